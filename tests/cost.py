"""Cost of a piece of code, in units that no machine changes."""

import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any


@dataclass
class Cost:
    """Calls of functions, Python's and C's, and the most bytes of Python's memory held at once."""

    calls: int = 0
    peak: int = 0


@contextmanager
def cost() -> Iterator[Cost]:
    """Filled when the block ends."""
    spent = Cost()

    def count(_frame: FrameType, happened: str, _argument: Any) -> None:
        spent.calls += happened in ("call", "c_call")

    tracemalloc.start()
    sys.setprofile(count)
    try:
        yield spent
    finally:
        sys.setprofile(None)
        spent.peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
