"""Prominence: how much of what a viewer sees of an asset is letters."""

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, view_directions
from core.geometry.products import cross, product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.geometry.triangles import unit

PIXELS = 96  # rays along either side of the asset's outline in a view
STANDS_OUT = 0.25  # share of a mark's relief off the original from which on surface is letters


def prominence(
    original_index: SpatialIndex, watermarked: Surface, watermarked_index: SpatialIndex, boxes: Boxes, relief: Float
) -> tuple[float, float]:
    """Share of the asset's silhouette that letters cover: the mean over the paper's 24 views, and that of the view with
    the least; high is good for marks that shall deter.

    Letters are what stands out of the original (or lies in it) by a quarter of the mark's relief, in the mark's box.

    Args:
        original_index: of the asset without marks.
        watermarked: the surface of the marked one, in the original's size-30 frame.
        watermarked_index: of it.
        boxes: of the B marks.
        relief: (B,) height of each mark's letters, size-30 units.
    """
    directions, ups = view_directions()
    views, row = np.unique(np.hstack([directions, ups]), axis=0, return_inverse=True)
    shares = np.array([_share(original_index, watermarked, watermarked_index, boxes, relief, view) for view in views])
    return float(shares[row].mean()), float(shares.min())


def _share(
    original_index: SpatialIndex, watermarked: Surface, index: SpatialIndex, boxes: Boxes, relief: Float, view: Float
) -> float:
    """Share in one ``view`` (6,): the direction to the camera and what is up in the picture."""
    direction, up = view[:3], view[3:]
    used = watermarked.positions[np.unique(watermarked.faces)]
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    right = unit(cross(up, direction)[None])[0]
    axes = np.stack([right, cross(direction, right)])
    eye = middle + EYE_DISTANCE * direction
    # Over all of the asset's own outline: from its edge, a plate would fall between rays spread over its length.
    shown = product(used - middle, axes.T) / (1 - product(used - middle, direction[:, None]) / EYE_DISTANCE)
    low, high = shown.min(axis=0), shown.max(axis=0)
    steps = low + (high - low) * ((np.arange(PIXELS) + 0.5) / PIXELS)[:, None]
    screen = middle + (steps[:, None, :1] * axes[0] + steps[None, :, 1:] * axes[1]).reshape(-1, 3)
    rays = unit(screen - eye)
    distance, face = index.first_hit(np.broadcast_to(eye, rays.shape), rays, Eye.ORIGIN)
    hit = face >= 0
    if not hit.any():
        return 0.0
    points = eye + distance[hit, None] * rays[hit]
    return float(_letters(original_index, points, boxes, relief).mean())


def _letters(original_index: SpatialIndex, points: Float, boxes: Boxes, relief: Float) -> Bool:
    """(N,) the ``points`` that are of letters."""
    found = np.zeros(len(points), dtype=bool)
    owner, which = _inside(boxes, points, relief)
    apart, _, _ = original_index.closest(points[which])
    found[which[apart > STANDS_OUT * np.abs(relief[owner])]] = True
    return found


def _inside(boxes: Boxes, points: Float, relief: Float) -> tuple[Int, Int]:
    """Pairs of a mark and a point in its box, which is made higher by its relief."""
    local = np.einsum("bij,bnj->bni", boxes.axes, points[None] - boxes.center[:, None])
    half = boxes.size / 2
    half[:, 2] += np.abs(relief)
    owner, which = np.nonzero((np.abs(local) <= half[:, None]).all(axis=2))
    return owner, which
