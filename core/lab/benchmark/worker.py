"""Process of the benchmark: makes all rows of one asset and sends them to the parent one by one."""

import logging
import os
import platform
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.datasets import Asset
from core.lab.benchmark.options import AttackRequest, BenchmarkOptions
from core.lab.benchmark.rows import Combination, Row, grouped
from core.processors import available_processors

log = logging.getLogger(__name__)


class Bench(Protocol):
    """One asset under test, with the parts that its rows share."""

    def facts(self) -> Row:
        """Columns about the asset, the same in every row."""

    def mark(self, method: str, count: int) -> Any:
        """The asset watermarked."""

    def measure(self, marked: Any, attack: AttackRequest) -> Row:
        """The values of one row."""


Open = Callable[[Asset, int, BenchmarkOptions], Bench]


@dataclass(frozen=True)
class Begun:
    """The rows that depend on the worker's next step: they fail if it does not return."""

    combinations: tuple[Combination, ...]


@dataclass(frozen=True)
class Done:
    """A finished row."""

    combination: Combination
    outcome: Row


def work(
    connection: Connection,
    opener: Open,
    asset: Asset,
    seed: int,
    options: BenchmarkOptions,
    wanted: list[Combination],
    started: float,
) -> None:
    """Make the rows ``wanted`` of one asset and send :class:`Begun` and :class:`Done`; runs in a process of its own.

    Args:
        connection: to the parent; closed at the end.
        opener: importable function that makes the bench of an asset.
        asset: to be processed.
        seed: of the asset.
        options: of the run.
        wanted: in groups of one method and count.
        started: ``time.monotonic()`` at the start of the process; loading the libraries counts as its time.
    """
    _end_with_parent()
    clock = _Clock(started)

    def fail(combinations: list[Combination], error: Exception, facts: Row) -> None:
        for one in combinations:
            connection.send(Done(one, facts | failure(error) | {"spent": clock.lap()}))

    connection.send(Begun(tuple(wanted)))
    try:
        bench = opener(asset, seed, options)
        facts = bench.facts() | {"machine": machine()}
    except Exception as error:  # here and below: the row records it, and the run of hours goes on
        fail(wanted, error, {"machine": machine()})
        return
    for group in grouped(wanted):
        connection.send(Begun(tuple(group)))
        try:
            marked = bench.mark(group[0].method, group[0].count)
        except Exception as error:
            fail(group, error, facts)
            continue
        for one in group:
            connection.send(Begun((one,)))
            try:
                outcome = facts | {"status": "ok", **bench.measure(marked, one.attack)}
            except Exception as error:
                fail([one], error, facts)
            else:
                connection.send(Done(one, outcome | {"spent": clock.lap()}))
    connection.close()


def failure(error: Exception) -> Row:
    """Row that ``error`` kept from being made: its status, code and message."""
    if isinstance(error, MeshmarkError):
        return {"status": "failed", "code": error.code.value, "message": error.message}
    log.error("a row could not be made", exc_info=error)
    return {
        "status": "failed",
        "code": ErrorCode.INTERNAL_ERROR.value,
        "message": f"{type(error).__name__}: {error}",
    }


def machine() -> str:
    """Machine that the seconds of a row were measured on."""
    threads = os.environ.get("OMP_NUM_THREADS", "all")
    return f"{platform.system()} {platform.machine()}, {available_processors()} cores, {threads} a process"


class _Clock:
    """Seconds between events."""

    def __init__(self, start: float) -> None:
        self._last = start

    def lap(self) -> float:
        start, self._last = self._last, time.monotonic()
        return round(self._last - start, 4)


def _end_with_parent() -> None:
    """End at once when the parent has ended, even killed: the rows would not be read."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
