"""Run the engine in a child process that may crash, hang or eat memory without harm to the worker."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import psutil
import structlog

from core.asset.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from service.jobs.artifacts import StoreUnavailableError, writing
from service.jobs.models import ArtifactKind
from worker.child import SUFFIXES

TICK = 0.1  # seconds between two looks at the child
LONGEST_MESSAGE = 2**20
LOGGED = 4000  # last characters of the child's stderr that are logged

# What the child gets of the worker's environment. The ledger's and the broker's passwords are not among it: the child
# handles hostile input.
PASSED_ON = (
    *("PATH", "HOME", "LANG", "TZ", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH"),
    *("MESHMARK_MODELS", "MESHMARK_DEVICE", "WARP_CACHE_PATH"),
)
PASSED_ON_PREFIXES = ("LC_", "XDG_", "OMP_", "MKL_", "OPENBLAS_", "CUDA_", "NVIDIA_", "TORCH_", "EGL_", "PYOPENGL_")
# What tells the numeric libraries, libigl and Mesa's software renderer how many threads to use.
THREADS = ("OMP_NUM_THREADS", "IGL_NUM_THREADS", "LP_NUM_THREADS")

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Work:
    """One call of the engine: its import path, its input files, and a folder that is its own.

    Of the private folders it sees nothing else; with `sandbox` "required" it does not run without being shut in.
    """

    engine: str
    input: Path
    font: Path | None
    parameters: dict[str, Any]
    budgets: Budgets
    folder: Path
    private: tuple[Path, ...] = ()
    sandbox: str = "required"


@dataclass(frozen=True)
class Limits:
    """Wall-clock seconds, resident bytes, and how many threads share the work."""

    seconds: float
    memory: int
    threads: int


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


def run_engine(work: Work, limits: Limits) -> Generator[Progress | Published | None]:
    """What the child reports, as it comes, and None at least once per tick; ends when the engine is done.

    Close the generator to stop the child. Whatever way the iteration ends, the child and what it started are killed.

    Raises:
        StoreUnavailableError: the disk under the working folder is full.
        MeshmarkError: the engine's own; ``time_limit``, ``memory_limit``; ``engine_crashed`` when the child died.
    """
    errors = work.folder / "stderr"
    with writing():
        stderr = errors.open("wb")
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb", buffering=0) as channel, stderr:
        with os.fdopen(writer, "wb"):  # closed here once the child has it, so that the pipe ends with the child
            child = subprocess.Popen(
                [sys.executable, "-m", "worker.child"],
                stdin=subprocess.PIPE,
                stdout=stderr,
                stderr=stderr,
                pass_fds=[writer],
                env=_environment(work.folder, limits.threads),
                start_new_session=True,  # out of reach of Ctrl-C, and one group to kill
            )
        try:
            _order(child, work, limits, writer)
            yield from _listen(child, channel.fileno(), limits, work.folder)
        finally:
            _kill(child)
            _log_stderr(errors)


def _order(child: "subprocess.Popen[bytes]", work: Work, limits: Limits, channel: int) -> None:
    request = {
        "engine": work.engine,
        "input": os.fspath(work.input),
        "font": os.fspath(work.font) if work.font else None,
        "parameters": work.parameters,
        "budgets": asdict(work.budgets),
        "folder": os.fspath(work.folder),
        "private": [os.fspath(path) for path in work.private],
        "sandbox": work.sandbox,
        "seconds": limits.seconds,
        "parent": os.getpid(),
        "channel": channel,
    }
    assert child.stdin is not None
    with suppress(BrokenPipeError), child.stdin as stdin:  # a child that is gone already is met in _listen
        stdin.write(json.dumps(request).encode())


def _listen(
    child: "subprocess.Popen[bytes]", channel: int, limits: Limits, folder: Path
) -> Generator[Progress | Published | None]:
    deadline = time.monotonic() + limits.seconds
    process = psutil.Process(child.pid)
    buffer = b""
    while True:
        if select.select([channel], [], [], TICK)[0]:
            chunk = os.read(channel, 65536)
            *lines, buffer = (buffer + chunk).split(b"\n")
            for line in lines:
                message = json.loads(line)
                if "done" in message:
                    return
                if "full" in message:
                    raise StoreUnavailableError
                if error := message.get("error"):
                    raise MeshmarkError(ErrorCode(error["code"]), error["message"], error["remedy"])
                yield _event(message, folder)
            if not chunk or len(buffer) > LONGEST_MESSAGE:
                raise _crashed(child)
        _check_limits(process, limits, deadline)
        yield None


def _event(message: dict[str, Any], folder: Path) -> Progress | Published:
    if kind := message.get("artifact"):
        return Published(ArtifactKind(kind), folder / (kind + SUFFIXES[kind]))
    return Progress(message["stage"], min(max(message["progress"], 0.0), 1.0))


def _check_limits(process: psutil.Process, limits: Limits, deadline: float) -> None:
    if time.monotonic() > deadline:
        raise MeshmarkError(
            ErrorCode.TIME_LIMIT,
            f"This asset took longer than the {limits.seconds:g} seconds a job may take.",
            "Reduce the asset or ask for fewer watermarks.",
        )
    try:
        resident = process.memory_info().rss
    except psutil.NoSuchProcess:
        return
    if resident > limits.memory:
        raise MeshmarkError(
            ErrorCode.MEMORY_LIMIT,
            f"This asset needed more than the {limits.memory // 2**20} MiB of memory a job may hold.",
            "Reduce the number of faces or the size of the textures.",
        )


def _crashed(child: "subprocess.Popen[bytes]") -> MeshmarkError:
    """Why the pipe closed without a result."""
    try:
        code = child.wait(timeout=2)
    except subprocess.TimeoutExpired:
        reason = "stopped answering"
    else:
        reason = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"left with exit code {code}"
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED,
        f"The process that worked on this asset {reason} before it was done.",
        "Send the asset again; if it happens again, re-export it from its authoring tool, or report this job's id.",
    )


def _kill(child: "subprocess.Popen[bytes]") -> None:
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)  # the group: also what the engine may have started
    child.wait()


def _environment(folder: Path, threads: int) -> dict[str, str]:
    passed = {key: value for key, value in os.environ.items() if key in PASSED_ON or key.startswith(PASSED_ON_PREFIXES)}
    own = {"TMPDIR": os.fspath(folder), "PYTHONUNBUFFERED": "1"}
    return dict.fromkeys(THREADS, str(threads)) | passed | own


def _log_stderr(path: Path) -> None:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - LOGGED))
        if text := file.read().decode(errors="replace").strip():
            log.warning("the engine's process wrote to stderr", text=text)
