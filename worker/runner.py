"""Run the engine in a child process that may crash, hang or exhaust memory without harm to the worker."""

import json
import os
import select
import signal
import time
from collections.abc import Generator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import psutil
import structlog

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode, error_code
from service.jobs.artifacts import StoreUnavailableError, writing
from service.jobs.models import ArtifactKind
from service.template import Child, Template, tail
from worker.child import SUFFIXES

TICK = 0.1  # seconds between two checks of the child's limits
LONGEST_MESSAGE = 2**20  # bytes

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Work:
    """Call of the engine: its input files, and a working folder of its own.

    It can read nothing else in the private folders; with `sandbox` "required" it does not run outside a whole sandbox.
    """

    input: Path
    font: Path | None
    parameters: dict[str, Any]
    budgets: Budgets
    folder: Path
    private: tuple[Path, ...] = ()
    sandbox: str = "required"
    logo: Path | None = None
    placement: Path | None = None
    texts: Path | None = None
    verification: "Verification | None" = None
    conversion: bool = False  # of the input into a plain GLB, and nothing else


@dataclass(frozen=True)
class Verification:
    """Call of a verification, beside its file and parameters.

    Attributes:
        verifier: the function that does it, as "module:function".
        filename: the file's name, for the page of evidence.
        moment: its moment, for that page, as in ISO 8601.
        files: paths of an ``original``, of the report of the job that ``marked`` it, and of a ``sidecar``.
        anchors: PEM of the root certificates that are trusted.
    """

    verifier: str
    filename: str
    moment: str
    files: Mapping[str, str]
    anchors: str | None


@dataclass(frozen=True)
class Limits:
    """Wall-clock seconds from the child's start, and resident bytes, those it shares with the template included."""

    seconds: float
    memory: int


@dataclass(frozen=True)
class Progress:
    """The engine's stage, and the share done of the whole run (0 to 1)."""

    stage: str
    fraction: float


@dataclass(frozen=True)
class Published:
    """The engine wrote an artifact."""

    kind: ArtifactKind
    path: Path


def run_engine(template: Template, work: Work, limits: Limits) -> Generator[Progress | Published | None]:
    """Run the engine in a child; yields its events as they come, and None at least once per tick, until it is done.

    Close the generator to stop the child. However the iteration ends, the child's process group is killed.

    Raises:
        StoreUnavailableError: the disk under the working folder is full.
        MeshmarkError: the engine's own; ``time_limit``, ``memory_limit``; ``engine_crashed`` when the child died.
    """
    request = work.folder / "request"
    with writing():
        request.write_text(_request(work, limits))
        stderr = (work.folder / "stderr").open("w+b")
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb", buffering=0) as channel, stderr:
        with os.fdopen(writer, "wb"), request.open("rb") as stdin:  # closed here: the pipe shall end with the child
            child = template.fork(stdin.fileno(), stderr.fileno(), writer)
        try:
            done = yield from _listen(child, channel.fileno(), limits, work.folder)
        finally:
            exit_code = child.end()
            if text := tail(stderr):
                log.warning("the engine's process wrote to stderr", text=text)
    if not done:
        raise _crashed(exit_code)


def _request(work: Work, limits: Limits) -> str:
    return json.dumps(
        {
            "input": os.fspath(work.input),
            "font": os.fspath(work.font) if work.font else None,
            "logo": os.fspath(work.logo) if work.logo else None,
            "placement": os.fspath(work.placement) if work.placement else None,
            "texts": os.fspath(work.texts) if work.texts else None,
            "parameters": work.parameters,
            "budgets": asdict(work.budgets),
            "folder": os.fspath(work.folder),
            "private": [os.fspath(path) for path in work.private],
            "sandbox": work.sandbox,
            "seconds": limits.seconds,
            "verification": work.verification and asdict(work.verification),
            "conversion": work.conversion,
        }
    )


def _listen(
    child: Child, channel: int, limits: Limits, folder: Path
) -> Generator[Progress | Published | None, None, bool]:
    """Yield the events of a child; returns whether it said that it is done, before the pipe was closed."""
    try:
        while (pid := child.pid(TICK)) is None:
            yield None
    except EOFError:
        return False
    deadline = time.monotonic() + limits.seconds
    buffer = b""
    while True:
        if select.select([channel], [], [], TICK)[0]:
            chunk = os.read(channel, 65536)
            *lines, buffer = (buffer + chunk).split(b"\n")
            for line in lines:
                message = json.loads(line)
                if "done" in message:
                    return True
                if "full" in message:
                    raise StoreUnavailableError
                if error := message.get("error"):
                    raise MeshmarkError(error_code(error["code"]), error["message"], error["remedy"])
                yield _event(message, folder)
            if not chunk or len(buffer) > LONGEST_MESSAGE:
                return False
        _check_limits(pid, limits, deadline)
        yield None


def _event(message: dict[str, Any], folder: Path) -> Progress | Published:
    if kind := message.get("artifact"):
        return Published(ArtifactKind(kind), folder / (kind + SUFFIXES[kind]))
    return Progress(message["stage"], max(0.0, min(1.0, message["progress"])))


def _check_limits(pid: int, limits: Limits, deadline: float) -> None:
    if time.monotonic() > deadline:
        raise MeshmarkError(
            ErrorCode.TIME_LIMIT,
            f"This asset took longer than the {limits.seconds:g} seconds a job may take.",
            "Reduce the asset or ask for fewer watermarks.",
        )
    try:
        resident = psutil.Process(pid).memory_info().rss
    except psutil.NoSuchProcess:
        return
    if resident > limits.memory:
        raise MeshmarkError(
            ServiceErrorCode.MEMORY_LIMIT,
            f"This asset needed more than the {limits.memory // 2**20} MiB of memory a job may hold.",
            "Reduce the number of faces or the size of the textures.",
        )


def _crashed(exit_code: int | None) -> MeshmarkError:
    """Error for a pipe that closed without a result."""
    if exit_code is None:
        reason = "stopped answering"
    elif exit_code < 0:
        reason = f"was ended by {signal.Signals(-exit_code).name}"
    else:
        reason = f"left with exit code {exit_code}"
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED,
        f"The process that worked on this asset {reason} before it was done.",
        "Send the asset again; if it happens again, re-export it from its authoring tool, or report this job's id.",
    )
