"""`make bench BEFORE=COMMIT [MESHES=DIR]`: what the engine takes, and what it took at another commit.

Both are measured in one run, before and after in turn, so that a machine whose speed varies slows down both. The other
commit is checked out into a worktree of its own, which is gone afterwards; both use the libraries that are installed.
Each measurement is a process of its own, and all its figures are the kernel's (wait4(2)): processor seconds of all
threads, seconds of the clock, peak resident memory. The cases:

- `apply`: `meshmark apply` without metrics, the start of its process included
- `service`: the job in a process forked from one that has loaded the libraries, as a worker runs it; without metrics
- `metrics`: the same with the preview and all metrics; of the smallest and the largest file alone

Fails where a run failed, and for no other reason.
"""

import argparse
import json
import math
import os
import platform
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, Any

from core.lab.benchmark.datasets import Asset, load
from core.lab.benchmark.markdown import number, table

ROOT = Path(__file__).parents[1]
OURS = ROOT / "tests" / "data"
JOB = Path(__file__).with_name("bench_job.py")
MESHMARK = "import sys; from core.cli import main; sys.exit(main())"  # the entry point, as pyproject.toml names it
SCHEMA = "meshmark.bench/1"
TEXT = "watermark"
CASES = ("apply", "service", "metrics")
CONFIDENCE = 0.95  # of an interval, where there are pairs enough
KIB = 1 if sys.platform == "darwin" else 1024  # getrusage(2): the unit of ru_maxrss
FIGURES = ("wall", "cpu", "peak")
HEADER = (
    *("Asset", "Case", "Wall before [s]", "after", "ratio", "CPU before [s]", "after", "ratio"),
    *("Peak before [MB]", "after", "ratio", "Same bytes"),
)


class RunError(Exception):
    """A run failed, or a commit cannot be measured; the message says why."""


@dataclass(frozen=True)
class Measurement:
    """Figures of one process.

    Attributes:
        wall: seconds of the clock.
        user, system: processor seconds of all its threads.
        peak: resident bytes.
        sha256: of the model.
    """

    wall: float
    user: float
    system: float
    peak: float
    sha256: str

    @property
    def cpu(self) -> float:
        """Processor seconds."""
        return self.user + self.system


@dataclass(frozen=True)
class Pair:
    """Two measurements, one right after the other."""

    before: Measurement
    after: Measurement


@dataclass(frozen=True)
class Compared:
    """One figure of all pairs.

    Attributes:
        before, after: medians.
        ratio: median of the pairs' ratios, after over before.
        low, high: interval of that median; None for a single pair.
    """

    before: float
    after: float
    ratio: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Row:
    """An asset in a case: its pairs, or the reason why there are none."""

    asset: str
    case: str
    pairs: tuple[Pair, ...] = ()
    failure: str = ""


def rank(pairs: int) -> int:
    """The order statistic, from either end, at which the interval of a median ends: the innermost that gives 95%, or
    the outermost."""
    return max([place for place in range(1, pairs // 2 + 1) if coverage(pairs, place) >= CONFIDENCE], default=1)


def coverage(pairs: int, place: int) -> float:
    """Chance that the median of a continuous distribution lies between the ``place``-th least and the ``place``-th
    greatest of so many independent draws: binomial, whatever the distribution."""
    outside: int = 2 * sum(math.comb(pairs, below) for below in range(place))
    return 1 - outside / int(2**pairs)


def compared(pairs: Sequence[Pair], figure: str) -> Compared:
    """One of ``FIGURES``, before and after."""
    before, after = ([getattr(getattr(pair, side), figure) for pair in pairs] for side in ("before", "after"))
    ratios = sorted(new / old for old, new in zip(before, after, strict=True))
    ends = (None, None) if len(ratios) < 2 else (ratios[rank(len(ratios)) - 1], ratios[-rank(len(ratios))])
    return Compared(median(before), median(after), median(ratios), *ends)


def same_bytes(pairs: Sequence[Pair]) -> str:
    """Whether all models are the same: "yes", "no", or which commit makes different ones of the same input."""
    before, after = ({getattr(pair, side).sha256 for pair in pairs} for side in ("before", "after"))
    varies = [name for name, found in (("before", before), ("after", after)) if len(found) > 1]
    return f"varies {' and '.join(varies)}" if varies else "yes" if before == after else "no"


def totals(rows: Sequence[Row]) -> list[Row]:
    """A row for each case of several assets: sums of seconds run by run, the highest peak, and all hashes as one."""
    found = []
    for case in dict.fromkeys(row.case for row in rows):
        of_case = [row.pairs for row in rows if row.case == case and row.pairs]
        if len(of_case) > 1:
            runs = zip(*of_case, strict=True)
            pairs = (Pair(_total([p.before for p in run]), _total([p.after for p in run])) for run in runs)
            found.append(Row(f"all {len(of_case)}", case, tuple(pairs)))
    return found


def _total(of: Sequence[Measurement]) -> Measurement:
    wall, user, system = (sum(getattr(each, name) for each in of) for name in ("wall", "user", "system"))
    hashes = sha256("".join(each.sha256 for each in of).encode()).hexdigest()
    return Measurement(wall, user, system, max(each.peak for each in of), hashes)


def cells(row: Row) -> list[str]:
    """The row's cells, below ``HEADER``."""
    if row.failure:
        return [row.asset, row.case, f"failed: {row.failure}", *[""] * (len(HEADER) - 3)]
    written: list[str] = []
    for figure in FIGURES:
        found = compared(row.pairs, figure)
        scale = 1e-6 if figure == "peak" else 1
        interval = "" if found.low is None else f" [{found.low:.3f}, {found.high:.3f}]"
        written += [number(found.before * scale), number(found.after * scale), f"{found.ratio:.3f}{interval}"]
    return [row.asset, row.case, *written, same_bytes(row.pairs)]


def about(before: str, after: str, runs: int) -> str:
    """The lines below the table."""
    told = "one pair, which has no interval"
    if runs > 1:
        which = "least and greatest" if rank(runs) == 1 else f"{rank(runs)} least and {rank(runs)} greatest: the inner"
        sure = f"{coverage(runs, rank(runs)):.1%}"
        told = f"median of {runs} pairs, in brackets the {which} ratio, between which the median lies with {sure}"
    return (
        f"Before: {before}. After: {after}. *Ratio*: after over before, {told}"
        f"{' confidence (order statistics, no distribution assumed)' if runs > 1 else ''}. *CPU*: processor seconds of "
        "all threads, user and system. *Same bytes*: SHA-256 of the models. "
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}."
    )


def as_json(rows: Sequence[Row], before: str, after: str) -> dict[str, Any]:
    """All that was measured, for programs."""
    return {
        "schema": SCHEMA,
        "before": before,
        "after": after,
        "rows": [
            asdict(row)
            | ({name: asdict(compared(row.pairs, name)) for name in FIGURES} if row.pairs else {})
            | ({"same_bytes": same_bytes(row.pairs)} if row.pairs else {})
            for row in rows
        ],
    }


@contextmanager
def checkout(repository: Path, commit: str) -> Iterator[Path]:
    """A worktree of a commit, in a folder of its own that is gone afterwards, also after an error or an interrupt.

    Raises:
        RunError: there is no such commit, or no repository.
    """
    with TemporaryDirectory(prefix="meshmark-bench-") as folder:
        tree = Path(folder) / "tree"
        git(repository, "worktree", "add", "--quiet", "--detach", str(tree), commit)
        try:
            yield tree
        finally:
            git(repository, "worktree", "remove", "--force", str(tree))


def git(repository: Path, *arguments: str) -> str:
    """What git prints; raises :class:`RunError` with what it says."""
    done = subprocess.run(["git", *arguments], cwd=repository, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RunError(f"git {arguments[0]}: {told(done.stderr)}")
    return done.stdout.strip()


def name_of(tree: Path) -> str:
    """The commit of a worktree, and whether it was changed since."""
    changed = git(tree, "status", "--porcelain", "--untracked-files=no")
    return git(tree, "rev-parse", "--short", "HEAD") + " with changes" * bool(changed)


def told(error: str) -> str:
    """The words of an error from what a process wrote: without the lines of a trace."""
    lines = [line for line in error.splitlines() if line.strip() and not line.startswith((" ", "Traceback"))]
    return " ".join(lines[-2:]) or "without a word"


def run(command: Sequence[str | Path], tree: Path) -> tuple[str, float, resource.struct_rusage]:
    """Run Python on the code of a tree, to its end.

    Args:
        command: Python's arguments.
        tree: holds the packages; those that are installed have no part in it.

    Returns:
        What it printed, the seconds of the clock, and what the kernel counted.

    Raises:
        RunError: its status is not 0; with its words.
    """
    unwanted = ("PYTHONDONTWRITEBYTECODE", "PYTHONPATH")  # both trees keep their bytecode
    environment = {name: value for name, value in os.environ.items() if name not in unwanted}
    with TemporaryFile() as printed, TemporaryFile() as errors:
        start = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-P", *command],
            env=environment | {"PYTHONPATH": str(tree)},
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=errors,
            start_new_session=True,
        )
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)  # with what it forked
            process.wait()
            raise
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        output, error = (_read(stream) for stream in (printed, errors))
    if process.returncode:
        how = f"signal {-process.returncode}" if process.returncode < 0 else f"status {process.returncode}"
        raise RunError(f"{how}: {told(error)}")
    return output, wall, usage


def _read(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode(errors="replace")


def apply(tree: Path, asset: Path) -> Measurement:
    """The case `apply`."""
    with TemporaryDirectory() as folder:
        model = Path(folder) / "model.glb"
        _, wall, usage = run(("-c", MESHMARK, "apply", asset, model, "--text", TEXT, "--evaluate", "none"), tree)
        if not model.is_file():
            raise RunError("the command wrote no model")
        digest = sha256(model.read_bytes()).hexdigest()
    return Measurement(wall, usage.ru_utime, usage.ru_stime, usage.ru_maxrss * KIB, digest)


def job(tree: Path, asset: Path, *, evaluate: str) -> Measurement:
    """The cases `service` and `metrics`."""
    found = json.loads(run((JOB, asset, TEXT, evaluate), tree)[0].splitlines()[-1])
    return Measurement(**found | {"peak": found["peak"] * KIB})


MEASURE: dict[str, Callable[[Path, Path], Measurement]] = {
    "apply": apply,
    "service": partial(job, evaluate="none"),
    "metrics": partial(job, evaluate="full"),
}


def measured(asset: Asset, case: str, before: Path, after: Path, runs: int) -> Row:
    """Measure one asset in one case: before, after, before, after and so on."""
    measure, pairs = MEASURE[case], []
    for _ in range(runs):
        sides = {}
        for name, tree in (("before", before), ("after", after)):
            try:
                sides[name] = measure(tree, asset.path)
            except RunError as failure:
                return Row(asset.name, case, failure=f"{name}: {failure}")
        pairs.append(Pair(**sides))
    return Row(asset.name, case, tuple(pairs))


def own_code(tree: Path) -> None:
    """Check that Python takes the packages from a tree, which loads none of their libraries; raises RunError."""
    found = run(("-c", "import core; print(core.__path__[0])"), tree)[0].strip()
    if Path(found).resolve() != (tree / "core").resolve():
        raise RunError(f"Python takes {found} instead of {tree / 'core'}")


def chosen(folder: Path, only: Sequence[str]) -> list[Asset]:
    """The assets of a folder, the smallest file first; those only whose names start so, where any are named.

    Raises:
        RunError: a name stands for no file.
        MeshmarkError: ``missing_file`` for a folder without assets.
    """
    found = sorted(load(folder, "folder", "").assets, key=lambda asset: (asset.path.stat().st_size, asset.name))
    for start in only:
        if not any(asset.name.startswith(start) for asset in found):
            raise RunError(f"no asset in {folder} has a name that starts with {start}")
    return [asset for asset in found if asset.name.startswith(tuple(only) or "")]


def compare(before: Path, after: Path, assets: Sequence[Asset], cases: Sequence[str], runs: int) -> Iterator[Row]:
    """The rows, as they are measured.

    Args:
        before, after: worktrees.
        assets: the smallest first.
        cases: of ``CASES``.
        runs: pairs of each asset in each case.

    Raises:
        RunError: a tree cannot be measured at all.
    """
    for tree in (before, after):
        own_code(tree)
        with suppress(RunError):  # reads libraries from disk and writes bytecode; does not count
            MEASURE[cases[0]](tree, assets[0].path)
    for asset in assets:
        for case in cases:
            if case != "metrics" or asset in (assets[0], assets[-1]):
                yield measured(asset, case, before, after, runs)


def main(arguments: Sequence[str] | None = None, repository: Path = ROOT) -> int:
    """Prints a row for each asset and case as it is measured, and rows of all assets together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", help="a commit")
    parser.add_argument("--after", help="another commit; by default the files as they are")
    parser.add_argument("--meshes", type=Path, default=OURS, help="a folder of assets; by default the project's own")
    parser.add_argument(
        "--only", action="append", default=[], help="start of a file's name; may be given several times"
    )
    parser.add_argument("--case", action="append", choices=CASES, help="may be given several times; by default all")
    parser.add_argument("--runs", type=int, default=5, help="pairs of each asset in each case")
    parser.add_argument("--json", type=Path, metavar="OUT", help="also write all figures here")
    options = parser.parse_args(arguments)
    if options.runs < 1:
        parser.error("--runs must be 1 or more")
    cases = [case for case in CASES if not options.case or case in options.case]
    rows: list[Row] = []
    try:
        assets = chosen(options.meshes, options.only)
        with ExitStack() as stack:
            before = stack.enter_context(checkout(repository, options.before))
            after = stack.enter_context(checkout(repository, options.after)) if options.after else repository
            names = name_of(before), name_of(after)
            print(table(HEADER, []), flush=True)
            for row in compare(before, after, assets, cases, options.runs):
                _print(row)
                rows.append(row)
    except RunError as failure:
        print(f"bench: {failure}", file=sys.stderr)
        return 1
    for row in totals(rows):
        _print(row)
    print("\n" + about(*names, options.runs))
    if options.json:
        options.json.write_text(json.dumps(as_json([*rows, *totals(rows)], *names), indent=1) + "\n")
    return int(any(row.failure for row in rows))


def _print(row: Row) -> None:
    print(table(HEADER, [cells(row)]).splitlines()[-1], flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # worktrees are removed then, too
    sys.exit(main())
