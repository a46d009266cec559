"""The Khronos glTF validator, run on bytes."""

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

_TESTS = Path(__file__).parent
ERROR = 0


def validate(glb: bytes) -> dict[str, Any]:
    """The validator's report on a GLB; a missing validator fails the test."""
    node = shutil.which("node")
    if node is None or not (_TESTS / "node_modules" / "gltf-validator").is_dir():
        pytest.fail("The glTF validator is missing: install Node.js, then run `npm ci --prefix tests`.", pytrace=False)
    result = subprocess.run(
        [node, "validate_gltf.mjs"], cwd=_TESTS, input=glb, capture_output=True, timeout=120, check=True
    )
    report: dict[str, Any] = json.loads(result.stdout)
    return report


def error_counts(glb: bytes) -> Counter[str]:
    """How often each error code of the validator occurs in a GLB."""
    return Counter(message["code"] for message in validate(glb)["issues"]["messages"] if message["severity"] == ERROR)
