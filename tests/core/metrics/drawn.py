"""Pictures with known words on them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import core.artwork

Picture = NDArray[np.uint8]

FONT = Path(core.artwork.__file__).parent / "fonts" / "DejaVuSans-Bold.ttf"
PAPER = (235, 235, 235)
SIZE = 512


def drawn(*words: str, height: int = 40, turn: float = 0.0, ink: tuple[int, int, int] = (40, 40, 40)) -> Picture:
    """(512, 512, 3) light grey with a line for each word, then turned counter-clockwise by ``turn`` degrees."""
    sheet = Image.new("RGB", (SIZE, SIZE), PAPER)
    pen = ImageDraw.Draw(sheet)
    font = ImageFont.truetype(FONT, height)
    for row, word in enumerate(words):
        middle = SIZE / 2 + (row - (len(words) - 1) / 2) * 3 * height
        pen.text((SIZE / 2, middle), word, fill=ink, font=font, anchor="mm")
    return np.asarray(sheet.rotate(turn, resample=Image.Resampling.BICUBIC, fillcolor=PAPER))
