"""The check of the written file, before anybody gets it: which marks a viewer draws, read back from its bytes."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Bool, Float
from core.geometry.products import cross
from core.geometry.surface import Surface
from core.gltf.edit import Kind, SurfaceEdit
from core.gltf.scene import Scene

ENOUGH = 0.95  # of the area of a mark's letter tops
ROUNDED = 8  # spacings of the file's coordinates that a triangle may have moved by


def drawn_marks(
    edit: SurfaceEdit, count: int, surface: Surface, resolution: Float, written: Scene, opaque: float
) -> Bool:
    """(``count``,) whether the letters of each mark are in the written file, and drawn from where they are to be seen.

    The tops of a mark's letters are looked up among the triangles of the file. They count where these are drawn,
    opaque, and seen from outside: they face it in the file's own winding, or their material is double-sided.

    Args:
        edit: what was written, with its triangles facing outside.
        count: how many marks it has.
        surface: what it was an edit of.
        resolution: (V,) the spacing of the file's coordinates at the vertices of ``surface``, size-30 units.
        written: the file, read back from its bytes.
        opaque: the share of a face that must be opaque.
    """
    found, seen = written.surface.in_frame_of(surface), written.viewed
    x, y, z = (np.ascontiguousarray(axis) for axis in found.positions[found.faces].mean(axis=1).T)
    caps = np.flatnonzero(edit.kind == Kind.CAP)
    drawn = np.zeros(count, dtype=bool)
    for mark in range(count):
        mine = caps[edit.mark[caps] == mark]
        if not len(mine):
            continue
        corners = edit.position[mine]
        slack = ROUNDED * float(resolution[surface.faces[edit.source_face[mine]]].max())
        low, high = corners.min(axis=(0, 1)) - slack, corners.max(axis=(0, 1)) + slack
        # What is not drawn may lie in the same place: a hidden node that shows the same mesh.
        near = np.flatnonzero(seen.drawn & (x >= low[0]) & (x <= high[0]))
        for axis, number in ((y, 1), (z, 2)):
            near = near[(axis[near] >= low[number]) & (axis[near] <= high[number])]
        if not len(near):
            continue
        centers = np.column_stack([x[near], y[near], z[near]])
        distance, which = cKDTree(centers).query(corners.mean(axis=1), distance_upper_bound=slack)
        there = np.isfinite(distance)
        face = near[np.where(there, which, 0)]
        outwards = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        front = np.einsum("ni,ni->n", found.normals[face], outwards) > 0
        good = there & (front | ~seen.one_sided[face]) & (seen.opacity[face] >= opaque)
        area = np.linalg.norm(outwards, axis=1)
        drawn[mark] = area[good].sum() >= ENOUGH * area.sum()
    return drawn
