"""The faces that make up the surface: neither collapsed ones nor second copies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Int
from core.geometry.surface import Surface

Hash = NDArray[np.uint64]

# Odd constants of splitmix64 (Steele, Lea, Flood 2014), as a source of well-mixed bits.
_MIX = tuple(np.uint64(constant) for constant in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


@dataclass(frozen=True, eq=False)
class CoincidentFaces:
    """The coincident faces of a surface, and the one of each group that counts.

    Faces are coincident when their corners lie at exactly the same three places, whatever their order and whatever
    node draws them: the two layers of a "double-sided" shell, or duplicates. Edges of such layers have four faces
    and no neighbours; those of one layer have two.

    Attributes:
        distinct: (F,) faces left when collapsed ones (two corners are one welded vertex) and all but one of
            coincident ones are set aside.
        copies: (C, 2) a distinct face, and one that coincides with it and was set aside.
        duplicates: (D, 2) a distinct face, and one with the same welded corners and winding, which may be removed
            together with the kept face. Sorted.
        has_reversed_copy: (F,) distinct faces with a coincident one of the same welded corners and the opposite
            winding: a second layer that is not removed.
        has_remaining_copy: (F,) distinct faces with any coincident face that is not removed with them.
        not_cuttable: (F,) distinct faces not to be cut: they have duplicates and a boundary edge, and with both
            removed an edge of two faces would be left with one.
    """

    distinct: Bool
    copies: Int
    duplicates: Int
    has_reversed_copy: Bool
    has_remaining_copy: Bool
    not_cuttable: Bool


def single_layer(faces: int) -> CoincidentFaces:
    """Every one of ``faces`` faces is distinct."""
    none, no_pairs = np.zeros(faces, dtype=bool), np.empty((0, 2), dtype=np.int64)
    return CoincidentFaces(~none, no_pairs, no_pairs, none, none, none)


def find_coincident(surface: Surface, rank: Int) -> CoincidentFaces:
    """The :class:`CoincidentFaces` of a surface; of coincident faces the one with the highest ``rank`` (F,) is the
    distinct one, else the first."""
    corners = surface.weld[surface.faces]
    distinct = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    twinned, covered = np.zeros(len(corners), dtype=bool), np.zeros(len(corners), dtype=bool)
    some = _repeated(surface, np.flatnonzero(distinct))
    some = some[np.argsort(-rank[some], kind="stable")]
    _, point = np.unique(surface.positions[surface.faces[some]].reshape(-1, 3), axis=0, return_inverse=True)
    _, first, group = np.unique(np.sort(point.reshape(-1, 3), axis=1), axis=0, return_index=True, return_inverse=True)
    kept = some[first][group.ravel()]
    copy, of = some[some != kept], kept[some != kept]
    distinct[copy] = False

    turns = np.stack([np.roll(corners[of], turn, axis=1) for turn in range(3)])
    is_duplicate = (turns == corners[copy]).all(axis=2).any(axis=0)
    is_twin = (turns == corners[copy][:, ::-1]).all(axis=2).any(axis=0)
    twinned[of[is_twin]] = True
    covered[of[~is_duplicate]] = True
    pairs = np.column_stack([of, copy])[is_duplicate]
    pinned = np.zeros(len(corners), dtype=bool)
    if len(pairs):
        pinned[pairs[:, 0]] = True
        pinned &= _has_boundary_edge(surface, distinct)
    duplicates = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return CoincidentFaces(distinct, np.column_stack([of, copy]), duplicates, twinned, covered, pinned)


def _has_boundary_edge(surface: Surface, distinct: Bool) -> Bool:
    """(F,) which of the ``distinct`` (F,) faces have an edge that no other of them has."""
    edges = surface.edges.among(distinct)
    result = np.zeros(len(distinct), dtype=bool)
    result[edges.sides[edges.first[edges.uses == 1]] // 3] = True
    return result


def _repeated(surface: Surface, ids: Int) -> Int:
    """Those of the faces ``ids`` that some other face shares its three places with; a hash may add a few more."""
    key = _mixed(surface.positions)[surface.faces[ids]].sum(axis=1, dtype=np.uint64)
    order = np.argsort(key)
    same = key[order][1:] == key[order][:-1]
    involved = np.zeros(len(ids), dtype=bool)
    involved[order[1:][same]] = involved[order[:-1][same]] = True
    return ids[involved]


def _mixed(points: NDArray[np.float64]) -> Hash:
    """(N,) 64 mixed bits of each of (N, 3) points; equal points, 0.0 and -0.0 included, have equal bits."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)
    result = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        result = (result ^ bits[:, axis]) * _MIX[axis]
        result ^= result >> np.uint64(29)
    return result * _MIX[1]
