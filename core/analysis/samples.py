"""Samples of a surface that carry values, and their means inside boxes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.geometry.boxes import Boxes

FEWEST = 8  # samples that the mean of a box is taken over, at least
NEAREST = 64  # samples around a box with too few, among which these are chosen


@dataclass(frozen=True, eq=False)
class Pairs:
    """Boxes and the samples under them, see :meth:`SurfaceSamples.pairs_in_boxes`.

    Attributes:
        box: (P,) the box of each pair.
        sample: (P,) the sample of each.
        boxes: number of all boxes.
    """

    box: Int
    sample: Int
    boxes: int

    @cached_property
    def samples(self) -> Int:
        """(B,) number of samples under each box, at least 1."""
        return np.maximum(np.bincount(self.box, minlength=self.boxes), 1)

    def mean(self, values: Float) -> Float:
        """(B, K) means of ``values`` (N, K) over the samples under each of B boxes."""
        total = [np.bincount(self.box, weights=column[self.sample], minlength=self.boxes) for column in values.T]
        return np.column_stack(total) / self.samples[:, None]


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on a surface.

    Attributes:
        points: (N, 3) float64, size-30 units.
        normals: (N, 3) float64, unit, of the face that each point lies on.
    """

    points: Float
    normals: Float

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def pairs_in_boxes(self, boxes: Boxes) -> Pairs:
        """Pairs of a box and a sample inside it.

        Points whose normals point away from the box are on the far side of thin geometry and do not count. A box with
        fewer than 8 points inside, smaller than the spacing of the samples, has the 8 nearest to its centre whose
        normals point towards it.
        """
        owner, which = self._inside(boxes)
        count = np.bincount(owner, minlength=len(boxes))
        few = np.flatnonzero(count < FEWEST)
        if len(few):
            kept = count[owner] >= FEWEST
            nearest = self._nearest(boxes[few])
            owner = np.concatenate([owner[kept], np.repeat(few, nearest.shape[1])])
            which = np.concatenate([which[kept], nearest.ravel()])
        return Pairs(owner, which, len(boxes))

    def _inside(self, boxes: Boxes) -> tuple[Int, Int]:
        """Pairs of a box and a point inside it whose normal points towards it: (P,), (P,)."""
        owner, which, _ = boxes.contained(self._tree)
        toward = np.einsum("ni,ni->n", self.normals[which], boxes.axes[owner, 2]) > 0
        return owner[toward], which[toward]

    def _nearest(self, boxes: Boxes) -> Int:
        """(B, 8) the points nearest to each centre whose normals point towards the box; others only where these are too
        few."""
        _, near = self._tree.query(boxes.center, k=min(NEAREST, len(self.points)))
        toward = np.einsum("bni,bi->bn", self.normals[near], boxes.axes[:, 2])
        order = np.argsort(toward <= 0, axis=1, kind="stable")  # each group stays sorted by distance
        return np.asarray(np.take_along_axis(near, order[:, :FEWEST], axis=1), dtype=np.int64)
