"""Edges and connected components, read through the weld."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.geometry.surface import Surface


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
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    start, end = corners.ravel(), corners[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * (surface.weld.max(initial=0) + 1) + np.maximum(start, end)
    order = np.argsort(key)
    key = key[order]
    same = key[1:] == key[:-1]
    count = np.diff(np.flatnonzero(np.concatenate([[True], ~same, [True]]))) if len(key) else np.empty(0)
    # Neighbours in the sorted list that have the same edge are faces that share it.
    pair = (np.stack([order[:-1][same], order[1:][same]]) // 3).astype(np.int32)  # half the time of 64 bits
    graph = coo_array((np.ones(pair.shape[1], dtype=np.int8), tuple(pair)), shape=(len(corners), len(corners))).tocsr()
    components = connected_components(graph, directed=False, return_labels=False) if len(corners) else 0
    return Topology(int(components), int((count == 1).sum()), int((count > 2).sum()))
