"""The fallback cut: the outlines are inserted into the projected patch as a planar arrangement.

Every outline is traced from triangle to triangle; inside each triangle it meets, the cells between the triangle's
sides and the outlines are traced and triangulated. Points on a shared side are computed once, so that neighbours fit.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, triangulate

from core.arrays import Float, Int
from core.embossing.patch import Patch
from core.embossing.pieces import Pieces
from core.geometry.edges import directed_edges
from core.geometry.triangles import doubled_area, inside_rings, ring_area

DEGENERATE = 1e-13  # square text widths; the sign of smaller signed areas is rounding noise of float64


@dataclass
class _Triangle:
    """Points and segments of the outlines inside one triangle."""

    on_sides: dict[tuple[int, int], list[tuple[float, int]]] = field(default_factory=lambda: defaultdict(list))
    segments: list[tuple[int, int]] = field(default_factory=list)


def arrange(patch: Patch, letters: CrossSection) -> Pieces | None:
    """``patch`` cut along the outlines of ``letters`` (box frame, text widths), which must lie inside it.

    Returns:
        The pieces, or None where an outline runs through a vertex or along an edge of the patch (move it a little).
    """
    plane = patch.points[:, :2]
    sides, side_faces = _sides(patch)
    points: list[Float] = list(patch.points)
    cut: dict[int, _Triangle] = defaultdict(_Triangle)
    rings = letters.to_polygons()
    for ring in rings:
        if not _walk(ring, patch, plane, sides, side_faces, points, cut):
            return None
    result: list[tuple[list[int], int, bool]] = []
    all_points = np.array(points)
    for face, inside in cut.items():
        cells = _cells(patch.triangles[face].tolist(), inside, all_points[:, :2])
        if cells is None:
            return None
        result += [(triangle, face, is_letter) for triangle, is_letter in cells]
    whole = np.setdiff1d(np.arange(len(patch.triangles)), np.array(list(cut), dtype=np.int64))
    in_letter = inside_rings(plane[patch.triangles[whole]].mean(axis=1), rings)
    triangles = np.concatenate([patch.triangles[whole], np.array([t for t, _, _ in result]).reshape(-1, 3)])
    faces = np.concatenate([whole, np.array([f for _, f, _ in result], dtype=np.int64)])
    is_letter = np.concatenate([in_letter, np.array([letter for _, _, letter in result], dtype=bool)])
    return Pieces(all_points, triangles[is_letter], faces[is_letter], triangles[~is_letter], faces[~is_letter])


def _sides(patch: Patch) -> tuple[Int, Int]:
    """(S, 2) undirected sides and (S, 2) the patch triangles left and right of each, -1 where there is none."""
    edges = directed_edges(patch.triangles)
    sides, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    faces = np.full((len(sides), 2), -1)
    faces[which.ravel(), (edges[:, 0] > edges[:, 1]).astype(np.int64)] = np.repeat(np.arange(len(edges) // 3), 3)
    return sides, faces


def _walk(
    ring: Float,
    patch: Patch,
    plane: Float,
    sides: Int,
    side_faces: Int,
    points: list[Float],
    cut: dict[int, _Triangle],
) -> bool:
    """Follows one outline through the patch, adding its points and its segments to the triangles it meets."""
    face = _containing(ring[0], plane[patch.triangles])
    if face < 0:
        return False
    first = previous = len(points)
    points.append(_on_plane(ring[0], patch.points[patch.triangles[face]]))
    low = plane[sides].min(axis=1)
    high = plane[sides].max(axis=1)
    for k, start in enumerate(ring):
        is_last = k == len(ring) - 1
        end = ring[0] if is_last else ring[k + 1]
        near = np.flatnonzero(np.all((high >= np.minimum(start, end)) & (low <= np.maximum(start, end)), axis=1))
        a, b = plane[sides[near, 0]], plane[sides[near, 1]]
        from_a, from_b = doubled_area(start, end, a), doubled_area(start, end, b)
        from_start, from_end = doubled_area(a, b, start), doubled_area(a, b, end)
        crosses = (from_a * from_b < 0) & (from_start * from_end < 0)
        doubtful = np.minimum(np.abs(from_a), np.abs(from_b)) < DEGENERATE
        doubtful |= np.minimum(np.abs(from_start), np.abs(from_end)) < DEGENERATE
        touches = (from_a * from_b <= 0) & (from_start * from_end <= 0)
        if np.any(doubtful & (crosses | touches)):
            return False
        hits = np.flatnonzero(crosses)
        along = from_start[hits] / (from_start[hits] - from_end[hits])
        for hit in hits[np.argsort(along)]:
            side = int(near[hit])
            left, right = side_faces[side].tolist()
            if face not in (left, right) or left < 0 or right < 0:
                return False
            share = float(from_a[hit] / (from_a[hit] - from_b[hit]))
            ends = patch.points[sides[side]]
            crossing = len(points)
            points.append((1 - share) * ends[0] + share * ends[1])
            cut[face].segments.append((previous, crossing))
            low_end, high_end = sides[side].tolist()
            for neighbour in (left, right):
                cut[neighbour].on_sides[low_end, high_end].append((share, crossing))
            face, previous = (right if face == left else left), crossing
        if is_last:
            cut[face].segments.append((previous, first))
        else:
            corner = len(points)
            points.append(_on_plane(end, patch.points[patch.triangles[face]]))
            cut[face].segments.append((previous, corner))
            previous = corner
    return True


def _cells(triangle: list[int], inside: _Triangle, plane: Float) -> list[tuple[list[int], bool]] | None:
    """The triangles of every cell of one cut triangle, and whether the cell is part of a letter."""
    following: dict[int, list[int]] = defaultdict(list)
    for k in range(3):
        start, end = triangle[k], triangle[(k + 1) % 3]
        on_side = sorted(inside.on_sides.get((min(start, end), max(start, end)), []), reverse=start > end)
        chain = [start, *(point for _, point in on_side), end]
        for here, there in pairwise(chain):
            following[here].append(there)
    outline = set(inside.segments)
    for here, there in inside.segments:
        following[here].append(there)
        following[there].append(here)

    # Trace the cell on the left of every half-edge: turn as far left as possible at each vertex.
    unused = {(here, there) for here, ends in following.items() for there in ends}
    cycles: list[list[int]] = []
    while unused:
        here, there = min(unused)
        cycle: list[int] = []
        while (here, there) in unused:
            unused.remove((here, there))
            cycle.append(here)
            here, there = there, _leftmost(here, there, following[there], plane)
        cycles.append(cycle)
    areas = [ring_area(plane[cycle]) for cycle in cycles]
    outer = [k for k, area in enumerate(areas) if area > 0]
    holes: dict[int, list[list[int]]] = defaultdict(list)
    for k, area in enumerate(areas):
        if area <= 0:
            # A closed outline wholly inside the triangle: it is a hole of the smallest cell around it.
            around = [o for o in outer if not set(cycles[o]) & set(cycles[k])]
            around = [o for o in around if inside_rings(plane[cycles[k][:1]], [plane[cycles[o]]])[0]]
            if not around:
                return None
            holes[min(around, key=lambda o: areas[o])].append(cycles[k])
    result: list[tuple[list[int], bool]] = []
    for k in outer:
        rings = [cycles[k], *holes[k]]
        half_edges = {(a, b) for ring in rings for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)}
        numbers = [number for ring in rings for number in ring]
        corners = triangulate([np.ascontiguousarray(plane[ring]) for ring in rings], allow_convex=False)
        is_letter = bool(half_edges & outline)
        result += [([numbers[c] for c in corner], is_letter) for corner in np.asarray(corners).tolist()]
    return result


def _leftmost(before: int, here: int, ends: list[int], plane: Float) -> int:
    """The end that follows ``before`` clockwise around ``here``: the sharpest left turn."""
    back = plane[before] - plane[here]
    base = np.arctan2(back[1], back[0])

    def turn(end: int) -> float:
        forward = plane[end] - plane[here]
        return float((base - np.arctan2(forward[1], forward[0])) % (2 * np.pi)) or 2 * np.pi

    others = [end for end in ends if end != before]
    return min(others, key=turn) if others else before


def _containing(point: Float, triangles: Float) -> int:
    """The one of (K, 3, 2) ``triangles`` that holds ``point`` strictly inside, -1 if none does."""
    area = np.stack([doubled_area(triangles[:, k], triangles[:, (k + 1) % 3], point) for k in range(3)])
    found = np.flatnonzero(np.all(area > DEGENERATE, axis=0))
    return int(found[0]) if len(found) else -1


def _on_plane(point: Float, triangle: Float) -> Float:
    """``point`` (2,) raised onto the plane of ``triangle`` (3, 3)."""
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    offset = (normal[:2] * (triangle[0, :2] - point)).sum()
    return np.array([point[0], point[1], triangle[0, 2] + offset / normal[2]])
