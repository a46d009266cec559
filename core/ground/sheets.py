"""The faces that make up the surface: neither collapsed ones nor second copies."""

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface

Bool = NDArray[np.bool_]
Hash = NDArray[np.uint64]

# Odd constants of splitmix64 (Steele, Lea, Flood 2014), as a source of well-mixed bits.
_MIX = tuple(np.uint64(constant) for constant in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def distinct_faces(surface: Surface, rank: NDArray[np.int64]) -> Bool:
    """(F,) the faces left when collapsed faces and all but one of coincident faces are set aside.

    A face is collapsed when two of its corners are one welded vertex. Faces are coincident when their corners lie
    at exactly the same three places, whatever their order and whatever node draws them: the two layers of a
    "double-sided" shell, or duplicates. Edges of such layers have four faces and no neighbours; those of one layer
    have two. What is set aside stays in the file as it is.

    Args:
        surface: the asset.
        rank: (F,) of coincident faces the one with the highest rank stays, else the first one.
    """
    corners = surface.weld[surface.faces]
    solid = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    ids = np.flatnonzero(solid)
    key = _mixed(surface.positions)[surface.faces[ids]].sum(axis=1, dtype=np.uint64)
    order = np.argsort(key)
    repeated = key[order][1:] == key[order][:-1]
    if not repeated.any():
        return np.asarray(solid)
    # A few candidates: told apart exactly, by the corners' sorted coordinates.
    involved = np.zeros(len(ids), dtype=bool)
    involved[order[1:][repeated]] = involved[order[:-1][repeated]] = True
    some = ids[involved]
    some = some[np.argsort(-rank[some], kind="stable")]
    _, point = np.unique(surface.positions[surface.faces[some]].reshape(-1, 3), axis=0, return_inverse=True)
    _, first = np.unique(np.sort(point.reshape(-1, 3), axis=1), axis=0, return_index=True)
    solid[some] = False
    solid[some[first]] = True
    return np.asarray(solid)


def _mixed(points: NDArray[np.float64]) -> Hash:
    """(N,) 64 mixed bits of each of (N, 3) points; equal points, 0.0 and -0.0 included, have equal bits."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)
    result = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        result = (result ^ bits[:, axis]) * _MIX[axis]
        result ^= result >> np.uint64(29)
    return result * _MIX[1]
