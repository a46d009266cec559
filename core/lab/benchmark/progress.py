"""Rows done, on standard error."""

import sys
from collections import Counter
from types import TracebackType
from typing import Self

from core.lab.benchmark.pool import Task
from core.lab.benchmark.rows import Row


class Progress:
    """A bar on a terminal (where tqdm is installed), else a line for each finished asset; a context manager."""

    def __init__(self, tasks: list[Task]) -> None:
        self._left = Counter({task.asset.name: len(task.wanted) for task in tasks})
        self._failed: Counter[str] = Counter()
        self._total = len(tasks)
        self._bar = None
        if sys.stderr.isatty() and tasks:
            try:
                from tqdm import tqdm
            except ImportError:
                return  # the lines say the same
            self._bar = tqdm(total=self._left.total(), unit="row", smoothing=0.05)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def show(self, row: Row) -> None:
        """One more row is done."""
        asset = row["asset"]
        self._left[asset] -= 1
        self._failed[asset] += row["status"] != "ok"
        if self._bar is not None:
            self._bar.set_postfix_str(f"{asset} {row['method']} {row['count']} {row['attack']}", refresh=False)
            self._bar.update()
        elif not self._left[asset]:
            done = sum(left == 0 for left in self._left.values())
            print(f"{done}/{self._total} {asset}: {self._failed[asset]} rows failed", file=sys.stderr, flush=True)
