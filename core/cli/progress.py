"""Progress by stage on standard error: a bar on a terminal, elsewhere a plain line for each stage."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from core.cli.terminal import console, printable, say

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

# Called with a stage's name and the share done, 0 to 1, or None where nobody knows.
Progress = Callable[[str, float | None], None]


def bars(*, in_background: bool = True) -> "Bars":
    """Bars on the terminal, which vanish when they are done, drawn by a thread if ``in_background``."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}", style="bold", markup=False),
        BarColumn(bar_width=30, complete_style="cyan", finished_style="green", pulse_style="cyan"),
        TaskProgressColumn(),
        TextColumn("{task.fields[stage]:10}", style="cyan", markup=False),
        TimeElapsedColumn(),
        console=console(sys.stderr),
        transient=True,
        auto_refresh=in_background,
    )


@contextmanager
def progress(title: str, *, quiet: bool) -> Iterator[Progress | None]:
    """Gives the function to be told how far the work on ``title`` is; None where nobody wants to know."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        with bars() as shown:
            task = shown.add_task(printable(title), total=None, stage="")

            def tell(stage: str, share: float | None) -> None:
                total = None if share is None else 1.0
                shown.update(task, total=total, completed=share, stage=printable(stage))

            yield tell
    else:
        yield plain(title)


def plain(title: str) -> Progress:
    """Progress as lines: one when a stage begins."""
    told: set[str] = set()

    def tell(stage: str, _share: float | None) -> None:
        if stage not in told:
            told.add(stage)
            say(f"{title}: {stage}", sys.stderr)

    return tell
