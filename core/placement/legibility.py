"""Legibility of text by the height of its letters; the source of every threshold of legibility."""

import numpy as np

from core.arrays import Float
from core.geometry.surface import MODEL_SIZE

# Text 5.5 wide, the paper's, is 20 pixels high in the metrics' pictures, which show a sphere about the asset, say of
# radius 18, on 1024 pixels. Over 978 views with one uncoloured mark each, of twelve assets and widths from 2 to 10,
# recognition reads 0.54 of a text 9 pixels high, 0.64 at 15, 0.75 at 19 and 0.80 from 24 on; 0.15 is what it reads
# where there is no text. Between 4 and 24 pixels that is about the square root. Over 551 views with one red mark each
# of nineteen assets it reads 0.39 at 4.5 pixels, 0.51 at 6.5, 0.92 at 8.5 and hardly more up to 14, 0.99 above.
PIXELS, TINY = 1024 / 36, 4.0  # pixels of a size-30 unit; pixels of height up to which nothing is read
PLAIN, COLORED = (24.0, 0.5), (9.0, 1.0)  # pixels of height from which on text is read, and the exponent up to there
LEGIBLE = 0.3945  # legibility below which text counts as legible from close up only
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
    return float((TINY + (readable - TINY) * LEGIBLE ** (1 / power)) / PIXELS)


def text_width(height: float, line_height: float) -> float:
    """The width, size-30 units, of text that is meant to read as a word does that is ``height`` times as high as is
    legible; the height of a line is ``line_height`` times the text's width."""
    taller = min(max(float(np.sqrt(line_height / USUAL_ASPECT)), 1.0), TALLEST)
    return min(height * legible_height() * taller / line_height, MODEL_SIZE)
