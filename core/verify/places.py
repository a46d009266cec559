"""Places on a surface where something was read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from core.arrays import Int
from core.verify.readings import Reading, Spot

# Readings are of one place whose middles are nearer than this share of the shorter one's length, on surface that looks
# the same way within 60 degrees.
NEAR, ALIKE = 0.5, 0.5


@dataclass(frozen=True, eq=False)
class Place:
    """Surface on which something was read.

    Attributes:
        readings: of it.
        spot: that of the surest one.
    """

    readings: tuple[Reading, ...]
    spot: Spot


def places(found: Sequence[Reading]) -> list[Place]:
    """The readings by place."""
    if not found:
        return []
    order = _labels(found)
    return [
        _place([found[number] for number in np.flatnonzero(order == label).tolist()]) for label in range(max(order) + 1)
    ]


def _labels(found: Sequence[Reading]) -> Int:
    center, normal = (np.array([getattr(one.spot, name) for one in found]) for name in ("center", "normal"))
    length = np.array([one.spot.length for one in found])
    pairs = cKDTree(center).query_pairs(NEAR * float(length.max()), output_type="ndarray")
    one, other = pairs[:, 0], pairs[:, 1]
    apart = np.linalg.norm(center[one] - center[other], axis=1)
    same = (apart < NEAR * np.minimum(length[one], length[other])) & (
        np.einsum("pi,pi->p", normal[one], normal[other]) > ALIKE
    )
    graph = coo_array((np.ones(same.sum()), (one[same], other[same])), shape=(len(found), len(found)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _place(mine: list[Reading]) -> Place:
    best = max(mine, key=lambda one: one.confidence * len(one.text))
    return Place(tuple(mine), best.spot)
