"""Selections of rows, for tables and plots."""

from collections.abc import Iterable, Sequence

from core.lab.benchmark.options import INVISIBLE, NO_ATTACK
from core.lab.benchmark.rows import Row

# The order of methods in tables and legends; others follow by name.
ORDER = (
    "meshmark",
    "meshmark-default",
    "meshmark-discreet",
    "meshmark-strong",
    "meshmark-flat",
    "li",
    "paper",
    "paper-no-curve-matching",
    "paper-no-optimization",
    "paper-no-filtering",
    INVISIBLE,
)


def ordered(rows: Iterable[Row]) -> list[Row]:
    """Rows by asset, method, count and attack, in an order independent of that of their making."""
    return sorted(
        rows,
        key=lambda row: (
            row["asset"],
            _rank(row["method"]),
            row["count"],
            row["attack"] != NO_ATTACK,
            row["attack"],
            row["strength"] or 0.0,
            row["key"],
        ),
    )


def latest(rows: Sequence[Row]) -> list[Row]:
    """The rows with the settings and version of the newest one, the newest for each asset, method, count and attack.

    A folder may hold the rows of several runs; means over different settings would say nothing.
    """
    newest = max(rows, key=lambda row: row["at"], default=None)
    found: dict[tuple[object, ...], Row] = {}
    for row in sorted(rows, key=lambda row: row["at"]):
        if newest and all(row[name] == newest[name] for name in ("settings", "version")):
            found[tuple(row[name] for name in ("sha256", "method", "count", "attack", "strength"))] = row
    return list(found.values())


def ok(rows: Iterable[Row]) -> list[Row]:
    """The rows that have values."""
    return [row for row in rows if row["status"] == "ok"]


def unattacked(rows: Iterable[Row], count: int | None = None) -> list[Row]:
    """The rows without an attack, at ``count`` watermarks if given; the invisible method has no count."""
    return [
        row
        for row in rows
        if row["attack"] == NO_ATTACK and (count is None or row["count"] == count or row["method"] == INVISIBLE)
    ]


def visible(rows: Iterable[Row]) -> list[Row]:
    """The rows of methods that place marks."""
    return [row for row in rows if row["method"] != INVISIBLE]


def methods(rows: Iterable[Row]) -> list[str]:
    """The methods, in the order of ``ORDER``."""
    return sorted({row["method"] for row in rows}, key=_rank)


def _rank(method: str) -> tuple[int, str]:
    return (ORDER.index(method) if method in ORDER else len(ORDER), method)


def counts(rows: Iterable[Row]) -> list[int]:
    """The requested counts."""
    return sorted({row["count"] for row in visible(rows)})


def middle_count(rows: Iterable[Row]) -> int:
    """The count at which methods are compared: the middle of the requested ones."""
    found = counts(rows)
    return found[len(found) // 2] if found else 0


def values(rows: Iterable[Row], metric: str) -> list[float]:
    """The values of ``metric``, a metric or another number of the row, without missing ones."""
    found = (row["metrics"].get(metric, row.get(metric)) for row in ok(rows))
    return [value for value in found if value is not None]


def paired(rows: Sequence[Row], by: Sequence[str]) -> list[Row]:
    """The rows of the assets that every method in ``by`` marked, so that no method gains by refusing hard ones."""
    marked = [{row["sha256"] for row in ok(rows) if row["method"] == method} for method in by]
    common = set.intersection(*marked) if marked else set()
    return [row for row in ok(rows) if row["sha256"] in common and row["method"] in by]
