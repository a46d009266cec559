"""Likeness of readings to a known text."""

from collections.abc import Sequence
from difflib import SequenceMatcher

from core.artwork.line_breaks import line_breaks

# A reading is the text from this ratio on; short texts are found by chance more easily, and have to be read better.
ALIKE, SHORT = 0.75, 5


def likeness(text: str, reading: str) -> float:
    """Ratio of two texts without regard to case and spaces, 0 to 1."""
    one, other = ("".join(words.casefold().split()) for words in (text, reading))
    return SequenceMatcher(None, one, other, autojunk=False).ratio() if one and other else 0.0


def enough(text: str) -> float:
    """Likeness from which on a reading counts as ``text``: one letter in four may be wrong, of five letters or fewer
    none."""
    return 1.0 if len("".join(text.split())) <= SHORT else ALIKE


def best(texts: Sequence[str], reading: str) -> tuple[float, str | None]:
    """The likeness of a reading to the most like of some ``texts``, and that text; 0 and None without one."""
    return max(((likeness(text, reading), text) for text in texts), default=(0.0, None), key=lambda found: found[0])


def fewest_letters(texts: Sequence[str]) -> int:
    """Letters of the shortest line in all layouts of some ``texts``, without spaces; 0 without one."""
    lines = (line for text in texts for layout in line_breaks(text) for line in layout)
    return min((len("".join(line.split())) for line in lines), default=0)
