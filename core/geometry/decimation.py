"""Triangles taken away from a surface by collapsing edges, each vertex into a neighbour that stays where it is."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.edges import edge_table
from core.geometry.grouping import among
from core.geometry.products import cross, product


@dataclass(frozen=True)
class DecimationOptions:
    """Values of :func:`decimate`: all ours.

    Attributes:
        border: weight of the planes that hold borders and seams in their place, over that of the surface.
        tie: share of an edge's length to the fourth power in its cost: of equal ones the short edge goes first.
        candidates: share of the vertices, those of the lowest cost, that may go in one round.
        passes: of the choice of collapses that do not touch each other, in one round.
        turn: least cosine between the normals of a triangle before and after.
        sliver: least quality of a triangle afterwards, 1 for an equilateral one, unless it had less.
        error: root of the mean squared distance that a vertex may have to the surface it stands for; in its units.
        stuck: collapses for each triangle, up to which a round counts as one in which nothing more could go.
    """

    border: float = 3.0
    tie: float = 1e-6
    candidates: float = 0.9
    passes: int = 3
    turn: float = 0.3
    sliver: float = 0.05
    error: float = 1.0
    stuck: float = 0.002


DECIMATION = DecimationOptions()
CHUNK = 1 << 16  # quadrics that are evaluated at once


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of F triangles.

    Several of one point are what the two sides of a seam have there: they differ in an attribute or in the material.

    Attributes:
        faces: (F, 3) numbers of corners.
        point: (W,) the point of each corner, ascending; triangles are connected through points.
        values: (W, 3 + m) its position, and its attributes in the same units.
        draws: (F,) how often each triangle is drawn.
    """

    faces: Int
    point: Int
    values: Float
    draws: Int


def decimate(corners: Corners, target: int, options: DecimationOptions = DECIMATION) -> tuple[Int, Int]:
    """Triangles of fewer corners of the same surface.

    Garland and Heckbert's quadrics of position and attributes (1998) say which vertex costs least to collapse into
    which neighbour. A seam or border only becomes shorter along itself, on both of its sides at once; edges of more
    than two triangles stay. No corner is moved or new, no hole is opened or closed. Many collapses at a time, none of
    which touches another, so that all is done on arrays; same input, same result.

    Args:
        corners: of the surface.
        target: how many triangles may be left, as often as they are drawn.
        options: tuned values.

    Returns:
        (G, 3) corners of the triangles that are left, and (G,) the triangle that each was; as few as ``target``, or
        more where no further collapse would keep seams, borders and the sides that triangles face.
    """
    faces, source = corners.faces, np.arange(len(corners.faces))
    solid = _solid(corners.point[faces])
    faces, source = faces[solid], source[solid]
    quadrics = _Quadrics(corners, faces, options.border)
    banned, since = np.empty(0, dtype=np.int64), 0
    while (excess := int(corners.draws[source].sum()) - target) > 0:
        move = _round(faces, source, corners, quadrics, banned, excess, options)
        since += move.collapsed
        if move.collapsed <= options.stuck * len(faces):
            # What was around refused collapses may have changed; where little has, nothing more can be done.
            if since <= options.stuck * len(faces):
                break
            banned, since = np.empty(0, dtype=np.int64), 0
        else:
            banned = np.union1d(banned, move.banned)
        faces = move.onto[faces]
        solid = _solid(corners.point[faces])
        faces, source = faces[solid], source[solid]
    return faces, source


def _solid(points: Int) -> Bool:
    """(F,) triangles (F, 3) of three different points."""
    return np.asarray((points != points[:, [1, 2, 0]]).all(axis=1))


class _Quadrics:
    """Sums of squared distances to the planes of the triangles at each corner, in the space of ``values``.

    Attributes:
        square, linear, constant: (W, n, n), (W, n), (W,) of x A x + 2 b x + c.
        weight: (W,) of all planes.
    """

    def __init__(self, corners: Corners, faces: Int, border: float) -> None:
        count, size = corners.values.shape
        self.square, self.linear = np.zeros((count, size, size)), np.zeros((count, size))
        self.constant, self.weight = np.zeros(count), np.zeros(count)
        for part in _chunks(len(faces)):
            self._add_planes(corners.values, faces[part])
        self._add_borders(corners, faces, border)

    def _add_planes(self, values: Float, faces: Int) -> None:
        p, q, r = (values[faces[:, corner]] for corner in range(3))
        area = np.linalg.norm(cross(q[:, :3] - p[:, :3], r[:, :3] - p[:, :3]), axis=1) / 2
        first = _unit(q - p)
        second = r - p
        second = _unit(second - np.einsum("fi,fi->f", first, second)[:, None] * first)
        square = np.eye(values.shape[1]) - np.einsum("fi,fj->fij", first, first)
        square -= np.einsum("fi,fj->fij", second, second)
        self._add(faces, np.repeat(square[:, None], 3, axis=1), np.repeat(p[:, None], 3, axis=1), area / 3)

    def _add_borders(self, corners: Corners, faces: Int, weight: float) -> None:
        """Planes that stand on the triangles at their edges that are a border or a seam."""
        edges = edge_table(corners.point[faces])
        one, two, _ = edges.pairs()
        start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        seam = np.minimum(start[one], end[one]) != np.minimum(start[two], end[two])
        seam |= np.maximum(start[one], end[one]) != np.maximum(start[two], end[two])
        lone = edges.sides[edges.first[edges.uses == 1]]
        sides = np.concatenate([lone, one[seam], two[seam]])
        at = corners.values[:, :3]
        p, q, r = at[start[sides]], at[end[sides]], at[faces[sides // 3, (sides % 3 + 2) % 3]]
        along = q - p
        normal = _unit(cross(cross(along, r - p), along))
        square = np.zeros((len(sides), 2, *self.square.shape[1:]))
        square[:, :, :3, :3] = np.einsum("si,sj->sij", normal, normal)[:, None]
        base = np.zeros((len(sides), 2, self.linear.shape[1]))
        base[:, :, :3] = p[:, None]
        length = np.einsum("si,si->s", along, along)
        self._add(np.column_stack([start[sides], end[sides]]), square, base, weight * length / 2)

    def _add(self, at: Int, square: Float, base: Float, weight: Float) -> None:
        """Add ``weight`` (N,) times (x - base) A (x - base) to the corners ``at`` (N, k)."""
        np.add.at(self.weight, at, np.broadcast_to(weight[:, None], at.shape))
        square = square * weight[:, None, None, None]
        linear = -np.einsum("nkij,nkj->nki", square, base)
        constant = -np.einsum("nki,nki->nk", linear, base)
        np.add.at(self.square, at, square)
        np.add.at(self.linear, at, linear)
        np.add.at(self.constant, at, constant)

    def cost(self, corners: Int, places: Float) -> Float:
        """(N,) of moving ``corners`` (N,) to ``places`` (N, n)."""
        result = np.empty(len(corners))
        for part in _chunks(len(corners)):
            at, x = corners[part], places[part]
            slope = product(x[:, None], self.square[at]) + 2 * self.linear[at][:, None]
            result[part] = product(slope, x[:, :, None])[:, 0, 0] + self.constant[at]
        return np.maximum(result, 0.0)

    def join(self, gone: Int, into: Int) -> None:
        """Give the quadrics of corners that are ``gone`` (N,) to those that they went ``into`` (N,)."""
        for sums in (self.square, self.linear, self.constant, self.weight):
            np.add.at(sums, into, sums[gone])


def _chunks(count: int) -> Iterator[slice]:
    for start in range(0, count, CHUNK):
        yield slice(start, start + CHUNK)


def _unit(vectors: Float) -> Float:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


@dataclass(frozen=True, eq=False)
class _Move:
    """The outcome of a round: the corner (W,) that each becomes, the number of points that went, and the pairs of
    points, as numbers, whose collapse would turn a triangle over or close a hole."""

    onto: Int
    collapsed: int
    banned: Int


@dataclass(frozen=True, eq=False)
class _Pairs:
    """C possible collapses, each of a point ``gone`` (C,) into its neighbour ``into`` (C,), at a ``cost`` (C,);
    ``uses`` (C,) triangles lie on the edge between them."""

    gone: Int
    into: Int
    cost: Float
    uses: Int

    def __getitem__(self, which: Int | Bool) -> "_Pairs":
        return _Pairs(self.gone[which], self.into[which], self.cost[which], self.uses[which])


def _round(
    faces: Int,
    source: Int,
    corners: Corners,
    quadrics: _Quadrics,
    banned: Int,
    excess: int,
    options: DecimationOptions,
) -> _Move:
    point, points = corners.point, int(corners.point.max()) + 1
    onto = np.arange(len(point))
    # Both directions of each side: corner and point that may go, and those that they may go into.
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    keys = np.concatenate([start * len(point) + end, end * len(point) + start])
    keys.sort()
    from_corner, to_corner = np.divmod(keys[np.diff(keys, prepend=-1) != 0], len(point))
    moves = np.stack([from_corner, point[to_corner], to_corner])
    pairs = _collapsible(faces, moves, corners, quadrics, options)
    pairs = pairs[~among(pairs.gone * points + pairs.into, banned)]
    # Of each point the cheapest way to go, and of these the cheapest.
    pairs = pairs[np.lexsort((pairs.into, pairs.cost, pairs.gone))]
    pairs = pairs[np.diff(pairs.gone, prepend=-1) != 0]
    cheap = np.argsort(pairs.cost, kind="stable")[: int(np.ceil(options.candidates * len(pairs.gone)))]
    pairs = pairs[cheap]
    ring = _rings(point[faces], pairs.gone, points)
    fine = _keeps_shape(faces, corners, pairs, ring, options) & _keeps_topology(point[faces], pairs, points)
    refused = pairs[~fine]
    chosen = _apart(point[faces], pairs, ring, fine, options.passes)
    # As many as are wanted, the cheapest first.
    which, face = ring
    vanish = (point[faces[face]] == pairs.into[which][:, None]).any(axis=1)
    saved = np.bincount(which[vanish], weights=corners.draws[source[face[vanish]]], minlength=len(pairs.gone))
    before = np.cumsum(saved[chosen]) - saved[chosen]
    chosen = chosen[before < excess]
    done = pairs[chosen]
    into = np.full(points, -1)
    into[done.gone] = done.into
    mine = moves[:, into[point[moves[0]]] == moves[1]]
    onto[mine[0]] = mine[2]
    quadrics.join(mine[0], mine[2])
    return _Move(onto, len(chosen), refused.gone * points + refused.into)


def _collapsible(faces: Int, moves: Int, corners: Corners, quadrics: _Quadrics, options: DecimationOptions) -> _Pairs:
    """The collapses that keep seams and borders, with their cost.

    Args:
        faces: (F, 3) corners.
        moves: (3, M) of a corner, the point of its neighbour and the neighbour's corner; sorted.
        corners, quadrics, options: as before.
    """
    point, points = corners.point, int(corners.point.max()) + 1
    edges = edge_table(point[faces])
    complex_point, border_point = np.zeros(points, dtype=bool), np.zeros(points, dtype=bool)
    complex_point[edges.ends[edges.uses > 2]] = True
    border_point[edges.ends[edges.uses == 1]] = True
    corner_count = np.bincount(point[np.flatnonzero(np.bincount(faces.ravel()))], minlength=points)
    # A corner that would have to become two different ones cannot go there.
    twice = np.zeros(moves.shape[1], dtype=bool)
    same = (moves[0, 1:] == moves[0, :-1]) & (moves[1, 1:] == moves[1, :-1])
    twice[1:] |= same
    twice[:-1] |= same
    gone, into = point[moves[0]], moves[1]
    step = corners.values[moves[2], :3] - corners.values[moves[0], :3]
    length = np.einsum("mi,mi->m", step, step)
    cost = quadrics.cost(moves[0], corners.values[moves[2]])
    key = gone * points + into
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    gone, into = gone[order[first]], into[order[first]]
    ways = np.diff(np.append(first, len(order)))
    split = np.maximum.reduceat(twice[order].astype(np.int8), first) > 0
    low, high = np.minimum(gone, into), np.maximum(gone, into)
    edge_keys = edges.ends[:, 0] * points + edges.ends[:, 1]
    uses = edges.uses[np.searchsorted(edge_keys, low * points + high)]
    total, weight = (np.add.reduceat(each[order], first) for each in (cost, quadrics.weight[moves[0]]))
    allowed = ~split & (total <= options.error**2 * weight)
    allowed &= (ways == corner_count[gone]) & ~complex_point[gone] & (~border_point[gone] | (uses == 1))
    pairs = _Pairs(gone, into, total + options.tie * length[order[first]] ** 2, uses)
    return pairs[allowed]


def _rings(faces: Int, centers: Int, points: int) -> tuple[Int, Int]:
    """(R,), (R,) the triangles (F, 3) of points at each of ``centers`` (C,): its number, and the triangle's."""
    number = np.full(points, -1)
    number[centers] = np.arange(len(centers))
    which = number[faces.ravel()]
    found = np.flatnonzero(which >= 0)
    return which[found], found // 3


def _keeps_shape(
    faces: Int, corners: Corners, pairs: _Pairs, ring: tuple[Int, Int], options: DecimationOptions
) -> Bool:
    """(C,) collapses after which no triangle faces another way, or is a sliver that was none, and some are left."""
    which, face = ring
    at, place = corners.point[faces], _places(corners)
    before = at[face]
    stays = (before != pairs.into[which][:, None]).all(axis=1)
    which, before = which[stays], before[stays]
    after = np.where(before == pairs.gone[which][:, None], pairs.into[which][:, None], before)
    (old, old_quality), (new, new_quality) = _shape(place[before]), _shape(place[after])
    bad = np.einsum("ri,ri->r", old, new) < options.turn
    bad &= old.any(axis=1)  # one without area faces no way
    bad |= new_quality < np.minimum(options.sliver, old_quality)
    failed = np.bincount(which[bad], minlength=len(pairs.gone)) > 0
    left = np.bincount(which, minlength=len(pairs.gone)) > 0
    return ~failed & left


def _places(corners: Corners) -> Float:
    """(P, 3) of the points."""
    place = np.zeros((int(corners.point.max()) + 1, 3))
    place[corners.point] = corners.values[:, :3]
    return place


def _shape(triangles: Float) -> tuple[Float, Float]:
    """Unit normals (N, 3) of triangles (N, 3, 3), and their quality (N,): area over the sum of squared sides."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = cross(b - a, c - a)
    sides = sum(np.einsum("ni,ni->n", side, side) for side in (b - a, c - b, a - c))
    doubled = np.linalg.norm(area, axis=1)
    quality = np.divide(2 * np.sqrt(3) * doubled, sides, out=np.zeros(len(area)), where=np.asarray(sides) > 0)
    return _unit(area), quality


def _keeps_topology(faces: Int, pairs: _Pairs, points: int) -> Bool:
    """(C,) collapses whose two points have no neighbours in common but those across the triangles on their edge."""
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys = np.sort(ends[:, 0] * points + ends[:, 1])
    keys = keys[np.diff(keys, prepend=-1) != 0]
    low, high = np.divmod(keys, points)
    one, two = np.concatenate([low, high]), np.concatenate([high, low])
    number = np.full(points, -1)
    number[pairs.gone] = np.arange(len(pairs.gone))
    mine = np.flatnonzero(number[one] >= 0)
    which, other = number[one[mine]], two[mine]
    into = pairs.into[which]
    common = among(np.minimum(into, other) * points + np.maximum(into, other), keys) & (into != other)
    return np.asarray(np.bincount(which[common], minlength=len(pairs.gone)) == pairs.uses)


def _apart(faces: Int, pairs: _Pairs, ring: tuple[Int, Int], fine: Bool, passes: int) -> Int:
    """Numbers of ``fine`` collapses, cheapest first, whose triangles have no point in common; ``pairs`` are sorted."""
    which, face = ring
    claim, claimed = np.repeat(which, 3), faces[face].ravel()
    points = int(faces.max()) + 1
    taken, open_, chosen = np.zeros(points, dtype=bool), fine.copy(), np.zeros(len(pairs.gone), dtype=bool)
    for _ in range(passes):
        mine = open_[claim]
        first = np.full(points, len(pairs.gone))
        np.minimum.at(first, claimed[mine], claim[mine])
        beaten = np.bincount(claim, weights=first[claimed] != claim, minlength=len(pairs.gone)) > 0
        won = open_ & ~beaten
        chosen |= won
        taken[claimed[won[claim]]] = True
        open_ &= ~won & (np.bincount(claim, weights=taken[claimed], minlength=len(pairs.gone)) == 0)
        if not open_.any():
            break
    return np.flatnonzero(chosen)
