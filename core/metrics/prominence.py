"""Prominence: how much of what a viewer sees of an asset is letters."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float
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
    drawn = watermarked.positions[np.unique(watermarked.faces)]
    columns = np.ascontiguousarray(drawn.T)  # their extremes are found four times as fast
    middle = (columns.min(axis=1) + columns.max(axis=1)) / 2
    drawn = drawn - middle
    near = Boxes(boxes.center, boxes.axes, boxes.size + 2 * np.abs(relief)[:, None] * (0, 0, 1))
    shares = []
    for view in views:
        points = _seen(drawn, middle, watermarked_index, view[:3], view[3:])
        owner, which, _ = near.contained(cKDTree(points))
        apart, _, _ = original_index.closest(points[which])
        letters = np.unique(which[apart > STANDS_OUT * np.abs(relief[owner])])
        shares.append(len(letters) / max(len(points), 1))
    return float(np.mean(np.array(shares)[row])), float(min(shares))


def _seen(drawn: Float, middle: Float, index: SpatialIndex, direction: Float, up: Float) -> Float:
    """(N, 3) points of the surface in ``index``, with vertices ``drawn`` (V, 3) about its ``middle`` (3,), that a
    camera in a ``direction`` sees in the pixels of a picture with ``up`` upwards."""
    right = unit(cross(up, direction)[None])[0]
    axes = np.stack([right, cross(direction, right)])
    eye = middle + EYE_DISTANCE * direction
    # Over all of the asset's own outline: from its edge, a plate would fall between rays spread over its length.
    shown = product(drawn, axes.T) / (1 - product(drawn, direction[:, None]) / EYE_DISTANCE)
    columns = np.ascontiguousarray(shown.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    steps = low + (high - low) * ((np.arange(PIXELS) + 0.5) / PIXELS)[:, None]
    screen = middle + (steps[:, None, :1] * axes[0] + steps[None, :, 1:] * axes[1]).reshape(-1, 3)
    rays = unit(screen - eye)
    distance, face = index.first_hit(np.broadcast_to(eye, rays.shape), rays, Eye.ORIGIN)
    return np.asarray((eye + distance[:, None] * rays)[face >= 0])
