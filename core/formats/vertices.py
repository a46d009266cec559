"""Vertices of exports: those of the input with its very numbers, and rows of one point as one vertex."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Float, Int
from core.geometry.grouping import float_words, group_rows, weld


def restored(positions: Float, original: Float, origin: Float) -> Float:
    """(V, 3) positions with the numbers of the input where they are its own, rounded to 32 bits as glTF stores them;
    all others as the shortest decimals that round to the same.

    Args:
        positions: (V, 3), 32-bit values relative to the origin.
        original: (N, 3) positions of the input.
        origin: (3,) in the coordinates of the input.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # those that no face uses may be anything
        single = (original - origin).astype(np.float32)
    label = group_rows(float_words(np.concatenate([single, positions.astype(np.float32)])))
    source = np.full(int(label.max(initial=-1)) + 1, -1)
    source[label[: len(original)][::-1]] = np.arange(len(original))[::-1]  # the first of equal ones
    found = source[label[len(original) :]]
    return np.where((found >= 0)[:, None], original[found], shortest(positions) + origin)


def shortest(values: Float) -> Float:
    """The same 32-bit values as the doubles of the fewest digits that round to them: 0.1 instead of 0.10000000149."""
    single = values.astype(np.float32)
    result = values.astype(np.float64)
    pending = np.isfinite(result) & (result != 0) & (np.rint(result) != result)
    for digits in (6, 7, 8):
        at = np.nonzero(pending)
        exact = result[at]
        scale = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(exact))))
        rounded = np.rint(exact * scale) / scale
        same = rounded.astype(np.float32) == single[at]
        result[tuple(axis[same] for axis in at)] = rounded[same]
        pending[tuple(axis[same] for axis in at)] = False
    return result


def joined(positions: Float, faces: Int) -> tuple[Int, Int]:
    """Number the vertices of faces (T, 3) whose rows (V, 3) are divided where normals, texture or colour change.

    Rows of one point become one vertex where two faces meet in an edge of both. Where more meet, as where solids touch,
    they stay apart as they are: no edge gets more faces than the rows give it.

    Returns:
        (V,) the vertex of each row, and (N,) the first row of each vertex; rows that no face uses have none (-1).
    """
    point = weld(positions)
    starts, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    a, b = point[starts], point[ends]
    code = np.minimum(a, b) * (int(point.max(initial=0)) + 1) + np.maximum(a, b)
    order = np.argsort(code, kind="stable")
    start = np.flatnonzero(np.diff(code[order], prepend=-1))
    pairs = start[np.diff(start, append=len(order)) == 2]
    one, two = order[pairs], order[pairs + 1]
    opposite = (a[one] == b[two]) & (a[one] != b[one])
    one, two = one[opposite], two[opposite]
    rows = np.concatenate([starts[one], ends[one]])
    others = np.concatenate([ends[two], starts[two]])
    apart = rows != others
    count = len(positions)
    graph = coo_array((np.ones(apart.sum(), bool), (rows[apart], others[apart])), shape=(count, count))
    group = connected_components(graph, directed=False)[1]
    used = np.unique(faces)
    _, first, number = np.unique(group[used], return_index=True, return_inverse=True)
    by_row = np.argsort(first)  # vertices in the order of their rows
    rank = np.empty(len(first), dtype=np.int64)
    rank[by_row] = np.arange(len(first))
    vertex = np.full(count, -1)
    vertex[used] = rank[number]
    return vertex, used[first[by_row]]
