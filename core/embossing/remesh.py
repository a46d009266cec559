"""The ground of smooth letters triangulated anew, along their contours: a constrained Delaunay triangulation.

The triangles of the patch that the letters and their trenches cover are replaced. The rim of this region keeps its
edges as they are, so that it meets the untouched surface edge by edge. Inside, the letters' outlines, the contours of
their height field, and those edges of the ground that carry its shape or part its attributes are edges; all other
edges of the ground may go, which saves half of the triangles on finely divided surfaces.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Bool, Float, Int
from core.embossing.delaunay import triangulated
from core.embossing.ground import INSIDE, Ground
from core.embossing.height_field import HeightField
from core.embossing.patch import Patch
from core.geometry.edges import directed_edges, edge_table
from core.geometry.grouping import among
from core.geometry.products import cross
from core.geometry.segments import crossing, distance_to_edges

FLAPS = 4  # rounds in which triangles at the rim that lie over others are left out
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
        crossed = crossing(plane[boundary], plane[boundary])
        if not crossed.any():
            break
        replaced = replaced[~among(replaced, owners[crossed])]
    else:
        return None
    ground = Ground(patch.points, patch.triangles, replaced)
    rim = field.near(plane[boundary])
    rings = ground.bridged([*field.outlines, *field.contours], options.ground * relief, field.slope)
    outlines = int(rings.sizes[: len(field.outlines)].sum())
    contour = rings.points
    kept = np.ones(len(contour), dtype=bool)
    kept[outlines:] = np.isinf(distance_to_edges(contour[outlines:], rim, options.rim * field.slope))
    kept[outlines:] &= rings.beside[outlines:] < INSIDE
    sides = np.column_stack([np.arange(len(contour)), rings.ahead])
    sides = sides[kept[sides[:, 0]] & kept[sides[:, 1]]]
    crossed = crossing(contour[sides], rim)
    if crossed[sides[:, 0] < outlines].any():
        return None
    sides = sides[~crossed]

    own = _own_vertices(patch, replaced, np.concatenate([boundary, edges]), contour[sides], field.slope, options)
    number = np.full(len(plane), -1)
    number[own] = np.arange(len(own))
    of_contour = np.cumsum(kept) - 1 + len(own)
    found = triangulated(
        np.concatenate([plane[own], contour[kept]]),
        np.concatenate([number[boundary], number[edges], of_contour[sides]]),
    )
    if found is None:
        return None
    inner = found.left_of(number[boundary])
    is_letter = found.inside(field.letters.to_polygons(), of_contour[sides[sides[:, 0] < outlines]])
    corners, is_letter = found.triangles[inner], is_letter[inner]
    if not len(corners):
        return None

    # Vertices of the patch keep their numbers; all others follow: points of the rings, and crossings of edges.
    extra = found.points[len(own) :]
    crossings = extra[kept.sum() :]
    at, beside = (
        np.concatenate([of_ring[kept], of_crossing])
        for of_ring, of_crossing in zip((rings.faces, rings.beside), ground.under(crossings), strict=True)
    )
    weights = ground.weights(extra, at)
    some = np.zeros(len(plane), dtype=np.int64)
    some[patch.triangles.ravel()] = np.repeat(np.arange(len(patch.triangles)), 3)
    points = np.concatenate([patch.points, np.column_stack([extra, ground.height(weights, at)])])
    corners = np.concatenate([own, len(plane) + np.arange(len(extra))])[corners]
    return Remesh(
        points=points,
        point_faces=np.concatenate([some, at]),
        weights=np.concatenate([patch.triangles[some] == np.arange(len(plane))[:, None], weights]),
        triangles=corners,
        corner_faces=_corner_faces(points, corners, patch.triangles, (at, beside < INSIDE), ground),
        letters=is_letter,
        replaced=replaced,
        boundary=boundary,
    )


def _covered(corners: Float, field: HeightField) -> Int:
    """The numbers of those of the triangles (K, 3, 2) whose bounds meet the texels that the footprint covers."""
    covered = field.covered_before
    high = np.array(field.covered.shape)[::-1]
    a, b, c = (corners[:, corner] for corner in range(3))
    lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    first = np.floor((lowest - field.origin) / field.texel - 0.5).astype(np.int64)
    last = np.ceil((highest - field.origin) / field.texel + 0.5).astype(np.int64) + 1
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


def _own_vertices(
    patch: Patch, replaced: Int, edges: Int, contours: Float, slope: float, options: RemeshOptions
) -> Int:
    """The vertices of the ``replaced`` triangles of a patch that stay, ascending: the ends of the ``edges`` (E, 2), and
    those not close to samples of the sides of ``contours`` (S, 2, 2)."""
    is_used, is_fixed = np.zeros((2, len(patch.points)), dtype=bool)
    is_used[patch.triangles[replaced]] = True
    is_fixed[edges] = True
    free = np.flatnonzero(is_used & ~is_fixed)
    if len(free):
        tree = cKDTree(_samples(contours, slope / 2), balanced_tree=False, compact_nodes=False)
        near, _ = tree.query(patch.points[free, :2], distance_upper_bound=options.spacing * slope)
        is_fixed[free[np.isinf(near)]] = True
    return np.flatnonzero(is_fixed)


def _samples(segments: Float, spacing: float) -> Float:
    """(N, 2) points on the ``segments`` (S, 2, 2), their ends included."""
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    count = np.ceil(length / spacing).astype(np.int64) + 1
    which = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    share = place / (count[which] - 1).clip(1)
    return np.asarray(segments[which, 0] + share[:, None] * (segments[which, 1] - segments[which, 0]))


def _corner_faces(points: Float, triangles: Int, ground_triangles: Int, under: tuple[Int, Bool], ground: Ground) -> Int:
    """(M, 3) the triangle of the ground under each corner of ``triangles`` (M, 3) into ``points``: the one under the
    middle where it holds the corner, else the one that the corner's triangle lies in close to it.

    Args:
        points: (N, 3), the last ones new.
        triangles: counter-clockwise, seen along z.
        ground_triangles: (K, 3) of the ground.
        under: of each new point the triangle of the ground that it was found in, and whether it is inside it.
        ground: the ground.
    """
    faces, inside = under
    known = len(points) - len(faces)
    last = np.maximum(np.maximum(triangles[:, 0], triangles[:, 1]), triangles[:, 2])
    face = np.where(last >= known, faces[np.maximum(last - known, 0)], -1)
    new = np.maximum(triangles - known, 0)
    a, b, c = ground_triangles[face].T
    certain = face >= 0
    for corner, number in zip(triangles.T, new.T, strict=True):
        in_face = (faces[number] == face) & inside[number]
        certain &= np.where(corner >= known, in_face, (corner == a) | (corner == b) | (corner == c))
    result = np.repeat(face[:, None], 3, axis=1)

    unsure = np.flatnonzero(~certain)
    corners = points[triangles[unsure], :2]
    middle = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
    own = np.repeat(ground.under(middle)[0][:, None], 3, axis=1)
    row, corner = np.nonzero(ground.outside(corners, own[:, 0]) > INSIDE)
    near = corners[row, corner] + TOWARDS * (middle[row] - corners[row, corner])
    number = triangles[unsure[row], corner] - known
    there = faces[np.maximum(number, 0)]  # most often the triangle that the corner itself was found in
    beyond = np.flatnonzero((number < 0) | (ground.outside(near[:, None], there)[:, 0] >= 0))
    there[beyond] = ground.under(near[beyond])[0]
    own[row, corner] = there
    result[unsure] = own
    return result
