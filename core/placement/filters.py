"""Filters of fitted boxes: one pure function per reason to drop a box.

A box may only be kept where its front looks out of the asset. On a component whose faces are wound inside out the
candidates look inwards, at the asset itself, and :func:`occluded` (or the visibility matrix of ``selection``) removes
them. They are not turned around: a renderer that culls back faces would not show their letters either.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from core.arrays import Bool, Float, Int
from core.geometry.boxes import Boxes, unit_grid
from core.geometry.products import cross, product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.triangles import unit
from core.placement.finetune import ADAM

# 1/cos has a pole at a right angle: steeper or opposed normals count as this rough.
SMALLEST_COSINE = 0.05
# Neighbours of a point in the plane of its own box, for labelling.
PLANE = np.array([[[0] * 3] * 3, [[0, 1, 0], [1, 1, 1], [0, 1, 0]], [[0] * 3] * 3])
FACING = 0.15  # cosine from which embossing takes a face as part of the patch


@dataclass(frozen=True)
class FilterOptions:
    """Values of the filters of boxes: ours, but for the roughness.

    Attributes:
        min_support: supported share of a box after the first pass of fitting, at least. Of 2746 boxes with less, on
            seven assets, 145 would have become fully supported: one in fifty of all that did.
        copy: tolerance of :func:`core.placement.finetune.distinct` after fitting: closer boxes are one.
        footprint: rays along the text and across it onto each box.
        margin: text heights around a box that the footprint spans too; letters keep this clear of every border of the
            surface.
        recentre_steps: ways of :func:`recentre` in turn, in shares of that to the centre of the support.
        recentre_grid: rays along the text and across it that find this centre.
        recentre_margin: text heights to spare at the border by then.
        roughness: mean of 1/cos, below which surface is smooth. Paper, supplement "Filtering".
        roughness_samples: normals in a box that :func:`roughness` compares. The paper's H_r, its value not given.
        roughness_rays: one in so many of the footprint's rays counts for the roughness, 36 a box.
        bend: cosine between the normals that neighbouring rays of a footprint meet, at least: more turned is an edge.
        turned: cosine between the normals of the pieces of ground on either side of edges, below which text is folded.
        tilted: cosine between a box's normal and the mean normal of its ground, at least.
        lift: reliefs above the surface at which visibility starts: just clear of the letters.
        sight_grid: rays along the text and across it that have to be free.
        sight: text heights in front of a text in which no other part may stand.
        edge_margin: text heights around a box that :func:`edge_proximity` looks at.
        edge_grid: rays along the text and across it over box and margin; the outermost count.
    """

    min_support: float = 0.7
    copy: float = 0.05
    footprint: tuple[int, int] = (24, 6)
    margin: float = 0.08
    recentre_steps: tuple[float, ...] = (2.0, 1.0)
    recentre_grid: tuple[int, int] = (12, 16)
    recentre_margin: float = 0.16
    roughness: float = 1.25
    roughness_samples: int = 32
    roughness_rays: int = 4
    bend: float = float(np.cos(np.radians(30.0)))
    turned: float = float(np.cos(np.radians(25.0)))
    tilted: float = float(np.cos(np.radians(12.0)))
    lift: float = 1.5
    sight_grid: tuple[int, int] = (8, 2)
    sight: float = 8.0
    edge_margin: float = 0.8
    edge_grid: tuple[int, int] = (9, 4)


FILTERS = FilterOptions()


@dataclass(frozen=True, eq=False)
class Footprint:
    """First hits of rays cast from above over a grid on each box, against the box's normal.

    Attributes:
        height: (B, N) along the normal from the middle plane, size-30 units; -inf where nothing is met.
        cosine: (B, N) between the box's normal and the normal of the face that is met; -1 where none is.
        local: (B, N, 2) grid points in box coordinates, right and up.
        face: (B, N) the face that is met; -1 where none is.
    """

    height: Float
    cosine: Float
    local: Float
    face: Int

    def __getitem__(self, which: Int | Bool) -> "Footprint":
        """Those of some of the boxes."""
        return Footprint(self.height[which], self.cosine[which], self.local[which], self.face[which])


def footprint(
    boxes: Boxes,
    index: SpatialIndex,
    normals: Float,
    clearance: float | Float,
    grid: tuple[int, int] = FILTERS.footprint,
    margin: float | Float = FILTERS.margin,
) -> Footprint:
    """Cast a ``grid`` of rays onto each box from ``clearance`` (one for all, or (B,)) above its front face.

    The grid spans the front face and ``margin`` (one for all, or (B,)) times the height more on all sides.
    ``normals`` (F, 3) are the unit face normals of the surface in ``index``.
    """
    spread = boxes.size[:, None, :2] + (2 * margin * boxes.size[:, 1])[:, None, None]
    return cast(boxes, unit_grid(grid)[None] * spread, index, normals, clearance)


def cast(boxes: Boxes, local: Float, index: SpatialIndex, normals: Float, clearance: float | Float) -> Footprint:
    """The same for rays at ``local`` (B, N, 2), right and up from the middle of each box, size-30 units."""
    start = boxes.size[:, 2] / 2 + clearance
    normal = boxes.axes[:, 2]
    origin = boxes.center + start[:, None] * normal
    points = origin[:, None, :] + np.einsum("bni,bij->bnj", local, boxes.axes[:, :2])
    down = np.broadcast_to(-normal[:, None, :], points.shape)
    distance, face = index.first_hit(points.reshape(-1, 3), down.reshape(-1, 3), Eye.ORIGIN)
    distance, face = distance.reshape(points.shape[:2]), face.reshape(points.shape[:2])
    cosine = np.where(face >= 0, np.einsum("bni,bi->bn", normals[face], normal), -1.0)
    return Footprint(start[:, None] - distance, cosine, local, face)


def well_aligned(loss: Float) -> Bool:
    """(B,) loss below the paper's 0.005."""
    return np.asarray(loss < ADAM.threshold)


def recentre(boxes: Boxes, met: Footprint, component: Int, step: float) -> Boxes:
    """Boxes moved along their plane towards the centre of their support.

    Each moves ``step`` times the way from its centre to that of the supported part of its footprint: with 2 a box that
    hangs over a straight edge ends right at it, with 1 a box on a strip narrower than itself ends in its middle. The
    loss brings boxes near such places, but a point that hangs over an edge only a little hardly contributes.
    ``component`` as for :func:`fully_supported`.
    """
    supported = held(met, boxes, component)
    share = supported.sum(axis=1, keepdims=True)
    middle = np.einsum("bn,bnk->bk", supported, met.local) / np.maximum(share, 1)
    return Boxes(boxes.center + step * np.einsum("bk,bkj->bj", middle, boxes.axes[:, :2]), boxes.axes, boxes.size)


def fully_supported(met: Footprint, boxes: Boxes, component: Int) -> Bool:
    """(B,) boxes with one layer of one component of the surface under all of their footprint.

    Every ray meets a face that looks at the box (cosine above 0.15) within the box's thickness. A box that
    hangs over an edge, a hole or a gap fails, and so does one with another layer within the clearance of
    ``footprint`` above it, because the rays start above that layer and meet it first. ``component`` (F,)
    numbers the component of each face: letters are not cut where one runs into another.
    """
    return np.asarray(held(met, boxes, component).all(axis=1))


def support(met: Footprint, boxes: Boxes, component: Int) -> Float:
    """(B,) share of each footprint that meets the conditions of :func:`fully_supported`."""
    return np.asarray(held(met, boxes, component).mean(axis=1))


def held(met: Footprint, boxes: Boxes, component: Int) -> Bool:
    """(B, N) rays that meet the conditions of :func:`fully_supported`."""
    return _supported(met, boxes) & _on_one_component(met, component)


def _supported(met: Footprint, boxes: Boxes) -> Bool:
    """(B, N) rays that meet, within the box, a face that looks at it."""
    return np.asarray((np.abs(met.height) <= boxes.size[:, 2:3] / 2) & (met.cosine > FACING))


def _on_one_component(met: Footprint, component: Int) -> Bool:
    """(B, N) rays that meet the same component as the ray in the middle."""
    under = np.where(met.face >= 0, component[met.face], -1)
    middle = (met.local**2).sum(axis=2).argmin(axis=1)
    return np.asarray(under == np.take_along_axis(under, middle[:, None], axis=1))


def edge_proximity(
    boxes: Boxes,
    height: Float,
    index: SpatialIndex,
    normals: Float,
    clearance: float | Float,
    options: FilterOptions = FILTERS,
) -> Float:
    """(B,) share of a margin around each box that has no supporting surface: near an edge, a hole or a silhouette a
    mark is cut off by the first crop, and looks misplaced.

    ``height`` (B,) is that of a line of the text, by which the margin goes; ``clearance`` and ``normals`` as for
    :func:`footprint`.
    """
    met = footprint(
        boxes, index, normals, clearance, options.edge_grid, options.edge_margin * height / boxes.size[:, 1]
    )
    across, down = options.edge_grid
    rim = np.zeros(options.edge_grid, dtype=bool)
    rim[[0, across - 1]] = True
    rim[:, [0, down - 1]] = True
    return np.asarray(1 - _supported(met, boxes)[:, rim.ravel()].mean(axis=1))


def folded(met: Footprint, normals: Float, options: FilterOptions = FILTERS) -> Float:
    """(B,) share of each footprint on ground that an edge turns away from the ground under most of it.

    Neighbouring rays are on one piece of ground where the normals of the faces they meet are alike: round a bend they
    are, across an edge they are not. ``met`` is of the grid ``options.footprint``, ``normals`` as for
    :func:`footprint`.
    """
    number, (across, down) = len(met.face), options.footprint
    if number == 0:
        return np.empty(0)
    normal = np.where(met.face[..., None] >= 0, normals[met.face], 0.0).reshape(number, across, down, 3)
    joined = np.zeros((number, 2 * across - 1, 2 * down - 1), dtype=bool)
    joined[:, ::2, ::2] = True
    joined[:, 1::2, ::2] = np.einsum("bxyi,bxyi->bxy", normal[:, 1:], normal[:, :-1]) > options.bend
    joined[:, ::2, 1::2] = np.einsum("bxyi,bxyi->bxy", normal[:, :, 1:], normal[:, :, :-1]) > options.bend
    piece = label(joined, PLANE)[0][:, ::2, ::2].reshape(-1) - 1
    size = np.bincount(piece)
    mean = unit(np.column_stack([np.bincount(piece, column) for column in normal.reshape(-1, 3).T]))
    box = np.zeros(len(size), dtype=np.int64)
    box[piece] = np.repeat(np.arange(number), across * down)
    order = np.lexsort((-size, box))
    largest = order[np.searchsorted(box[order], np.arange(number))]
    away = np.einsum("pi,pi->p", mean, mean[largest[box]]) < options.turned
    return np.bincount(box, size * away, number) / (across * down)


def roughness(boxes: Boxes, points: Float, normals: Float, options: FilterOptions = FILTERS) -> Float:
    """(B,) mean over all pairs of normals inside each box of 1/cos (paper, supplement "Filtering"); 1 is flat.

    Args:
        boxes: the boxes.
        points: (S, 3) area samples of the surface; samples, not vertices, so that coarse meshes are judged too.
        normals: (S, 3) unit normals there.
        options: tuned values.

    Samples that look away from the box belong to the far side of a thin wall and do not count. Pairs at
    almost a right angle or more count as 1/0.05. A box with no sample inside is infinitely rough.
    """
    if len(boxes) == 0:
        return np.empty(0)
    owner, which, _ = boxes.contained(cKDTree(points))
    toward = np.einsum("ni,ni->n", normals[which], boxes.axes[owner, 2]) > -0.2
    owner, which = owner[toward], which[toward]
    # The samples come in random order, so each box's first ones are a random choice.
    first = np.searchsorted(owner, np.arange(len(boxes)))
    rank = np.arange(len(owner)) - first[owner]
    few = rank < options.roughness_samples
    taken = np.zeros((len(boxes), options.roughness_samples, 3))
    taken[owner[few], rank[few]] = normals[which[few]]
    return _mean_inverse_cosine(taken, np.linalg.norm(taken, axis=2) > 0.5)


def roughness_met(met: Footprint, normals: Float, options: FilterOptions = FILTERS) -> Float:
    """(B,) :func:`roughness` over the faces met by some of the rays of a footprint; ``normals`` as there."""
    face = met.face[:, :: options.roughness_rays]
    return _mean_inverse_cosine(normals[face], face >= 0)


def _mean_inverse_cosine(normals: Float, valid: Bool) -> Float:
    """(B,) mean over all pairs of ``valid`` (B, N) normals (B, N, 3) of 1/cos; inf where there are none."""
    pairs = valid[:, :, None] & valid[:, None, :]
    inverse = 1 / np.clip(product(normals, normals.transpose(0, 2, 1)), SMALLEST_COSINE, 1.0)
    count = pairs.sum(axis=(1, 2))
    total = np.where(pairs, inverse, 0.0).sum(axis=(1, 2))
    return np.asarray(np.divide(total, count, out=np.full(len(normals), np.inf), where=count > 0))


def smooth(rough: Float, options: FilterOptions = FILTERS) -> Bool:
    """(B,) roughness below the threshold."""
    return np.asarray(rough < options.roughness)


def tilted(boxes: Boxes, met: Footprint, normals: Float, options: FilterOptions = FILTERS) -> Bool:
    """(B,) boxes that do not lie on their ground: turned against the mean normal of the faces ``met``.

    At the rim of a plate such a box may hold the plate's other side too. ``normals`` as for :func:`footprint`.
    """
    mean = unit(np.where(met.face[..., None] >= 0, normals[met.face], 0.0).sum(axis=1))
    return np.asarray(np.einsum("bi,bi->b", mean, boxes.axes[:, 2]) < options.tilted)


def occluded(boxes: Boxes, points: Float, index: SpatialIndex, reach: float | Float) -> Bool:
    """(B,) boxes whose front looks at the asset itself within ``reach`` (one for all, or (B,)), size-30 units.

    Rays leave along the normal from ``points`` (B, N, 3), see :func:`above` (paper, supplement "Non-Occluding
    Boxes"), and pass faces that hide nothing from the outside.
    """
    normal = np.broadcast_to(boxes.axes[:, None, 2], points.shape)
    distance, _ = index.first_hit(points.reshape(-1, 3), normal.reshape(-1, 3), Eye.FAR)
    return np.asarray((distance.reshape(points.shape[:2]) <= np.reshape(reach, (-1, 1))).any(axis=1))


def thin_walled(boxes: Boxes, met: Footprint, index: SpatialIndex, depth: Float) -> Bool:
    """(B,) boxes with another side of the asset within ``depth`` (B,) behind their surface, size-30 units.

    Sunken letters would break through there. Rays come back from that depth along the normal: they meet the surface
    under the box, at the points that were ``met``, from behind, or another side before it or from its front.
    """
    points = above(boxes, met, -depth)
    normal = np.broadcast_to(boxes.axes[:, None, 2], points.shape).reshape(-1, 3)
    distance, face = index.first_hit(points.reshape(-1, 3), normal)
    share = distance / np.repeat(depth, points.shape[1])
    from_front = (face >= 0) & (np.einsum("ni,ni->n", index.normals(face), normal) < 0)
    other_side = (share < 0.95) | (from_front & (share < 1.05))
    return np.asarray(other_side.reshape(points.shape[:2]).any(axis=1))


def above(boxes: Boxes, met: Footprint, clearance: float | Float) -> Float:
    """(B, N, 3) points ``clearance`` (one for all, or (B,)) above the surface under each box, so that the curvature
    below the box is not in their way; above the middle plane where no surface is met."""
    height = np.where(np.isfinite(met.height), met.height, 0.0) + np.reshape(clearance, (-1, 1))
    local = np.concatenate([met.local, height[..., None]], axis=2)
    return np.asarray(np.einsum("bni,bij->bnj", local, boxes.axes) + boxes.center[:, None, :])


def overlapping(boxes: Boxes, one: int, spacing: float = 0.0) -> Bool:
    """(B,) which boxes come closer to box ``one`` than ``spacing``, by the separating-axis test.

    Every box is grown by half the spacing on all sides. Fifteen axes per pair: the six face normals and the
    nine cross products of edges (Gottschalk, Lin, Manocha 1996). Touching boxes overlap; a box overlaps itself.
    """
    half = boxes.size / 2 + spacing / 2
    radius = np.linalg.norm(half, axis=1)
    offset = boxes.center - boxes.center[one]
    near = np.flatnonzero(np.linalg.norm(offset, axis=1) <= radius + radius[one])
    mine, others = boxes.axes[one], boxes.axes[near]
    crossed = cross(mine[None, :, None, :], others[:, None, :, :]).reshape(-1, 9, 3)
    axes = np.concatenate([np.broadcast_to(mine, others.shape), others, crossed], axis=1)
    reach = product(np.abs(product(axes, mine.T)), half[one][:, None])[..., 0]
    reach += product(np.abs(product(axes, others.transpose(0, 2, 1))), half[near][:, :, None])[..., 0]
    gap = np.abs(product(axes, offset[near][:, :, None]))[..., 0] - reach
    overlap = np.zeros(len(boxes), dtype=bool)
    # Parallel edges give a null axis, on which nothing separates: the gap is then zero up to rounding.
    overlap[near] = (gap <= 1e-12).all(axis=1)
    return overlap
