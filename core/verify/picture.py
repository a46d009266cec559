"""Marks in a picture of a suspect file, such as a screenshot."""

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image

from core.arrays import Float
from core.metrics.recognition import Reader, scaled
from core.verify.header import FORMATS, declared_size, malformed_picture
from core.verify.look import Picture
from core.verify.readings import TURNS
from core.verify.texts import best, enough

# Pixels of the longer side to which larger pictures are reduced, and to which smaller ones are enlarged: first as they
# are, then with their light evened out.
MOST, LEAST, LEAST_EVEN = 2048, 1024, 1536
GRAIN, AROUND = 1.5, 12.0  # pixels
GREY, CONTRAST = 128, 4  # 8-bit grey levels: of an even surface, and for each that a pixel is lighter
MOST_LINES = 64
SURE, SHORTEST = 0.6, 3  # confidence and letters, at least, of what is told without a known text


@dataclass(frozen=True, eq=False)
class FoundText:
    """Writing in a picture.

    Attributes:
        text: as it was read.
        known: the known text that it is; None where it is none.
        likeness: to that, 0 to 1.
        confidence: of the recogniser, 0 to 1.
        pixel: (2,) its middle, pixels to the right and down.
        picture: (H, W, 3) the line.
    """

    text: str
    known: str | None
    likeness: float
    confidence: float
    pixel: Float
    picture: Picture


def decode(data: bytes) -> Picture:
    """(H, W, 3) sRGB pixels of a picture, on white where it is clear.

    Raises:
        MeshmarkError: ``budget_exceeded`` above 50 megapixels, by its header; ``malformed_file``.
    """
    size = declared_size(data)
    try:
        with (
            warnings.catch_warnings(),
            Image.open(io.BytesIO(data), formats=list(map(str.upper, FORMATS.values()))) as image,
        ):
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            if image.size != size:
                raise malformed_picture("its headers contradict each other")
            clear = Image.new("RGBA", image.size, "white")
            clear.alpha_composite(image.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
        raise malformed_picture(f"{type(error).__name__}") from None
    return np.asarray(clear.convert("RGB"))


def read_picture(picture: Picture, texts: Sequence[str], reader: Reader) -> list[FoundText]:
    """Writing in a picture, the surest first: known ``texts``, or without any, all that is read with confidence.

    Where there is none, the picture is looked at again without its large differences of light: letters in the colour of
    the surface are a few grey levels lighter and darker than it, and more is then read of small ones.
    """
    scale = _scale(picture, LEAST)
    found = _read(scaled(picture, scale), scale, texts, reader)
    if found:
        return found
    scale = _scale(picture, LEAST_EVEN)
    return _read(_evened(scaled(picture, scale)), scale, texts, reader)


def _scale(picture: Picture, least: int) -> float:
    """The factor by which a picture is enlarged, or reduced, to be between ``least`` and MOST pixels long."""
    longest: int = max(picture.shape[:2])
    return min(MOST / longest, max(least / longest, 1.0))


def _evened(picture: Picture) -> Picture:
    """The lightness of a picture over that of its surroundings (a difference of Gaussians), on an even grey."""
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine, around = (np.asarray(cv2.GaussianBlur(grey, (0, 0), width)) for width in (GRAIN, AROUND))
    level = np.clip(GREY + CONTRAST * (fine - around), 0, 255).astype(np.uint8)
    return np.repeat(level[..., None], 3, axis=2)


def _read(picture: Picture, scale: float, texts: Sequence[str], reader: Reader) -> list[FoundText]:
    """Writing in a picture that was scaled."""
    found = []
    lines = reader.detect(picture)[:MOST_LINES]
    for turn in TURNS:
        turned = [np.rot90(line.picture, turn) for line in lines]
        for line, part, (text, confidence) in zip(lines, turned, reader.read_with_confidence(turned), strict=True):
            likeness, known = best(texts, text)
            told = known is not None and likeness >= enough(known) if texts else len(text) >= SHORTEST
            if told and (confidence >= SURE or likeness == 1):
                pixel = np.array(line.center) / scale
                found.append(FoundText(text, known, likeness, confidence, pixel, np.ascontiguousarray(part)))
    return sorted(found, key=lambda one: (-one.likeness, -one.confidence))
