"""Areas, normals and coordinates of triangles."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.products import cross, dot, length


def unit(vectors: Float) -> Float:
    """(N, K) vectors at length 1, for small K; zero where they have no direction."""
    size = length(vectors)[:, None]
    return np.asarray(np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 1e-30))


def flat_normals(corners: Float) -> Float:
    """(F, 3) unit normals of (F, 3, 3) triangles; zero for degenerate ones."""
    return unit(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def barycentric(points: Float, triangles: Float) -> Float:
    """(F, K, 3) barycentric coordinates of ``points`` (F, K, 3) in their (F, 3, 3) triangles, on whose planes they lie
    up to rounding, clamped into the triangle."""
    origin, second, third = (np.repeat(triangles[:, corner], points.shape[1], axis=0) for corner in range(3))
    second -= origin
    third -= origin
    normal, relative = cross(second, third), points.reshape(-1, 3) - origin
    area = np.maximum(dot(normal, normal), np.finfo(float).tiny)
    v = np.einsum("ni,ni->n", cross(relative, third), normal) / area
    w = np.einsum("ni,ni->n", cross(second, relative), normal) / area
    return _clamped(v, w).reshape(points.shape)


def plane_barycentric(points: Float, triangles: Float) -> Float:
    """(N, 3) barycentric coordinates of (N, 2) ``points`` in (N, 3, 2) triangles of the plane, each in its own, clamped
    into it: those of :func:`barycentric`, bit for bit."""
    a, b, c = (triangles[:, corner] for corner in range(3))
    area = doubled_area(a, b, c)
    square = np.maximum(area * area, np.finfo(float).tiny)
    return _clamped(doubled_area(a, points, c) * area / square, doubled_area(a, b, points) * area / square)


def _clamped(second: Float, third: Float) -> Float:
    """(N, 3) barycentric coordinates, of which two (N,) are given, clamped into the triangle."""
    result = np.clip(np.stack([1 - second - third, second, third]), 0.0, 1.0)
    result[result < 1e-9] = 0.0
    result /= result[0] + result[1] + result[2]
    return np.ascontiguousarray(result.T)


def bisected(corners: Float, longest: float) -> tuple[Float, Int]:
    """Triangles (N, 3, 3) cut in two across their longest edges until no edge is longer than ``longest``: the pieces
    (M, 3, 3) and the number (M,) of the triangle that each is of."""
    source = np.arange(len(corners))
    done = [(corners[:0], source[:0])]
    while len(corners):
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)  # of ab, bc, ca
        long = sides.max(axis=1) > longest
        done.append((corners[~long], source[~long]))
        corners, source, edge = corners[long], source[long], sides[long].argmax(axis=1)
        rows = np.arange(len(corners))
        a, b, c = (corners[rows, (edge + corner) % 3] for corner in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        source = np.tile(source, 2)
    pieces, sources = zip(*done, strict=True)
    return np.concatenate(pieces), np.concatenate(sources)


def doubled_area(a: Float, b: Float, c: Float) -> Float:
    """(...) twice the signed areas of plane triangles with the corners ``a``, ``b``, ``c`` (..., 2), broadcast;
    positive where these run counter-clockwise."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def ring_area(ring: Float) -> float:
    """Signed area of a closed plane ring (N, 2); positive where it runs counter-clockwise."""
    x, y = (ring - ring[0]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def inside_rings(points: Float, rings: Sequence[Float]) -> Bool:
    """(N,) those of (N, 2) ``points`` inside closed plane ``rings`` (K, 2) by the even-odd rule."""
    if not len(points) or not len(rings):
        return np.zeros(len(points), dtype=bool)
    start, end = np.concatenate(rings), np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    # A side is crossed by the rays to the right from points of its heights only, which follow each other in this order.
    order = np.argsort(points[:, 1], kind="stable")
    x, y = points[order].T
    first = np.searchsorted(y, np.minimum(start[:, 1], end[:, 1]))
    count = np.searchsorted(y, np.maximum(start[:, 1], end[:, 1])) - first
    side = np.repeat(np.arange(len(start)), count)
    point = np.arange(len(side)) + np.repeat(first - np.cumsum(count) + count, count)
    (from_x, from_y), (way_x, way_y) = start[side].T, (end - start)[side].T
    crossed = point[x[point] < from_x + (y[point] - from_y) * way_x / way_y]
    result = np.empty(len(points), dtype=bool)
    result[order] = np.bincount(crossed, minlength=len(points)) % 2
    return result
