"""Edges and connected components, read through the weld."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.asset.surface import Surface

Int = NDArray[np.int64]


@dataclass(frozen=True)
class Topology:
    """Counts on the welded surface; faces that collapse to a line or a point in the weld are left out.

    Attributes:
        components: groups of faces connected through shared edges (a shared vertex does not connect).
        boundary_edges: edges of one face.
        nonmanifold_edges: edges of more than two faces.
    """

    components: int
    boundary_edges: int
    nonmanifold_edges: int

    @property
    def watertight(self) -> bool:
        """Whether every edge has exactly two faces."""
        return self.boundary_edges == 0 and self.nonmanifold_edges == 0


def topology(surface: Surface) -> Topology:
    """The :class:`Topology` of a surface."""
    corners = surface.weld[surface.faces]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    low = np.minimum(corners, np.roll(corners, -1, axis=1)).ravel()
    high = np.maximum(corners, np.roll(corners, -1, axis=1)).ravel()
    key = low * (surface.weld.max(initial=0) + 1) + high
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    _, count = np.unique(key[order], return_counts=True)
    # Neighbours in the sorted list that have the same edge are faces that share it.
    one, two = order[:-1][same] // 3, order[1:][same] // 3
    graph = coo_array((np.ones(len(one), dtype=np.int8), (one, two)), shape=(len(corners), len(corners)))
    components = connected_components(graph, directed=False, return_labels=False) if len(corners) else 0
    return Topology(int(components), int((count == 1).sum()), int((count > 2).sum()))
