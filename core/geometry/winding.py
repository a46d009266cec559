"""How faces are wound: which of them agree with their neighbours, which parts are closed, and which side looks out."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.edges import EdgeTable, connected, edge_table
from core.geometry.grouping import weld
from core.geometry.products import cross

FLAT = 1e-9  # volume over area^1.5 (a sphere: 0.09) under which a closed part has no inside
# What is asked about parts that lie in others: the largest so many may hold some, and so many pairs are tested in all.
HOLDERS, PAIRS = 1024, 1_000_000
ROUNDS = 4  # in which closed parts are told from the rest


@dataclass(frozen=True, eq=False)
class Outward:
    """How to wind triangles so that closed parts look out.

    Attributes:
        turned: (T,) those to reverse.
        part: (T,) the part that each belongs to; -1 for triangles of fewer than three different corners.
        closed: (T,) whether that part is closed and has two sides; True for -1.
    """

    turned: Bool
    part: Int
    closed: Bool


def outward(positions: Float, triangles: Int) -> Outward:
    """What to turn in the triangles (T, 3) into ``positions`` (V, 3), equal positions being one vertex if need be.

    Parts are faces connected through edges of exactly two. In a closed part single faces that disagree with the rest
    are turned, then all of it if its volume is negative. A part inside another one is the wall of a cavity, and looks
    into it, or a solid of its own, and looks out. The file decides where both are wound consistently in it: one that
    is wound against its holder is a cavity. Else the number of parts around it does: odd for a cavity. Open and
    one-sided parts stay as they are.
    """
    found = _outward(positions, triangles)
    if found.closed.all():
        return found
    label = weld(positions)
    return found if np.array_equal(label, np.arange(len(label))) else _outward(positions, label[triangles])


def consistent(count: int, one: Int, two: Int, agree: Bool) -> tuple[Int, Bool]:
    """The part (F,) of each of ``count`` faces, and which (F,) to turn for the faces of a part to agree."""
    if agree.all():
        return connected(count, one, two), np.zeros(count, dtype=bool)
    # Every face twice, as it is and turned: neighbours that disagree connect crosswise. An orientable part then
    # falls into two mirror images, of which one is chosen.
    across = np.where(agree, 0, count)
    both = connected(
        2 * count, np.concatenate([one, one + count]), np.concatenate([two + across, two + count - across])
    )
    image = np.minimum(both[:count], both[count:])
    _, part = np.unique(image, return_inverse=True)
    return part, both[:count] != image


def _outward(positions: Float, triangles: Int) -> Outward:
    """As :func:`outward`, each row of ``positions`` being a vertex of its own."""
    left = np.flatnonzero((triangles != np.roll(triangles, 1, axis=1)).all(axis=1))
    turned, part, closed = np.zeros(len(triangles), bool), np.full(len(triangles), -1), np.ones(len(triangles), bool)
    for _ in range(ROUNDS):
        if len(left) == 0:
            break
        shells = _Shells(positions, triangles[left])
        done = shells.closed[shells.part]
        part[left], closed[left] = part.max() + 1 + shells.part, done
        turned[left] = shells.turned() & done
        if not done.any():
            break
        left = left[~done]  # where closed parts touch along edges, the others may have edges of two faces without them
    return Outward(turned, part, closed)


class _Shells:
    """The parts of a mesh.

    Attributes:
        part: (F,) of each face.
        closed: (P,) whether a part is closed and has two sides.
    """

    def __init__(self, positions: Float, corners: Int) -> None:
        self._positions, self._corners = positions, corners
        edges = edge_table(corners)
        first, second, agree = edges.pairs()
        one, two = first // 3, second // 3
        self.part, against = consistent(len(corners), one, two, agree)
        size = np.bincount(self.part)
        against ^= (np.bincount(self.part, against) > size / 2)[self.part]  # the fewest faces are turned
        self._against = against
        self._as_in_file = np.bincount(self.part[one], ~agree, len(size)) == 0
        self.closed = np.ones(len(size), bool)
        self.closed[self.part[one[~(agree ^ against[one] ^ against[two])]]] = False  # one-sided
        self.closed[self._at_boundary(edges)] = False
        a, b, c = (positions[corners[:, number]] for number in range(3))
        origin = a[np.unique(self.part, return_index=True)[1]][self.part]
        side = np.where(against, -1.0, 1.0)
        volume = np.bincount(self.part, side * np.einsum("ni,ni->n", a - origin, cross(b - origin, c - origin))) / 6
        area = np.bincount(self.part, np.linalg.norm(cross(b - a, c - a), axis=1)) / 2
        self._volume = np.where(np.abs(volume) > FLAT * area**1.5, volume, 0.0)
        self.closed &= (self._volume != 0) | self._as_in_file  # of two faces back to back there is nothing to turn

    def turned(self) -> Bool:
        """(F,) the faces to turn for all closed parts to look where they should."""
        sign, told = np.sign(self._volume), self._as_in_file
        turn = (sign < 0) & self.closed
        if turn.any() or not told[self.closed].all():
            # Parts that are all wound the same way are turned together; else it matters what lies in what.
            same = told[self.closed].all() and turn[self.closed & (sign != 0)].all()
            turn = turn if same else sign * self._wanted() < 0
        return self._against ^ turn[self.part]

    def _at_boundary(self, edges: EdgeTable) -> Int:
        """The parts whose faces do not pass each edge as often one way as the other, once they are made to agree.

        Edges of exactly two faces are not looked at.
        """
        row = np.flatnonzero(np.repeat(edges.uses != 2, edges.uses))
        face, number = edges.sides[row] // 3, edges.edge[edges.sides[row]]
        used, place = np.unique(self.part[face] * len(edges.uses) + number, return_inverse=True)
        way = np.where(edges.upward[row] ^ self._against[face], 1, -1)
        return np.asarray(used[np.bincount(place, way) != 0] // max(len(edges.uses), 1))

    def _wanted(self) -> Float:
        """(P,) 1 for parts that look out, -1 for cavities."""
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
        """(P,) in how many closed parts each closed part lies, and the smallest of them."""
        import igl  # the native library is loaded only for files that need it

        order = np.argsort(self.part, kind="stable")
        start = np.searchsorted(self.part[order], np.arange(len(self.closed)))
        end = np.append(start[1:], len(order))
        points = self._positions[self._corners]
        low = np.minimum.reduceat(points.min(axis=1)[order], start)
        high = np.maximum.reduceat(points.max(axis=1)[order], start)
        # Three places on each part, so that one on the holder's very surface does not decide.
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
