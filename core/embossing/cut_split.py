"""The cut by manifold3d: a closed slab under the patch is split by the letters' prism."""

import numpy as np
from manifold3d import CrossSection, Error, Manifold, Mesh64
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Int
from core.embossing.patch import Patch
from core.embossing.pieces import Pieces, mend_t_vertices, number_points
from core.geometry.edges import boundary_edges

DEPTH = 0.2  # text widths from the lowest point to the bottom of the slab: the prism ends half way down
SLACK = 0.1  # text widths


def split(patch: Patch, letters: CrossSection) -> Pieces | None:
    """``patch`` cut along the outlines of ``letters`` (box frame, text widths), which must lie inside it.

    Returns:
        The pieces, or None where manifold3d does not accept the slab or loses it.
    """
    slab, originals = _slab(patch)
    if slab.status() != Error.NoError or slab.is_empty():
        return None
    low, high = patch.points[:, 2].min(), patch.points[:, 2].max()
    bottom = low - DEPTH / 2
    prism = letters.extrude(high + SLACK - bottom).translate((0.0, 0.0, bottom))
    inside, outside = slab.split(prism)
    if inside.is_empty() or outside.is_empty():
        return None
    corner_points, faces, sizes = [], [], []
    for half in (inside, outside):
        mesh = half.to_mesh64()
        triangles = np.asarray(mesh.tri_verts, dtype=np.int64)
        from_slab = _run_of_triangle(mesh) == originals
        on_top = from_slab & (np.asarray(mesh.face_id) < len(patch.triangles))
        corner_points.append(np.asarray(mesh.vert_properties)[:, :3][triangles[on_top]].reshape(-1, 3))
        faces.append(np.asarray(mesh.face_id, dtype=np.int64)[on_top])
        sizes.append(int(on_top.sum()))
    points, number = number_points(patch, np.concatenate(corner_points))
    corners = number.reshape(-1, 3)
    letter_corners, letter_faces = corners[: sizes[0]], faces[0]
    rest_corners, rest_faces = corners[sizes[0] :], faces[1]
    if not len(letter_corners) or not len(rest_corners):
        return None
    letter_edges, rest_edges = boundary_edges(letter_corners), boundary_edges(rest_corners)
    letter_corners, letter_faces = mend_t_vertices(letter_corners, letter_faces, points, rest_edges)
    rest_corners, rest_faces = mend_t_vertices(rest_corners, rest_faces, points, letter_edges)
    return Pieces(points, letter_corners, letter_faces, rest_corners, rest_faces)


def _run_of_triangle(mesh: Mesh64) -> Int:
    """The original mesh id of every triangle."""
    ends = np.asarray(mesh.run_index, dtype=np.int64) // 3
    return np.repeat(np.asarray(mesh.run_original_id, dtype=np.int64), np.diff(ends))


def _slab(patch: Patch) -> tuple[Manifold, int]:
    """A closed solid with the patch on top and a flat bottom; triangle k of the patch has face id k."""
    corner_vertex, points = _fans(patch)
    count, faces = len(points), len(corner_vertex)
    below = points.copy()
    below[:, 2] = points[:, 2].min() - DEPTH
    edges = boundary_edges(corner_vertex)
    a, b = edges[:, 0], edges[:, 1]
    triangles = np.concatenate(
        [
            corner_vertex,
            corner_vertex[:, ::-1] + count,
            np.column_stack([b, a, a + count]),
            np.column_stack([b, a + count, b + count]),
        ]
    )
    wall_ids = 2 * faces + np.tile(np.arange(len(edges)), 2)
    original = Manifold.reserve_ids(1)
    mesh = Mesh64(
        vert_properties=np.ascontiguousarray(np.concatenate([points, below])),
        tri_verts=np.ascontiguousarray(triangles.astype(np.uint64)),
        run_index=np.array([0, 3 * len(triangles)], dtype=np.uint64),
        run_original_id=np.array([original], dtype=np.uint32),
        face_id=np.concatenate([np.arange(2 * faces), wall_ids]).astype(np.uint64),
    )
    return Manifold(mesh), original


def _fans(patch: Patch) -> tuple[Int, NDArray[np.float64]]:
    """(K, 3) corners renumbered so that faces which only touch in a vertex no longer share it, and the points."""
    faces = len(patch.triangles)
    flat = patch.triangles.ravel()
    links = []
    first, second = patch.pairs[:, 0], patch.pairs[:, 1]
    for corner in range(3):
        same = patch.triangles[second] == patch.triangles[first, corner][:, None]
        shared = same.any(axis=1)
        links.append(np.column_stack([3 * first + corner, 3 * second + same.argmax(axis=1)])[shared])
    link = np.concatenate(links)
    graph = coo_array((np.ones(len(link)), (link[:, 0], link[:, 1])), shape=(3 * faces, 3 * faces))
    count, fan = connected_components(graph, directed=False)
    points = np.empty((count, 3))
    points[fan] = patch.points[flat]
    return np.asarray(fan, dtype=np.int64).reshape(-1, 3), points
