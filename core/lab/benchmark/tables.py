"""The paper's tables from rows: each function takes rows and gives Markdown."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from core.lab.benchmark import published
from core.lab.benchmark.markdown import METRICS, NOTHING, amount, best, number, table
from core.lab.benchmark.options import NO_ATTACK
from core.lab.benchmark.rows import Row
from core.lab.benchmark.select import counts, methods, ok, paired, unattacked, values, visible
from core.lab.benchmark.statistics import Mean, mean
from core.lab.benchmark.theft import STRIPPED

QUALITY = (
    "wps", "wps_area", "ray", "coverage", "crop_survival", "ocr", "ocr_ge_0.8", "ocr_exact", "ocr_color",
    "ocr_delivered", "ocr_delivered_ge_0.8",
    "smse", "ipe", "lce", "lce_pooled", "se", "se_lee2005", "ss",
)  # fmt: skip
DELIVERED = ("ocr", "ocr_ge_0.8", "ocr_delivered", "ocr_delivered_ge_0.8", "smse")
OBJECTIVE = ("ray", "coverage", "crop_survival", "ocr", "ocr_color", "ocr_delivered", "smse", "se", "ss")
ATTACKED = ("ray", "ocr", "ocr_color", "ipe", "ss", "survived", "bit_accuracy")
# In the order of execution; `run` is the sum of all before it that a method needs.
STEPS = ("reading", "solid", "candidates", "fine-tuning", "saliency", "marking", "run", "pictures")
INVISIBLE = ("ray", "ocr", "smse", "ss", "bit_accuracy")
TRADE_OFF = ("wps", "ray", "ocr", "smse", "ipe", "se", "ss")
PAPER = "the paper's"


def comparison(
    groups: Sequence[tuple[Sequence[str], Sequence[Row]]], labels: Sequence[str], metrics: Sequence[str]
) -> str:
    """Means over groups of rows, the best of each metric in bold; metrics that no row has are left out.

    Args:
        groups: the cells that name the group, and its rows.
        labels: headings of these cells.
        metrics: names in ``METRICS``.
    """
    shown = [name for name in metrics if any(values(rows, name) for _, rows in groups)]
    columns = [best([mean(values(rows, name)) for _, rows in groups], METRICS[name].higher) for name in shown]
    body = [[*cells, *(column[row] for column in columns)] for row, (cells, _) in enumerate(groups)]
    return table([*labels, *(METRICS[name].heading for name in shown)], body)


def quality(rows: Sequence[Row], count: int, only_common: bool) -> str:
    """Watermark quality and asset utility by method (the paper's Tab. 1).

    Args:
        rows: all.
        count: requested number of watermarks.
        only_common: on the assets that all methods marked.
    """
    chosen = visible(unattacked(rows, count))
    if only_common:
        chosen = paired(chosen, methods(chosen))
    return comparison(
        [_group(method, of_method(chosen, method)) for method in methods(chosen)],
        ["Method", "Assets", "Marks"],
        QUALITY,
    )


def published_quality() -> str:
    """The paper's Tab. 1 as it was printed."""
    shown = [name for name in QUALITY if name in published.QUALITY["Manifold40"]["li"]]
    body = [
        [dataset, method, *_best_of(found, method, shown)]
        for dataset, found in published.QUALITY.items()
        for method in found
    ]
    return table(["Dataset", "Method", *(METRICS[name].heading for name in shown)], body)


def delivered(rows: Sequence[Row], count: int) -> str:
    """Our own product in pictures of clay and as it is delivered, over all assets and over those with textures."""
    chosen = [row for row in ok(unattacked(rows, count)) if row["metrics"].get("ocr_delivered") is not None]
    if not chosen:
        return "No file was read as it is delivered."
    groups = []
    for name, kept in (("all", chosen), ("textured", [row for row in chosen if row.get("textured")])):
        for method in methods(kept):
            one = of_method(kept, method)
            groups.append(([method, name, str(len(one))], one))
    return comparison(groups, ["Method", "Assets", "Number"], DELIVERED)


def delivered_by_asset(rows: Sequence[Row], count: int) -> str:
    """OCR of clay / as delivered for each asset and method that was read both ways; textured assets first."""
    chosen = [row for row in ok(unattacked(rows, count)) if row["metrics"].get("ocr_delivered") is not None]
    names = methods(chosen)
    assets: dict[tuple[bool, str], dict[str, str]] = {}
    for row in chosen:
        both = (number(row["metrics"][name]) for name in ("ocr", "ocr_delivered"))
        assets.setdefault((not row.get("textured"), row["asset"]), {})[row["method"]] = " / ".join(both)
    body = [
        [asset, NOTHING if plain else "yes", *(cells.get(name, NOTHING) for name in names)]
        for (plain, asset), cells in sorted(assets.items())
    ]
    return table(["Asset", "Textures", *names], body)


def ablation(rows: Sequence[Row], count: int) -> str:
    """The paper's own pipeline without one of its parts (its Tab. 2), on the assets that all of these marked."""
    chosen = visible(unattacked(rows, count))
    names = [name for name in ("meshmark", *published.ABLATION) if name in methods(chosen)]
    common = paired(chosen, names)
    return comparison([_group(name, of_method(common, name)) for name in names], ["Method", "Assets", "Marks"], QUALITY)


def objective(rows: Sequence[Row], count: int) -> str:
    """Our own pipeline without one of the objective's terms, on the assets that all of these marked."""
    chosen = visible(unattacked(rows, count))
    names = [name for name in methods(chosen) if name == "meshmark" or name.startswith("meshmark-no-")]
    if len(names) < 2:
        return "None of them was run; `make ablation` does."
    common = paired(chosen, names)
    return comparison(
        [_group(name, of_method(common, name)) for name in names], ["Method", "Assets", "Marks"], OBJECTIVE
    )


def published_ablation() -> str:
    """The paper's Tab. 2 as it was printed."""
    shown = [name for name in QUALITY if name in published.ABLATION["paper"]]
    body = [[method, *_best_of(published.ABLATION, method, shown)] for method in published.ABLATION]
    return table(["Method", *(METRICS[name].heading for name in shown)], body)


def attacks(rows: Sequence[Row], only_common: bool) -> str:
    """Metrics after each attack (the paper's Tab. 3), the best of each attack in bold."""
    lines: list[list[str]] = []
    attacked = [row for row in rows if row["attack"] != NO_ATTACK]
    if not attacked:
        return "No attack was run."
    at = {row["count"] for row in attacked}
    chosen = [row for row in rows if row["count"] in at]
    kinds = dict.fromkeys((row["attack"], row["strength"], row["count"] or None) for row in chosen)
    shown = [name for name in ATTACKED if values(chosen, name)]
    several = len(counts(chosen)) > 1
    for attack, strength, count in sorted(kinds, key=lambda kind: (kind[0] != NO_ATTACK, str(kind))):
        if count is None and counts(chosen):
            continue  # the invisible method has a line at each count
        here = [row for row in chosen if (row["attack"], row["strength"]) == (attack, strength)]
        here = [row for row in here if row["count"] in (count or 0, 0)]
        if only_common:
            here = paired(here, methods(here))
        groups = [(method, of_method(here, method)) for method in methods(here)]
        columns = [best([mean(values(one, name)) for _, one in groups], METRICS[name].higher) for name in shown]
        name = attack + (f" {strength:.3g}" if strength is not None else "") + (f", {count} marks" * several)
        for position, (method, one) in enumerate(groups):
            lines.append([name, method, str(len(ok(one))), *(column[position] for column in columns)])
    return table(["Attack", "Method", "Assets", *(METRICS[name].heading for name in shown)], lines)


def removal_resistance(rows: Sequence[Row]) -> str:
    """Thieves who have only the marked file: the share of assets that they do not strip, with what is regained and
    read."""
    stolen = [row for row in ok(rows) if row["metrics"].get("recovered") is not None]
    if not stolen:
        return "No thief was let in."
    lines = []
    for attack in dict.fromkeys(row["attack"] for row in stolen):
        here = [row for row in stolen if row["attack"] == attack]
        for method in methods(here):
            one = of_method(here, method)
            stripped, regained = values(one, "stripped"), values(one, "recovered")
            resisted = f"{1 - sum(stripped) / len(stripped):.0%}" if stripped else NOTHING
            much = f"{sum(value >= STRIPPED for value in regained)} of {len(regained)}"
            read = [amount(mean(values(one, name))) for name in ("ocr", "ocr_relief", "ocr_delivered", "ss")]
            lines.append([attack, method, resisted, much, f"{np.median(regained):.2f}", *read])
    headings = ["not stripped", "≥ 90 % regained", "regained, median", "OCR", "OCR relief", "OCR as delivered", "SS"]
    return table(["Attack", "Method", *headings], lines)


def published_attacks() -> str:
    """The paper's Tab. 3 as it was printed."""
    shown = [name for name in ATTACKED if name in published.ATTACKS["none"]["li"]]
    body = [
        [attack, method, *_best_of(found, method, shown)]
        for attack, found in published.ATTACKS.items()
        for method in found
    ]
    return table(["Attack", "Method", *(METRICS[name].heading for name in shown)], body)


def invisible(rows: Sequence[Row], count: int) -> str:
    """Comparison with an invisible watermark (the paper's Tab. 4), on the assets that all methods marked."""
    chosen = unattacked(rows, count)
    common = paired(chosen, methods(chosen))
    groups = [_group(method, of_method(common, method))[:2] for method in methods(common)]
    ours = comparison([(cells[:2], found) for cells, found in groups], ["Method", "Assets"], INVISIBLE)
    shown = [name for name in INVISIBLE if name in published.INVISIBLE["paper"]]
    body = [[method, *_best_of(published.INVISIBLE, method, shown)] for method in published.INVISIBLE]
    theirs = table(["Method, published", *(METRICS[name].heading for name in shown)], body)
    return f"{ours}\n\n{theirs}"


def trade_off(rows: Sequence[Row]) -> str:
    """Quality and utility over the number of watermarks (the paper's trade-off figures as numbers)."""
    chosen = visible(unattacked(rows))
    groups = []
    for method in methods(chosen):
        for count in counts(chosen):
            found = [row for row in of_method(chosen, method) if row["count"] == count]
            groups.append(([method, str(count), *_group(method, found)[0][1:]], found))
    return comparison(groups, ["Method", "Asked", "Assets", "Marks"], TRADE_OFF)


def mesh_statistics(rows: Sequence[Row]) -> str:
    """Vertices and faces of the assets beside those of the paper's datasets (its supplement)."""
    assets = {row["sha256"]: row for row in rows if row.get("vertices") is not None}
    lines = []
    if assets:
        numbers = [f"{len(assets)}"]
        for name in ("vertices", "faces"):
            found = np.array([row[name] for row in assets.values()])
            numbers += [f"{found.min():,}", f"{found.max():,}", f"{found.mean():,.1f}"]
        lines.append([", ".join(sorted({row["dataset"] for row in rows})) + " (this run)", *numbers])
    lines += [
        [f"{name} ({PAPER})", *(f"{value:,}" for value in printed)] for name, printed in published.STATISTICS.items()
    ]
    sizes = [f"{what} {of}" for what in ("Vertices", "Faces") for of in ("min", "max", "mean")]
    return table(["Dataset", "Samples", *sizes], lines)


def acceptance(rows: Sequence[Row]) -> str:
    """Number of assets that each method marked at each count, and the reasons for the others."""
    chosen = unattacked(rows)
    lines = []
    for method in methods(chosen):
        of = of_method(chosen, method)
        for count in dict.fromkeys(row["count"] for row in sorted(of, key=lambda row: row["count"])):
            tried = [row for row in of if row["count"] == count]
            reasons = Counter(row["code"] for row in tried if row["status"] != "ok")
            share = f"{len(ok(tried))} of {len(tried)} ({len(ok(tried)) / len(tried):.0%})"
            why = ", ".join(f"{found} {code}" for code, found in reasons.most_common()) or NOTHING
            lines.append([method, str(count) if count else NOTHING, share, amount(mean(values(tried, "marks"))), why])
    return table(["Method", "Asked", "Accepted", "Marks placed", "Refused"], lines)


def stages(rows: Sequence[Row]) -> str:
    """Seconds of each step over all unattacked rows that took it."""
    chosen = ok(unattacked(rows))
    found = dict.fromkeys(name for row in chosen for name in row["seconds"])
    names = sorted(found, key=lambda name: STEPS.index(name) if name in STEPS else len(STEPS))
    lines = []
    for name in names:
        seconds = np.array([row["seconds"][name] for row in chosen if name in row["seconds"]])
        numbers = [f"{value:.2f}" for value in (seconds.mean(), np.median(seconds), seconds.max())]
        lines.append([name, *numbers, str(len(seconds))])
    return table(["Step", "Mean [s]", "Median [s]", "Longest [s]", "Rows"], lines)


def of_method(rows: Sequence[Row], method: str) -> list[Row]:
    """The rows of one method."""
    return [row for row in rows if row["method"] == method]


def _group(method: str, rows: Sequence[Row]) -> tuple[list[str], Sequence[Row]]:
    return [method, str(len(ok(rows))), amount(mean(values(rows, "marks")))], rows


def _best_of(found: dict[str, dict[str, float]], method: str, metrics: Sequence[str]) -> list[str]:
    """The printed numbers of one method, bold where the best of its block."""
    cells = []
    for name in metrics:
        means = [Mean(one[name], None, 1) for one in found.values()]
        cells.append(best(means, METRICS[name].higher)[list(found).index(method)])
    return cells
