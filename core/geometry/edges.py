"""The edges of triangles.

A side of a triangle is numbered ``3 * face + k`` and runs from its corner k to the next one. Sides between the same two
vertices lie on one edge, whichever way they run.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Bool, Int
from core.geometry.grouping import among


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The edges of triangles and the sides on each, sorted once.

    Attributes:
        sides: (S,) numbers of sides, edge by edge, ascending within each; edges come in the order of their lower
            vertex, then of their higher one.
        first: (E,) offset in ``sides`` of each edge's first side.
        uses: (E,) number of sides on each edge.
        ends: (E, 2) its vertices, the lower number first.
        upward: (S,) by row of ``sides``, true where the side runs from the lower vertex to the higher one.
        faces: the number of faces.
    """

    sides: Int
    first: Int
    uses: Int
    ends: Int
    upward: Bool
    faces: int

    @cached_property
    def edge(self) -> Int:
        """(3F,) the edge that each side lies on; -1 for sides of faces that :meth:`among` left out."""
        result = np.full(3 * self.faces, -1)
        result[self.sides] = np.repeat(np.arange(len(self.uses)), self.uses)
        return result

    def pairs(self) -> tuple[Int, Int, Bool]:
        """The two sides (P,), (P,) on each edge of exactly two; (P,) true where they run opposite ways, as in faces of
        consistent winding."""
        row = self.first[self.uses == 2]
        return self.sides[row], self.sides[row + 1], self.upward[row] != self.upward[row + 1]

    def components(self) -> Int:
        """(F,) a number for each group of faces connected through edges, whatever number of faces an edge has."""
        following = np.ones(len(self.sides), dtype=bool)
        following[self.first] = False
        row = np.flatnonzero(following)
        return connected(self.faces, self.sides[row - 1] // 3, self.sides[row] // 3)

    def among(self, faces: Bool) -> "EdgeTable":
        """The edges of those of the faces (F,) alone; sides, vertices and faces keep their numbers."""
        if faces.all():
            return self
        kept = faces[self.sides // 3]
        uses = np.add.reduceat(kept, self.first, dtype=np.int64) if len(self.first) else self.uses
        left = uses > 0
        return EdgeTable(
            self.sides[kept],
            np.cumsum(uses[left]) - uses[left],
            uses[left],
            self.ends[left],
            self.upward[kept],
            self.faces,
        )


def edge_table(triangles: Int) -> EdgeTable:
    """The :class:`EdgeTable` of (F, 3) triangles of vertex numbers."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    count = int(triangles.max(initial=0)) + 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    sides = np.argsort(key)
    key = key[sides]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]])) if len(key) else np.empty(0, dtype=np.int64)
    uses = np.diff(np.append(first, len(key)))
    # The sort is the fastest one, which does not keep the order of equal keys.
    pair = first[uses == 2]
    sides[pair], sides[pair + 1] = np.minimum(sides[pair], sides[pair + 1]), np.maximum(sides[pair], sides[pair + 1])
    more = np.flatnonzero(np.repeat(uses > 2, uses))
    sides[more] = sides[more][np.lexsort((sides[more], key[more]))]
    ends = np.column_stack(np.divmod(key[first], count))
    return EdgeTable(sides, first, uses, ends, start[sides] < end[sides], len(triangles))


def connected(count: int, one: Int, two: Int) -> Int:
    """(count,) a number for each group of items connected through the pairs ``one`` (P,) and ``two`` (P,); groups are
    numbered by their first item."""
    pairs = one.astype(np.int32), two.astype(np.int32)  # half the time of 64 bits
    graph = coo_array((np.ones(len(one), dtype=np.int8), pairs), shape=(count, count)).tocsr()
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def directed_edges(triangles: Int) -> Int:
    """(3F, 2) start and end of each side of (F, 3) triangles, side by side."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def boundary_edges(triangles: Int) -> Int:
    """(E, 2) start and end of the sides of (F, 3) triangles whose opposite no other triangle has."""
    edges = directed_edges(triangles)
    size = int(edges.max()) + 1 if len(edges) else 1
    forward, backward = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    return edges[~among(forward, backward)]
