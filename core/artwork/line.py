"""Single lines of text: rows, and the columns of vertical setting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from unicodedata import east_asian_width

from fontTools.unicodedata import script

from core.artwork.installed import CJK
from core.artwork.itemization import Piece, runs_of, text_of
from core.artwork.shaping import Glyph, Spacing, shape
from core.artwork.typeface import Typeface

# Scripts whose letters stand upright in columns; others are turned (UAX 50).
UPRIGHT = {*CJK, "Kits", "Nshu", "Tang", "Yiii"}
ACRONYM = 3  # capitals or digits, at most, that stand upright one below the other


@dataclass(frozen=True, eq=False)
class Line:
    """A line set from the origin.

    Attributes:
        glyphs: of the line.
        advance: its length, to the right or down.
        below, above: how far its letters reach across it: down and up from a row, left and right of a column.
    """

    glyphs: list[Glyph]
    advance: float
    below: float
    above: float


def has_upright(text: str) -> bool:
    """True where letters of a text are made to stand one below the other."""
    return any(script(character) in UPRIGHT for character in text)


def row(pieces: Sequence[Piece], spacing: Spacing) -> Line:
    """A line from left to right."""
    glyphs, advance = shape(text_of(pieces), runs_of(pieces), spacing)
    ends = [end for glyph in glyphs for end in _ends(glyph, spacing.upem, across=1)]
    return Line(glyphs, advance, min(ends, default=0.0), max(ends, default=0.0))


def enlarged(line: Line, scale: float) -> Line:
    """A line in another size, about the origin."""
    glyphs = [replace(one, x=one.x * scale, y=one.y * scale, scale=one.scale * scale) for one in line.glyphs]
    return Line(glyphs, line.advance * scale, line.below * scale, line.above * scale)


def column(pieces: Sequence[Piece], spacing: Spacing) -> Line:
    """A line from the top down, its middle on the vertical axis: upright letters, and rows turned clockwise."""
    glyphs: list[Glyph] = []
    pen = 0.0
    gap = spacing.letters * spacing.upem
    for number, (upright, group) in enumerate(
        groupby(zip(pieces, _upright(pieces), strict=True), key=lambda item: item[1])
    ):
        part = [piece for piece, _ in group]
        pen += gap if number else 0.0
        if upright:
            runs = sorted(runs_of(part), key=lambda run: run.start)
            placed, advance = shape(text_of(part), runs, replace(spacing, vertical=True))
        else:
            turned = row(part, spacing)
            middle = _middle(part[0][1]) * spacing.upem
            placed = [replace(item, x=item.y - middle, y=-item.x, sideways=True) for item in turned.glyphs]
            advance = turned.advance
        glyphs += [replace(item, y=item.y - pen) for item in placed]
        pen += advance
    ends = [end for glyph in glyphs for end in _ends(glyph, spacing.upem, across=0)]
    return Line(glyphs, pen, min(ends, default=0.0), max(ends, default=0.0))


def _upright(pieces: Sequence[Piece]) -> list[bool]:
    """Choose the clusters of a column that stand upright: ideographs and their like, and acronyms such as "AI"."""
    stands = [
        not cluster.text.isspace()
        and (cluster.script in UPRIGHT or east_asian_width(cluster.text[0]) in "WF")
        and not (cluster.text.isascii() and cluster.text.isalnum())
        for cluster, _ in pieces
    ]
    found: list[bool] = []
    for (upright, space), group in groupby(
        zip(pieces, stands, strict=True), key=lambda item: (item[1], item[0][0].text.isspace())
    ):
        word = [cluster.text for (cluster, _), _ in group]
        short = len(word) <= ACRONYM and all(
            letter.isascii() and (letter.isupper() or letter.isdigit()) for letter in word
        )
        found += [upright or (short and not space)] * len(word)
    return found


def _middle(face: Typeface) -> float:
    """Height of the middle of a typeface's letters above their baseline, in ems."""
    extents = face.font.get_font_extents("ltr")
    return float(extents.ascender + extents.descender) / 2 / face.upem


def _ends(glyph: Glyph, upem: int, across: int) -> tuple[float, ...]:
    """Ends of a glyph's outline horizontally (``across`` 0) or vertically (1); nothing if it is blank."""
    extents = glyph.face.font.get_glyph_extents(glyph.id)
    if extents is None or not any(extents):
        return ()
    scale = upem / glyph.face.upem
    thicker = glyph.face.offset * upem
    ranges = (
        (extents.x_bearing, extents.x_bearing + extents.width),
        (extents.y_bearing + extents.height, extents.y_bearing),
    )
    low, high = ranges[1 - across if glyph.sideways else across]
    if glyph.sideways and across:
        low, high = -high, -low
    start = (glyph.x, glyph.y)[across]
    return start + low * scale - thicker, start + high * scale + thicker
