"""Laplacian smoothing."""

import numpy as np
from scipy.sparse import coo_array, diags_array

from core.asset.plain import Mesh
from core.attacks.target import Attacked, Target, whole

STEP = 0.5  # ten such steps smooth as much as the fifty of 0.1 that Wang et al. (2010) benchmark watermarks with


def smooth(mesh: Mesh, target: Target, strength: float = 10) -> Attacked:
    """Moves every vertex half of the way to the mean of its neighbours, all at once, again and again.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number.
        strength: iterations, rounded to a whole number.
    """
    ends = (
        np.concatenate([mesh.faces, np.roll(mesh.faces, -1, axis=1)]),
        np.concatenate([np.roll(mesh.faces, -1, axis=1), mesh.faces]),
    )
    rows, columns = (end.ravel() for end in ends)
    count = len(mesh.positions)
    adjacent = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    adjacent.data[:] = 1.0  # an edge counts once however many faces share it
    degree = adjacent.sum(axis=1)
    mean = diags_array(np.divide(1.0, degree, out=np.zeros(count), where=degree > 0)) @ adjacent
    positions = mesh.positions
    for _ in range(round(strength)):
        positions = positions + STEP * (mean @ positions - positions)
    return whole(Mesh(np.asarray(positions), mesh.faces), target)
