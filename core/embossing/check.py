"""The local check after each watermark: the new faces must fit the hole edge by edge."""

import numpy as np

from core.arrays import Bool, Int
from core.geometry.edges import directed_edges


def is_closed(removed: Int, boundary: Int, added: Int) -> bool:
    """True where (M, 3) ``added`` triangles replace (K, 3) ``removed`` ones without changing the topology around them.

    Each edge has the same number of directed uses, net of its opposite, in the added as in the removed faces; the
    removed patch's ``boundary`` edges (E, 2) keep their number of faces; and every other edge of the added faces has
    exactly two. All arguments are in the mesh's topological vertices.
    """
    size = int(max(removed.max(), added.max())) + 1
    old, new = directed_edges(removed), directed_edges(added)
    both = np.concatenate([old, new, boundary])
    key = np.minimum(*both.T) * size + np.maximum(*both.T)
    order = np.argsort(key)
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    upward = np.where(both[order, 0] < both[order, 1], 1, -1)
    is_old, is_new = order < len(old), (order >= len(old)) & (order < len(old) + len(new))
    is_rim = order >= len(old) + len(new)

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
