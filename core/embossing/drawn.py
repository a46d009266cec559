"""The check of the written file: visibility of its marks in a viewer, read back from its bytes."""

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.bounds import meeting
from core.geometry.products import cross, dot, length
from core.geometry.surface import Surface
from core.geometry.triangles import flat_normals
from core.gltf.edit import Kind, SurfaceEdit
from core.gltf.scene import Scene

ENOUGH = 0.95  # share of the area of a mark's caps that must be drawn
ROUNDED = 8  # spacings of the file's coordinates by which rounding may have moved a triangle


def drawn_marks(
    edit: SurfaceEdit, count: int, surface: Surface, resolution: Float, written: Scene, opaque: float
) -> Bool:
    """(``count``,) marks whose letters are in the written file, and are drawn from outside.

    The caps of a mark are looked up among the triangles of the file. They count where these are drawn, opaque, and
    visible from outside: they face outwards in the file's own winding, or their material is double-sided.

    Args:
        edit: the written edit, with its triangles facing outwards.
        count: number of its marks.
        surface: that it is an edit of.
        resolution: (V,) the spacing of the file's coordinates at the vertices of ``surface``, size-30 units.
        written: the file, read back from its bytes.
        opaque: the share of a face that must be opaque.
    """
    found, seen = written.surface.in_frame_of(surface), written.viewed
    x, y, z = (sum(axis[corner] for corner in found.faces.T) / 3 for axis in found.positions.T.copy())
    caps = np.flatnonzero(edit.kind == Kind.CAP)
    drawn = np.zeros(count, dtype=bool)
    for mark in range(count):
        mine = caps[edit.mark[caps] == mark]
        if not len(mine):
            continue
        corners = edit.position[mine]
        slack = ROUNDED * float(resolution[surface.faces[edit.source_face[mine]]].max())
        by_axis = corners.reshape(-1, 3).T
        low, high = [axis.min() - slack for axis in by_axis], [axis.max() + slack for axis in by_axis]
        # Undrawn triangles may be in the same place: of a hidden node with the same mesh.
        near = np.flatnonzero(seen.drawn & (x >= low[0]) & (x <= high[0]))
        for axis, number in ((y, 1), (z, 2)):
            near = near[(axis[near] >= low[number]) & (axis[near] <= high[number])]
        if not len(near):
            continue
        middle = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
        which = _nearest(np.column_stack([x[near], y[near], z[near]]), middle, slack)
        there, face = which >= 0, near[which]
        outwards = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        front = dot(flat_normals(found.positions[found.faces[face]]), outwards) > 0
        good = there & (front | ~seen.one_sided[face]) & (seen.opacity[face] >= opaque)
        area = length(outwards)
        drawn[mark] = area[good].sum() >= ENOUGH * area.sum()
    return drawn


def _nearest(points: Float, to: Float, within: float) -> Int:
    """(M,) the number of the nearest of (N, 3) ``points`` to each of the points ``to`` (M, 3), the first of equals; -1
    where none is ``within`` that distance."""
    result, best = np.full(len(to), -1), np.full(len(to), within)
    for point, which in meeting(points, points, to - within, to + within):
        distance = length(points[point] - to[which])
        least = best.copy()
        np.minimum.at(least, which, distance)
        nearest = np.flatnonzero((distance == least[which]) & (distance < best[which]))
        first = nearest[np.lexsort((-point[nearest], which[nearest]))]
        result[which[first]], best = point[first], least  # of several for one, the last one stays
    return result
