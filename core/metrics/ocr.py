"""OCR Visibility (paper, supplement "OCR Visibility"; the recogniser and the shares are ours)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from core.arrays import Bool, Float
from core.metrics.recognition import Line, Reader, scaled
from core.rendering.pictures import Large

Picture = NDArray[np.uint8]

READABLE = 0.8  # ratio from which on the text is recognisable: one or two of nine letters wrong
MARGIN = 32  # pixels of background left around the asset
# Times the picture's own size at which it is searched. The detector misses letters 5 to 15 pixels high on ground whose
# own edges are stronger, which anybody reads: of 89 views of twelve assets in which coloured text was not read exactly,
# 40 are at 1.5 times the size; 38 of the rest are of a chain with letters 5 pixels high and of a sheet from behind. At
# twice the size they are hardly more, for 330 MB more of memory.
SIZES = (1.0, 1.5)
MOST_LINES = 32  # lines a view, at most: an asset covered with writing of its own must not take minutes
TURNS = (0, 2, 1, 3)  # quarter turns; upside down before upright
SQUARE = 3.0  # length over height of a detected line, up to which it may be one of few letters that stand upright in it
# Where letters are known to stand, these are looked at alone first, with some of what is around them. The detector
# judges all of a picture at once: in one of a few letters it finds fainter ones. So only a look is taken that makes it
# quite sure: of 321 views of 14 assets, 204 were read by a look, and all but two of them from the whole picture too.
LOOK = 384  # pixels a side
SURE = 0.67  # confidence of a line, at least
# Parts of one text: the cosine between them, at least; and in heights of a line, at most, how far parts of one line lie
# one above the other, how far they are apart, and how far one line is from the next: `line_spacing` goes up to 3 ems.
PARALLEL = np.cos(np.radians(20.0))
ROW, WORD_GAP, LINE_GAP = 0.5, 1.0, 2.5


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


@dataclass(frozen=True, eq=False)
class Look:
    """A part of a picture in which letters are known to stand.

    Attributes:
        picture: (:data:`LOOK`, :data:`LOOK`, 3) sRGB.
        right: (2,) the way in which they run there, to the right and down.
    """

    picture: Picture
    right: Float


@dataclass(frozen=True, eq=False)
class _Part:
    """A reading of a detected line."""

    text: str
    center: Float  # (2,) pixels, to the right and down
    right: Float  # (2,) unit vector, the direction of reading
    length: float  # pixels
    height: float  # pixels

    @property
    def down(self) -> Float:
        """(2,) unit vector towards the next line."""
        return np.array([-self.right[1], self.right[0]])


def ocr(pictures: Large, settings: Sequence[str], reader: Reader, looks: Mapping[int, Look] | None = None) -> Ocr:
    """Readability of a text in pictures of an asset.

    In each picture, and where that is not enough in the same one enlarged (:data:`SIZES`), lines of text are detected,
    and each is read upright and upside down, short ones in all four rotations. A reading scores
    ``difflib.SequenceMatcher(None, text, reading).ratio()``, without regard to case, and a picture the best of its
    readings, 0 where there is none. Once the text was read exactly, the picture is done. Equal pictures are read once.
    Only the :data:`MOST_LINES` most prominent lines of a picture are read.

    A text of several lines is compared with the readings of neighbouring parallel lines, joined in reading order, line
    breaks as spaces.

    Args:
        pictures: V of (H, W, 3) sRGB on a uniform background, which the upper left pixel shows. Each is asked for when
            it is searched, and not kept.
        settings: the text of the watermark in each of the ways in which it is broken into lines.
        reader: made once for many calls.
        looks: by view, what is looked at first. The view is done where the text is read exactly there; else its whole
            picture is searched.
    """
    per_view = np.zeros(len(pictures))
    known: dict[tuple[bytes, float], float] = {}

    def read(picture: Picture, confidence: float, right: Float | None) -> float:
        key = sha256(picture.tobytes()).digest(), confidence
        if key not in known:
            known[key] = _read(picture, settings, reader, confidence, right)
        return known[key]

    for view, look in (looks or {}).items():
        per_view[view] = read(look.picture, SURE, look.right) == 1
    for view in np.flatnonzero(per_view < 1).tolist():
        per_view[view] = read(_crop(pictures[view]), 0.0, None)
    return Ocr(float(per_view.mean()), float((per_view >= READABLE).mean()), float((per_view == 1).mean()), per_view)


def _read(
    picture: Picture, settings: Sequence[str], reader: Reader, confidence: float = 0.0, right: Float | None = None
) -> float:
    """The best ratio in a picture, of lines with this ``confidence`` at least; ``right`` (2,) is the way in which its
    text runs, where that is known."""
    best = 0.0
    for size in SIZES:
        found = [line for line in reader.detect(scaled(picture, size))[:MOST_LINES] if line.confidence >= confidence]
        lines = [(line, 0 if right is None else _upright(line, right)) for line in found]
        best = max(best, _best_reading(lines, settings, reader))
        if best == 1:
            break
    return best


def _upright(line: Line, right: Float) -> int:
    """The quarter turns after which a line reads from left to right, if its text runs to the ``right`` (2,)."""
    angle = np.radians(line.angle)
    return 0 if right @ (np.cos(angle), np.sin(angle)) >= 0 else 2


def _best_reading(lines: Sequence[tuple[Line, int]], settings: Sequence[str], reader: Reader) -> float:
    """The best ratio among the readings of ``lines``, each with the quarter turns after which it is read first."""
    single = [text for text in settings if "\n" not in text]
    several = [text for text in settings if "\n" in text]
    best, parts = 0.0, list[_Part]()
    for turn in TURNS:
        turned = [
            (line, (turn + first) % 4)
            for line, first in lines
            if turn % 2 == 0 or line.picture.shape[1] <= SQUARE * line.picture.shape[0]
        ]
        readings = reader.read([np.rot90(line.picture, way) for line, way in turned])
        for (line, way), reading in zip(turned, readings, strict=True):
            parts.append(_part(line, way, reading))
            best = max([best, *(_ratio(text, reading) for text in single)])
        if best == 1:
            return best
    return max([best, *(_best_passage(text, parts) for text in several)])


def _ratio(text: str, reading: str) -> float:
    return SequenceMatcher(None, text.casefold(), reading.casefold()).ratio()


def _best_passage(text: str, parts: list[_Part]) -> float:
    """The best ratio of a text to as many successive ``parts`` of a block as it has words, or fewer."""
    words, matcher, best = text.split(), SequenceMatcher(None), 0.0
    matcher.set_seq2(" ".join(words).casefold())
    for block in _blocks(parts):
        readings = [part.text.strip().casefold() for part in block]
        for first in range(len(block)):
            for last in range(first + 1, min(first + len(words), len(block)) + 1):
                matcher.set_seq1(" ".join(readings[first:last]))
                if matcher.real_quick_ratio() > best and matcher.quick_ratio() > best:
                    best = max(best, matcher.ratio())
    return best


def _blocks(parts: list[_Part]) -> Iterator[list[_Part]]:
    """Groups of neighbouring parallel parts, each in reading order."""
    parts = [part for part in parts if part.text.strip()]
    if not parts:
        return
    _, label = connected_components(_neighbours(parts), directed=False)
    for number in range(label.max() + 1):
        block = [part for part, mine in zip(parts, label, strict=True) if mine == number]
        down, right = block[0].down, block[0].right
        block.sort(key=lambda part: float(part.center @ down))
        rows: list[list[_Part]] = []
        for part in block:
            if rows and (part.center - rows[-1][0].center) @ down < ROW * min(part.height, rows[-1][0].height):
                rows[-1].append(part)
            else:
                rows.append([part])
        yield [part for row in rows for part in sorted(row, key=lambda part: float(part.center @ right))]


def _neighbours(parts: list[_Part]) -> Bool:
    """(N, N) which of the parts run alike and stand side by side or one below the other."""
    center, right, down = (np.array([getattr(part, name) for part in parts]) for name in ("center", "right", "down"))
    length, height = np.array([part.length for part in parts]), np.array([part.height for part in parts])
    offset = center[:, None] - center
    gap, step = (np.abs(np.einsum("nmi,ni->nm", offset, axis)) for axis in (right, down))
    gap -= (length[:, None] + length) / 2
    step -= (height[:, None] + height) / 2
    lower = np.minimum(height[:, None], height)
    near: Bool = (right @ right.T > PARALLEL) & (gap < WORD_GAP * lower) & (step < LINE_GAP * lower)
    return near


def _part(line: Line, turn: int, reading: str) -> _Part:
    angle = np.radians(line.angle + 90 * turn)
    height, length = line.picture.shape[:2] if turn % 2 == 0 else line.picture.shape[1::-1]
    return _Part(reading, np.array(line.center), np.array([np.cos(angle), np.sin(angle)]), length, height)


def _crop(picture: Picture) -> Picture:
    """The picture cropped to the asset: background need not be searched."""
    shown = picture != picture[0, 0]
    rows = np.flatnonzero(shown.reshape(len(shown), -1).any(axis=1))
    columns = np.flatnonzero(shown.any(axis=0).any(axis=1))
    if not len(rows):
        return picture[:1, :1]
    return picture[
        max(rows[0] - MARGIN, 0) : rows[-1] + 1 + MARGIN, max(columns[0] - MARGIN, 0) : columns[-1] + 1 + MARGIN
    ]
