"""The process that runs the engine, forked by :mod:`worker.template` for :mod:`worker.runner`.

It reads one JSON object from stdin and answers in JSON lines on a socket of its own, since native libraries print on
stdout: `{"stage", "progress"}`, `{"artifact", "path"}`, and last `{"done": true}`, `{"error": {...}}`, or, where the
disk is, `{"full": true}`. Files stay in the working folder it was given.

One that has an asset with a plan then waits: a line `{"parameters", "folder"}` on the socket asks for a copy of it,
whose folder is the first one under another name.
"""

import ctypes
import errno
import faulthandler
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TextIO

from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from worker import sandbox

PR_SET_PDEATHSIG = 1  # linux/prctl.h
LARGEST_FILE = 2**31  # bytes; results are far smaller
CPU_MARGIN = 60  # seconds beyond all cores' time within the job's limit
CHANNEL = 3  # the descriptor of its answers, after stdin, stdout and stderr
SUFFIXES = {
    "model": ".glb",
    "preview_model": ".glb",
    "export": ".bin",
    "plan": ".json",
    "report": ".json",
    "preview": ".png",
    "turntable": ".webp",
    "poster": ".webp",
    "explanation": ".json",
    "layers": ".glb",
    "evidence": ".html",
}

Engine = Callable[..., Any]  # core.pipeline.watermark, or one like it
Say = Callable[..., None]  # sends one message


def die_with_parent(parent: int) -> None:
    """Be killed by the kernel as soon as the thread that started this process is gone (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it went before the request was made
        os._exit(1)


class Outputs:
    """Artifacts of a run, in its working folder."""

    def __init__(self, folder: Path, say: Say) -> None:
        self._folder, self._say = folder, say
        self.published: set[str] = set()

    def publish(self, kind: str, content: bytes) -> None:
        """Write an artifact and send its path."""
        path = self._folder / (kind + SUFFIXES[kind])
        partial = path.with_suffix(".partial")
        partial.write_bytes(content)
        partial.replace(path)  # the report is written twice: whenever this process ends, one of them is whole
        self.published.add(kind)
        self._say(artifact=kind, path=os.fspath(path))


def run(engine: Engine, request: dict[str, Any], say: Say, further: Iterable[dict[str, Any]]) -> None:
    """Call the engine and send the paths of its artifacts as it publishes them; then once for each further copy.

    Args:
        engine: the engine's function.
        request: ``input``, ``font``, ``logo``, ``placement`` and ``texts`` as paths, ``parameters``, ``budgets``,
            ``folder``.
        say: sends one message.
        further: ``parameters`` and ``folder`` of copies of the same asset at the same places.

    Raises:
        MeshmarkError: as the engine does.
    """
    from core.budgets import Budgets
    from core.parameters import parse_parameters
    from core.plan import parse_plan

    given = partial(
        engine,
        Path(request["input"]).read_bytes(),
        budgets=Budgets(**request["budgets"]),
        font=Path(request["font"]).read_bytes() if request["font"] else None,
        logo=Path(request["logo"]).read_bytes() if request["logo"] else None,
        progress=lambda stage, fraction: say(stage=stage, progress=float(fraction)),
    )
    plan = parse_plan(Path(request["placement"]).read_bytes()) if request["placement"] else None
    texts = json.loads(Path(request["texts"]).read_bytes()) if request["texts"] else ()

    def mark(asked: dict[str, Any], **more: Any) -> Any:
        outputs = Outputs(Path(asked["folder"]), say)
        parameters = parse_parameters(asked["parameters"])
        # Copies look as their job does, but for the text.
        result = given(parameters, preview=more["plan"] is None, publish=outputs.publish, **more)
        for kind, content in (("model", result.model), ("preview", result.preview)):
            if content is not None and kind not in outputs.published:
                outputs.publish(kind, content)
        outputs.publish("report", json.dumps(result.report, allow_nan=False).encode())
        return result

    result = mark(request, plan=plan, copies=texts)
    plan, asset = plan or result.plan, result.asset
    del result  # all else of it is written
    if plan is not None:
        for copy in further:
            mark(copy, plan=plan, before=asset)


def run_verification(request: dict[str, Any], say: Say) -> None:
    """Verify a suspect file, and send the paths of the page of evidence and the report.

    Args:
        request: ``input`` as a path, ``parameters`` with the known ``texts``, ``budgets``, ``folder``, and
            ``verification``: :class:`worker.runner.Verification`.
        say: sends one message.

    Raises:
        MeshmarkError: as :func:`core.verify.verify.verify` does.
    """
    from core.budgets import Budgets
    from core.verify.evidence import evidence_page
    from core.verify.original import Against
    from core.verify.seal import Seal

    asked = request["verification"]
    module, _, function = asked["verifier"].partition(":")
    verify = getattr(import_module(module), function)
    say(stage="reading", progress=0.0)
    texts, budgets = request["parameters"]["texts"], Budgets(**request["budgets"])
    original, marked, sidecar = (
        Path(path).read_bytes() if path else None for path in map(asked["files"].get, ("original", "marked", "sidecar"))
    )
    against = None if original is None else Against(original, marked)
    result = verify(Path(request["input"]).read_bytes(), texts, budgets, against, Seal(sidecar, asked["anchors"]))
    moment = datetime.fromisoformat(asked["moment"])
    outputs = Outputs(Path(request["folder"]), say)
    outputs.publish(
        "evidence", evidence_page(result.report, result.pictures, asked["filename"], moment, result.heights)
    )
    outputs.publish("report", json.dumps(result.report, allow_nan=False).encode())


def run_conversion(request: dict[str, Any], say: Say) -> None:
    """Decode an asset, and send the path of the plain GLB.

    Args:
        request: ``input`` as a path, ``budgets``, ``folder``.
        say: sends one message.

    Raises:
        MeshmarkError: as :func:`core.conversion.plain_glb` does.
    """
    from core.budgets import Budgets
    from core.conversion import plain_glb

    say(stage="reading", progress=0.0)
    model = plain_glb(Path(request["input"]).read_bytes(), Budgets(**request["budgets"]))
    Outputs(Path(request["folder"]), say).publish("model", model)


def processor_seconds(seconds: float) -> int:
    """The most that a job with a limit of so many seconds can take of all cores."""
    return int(seconds * (os.cpu_count() or 1)) + CPU_MARGIN


def limit(seconds: float) -> None:
    """Set resource limits: CPU time, file size, no core dumps.

    Memory has none: CUDA and ONNX reserve address space without using it, so the worker watches resident memory.
    Time is for two jobs, in case the worker no longer enforces it: it asks for no copy after that for one is used.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a crash is reported, not written to disk with the asset in it
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))
    most = 2 * processor_seconds(seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (most, most))


def confine(request: dict[str, Any]) -> dict[str, bool]:
    """Enter the sandbox; returns which of its protections are in force."""
    caches = [
        Path(os.environ.get("WARP_CACHE_PATH") or Path.home() / ".cache" / "warp")
    ]  # kernels compiled for the GPU
    return sandbox.enter(Path(request["folder"]), map(Path, request["private"]), caches)


def keep_only(request: int, stderr: int, channel: int) -> None:
    """Make these the first descriptors, and close all others, among them those of the template."""
    for number, file in enumerate((request, stderr, stderr, channel)):
        os.dup2(file, number, inheritable=number != CHANNEL)
    os.closerange(CHANNEL + 1, os.sysconf("SC_OPEN_MAX"))


def main(engine: Engine, parent: int, *files: int) -> NoReturn:
    """Serve one request and exit without the teardown of native libraries, which adds nothing but time and crashes.

    Args:
        engine: the engine's function.
        parent: the process that forked this one, with which it ends.
        files: descriptors of the request, of stderr and of the channel.
    """
    os.setsid()  # a process group of its own, to be killed as a whole
    die_with_parent(parent)
    keep_only(*files)
    request = json.load(sys.stdin)
    os.environ["TMPDIR"], tempfile.tempdir = request["folder"], None
    limit(request["seconds"])
    in_force = confine(request)
    faulthandler.enable()
    channel: TextIO = os.fdopen(CHANNEL, "w", buffering=1)

    def say(**message: Any) -> None:
        channel.write(json.dumps(message) + "\n")

    def further() -> Iterator[dict[str, Any]]:
        with open(CHANNEL, closefd=False) as lines:
            say(done=True)
            for line in lines:
                copy = json.loads(line)
                os.environ["TMPDIR"], tempfile.tempdir = copy["folder"], None
                yield copy
                say(done=True)
        os._exit(0)  # the worker is gone

    try:
        if request["sandbox"] == "required" and not all(in_force.values()):
            raise RuntimeError(f"the sandbox is not whole: {in_force}")
        if request["verification"]:
            run_verification(request, say)
        elif request["conversion"]:
            run_conversion(request, say)
        else:
            run(engine, request, say, further())
        say(done=True)
    except MeshmarkError as error:
        say(error={"code": error.code, "message": error.message, "remedy": error.remedy})
    except MemoryError:
        say(
            error={
                "code": ServiceErrorCode.MEMORY_LIMIT,
                "message": "There is not enough memory on the machine for this asset.",
                "remedy": "Reduce the asset, or run the worker where there is more memory.",
            }
        )
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            say(full=True)
            os._exit(0)
        traceback.print_exc()
        say(
            error={
                "code": ErrorCode.INTERNAL_ERROR,
                "message": "The engine met a case it does not handle.",
                "remedy": "Report this job's id to the operator; the log holds the details.",
            }
        )
    sys.stderr.flush()
    os._exit(0)
