"""Legibility of text by the height of its letters; the source of every threshold of legibility."""

import numpy as np

from core.arrays import Float
from core.geometry.surface import MODEL_SIZE
from core.notices import Notice, NoticeCode

# Text 5.5 wide, the paper's, is 20 pixels high in the metrics' pictures, which show a sphere about the asset, say of
# radius 18, on 1024 pixels. Over 978 views with one uncoloured mark each, of twelve assets and widths from 2 to 10,
# recognition reads 0.54 of a text 9 pixels high, 0.64 at 15, 0.75 at 19 and 0.80 from 24 on; 0.15 is what it reads
# where there is no text. Between 4 and 24 pixels that is about the square root, of single marks. Larger
# text bends over more ground, though: where legibility rises up to 16 in place of 24 pixels, 15 assets are read with
# 0.79 in place of 0.76. Over 551 views with one red mark each of nineteen assets it reads 0.39 at 4.5 pixels, 0.51 at
# 6.5, 0.92 at 8.5 and hardly more up to 14, 0.99 above.
PIXELS, TINY = 1024 / 36, 4.0  # pixels of a size-30 unit; pixels of height up to which nothing is read
PLAIN, COLORED = (16.0, 0.5), (9.0, 1.0)  # pixels of height from which on text is read, and the exponent up to there
CLOSE_UP = (0.5093, 0.3945)  # of either, legibility below which text counts as legible from close up only
# Pixels of height, times the contrast of uncoloured letters with textured ground, below which a text is hard to read:
# over 209 marks of 16 textured assets recognition reads 0.1 up to 7 of them, 0.4 to 0.5 from there to 10, 0.6 up to 12,
# 0.85 up to 15, 0.99 above. Contrast below which the ground is to blame: marks at least 10 pixels high are read with
# 0.1 below 0.5, 0.4 up to 0.6, 0.6 up to 0.7, 0.9 from 0.8 on. Share of such marks from which on it is said.
HARD, GROUND, MANY = 10.0, 0.7, 1 / 3
# Height over width of a word like "watermark", to which heights refer; and the greatest ratio to it by which shorter
# text, which covers the same area, is higher.
USUAL_ASPECT, TALLEST = 0.125, 2.0


def legibility(height: Float, colored: bool = False) -> Float:
    """Legibility of text of a ``height`` (any shape, size-30 units) in the metrics' pictures: 0 to 1. Letters
    ``colored`` by themselves need less height than those of the surface's colour."""
    readable, power = COLORED if colored else PLAIN
    return np.asarray(np.clip((height * PIXELS - TINY) / (readable - TINY), 0.0, 1.0) ** power)


def legible_height(colored: bool = False) -> float:
    """The height from which on text is legible from further away than close up, size-30 units."""
    readable, power = COLORED if colored else PLAIN
    return float((TINY + (readable - TINY) * CLOSE_UP[colored] ** (1 / power)) / PIXELS)


def text_width(height: float, line_height: float) -> float:
    """The width, size-30 units, of text that is meant to read as a word does that is ``height`` times as high as is
    legible; the height of a line is ``line_height`` times the text's width."""
    taller = min(max(float(np.sqrt(line_height / USUAL_ASPECT)), 1.0), TALLEST)
    return min(height * legible_height() * taller / line_height, MODEL_SIZE)


def hard_to_read(height: Float, contrast: Float) -> list[Notice]:
    """The notice that the ground of many marks hides letters that have no colour of their own.

    Args:
        height: (B,) of a line of text of each mark, size-30 units.
        contrast: (B,) of these letters with their ground, see :func:`core.placement.objective.contrast`.
    """
    hidden = int(((height * contrast * PIXELS < HARD) & (contrast < GROUND)).sum())
    if not hidden or hidden < MANY * len(height):
        return []
    return [
        Notice(
            NoticeCode.HARD_TO_READ,
            f"{hidden} of {len(height)} marks are hard to read: their letters have the surface's own colour, and the "
            "ground there is too dark or too varied to tell them from it. Nothing plainer that shows as much has room.",
            'Ask for `color` "auto": each mark then has a colour that stands out from its ground.',
        )
    ]


def too_low(highest: float, is_text: bool, capped: bool) -> Notice:
    """The notice that no mark reads well: its lines, or a logo's details, are so high at most (size-30 units).

    Args:
        highest: of the marks.
        is_text: not a logo alone.
        capped: the ``size`` that was asked for allows no more.
    """
    use = "use a shorter text" if is_text else "use a simpler logo"
    return Notice(
        NoticeCode.SMALL_TEXT,
        f"No {'text' if is_text else 'logo'} on this asset reads well: "
        f"{'the highest is' if is_text else 'its details are'} {highest:.2g} high where the asset's largest side is "
        f"{MODEL_SIZE:g}, and legible only from close up." + ("" if capped else " Nothing higher has room."),
        f"Ask for a larger `size`, or {use}." if capped else f"{use.capitalize()}.",
    )
