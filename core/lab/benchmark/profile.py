"""Profile of jobs: seconds by stage, against the number of faces, and next to reading and writing alone."""

import json
import signal
import time
from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.scene import Scene, flatten
from core.lab.benchmark.datasets import Asset, load
from core.lab.benchmark.markdown import NOTHING, exponent, number, table
from core.lab.benchmark.results import environment, write_text
from core.lab.benchmark.rows import Row
from core.lab.benchmark.statistics import PowerLaw, power_law
from core.lab.benchmark.worker import failure, machine
from core.parameters import Parameters
from core.pipeline import STAGES, Progress, watermark
from core.preload import LATER, preload
from core.report import Report

SCHEMA = "meshmark.profile/1"
EVERY_STAGE = list(STAGES)
TO_THE_MODEL = EVERY_STAGE[: EVERY_STAGE.index("writing") + 1]  # the job without metrics
TOTAL, FLOOR = "without metrics", "floor"


def profile(
    folder: Path, *, repeats: int = 1, evaluate: Evaluate = Evaluate.NONE, progress: Progress | None = None
) -> dict[str, Any]:
    """Watermark every asset of a folder, one after the other, the smallest file first.

    Each run is a process of its own, forked from one that has loaded the libraries as a worker's jobs are, so that what
    an asset leaves in memory and in caches does not count for others. In it the asset is read and written without a
    watermark right before, so that the ratio of the two holds on a machine whose speed varies. Parameters are the
    defaults.

    Args:
        folder: the assets, at any depth.
        repeats: number of runs of each asset; the quickest counts.
        evaluate: level of the metrics to time, and with any the preview; with none the profile ends with the written
            model.
        progress: called with an asset's name and the share of assets done before it.

    Returns:
        ``meshmark.profile/1``, JSON-ready. ``assets``, by faces: seconds, processor seconds of all threads and peak
        memory [bytes] by stage, ``total`` and ``processor_total`` (up to the written model), ``floor`` (all seconds)
        and ``ratio``; or, where an asset is refused, its ``code`` and ``message``. ``stages``: over all assets that
        were not refused. ``ratio`` likewise.

    Raises:
        MeshmarkError: ``missing_file`` for a folder without assets, ``invalid_parameters`` for less than one repeat.
    """
    if repeats < 1:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f"{repeats} repeats measure nothing.", "Ask for at least one repeat."
        )
    dataset = load(folder, "folder", "")
    assets = sorted(dataset.assets, key=lambda asset: asset.path.stat().st_size)
    parameters = Parameters(text="watermark", evaluate=evaluate)
    rows = []
    for done, asset in enumerate(assets):
        if progress is not None:
            progress(asset.name, done / len(assets))
        rows.append(_measured(asset, parameters, repeats))
    if progress is not None:
        progress("done", 1.0)
    rows.sort(key=lambda row: row.get("faces", 0))
    ok = [row for row in rows if row["status"] == "ok"]
    return {
        "schema": SCHEMA,
        "environment": environment() | {"machine": machine()},
        "parameters": parameters.resolved().model_dump(mode="json"),
        "repeats": repeats,
        "notes": dataset.notes,
        "assets": rows,
        "stages": _stages(ok, TO_THE_MODEL if evaluate is Evaluate.NONE else EVERY_STAGE) if ok else [],
        "ratio": _ratio(ok) if ok else None,
    }


def markdown(profile: dict[str, Any]) -> str:
    """The profile as a page of its own."""
    return f"# Profile\n\n{tables(profile)}"


def tables(profile: dict[str, Any]) -> str:
    """The profile as a table by asset, a table by stage and, where there are any, a table of refused assets."""
    rows, stages = profile["assets"], [line["stage"] for line in profile["stages"]]
    ok, refused = ([row for row in rows if (row["status"] == "ok") is wanted] for wanted in (True, False))
    metrics = profile["parameters"]["evaluate"] != Evaluate.NONE
    sections = [_about(profile, len(ok))]
    if ok:
        measured = [stage for stage in stages if stage in EVERY_STAGE]
        header = ["Asset", "Bytes", "Vertices", "Faces", *(f"{stage} [s]" for stage in measured)]
        header += [f"{TOTAL} [s]", "CPU [s]", f"{FLOOR} [s]", "Ratio", "Peak [MB]"]
        sections += ["## By asset", table(header, [_asset_line(row, measured) for row in ok])]
        header = ["Stage", "Mean [s]", "CPU [s]", "Longest [s]", "Share", "Exponent", "Peak [MB]"]
        sections += ["## By stage", table(header, [_stage_line(line) for line in profile["stages"]])]
        sections.append(_about_stages(profile["ratio"], metrics))
    if refused:
        body = [[row["asset"], _count(row, "faces"), row["code"], row["message"]] for row in refused]
        sections += ["## Refused", table(["Asset", "Faces", "Code", "Why"], body)]
    for row in ok:
        if row["missing"]:
            sections.append(f"{row['asset']}: not measured: {', '.join(row['missing'])}.")
    return "\n\n".join(sections + profile["notes"]) + "\n"


def write_profile(profile: dict[str, Any], out: Path) -> None:
    """Write ``PROFILE.md`` and ``profile.json`` into ``out``; raises ``output_not_writable``."""
    write_text(out / "PROFILE.md", markdown(profile))
    write_text(out / "profile.json", json.dumps(profile, indent=1) + "\n")


def _measured(asset: Asset, parameters: Parameters, repeats: int) -> Row:
    """The asset's quickest run and quickest floor, or the error."""
    row: Row = {"asset": asset.name, "bytes": asset.path.stat().st_size}
    runs = []
    for _ in range(repeats):
        run = _run_apart(asset.path, parameters)
        if run["status"] != "ok":
            return row | run
        runs.append(run)
    best, floor = min(runs, key=lambda run: run["total"]), min(run["floor"] for run in runs)
    return row | best | {"floor": floor, "ratio": best["total"] / floor}


def _run_apart(path: Path, parameters: Parameters) -> Row:
    """Cost of one run in a process of its own, or the error."""
    context = get_context("forkserver")
    context.set_forkserver_preload([*LATER])
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_send_run, args=(theirs, path, parameters), daemon=True)
    child.start()
    theirs.close()  # so that the end of the process is the end of the pipe
    try:
        row: Row = ours.recv()
    except EOFError:
        child.join()
        message = f"The process ended before its result (exit status {child.exitcode})."
        row = failure(MeshmarkError(ErrorCode.ENGINE_CRASHED, message, "Watermark this asset alone."))
    finally:
        child.kill()  # where this one is interrupted; else it has ended
        child.join()
        ours.close()
    return row


def _send_run(connection: Connection, path: Path, parameters: Parameters) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent, which gets it too, ends this process
    preload()
    row: Row = {}
    try:
        data = path.read_bytes()
        surface = _read_and_write(data).surface  # loads what only this file's format needs
        row = {"vertices": len(surface.positions), "faces": len(surface.faces)}
        del surface
        row |= {"status": "ok"} | _run(data, parameters)
    except Exception as error:  # the row records it, and the other assets go on
        row |= failure(error)
    connection.send(row)


def _run(data: bytes, parameters: Parameters) -> Row:
    """Cost of one run of the engine, and the floor right before."""
    start = time.perf_counter()
    _read_and_write(data)
    floor = round(time.perf_counter() - start, 6)
    clock = _ProcessorClock()
    preview = parameters.evaluate is not Evaluate.NONE
    result = watermark(data, parameters, preview=preview, progress=clock.tell)
    processor = clock.seconds()
    report = Report.model_validate(result.report)
    measured = EVERY_STAGE if report.metrics else TO_THE_MODEL
    seconds = {stage: report.timings[stage] for stage in measured}
    memory = {stage: report.memory[stage] for stage in measured}
    return {
        "seconds": seconds,
        "processor": {stage: processor[stage] for stage in measured},
        "memory": memory,
        "total": sum(seconds[stage] for stage in TO_THE_MODEL),
        "processor_total": sum(processor[stage] for stage in TO_THE_MODEL),
        "floor": floor,
        "peak": max(memory.values()),
        "missing": sorted(report.metrics.missing) if report.metrics else [],
    }


class _ProcessorClock:
    """Processor seconds of all threads of this process, by stage: the engine tells when each begins."""

    def __init__(self) -> None:
        self._begun: dict[str, float] = {}

    def tell(self, stage: str, _share: float) -> None:
        """Note when a stage begins; it tells of its progress more often."""
        self._begun.setdefault(stage, time.process_time())

    def seconds(self) -> dict[str, float]:
        """Of each stage until the next one began, and of the last until now."""
        times = [*self._begun.values(), time.process_time()]
        return {stage: round(end - start, 4) for stage, (start, end) in zip(self._begun, pairwise(times), strict=True)}


def _read_and_write(data: bytes) -> Scene:
    """The floor: reading and writing a file without watermarking it."""
    scene = flatten(document_of(admit(data)))
    scene.document.to_glb()
    return scene


def _stages(rows: Sequence[Row], stages: Sequence[str]) -> list[dict[str, Any]]:
    """A line for each stage, for all up to the model, and for the floor."""
    seconds = [row["seconds"] | {TOTAL: row["total"], FLOOR: row["floor"]} for row in rows]
    processor = [row["processor"] | {TOTAL: row["processor_total"], FLOOR: None} for row in rows]
    peaks = [row["memory"] | {TOTAL: row["memory"][TO_THE_MODEL[-1]], FLOOR: None} for row in rows]
    faces, whole = [row["faces"] for row in rows], sum(row["total"] for row in rows)
    lines = []
    for name in [*TO_THE_MODEL, TOTAL, *stages[len(TO_THE_MODEL) :], FLOOR]:
        costs = [row[name] for row in seconds]
        lines.append(
            {
                "stage": name,
                "mean": sum(costs) / len(costs),
                "processor": None if name == FLOOR else sum(row[name] for row in processor) / len(costs),
                "longest": max(costs),
                "share": sum(costs) / whole,
                "law": _law(faces, costs),
                "peak": None if name == FLOOR else max(row[name] for row in peaks),
            }
        )
    return lines


def _ratio(rows: Sequence[Row]) -> dict[str, Any]:
    ratios = [row["ratio"] for row in rows]
    return {
        "of_sums": sum(row["total"] for row in rows) / sum(row["floor"] for row in rows),
        "median": median(ratios),
        "least": min(ratios),
        "most": max(ratios),
        "law": _law([row["faces"] for row in rows], ratios),
    }


def _law(faces: Sequence[int], costs: Sequence[float]) -> dict[str, Any] | None:
    # Timings are in steps of 0.1 ms; 0 has no logarithm.
    pairs = [(count, cost) for count, cost in zip(faces, costs, strict=True) if cost > 0]
    law = power_law([count for count, _ in pairs], [cost for _, cost in pairs])
    return None if law is None else asdict(law)


def _about(profile: dict[str, Any], ok: int) -> str:
    repeats = profile["repeats"]
    runs = "one run each" if repeats == 1 else f"the quickest of {repeats} runs each"
    return (
        f"{ok} of {len(profile['assets'])} assets watermarked, by faces; {runs}; {profile['environment']['machine']}. "
        "Each run is a process of its own, forked from one that has loaded the libraries. *Without metrics* is reading "
        "to writing, and *CPU* the processor seconds of all threads meanwhile. The *floor* reads and writes the same "
        "asset without a watermark, in the same process right before, and *ratio* is between these two. *Peak* is the "
        "most memory the process held, libraries included."
    )


def _about_stages(ratio: dict[str, Any], metrics: bool) -> str:
    text = (
        "*CPU* is the mean of the processor seconds. *Share* is of the job without metrics, all assets together. "
        "Seconds grow with the number of faces to the power of *exponent* (least squares in log-log, ± half of its 95% "
        "interval). A stage's peak is the one by its end. "
        f"The job without metrics takes {number(ratio['of_sums'])} times its floor, all assets together; "
        f"{number(ratio['median'])} times at the median, from {number(ratio['least'])} to {number(ratio['most'])}; "
        f"exponent of the ratio: {exponent(_law_of(ratio))}."
    )
    return text + " Rendering includes the preview." * metrics


def _asset_line(row: Row, stages: Sequence[str]) -> list[str]:
    counts = [_count(row, name) for name in ("bytes", "vertices", "faces")]
    seconds = [number(row["seconds"][stage]) for stage in stages]
    whole = [number(row[name]) for name in ("total", "processor_total", "floor", "ratio")]
    return [row["asset"], *counts, *seconds, *whole, _peak(row)]


def _stage_line(line: dict[str, Any]) -> list[str]:
    share = f"{line['share']:.1%}"
    processor = NOTHING if line["processor"] is None else number(line["processor"])
    times = [number(line["mean"]), processor, number(line["longest"])]
    return [line["stage"], *times, share, exponent(_law_of(line)), _peak(line)]


def _law_of(line: dict[str, Any]) -> PowerLaw | None:
    return None if line["law"] is None else PowerLaw(**line["law"])


def _count(row: Row, name: str) -> str:
    return f"{row[name]:,}" if name in row else NOTHING


def _peak(row: Row) -> str:
    return NOTHING if row["peak"] is None else f"{row['peak'] / 1e6:,.0f}"
