"""Oriented boxes: the bounds of watermarks before they are embossed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.geometry.products import product


@dataclass(frozen=True, eq=False)
class Boxes:
    """B oriented boxes in the size-30 frame.

    Attributes:
        center: (B, 3), on the surface (the surface passes through the middle of the box).
        axes: (B, 3, 3) rows: right (the reading direction), up, normal (facing outwards); right x up = normal.
        size: (B, 3) full width, height and thickness along these axes.
    """

    center: Float
    axes: Float
    size: Float

    @classmethod
    def empty(cls) -> "Boxes":
        """No boxes."""
        return cls(np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, 3)))

    @classmethod
    def concat(cls, *parts: "Boxes") -> "Boxes":
        """The boxes of all parts, one part after another."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("center", "axes", "size")))

    def __len__(self) -> int:
        return len(self.center)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "Boxes":
        return Boxes(self.center[index], self.axes[index], self.size[index])

    def corners(self) -> Float:
        """(B, 8, 3) corners; the first four are the back face, the last four the front (+normal) face."""
        signs = np.array(
            [[x, y, z] for z in (-0.5, 0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
        )
        local = signs[None] * self.size[:, None, :]
        return np.asarray(np.einsum("bki,bij->bkj", local, self.axes) + self.center[:, None, :])

    def to_local(self, index: int, points: Float) -> Float:
        """(N, 3) points in the frame of box ``index``: x right, y up, z along the normal, origin at its centre."""
        return np.asarray(product(points - self.center[index], self.axes[index].T))

    def to_frame(self, offset: Float, scale: float) -> "Boxes":
        """Boxes of world coordinates in a size-30 frame, see :class:`core.geometry.surface.Surface`."""
        return Boxes((self.center - offset) * scale, self.axes, self.size * scale)

    def contained(self, points: cKDTree) -> tuple[Int, Int, Float]:
        """Pairs of a box and a point inside it: the box (P,), the point (P,), and where it lies in the box's frame, as
        :meth:`to_local` has it (P, 3). Ordered by box, then by point."""
        found = points.query_ball_point(self.center, np.linalg.norm(self.size, axis=1) / 2, return_sorted=True)
        box = np.repeat(np.arange(len(self)), [len(item) for item in found])
        point = np.concatenate([np.empty(0, dtype=np.int64), *(np.asarray(item, dtype=np.int64) for item in found)])
        offset = np.asarray(points.data)[point] - self.center[box]
        local = np.einsum("ni,nji->nj", offset, self.axes[box])
        inside = (np.abs(local) <= self.size[box] / 2).all(axis=1)
        return box[inside], point[inside], local[inside]


def unit_grid(counts: tuple[int, int]) -> Float:
    """(N, 2) points of a grid over the unit square about the origin, its corners included; the second axis runs
    fastest."""
    u, v = np.meshgrid(*(np.linspace(-0.5, 0.5, count) for count in counts), indexing="ij")
    return np.stack([u.ravel(), v.ravel()], axis=1)
