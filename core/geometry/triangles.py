"""Areas, normals and coordinates of triangles."""

import numpy as np

from core.arrays import Float
from core.geometry.products import cross


def unit(vectors: Float) -> Float:
    """(N, 3) vectors at length 1; zero where they have no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-30))


def flat_normals(corners: Float) -> Float:
    """(F, 3) unit normals of (F, 3, 3) triangles; zero for degenerate ones."""
    return unit(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def barycentric(points: Float, triangles: Float) -> Float:
    """(F, K, 3) barycentric coordinates of ``points`` (F, K, 3) in their (F, 3, 3) triangles, on whose planes they lie
    up to rounding, clamped into the triangle."""
    origin = triangles[:, 0]
    first, second = triangles[:, 1] - origin, triangles[:, 2] - origin
    normal = cross(first, second)
    area = np.maximum(np.sum(normal * normal, axis=1), np.finfo(float).tiny)[:, None]
    relative = points - origin[:, None]
    v = np.einsum("fkj,fj->fk", cross(relative, second[:, None]), normal) / area
    w = np.einsum("fkj,fj->fk", cross(first[:, None], relative), normal) / area
    result = np.clip(np.stack([1 - v - w, v, w], axis=-1), 0.0, 1.0)
    result[result < 1e-9] = 0.0
    return np.asarray(result / result.sum(axis=-1, keepdims=True))


def doubled_area(a: Float, b: Float, c: Float) -> Float:
    """(...) twice the signed areas of plane triangles with the corners ``a``, ``b``, ``c`` (..., 2), broadcast;
    positive where these run counter-clockwise."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def ring_area(ring: Float) -> float:
    """Signed area of a closed plane ring (N, 2); positive where it runs counter-clockwise."""
    x, y = (ring - ring[0]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
