"""Oriented boxes: the stand-ins for watermarks until they are embossed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
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


def join(one: Boxes, other: Boxes) -> Boxes:
    """The boxes of both; those of ``one`` keep their numbers."""
    return Boxes(
        np.concatenate([one.center, other.center]),
        np.concatenate([one.axes, other.axes]),
        np.concatenate([one.size, other.size]),
    )
