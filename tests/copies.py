"""`make copies FILES="FILE ..."`: what copies of a job cost over HTTP, by the seconds of all processes of a service.

Without metrics. The job's own seconds have its preview, which copies have none of; ``marked`` is its report's share
without pictures.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import httpx2
import psutil

from tests.demo import service

PARAMETERS = '{"text": "ORDER-1000", "evaluate": "none"}'
PAUSE = 0.25  # seconds between two looks
SETTLED = 1.0  # seconds after which the processes of the last job have ended


@dataclass(frozen=True)
class Cost:
    """Seconds of one request's jobs, by the clock and of all processors."""

    jobs: int
    wall: float
    processor: float


def processor_seconds() -> float:
    """Of all descendants of this process, those that have ended included."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        times = process.cpu_times()
        total += times.user + times.system + times.children_user + times.children_system
    return total


def cost(jobs: int, ask: Callable[[], Any], done: Callable[[Any], bool]) -> Cost:
    """The cost of what ``ask`` begins, until it is ``done``."""
    before, began = processor_seconds(), time.monotonic()
    asked = ask()
    while not done(asked):
        time.sleep(PAUSE)
    wall = time.monotonic() - began
    time.sleep(SETTLED)
    return Cost(jobs, wall, processor_seconds() - before)


def measured(client: httpx2.Client, file: Path, numbers: list[int]) -> tuple[list[Cost], float]:
    """The cost of a job, and of so many copies of it; and the job's seconds without pictures.

    Raises:
        SystemExit: a job did not succeed.
    """

    def succeeded(url: str) -> bool:
        job = client.get(url).raise_for_status().json()
        if job["state"] not in ("queued", "running", "succeeded"):
            sys.exit(f"{file.name}: {job['error']['message']}")
        return bool(job["state"] == "succeeded")

    def mark() -> str:
        with file.open("rb") as content:
            asked: dict[str, Any] = {"data": {"params": PARAMETERS}, "files": {"file": (file.name, content)}}
            made = client.post("/v1/watermarks", params={"cache": False}, **asked)
            return str(made.raise_for_status().headers["Location"])

    texts = (f"ORDER-{number}" for number in count(1001))
    found = [cost(1, mark, succeeded)]
    url = client.get("/v1/watermarks").json()["items"][0]["links"]["self"]
    for number in numbers:
        copies = {"copies": [{"text": next(texts)} for _ in range(number)]}

        def ask(copies: Any = copies) -> list[str]:
            made = client.post(f"{url}/copies", json=copies, params={"cache": False})
            return [copy["links"]["self"] for copy in made.raise_for_status().json()["items"]]

        found.append(cost(number, ask, lambda urls: succeeded(urls[-1]) and all(map(succeeded, urls))))
    timings = client.get(f"{url}/report").json()["timings"]
    return found, sum(seconds for stage, seconds in timings.items() if stage not in ("rendering", "evaluating"))


def lines(name: str, found: list[Cost], marked: float) -> Iterator[str]:
    """The table of a file."""
    yield f"{name}: marked in {marked:.2f} s"
    yield "| copies | seconds | of processors | each | share of the job |\n| ---: | ---: | ---: | ---: | ---: |"
    job = found[0].processor
    for number, of in enumerate(found):
        each = of.processor / of.jobs
        share = f"{each / job:.2f}" if number else "1"
        yield f"| {of.jobs if number else 'the job'} | {of.wall:.2f} | {of.processor:.2f} | {each:.3f} | {share} |"


def main() -> int:
    """Prints a table for each file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 10, 100])
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as data,
        service(Path(data)) as url,
        httpx2.Client(base_url=url, timeout=60) as client,
    ):
        measured(client, options.files[0], [1])  # loads what is loaded late
        for file in options.files:
            print(*lines(file.name, *measured(client, file, options.copies)), sep="\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
