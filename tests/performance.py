"""`make performance MESHES=DIR`: measures every asset of a folder, and writes the tables of the manual's page.

Seconds by stage with the preview and all metrics, by `meshmark profile`; then how many small assets an hour are marked,
by `tests.hourly`. All on two processors, however many there are, so that pages of different machines compare.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.choices import Evaluate
from core.cli.progress import progress
from core.lab.benchmark.markdown import number, table
from core.lab.benchmark.profile import profile, tables, write_profile
from tests.manual import MANUAL, ROOT

PAGE = MANUAL / "performance.md"
BEGIN, END = "<!-- Written by `make performance`. -->", "<!-- The end of what it writes. -->"
PROCESSORS = 2
SMALL = 10_000  # faces
HOUR = 3600.0


@dataclass(frozen=True)
class Rate:
    """Small assets marked, with the metrics that ``evaluate`` says, so many jobs at once, in so many seconds of the
    clock."""

    evaluate: str
    jobs: int
    marked: int
    seconds: float

    @property
    def hourly(self) -> float:
        """Assets an hour."""
        return HOUR * self.marked / self.seconds


def written(page: str, found: dict[str, Any], rates: Sequence[Rate]) -> str:
    """The page with these figures between its two markers, in place of those there are.

    Raises:
        ValueError: the page has not both markers once.
    """
    between = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", re.DOTALL)
    if (page.count(BEGIN), page.count(END), len(between.findall(page))) != (1, 1, 1):
        raise ValueError(f"The page needs {BEGIN!r} and {END!r} once, in this order.")
    content = "\n\n".join([BEGIN, tables(found).strip(), *hourly(rates), END])
    return between.sub(lambda _: content, page)


def hourly(rates: Sequence[Rate]) -> list[str]:
    """The section about small assets; nothing where there were none."""
    if not rates:
        return []
    body = [
        [
            rate.evaluate,
            str(rate.jobs),
            str(rate.marked),
            number(rate.seconds),
            number(rate.seconds / rate.marked),
            f"{rate.hourly:,.0f}",
        ]
        for rate in rates
    ]
    told = f"Assets of up to {SMALL:,} faces, without pictures, one after the other or {PROCESSORS} at once."
    head = ("`evaluate`", "Jobs at once", "Marked", "Seconds", "Seconds an asset", "Assets an hour")
    return ["## Small assets an hour", told, table(head, body)]


def small(found: dict[str, Any], folder: Path) -> list[Path]:
    """The files of a profile that are small and can be marked."""
    return [folder / row["asset"] for row in found["assets"] if row["status"] == "ok" and row["faces"] <= SMALL]


def rate(files: Sequence[Path], evaluate: Evaluate, jobs: int) -> Rate:
    """Mark files with these metrics, so many at once, by a process whose libraries know the number of their threads
    from the start."""
    command = [sys.executable, "-m", "tests.hourly", *map(str, files), "--jobs", str(jobs), "--evaluate", evaluate]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return Rate(**json.loads(done.stdout))


def main() -> int:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--repeats", type=int, default=1, help="runs of each asset; the quickest counts")
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--out", type=Path, help="also write PROFILE.md and profile.json there, for meshmark sizing")
    options = parser.parse_args()
    page = options.page.read_text()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:PROCESSORS])
    with progress(str(options.folder), quiet=False) as tell:
        found = profile(options.folder, repeats=options.repeats, evaluate=Evaluate.FULL, progress=tell)
    files = small(found, options.folder.resolve())
    kinds = [(evaluate, jobs) for evaluate in (Evaluate.NONE, Evaluate.GEOMETRY) for jobs in (1, PROCESSORS)]
    rates = [rate(files, *kind) for kind in kinds if files]
    options.page.write_text(written(page, found, rates))
    if options.out:
        write_profile(found, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
