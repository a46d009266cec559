"""From where the rays of the visibility metrics start (paper, supplement "Ray Casting Visibility")."""

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface
from core.placement.boxes import Boxes
from core.placement.filters import above, footprint
from core.spatial import SpatialIndex

Float = NDArray[np.float64]

GRID = (16, 4)  # 64 rays a box
LIFT = 1.5  # reliefs: just clear of the letters


def above_letters(original: Surface, original_index: SpatialIndex, boxes: Boxes, relief: Float) -> Float:
    """(B, 64, 3) points of a grid over each box, 1.5 reliefs above the original surface under it, size-30 units.

    ``relief`` is (B,), the height of each mark's letters.
    """
    clearance = LIFT * np.abs(relief)
    met = footprint(boxes, original_index, original.normals, clearance, GRID, margin=0.0)
    return above(boxes, met, clearance)


def top_face(boxes: Boxes) -> Float:
    """(B, 64, 3) points of a grid over the top (front) face of each box, size-30 units."""
    u, v = np.meshgrid(*(np.linspace(-0.5, 0.5, count) for count in GRID), indexing="ij")
    local = np.stack([u.ravel(), v.ravel(), np.full(u.size, 0.5)], axis=1)[None] * boxes.size[:, None, :]
    return np.asarray(np.einsum("bni,bij->bnj", local, boxes.axes) + boxes.center[:, None, :])
