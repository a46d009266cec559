"""Intake of uploads: each is checked before it becomes a job, in a process that may crash, hang or be killed.

Uploads wait without holding a thread, have threads of their own, and are checked by a limited number of processes; a
fair semaphore shares both among tenants, none of whom gets all. So one tenant's uploads delay neither other tenants'
nor any other request.
"""

import json
import os
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TypeVar

import anyio.to_thread
import structlog

from core.artwork.layout import set_text
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from service.config import Settings
from service.errors import error_code
from service.fair_semaphore import FairSemaphore
from service.jobs.artifacts import Staged, writing
from service.template import Child, Template, tail

THREADS = 32  # for uploads, beside the threads of other requests
TICK = 1.0  # seconds between two polls for the start of a process
MEMORY_MARGIN = 256 * 2**20  # bytes beyond twice the limits of an upload and of its content
LONGEST_ANSWER = 2**20  # bytes

Result = TypeVar("Result")
# Errors of uploads, None where there is none, by what is done with them, and the SHA-256 of each by its kind.
Verdicts = dict[tuple[str, ...], MeshmarkError | None]

log = structlog.get_logger(__name__)


def gate_template() -> Template:
    """Template that the gate's processes are forked from."""
    return Template([sys.executable, "-m", "worker.gate"], threads=1, name="gate")


class Intake:
    """Concurrency limits, threads and processes of an API's uploads.

    Args:
        settings: budgets, the number of concurrent checks, and their time limit.
        template: template that the processes are forked from.
    """

    def __init__(self, settings: Settings, template: Template) -> None:
        self._uploads = FairSemaphore(THREADS)
        self._threads = anyio.CapacityLimiter(THREADS)
        self._processes = FairSemaphore(settings.intake_concurrency)
        self._template = template
        self._seconds = settings.intake_time_limit
        self._request = {
            "budgets": asdict(settings.budgets),
            "seconds": settings.intake_time_limit,
            "memory": 2 * (settings.max_upload_bytes + settings.max_unpacked_bytes) + MEMORY_MARGIN,
            "sandbox": settings.sandbox,
            "lettering": "",
            "pictures": False,
        }

    async def run(self, tenant: str, function: Callable[[], Result]) -> Result:
        """Call a function that takes uploads in, in a thread of the intake once it is its tenant's turn; returns its
        result.

        Raises:
            MeshmarkError: the function's own; ``service_unavailable``, the service stops.
        """
        async with self._uploads.acquired_async(tenant):
            return await anyio.to_thread.run_sync(function, limiter=self._threads)

    def check(
        self,
        tenant: str,
        parameters: Parameters,
        asset: Staged | None,
        font: Staged | None,
        known: Verdicts | None = None,
        logo: Staged | None = None,
    ) -> None:
        """Refuse an upload that cannot be watermarked, as far as its headers, its font and its logo tell.

        Args:
            tenant: whose upload it is.
            parameters: of the engine.
            asset: the asset, if it is here.
            font: the font, if it is not the engine's own.
            known: verdicts of earlier calls, to which that of this one is added.
            logo: the logo, if there is one.

        Raises:
            MeshmarkError: as :func:`worker.gate.look` does; ``budget_exceeded`` too where the check took too long,
                ``engine_crashed`` where its process died, ``service_unavailable``.
        """
        words, lettering = parameters.resolved().text, ""
        text = words.strip()
        if font is None and text:
            set_text(words)
        if font or (text and parameters.qr):  # by the outlines of the text goes how large a code beside it is
            lettering = parameters.model_dump_json(exclude={"keep_out", "prefer"})
        known = {} if known is None else known
        if lettering or logo:
            self._look(tenant, known, {"lettering": lettering}, font=font, logo=logo)
        if asset:  # by itself, since a batch may name it often
            self._look(tenant, known, {}, asset=asset)

    def check_suspect(self, tenant: str, suspect: Staged | None, original: Staged | None = None) -> None:
        """Refuse a file that cannot be verified, an asset or a picture, as far as its headers tell, and an original
        that is no asset.

        Args:
            tenant: whose upload it is.
            suspect: the file, if it is here.
            original: the original, if there is one.

        Raises:
            MeshmarkError: as :meth:`check` does.
        """
        if suspect:
            self._look(tenant, {}, {"pictures": True}, asset=suspect)
        if original:
            self.check_asset(tenant, original)

    def check_asset(self, tenant: str, asset: Staged) -> None:
        """Refuse an asset that cannot be read, as far as its headers tell.

        Raises:
            MeshmarkError: as :meth:`check` does.
        """
        self._look(tenant, {}, {}, asset=asset)

    def _look(self, tenant: str, known: Verdicts, more: Mapping[str, object], **files: Staged | None) -> None:
        """Refuse files, or what is to be done with them, by the verdict of the gate, which is asked once."""
        key = (json.dumps(more), *(f"{name} {file.sha256}" for name, file in files.items() if file))
        if key not in known:
            known[key] = self._check(tenant, more, files)
        if refusal := known[key]:
            # As a new error: it may be raised again, and the frames in its traceback hold what the request held.
            raise MeshmarkError(refusal.code, refusal.message, refusal.remedy)

    def close(self) -> None:
        """Refuse the uploads that wait, and all new ones."""
        self._uploads.close()
        self._processes.close()

    def _check(
        self, tenant: str, more: Mapping[str, object], files: Mapping[str, Staged | None]
    ) -> MeshmarkError | None:
        """Check an upload in a process of the gate; returns its error, or None."""
        paths = dict.fromkeys(("asset", "font", "logo")) | {name: file.path for name, file in files.items() if file}
        request = json.dumps({**self._request, **paths, **more}, default=os.fspath).encode() + b"\n"
        with self._processes.acquired(tenant):
            with writing():
                stderr = tempfile.TemporaryFile()  # noqa: SIM115  # it is closed below
            ours, theirs = socket.socketpair()
            with ours, stderr:
                with theirs:
                    ours.sendall(request)  # far less than a socket holds
                    child = self._template.fork(theirs.fileno(), stderr.fileno(), theirs.fileno())
                answer = None
                try:
                    answer = self._listen(child, ours)
                except TimeoutError:
                    return _too_long(self._seconds)
                finally:
                    exit_code = child.end()
                    if written := tail(stderr):
                        log.warning("the gate's process wrote to stderr", text=written)
        if answer is None:
            log.error("the gate's process died", exit_code=exit_code)
            return _crashed(exit_code)
        said = json.loads(answer)
        return said and MeshmarkError(error_code(said["code"]), said["message"], said["remedy"])

    def _listen(self, child: Child, channel: socket.socket) -> bytes | None:
        """Line that a child answers; None where it ended before.

        Raises:
            TimeoutError: it takes too long.
        """
        try:
            while child.pid(TICK) is None:
                pass
        except EOFError:
            return None
        deadline, answer = time.monotonic() + self._seconds, b""
        while not answer.endswith(b"\n"):
            channel.settimeout(max(deadline - time.monotonic(), 0.001))
            try:
                chunk = channel.recv(2**16)
            except ConnectionResetError:  # it ended before it had read its request
                return None
            answer += chunk
            if not chunk or len(answer) > LONGEST_ANSWER:
                return None
        return answer


def _too_long(seconds: float) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.BUDGET_EXCEEDED,
        f"The file takes more than {seconds:g} seconds to look through, though nothing is loaded yet.",
        "Simplify or split the asset, or send it as a GLB.",
    )


def _crashed(exit_code: int | None) -> MeshmarkError:
    how = f"was ended by {signal.Signals(-exit_code).name}" if exit_code is not None and exit_code < 0 else "ended"
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED,
        f"The process that looked through this file {how} before it was done.",
        "Send the asset again; if it happens again, export it anew from the program that made it, or as a GLB.",
    )
