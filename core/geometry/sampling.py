"""Points spread over a surface: uniform by area, then thinned to be roughly equidistant."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface


def sample(surface: Surface, count: int, rng: np.random.Generator) -> tuple[Float, Int]:
    """``count`` points drawn uniformly by area, whatever the tessellation.

    Returns:
        points (count, 3) float64 in the size-30 frame, and the face (count,) int64 each lies on; a face
        without area is never picked.

    Raises:
        MeshmarkError: ``no_faces`` when no face has any area.
    """
    solid = np.flatnonzero(surface.areas > 0)
    if len(solid) == 0:
        raise MeshmarkError(
            ErrorCode.NO_FACES,
            f"None of the {len(surface.faces)} faces of this file has any area.",
            "Export the model with its surface, not only points, lines or collapsed triangles.",
        )
    cumulative = np.cumsum(surface.areas[solid])
    picked = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    face = solid[np.minimum(picked, len(solid) - 1)]
    # The square root makes the two coordinates uniform over the triangle (Turk 1990).
    root, second = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = (surface.positions[surface.faces[face, corner]] for corner in range(3))
    return (1 - root) * a + root * (1 - second) * b + root * second * c, face


def thin(points: Float, radius: float) -> Int:
    """Indices of the ``points`` (N, 3) that stay when, in order, each one closer than ``radius`` to an earlier
    kept one is rejected (the paper's initialization, radius 1)."""
    tree = cKDTree(points)
    open_ = np.ones(len(points), dtype=bool)
    kept = []
    for index, point in enumerate(points):
        if open_[index]:
            kept.append(index)
            open_[tree.query_ball_point(point, radius)] = False
    return np.asarray(kept, dtype=np.int64)
