"""An engine that does what the asset tells it to: the first line of an OBJ is `# {"do": ..., ...}`."""

import ctypes
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.asset.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def asset(do: str = "work", **details: Any) -> bytes:
    """An OBJ file that makes the engine below do something."""
    return f"# {json.dumps({'do': do, **details})}\n{TRIANGLE}".encode()


@dataclass(frozen=True)
class Result:
    model: bytes
    report: dict[str, Any]
    preview: bytes | None


def directed(
    data: bytes,
    parameters: Parameters,
    *,
    budgets: Budgets,
    font: bytes | None = None,
    progress: Callable[[str, float], None] | None = None,
    publish: Callable[[str, bytes], None] | None = None,
) -> Result:
    assert progress is not None
    assert publish is not None
    assert budgets.faces > 0
    order = json.loads(data.split(b"\n", 1)[0].removeprefix(b"# "))
    progress("reading", 1.0)
    progress("placing", 0.5)
    ACTIONS[order["do"]](order)
    model = b"glTF of " + parameters.text.encode()
    if "sign" in order:
        model += b" by %d" % os.getpid()
    publish("model", model)
    missing = {"ocr": {"code": "not_measured", "message": "Not yet.", "remedy": "Wait."}}
    publish("report", json.dumps({"metrics": {"ocr": None, "missing": missing}}).encode())
    progress("evaluating", 0.0)
    ACTIONS[order.get("then", "work")](order)
    wait_for(order.get("wait_for_before_the_report"))
    preview = b"\x89PNG"
    publish("preview", preview)
    return Result(model, {"text": parameters.text, "font": font is not None, "metrics": {"ocr": 1.0}}, preview)


def wait_for(path: str | None) -> None:
    while path and not Path(path).exists():
        time.sleep(0.02)


def work(order: dict[str, Any]) -> None:
    wait_for(order.get("wait_for"))


def segfault(_order: dict[str, Any]) -> None:
    ctypes.string_at(0)


def hang(order: dict[str, Any]) -> None:
    """In native code, without giving up the interpreter's lock: no Python thread runs any more."""
    if "pid_file" in order:
        Path(order["pid_file"]).write_text(str(os.getpid()))
    ctypes.PyDLL(None).sleep(600)


def eat_memory(_order: dict[str, Any]) -> None:
    hoard = []
    while True:
        hoard.append(b"x" * 2**24)
        time.sleep(0.005)


def refuse(_order: dict[str, Any]) -> None:
    raise MeshmarkError(ErrorCode.NO_PLACEMENT, "No place on this asset.", "Ask for smaller letters.")


def stumble(_order: dict[str, Any]) -> None:
    raise RuntimeError("secret detail of the implementation")


def run_out_of_memory(_order: dict[str, Any]) -> None:
    raise MemoryError


def leave(_order: dict[str, Any]) -> None:
    os._exit(3)


def chatter(_order: dict[str, Any]) -> None:
    os.write(1, b'{"done": true}\n' * 10_000)


def spawn(order: dict[str, Any]) -> None:
    process = subprocess.Popen(["sleep", "600"])
    Path(order["pid_file"]).write_text(str(process.pid))
    time.sleep(600)


def tell_environment(_order: dict[str, Any]) -> None:
    raise MeshmarkError(ErrorCode.NO_PLACEMENT, json.dumps(dict(os.environ)), ".")


def kill_parent(order: dict[str, Any]) -> None:
    """Kill the worker: each time, or with a marker file only the first time."""
    marker = Path(order["once"]) if "once" in order else None
    if marker is None or not marker.exists():
        if marker:
            marker.touch()
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(600)


ACTIONS: dict[str, Callable[[dict[str, Any]], None]] = {
    function.__name__: function
    for function in (
        work,
        segfault,
        hang,
        eat_memory,
        refuse,
        stumble,
        run_out_of_memory,
        leave,
        chatter,
        spawn,
        tell_environment,
        kill_parent,
    )
}
