"""The working surface: every triangle of an asset in one pair of arrays, in the size-30 frame."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from core.arrays import Float, Int
from core.geometry.edges import EdgeTable, edge_table
from core.geometry.products import cross

MODEL_SIZE = 30.0


@dataclass(frozen=True, eq=False)
class Surface:
    """All triangles of an asset, flattened to world space and normalised to size 30 about the origin.

    Attributes:
        positions: (V, 3) float64, ``(world - offset) * scale``. Rows are the accessor rows of each drawn
            primitive one after another: nothing is merged, so each row maps back to one accessor row.
        faces: (F, 3) int64 into ``positions``.
        weld: (V,) int64, the same number for vertices of one node at exactly equal positions; topology is read
            through ``weld[faces]``.
        face_primitive: (F,) int64, number of each face's drawn primitive (node x mesh primitive).
        face_triangle: (F,) int64, number of its triangle in that primitive.
        scale: size-30 units per world unit.
        offset: (3,) world position of the size-30 origin.
    """

    positions: Float
    faces: Int
    weld: Int
    face_primitive: Int
    face_triangle: Int
    scale: float
    offset: Float

    @cached_property
    def edges(self) -> EdgeTable:
        """The edges of the faces, read through the weld."""
        return edge_table(self.weld[self.faces])

    @cached_property
    def _cross(self) -> Float:
        a, b, c = (self.positions.take(self.faces[:, corner], axis=0) for corner in range(3))
        return cross(b - a, c - a)

    @cached_property
    def areas(self) -> Float:
        """(F,) face areas."""
        return np.asarray(np.linalg.norm(self._cross, axis=1) / 2)

    @cached_property
    def normals(self) -> Float:
        """(F, 3) unit face normals; zero for degenerate faces."""
        length = np.linalg.norm(self._cross, axis=1, keepdims=True)
        return np.asarray(np.divide(self._cross, length, out=np.zeros_like(self._cross), where=length > 0))

    @property
    def reach(self) -> float:
        """Largest absolute coordinate in the frame, rounding included; size-30 units."""
        return MODEL_SIZE / 2 * (1 + 1e-6)

    @cached_property
    def radius(self) -> float:
        """Distance of the farthest drawn point from the middle of the frame, size-30 units."""
        drawn = np.zeros(len(self.positions), dtype=bool)
        drawn[self.faces] = True
        used = self.positions[drawn]
        used = used[np.abs(used).max(axis=1) <= self.reach]
        return float(np.linalg.norm(used, axis=1).max(initial=0.0))

    def to_world(self, points: Float) -> Float:
        """(N, 3) size-30 points as world points."""
        return np.asarray(points / self.scale + self.offset)

    def in_frame_of(self, other: "Surface") -> "Surface":
        """This surface in the size-30 frame of ``other``: a watermarked asset is measured in its original's frame."""
        positions = (self.to_world(self.positions) - other.offset) * other.scale
        return replace(self, positions=positions, scale=other.scale, offset=other.offset)
