"""Laplacian smoothing."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Float
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh

STEP = 0.5  # share of the way to the mean: ten steps smooth as much as the fifty of 0.1 of Wang et al. (2010)


def smooth(mesh: Mesh, target: Target, strength: float = 10) -> Attacked:
    """Moves every vertex half of the way to the mean of its neighbours, all at once, again and again.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number.
        strength: iterations, rounded to a whole number.
    """
    return whole(Mesh(relaxed(mesh, [STEP] * round(strength)), mesh.faces), target)


def relaxed(mesh: Mesh, steps: Sequence[float]) -> Float:
    """(V, 3) positions of vertices that go each of the ``steps``, in shares of the way to the mean of their neighbours,
    one after the other, all at once."""
    count = len(mesh.positions)
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    # An edge counts once, independent of the number of its faces; one from a vertex to itself does not count.
    rows, columns = np.divmod(np.unique(np.concatenate([start * count + end, end * count + start])), count)
    rows, columns = rows[rows != columns], columns[rows != columns]
    degree = np.bincount(rows, minlength=count)
    mean = csr_array((1 / degree[rows], (rows, columns)), shape=(count, count))
    joined = (degree > 0)[:, None]
    positions = mesh.positions
    for step in steps:
        positions = positions + step * (mean @ positions - positions * joined)
    return np.asarray(positions)
