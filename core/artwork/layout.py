"""Lines of text set as one block of glyphs."""

import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

from core.artwork.itemization import Cluster, FontChain, clusters_of, language_of
from core.artwork.line import Line, column, enlarged, row
from core.artwork.shaping import Glyph, Spacing
from core.artwork.style import PLAIN, TextStyle
from core.artwork.typeface import Typeface
from core.choices import Align, Direction
from core.errors import ErrorCode, MeshmarkError
from core.labels.wording import MAX_LINES

_JOINERS = "\u200c\u200d"  # zero-width (non-)joiners steer the shaping of Arabic and Indic scripts
_REFUSED_CATEGORIES = {"Cc": "control", "Cf": "formatting", "Cs": "surrogate", "Zl": "line break", "Zp": "line break"}
# The share of the room left in a line that stands before it.
SHARE_BEFORE = {Align.LEFT: 0.0, Align.CENTER: 0.5, Align.RIGHT: 1.0}


@dataclass(frozen=True)
class LayoutOptions:
    """Tuned values of the layout.

    Attributes:
        least_gap: between the letters of two lines, in ems: closer ones run together in a coarse surface. Ours; the
            paper sets one line.
    """

    least_gap: float = 0.12


OPTIONS = LayoutOptions()


@dataclass(frozen=True, eq=False)
class Block:
    """A text that is set.

    Attributes:
        glyphs: of all lines.
        upem: units an em of their places.
        lines: of the text.
        line_height: of the letters of the highest line, across its direction, in the same units; a first line that is
            larger than the others does not count.
    """

    glyphs: list[Glyph]
    upem: int
    lines: tuple[str, ...]
    line_height: float

    @property
    def faces(self) -> list[Typeface]:
        """Its typefaces in the order of their first glyphs."""
        return list(dict.fromkeys(glyph.face for glyph in self.glyphs))


def set_text(text: str, style: TextStyle = PLAIN, own: Typeface | None = None) -> Block:
    """Set a text in lines.

    Every line is a paragraph of its own: its base direction is that of its first strong character. Lines of a vertical
    setting are columns, from right to left.

    Args:
        text: up to six lines, parted by line feeds.
        style: how to set it.
        own: the typeface that came with the request; characters that it lacks are set in the installed ones.

    Raises:
        MeshmarkError: ``empty_text`` (nothing visible), ``invalid_parameters`` (control or formatting characters, too
            many lines), ``missing_glyphs`` (naming each character that no typeface has), ``invalid_font`` (it
            multiplies glyphs).
    """
    lines = _lines_of(text)
    chain = FontChain(language_of(text, style.language), own)
    pieces = chain.choose(_clusters(lines))
    upem = next(face.upem for line in pieces for _, face in line)
    spacing = Spacing(upem, style.letter_spacing, style.language or "und", chain.language)
    setting = column if style.direction is Direction.VERTICAL else row
    first, *others = (setting(line, spacing) for line in pieces)
    return _stacked([enlarged(first, style.first_line) if others else first, *others], lines, upem, style)


def serving_fonts(text: str, language: str | None) -> list[str]:
    """The names and versions of the installed fonts that letters of a text come from, whatever else is in it."""
    pieces, _ = FontChain(language_of(text, language)).match(_clusters(text.splitlines()))
    return list(dict.fromkeys(f"{face.name} {face.version}" for line in pieces for _, face in line))


def _clusters(lines: Iterable[str]) -> list[list[Cluster]]:
    return [clusters_of(unicodedata.normalize("NFC", line)) for line in lines]


def _lines_of(text: str) -> tuple[str, ...]:
    """The lines of a text without the spaces at their ends; blank ones stay between others."""
    if not text.strip():
        raise MeshmarkError(
            ErrorCode.EMPTY_TEXT, "The watermark text is empty or only spaces.", "Send at least one visible character."
        )
    plain = text.replace("\r\n", "\n")
    for position, character in enumerate(plain):
        kind = _REFUSED_CATEGORIES.get(unicodedata.category(character))
        if kind and character not in _JOINERS and character != "\n":
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The watermark text has a {kind} character U+{ord(character):04X} at position {position + 1}.",
                "Send visible characters only, and line feeds between lines.",
            )
    lines = tuple(line.strip() for line in plain.strip("\n").split("\n"))
    if len(lines) > MAX_LINES:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The watermark text has {len(lines)} lines; at most {MAX_LINES} can be set.",
            "Send fewer lines.",
        )
    return lines


def _stacked(settings: list[Line], lines: tuple[str, ...], upem: int, style: TextStyle) -> Block:
    """Lines one below the other or, columns, one left of the other; as far apart as the closest two need."""
    vertical = style.direction is Direction.VERTICAL
    sides = pairwise((line.below, line.above) for line in settings)
    # Rows go down and columns to the left: the near sides are the foot of one line and the head of the next.
    needed = max((after[1] - before[0] for before, after in sides), default=0.0)
    step = max(style.line_spacing * upem, needed + OPTIONS.least_gap * upem)
    longest = max(line.advance for line in settings)
    glyphs: list[Glyph] = []
    for number, line in enumerate(settings):
        start = SHARE_BEFORE[style.align] * (longest - line.advance)
        x, y = (-number * step, -start) if vertical else (start, -number * step)
        glyphs += [replace(glyph, x=glyph.x + x, y=glyph.y + y) for glyph in line.glyphs]
    plain = settings if style.first_line == 1 else settings[1:] or settings
    return Block(glyphs, upem, lines, max(line.above - line.below for line in plain))
