"""Intersection of triangles and oriented boxes with axis-aligned boxes, by separating axes.

Two convex bodies are apart if and only if their projections are apart on a face normal of either or on the cross
product of an edge of each (Gottschalk, Lin, Manocha 1996; for triangles Akenine-Moeller 2001).
"""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.products import cross, product

# Size-30 units; bodies this close intersect. The cross product of parallel edges is rounding noise; its projections are
# far below this, so it separates nothing.
TOUCH = 1e-9


def triangles_meet(triangles: Float, low: Float, high: Float) -> Bool:
    """(T,) those of (T, 3, 3) triangles that intersect the box from ``low`` (3,) to ``high`` (3,)."""
    meet = (triangles.min(axis=1) <= high + TOUCH).all(axis=1) & (triangles.max(axis=1) >= low - TOUCH).all(axis=1)
    near = np.flatnonzero(meet)
    half = (high - low) / 2
    corners = triangles[near] - (low + high) / 2
    edges = np.roll(corners, -1, axis=1) - corners
    normal = cross(edges[:, 0], edges[:, 1])
    axes = np.concatenate([normal[:, None], cross(np.eye(3)[:, None], edges[:, None]).reshape(-1, 9, 3)], axis=1)
    along = np.einsum("tcx,tax->tac", corners, axes)
    reach = product(np.abs(axes), half[:, None])[..., 0] + TOUCH
    meet[near] = ((along.min(axis=2) <= reach) & (along.max(axis=2) >= -reach)).all(axis=1)
    return np.asarray(meet)


def boxes_meet(boxes: Boxes, upright: Float) -> Bool:
    """(B, K) oriented boxes that intersect each axis-aligned one (K, 2, 3: lowest, highest corner)."""
    middle, half = upright.mean(axis=1), (upright[:, 1] - upright[:, 0]) / 2
    crosses = cross(np.eye(3)[:, None], boxes.axes[:, None]).reshape(-1, 9, 3)
    world = np.broadcast_to(np.eye(3), boxes.axes.shape)
    axes = np.concatenate([world, boxes.axes, crosses], axis=1)
    apart = np.abs(np.einsum("bax,bkx->bka", axes, boxes.center[:, None] - middle))
    own = np.einsum("bja,bj->ba", np.abs(np.einsum("bjx,bax->bja", boxes.axes, axes)), boxes.size / 2)
    reach = own[:, None] + np.einsum("bax,kx->bka", np.abs(axes), half)
    return np.asarray((apart <= reach + TOUCH).all(axis=2))
