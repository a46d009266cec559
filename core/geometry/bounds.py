"""Pairs of axis-parallel boxes that meet."""

from collections.abc import Iterator

import numpy as np

from core.arrays import Float, Int

_BLOCK = 2**20  # pairs worked on at a time: bounds the memory where each box meets many


def meeting(low: Float, high: Float, other_low: Float, other_high: Float) -> Iterator[tuple[Int, Int]]:
    """The pairs (P,), (P,) of boxes ``low``-``high`` (N, K each) and others (E, K each) that meet, in blocks by
    ascending number of the other one; points are boxes of no size."""
    if not len(low) or not len(other_low):
        return
    axis = int(np.argmax([along.max() - along.min() for along in low.T]))
    order = np.argsort(low[:, axis])
    left, reach = low[order, axis], (high[:, axis] - low[:, axis]).max()
    first = np.searchsorted(left, other_low[:, axis] - reach)
    count = np.searchsorted(left, other_high[:, axis], side="right") - first
    block = np.cumsum(count) // _BLOCK
    for others in np.split(np.arange(len(count)), np.flatnonzero(np.diff(block)) + 1):
        sizes = count[others]
        other = np.repeat(others, sizes)
        place = np.arange(len(other)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        box = order[np.repeat(first[others], sizes) + place]
        for column in range(low.shape[1]):
            meet = high[box, column] >= other_low[other, column]
            meet &= low[box, column] <= other_high[other, column]
            box, other = box[meet], other[meet]
        yield box, other
