"""Watermark Placement Score by exact area: Definition 1 of the paper without its shortcut."""

import numpy as np

from core.arrays import Float, Int
from core.geometry.boxes import Boxes
from core.geometry.faces_near import near
from core.geometry.surface import Surface


def wps_area(original: Surface, boxes: Boxes) -> Float:
    """(B,) projected area of the original's surface inside each box over the box's front area, 0 to 1.

    The paper's Eq. 1 with the box for the watermark and ``min`` for ``max``. Higher is better; 1 where the surface
    passes through the whole box. Triangles are clipped to the box, so the score does not depend on tessellation.
    Only faces that face the box count.
    """
    score = np.zeros(len(boxes))
    for number, faces in enumerate(near(original, boxes)):
        seen = faces[original.normals[faces] @ boxes.axes[number, 2] > 0]
        local = boxes.to_local(number, original.positions[original.faces[seen]].reshape(-1, 3))
        area = _clipped_area(local, boxes.size[number] / 2)
        score[number] = min(area / boxes.size[number, :2].prod(), 1.0)
    return score


def _clipped_area(points: Float, half: Float) -> float:
    """Area on the xy plane of triangles, three rows of ``points`` each, inside the box of half sizes ``half``.

    Sutherland-Hodgman on all triangles at once: polygons follow one another in one array, ``owner`` numbers them, and
    each point is followed by the intersection of its edge to the next one with the plane.
    """
    owner: Int = np.repeat(np.arange(len(points) // 3), 3)
    for axis in (0, 1, 2):
        for side in (-1.0, 1.0):
            following: Int = _next(owner)
            depth = half[axis] - side * points[:, axis]
            inside = depth >= 0
            crosses = inside != inside[following]
            share = np.divide(depth, depth - depth[following], out=np.zeros_like(depth), where=crosses)
            crossing = points + share[:, None] * (points[following] - points)
            kept = np.stack([inside, crosses], axis=1).ravel()
            points = np.stack([points, crossing], axis=1).reshape(-1, 3)[kept]
            owner = np.repeat(owner, 2)[kept]
    ahead = points[_next(owner)]
    return float((points[:, 0] * ahead[:, 1] - points[:, 1] * ahead[:, 0]).sum() / 2)


def _next(owner: Int) -> Int:
    """Row of the point after each one round its polygon."""
    following = np.arange(1, len(owner) + 1)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    last = np.concatenate([first[1:], [len(owner)]]) - 1 if len(owner) else first
    following[last] = first
    return following
