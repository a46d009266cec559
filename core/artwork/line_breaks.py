"""Layouts of a text in several lines, broken where its writing allows it (UAX 14)."""

import unicodedata
from itertools import accumulate, pairwise, takewhile

from fontTools.unicodedata import script
from uniseg.graphemecluster import grapheme_clusters
from uniseg.linebreak import line_break_units

MOST_LINES = 4

# Widths in ems, near enough to balance lines before any font is chosen: of ideographs and their like, and of letters.
WIDE, NARROW, SPACE = 1.0, 0.65, 0.35
SHORTEST = 2 * WIDE  # of the longest line of a layout of several


def line_breaks(text: str, most: int = MOST_LINES) -> list[tuple[str, ...]]:
    """The layouts of a text in 1 to ``most`` lines, for each number of lines the one whose longest line is shortest.

    Lines end at spaces, after hyphens, and between ideographs and kana, as UAX 14 allows: not before closing
    punctuation and small kana, not after opening ones. Korean is broken at its spaces only, and words never; lines of
    ideographs are not more than the longest of them is long, or they would be read as columns, and columns as lines. A
    text that has line breaks of its own keeps them, as its one layout.

    Returns:
        The lines of each layout, without spaces at their ends; fewer layouts where the text has fewer places to break.
    """
    given = text.splitlines()
    if len(given) > 1:
        return [tuple(given)]
    units = _units(text.strip())
    layouts = [_balanced(units, count) for count in range(1, min(most, len(units)) + 1)]
    return list(takewhile(lambda lines: len(lines) == 1 or max(map(width_in_ems, lines)) >= _shortest(lines), layouts))


def _shortest(lines: tuple[str, ...]) -> float:
    """Width of the longest of several ``lines``, in ems, at least."""
    return max(SHORTEST, len(lines) * WIDE if any(_is_wide(line[-1]) for line in lines) else 0.0)


def _units(text: str) -> list[str]:
    """The parts of a line that no break may divide, with the spaces after them."""
    units: list[str] = []
    for unit in line_break_units(text):
        if units and (unit.isspace() or (_is_hangul(units[-1][-1]) and _is_hangul(unit[0]))):
            units[-1] += unit
        else:
            units.append(unit)
    return units


def _is_hangul(character: str) -> bool:
    return bool(script(character) == "Hang")


def _balanced(units: list[str], count: int) -> tuple[str, ...]:
    """Units in ``count`` lines: the longest is as short as can be, and the lengths differ least by their squares."""
    reach = [0.0, *accumulate(map(width_in_ems, units))]
    spaces = [width_in_ems(unit) - width_in_ems(unit.rstrip()) for unit in units]
    # By the number of units set: the longest line, the sum of squares, and where lines end.
    best: dict[int, tuple[float, float, tuple[int, ...]]] = {0: (0.0, 0.0, (0,))}
    for _ in range(count):
        best = {
            stop: min(
                (max(longest, width), squares + width**2, (*ends, stop))
                for start, (longest, squares, ends) in best.items()
                if start < stop
                for width in [reach[stop] - reach[start] - spaces[stop - 1]]
            )
            for stop in range(min(best) + 1, len(units) + 1)
        }
    return tuple("".join(units[start:stop]).strip() for start, stop in pairwise(best[len(units)][2]))


def width_in_ems(line: str) -> float:
    """Width of a line in ems, estimated by the kind of its characters."""
    return sum(_advance(cluster[0]) for cluster in (line if line.isascii() else grapheme_clusters(line)))


def _advance(character: str) -> float:
    if character.isspace():
        return SPACE
    return WIDE if _is_wide(character) else NARROW


def _is_wide(character: str) -> bool:
    return unicodedata.east_asian_width(character) in "WF"
