"""`python -m tests.hourly FILE... --jobs N`: how long assets take, so many at once, each in a process of its own.

As `meshmark apply --jobs N` and a worker run them: forked from a process that has loaded the libraries, which does not
count, with their share of the processors' threads; without pictures, and without metrics or with those of geometry.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory

from core.choices import Evaluate
from core.cli.order import Order, Style
from core.cli.pool import mark_all
from core.parameters import Parameters

TEXT = "watermark"
LEAST = 8  # jobs, so that all places are taken most of the time


def orders(files: Sequence[Path], folder: Path) -> list[Order]:
    """Of each file once, and again in turn where they are few."""
    inputs = islice(cycle(files), max(len(files), LEAST))
    return [Order(path, folder / f"{number}.glb") for number, path in enumerate(inputs)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints metrics, jobs at once, number of files marked and seconds as JSON; fails where a file was not marked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--evaluate", type=Evaluate, choices=[Evaluate.NONE, Evaluate.GEOMETRY], default=Evaluate.NONE)
    options = parser.parse_args(arguments)
    style = Style(Parameters(text=TEXT, evaluate=options.evaluate), None, None)
    with TemporaryDirectory() as folder:
        wanted = orders(options.files, Path(folder))
        mark_all(wanted[:1], style, options.jobs, quiet=True)  # loads the libraries
        start = time.perf_counter()
        outcomes = mark_all(wanted, style, options.jobs, quiet=True)
        seconds = time.perf_counter() - start
    for outcome in outcomes:
        if outcome.error:
            print(f"hourly: {outcome.order.input}: {outcome.error.code}: {outcome.error.message}", file=sys.stderr)
            return 1
    print(json.dumps({"evaluate": options.evaluate, "jobs": options.jobs, "marked": len(outcomes), "seconds": seconds}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
