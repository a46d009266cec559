"""The pieces of a cut patch: the triangles of the letters and those of the rest."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.embossing.patch import Patch
from core.geometry.edges import directed_edges
from core.geometry.grouping import among
from core.geometry.products import product

ON_SEGMENT = 1e-9  # in text widths: the two halves of a cut are simplified apart by rounding errors only


@dataclass(frozen=True, eq=False)
class Pieces:
    """A patch cut along the letters' outlines.

    Attributes:
        points: (N, 3) box frame, in text widths; the first rows are the patch's own points.
        letters: (L, 3) triangles inside the letters.
        letter_faces: (L,) the patch triangle each one was cut from.
        rest: (R, 3) triangles outside.
        rest_faces: (R,) likewise.
    """

    points: Float
    letters: Int
    letter_faces: Int
    rest: Int
    rest_faces: Int


def mend_t_vertices(triangles: Int, faces: Int, points: Float, opposite: Int) -> tuple[Int, Int]:
    """Splits triangles whose boundary edge passes through vertices of the boundary ``opposite`` (E, 2).

    manifold3d simplifies the two halves of a split separately, so one may have dropped a vertex on a straight
    outline that the other still has.
    """
    edges = directed_edges(triangles)
    candidates = np.unique(opposite)
    # Boundary edges whose opposite is neither among these triangles nor in ``opposite``.
    size = len(points)
    backward = np.concatenate([edges[:, 1] * size + edges[:, 0], opposite[:, 1] * size + opposite[:, 0]])
    loose = np.flatnonzero(~among(edges[:, 0] * size + edges[:, 1], backward))
    if not len(loose) or not len(candidates):
        return triangles, faces
    first, last = points[edges[loose, 0]], points[edges[loose, 1]]
    reach = np.linalg.norm(last - first, axis=1) / 2 + 2 * ON_SEGMENT
    close = cKDTree(points[candidates]).query_ball_point((first + last) / 2, reach, return_sorted=True)
    breaks: dict[int, list[list[int]]] = {}
    for k, beside in zip(loose.tolist(), close, strict=True):
        a, b = edges[k]
        along = points[b] - points[a]
        squared = float((along * along).sum())
        if squared == 0:
            continue
        near = candidates[beside]
        relative = points[near] - points[a]
        position = product(relative, along[:, None])[:, 0] / squared
        away = np.linalg.norm(relative - position[:, None] * along, axis=1)
        margin = ON_SEGMENT / np.sqrt(squared)
        hits = np.flatnonzero((away < ON_SEGMENT) & (position > margin) & (position < 1 - margin))
        if len(hits):
            chain = [int(c) for c in near[hits[np.argsort(position[hits])]]]
            breaks.setdefault(k // 3, [[], [], []])[k % 3] = chain
    if not breaks:
        return triangles, faces
    keep = np.ones(len(triangles), dtype=bool)
    keep[list(breaks)] = False
    added = [
        (triangle, faces[face])
        for face, inserted in breaks.items()
        for triangle in _split_triangle([int(v) for v in triangles[face]], inserted)
    ]
    return (
        np.concatenate([triangles[keep], np.array([triangle for triangle, _ in added], dtype=np.int64)]),
        np.concatenate([faces[keep], np.array([face for _, face in added], dtype=np.int64)]),
    )


def _split_triangle(triangle: list[int], inserted: list[list[int]]) -> list[list[int]]:
    """The triangles of ``triangle`` once ``inserted[k]`` are vertices on its side k (corner k to k + 1)."""
    for side in range(3):
        if inserted[side]:
            apex = triangle[(side + 2) % 3]
            chain = [triangle[side], *inserted[side], triangle[(side + 1) % 3]]
            last = len(chain) - 2
            return [
                part
                for k in range(last + 1)
                for part in _split_triangle(
                    [chain[k], chain[k + 1], apex],
                    [[], inserted[(side + 1) % 3] if k == last else [], inserted[(side + 2) % 3] if k == 0 else []],
                )
            ]
    return [triangle]


def number_points(patch: Patch, extra: Float) -> tuple[Float, Int]:
    """Numbers (N, 3) ``extra`` points together with the patch's own: points at exactly equal coordinates are one.

    Returns:
        All points, the patch's first; and the (N,) number of each extra point.
    """
    together = np.concatenate([patch.points, extra]) + 0.0  # -0.0 and 0.0 are one coordinate
    rows = np.ascontiguousarray(together).view(np.dtype((np.void, together.dtype.itemsize * 3))).ravel()
    _, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
    representative = first[inverse]  # stable: np.unique gives the first occurrence, so patch points win
    is_new = representative == np.arange(len(together))
    is_new[: len(patch.points)] = True
    number = np.cumsum(is_new) - 1
    return together[is_new], number[representative[len(patch.points) :]]
