"""Closed rings of points, side by side in one array."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.products import length as length_of


@dataclass(frozen=True, eq=False)
class Rings:
    """Closed rings in the plane, one after another.

    Attributes:
        points: (N, 2), each the start of a side.
        sizes: (R,) number of points of each ring.
    """

    points: Float
    sizes: Int

    @classmethod
    def of(cls, rings: Sequence[Float]) -> "Rings":
        """Those with the points (N, 2) of each of the ``rings``, at least one."""
        return cls(np.concatenate(rings), np.array([len(ring) for ring in rings]))

    @property
    def ahead(self) -> Int:
        """(N,) the number of the next point of the same ring."""
        result = np.arange(1, len(self.points) + 1)
        end = np.cumsum(self.sizes)
        result[end - 1] = end - self.sizes
        return result

    def longer(self, length: float) -> Bool:
        """(N,) sides longer than ``length``."""
        return np.asarray(length_of(self.points[self.ahead] - self.points) > length)

    def with_points(self, sides: Int, points: Float) -> "Rings":
        """The rings with (K, 2) ``points`` between the ends of the ``sides`` (K,)."""
        ring = np.repeat(np.arange(len(self.sizes)), self.sizes)[sides]
        sizes = self.sizes + np.bincount(ring, minlength=len(self.sizes))
        return Rings(np.insert(self.points, sides + 1, points, axis=0), sizes)

    def separate(self) -> list[Float]:
        """The points (N, 2) of each ring."""
        return np.split(self.points, np.cumsum(self.sizes)[:-1])
