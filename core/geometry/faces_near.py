"""Faces near each mark, found once, so that nobody goes over the whole asset for every mark."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface

CELLS = 64  # cells along the longest side of the bounding box of all boxes


def near(surface: Surface, boxes: Boxes) -> list[Int]:
    """For each box the faces, ascending, whose axis-aligned bounding boxes meet that of the box.

    One pass over the faces on a coarse grid of flags leaves those in cells that some box touches and those larger
    than a cell; only these are compared with every box.
    """
    if len(boxes) == 0:
        return []
    corners = boxes.corners()
    first, last = corners.min(axis=1), corners.max(axis=1)
    origin = first.min(axis=0)
    cell = (last.max(axis=0) - origin).max() / CELLS

    def cells(points: Float) -> NDArray[np.int16]:
        # Two cells of margin on either side, which no box touches, hold all points outside.
        return np.asarray(np.clip((points - origin) / cell + 2, 0, CELLS + 3), dtype=np.int16)

    touched = np.zeros((CELLS + 4,) * 3, dtype=bool)
    for start, stop in zip(cells(first) - 1, cells(last) + 1, strict=True):
        # From one cell before: a face that intersects the box may begin there.
        touched[start[0] : stop[0], start[1] : stop[1], start[2] : stop[2]] = True
    by_vertex = cells(surface.positions).T.copy()
    begins, large = [], np.zeros(len(surface.faces), dtype=bool)
    for axis in range(3):
        a, b, c = (by_vertex[axis][surface.faces[:, corner]] for corner in range(3))
        begins.append(np.minimum(np.minimum(a, b), c))
        large |= np.maximum(np.maximum(a, b), c) - begins[axis] > 1
    some = np.flatnonzero(touched[tuple(begins)] | large)

    columns = [[surface.positions[surface.faces[some, corner], axis] for corner in range(3)] for axis in range(3)]
    low = [np.minimum(np.minimum(a, b), c) for a, b, c in columns]
    high = [np.maximum(np.maximum(a, b), c) for a, b, c in columns]
    found = []
    for start, stop in zip(first, last, strict=True):
        # Axis by axis, since most faces fail the first comparison.
        meets = np.flatnonzero((low[0] <= stop[0]) & (high[0] >= start[0]))
        for axis in (1, 2):
            meets = meets[(low[axis][meets] <= stop[axis]) & (high[axis][meets] >= start[axis])]
        found.append(some[meets])
    return found
