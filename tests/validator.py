"""The Khronos glTF validator, run on bytes."""

import atexit
import json
import select
import shutil
import struct
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest

_TESTS = Path(__file__).parent
ERROR = 0
PATIENCE = 120.0  # seconds for one file


class ValidatorBrokenError(Exception):
    """The validator itself breaks on a file."""


@cache
def _validator() -> subprocess.Popen[bytes]:
    """One process for all files of a test process: Node.js takes longer to start than most files to be validated."""
    node = shutil.which("node")
    if node is None or not (_TESTS / "node_modules" / "gltf-validator").is_dir():
        pytest.fail("The glTF validator is missing: install Node.js, then run `npm ci --prefix tests`.", pytrace=False)
    process = subprocess.Popen(
        [node, "validate_gltf.mjs"], cwd=_TESTS, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
    )
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


def _answer(process: subprocess.Popen[bytes]) -> bytes:
    assert process.stdout is not None
    line = b""
    while not line.endswith(b"\n"):
        if not select.select([process.stdout], [], [], PATIENCE)[0]:
            raise TimeoutError(f"The glTF validator says nothing for {PATIENCE:.0f} s.")
        part = process.stdout.read(1 << 20)
        if not part:
            raise ValidatorBrokenError(f"it ended with exit code {process.wait()}")
        line += part
    return line


def validate(glb: bytes) -> dict[str, Any]:
    """The validator's report on a GLB; a missing validator fails the test.

    Raises:
        ValidatorBrokenError: where the validator fails instead of reporting.
    """
    process = _validator()
    assert process.stdin is not None
    try:
        rest = memoryview(struct.pack("<I", len(glb)) + glb)
        while rest:
            rest = rest[process.stdin.write(rest) :]
        report: dict[str, Any] = json.loads(_answer(process))
    except BaseException:
        # What it may still answer would be taken for the answer to the next file.
        _end(process)
        _validator.cache_clear()
        raise
    if "broken" in report:
        raise ValidatorBrokenError(report["broken"])
    return report


def error_counts(glb: bytes) -> Counter[str]:
    """How often each error code of the validator occurs in a GLB."""
    return Counter(message["code"] for message in validate(glb)["issues"]["messages"] if message["severity"] == ERROR)
