"""An engine that does what the asset tells it to: the first line of an OBJ is `# {"do": ..., ...}`."""

import ctypes
import errno
import hashlib
import json
import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.budgets import Budgets
from core.choices import FileFormat
from core.errors import ErrorCode, MeshmarkError
from core.notices import Notice, NoticeCode
from core.parameters import Parameters
from core.plan import Plan, PlannedMark
from core.report import Engine, FileFacts
from core.verify.original import Against
from core.verify.report import ReadMark, VerificationReport
from core.verify.seal import Seal
from tests.worker.waiting import PATIENCE

WORKER = os.getppid()  # in the template that imports this, and in its children

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def asset(do: str = "work", **details: Any) -> bytes:
    """An OBJ file that makes the engine below do something."""
    return f"# {json.dumps({'do': do, **details})}\n{TRIANGLE}".encode()


@dataclass(frozen=True)
class Result:
    model: bytes
    report: dict[str, Any]
    preview: bytes | None
    plan: Plan | None
    asset: int


def ordered(data: bytes) -> dict[str, Any]:
    """What an asset tells the engine to do; one that tells nothing, as a real one, is just worked on."""
    if not data.startswith(b"# "):
        return {"do": "work"}
    return dict(json.loads(data.split(b"\n", 1)[0].removeprefix(b"# ")))


def preload() -> None:
    """It imports nothing later."""


def directed(
    data: bytes,
    parameters: Parameters,
    *,
    budgets: Budgets,
    font: bytes | None = None,
    logo: bytes | None = None,
    preview: bool = True,
    plan: Plan | None = None,
    copies: Sequence[str] = (),
    before: int | None = None,
    progress: Callable[[str, float], None] | None = None,
    publish: Callable[[str, bytes], None] | None = None,
) -> Result:
    assert progress is not None
    assert publish is not None
    assert budgets.faces > 0
    order = ordered(data)
    progress("reading", 1.0)
    progress("placing", 0.5)
    ACTIONS[order.get("for", {}).get(parameters.text, order["do"])](order)
    model = b"glTF of " + parameters.text.encode()
    if "sign" in order:
        model += b" by %d" % os.getpid()
    publish("model", model)
    made = None
    if plan is None:
        longest = max([parameters.text, *copies], key=len)
        made = plan_for(data, parameters.model_copy(update={"text": longest}))
        publish("plan", made.to_json())
    missing = {"ocr": {"code": "not_measured", "message": "Not yet.", "remedy": "Wait."}}
    publish("report", json.dumps({"metrics": {"ocr": None, "missing": missing}}).encode())
    progress("evaluating", 0.0)
    ACTIONS[order.get("then", "work")](order)
    wait_for(order.get("wait_for_before_the_report"))
    picture = bytes.fromhex(order.get("picture", "89504e47")) if preview else None
    if picture is not None:
        publish("preview", picture)
    if parameters.format is not FileFormat.GLB:
        publish("export", b"ply\n")
    if parameters.explain:
        publish("explanation", b"{}")
        publish("layers", b"glTF of layers")
    if parameters.preview_model is not None:
        publish("preview_model", b"glTF in little")
    if parameters.turntable:
        publish("turntable", bytes.fromhex(order.get("animation", "52494646")))
        publish("poster", bytes.fromhex(order.get("animation", "52494646")))
    metrics = {"ocr": 1.0, "missing": {}}
    told: dict[str, Any] = {"placed_for": plan and plan.parameters.text} if plan else {}
    told |= {"text": parameters.text, "font": font is not None, "logo": logo is not None, "metrics": metrics}
    report = order.get("report", told)
    if "at_the_end" in order:
        publish("report", json.dumps(report).encode())
        ACTIONS[order["at_the_end"]](order)
    return Result(model, report, picture, made, asset=os.getpid() if before is None else before)


def plan_for(data: bytes, parameters: Parameters) -> Plan:
    """A plan with one place."""
    mark = PlannedMark(
        center=(0, 0, 0),
        axes=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        size=(3, 1, 1),
        line_height=1,
        color=None,
        glows=False,
        contrast=None,
        lighter=False,
        loss=0,
        roughness=1,
        views=(),
    )
    return Plan(
        engine="0",
        asset=hashlib.sha256(data).hexdigest(),
        parameters=parameters,
        offset=(0, 0, 0),
        scale=1,
        opaque=1,
        marks=(mark,),
    )


@dataclass(frozen=True)
class Seen:
    report: dict[str, Any]
    pictures: tuple[bytes, ...]
    heights: tuple[bytes, ...] = ()


def looked_at(data: bytes, texts: Sequence[str], budgets: Budgets, against: Against | None, seal: Seal) -> Seen:
    """A verification that does what the asset tells it to, and reads all texts; of a picture, it just reads."""
    assert budgets.faces > 0
    order = ordered(data)
    ACTIONS[order["do"]](order)
    common = {"likeness": 1.0, "confidence": 0.9, "votes": 1, "pictures": ["ordinary"], "pixel": (1.0, 2.0)}
    marks = [ReadMark.model_validate({"text": text, "known": text, **common}) for text in texts]
    report = VerificationReport(
        file=FileFacts(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data), format="obj"),
        engine=Engine(version="1", device="cpu"),
        texts=list(texts),
        found=list(texts) or None,
        marks=marks,
        label=None,
        credentials=None,
        warnings=[Notice(NoticeCode.HARD_TO_READ, compared(against, seal), "")],
        timings={"all": 0.0},
    )
    return Seen(report.model_dump(mode="json"), (b"\x89PNG",) * len(marks))


def compared(against: Against | None, seal: Seal) -> str:
    """The first bytes of what came beside a suspect file, in words."""
    there = {
        "original": against and against.original,
        "marked": against and against.report,
        "sidecar": seal.sidecar,
        "anchors": seal.anchors and seal.anchors.encode(),
    }
    return ", ".join(f"{name} {content[:12]!r}" for name, content in there.items() if content)


def wait_for(path: str | None) -> None:
    while path and not Path(path).exists():
        time.sleep(0.02)


def work(order: dict[str, Any]) -> None:
    wait_for(order.get("wait_for"))


def segfault(_order: dict[str, Any]) -> None:
    ctypes.string_at(0)


def tell_pid(pid: int) -> None:
    """In the attempt's own folder: nowhere else may an engine write."""
    Path(os.environ["TMPDIR"], "pid").write_text(str(pid))


def hang(_order: dict[str, Any]) -> None:
    """In native code, without giving up the interpreter's lock: no Python thread runs any more."""
    tell_pid(os.getpid())
    ctypes.PyDLL(None).sleep(600)


def find_disk_full(_order: dict[str, Any]) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def eat_memory(_order: dict[str, Any]) -> None:
    hoard = []
    while True:
        hoard.append(b"x" * 2**24)
        time.sleep(0.005)


def hoard(_order: dict[str, Any]) -> None:
    """Keep a quarter of a gigabyte for good."""
    globals()["hoarded"] = b"x" * 2**28


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


def spawn(_order: dict[str, Any]) -> None:
    tell_pid(subprocess.Popen(["sleep", "600"]).pid)
    time.sleep(600)


def reach_out(order: dict[str, Any]) -> None:
    """Try what the sandbox forbids, and tell what came of it."""
    found = {attempt.__name__: _outcome(attempt, order) for attempt in (connect, listen, read_private, write_outside)}
    inside = (read_worker, read_template, write_much, write_own)
    found |= {attempt.__name__: _outcome(attempt, order) for attempt in inside}
    raise MeshmarkError(ErrorCode.NO_PLACEMENT, json.dumps(found), ".")


def _outcome(attempt: Callable[[dict[str, Any]], object], order: dict[str, Any]) -> str:
    try:
        attempt(order)
    except OSError as error:
        return errno.errorcode[error.errno or 0]
    return "done"


def connect(order: dict[str, Any]) -> None:
    socket.create_connection(("127.0.0.1", order["port"]), timeout=PATIENCE)


def listen(_order: dict[str, Any]) -> None:
    socket.socket(socket.AF_UNIX)


def read_private(order: dict[str, Any]) -> None:
    Path(order["private"]).read_bytes()


def write_outside(order: dict[str, Any]) -> None:
    Path(order["outside"]).write_bytes(b"1")


def read_worker(_order: dict[str, Any]) -> None:
    Path(f"/proc/{WORKER}/environ").read_bytes()


def read_template(_order: dict[str, Any]) -> None:
    Path(f"/proc/{os.getppid()}/environ").read_bytes()


def write_much(_order: dict[str, Any]) -> None:
    with Path(os.environ["TMPDIR"], "much").open("wb") as file:
        file.seek(2**31)
        file.write(b"1")


def write_own(_order: dict[str, Any]) -> None:
    Path(os.environ["TMPDIR"], "own").write_bytes(b"1")


def tell_process(_order: dict[str, Any]) -> None:
    """What this process is and has open."""
    opened = {}
    for path in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the folder itself
            opened[path.name] = os.fspath(path.readlink())
    found = {"pid": os.getpid(), "session": os.getsid(0), "template": os.getppid(), "opened": opened}
    raise MeshmarkError(ErrorCode.NO_PLACEMENT, json.dumps(found), tempfile.gettempdir())


def link_instead(order: dict[str, Any]) -> None:
    """Leave links to what the worker may read in the place of results."""
    _instead_of_writing(lambda path: path.symlink_to(order["private"]))


def pipe_instead(_order: dict[str, Any]) -> None:
    """Leave pipes, which nobody writes to, in the place of results."""
    _instead_of_writing(os.mkfifo)


def _instead_of_writing(make: Callable[[Path], object]) -> None:
    setattr(Path, "write_bytes", lambda path, _content: make(path))  # noqa: B010


def tell_environment(_order: dict[str, Any]) -> None:
    raise MeshmarkError(ErrorCode.NO_PLACEMENT, json.dumps(dict(os.environ)), ".")


def kill_worker(order: dict[str, Any]) -> None:
    """Each one, or only that with a process id."""
    if order.get("pid", WORKER) == WORKER:
        os.kill(WORKER, signal.SIGKILL)
        time.sleep(600)


ACTIONS: dict[str, Callable[[dict[str, Any]], None]] = {
    function.__name__: function
    for function in (
        work,
        segfault,
        hang,
        eat_memory,
        hoard,
        find_disk_full,
        refuse,
        stumble,
        run_out_of_memory,
        leave,
        chatter,
        spawn,
        reach_out,
        link_instead,
        pipe_instead,
        tell_environment,
        tell_process,
        kill_worker,
    )
}
