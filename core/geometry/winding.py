"""Winding of faces: agreement with neighbours, closed components, and their outer side."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.edges import EdgeTable, connected, edge_table
from core.geometry.grouping import weld
from core.geometry.products import cross

FLAT = 1e-9  # volume over area^1.5 (a sphere: 0.09); a closed component with less has no inside
# Bounds of the nesting test: components that may contain others, the largest first; and pairs tested in all.
HOLDERS, PAIRS = 1024, 1_000_000
ROUNDS = 4  # rounds in which closed components are separated from the rest


@dataclass(frozen=True, eq=False)
class Outward:
    """Winding with which closed components face outwards.

    Attributes:
        flipped: (T,) triangles to flip.
        component: (T,) the component of each; -1 for triangles of fewer than three different corners.
        closed: (T,) true where that component is closed and two-sided, and for -1.
    """

    flipped: Bool
    component: Int
    closed: Bool


def outward(positions: Float, triangles: Int) -> Outward:
    """The :class:`Outward` winding of triangles (T, 3) into ``positions`` (V, 3). Equal positions count as one vertex
    where some component is not closed without.

    Components are faces connected through edges of exactly two. In a closed component single faces that disagree with
    the rest are flipped, then all of it if its volume is negative. A component inside another one is the wall of a
    cavity, and faces into it, or a solid of its own, and faces outwards. The file decides where both are wound
    consistently in it: one that is wound against the component around it is a cavity. Else the number of components
    around it does: odd for a cavity. Open and one-sided components stay as they are.
    """
    found = _outward(positions, triangles)
    if found.closed.all():
        return found
    label = weld(positions)
    return found if np.array_equal(label, np.arange(len(label))) else _outward(positions, label[triangles])


def consistent(count: int, one: Int, two: Int, agree: Bool) -> tuple[Int, Bool]:
    """The component (F,) of each of ``count`` faces, and those (F,) to flip for the faces of a component to agree."""
    if agree.all():
        return connected(count, one, two), np.zeros(count, dtype=bool)
    # Every face twice, as it is and flipped: neighbours that disagree connect crosswise. An orientable component then
    # falls into two mirror images, of which one is chosen.
    across = np.where(agree, 0, count)
    both = connected(
        2 * count, np.concatenate([one, one + count]), np.concatenate([two + across, two + count - across])
    )
    image = np.minimum(both[:count], both[count:])
    _, component = np.unique(image, return_inverse=True)
    return component, both[:count] != image


def _outward(positions: Float, triangles: Int) -> Outward:
    """As :func:`outward`, each row of ``positions`` being a vertex of its own."""
    left = np.flatnonzero((triangles != np.roll(triangles, 1, axis=1)).all(axis=1))
    flipped, component, closed = (
        np.zeros(len(triangles), bool),
        np.full(len(triangles), -1),
        np.ones(len(triangles), bool),
    )
    for _ in range(ROUNDS):
        if len(left) == 0:
            break
        shells = _Shells(positions, triangles[left])
        done = shells.closed[shells.component]
        component[left], closed[left] = component.max() + 1 + shells.component, done
        flipped[left] = shells.flipped() & done
        if not done.any():
            break
        left = left[~done]  # components that touch closed ones along edges may have edges of two faces without these
    return Outward(flipped, component, closed)


class _Shells:
    """The components of a mesh.

    Attributes:
        component: (F,) of each face.
        closed: (P,) components that are closed and two-sided.
    """

    def __init__(self, positions: Float, corners: Int) -> None:
        self._positions, self._corners = positions, corners
        edges = edge_table(corners)
        first, second, agree = edges.pairs()
        one, two = first // 3, second // 3
        self.component, against = consistent(len(corners), one, two, agree)
        size = np.bincount(self.component)
        against ^= (np.bincount(self.component, against) > size / 2)[self.component]  # the fewest faces are flipped
        self._against = against
        self._as_in_file = np.bincount(self.component[one], ~agree, len(size)) == 0
        self.closed = np.ones(len(size), bool)
        self.closed[self.component[one[~(agree ^ against[one] ^ against[two])]]] = False  # one-sided
        self.closed[self._at_boundary(edges)] = False
        a, b, c = (positions[corners[:, number]] for number in range(3))
        origin = a[np.unique(self.component, return_index=True)[1]][self.component]
        side = np.where(against, -1.0, 1.0)
        volume = (
            np.bincount(self.component, side * np.einsum("ni,ni->n", a - origin, cross(b - origin, c - origin))) / 6
        )
        area = np.bincount(self.component, np.linalg.norm(cross(b - a, c - a), axis=1)) / 2
        self._volume = np.where(np.abs(volume) > FLAT * area**1.5, volume, 0.0)
        self.closed &= (self._volume != 0) | self._as_in_file  # of two faces back to back there is nothing to flip

    def flipped(self) -> Bool:
        """(F,) the faces to flip for all closed components to have the right orientation."""
        sign, told = np.sign(self._volume), self._as_in_file
        turn = (sign < 0) & self.closed
        if turn.any() or not told[self.closed].all():
            # Components of one winding are flipped together; else their nesting decides.
            same = told[self.closed].all() and turn[self.closed & (sign != 0)].all()
            turn = turn if same else sign * self._wanted() < 0
        return self._against ^ turn[self.component]

    def _at_boundary(self, edges: EdgeTable) -> Int:
        """The components whose faces, once they agree, do not run along each edge equally often in both directions.

        Edges of exactly two faces are not tested.
        """
        row = np.flatnonzero(np.repeat(edges.uses != 2, edges.uses))
        face, number = edges.sides[row] // 3, edges.edge[edges.sides[row]]
        used, place = np.unique(self.component[face] * len(edges.uses) + number, return_inverse=True)
        way = np.where(edges.upward[row] ^ self._against[face], 1, -1)
        return np.asarray(used[np.bincount(place, way) != 0] // max(len(edges.uses), 1))

    def _wanted(self) -> Float:
        """(P,) 1 for components that face outwards, -1 for cavities."""
        count = len(self.closed)
        sign = np.sign(self._volume)
        depth, holder = self._nesting()
        told = self._as_in_file & (sign != 0)
        wanted = np.ones(count)
        for level in np.unique(depth[depth > 0]).tolist():  # from the outside in
            inner = np.flatnonzero(depth == level)
            outer = holder[inner]
            parity = 1.0 if level % 2 == 0 else -1.0
            wanted[inner] = np.where(told[inner] & told[outer], wanted[outer] * sign[outer] * sign[inner], parity)
        return wanted

    def _nesting(self) -> tuple[Int, Int]:
        """(P,) number of closed components around each closed one, and the smallest of them."""
        import igl  # the native library is loaded only for files that need it

        order = np.argsort(self.component, kind="stable")
        start = np.searchsorted(self.component[order], np.arange(len(self.closed)))
        end = np.append(start[1:], len(order))
        points = self._positions[self._corners]
        low = np.minimum.reduceat(points.min(axis=1)[order], start)
        high = np.maximum.reduceat(points.max(axis=1)[order], start)
        # Three probes on each component, so that one exactly on the surface around it does not decide.
        probes = points[order[np.stack([start, (start + end) // 2, end - 1], axis=1)]].mean(axis=2)
        size = np.abs(self._volume)
        depth, holder = np.zeros(len(size), np.int64), np.full(len(size), -1)
        left = PAIRS
        for outer in np.argsort(-size, kind="stable")[:HOLDERS].tolist():
            inside = self.closed & (size < size[outer]) & np.all((low >= low[outer]) & (high <= high[outer]), axis=1)
            inner = np.flatnonzero(inside)
            left -= len(inner)
            if not self.closed[outer] or len(inner) == 0 or left < 0:
                continue
            faces = order[start[outer] : end[outer]]
            used, corners = np.unique(self._corners[faces], return_inverse=True)
            corners = np.where(self._against[faces, None], corners[:, ::-1], corners)
            number = igl.fast_winding_number(
                np.ascontiguousarray(self._positions[used]), np.ascontiguousarray(corners), probes[inner].reshape(-1, 3)
            )
            within = inner[np.abs(np.median(np.reshape(number, (-1, 3)), axis=1)) > 0.5]
            depth[within] += 1
            holder[within] = outer  # the last is the smallest
        return depth, holder
