"""Edges and connected components, read through the weld."""

from dataclasses import dataclass

import numpy as np

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
        """True where every edge has exactly two faces."""
        return self.boundary_edges == 0 and self.nonmanifold_edges == 0


def topology(surface: Surface) -> Topology:
    """The :class:`Topology` of a surface."""
    a, b, c = surface.weld[surface.faces].T
    whole = (a != b) & (b != c) & (c != a)
    edges = surface.edges.among(whole)
    apart = int(edges.components().max(initial=-1)) + 1  # a face that is left out is connected to nothing
    return Topology(
        apart - int(np.count_nonzero(~whole)),
        int(np.count_nonzero(edges.uses == 1)),
        int(np.count_nonzero(edges.uses > 2)),
    )
