"""Writing in looks at an asset, with its places on the surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.arrays import Float
from core.geometry.directions import EYE_DISTANCE
from core.metrics.recognition import Line, Reader
from core.verify.look import Look, Picture

Kind = Literal["ordinary", "relief"]

MARGIN = 32  # pixels of background left around the asset
MOST_LINES = 24  # lines a picture, at most: an asset covered with writing of its own must not take minutes
TURNS = (0, 2)  # quarter turns that a line is read in: as it is, and upside down
GRID = np.stack(np.meshgrid((-0.8, -0.4, 0.0, 0.4, 0.8), (-0.6, 0.0, 0.6)), axis=-1).reshape(-1, 2)
LEAST = 4  # of these places on a line have to lie on the surface


@dataclass(frozen=True, eq=False)
class Reading:
    """A line of writing that was read.

    Attributes:
        text: as it was read.
        confidence: the recogniser's, mean over its letters, 0 to 1.
        kind: of the picture.
        look: number of the look.
        row: of the line's middle in the picture, pixels downwards.
        center: (3,) on the surface, size-30 units.
        right: (3,) unit vector of the direction of reading.
        normal: (3,) unit vector towards the reader.
        length: size-30 units.
        height: size-30 units.
    """

    text: str
    confidence: float
    kind: Kind
    look: int
    row: float
    center: Float
    right: Float
    normal: Float
    length: float
    height: float


def readings(looks: Sequence[Look], reader: Reader, first: int = 0) -> list[Reading]:
    """All writing in ordinary and relief pictures; the looks are numbered from ``first`` on."""
    found: list[Reading] = []
    for number, one in enumerate(looks, first):
        for kind, picture in (("ordinary", one.ordinary), ("relief", one.relief)):
            part, corner = _cropped(picture, one)
            lines = reader.detect(part)[:MOST_LINES]
            for turn in TURNS:
                read = reader.read_with_confidence([np.rot90(line.picture, turn) for line in lines])
                for line, (text, confidence) in zip(lines, read, strict=True):
                    placed = _placed(line, turn, corner, one) if text.strip() else None
                    if placed is not None:
                        found.append(Reading(text.strip(), confidence, kind, number, *placed))  # type: ignore[arg-type]
    return found


def _cropped(picture: Picture, one: Look) -> tuple[Picture, Float]:
    """The part of a picture that shows the asset, and its upper left corner, pixels."""
    shown = one.depth > 0
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return picture[:1, :1], np.zeros(2)
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    part = picture[top : rows[-1] + 1 + MARGIN, left : columns[-1] + 1 + MARGIN]
    return part, np.array([left, top], dtype=np.float64)


def _placed(line: Line, turn: int, corner: Float, one: Look) -> tuple[float, Float, Float, Float, float, float] | None:
    """Row, centre, direction, normal, length and height of a line on the surface; None where it lies on nothing."""
    angle = np.radians(line.angle + 90 * turn)
    right = np.array([np.cos(angle), np.sin(angle)])
    down = np.array([-right[1], right[0]])
    height, length = line.picture.shape[:2]
    middle = np.array(line.center) + corner
    half = np.array([length, height]) / 2
    points = one.points(middle + GRID * half @ np.stack([right, down]))
    known = np.isfinite(points).all(axis=1)
    if known.sum() < LEAST:
        return None
    solid = points[known]
    center = np.median(solid, axis=0)
    # A plane through the places: the shortest axis of their spread is its normal.
    _, spread, axes = np.linalg.svd(solid - solid.mean(axis=0), full_matrices=False)
    back = one.axes[2]
    normal = axes[2] * np.sign(axes[2] @ back or 1.0) if spread[1] > 0 else back
    if normal @ back < 0.2:  # a rim, or a jump of the depth: what is known is where the reader stands
        normal = back
    flat = right[0] * one.axes[0] - right[1] * one.axes[1]
    along = flat - flat @ normal * normal
    along /= np.linalg.norm(along)
    pixel = 2 * one.slope * float(np.median(_distance(solid, one))) / len(one.depth)
    return float(middle[1]), center, along, normal, length * pixel / max(float(flat @ along), 0.2), height * pixel


def _distance(points: Float, one: Look) -> Float:
    return np.asarray(EYE_DISTANCE - (points - one.center) @ one.axes[2])
