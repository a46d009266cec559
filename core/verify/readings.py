"""Writing in looks at an asset, with its places on the surface."""

from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from core.arrays import Float
from core.geometry.directions import EYE_DISTANCE
from core.geometry.triangles import unit
from core.metrics.recognition import Line, Reader, available_threads
from core.verify.look import Look, Part
from core.verify.report import Kind

MARGIN = 32  # pixels of background left around the asset
MOST_LINES = 24  # lines a picture, at most: an asset covered with writing of its own must not take minutes
TURNS = (0, 2)  # quarter turns that a line is read in: as it is, and upside down
# Pixels below which no line was read in 16 files, marked and not; width over height for each letter of the shortest
# text that is looked for, below which 2 of 720 lines were read. Both together leave out more than half of all lines.
LOWEST, NARROWEST = 8, 0.2
UPRIGHT, UPRIGHT_LETTERS = 0.95, 5  # confidence and letters from which on no line of four assets was one turned over
GRID = np.stack(np.meshgrid((-0.8, -0.4, 0.0, 0.4, 0.8), (-0.6, 0.0, 0.6)), axis=-1).reshape(-1, 2)
LEAST = 4  # of these places on a line have to lie on the surface
STEEPEST = 0.2  # cosine of the ground with the camera, at least


@dataclass(frozen=True, eq=False)
class Spot:
    """Surface under a line of writing.

    Attributes:
        row: of the line's middle in the picture, pixels downwards.
        center: (3,) on the surface, size-30 units.
        right: (3,) unit vector of the direction of reading.
        normal: (3,) unit vector towards the reader.
        length, height: of the line, size-30 units.
    """

    row: float
    center: Float
    right: Float
    normal: Float
    length: float
    height: float

    @property
    def up(self) -> Float:
        """(3,) unit vector from the foot of the letters to their head."""
        return np.asarray(np.cross(self.normal, self.right))


@dataclass(frozen=True, eq=False)
class Reading:
    """A line of writing that was read.

    Attributes:
        text: as it was read.
        confidence: the recogniser's, mean over its letters, 0 to 1.
        kind: of the picture.
        look: number of the look.
        spot: where it is.
    """

    text: str
    confidence: float
    kind: Kind
    look: int
    spot: Spot


def readings(
    looks: Iterable[Look], kinds: Sequence[Kind], reader: Reader, letters: int, first: int = 0
) -> list[Reading]:
    """All writing of so many ``letters`` or more in these kinds of pictures; the looks are numbered from ``first`` on.

    Every processor reads a picture of its own, while the caller's thread draws the next look: with a ``reader`` of one
    thread that takes three quarters of the time that all of them take for one picture after the other.
    """
    found: list[Reading] = []
    waiting: deque[Future[list[Reading]]] = deque()
    processors = available_threads()
    with ThreadPoolExecutor(processors) as threads:
        for number, one in enumerate(looks, first):
            waiting.extend(threads.submit(_read, one, kind, number, reader, letters) for kind in kinds)
            while len(waiting) > 2 * processors:  # a look has 10 MB
                found += waiting.popleft().result()
        for future in waiting:
            found += future.result()
    return found


def _read(one: Look, kind: Kind, number: int, reader: Reader, letters: int) -> list[Reading]:
    """All writing in one of the pictures of a look."""
    found: list[Reading] = []
    part, corner = _outline(one)
    detected = reader.detect(one.picture(kind, part))
    lines = [line for line in detected if _is_readable(line, letters)][:MOST_LINES]
    for turn in TURNS:
        read = reader.read_with_confidence([np.rot90(line.picture, turn) for line in lines])
        for line, (text, confidence) in zip(lines, read, strict=True):
            spot = _spot(line, turn, corner, one) if text.strip() else None
            if spot is not None:
                found.append(Reading(text.strip(), confidence, kind, number, spot))
        lines = [line for line, said in zip(lines, read, strict=True) if not _is_upright(*said)]
    return found


def _is_readable(line: Line, letters: int) -> bool:
    """True for a line that is large and long enough for so many letters."""
    height, width = line.picture.shape[:2]
    return bool(height >= LOWEST and width >= NARROWEST * letters * height)


def _is_upright(text: str, confidence: float) -> bool:
    """True for a line that was read so surely that it need not be turned over."""
    return confidence >= UPRIGHT and len(text.strip()) >= UPRIGHT_LETTERS


def _outline(one: Look) -> tuple[Part, Float]:
    """The part of a picture that shows the asset, and its upper left corner, pixels."""
    shown = one.depth > 0
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return (slice(1), slice(1)), np.zeros(2)
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    part = slice(top, rows[-1] + 1 + MARGIN), slice(left, columns[-1] + 1 + MARGIN)
    return part, np.array([left, top], dtype=np.float64)


def _spot(line: Line, turn: int, corner: Float, one: Look) -> Spot | None:
    """The surface under a line, read after so many quarter turns, of a part of a picture whose upper left ``corner``
    (2,) is in pixels; None where there is too little."""
    angle = np.radians(line.angle + 90 * turn)
    right = np.array([np.cos(angle), np.sin(angle)])
    down = np.array([-right[1], right[0]])
    height, length = line.picture.shape[:2]
    middle = np.array(line.center) + corner
    half = np.array([length, height]) / 2
    points = one.points(middle + GRID * half @ np.stack([right, down]))
    solid = points[np.isfinite(points).all(axis=1)]
    if len(solid) < LEAST:
        return None
    center, back = np.median(solid, axis=0), one.axes[2]
    # A plane through the places: the shortest axis of their spread is its normal.
    axes = np.linalg.svd(solid - solid.mean(axis=0), full_matrices=False)[2]
    normal = axes[2] if axes[2] @ back > 0 else -axes[2]
    if normal @ back < STEEPEST:  # a rim, or a jump of the depth: all that is known is where the reader stands
        normal = back
    flat = right[0] * one.axes[0] - right[1] * one.axes[1]
    along = unit((flat - flat @ normal * normal)[None])[0]
    pixel = 2 * one.slope * float(EYE_DISTANCE - (center - one.center) @ back) / len(one.depth)
    return Spot(
        row=float(middle[1]),
        center=center,
        right=along,
        normal=normal,
        length=length * pixel / max(float(flat @ along), STEEPEST),
        height=height * pixel,
    )
