"""Rows by what they are about: the questions that tables and plots ask."""

from collections.abc import Iterable, Sequence

from core.benchmark.options import INVISIBLE, NO_ATTACK
from core.benchmark.rows import Row


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
    """The methods, in the order in which they first appear."""
    return list(dict.fromkeys(row["method"] for row in rows))


def counts(rows: Iterable[Row]) -> list[int]:
    """The counts that were asked for."""
    return sorted({row["count"] for row in visible(rows)})


def middle_count(rows: Iterable[Row]) -> int:
    """The count at which methods are compared: the middle of those asked for."""
    found = counts(rows)
    return found[len(found) // 2] if found else 0


def values(rows: Iterable[Row], metric: str) -> list[float]:
    """The values of ``metric`` that are there; a metric, or another number of the row."""
    found = (row["metrics"].get(metric, row.get(metric)) for row in ok(rows))
    return [value for value in found if value is not None]


def paired(rows: Sequence[Row], by: Sequence[str]) -> list[Row]:
    """The rows of the assets that every method in ``by`` marked, so that no method gains by refusing hard ones."""
    marked = [{row["sha256"] for row in ok(rows) if row["method"] == method} for method in by]
    common = set.intersection(*marked) if marked else set()
    return [row for row in ok(rows) if row["sha256"] in common and row["method"] in by]
