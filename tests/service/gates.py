"""The gate's processes for tests: `python -m tests.service.gates`. The first line of an OBJ says what its process does
beside looking through it."""

import json
import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from core.errors import ErrorCode, MeshmarkError
from service.template import Template, serve
from tests.worker.waiting import PATIENCE
from worker import gate

NO_FACE = b"\nv 0 0 0\n"
CRASH, HANG, FILL, PEEK = b"# crash", b"# hang", b"# fill", b"# peek"


def noted(started: Path, go: Path) -> bytes:
    """An OBJ without a face whose process leaves something in a folder, and waits until a file is there."""
    return f"# note {started} {go}".encode() + NO_FACE


def obedient() -> Template:
    """What such processes are forked from."""
    return Template([sys.executable, "-m", "tests.service.gates"], threads=1, name="gate")


def _answer(request: dict[str, Any]) -> MeshmarkError | None:
    if request["asset"] is None:
        return answer(request)
    order, *paths = Path(request["asset"]).read_bytes().split(b"\n")[0].decode().removeprefix("# ").split(" ")
    if order == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if order == "hang":
        time.sleep(PATIENCE)
    if order == "note":
        started, go = map(Path, paths)
        Path(started, str(os.getpid())).mkdir(parents=True)
        while not go.exists():
            time.sleep(0.01)
    return answer(request)


def _look(request: dict[str, Any], asset: bytes | None, font: bytes | None, logo: bytes | None) -> None:
    if asset and asset.startswith(FILL):
        asset += bytes(2 * request["memory"])
    if asset and asset.startswith(PEEK):
        raise MeshmarkError(ErrorCode.MALFORMED_FILE, json.dumps(_within_reach(Path(request["asset"]))), "")
    look(request, asset, font, logo)


def _within_reach(asset: Path) -> list[str]:
    reached = []
    for path in (asset, Path(__file__), Path(f"/proc/{os.getppid()}/environ"), Path("/dev/null")):
        with suppress(OSError):
            path.read_bytes()
            reached.append(str(path))
    with suppress(OSError):
        Path(asset.parent, "written").write_text("x")
        reached.append("writing")
    with suppress(OSError), socket.socket():
        reached.append("network")
    return reached


answer, look = gate.answer, gate.look

if __name__ == "__main__":
    gate.answer, gate.look = _answer, _look
    serve(socket.socket(fileno=sys.stdin.fileno()), gate.main)
