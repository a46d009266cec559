"""Run times of each method, and their growth with the asset."""

import math
from collections.abc import Sequence

from core.lab.benchmark.markdown import NOTHING, exponent, table
from core.lab.benchmark.published import RUN_TIME
from core.lab.benchmark.rows import Row
from core.lab.benchmark.select import methods, ok, unattacked, visible
from core.lab.benchmark.statistics import PowerLaw, power_law
from core.lab.benchmark.tables import of_method


def points(rows: Sequence[Row], method: str, count: int) -> tuple[list[float], list[float]]:
    """Vertices, and seconds from the file's bytes to the watermarked mesh, of each asset that ``method`` marked."""
    chosen = [row for row in ok(of_method(unattacked(visible(rows), count), method)) if row["seconds"].get("run")]
    return [row["vertices"] for row in chosen], [row["seconds"]["run"] for row in chosen]


def run_times(rows: Sequence[Row], count: int) -> str:
    """The fitted power law of each method, and its values at the sizes that the paper gives times for."""
    body = []
    for method in methods(visible(rows)):
        vertices, seconds = points(rows, method, count)
        if not seconds:
            continue
        law = power_law(vertices, seconds)
        body.append(
            [
                method,
                str(len(seconds)),
                f"{min(vertices):,} to {max(vertices):,}",
                f"{sum(seconds) / len(seconds):.2f}",
                f"{max(seconds):.2f}",
                exponent(law),
                *(_at(law, size) for size, _ in RUN_TIME),
            ]
        )
    published = power_law_through(*RUN_TIME)
    body.append(["published", NOTHING, NOTHING, NOTHING, NOTHING, f"{published:.2f} (from its two points)"])
    body[-1] += [f"{seconds:g}" for _, seconds in RUN_TIME]
    header = ["Method", "Assets", "Vertices", "Mean [s]", "Longest [s]", "Exponent"]
    return table(header + [f"At {size:,} vertices [s]" for size, _ in RUN_TIME], body)


def power_law_through(first: tuple[int, float], second: tuple[int, float]) -> float:
    """The exponent of the power law through two points (x, y)."""
    return math.log(second[1] / first[1]) / math.log(second[0] / first[0])


def _at(law: PowerLaw | None, size: int) -> str:
    return NOTHING if law is None else f"{law.factor * size**law.exponent:.1f}"
