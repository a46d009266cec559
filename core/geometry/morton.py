"""Order along a space-filling curve: neighbours in space are neighbours in the file."""

import numpy as np
from numpy.typing import NDArray

BITS = 21  # bits an axis; three fit 63


def morton_order(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) the order of ``points`` (N, 3) along a Morton curve (Z-order; Morton 1966) over their bounding box.

    Points of one cell come in a random order, the same for the same number of points: their order before does not show.
    """
    if not len(points):
        return np.empty(0, dtype=np.int64)
    finite = np.nan_to_num(points)
    low, high = (np.array([bound(axis) for axis in finite.T]) for bound in (np.min, np.max))
    extent = float((high - low).max())
    cell = ((finite - low) * ((2**BITS - 1) / extent if extent > 0 else 0.0)).astype(np.uint64)
    code = _spread(cell[:, 0]) | _spread(cell[:, 1]) << np.uint64(1) | _spread(cell[:, 2]) << np.uint64(2)
    shuffled = np.random.default_rng(0).permutation(len(points))
    code = code[shuffled]
    order = np.argsort(code)  # not stable, but several times as fast
    code = code[order]
    equal = np.flatnonzero(np.concatenate([[False], code[1:] == code[:-1]]))
    tied = np.unique(np.concatenate([equal - 1, equal]))
    order[tied] = order[tied][np.lexsort((order[tied], code[tied]))]
    return np.asarray(shuffled[order])


def _spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """21-bit numbers with two zero bits after each of theirs."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
