"""The paper's figures from rows, as PNG and SVG; the same rows give the same bytes."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.markdown import METRICS
from core.lab.benchmark.rows import Row
from core.lab.benchmark.run_time import points
from core.lab.benchmark.select import counts, methods, middle_count, paired, unattacked, values, visible
from core.lab.benchmark.statistics import Mean, mean, power_law
from core.lab.benchmark.tables import of_method

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# sRGB; Okabe and Ito's palette, distinguishable with every kind of colour vision; the markers differ too.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
STYLE: Any = {
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "axes.labelsize": 10,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 11,
    "figure.dpi": 100,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "savefig.dpi": 180,
    "svg.hashsalt": "meshmark",
}


@dataclass(frozen=True)
class Curve:
    """A panel: utility over quality, a line for each method through its counts."""

    x: str
    y: str


FIGURES = {
    "trade-off": (Curve("wps", "ss"), Curve("ocr", "smse")),
    "visibility": (Curve("ray", "smse"),),
    "prominence": (Curve("prominence", "ocr"), Curve("prominence", "smse"), Curve("prominence", "ss")),
}


def require_matplotlib() -> None:
    """Raise ``rendering_unavailable`` before hours of work where the plots could not be drawn in the end."""
    try:
        import matplotlib  # noqa: F401 - whether it is there is all that is asked
    except ImportError as error:
        raise MeshmarkError(
            ErrorCode.RENDERING_UNAVAILABLE,
            "The benchmark draws its plots with matplotlib, which is not installed.",
            'Run `pip install "meshmark[benchmark]"`.',
        ) from error


def write_plots(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw the figures that the rows have values for into ``out``; returns the PNG of each."""
    drawn = []
    for name, curves in FIGURES.items():
        there = [curve for curve in curves if _lines(rows, curve)]
        if there:
            drawn.append(_save(partial(_curves, rows, there), out / name))
    if any(points(rows, method, middle_count(rows))[0] for method in methods(visible(rows))):
        drawn.append(_save(partial(_run_time, rows), out / "run-time"))
    return drawn


def _save(draw: "Callable[[], Figure]", path: Path) -> Path:
    with _style():
        figure = draw()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None}, bbox_inches="tight")
        figure.savefig(path.with_suffix(".png"), metadata={"Software": None}, bbox_inches="tight")
    return path.with_suffix(".png")


def _style() -> AbstractContextManager[None]:
    from matplotlib import rc_context

    return rc_context(STYLE)


def _looks(rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Colour and marker by method, the same in all figures."""
    names = methods(visible(rows))
    return {name: (COLORS[row % len(COLORS)], MARKERS[row % len(MARKERS)]) for row, name in enumerate(names)}


def _lines(rows: Sequence[Row], curve: Curve) -> dict[str, list[tuple[int, Mean, Mean]]]:
    """By method: count, mean of x and mean of y; on the assets that every method marked at that count."""
    chosen = visible(unattacked(rows))
    lines: dict[str, list[tuple[int, Mean, Mean]]] = {}
    for count in counts(chosen):
        common = paired([row for row in chosen if row["count"] == count], methods(chosen))
        for method in methods(chosen):
            x, y = (mean(values(of_method(common, method), name)) for name in (curve.x, curve.y))
            if x and y:
                lines.setdefault(method, []).append((count, x, y))
    return lines


def _curves(rows: Sequence[Row], curves: Sequence[Curve]) -> "Figure":
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    figure = Figure(figsize=(5.2 * len(curves), 4.2), layout="constrained")
    looks = _looks(rows)
    handles: dict[str, Any] = {}
    for axes, curve in zip(np.atleast_1d(figure.subplots(1, len(curves))), curves, strict=True):
        for method, line in _lines(rows, curve).items():
            color, marker = looks[method]
            at, x, y = zip(*line, strict=True)
            handles[method] = axes.errorbar(
                [value.value for value in x],
                [value.value for value in y],
                xerr=[value.half or 0 for value in x],
                yerr=[value.half or 0 for value in y],
                color=color, marker=marker, markersize=6, linewidth=1.6, elinewidth=0.8, capsize=2, alpha=0.95,
            )  # fmt: skip
            for count, left, up in zip(at, x, y, strict=True):
                axes.annotate(
                    str(count),
                    (left.value, up.value),
                    xytext=(6, 5),
                    textcoords="offset points",
                    color=color,
                    size=8,
                    path_effects=[withStroke(linewidth=2, foreground="white")],
                )
        for name, label in ((curve.x, axes.set_xlabel), (curve.y, axes.set_ylabel)):
            label(f"{METRICS[name].label}{_unit(name)} ({'higher' if METRICS[name].higher else 'lower'} is better)")
        axes.set_title(f"{METRICS[curve.y].label} against {METRICS[curve.x].label}", loc="left")
    _legend(figure, handles, "numbers: watermarks asked for; bars: 95% intervals of the mean")
    return figure


def _run_time(rows: Sequence[Row]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes: Axes = figure.subplots()
    count = middle_count(rows)
    handles: dict[str, Any] = {}
    for method, (color, marker) in _looks(rows).items():
        vertices, seconds = points(rows, method, count)
        if not seconds:
            continue
        handle = axes.plot(vertices, seconds, linestyle="", marker=marker, color=color, markersize=5, alpha=0.75)[0]
        law = power_law(vertices, seconds)
        name = method
        if law:
            ends = np.array([min(vertices), max(vertices)], dtype=np.float64)
            axes.plot(ends, law.factor * ends**law.exponent, color=color, linewidth=1.5)
            name = f"{method}: exponent {law.exponent:.2f} ± {law.half:.2f}"
        handles[name] = handle
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("Vertices")
    axes.set_ylabel("Seconds from file to watermarked mesh")
    axes.set_title(f"Run time at {count} watermarks", loc="left")
    _legend(figure, handles, "lines: least squares in log-log; ±: 95% interval")
    return figure


def _legend(figure: "Figure", handles: dict[str, Any], note: str) -> None:
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=2, title=note,
        title_fontsize=8,
    )  # fmt: skip


def _unit(name: str) -> str:
    return f" [{METRICS[name].unit}]" if METRICS[name].unit else ""
