"""Edges that no letter can be cut across: boundaries and creases of a surface, and edges of more than two faces."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Bool, Float, Int
from core.artwork.layouts import Layouts
from core.artwork.raster import raster
from core.geometry.boxes import Boxes
from core.geometry.edges import EdgeTable
from core.geometry.products import dot
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.placement.filters import FACING

MOST_POINTS = 1_000_000  # on all edges
UPPERMOST = 1e-3  # size-30 units below the first hit of a ray, within which points are visible


@dataclass(frozen=True)
class RimOptions:
    """Values of :func:`rims`: all ours; the paper knows no such edges.

    Attributes:
        spacing: size-30 units between points of an edge, about a stroke of legible text; wider where edges are many.
        texels: of the letters, across the text's width.
        crease: cosine between the normals of two faces; below it one may face away from a box on the other.
    """

    spacing: float = 0.05
    texels: int = 1024
    crease: float = 0.5


RIMS = RimOptions()


@dataclass(frozen=True, eq=False)
class Rims:
    """Points on the edges of a surface that do not join exactly two of its faces, wound alike, and on sharp ones.

    The rays of a footprint hit neither the wall of a low step nor a crack.

    Attributes:
        tree: over the (N) points, size-30 units.
        normals: (N, 2, 3) of both faces that meet there; zero where these do not join.
        layouts: of the text.
        ink: for each layout (H, W) texels of its bounding box that the letters cover, the first row at the bottom.
    """

    tree: cKDTree
    normals: Float
    layouts: Layouts
    ink: tuple[Bool, ...]

    def crossed(self, boxes: Boxes, index: SpatialIndex) -> Bool:
        """(B,) boxes in which a letter would be cut across an edge that does not join two faces facing the box; edges
        hidden by another layer do not count. ``index`` is over the surface."""
        owner, which, local = boxes.contained(self.tree)
        apart = (np.einsum("nfi,ni->nf", self.normals[which], boxes.axes[owner, 2]) <= FACING).any(axis=1)
        place, layout = local[:, :2] / boxes.size[owner, :2] + 0.5, self.layouts.of(boxes.size)[owner]
        covered = np.zeros(len(owner), dtype=bool)
        for number, ink in enumerate(self.ink):
            mine = np.flatnonzero(layout == number)
            texel = (place[mine] * ink.shape[::-1]).astype(np.int64)
            column, row = np.minimum(texel, np.array(ink.shape[::-1]) - 1).T
            covered[mine] = ink[row, column]
        met = np.flatnonzero(apart & covered)
        owner, normal = owner[met], boxes.axes[owner[met], 2]
        above = boxes.size[owner, 2] / 2 - local[met, 2]
        start = np.asarray(self.tree.data)[which[met]] + above[:, None] * normal
        distance, _ = index.first_hit(start, -normal, Eye.ORIGIN)
        uppermost = distance > above - UPPERMOST
        return np.bincount(owner[uppermost], minlength=len(boxes)) > 0


def rims(surface: Surface, distinct: Bool, layouts: Layouts, options: RimOptions = RIMS) -> Rims | None:
    """The :class:`Rims` of the ``distinct`` (F,) faces of a ``surface`` for a text; None where it has none, as a
    smooth closed manifold."""
    ends, normals = _sharp_edges(surface.edges.among(distinct), surface.normals, options.crease)
    if not len(ends):
        return None
    place = np.zeros((int(surface.weld.max()) + 1, 3))
    place[surface.weld] = surface.positions
    first, along = place[ends[:, 0]], place[ends[:, 1]] - place[ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    pieces = np.ceil(length / max(options.spacing, float(length.sum()) / MOST_POINTS)).astype(np.int64)
    edge = np.repeat(np.arange(len(ends)), pieces)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = (number + 0.5) / pieces[edge]
    ink = tuple(raster(artwork, options.texels) for artwork in layouts.artworks)
    return Rims(cKDTree(first[edge] + share[:, None] * along[edge]), normals[edge], layouts, ink)


def _sharp_edges(edges: EdgeTable, normals: Float, crease: float) -> tuple[Int, Float]:
    """Both vertices (E, 2) of each edge that is sharp or does not join exactly two faces, wound alike; and the normals
    there, of the unit ``normals`` (F, 3), see :class:`Rims`; ``crease`` as in :class:`RimOptions`."""
    pair = np.column_stack([edges.first, np.minimum(edges.first + 1, len(edges.sides) - 1)])
    joined = (edges.uses == 2) & (edges.upward[pair[:, 0]] != edges.upward[pair[:, 1]])
    faces = edges.sides[pair] // 3
    cosine = dot(normals.take(faces[:, 0], axis=0), normals.take(faces[:, 1], axis=0))
    sharp = np.flatnonzero(~joined | (cosine < crease))
    return edges.ends[sharp], np.where(joined[sharp, None, None], normals[faces[sharp]], 0.0)
