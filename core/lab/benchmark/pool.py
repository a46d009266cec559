"""Processes that work on one asset each: a crash or a hang costs the row at hand and nothing else."""

import os
import signal
import time
from collections import deque
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.datasets import Asset
from core.lab.benchmark.options import BenchmarkOptions
from core.lab.benchmark.rows import Combination, Row
from core.lab.benchmark.worker import Begun, Done, Open, failure, machine, work
from core.processors import available_processors

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Task:
    """The rows to make of one asset, in groups of one method and count."""

    asset: Asset
    sha256: str
    seed: int
    wanted: list[Combination]


@dataclass(eq=False)
class _Child:
    task: Task
    process: SpawnProcess
    connection: Connection
    left: list[Combination]  # rows that have not come
    at_stake: tuple[Combination, ...] = ()
    since: float = field(default_factory=time.monotonic)


def outcomes(tasks: list[Task], opener: Open, options: BenchmarkOptions) -> Generator[tuple[Task, Combination, Row]]:
    """Every row of ``tasks`` as it comes, in ``options.processes`` processes, a fresh one for each asset.

    A process that crashes, or takes longer than ``options.row_seconds`` for one step, fails the rows that depend on
    that step (code ``engine_crashed`` or ``time_limit``); the asset's other rows go on in a new one. Closing the
    iterator ends all processes.
    """
    waiting = deque(tasks)
    children: list[_Child] = []
    try:
        while waiting or children:
            while waiting and len(children) < options.processes:
                children.append(_start(waiting.popleft(), opener, options))
            patience = min(child.since for child in children) + options.row_seconds - time.monotonic()
            ready = wait([child.connection for child in children], timeout=max(patience, 0.0))
            for child in list(children):
                late = time.monotonic() - child.since > options.row_seconds
                if child.connection in ready:
                    late = False
                    message = _receive(child.connection)
                    if isinstance(message, Begun):
                        child.at_stake, child.since = message.combinations, time.monotonic()
                        continue
                    if isinstance(message, Done):
                        child.left.remove(message.combination)
                        child.since = time.monotonic()
                        yield child.task, message.combination, message.outcome
                        continue
                elif not late:
                    continue
                children.remove(child)
                error = _end(child, options.row_seconds if late else None)
                lost = [one for one in child.left if one in child.at_stake]
                for one in lost:
                    yield child.task, one, failure(error) | {"machine": machine(), "spent": 0.0}
                rest = [one for one in child.left if one not in lost]
                if rest:
                    waiting.appendleft(Task(child.task.asset, child.task.sha256, child.task.seed, rest))
    finally:
        for child in children:
            child.process.kill()
        for child in children:
            child.process.join()


def _receive(connection: Connection) -> Begun | Done | None:
    """The next message; None at the end of the process."""
    try:
        message: Begun | Done = connection.recv()
    except (EOFError, OSError):
        return None
    return message


def _start(task: Task, opener: Open, options: BenchmarkOptions) -> _Child:
    receiving, sending = get_context("spawn").Pipe(duplex=False)
    given = (sending, opener, task.asset, task.seed, options, task.wanted, time.monotonic())
    process = get_context("spawn").Process(target=work, args=given, daemon=True)
    with _threads(options.processes), _interrupts_held():
        process.start()
    sending.close()  # so that the end of the process is the end of the pipe
    # Until the first word comes, a process that cannot even start fails all of its rows.
    return _Child(task, process, receiving, list(task.wanted), tuple(task.wanted))


def _end(child: _Child, limit: float | None) -> MeshmarkError:
    """Make sure the process has ended; returns the reason why its remaining rows did not come."""
    if limit is not None:
        child.process.kill()
    child.process.join()
    child.connection.close()
    if limit is not None:
        return MeshmarkError(
            ErrorCode.TIME_LIMIT, f"One step took longer than {limit:g} s.", "Raise --row-seconds, or leave it out."
        )
    status = child.process.exitcode or 0
    how = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED, f"The process ended before its result ({how}).", "Run it again with --retry-failed."
    )


@contextmanager
def _threads(processes: int) -> Iterator[None]:
    """An environment in which numerical libraries of a new process share the cores with the other processes."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, str(max(available_processors() // processes, 1))))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A process started here never sees Ctrl-C, which a terminal sends to all: the parent ends it instead."""
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)
