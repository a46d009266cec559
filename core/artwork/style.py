"""Styles of a text: how its letters and lines stand to each other."""

from dataclasses import dataclass

from core.choices import Align, Direction
from core.parameters import Parameters


@dataclass(frozen=True)
class TextStyle:
    """Setting of a text.

    Attributes:
        align: of lines that are shorter than the longest; in vertical setting, left is the top and right the bottom.
        line_spacing: distance from one line to the next, in ems; more where letters would come too close.
        letter_spacing: added between letters, in ems; not within scripts whose letters are joined.
        direction: of the lines, not ``auto``.
        language: BCP 47 tag, which decides the shapes of ideographs; None: guessed from the text.
        first_line: size of the first of several lines over that of the others.
    """

    align: Align = Align.CENTER
    line_spacing: float = 1.2
    letter_spacing: float = 0.0
    direction: Direction = Direction.HORIZONTAL
    language: str | None = None
    first_line: float = 1.0


PLAIN = TextStyle()


def style_of(parameters: Parameters, direction: Direction) -> TextStyle:
    """The setting that a request asks for, in one ``direction``."""
    wanted = parameters
    return TextStyle(
        wanted.align, wanted.line_spacing, wanted.letter_spacing, direction, wanted.language, wanted.first_line
    )
