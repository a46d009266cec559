"""Room for several texts in the same places: which of them needs most, and which of its layouts suit all."""

import re
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.artwork.line_breaks import line_breaks, width_in_ems
from core.choices import Wrap

# Height of the lines of a text over that of the text that a place was chosen for: the least that is set, and the least
# by the estimated widths of letters, which are near enough to choose layouts by.
LEAST, EASY = 0.6, 0.8
MANY = 64  # texts whose lines are broken to see what room they need


def roomiest(texts: Sequence[str], wrap: Wrap) -> str:
    """The one of the ``texts`` in whose place, where it is set as it is, most of them can be set about as high; of
    equally good ones the one that covers most, and of these the first."""
    texts = _telling(texts)
    blocks = [_blocks(text, wrap) for text in texts]
    most = max(map(len, blocks))
    width, lines = np.array([each + each[:1] * (most - len(each)) for each in blocks], dtype=np.float64).T
    place = width[0], lines[0]
    room = np.minimum(place[0][:, None, None] / width, place[1][:, None, None] / lines).max(axis=1)
    fitting = (room >= EASY).sum(axis=1)
    return texts[max(range(len(texts)), key=lambda number: (fitting[number], place[0][number] * place[1][number]))]


def suiting(layouts: Layouts, texts: Sequence[str], wrap: Wrap) -> Layouts:
    """Those of the ``layouts`` of one text in whose places all ``texts`` can be set about as high; at least the
    first."""
    blocks = [_blocks(text, wrap) for text in _telling(texts)]

    def suits(artwork: Artwork) -> bool:
        width, lines = _block(artwork.lines)
        return all(max(min(width / w, lines / n) for w, n in each) >= EASY for each in blocks)

    first, *others = layouts.artworks
    return Layouts((first, *filter(suits, others)))


def set_in(layouts: Layouts, sizes: Float, line_heights: Float) -> tuple[Float, Layouts]:
    """The sizes (B, 2) of a text in places for another one, each in the layout whose lines are highest there, and the
    layouts that are used.

    Lines are no higher than those of the text that the places were chosen for, with which their surroundings agree.

    Args:
        layouts: of the text.
        sizes: (B, 2) width and height of the places.
        line_heights: (B,) of the other text in them, in the same unit.

    Returns:
        None of the layouts, and sizes of 0, where one of the places has no room for a QR code that can be read.
    """
    aspect, line, least = (
        np.array([getattr(artwork, name) for artwork in layouts.artworks])
        for name in ("aspect", "line_height", "least_width")
    )
    width = np.minimum(np.minimum(sizes[:, :1], sizes[:, 1:2] / aspect), line_heights[:, None] / line)
    width[width < least - 1e-6] = 0.0
    # Of layouts with equally high lines, the one that is nearest in its width leaves least of the place empty.
    best = np.lexsort((width, np.round(width * line, 9)), axis=1)[:, -1]
    chosen = width[np.arange(len(sizes)), best]
    used = tuple(layouts.artworks[number] for number in np.unique(best[chosen > 0]))
    return np.stack([chosen, chosen * aspect[best]], axis=1), Layouts(used)


def _telling(texts: Sequence[str]) -> list[str]:
    """Those of the ``texts`` that tell what room all need, in their order: of many, the widest and those of the widest
    words. To break lines takes milliseconds a text."""
    if len(texts) <= MANY:
        return list(texts)
    widest, worded = (
        sorted(range(len(texts)), key=lambda number: -max(map(width_in_ems, re.split(parts, texts[number]))))
        for parts in (r"\n", r"[\s-]")
    )
    return [texts[number] for number in sorted({*widest[: MANY // 2], *worded[: MANY // 2]})]


@lru_cache(2 * MANY)
def _blocks(text: str, wrap: Wrap) -> list[tuple[float, int]]:
    """Width in ems and number of lines of a text in each way of setting it, the one that was asked for first."""
    return [_block(lines) for lines in (line_breaks(text) if wrap is Wrap.AUTO else [tuple(text.splitlines())])]


def _block(lines: Sequence[str]) -> tuple[float, int]:
    return max(map(width_in_ems, lines)), len(lines)
