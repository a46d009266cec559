"""The ground of letters as a function over the box plane, and rings laid over it."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import doubled_area, plane_barycentric

ROUNDS = 4  # of bisecting the sides of rings over bent ground, at most
INSIDE = 1e-7  # text widths or barycentric coordinate; points this far outside a triangle are in it


@dataclass(frozen=True, eq=False)
class Rings:
    """Closed rings over the ground, one after another.

    Attributes:
        points: (N, 2) in the plane.
        sizes: (R,) number of points of each.
        faces: (N,) the triangle under each point, or nearest to it.
        beside: (N,) the distance to it in the plane.
    """

    points: Float
    sizes: Int
    faces: Int
    beside: Float

    @property
    def ahead(self) -> Int:
        """(N,) the number of the next point of the ring."""
        result = np.arange(1, len(self.points) + 1)
        end = np.cumsum(self.sizes)
        result[end - 1] = end - self.sizes
        return result


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
        self._index = SpatialIndex(flat, triangles[which])

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

    def bridged(self, rings: list[Float], tolerance: float, shortest: float) -> Rings:
        """The ``rings`` (N, 2) with their sides bisected until none is further than ``tolerance`` from the surface, or
        as short as ``shortest``."""
        points, sizes = np.concatenate(rings), np.array([len(ring) for ring in rings])
        found = Rings(points, sizes, *self.under(points))
        unknown = np.ones(len(points), dtype=bool)
        for _ in range(ROUNDS):
            inside, ahead = found.beside < INSIDE, found.ahead
            in_one = (found.faces == found.faces[ahead]) & inside & inside[ahead]  # a triangle, and thus on the surface
            way = found.points[ahead] - found.points
            long = np.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1]) > shortest
            which = np.flatnonzero(unknown & ~in_one & long)
            found, unknown = self._bisected(found, which, tolerance)
            if not unknown.any():
                break
        return found

    def _bisected(self, rings: Rings, which: Int, tolerance: float) -> tuple[Rings, Bool]:
        """The ``rings`` with those of their sides ``which`` bisected that are further than ``tolerance`` from the
        surface, and the sides (N,) that are new."""
        ahead = rings.ahead[which]
        start, end = rings.points[which], rings.points[ahead]
        middle = (start + end) / 2
        probes = np.concatenate([(start + middle) / 2, middle, (middle + end) / 2])
        faces, beside = self.under(probes)
        all_points = np.concatenate([start, end, probes])
        all_faces = np.concatenate([rings.faces[which], rings.faces[ahead], faces])
        first, last, *between = self.height(self.weights(all_points, all_faces), all_faces).reshape(5, -1)
        error = [
            np.abs(height - first - share * (last - first))
            for height, share in zip(between, (0.25, 0.5, 0.75), strict=True)
        ]
        far = np.flatnonzero(np.maximum(np.maximum(*error[:2]), error[2]) > tolerance)
        split = np.zeros(len(rings.points), dtype=bool)
        split[which[far]] = True
        at, halves = which[far] + 1, len(which) + far  # of the middles among the probes
        ring = np.repeat(np.arange(len(rings.sizes)), rings.sizes)
        return Rings(
            np.insert(rings.points, at, middle[far], axis=0),
            rings.sizes + np.bincount(ring[which[far]], minlength=len(rings.sizes)),
            np.insert(rings.faces, at, faces[halves]),
            np.insert(rings.beside, at, beside[halves]),
        ), np.repeat(split, 1 + split)
