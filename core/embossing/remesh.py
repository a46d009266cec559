"""The ground of smooth letters triangulated anew, along their contours: a constrained Delaunay triangulation.

The triangles of the patch that the letters and their trenches cover are replaced. The rim of this region keeps its
edges as they are, so that it meets the untouched surface edge by edge. Inside, the letters' outlines, the contours of
their height field, and those edges of the ground that carry its shape or part its attributes are edges; all other
edges of the ground may go, which saves half of the triangles on finely divided surfaces.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pythoncdt
from scipy.spatial import cKDTree

from core.arrays import Bool, Float, Int
from core.embossing.height_field import HeightField
from core.embossing.patch import Patch
from core.geometry.edges import connected, directed_edges, edge_table
from core.geometry.grouping import among
from core.geometry.products import cross
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import barycentric, doubled_area, inside_rings

FLAPS = 4  # rounds in which triangles at the rim that lie over others are left out
ROUNDS = 4  # of bisecting the sides of contours over bent ground, at most
INSIDE = 1e-7  # barycentric coordinate; corners that lie on a triangle's side up to this are in it
TOWARDS = 1e-4  # share of the way from a corner to its triangle's middle at which the ground under it is looked up


@dataclass(frozen=True)
class RemeshOptions:
    """Values of :func:`remesh`: all ours; the paper cuts letters by a union of solids.

    Attributes:
        ground: share of the relief by which the ground may change where its edges are left out or bridged.
        long: edge of the ground, in text widths, from which on it stays.
        spacing: from contours to the ground's own vertices, in deviations of the slope: closer ones are left out.
        rim: the same from contours, outlines apart, to the edge of the patch.
    """

    ground: float = 0.03
    long: float = 0.15
    spacing: float = 0.6
    rim: float = 0.5


REMESH = RemeshOptions()


@dataclass(frozen=True, eq=False)
class Remesh:
    """A region of a patch, triangulated anew.

    Attributes:
        points: (N, 3) on the surface, in the patch's frame; the first rows are the patch's own.
        point_faces: (N,) the patch triangle that each lies in.
        weights: (N, 3) barycentric coordinates of each in it.
        triangles: (M, 3) into ``points``.
        corner_faces: (M, 3) that under each corner, on the triangle's own side where attributes part.
        letters: (M,) bool, triangles inside the outlines.
        replaced: (K,) patch triangles of the region.
        boundary: (E, 2) directed edges round the region.
    """

    points: Float
    point_faces: Int
    weights: Float
    triangles: Int
    corner_faces: Int
    letters: Bool
    replaced: Int
    boundary: Int


def remesh(
    patch: Patch, rows: Int, field: HeightField, relief: float, options: RemeshOptions = REMESH
) -> Remesh | None:
    """The part of ``patch`` that ``field`` covers, triangulated along its contours.

    Args:
        patch: its letters lie inside it.
        rows: (K, 3) a number for each corner of its triangles, equal where its attributes are the same.
        field: of the letters.
        relief: of the letters in text widths, unsigned.
        options: tuned values.

    Returns:
        The new triangles, or None where there is no triangulation with all of these edges.
    """
    plane = patch.points[:, :2]
    replaced = _covered(plane[patch.triangles], field)
    stays = _Stays(rows, ~field.covers(plane), options.ground * relief, options.long)
    for _ in range(FLAPS):
        boundary, owners, edges = _edges(patch, replaced, stays)
        crossed = _crossing(plane[boundary], plane[boundary])
        if not crossed.any():
            break
        replaced = replaced[~among(replaced, owners[crossed])]
    else:
        return None
    triangles = patch.triangles[replaced]
    ground = Ground(patch.points, patch.triangles, replaced)
    rim = field.near(plane[boundary])
    rings = ground.bridged([*field.outlines, *field.contours], options.ground * relief, field.slope)
    outlines = sum(map(len, rings[: len(field.outlines)]))
    contour, sides = _chained(rings)
    kept = np.ones(len(contour), dtype=bool)
    kept[outlines:] = distance_to_edges(contour[outlines:], rim) > options.rim * field.slope
    kept[outlines:] &= ground.under(contour[outlines:])[1] < INSIDE
    sides = sides[kept[sides].all(axis=1)]
    crossed = _crossing(contour[sides], rim)
    if crossed[sides[:, 0] < outlines].any():
        return None
    sides = sides[~crossed]

    used = np.unique(triangles)
    fixed = np.unique(np.concatenate([boundary, edges]))
    samples = _samples(contour[sides], field.slope / 2)
    free = used[~among(used, fixed)]
    near, _ = cKDTree(samples).query(plane[free], distance_upper_bound=options.spacing * field.slope)
    own = np.sort(np.concatenate([fixed, free[np.isinf(near)]]))

    number = np.full(len(plane), -1)
    number[own] = np.arange(len(own))
    inserted = np.concatenate([plane[own], contour[kept]])
    of_contour = np.cumsum(kept) - 1 + len(own)
    constraints = np.concatenate([number[boundary], number[edges], of_contour[sides]])
    found = _triangulated(inserted, constraints)
    if found is None:
        return None
    vertices, corners = found
    inner = _enclosed(corners, number[boundary])
    corners = corners[inner]
    if not len(corners):
        return None

    # Vertices of the patch keep their numbers; all others follow.
    extra = vertices[len(own) :]
    numbers = np.concatenate([own, len(plane) + np.arange(len(extra))])
    at = ground.under(extra)[0]
    points = np.concatenate([patch.points, ground.raised(extra, at)])
    some = np.zeros(len(plane), dtype=np.int64)
    some[patch.triangles.ravel()] = np.repeat(np.arange(len(patch.triangles)), 3)
    corners = numbers[corners]
    middle = points[corners, :2].mean(axis=1)
    return Remesh(
        points=points,
        point_faces=np.concatenate([some, at]),
        weights=np.concatenate([patch.triangles[some] == np.arange(len(plane))[:, None], ground.weights(extra, at)]),
        triangles=corners,
        corner_faces=_corner_faces(points, corners, ground.under(middle)[0], ground),
        letters=inside_rings(middle, field.letters.to_polygons()),
        replaced=replaced,
        boundary=boundary,
    )


class Ground:
    """Triangles of a patch as a function over its plane.

    Args:
        points: (V, 3) of the patch.
        triangles: (K, 3) into them.
        which: the triangles that count.
    """

    def __init__(self, points: Float, triangles: Int, which: Int) -> None:
        self._points, self._triangles, self._which = points, triangles, which
        flat = np.column_stack([points[:, :2], np.zeros(len(points))])
        self._index = SpatialIndex(flat, triangles[which])

    def under(self, points: Float) -> tuple[Int, Float]:
        """The triangle (N,) under, or nearest to, each of (N, 2) ``points``, and the distance (N,) to it."""
        distance, face, _ = self._index.closest(np.column_stack([points, np.zeros(len(points))]))
        return self._which[face], distance

    def weights(self, points: Float, faces: Int) -> Float:
        """(N, 3) barycentric coordinates of (N, 2) ``points`` in triangles (N,), clamped into these."""
        corners = self._points[self._triangles[faces]].copy()
        corners[..., 2] = 0.0
        return barycentric(np.column_stack([points, np.zeros(len(points))])[:, None], corners)[:, 0]

    def raised(self, points: Float, faces: Int) -> Float:
        """(N, 3) points of the surface over (N, 2) ``points`` in triangles (N,)."""
        height = np.sum(self.weights(points, faces) * self._points[self._triangles[faces], 2], axis=1)
        return np.column_stack([points, height])

    def outside(self, points: Float, faces: Int) -> Float:
        """(N, K) by how much (N, K, 2) ``points`` lie outside the triangles (N,), in barycentric coordinates."""
        a, b, c = (self._points[self._triangles[faces, k], :2][:, None] for k in range(3))
        area = np.stack([doubled_area(p, q, points) for p, q in ((b, c), (c, a), (a, b))], axis=2)
        return np.asarray(-area.min(axis=2) / doubled_area(a, b, c))

    def bridged(self, rings: list[Float], tolerance: float, shortest: float) -> list[Float]:
        """The ``rings`` (N, 2) with their sides bisected until none is further than ``tolerance`` from the surface."""
        shares = np.array([0.0, 0.25, 0.5, 0.75, 1.0])[:, None, None]
        start, sizes = np.concatenate(rings), np.array([len(ring) for ring in rings])
        unknown = np.ones(len(start), dtype=bool)
        for _ in range(ROUNDS):
            sides = _sides(sizes)
            which = np.flatnonzero(unknown)
            first, way = start[which], start[sides[which, 1]] - start[which]
            probes = (first + shares * way).reshape(-1, 2)
            height = self.raised(probes, self.under(probes)[0])[:, 2].reshape(len(shares), -1)
            error = np.abs(height - height[0] - shares[:, 0] * (height[-1] - height[0])).max(axis=0)
            split = np.zeros(len(start), dtype=bool)
            split[which] = (error > tolerance) & (np.linalg.norm(way, axis=1) > shortest)
            if not split.any():
                break
            middle = (start + start[sides[:, 1]]) / 2
            ring = np.repeat(np.arange(len(sizes)), sizes)
            sizes = sizes + np.bincount(ring[split], minlength=len(sizes))
            start = np.insert(start, np.flatnonzero(split) + 1, middle[split], axis=0)
            unknown = np.repeat(split, 1 + split)
        return np.split(start, np.cumsum(sizes)[:-1])


def distance_to_edges(points: Float, edges: Float, toward: Float | None = None) -> Float:
    """(N,) distances of (N, 2) ``points`` to the nearest of the segments (E, 2, 2), inf where there is none.

    Args:
        points: in the plane.
        edges: start and end of each segment.
        toward: (N, 2) if given, filled with the nearest points.
    """
    best = np.full(len(points), np.inf)
    along = edges[:, 1] - edges[:, 0]
    squared = np.maximum((along * along).sum(axis=1), np.finfo(float).tiny)
    step = max(1, 2**21 // max(len(edges), 1))
    for first in range(0, len(points) if len(edges) else 0, step):
        block = slice(first, first + step)
        away = points[block, None] - edges[:, 0]
        share = np.clip((away * along).sum(axis=2) / squared, 0.0, 1.0)
        away -= share[..., None] * along
        square = (away * away).sum(axis=2)
        which = square.argmin(axis=1)
        row = np.arange(len(which))
        best[block] = np.sqrt(square[row, which])
        if toward is not None:
            toward[block] = points[block] - away[row, which]
    return best


def _covered(corners: Float, field: HeightField) -> Int:
    """The numbers of those of the triangles (K, 3, 2) whose bounds meet the texels that the footprint covers."""
    covered = np.pad(field.covered.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    high = np.array(field.covered.shape)[::-1]
    first = np.floor((corners.min(axis=1) - field.origin) / field.texel - 0.5).astype(np.int64)
    last = np.ceil((corners.max(axis=1) - field.origin) / field.texel + 0.5).astype(np.int64) + 1
    left, bottom = np.clip(first, 0, high).T
    right, top = np.clip(last, 0, high).T
    return np.flatnonzero(covered[top, right] - covered[bottom, right] - covered[top, left] + covered[bottom, left] > 0)


@dataclass(frozen=True, eq=False)
class _Stays:
    """Edges that stay."""

    rows: Int  # (K, 3) for each corner of the patch: where they differ, attributes part
    beyond: Bool  # (V,) vertices beside the footprint
    tolerance: float  # by which the surface may move without an edge, text widths
    long: float  # edge, text widths


def _edges(patch: Patch, replaced: Int, stays: _Stays) -> tuple[Int, Int, Int]:
    """(E, 2) directed edges round the ``replaced`` triangles of a patch, the triangle (E,) that each is of, and (H, 2)
    edges between them that stay: where attributes part, those that leave the footprint, so that only triangles in it
    reach over several of the ground's, long ones, and those without which the surface would move."""
    triangles, count = patch.triangles[replaced], len(patch.triangles)
    one, two, agree = edge_table(triangles).pairs()
    first, second = replaced[one // 3], replaced[two // 3]
    linked = np.sort(patch.pairs, axis=1)
    key = np.minimum(first, second) * count + np.maximum(first, second)
    joined = agree & among(key, linked[:, 0] * count + linked[:, 1])
    one, two = one[joined], two[joined]
    edges = directed_edges(triangles)
    is_open = np.ones(len(edges), dtype=bool)
    is_open[one] = is_open[two] = False

    own = stays.rows[replaced].ravel()
    ahead = stays.rows[replaced][:, [1, 2, 0]].ravel()
    kept = (own[one] != ahead[two]) | (ahead[one] != own[two]) | stays.beyond[edges[one]].any(axis=1)
    start, end = patch.points[edges[one]].transpose(1, 0, 2)
    apex = [patch.points[triangles[side // 3, (side + 2) % 3]] for side in (one, two)]
    off = []
    for here, there in (apex, apex[::-1]):
        normal = cross(end - start, here - start)
        length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
        off.append(np.abs(np.sum(normal * (there - start), axis=1)) / length)
    kept |= (np.minimum(*off) > 2 * stays.tolerance) | (np.linalg.norm(end - start, axis=1) > stays.long)
    return edges[is_open], np.repeat(replaced, 3)[is_open], edges[one[kept]]


def _chained(rings: list[Float]) -> tuple[Float, Int]:
    """The points (N, 2) of all ``rings`` and their sides (N, 2)."""
    return np.concatenate(rings), _sides(np.array([len(ring) for ring in rings]))


def _sides(sizes: Int) -> Int:
    """The sides (N, 2) of rings with so many points each, one after another."""
    start = np.repeat(np.cumsum(sizes) - sizes, sizes)
    place = np.arange(sizes.sum()) - start
    following = start + (place + 1) % np.repeat(sizes, sizes)
    return np.column_stack([np.arange(sizes.sum()), following])


def _samples(segments: Float, spacing: float) -> Float:
    """(N, 2) points on the ``segments`` (S, 2, 2), their ends included."""
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    count = np.ceil(length / spacing).astype(np.int64) + 1
    which = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    share = place / (count[which] - 1).clip(1)
    return np.asarray(segments[which, 0] + share[:, None] * (segments[which, 1] - segments[which, 0]))


def _crossing(segments: Float, edges: Float) -> Bool:
    """(S,) those of the ``segments`` (S, 2, 2) that cross any of the ``edges`` (E, 2, 2)."""
    result = np.zeros(len(segments), dtype=bool)
    step = max(1, 2**20 // max(len(edges), 1))
    for first in range(0, len(segments), step):
        block = slice(first, first + step)
        a, b = segments[block, None, 0], segments[block, None, 1]
        c, d = edges[None, :, 0], edges[None, :, 1]
        crossed = doubled_area(a, b, c) * doubled_area(a, b, d) < 0
        crossed &= doubled_area(c, d, a) * doubled_area(c, d, b) < 0
        result[block] = crossed.any(axis=1)
    return result


def _triangulated(points: Float, constraints: Int) -> tuple[Float, Int] | None:
    """The (M, 3) triangles of a constrained Delaunay triangulation of (N, 2) ``points``, and all points: where
    constraints cross, new ones follow."""
    triangulation = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE, 0.0
    )
    vertices: Any = np.ascontiguousarray(points)  # the bindings' types do not know that arrays are buffers
    edges: Any = np.unique(np.sort(constraints, axis=1), axis=0).astype(np.uintc)
    try:
        triangulation.insert_vertices(vertices)
        triangulation.insert_edges(edges)
        triangulation.erase_super_triangle()
    except RuntimeError:  # constraints that cross closer than numbers can tell
        return None
    found = triangulation.vertices_array()
    return np.column_stack([found["x"], found["y"]]), np.asarray(
        triangulation.triangles_array()["vertices"], dtype=np.int64
    )


def _enclosed(triangles: Int, boundary: Int) -> Bool:
    """(M,) triangles on the left of the directed edges ``boundary`` (E, 2), and all that are joined to them."""
    table = edge_table(triangles)
    one, two, _ = table.pairs()
    edges = directed_edges(triangles)
    size = int(triangles.max()) + 1
    wall = np.sort(boundary, axis=1)
    side = np.sort(edges[one], axis=1)
    passed = ~among(side[:, 0] * size + side[:, 1], wall[:, 0] * size + wall[:, 1])
    part = connected(len(triangles), one[passed] // 3, two[passed] // 3)
    left = among(edges[:, 0] * size + edges[:, 1], boundary[:, 0] * size + boundary[:, 1])
    return among(part, part[np.flatnonzero(left) // 3])


def _corner_faces(points: Float, triangles: Int, faces: Int, ground: Ground) -> Int:
    """(M, 3) the triangle of the ground under each corner: the one under the middle where it holds the corner, else
    the one that the corner's triangle lies in close to it."""
    corners = points[triangles, :2]
    result = np.repeat(faces[:, None], 3, axis=1)
    beyond = ground.outside(corners, faces) > INSIDE
    middle = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    near = corners[beyond] + TOWARDS * (middle[beyond] - corners[beyond])
    result[beyond] = ground.under(near)[0]
    return result
