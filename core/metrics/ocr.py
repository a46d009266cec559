"""OCR Visibility (paper, supplement "OCR Visibility"; the recogniser and the shares are ours)."""

from dataclasses import dataclass
from difflib import SequenceMatcher

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.metrics.recognition import Reader

Picture = NDArray[np.uint8]

READABLE = 0.8  # ratio from which on the text is recognisable: one or two of nine letters wrong
MARGIN = 32  # pixels of background left around the asset
MOST_LINES = 32  # lines a view, at most: an asset covered with writing of its own must not take minutes
TURNS = (0, 2, 1, 3)  # quarter turns; upside down before upright


@dataclass(frozen=True, eq=False)
class Ocr:
    """Readability of a text; higher is better throughout.

    Attributes:
        ratio: mean of ``per_view``.
        ge_08: share of views with a ratio of at least 0.8.
        exact: share of views in which the text is read without a mistake.
        per_view: (V,) the best ratio in each view, 0 to 1.
    """

    ratio: float
    ge_08: float
    exact: float
    per_view: Float


def ocr(pictures: Picture, text: str, reader: Reader) -> Ocr:
    """Readability of ``text`` in pictures of an asset.

    In each picture lines of text are detected, and each is read in four rotations (0, 180, 90 and 270 degrees). A
    reading scores ``difflib.SequenceMatcher(None, text, reading).ratio()``, without regard to case, and a picture
    the best of its readings, 0 where there is none. Once the text was read exactly, the picture is done. Equal
    pictures are read once. Only the :data:`MOST_LINES` most prominent lines of a picture are read.

    Args:
        pictures: (V, H, W, 3) sRGB on a uniform background, which the upper left pixel shows.
        text: of the watermark.
        reader: made once for many calls.
    """
    distinct: dict[bytes, int] = {}
    row = [distinct.setdefault(picture.tobytes(), len(distinct)) for picture in pictures]
    crops = [
        (view, line)
        for view, picture in enumerate(pictures[np.unique(row, return_index=True)[1]])
        for line in reader.detect(_crop(picture))[:MOST_LINES]
    ]
    best = np.zeros(len(distinct))
    for turn in TURNS:
        open_crops = [(view, line) for view, line in crops if best[view] < 1]
        readings = reader.read([np.rot90(line, turn) for _, line in open_crops])
        for (view, _), reading in zip(open_crops, readings, strict=True):
            best[view] = max(best[view], _ratio(text, reading))
    per_view = best[row]
    return Ocr(float(per_view.mean()), float((per_view >= READABLE).mean()), float((per_view == 1).mean()), per_view)


def _ratio(text: str, reading: str) -> float:
    return SequenceMatcher(None, text.casefold(), reading.casefold()).ratio()


def _crop(picture: Picture) -> Picture:
    """The picture cropped to the asset: background need not be searched."""
    shown = (picture != picture[0, 0]).any(axis=2)
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return picture[:1, :1]
    return picture[
        max(rows[0] - MARGIN, 0) : rows[-1] + 1 + MARGIN, max(columns[0] - MARGIN, 0) : columns[-1] + 1 + MARGIN
    ]
