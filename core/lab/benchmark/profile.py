"""Profile of jobs: seconds by stage, against the number of faces, and next to reading and writing alone."""

import gc
import json
import time
from collections.abc import Sequence
from dataclasses import asdict
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
from core.report import Report

SCHEMA = "meshmark.profile/1"
EVERY_STAGE = list(STAGES)
TO_THE_MODEL = EVERY_STAGE[: EVERY_STAGE.index("writing") + 1]  # the job without metrics
TOTAL, FLOOR = "without metrics", "floor"
CLEAR_REFS = Path("/proc/self/clear_refs")


def profile(
    folder: Path, *, repeats: int = 1, evaluate: Evaluate = Evaluate.NONE, progress: Progress | None = None
) -> dict[str, Any]:
    """Watermark every asset of a folder in this process, one after the other, the smallest file first.

    Each asset is read and written without a watermark right beside its watermarking, so that the ratio of the two
    holds on a machine whose speed varies. Parameters are the defaults.

    Args:
        folder: the assets, at any depth.
        repeats: number of runs of each asset; the quickest counts.
        evaluate: level of the metrics to time, and with any the preview; with none the profile ends with the written
            model.
        progress: called with an asset's name and the share of assets done before it.

    Returns:
        ``meshmark.profile/1``, JSON-ready. ``assets``, by faces: seconds and peak memory [bytes] by stage, ``total``
        (up to the written model), ``floor`` (both seconds) and ``ratio``; or, where an asset is refused, its ``code``
        and ``message``. ``stages``: over all assets that were not refused. ``ratio`` likewise.

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
    for asset in assets:  # loading the libraries does not count
        if _measured(asset, parameters, 1)["status"] == "ok":
            break
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
    """The profile as a table by asset, a table by stage and, where there are any, a table of refused assets."""
    rows, stages = profile["assets"], [line["stage"] for line in profile["stages"]]
    ok, refused = ([row for row in rows if (row["status"] == "ok") is wanted] for wanted in (True, False))
    metrics = profile["parameters"]["evaluate"] != Evaluate.NONE
    sections = ["# Profile", _about(profile, len(ok))]
    if ok:
        measured = [stage for stage in stages if stage in EVERY_STAGE]
        header = ["Asset", "Bytes", "Vertices", "Faces", *(f"{stage} [s]" for stage in measured)]
        header += [f"{TOTAL} [s]", f"{FLOOR} [s]", "Ratio", "Peak [MB]"]
        sections += ["## By asset", table(header, [_asset_line(row, measured) for row in ok])]
        header = ["Stage", "Mean [s]", "Longest [s]", "Share", "Exponent", "Peak [MB]"]
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
    try:
        data = asset.path.read_bytes()
        surface = _read_and_write(data).surface  # loads what only this file's format needs
        row |= {"vertices": len(surface.positions), "faces": len(surface.faces)}
        del surface
        runs = [_run(data, parameters) for _ in range(repeats)]
    except Exception as error:  # the row records it, and the other assets go on
        return row | failure(error)
    best, floor = min(runs, key=lambda run: run["total"]), min(run["floor"] for run in runs)
    return row | {"status": "ok"} | best | {"floor": floor, "ratio": best["total"] / floor}


def _run(data: bytes, parameters: Parameters) -> Row:
    """Cost of one run of the engine, and the floor right before."""
    gc.collect()  # garbage of earlier assets does not count for this one
    start = time.perf_counter()
    _read_and_write(data)
    floor = round(time.perf_counter() - start, 6)
    _forget_peak_memory()
    result = watermark(data, parameters, preview=parameters.evaluate is not Evaluate.NONE)
    report = Report.model_validate(result.report)
    measured = EVERY_STAGE if report.metrics else TO_THE_MODEL
    seconds = {stage: report.timings[stage] for stage in measured}
    memory = {stage: report.memory[stage] for stage in measured}
    return {
        "seconds": seconds,
        "memory": memory,
        "total": sum(seconds[stage] for stage in TO_THE_MODEL),
        "floor": floor,
        "peak": max(memory.values()),
        "missing": sorted(report.metrics.missing) if report.metrics else [],
    }


def _read_and_write(data: bytes) -> Scene:
    """The floor: reading and writing a file without watermarking it."""
    scene = flatten(document_of(admit(data)))
    scene.document.to_glb()
    return scene


def _forget_peak_memory() -> None:
    """Reset the peak memory of this process to its present one (Linux, proc(5), clear_refs).

    Elsewhere a process cannot reset its peak, and the profile says so.
    """
    if CLEAR_REFS.exists():
        CLEAR_REFS.write_text("5")


def _stages(rows: Sequence[Row], stages: Sequence[str]) -> list[dict[str, Any]]:
    """A line for each stage, for all up to the model, and for the floor."""
    seconds = [row["seconds"] | {TOTAL: row["total"], FLOOR: row["floor"]} for row in rows]
    peaks = [row["memory"] | {TOTAL: row["memory"][TO_THE_MODEL[-1]], FLOOR: None} for row in rows]
    faces, whole = [row["faces"] for row in rows], sum(row["total"] for row in rows)
    lines = []
    for name in [*TO_THE_MODEL, TOTAL, *stages[len(TO_THE_MODEL) :], FLOOR]:
        costs = [row[name] for row in seconds]
        lines.append(
            {
                "stage": name,
                "mean": sum(costs) / len(costs),
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
    of_one_run = "during the run, libraries included"
    so_far = "up to the end of the run, for another asset perhaps: this system cannot tell the peak of one run"
    return (
        f"{ok} of {len(profile['assets'])} assets watermarked, by faces; {runs}; {profile['environment']['machine']}. "
        "*Without metrics* is reading to writing. The *floor* reads and writes the same asset without a watermark, in "
        "the same process right before, and *ratio* is between these two. *Peak* is the most memory the process held "
        f"{of_one_run if CLEAR_REFS.exists() else so_far}."
    )


def _about_stages(ratio: dict[str, Any], metrics: bool) -> str:
    text = (
        "*Share* is of the job without metrics, all assets together. Seconds grow with the number of faces to the "
        "power of *exponent* (least squares in log-log, ± half of its 95% interval). A stage's peak is the one by its "
        f"end. The job without metrics takes {number(ratio['of_sums'])} times its floor, all assets together; "
        f"{number(ratio['median'])} times at the median, from {number(ratio['least'])} to {number(ratio['most'])}; "
        f"exponent of the ratio: {exponent(_law_of(ratio))}."
    )
    return text + " Rendering includes the preview." * metrics


def _asset_line(row: Row, stages: Sequence[str]) -> list[str]:
    counts = [_count(row, name) for name in ("bytes", "vertices", "faces")]
    seconds = [number(row["seconds"][stage]) for stage in stages]
    return [row["asset"], *counts, *seconds, *(number(row[name]) for name in ("total", "floor", "ratio")), _peak(row)]


def _stage_line(line: dict[str, Any]) -> list[str]:
    share = f"{line['share']:.1%}"
    return [line["stage"], number(line["mean"]), number(line["longest"]), share, exponent(_law_of(line)), _peak(line)]


def _law_of(line: dict[str, Any]) -> PowerLaw | None:
    return None if line["law"] is None else PowerLaw(**line["law"])


def _count(row: Row, name: str) -> str:
    return f"{row[name]:,}" if name in row else NOTHING


def _peak(row: Row) -> str:
    return NOTHING if row["peak"] is None else f"{row['peak'] / 1e6:,.0f}"
