"""The local check after each watermark: the new faces must fit the hole edge by edge."""

import numpy as np

from core.arrays import Int
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
    key, which = np.unique(both.min(axis=1) * size + both.max(axis=1), return_inverse=True)
    sign = np.where(both[:, 0] < both[:, 1], 1, -1)
    is_old = np.arange(len(both)) < len(old)
    is_new = ~is_old & (np.arange(len(both)) < len(old) + len(new))

    def tally(weight: Int) -> Int:
        return np.bincount(which, weights=weight, minlength=len(key)).astype(np.int64)

    if np.any(tally(sign * is_old) != tally(sign * is_new)):
        return False
    old_uses, new_uses = tally(is_old.astype(np.int64)), tally(is_new.astype(np.int64))
    is_boundary = np.zeros(len(key), dtype=bool)
    is_boundary[which[len(old) + len(new) :]] = True
    if np.any(old_uses[is_boundary] != new_uses[is_boundary]):
        return False
    degenerate = (added[:, 0] == added[:, 1]) | (added[:, 1] == added[:, 2]) | (added[:, 2] == added[:, 0])
    inner = new_uses[~is_boundary]
    return bool(not degenerate.any() and np.all((inner == 2) | (inner == 0)))
