"""Constrained Delaunay triangulations of the plane, and the regions that their constraints enclose."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pythoncdt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Bool, Float, Int
from core.geometry.grouping import among
from core.geometry.segments import distance_to_edges
from core.geometry.triangles import doubled_area, inside_rings

_ON = 1e-9  # widths of the text from an edge to points on it, at most: rounding errors of crossings are far smaller
_AROUND = 3  # vertices of the triangle round all points, which come first


@dataclass(frozen=True, eq=False)
class Triangulation:
    """A constrained Delaunay triangulation.

    Attributes:
        points: (N, 2) those that were given; where constraints cross, new ones follow.
        triangles: (M, 3) into them, counter-clockwise.
        neighbours: (M, 3) the triangle beyond the side from each corner to the next; -1 where there is none.
    """

    points: Float
    triangles: Int
    neighbours: Int

    def left_of(self, edges: Int) -> Bool:
        """(M,) triangles on the left of the directed constraints ``edges`` (E, 2), and all that are joined to them
        without crossing one."""
        left = self._sides_on(edges)
        part = self._parts(left | self._sides_on(edges[:, ::-1]))
        return among(part, part[left.any(axis=1)])

    def inside(self, rings: Sequence[Float], edges: Int) -> Bool:
        """(M,) triangles inside plane ``rings`` (K, 2) by the even-odd rule, of which the constraints ``edges`` (E, 2)
        are the sides: each region between these is inside or outside as its largest triangle is."""
        # Where constraints cross there are points on them. Edges between such points, or from them to the ends of
        # others, are taken for walls: if they are none, a region is tested as two.
        is_end, on_edge = np.zeros((2, len(self.points)), dtype=bool)
        is_end[edges] = True
        on_edge[~is_end] = np.isfinite(distance_to_edges(self.points[~is_end], self.points[edges], _ON))
        start, end = self.triangles, self.triangles[:, [1, 2, 0]]
        walls = (on_edge[start] & (on_edge | is_end)[end]) | (on_edge[end] & is_end[start])
        part = self._parts(walls | self._sides_on(np.concatenate([edges, edges[:, ::-1]])))
        a, b, c = (self.points[self.triangles[:, corner]] for corner in range(3))
        ascending = np.argsort(doubled_area(a, b, c), kind="stable")
        largest = np.empty(int(part.max(initial=-1)) + 1, dtype=np.int64)
        largest[part[ascending]] = ascending  # the last one stays
        middle = (a[largest] + b[largest] + c[largest]) / 3
        return np.asarray(inside_rings(middle, rings)[part])

    def _parts(self, walls: Bool) -> Int:
        """(M,) a number for each group of triangles that are joined by sides other than the ``walls`` (M, 3)."""
        passed = ~walls & (self.neighbours >= 0)
        start = np.concatenate([[0], np.cumsum(np.count_nonzero(passed, axis=1))])
        to = self.neighbours[passed]
        graph = csr_array((np.ones(len(to)), to, start), shape=(len(passed), len(passed)))
        # All pairs go both ways: what is strongly connected is connected, and is found without their transpose.
        return np.asarray(connected_components(graph, connection="strong")[1], dtype=np.int64)

    def _sides_on(self, edges: Int) -> Bool:
        """(M, 3) sides of the triangles that are among the directed ``edges`` (E, 2)."""
        is_end = np.zeros((2, len(self.points)), dtype=bool)
        is_end[0, edges[:, 0]] = is_end[1, edges[:, 1]] = True
        start, end = self.triangles.ravel(), self.triangles[:, [1, 2, 0]].ravel()
        result = is_end[0, start] & is_end[1, end]
        both, size = np.flatnonzero(result), len(self.points)
        result[both] = among(start[both] * size + end[both], edges[:, 0] * size + edges[:, 1])
        return np.asarray(result.reshape(-1, 3))


def triangulated(points: Float, constraints: Int) -> Triangulation | None:
    """The triangulation of (N, 2) ``points`` with the edges ``constraints`` (E, 2), over their convex hull; None where
    constraints cross closer than numbers can tell."""
    triangulation = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE, 0.0
    )
    keys = np.unique(constraints.min(axis=1) * len(points) + constraints.max(axis=1))
    vertices: Any = np.ascontiguousarray(points)  # the bindings' types do not know that arrays are buffers
    edges: Any = np.column_stack(np.divmod(keys, len(points))).astype(np.uintc)
    try:
        triangulation.insert_vertices(vertices)
        triangulation.insert_edges(edges)
    except RuntimeError:
        return None
    found, around = triangulation.vertices_array(copy=False), triangulation.triangles_array(copy=False)
    corners = around["vertices"].astype(np.int64) - _AROUND
    within = np.flatnonzero((corners >= 0).all(axis=1))
    number = np.full(len(corners) + 1, -1)  # the last one stands for no neighbour
    number[within] = np.arange(len(within))
    neighbours = number[np.minimum(around["neighbors"][within], len(corners))]
    return Triangulation(
        points=np.column_stack([found["x"], found["y"]])[_AROUND:],
        triangles=corners[within],
        neighbours=neighbours,
    )
