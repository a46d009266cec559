"""The ground of letters as a function over the box plane, and rings laid over it."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Float, Int
from core.embossing.rings import Rings
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import doubled_area, plane_barycentric

ROUNDS = 4  # of bisecting the sides of rings over bent ground, at most
FEW = 1000  # triangles, up to which long ones are not cut up: that takes longer than all queries
INSIDE = 1e-7  # text widths or barycentric coordinate; points this far outside a triangle are in it


@dataclass(frozen=True, eq=False)
class LaidRings(Rings):
    """Rings laid over the ground.

    Attributes:
        faces: (N,) the triangle under each point, or nearest to it.
        beside: (N,) the distance to it in the plane.
    """

    faces: Int
    beside: Float


class Ground:
    """Triangles of a patch as a function over its plane.

    Args:
        points: (V, 3) of the patch.
        triangles: (K, 3) into them.
        which: the triangles that count.
    """

    def __init__(self, points: Float, triangles: Int, which: Int) -> None:
        self._points, self._triangles, self._which = points, triangles, which
        flat = np.column_stack([points[:, :2], np.zeros(len(points))])
        self._index = SpatialIndex(flat, triangles[which], cut=len(which) > FEW)

    def under(self, points: Float) -> tuple[Int, Float]:
        """The triangle (N,) under, or nearest to, each of (N, 2) ``points``, and the distance (N,) to it."""
        distance, face, _ = self._index.closest(np.column_stack([points, np.zeros(len(points))]))
        return self._which[face], distance

    def weights(self, points: Float, faces: Int) -> Float:
        """(N, 3) barycentric coordinates of (N, 2) ``points`` in triangles (N,), clamped into these."""
        return plane_barycentric(points, self._points[self._triangles[faces], :2])

    def height(self, weights: Float, faces: Int) -> Float:
        """(N,) of the surface at barycentric coordinates (N, 3) in triangles (N,)."""
        a, b, c = (weights[:, corner] * self._points[self._triangles[faces, corner], 2] for corner in range(3))
        return np.asarray(a + b + c)

    def outside(self, points: Float, faces: Int) -> Float:
        """(N, K) by how much (N, K, 2) ``points`` lie outside the triangles (N,), in barycentric coordinates."""
        a, b, c = (self._points[self._triangles[faces, k], :2][:, None] for k in range(3))
        least = np.minimum(
            np.minimum(doubled_area(b, c, points), doubled_area(c, a, points)), doubled_area(a, b, points)
        )
        return np.asarray(-least / doubled_area(a, b, c))

    def bridged(self, rings: list[Float], tolerance: float, shortest: float) -> LaidRings:
        """The ``rings`` (N, 2) with their sides bisected until none is further than ``tolerance`` from the surface, or
        as short as ``shortest``."""
        found = Rings.of(rings)
        faces, beside = self.under(found.points)
        unknown = np.ones(len(found.points), dtype=bool)
        for _ in range(ROUNDS):
            ahead, inside = found.ahead, beside < INSIDE
            in_one = (faces == faces[ahead]) & inside & inside[ahead]  # a triangle, and thus on the surface
            which = np.flatnonzero(unknown & ~in_one & found.longer(shortest))
            start, end = found.points[which], found.points[ahead[which]]
            middle = (start + end) / 2
            probes = np.concatenate([(start + middle) / 2, middle, (middle + end) / 2])
            under, away = self.under(probes)
            low, high, *between = self._height(
                np.concatenate([start, end, probes]), np.concatenate([faces[which], faces[ahead[which]], under])
            ).reshape(5, -1)
            error = [
                np.abs(at - low - share * (high - low)) for share, at in zip((0.25, 0.5, 0.75), between, strict=True)
            ]
            split = np.flatnonzero(np.max(error, axis=0) > tolerance)
            if not len(split):
                break
            found = found.with_points(which[split], middle[split])
            faces = np.insert(faces, which[split] + 1, under[len(which) + split])
            beside = np.insert(beside, which[split] + 1, away[len(which) + split])
            new = which[split] + np.arange(len(split))  # of each pair of halves the first
            unknown = np.zeros(len(found.points), dtype=bool)
            unknown[new] = unknown[new + 1] = True
        return LaidRings(found.points, found.sizes, faces, beside)

    def _height(self, points: Float, faces: Int) -> Float:
        """(N,) of the surface at (N, 2) ``points`` in triangles (N,)."""
        return self.height(self.weights(points, faces), faces)
