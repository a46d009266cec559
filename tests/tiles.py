"""Rows of pictures with a caption below each, as the manual shows them."""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tests.manual import ROOT

FONT = ROOT / "core" / "artwork" / "fonts" / "DejaVuSans-Bold.ttf"
TILE = 380  # pixels; side of a picture
SUPERSAMPLING = 3  # samples a pixel and axis
CAPTION = 30  # pixels; height of the strip with the value
GAP = 6  # pixels between pictures
QUALITY = 82  # of WebP
GROUND, INK = (235, 235, 235), (60, 60, 60)  # between pictures the page shows through


def row(tiles: list[tuple[str, Image.Image]], *, height: int = TILE, lossless: bool = False) -> bytes:
    """WebP of pictures side by side, TILE wide and of one ``height``, each with its caption.

    Args:
        tiles: captions and pictures.
        height: of each, in pixels.
        lossless: for diagrams of few colours, which are smaller so.
    """
    whole = Image.new("RGBA", (len(tiles) * (TILE + GAP) - GAP, height + CAPTION))
    pen, font = ImageDraw.Draw(whole), ImageFont.truetype(FONT, 15)
    for place, (caption, tile) in enumerate(tiles):
        left = place * (TILE + GAP)
        pen.rectangle((left, 0, left + TILE - 1, height + CAPTION), GROUND)
        whole.paste(tile, (left, 0))
        pen.text((left + TILE / 2, height + CAPTION / 2), caption, INK, font, anchor="mm")
    return webp(whole, lossless=lossless)


def tile(samples: NDArray[np.uint8]) -> Image.Image:
    """A picture of (TILE SUPERSAMPLING) squared samples."""
    return Image.fromarray(samples).reduce(SUPERSAMPLING)


def webp(picture: Image.Image, *, lossless: bool = False) -> bytes:
    """A picture as the manual's are stored."""
    stream = BytesIO()
    picture.save(stream, format="WEBP", quality=QUALITY, method=6, lossless=lossless)
    return stream.getvalue()
