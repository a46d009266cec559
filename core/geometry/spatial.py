"""Closest points and ray casts on one fixed triangle mesh: built once per job, used by every stage."""

from copy import copy
from enum import IntEnum
from functools import cached_property, reduce
from typing import Protocol, Self

import igl
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.geometry.products import cross
from core.geometry.triangles import bisected

LONG = 1 / 15  # edge length over the mesh's extent, from which on a triangle is long
PIECES = 50_000  # triangles that long ones are subdivided into, unless there are more faces
# Share of the mesh's extent (3e-5 size-30 units) behind a passed face at which the ray is cast anew; and faces that a
# ray passes at most: the next one occludes, whatever its :class:`Hides`.
PASSED, PASSES = 1e-6, 64


class Eye(IntEnum):
    """End of a ray that the viewer is at."""

    ORIGIN = 1
    FAR = -1


class Hides(IntEnum):
    """Sides from which a face occludes."""

    ALWAYS = 0
    FROM_FRONT = 1
    """Its back is not drawn."""
    NEVER = 2
    """It is see-through."""


class RayCaster(Protocol):
    """Surface that rays are cast on."""

    def first_hit(self, origins: Float, directions: Float, eye: Eye | None = None) -> tuple[Float, Int]:
        """First hit of each ray, see :meth:`SpatialIndex.first_hit`."""


class _Hierarchies:
    """The hierarchies over ``positions[faces]``, each built at its first use, and shared by all indices over them.

    Args:
        positions: (V, 3) float64, contiguous.
        faces: (F, 3) int64, contiguous.
        cut: long triangles are cut up.
    """

    def __init__(self, positions: Float, faces: Int, cut: bool) -> None:
        self.positions, self.faces, self._cut = positions, faces, cut

    @cached_property
    def parts(self) -> tuple[Float, Int, Int]:
        """Positions and faces with long triangles cut up, and the row of ``faces`` that each came from.

        The boxes around long triangles overlap all that lies beside them: where there are some among many small ones,
        closest points are found two to three times as fast without them.
        """
        if not self._cut:
            return self.positions, self.faces, np.arange(len(self.faces))
        a, b, c = (self.positions.take(self.faces[:, corner], axis=0) for corner in range(3))
        edges = np.maximum(np.maximum(_length(a - c), _length(b - a)), _length(c - b))
        low, high = (reduce(bound, (a, b, c)) for bound in (np.minimum, np.maximum))
        most = LONG * float((high.max(axis=0, initial=-np.inf) - low.min(axis=0, initial=np.inf)).max())
        while ((edges[edges > most] / max(most, np.finfo(float).tiny)) ** 2).sum() > max(PIECES, len(edges)):
            most *= 2
        whole, long = np.flatnonzero(edges <= most), np.flatnonzero(edges > most)
        if not len(long):
            return self.positions, self.faces, whole
        pieces, source = bisected(self.positions[self.faces[long]], most)
        new = np.arange(3 * len(pieces)).reshape(-1, 3) + len(self.positions)
        return (
            np.concatenate([self.positions, pieces.reshape(-1, 3)]),
            np.concatenate([self.faces[whole], new]),
            np.concatenate([whole, long[source]]),
        )

    @cached_property
    def tree(self) -> igl.AABB:
        tree = igl.AABB()
        positions, faces, _ = self.parts
        tree.init(positions, faces)
        return tree

    @cached_property
    def scene(self) -> rtcore_scene.EmbreeScene:
        scene = rtcore_scene.EmbreeScene()
        # With shared vertices: half the time and memory of a soup of triangles.
        TriangleMesh(scene, self.positions.astype(np.float32), self.faces.astype(np.int32))
        return scene

    @cached_property
    def extent(self) -> float:
        used = self.positions[self.faces.ravel()]
        return float((used.max(axis=0) - used.min(axis=0)).max()) or 1.0


class SpatialIndex:
    """A bounding-volume hierarchy over ``positions[faces]``.

    Args:
        positions: (V, 3) float64.
        faces: (F, 3) int64.
        ids: the rows of ``faces`` that count, ascending, at least one; all of them if None. Answers are rows of
            ``faces`` in either case.
        hides: (F,) uint8, a :class:`Hides` of each face; all hide always if None.
        cut: long triangles are cut up for :meth:`closest`: it pays where there are many, or many queries.

    Attributes:
        device: that queries run on, as torch names it; callers of many queries best calculate there as well.
    """

    device = "cpu"

    def __init__(
        self,
        positions: Float,
        faces: Int,
        ids: Int | None = None,
        hides: NDArray[np.uint8] | None = None,
        cut: bool = True,
    ) -> None:
        self.positions = np.ascontiguousarray(positions, dtype=np.float64)
        self._ids = ids if ids is not None and len(ids) < len(faces) else None
        self.faces = np.ascontiguousarray(faces if self._ids is None else faces[self._ids], dtype=np.int64)
        self._hides = self._mask(hides)
        self._built = _Hierarchies(self.positions, self.faces, cut)

    def hiding(self, hides: NDArray[np.uint8] | None) -> Self:
        """The same index with other ``hides``; the hierarchies are shared."""
        other = copy(self)
        other._hides = self._mask(hides)
        return other

    def among(self, rows: Int) -> "SpatialIndex":
        """An index over those of the ``rows`` of ``faces`` (N,), ascending, that count here, for queries near these.

        It is built sooner than one over all of them. Answers are rows of the same ``faces``, each of which hides."""
        mine = rows if self._ids is None else np.flatnonzero(np.isin(self._ids, rows, assume_unique=True))
        few = SpatialIndex(self.positions, self.faces, mine)
        few._ids = mine if self._ids is None else self._ids[mine]
        return few

    def _mask(self, hides: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
        mine = hides if hides is None or self._ids is None else hides[self._ids]
        return mine if mine is not None and mine.any() else None

    def closest(self, points: Float) -> tuple[Float, Int, Float]:
        """Nearest surface point of each of (N, 3) ``points``: distance (N,), face (N,), point (N, 3)."""
        if len(points) == 0:
            return np.empty(0), np.empty(0, dtype=np.int64), np.empty((0, 3))
        positions, faces, row = self._built.parts
        squared, face, nearest = self._built.tree.squared_distance(
            positions, faces, np.ascontiguousarray(points, dtype=np.float64)
        )
        return np.sqrt(squared), self._row(row[face]), nearest

    def first_hit(self, origins: Float, directions: Float, eye: Eye | None = None) -> tuple[Float, Int]:
        """First hit of each ray: distance in multiples of the direction's length (N,), inf where there is none,
        and face (N,), -1 where there is none.

        Args:
            origins: (N, 3).
            directions: (N, 3).
            eye: rays pass the faces that do not occlude from this end; none if None.
        """
        if len(origins) == 0:
            return np.empty(0), np.empty(0, dtype=np.int64)
        distance, face = self._cast(origins, directions)
        if eye is not None and self._hides is not None:
            self._pass(self._hides, origins, directions, eye, distance, face)
        return distance, np.where(face >= 0, self._row(face), -1)

    def _pass(
        self, hides: NDArray[np.uint8], origins: Float, directions: Float, eye: Eye, distance: Float, face: Int
    ) -> None:
        """Continue rays whose hits, ``distance`` (N,) and ``face`` (N,), do not occlude to the next hit, in place."""
        which = np.flatnonzero(face >= 0)
        for _ in range(PASSES):
            which = which[hides[face[which]] != Hides.ALWAYS]
            a, b, c = (self.positions[self.faces[face[which], corner]] for corner in range(3))
            back = np.einsum("ni,ni->n", cross(b - a, c - a), directions[which]) * eye > 0
            which = which[back | (hides[face[which]] == Hides.NEVER)]
            if not len(which):
                return
            length = np.maximum(np.linalg.norm(directions[which], axis=1), np.finfo(float).tiny)
            start = distance[which] + PASSED * self._built.extent / length
            beyond, face[which] = self._cast(origins[which] + start[:, None] * directions[which], directions[which])
            distance[which] = start + beyond
            which = which[face[which] >= 0]

    def _cast(self, origins: Float, directions: Float) -> tuple[Float, Int]:
        """First hit of each ray, its face as a row of ``self.faces``."""
        result = self._built.scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            output=True,
        )
        face = np.asarray(result["primID"], dtype=np.int64)
        return np.where(face >= 0, np.asarray(result["tfar"], dtype=np.float64), np.inf), face

    def normals(self, face: Int) -> Float:
        """(N, 3) unit normals of the faces ``face`` (N,), numbered as in hits; zero for collapsed ones."""
        mine = face if self._ids is None else np.searchsorted(self._ids, face)
        a, b, c = (self.positions[self.faces[mine, corner]] for corner in range(3))
        normal = cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(np.divide(normal, length, out=np.zeros_like(normal), where=length > 0))

    def _row(self, face: Int) -> Int:
        return face if self._ids is None else self._ids[face]


def _length(vectors: Float) -> Float:
    """(N,) lengths of (N, 3) vectors."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z))
