"""Ray origins of the visibility metrics (paper, supplement "Ray Casting Visibility")."""

import numpy as np

from core.arrays import Float
from core.geometry.boxes import Boxes, unit_grid
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.placement.filters import above, footprint

GRID = (16, 4)  # points along the text and across it: 64 rays a box
LIFT = 1.5  # reliefs above the surface: just clear of the letters
CLEAR = 1e-3  # size-30 units above the top face


def above_letters(original: Surface, original_index: SpatialIndex, boxes: Boxes, relief: Float) -> Float:
    """(B, 64, 3) points of a grid over each box, just clear of its letters, size-30 units.

    They are 1.5 reliefs above the original surface in the box, or on the box's top face where that is higher: the
    letters of a mark that does not follow the surface end there. ``relief`` is (B,), the height of the letters.
    """
    clearance = LIFT * np.abs(relief)
    met = footprint(boxes, original_index, original.normals, clearance, GRID, margin=0.0)
    points, top, normal = above(boxes, met, clearance), top_face(boxes), boxes.axes[:, None, 2]
    short = np.maximum(np.einsum("bni,bni->bn", top - points, np.broadcast_to(normal, top.shape)), 0.0)
    return np.asarray(points + short[..., None] * normal)


def top_face(boxes: Boxes) -> Float:
    """(B, 64, 3) points of a grid just above the top (front) face of each box, size-30 units.

    On the face itself the rays of flat letters, which end there, would start inside them or not by rounding.
    """
    front = np.pad(unit_grid(GRID), ((0, 0), (0, 1)), constant_values=0.5)
    local = front[None] * boxes.size[:, None, :]
    local[..., 2] += CLEAR
    return np.asarray(np.einsum("bni,bij->bnj", local, boxes.axes) + boxes.center[:, None, :])
