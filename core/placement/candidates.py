"""Where a watermark might go: boxes at even surface samples, facing along the normal, text upright."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.placement.boxes import Boxes
from core.placement.sampling import thin

Float = NDArray[np.float64]

UP = np.array([0.0, 1.0, 0.0])
# Within 20 degrees of +-Y the asset's up says nothing about the reading direction.
POLE = np.cos(np.radians(20.0))


def candidates(points: Float, normals: Float, size: tuple[float, float, float], radius: float) -> Boxes:
    """Boxes at area samples, thinned to be roughly equidistant (paper, section "Initialization").

    Args:
        points: (N, 3) area samples of the surface (the paper's H_s = 300), size-30 units.
        normals: (N, 3) unit normals there.
        size: width, height and thickness of each box, size-30 units.
        radius: samples closer than this to an earlier one are rejected (the paper's H_r = 1).
    """
    kept = thin(points, radius)
    normal = _mean_normals(points, normals, kept, reach=size[0] / 4)
    return Boxes(points[kept], upright(normal), np.tile(np.asarray(size, dtype=np.float64), (len(kept), 1)))


def upright(normal: Float) -> Float:
    """(B, 3, 3) right-handed rows right, up, normal for unit normals (B, 3): up leans towards the asset's +Y.

    Near the poles it is what a camera tilted from the front would show as up: -Z on top, +Z underneath.
    """
    polar = np.abs(normal[:, 1]) > POLE
    reference = np.where(polar[:, None], np.sign(normal[:, 1:2]) * np.array([0.0, 0.0, -1.0]), UP)
    up = reference - np.einsum("bi,bi->b", reference, normal)[:, None] * normal
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([np.cross(up, normal), up, normal], axis=1)


def right_way_up(boxes: Boxes) -> Boxes:
    """The same boxes, with half a turn in their plane where the text would stand on its head: fitting may tip one over
    an edge."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    turned = np.where(level < 0, -1.0, 1.0)
    axes = boxes.axes * np.stack([turned, turned, np.ones(len(boxes))], axis=1)[:, :, None]
    return Boxes(boxes.center, axes, boxes.size)


def _mean_normals(points: Float, normals: Float, kept: NDArray[np.int64], reach: float) -> Float:
    """Unit normals at ``points[kept]``, averaged over the area samples within ``reach`` on the same side.

    Samples are uniform by area, so a plain mean is the area-weighted one. A sharp crease or the far side of a
    thin wall must not turn the box, hence only normals within 60 degrees of the sample's own count; the sum
    of such vectors is never zero.
    """
    neighbours = cKDTree(points).query_ball_point(points[kept], reach)
    lengths = np.fromiter((len(found) for found in neighbours), dtype=np.int64, count=len(kept))
    flat = np.concatenate([np.asarray(found, dtype=np.int64) for found in neighbours])
    own = np.repeat(normals[kept], lengths, axis=0)
    alike = np.einsum("ni,ni->n", normals[flat], own) > 0.5
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    total = np.add.reduceat(normals[flat] * alike[:, None], starts, axis=0)
    return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))
