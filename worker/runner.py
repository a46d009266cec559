"""Run the engine in a child process that may crash, hang or exhaust memory without harm to the worker."""

import json
import os
import select
import signal
import socket
import time
from collections.abc import Generator, Mapping
from contextlib import closing, suppress
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
from service.template import Template, tail
from worker.child import SUFFIXES, processor_seconds

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
    with closing(Session(template, work, limits)) as session:
        yield from session.events()


class Session:
    """A child that runs the engine: for one job, and then for copies of the same asset, each a job of its own.

    `folder` is the only one that it can write in.

    Raises:
        StoreUnavailableError: the disk under the folder is full.
    """

    def __init__(self, template: Template, work: Work, limits: Limits) -> None:
        self.folder = work.folder
        self._limits, self._pid = limits, 0
        request = work.folder / "request"
        with writing():
            request.write_text(_request(work, limits))
            self._stderr = (work.folder / "stderr").open("w+b")
        self._channel, theirs = socket.socketpair()
        with theirs, request.open("rb") as stdin:  # closed here: the channel shall end with the child
            self._child = template.fork(stdin.fileno(), self._stderr.fileno(), theirs.fileno())

    def events(self) -> Generator[Progress | Published | None]:
        """Events and errors as :func:`run_engine` has them, of the job or copy that was asked for last."""
        done = yield from self._listen()
        if not done:
            raise _crashed(self._end())

    def may_go_on(self) -> bool:
        """True where the child, which is done, is there, and the limits of a job leave room for a copy."""
        if self._stderr.closed or select.select([self._channel], [], [], 0)[0]:  # it was ended, or died
            return False
        try:
            process = psutil.Process(self._pid)
            used, resident = sum(process.cpu_times()[:2]), process.memory_info().rss
        except psutil.NoSuchProcess:
            return False
        return bool(used < processor_seconds(self._limits.seconds) and resident < self._limits.memory / 2)

    def go_on(self, parameters: dict[str, Any], folder: Path) -> None:
        """Ask for a copy in a folder, which is the child's own under another name."""
        self.folder = folder
        order = json.dumps({"parameters": parameters, "folder": os.fspath(folder)}) + "\n"
        with suppress(BrokenPipeError):  # a child that died meanwhile is met in events()
            self._channel.sendall(order.encode())

    def close(self) -> None:
        """Kill the child's process group."""
        self._end()

    def _end(self) -> int | None:
        if self._stderr.closed:
            return None
        with self._channel, self._stderr:
            exit_code = self._child.end()
            if text := tail(self._stderr):
                log.warning("the engine's process wrote to stderr", text=text)
        return exit_code

    def _listen(self) -> Generator[Progress | Published | None, None, bool]:
        """Yield the events of the child; returns whether it said that it is done, before the channel was closed."""
        try:
            while not self._pid:
                self._pid = self._child.pid(TICK) or 0
                yield None
        except EOFError:
            return False
        deadline = time.monotonic() + self._limits.seconds
        buffer = b""
        while True:
            if select.select([self._channel], [], [], TICK)[0]:
                try:
                    chunk = self._channel.recv(65536)
                except ConnectionResetError:  # it died before it read what it was asked for
                    return False
                *lines, buffer = (buffer + chunk).split(b"\n")
                for line in lines:
                    message = json.loads(line)
                    if "done" in message:
                        return True
                    if "full" in message:
                        raise StoreUnavailableError
                    if error := message.get("error"):
                        raise MeshmarkError(error_code(error["code"]), error["message"], error["remedy"])
                    yield _event(message, self.folder)
                if not chunk or len(buffer) > LONGEST_MESSAGE:
                    return False
            _check_limits(self._pid, self._limits, deadline)
            yield None


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
