"""One benchmark run: the missing rows, and the report on all of them."""

import hashlib
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark import rows as rows_of
from core.lab.benchmark.datasets import LAYOUTS, load, stratified
from core.lab.benchmark.options import INVISIBLE, NO_ATTACK, AttackRequest, BenchmarkOptions
from core.lab.benchmark.plots import require_matplotlib
from core.lab.benchmark.pool import Task, outcomes
from core.lab.benchmark.progress import Progress
from core.lab.benchmark.report import write_report
from core.lab.benchmark.results import write_results
from core.lab.benchmark.rows import Row, appending, asset_seed, combinations, key
from core.lab.benchmark.select import latest, ordered
from core.lab.benchmark.worker import Open


def run(options: BenchmarkOptions, opener: Open | None = None) -> list[Row]:
    """Make all rows of ``options`` that are missing, then write tables and plots of all.

    Writes ``rows.jsonl`` as it goes, then ``results.csv``, ``results.json``, ``REPORT.md`` and the plots. Ctrl-C ends
    the processes and keeps every finished row.

    Args:
        options: of the run.
        opener: makes the bench of an asset; None for :func:`core.lab.benchmark.bench.open_bench`.

    Returns:
        The rows of these options, old ones included.

    Raises:
        MeshmarkError: without matplotlib, for a dataset that is not there, unknown methods or attacks, a folder that
            cannot be written.
        KeyboardInterrupt: after Ctrl-C.
    """
    require_matplotlib()
    if options.report_only:
        found = latest(rows_of.read(options.out))
        if not found:
            raise MeshmarkError(
                ErrorCode.MISSING_FILE, f"{options.out} holds no rows.", "Run the benchmark without --report-only."
            )
    else:
        options = _checked(options)
        found = _make(options, opener or _open_bench())
    found = ordered(found)
    write_results(found, options)
    write_report(found, options.out)
    return found


def _open_bench() -> Open:
    from core.lab.benchmark.bench import open_bench  # torch and the geometry libraries: not for --report-only

    return open_bench


def _make(options: BenchmarkOptions, opener: Open) -> list[Row]:
    dataset = load(options.folder, options.dataset, options.split)
    assets = stratified(dataset.assets, options.samples or len(dataset.assets), options.seed)
    for note in dataset.notes:
        print(f"meshmark: {note}", file=sys.stderr)
    hashes = {asset: _sha256(asset.path) for asset in assets}
    first = {sha256: asset for asset, sha256 in reversed(hashes.items())}
    for asset, sha256 in hashes.items():
        if first[sha256] != asset:
            print(f"meshmark: {asset.name} is the same file as {first[sha256].name}; left out.", file=sys.stderr)

    wanted = combinations(options)
    with appending(options.out) as log:
        kept = {row["key"]: row for row in rows_of.read(options.out)}
        tasks: list[Task] = []
        mine: list[str] = []
        for sha256, asset in sorted(first.items(), key=lambda item: item[1].name):
            seed = asset_seed(sha256, options.seed)
            keys = {one: key(one.identity(sha256, seed, options)) for one in wanted}
            mine += keys.values()
            left = [one for one in wanted if not _finished(kept.get(keys[one]), options)]
            if left:
                tasks.append(Task(asset, sha256, seed, left))
        with Progress(tasks) as progress, closing(outcomes(tasks, opener, options)) as stream:
            for task, one, outcome in stream:
                identity = one.identity(task.sha256, task.seed, options)
                about = {"dataset": options.dataset, "asset": task.asset.name, "kind": task.asset.kind}
                row = {"key": key(identity), **identity, **about, **outcome, "at": round(time.time(), 3)}
                log.append(row)
                progress.show(row)
    kept = {row["key"]: row for row in rows_of.read(options.out)}
    return [kept[name] for name in mine]


def _finished(row: Row | None, options: BenchmarkOptions) -> bool:
    return row is not None and (row["status"] == "ok" or not options.retry_failed)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _checked(options: BenchmarkOptions) -> BenchmarkOptions:
    """The options with every attack's strength spelled out, once all names are known to exist."""
    from core.lab.attacks.attack import ATTACKS
    from core.lab.attacks.ladder import LADDER
    from core.lab.baselines import STRATEGIES

    known = ATTACKS | LADDER
    for what, names, choices in (
        ("method", options.methods, [*STRATEGIES, INVISIBLE]),
        ("attack", [attack.name for attack in options.attacks], [NO_ATTACK, *known]),
        ("dataset layout", [options.dataset], [*LAYOUTS]),
    ):
        unknown = sorted(set(names) - set(choices))
        if unknown:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"There is no {what} {', '.join(unknown)}.",
                f"Choose among: {', '.join(choices)}.",
            )
    attacks = tuple(
        attack if attack.strength is not None else AttackRequest(attack.name, float(known[attack.name].strength))
        for attack in options.attacks
        if attack.name != NO_ATTACK
    )
    return replace(options, attacks=attacks)
