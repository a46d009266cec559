"""Templates (zygotes): processes for hostile input are forked from one that has loaded their libraries.

Loading libraries takes up to seconds; a template loads them once. It imports and then only forks: it reads nothing of
its children's input, starts no thread and opens no device. There is one for each worker, of the processes of jobs
(:mod:`worker.template`), and one for each API, of those of its gate (:mod:`worker.gate`).

Its stdin is a socket. For each child its owner sends four descriptors: the child's line, its request, stderr and
channel. On the line, a socket, comes the process id of the child. When the owner shuts its side, or is gone, the
template kills the child with all that it started, and its exit code comes. No child is waited for before that, so its
process id stays its own.
"""

import gc
import os
import select
import signal
import socket
import subprocess
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO, NoReturn

import structlog

# A template that takes longer is stuck, and is killed.
START_SECONDS = 120.0  # to load its libraries, perhaps from a cold disk, and to fork
END_SECONDS = 20.0  # to kill a child, whose memory has to be freed
TAIL = 4000  # bytes at the end of stderr that are logged

# Environment variables that a template inherits from its owner. The ledger's and the broker's passwords are not among
# them: its children handle hostile input.
PASSED_ON = (
    *("PATH", "HOME", "LANG", "TZ", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH"),
    *("MESHMARK_FONTS", "MESHMARK_MODELS", "MESHMARK_DEVICE", "WARP_CACHE_PATH"),
)
PASSED_ON_PREFIXES = ("LC_", "XDG_", "OMP_", "MKL_", "OPENBLAS_", "CUDA_", "NVIDIA_", "TORCH_", "EGL_", "PYOPENGL_")
# Variables that set the threads of the numeric libraries, libigl and Mesa's software renderer.
THREADS = ("OMP_NUM_THREADS", "IGL_NUM_THREADS", "LP_NUM_THREADS")

log = structlog.get_logger(__name__)


class Child:
    """Process that a template was asked to fork."""

    def __init__(self, line: socket.socket, template: "subprocess.Popen[bytes]") -> None:
        self._line, self._template = line, template
        self._begun, self._begin_by = False, time.monotonic() + START_SECONDS

    def pid(self, patience: float) -> int | None:
        """Its process id, once; None if it has not begun within these seconds.

        Raises:
            EOFError: it will never begin.
        """
        self._line.settimeout(patience)
        try:
            said = self._line.recv(16)
        except TimeoutError:
            if time.monotonic() > self._begin_by:
                self._template.kill()  # it is stuck
            return None
        if not said:
            raise EOFError
        self._begun = True
        return int(said)

    def end(self) -> int | None:
        """Kill the child and its process group.

        Returns:
            Its exit code, its own if it had ended by itself; None if it never began, or its template is gone.
        """
        said = b""
        with self._line as line, suppress(OSError):
            if self._begun:
                line.settimeout(END_SECONDS)
                line.shutdown(socket.SHUT_WR)
                try:
                    said = line.recv(16)
                except TimeoutError:
                    self._template.kill()  # its children go with it
        return int(said) if said else None


class Template:
    """Owner's handle of a template process: starts it when it is needed, and again when it has died.

    Args:
        command: command line of the process.
        threads: how many a child may use.
        name: of the processes, for the log.
    """

    def __init__(self, command: Sequence[str], threads: int, name: str) -> None:
        self._command, self._threads, self._name = command, threads, name
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the process, without waiting until it has loaded everything."""
        with self._lock:
            self._running()

    def fork(self, request: int, stderr: int, channel: int) -> Child:
        """Ask for a child with these descriptors; it begins once the template has loaded everything."""
        with self._lock:
            process = self._running()
            ours, theirs = socket.socketpair()
            with theirs, suppress(BrokenPipeError):  # a template that died just now is met in Child.pid
                socket.send_fds(self._control, [b"!"], [theirs.fileno(), request, stderr, channel])
        return Child(ours, process)

    def close(self) -> None:
        """End the process, and with it every child."""
        with self._lock:
            self._end()

    def _running(self) -> "subprocess.Popen[bytes]":
        if self._process is not None and self._process.poll() is not None:
            code = self._process.returncode
            log.error("a template died and is started again", template=self._name, exit_code=code)
            self._end()
        if self._process is None:
            self._control, theirs = socket.socketpair()
            self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  # it is closed in _end
            with theirs:
                self._process = subprocess.Popen(
                    self._command,
                    stdin=theirs.fileno(),
                    stdout=self._stderr,
                    stderr=self._stderr,
                    env=_environment(self._threads),
                    start_new_session=True,  # out of reach of Ctrl-C
                )
        return self._process

    def _end(self) -> None:
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        with self._control, self._stderr as stderr:
            if text := tail(stderr):
                log.warning("a template wrote to stderr", template=self._name, text=text)
        self._process = None


def tail(stderr: IO[bytes]) -> str:
    """End of a process's stderr, as text."""
    stderr.seek(max(0, stderr.seek(0, os.SEEK_END) - TAIL))
    return stderr.read().decode(errors="replace").strip()


def _environment(threads: int) -> dict[str, str]:
    passed = {key: value for key, value in os.environ.items() if key in PASSED_ON or key.startswith(PASSED_ON_PREFIXES)}
    return dict.fromkeys(THREADS, str(threads)) | passed | {"PYTHONUNBUFFERED": "1"}


Run = Callable[[int, int, int, int], NoReturn]  # gets the template's process id, the request, stderr and the channel


def serve(control: socket.socket, run: Run) -> NoReturn:
    """Fork a child for each request, and end those whose lines are shut, until the owner is gone."""
    gc.freeze()  # loaded objects stay: garbage collection in a child shall neither scan them nor copy their pages
    children: dict[socket.socket, int] = {}
    while True:
        for ready in select.select([control, *children], [], [])[0]:
            if ready is not control:
                _end_child(ready, children.pop(ready))
                continue
            said, files, _, _ = socket.recv_fds(control, 1, 4)
            if not said:
                for line, pid in children.items():
                    _end_child(line, pid)
                os._exit(0)  # without the teardown of native libraries
            line = socket.socket(fileno=files[0])
            try:
                children[line] = _fork(run, *files[1:])
            except OSError:  # no more processes or memory
                traceback.print_exc()
                line.close()
            else:
                with suppress(BrokenPipeError):  # given up meanwhile: the line is shut
                    line.send(b"%d" % children[line])


def _fork(run: Run, request: int, stderr: int, channel: int) -> int:
    template = os.getpid()
    try:
        if pid := os.fork():
            return pid
        try:
            run(template, request, stderr, channel)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    finally:
        for file in (request, stderr, channel):
            os.close(file)


def _end_child(line: socket.socket, pid: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # the group: also what the engine may have started
    os.kill(pid, signal.SIGKILL)  # one that is so young that it has none
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with line, suppress(BrokenPipeError):
        line.send(b"%d" % code)
