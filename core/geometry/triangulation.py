"""Polygons cut into triangles."""

from collections.abc import Iterator

import numpy as np

from core.arrays import Float, Int
from core.geometry.products import cross

_BLOCK = 2**20  # corners worked on at a time: bounds the memory of a five-million-quad file


def triangulate(positions: Float, corners: Int, sizes: Int) -> tuple[Int, Int]:
    """Split polygons into triangles, in polygon order.

    Convex polygons become fans about their first corner; a concave quad is cut at its reflex corner; other concave
    polygons are clipped in their plane. Polygons with fewer than three corners draw nothing and vanish.

    Args:
        positions: (V, 3).
        corners: (C,) vertex of each corner, in range.
        sizes: (P,) corners of each polygon, summing to C.

    Returns:
        (T, 3) corner numbers and (T,) the polygon of each triangle.
    """
    first = np.cumsum(sizes) - sizes
    count = np.maximum(sizes - 2, 0)
    offset = np.cumsum(count) - count
    triangles = np.empty((int(count.sum()), 3), np.int64)
    for size, rows in _blocks(sizes):
        local = np.broadcast_to(_fan(size, 0), (len(rows), size - 2, 3))
        if size > 3:
            local = _cut(positions[corners[first[rows][:, None] + np.arange(size)]], local)
        triangles[offset[rows][:, None] + np.arange(size - 2)] = local + first[rows][:, None, None]
    return triangles, np.repeat(np.arange(len(sizes)), count)


def _blocks(sizes: Int) -> Iterator[tuple[int, Int]]:
    """Polygon numbers by size, at most ``_BLOCK`` corners (or one polygon) at a time."""
    order = np.argsort(sizes, kind="stable")
    order = order[sizes[order] >= 3]
    for rows in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1):
        if len(rows):  # there is one empty group where there is no polygon
            size = int(sizes[rows[0]])
            step = max(1, _BLOCK // size)
            for block in range(0, len(rows), step):
                yield size, rows[block : block + step]


def _fan(size: int, start: int) -> Int:
    """(size - 2, 3) the fan of one polygon about corner ``start``."""
    middle = np.arange(1, size - 1)
    return (np.column_stack([np.zeros_like(middle), middle, middle + 1]) + start) % size


def _cut(points: Float, fans: Int) -> Int:
    """(R, n - 2, 3) triangles of R polygons (R, n, 3), given their fans."""
    size = points.shape[1]
    ahead = np.roll(points, -1, axis=1) - points
    turn = cross(np.roll(ahead, 1, axis=1), ahead)
    normal = cross(points - points[:, :1], np.roll(points, -1, axis=1) - points[:, :1]).sum(axis=1)
    reflex = np.einsum("rnk,rk->rn", turn, normal) < 0
    concave = np.flatnonzero(reflex.any(axis=1))
    if len(concave) == 0:
        return fans
    result = fans.copy()
    if size == 4:
        result[reflex[:, 1] | reflex[:, 3]] = _fan(4, 1)
        return result
    for row in concave:
        clipped = _clip(points[row], normal[row])
        if len(clipped) == size - 2:  # fewer for an outline that crosses itself: it has no triangulation, keep the fan
            result[row] = clipped
    return result


def _clip(points: Float, normal: Float) -> Int:
    """Triangles of a simple polygon (n, 3), seen along ``normal``."""
    # Imported here because the API imports this module for its gate, and must stay small.
    from manifold3d import triangulate as triangulate_outlines

    drop = int(np.argmax(np.abs(normal)))
    flat = points[:, [(drop + 1) % 3, (drop + 2) % 3]]
    flat = flat - flat.min(axis=0)
    flat /= max(float(flat.max()), np.finfo(np.float64).tiny)
    if normal[drop] < 0:
        flat = flat[:, ::-1]
    return np.asarray(triangulate_outlines([np.ascontiguousarray(flat)]), np.int64)
