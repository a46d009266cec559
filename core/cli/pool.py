"""Files marked several at once, each in a process of its own: if one ends, the others go on."""

import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

from core import process
from core.cli.order import LOADING, Order, Outcome, Style, mark
from core.cli.progress import bars
from core.cli.terminal import printable, say, unhandled
from core.errors import ErrorCode, MeshmarkError
from core.processors import available_processors

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

REFRESH = 0.1  # seconds between two pictures of the bars


@dataclass(frozen=True)
class Running:
    """A file that is being marked: its place among all, its process, and what that sends."""

    place: int
    order: Order
    process: BaseProcess
    connection: Connection


class Board:
    """Listener to the work on all files; this one tells nothing of it."""

    def begin(self, order: Order) -> None:
        """A file is begun."""

    def move(self, order: Order, stage: str, share: float) -> None:
        """A file's stage, and its share done."""

    def end(self, outcome: Outcome) -> None:
        """A file is done, or has failed."""

    def draw(self) -> None:
        """Show time pass."""


class Lines(Board):
    """A plain line for each file that has ended."""

    def __init__(self, total: int) -> None:
        self._total, self._done = total, 0

    def end(self, outcome: Outcome) -> None:
        """Count it."""
        self._done += 1
        said = f"failed: {outcome.error.code}" if outcome.error else outcome.summary()
        say(f"{self._done}/{self._total} {outcome.order.input}: {said}", sys.stderr)


class BarBoard(Board):
    """A bar for all files, and one for each that is being marked."""

    def __init__(self, shown: "Bars", total: int) -> None:
        self._bars, self._files, self._total, self._failed = shown, dict[Order, Any](), total, 0
        self._all = shown.add_task(f"{total} files", total=total, stage=LOADING)

    def begin(self, order: Order) -> None:
        """Add its bar."""
        self._bars.update(self._all, stage="")
        self._files[order] = self._bars.add_task(printable(str(order.input)), total=1.0, stage="")

    def move(self, order: Order, stage: str, share: float) -> None:
        """Move its bar."""
        self._bars.update(self._files[order], completed=share, stage=stage)

    def end(self, outcome: Outcome) -> None:
        """Take its bar away, and count it."""
        self._bars.remove_task(self._files.pop(outcome.order))
        self._failed += outcome.error is not None
        told = f", {self._failed} failed" if self._failed else ""
        self._bars.update(self._all, advance=1, description=f"{self._total} files{told}")

    def draw(self) -> None:
        """Draw all bars; no thread does, for processes are forked from this one."""
        self._bars.refresh()


@contextmanager
def _board(total: int, quiet: bool) -> Iterator[Board]:
    if quiet:
        yield Board()
    elif sys.stderr.isatty():
        with bars(in_background=False) as shown:
            yield BarBoard(shown, total)
    else:
        yield Lines(total)


def mark_all(orders: list[Order], style: Style, jobs: int, *, quiet: bool) -> list[Outcome]:
    """Mark files, ``jobs`` at once.

    Args:
        orders: of the files.
        style: of all of them.
        jobs: number of processes.
        quiet: tell nothing meanwhile.

    Returns:
        The outcomes, in the order of the orders.
    """
    process.before_children(max(1, available_processors() // jobs))
    from core.preload import preload

    outcomes: dict[int, Outcome] = {}
    waiting, running = deque(enumerate(orders)), dict[Any, Running]()
    with _board(len(orders), quiet) as board:
        board.draw()
        preload()
        try:
            while waiting or running:
                while waiting and len(running) < jobs:
                    place, order = waiting.popleft()
                    board.begin(order)
                    one = _start(place, order, style)
                    running[one.connection] = one
                for ready in wait([*running], timeout=REFRESH):
                    one = running[ready]
                    message = _received(one)
                    if isinstance(message, Outcome):
                        del running[ready]
                        one.connection.close()
                        one.process.join()
                        outcomes[one.place] = message
                        board.end(message)
                    else:
                        board.move(one.order, *message)
                board.draw()
        finally:
            for one in running.values():
                one.process.kill()
    return [outcomes[place] for place in range(len(orders))]


def _start(place: int, order: Order, style: Style) -> Running:
    ours, theirs = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_work, args=(theirs, order, style))
    child.start()
    theirs.close()
    return Running(place, order, child, ours)


def _received(one: Running) -> Outcome | tuple[str, float]:
    """The next message of a child: its progress, or the outcome, also where it ended without one."""
    try:
        message: Outcome | tuple[str, float] = one.connection.recv()
    except EOFError:
        one.process.join()
        status = one.process.exitcode or 0
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        return Outcome(
            one.order,
            error=MeshmarkError(
                ErrorCode.ENGINE_CRASHED,
                f"The process that worked on this file ended before it was done ({how}).",
                "Mark it alone; if that fails too, export it anew from the program that made it.",
            ),
        )
    return message


def _work(connection: Connection, order: Order, style: Style) -> None:
    """Mark one file, in a process of its own, and send progress and outcome."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent, which gets it too, ends this process

    def send(message: Outcome | tuple[str, float | None]) -> None:
        try:
            connection.send(message)
        except OSError:  # the parent is gone, and nobody waits for the rest
            os._exit(1)

    try:
        outcome = mark(order, style, lambda stage, share: send((stage, share)))
    except MeshmarkError as error:
        outcome = Outcome(order, error=error)
    except Exception as error:  # reported with this file; the others go on
        outcome = Outcome(order, error=unhandled(error), trace=traceback.format_exc())
    send(outcome)
    connection.close()
