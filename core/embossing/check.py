"""The local check after each watermark: the new faces must fit the hole edge by edge."""

import numpy as np

from core.arrays import Bool, Int
from core.geometry.edges import directed_edges

_OLD, _NEW, _RIM = 0, 1, 2  # origins of edges


def is_closed(removed: Int, boundary: Int, added: Int) -> bool:
    """True where (M, 3) ``added`` triangles replace (K, 3) ``removed`` ones without changing the topology around them.

    Each edge has the same number of directed uses, net of its opposite, in the added as in the removed faces; the
    removed patch's ``boundary`` edges (E, 2) keep their number of faces; and every other edge of the added faces has
    exactly two. All arguments are in the mesh's topological vertices.
    """
    size = int(max(removed.max(), added.max())) + 1
    old, new = directed_edges(removed), directed_edges(added)
    start, end = np.concatenate([old, new, boundary]).T
    origin = np.repeat([_OLD, _NEW, _RIM], [len(old), len(new), len(boundary)])
    # One number for an edge, its direction and its origin: numbers are sorted in a fraction of the time of their order.
    numbers = np.sort(((np.minimum(start, end) * size + np.maximum(start, end)) * 2 + (start < end)) * 4 + origin)
    first = np.flatnonzero(np.diff(numbers >> 3, prepend=-1))
    upward = np.where(numbers & 4, 1, -1)
    is_old, is_new, is_rim = (numbers & 3 == each for each in (_OLD, _NEW, _RIM))

    def tally(weight: Int | Bool) -> Int:
        return np.add.reduceat(weight, first, dtype=np.int64)

    if np.any(tally(upward * is_old) != tally(upward * is_new)):
        return False
    old_uses, new_uses, on_rim = tally(is_old), tally(is_new), tally(is_rim) > 0
    if np.any(old_uses[on_rim] != new_uses[on_rim]):
        return False
    degenerate = (added[:, 0] == added[:, 1]) | (added[:, 1] == added[:, 2]) | (added[:, 2] == added[:, 0])
    inner = new_uses[~on_rim]
    return bool(not degenerate.any() and np.all((inner == 2) | (inner == 0)))
