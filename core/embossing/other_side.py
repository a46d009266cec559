"""Walls so thin, or so bent, that the bounds of a mark hold their other side as well."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool
from core.choices import Mode
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.placement.context import PlacementContext
from core.placement.filters import footprint


@dataclass(frozen=True)
class OtherSideOptions:
    """Values of :func:`hold_other_side`: all ours; the paper's marks are not looked up by their boxes.

    Attributes:
        share: of a box's area that the other side may have: a good third of what letters and the ground between have.
        turned_away: cosine between the normals of a box and of a triangle, up to which the latter faces away.
    """

    share: float = 0.35
    turned_away: float = -0.5


OTHER_SIDE = OtherSideOptions()


def hold_other_side(boxes: Boxes, context: PlacementContext, options: OtherSideOptions = OTHER_SIDE) -> Bool:
    """(B,) boxes of which a viewer sees the letters, but a program that looks them up by the bounds in the report
    would find much that faces away: triangles with their centres within a relief of the bounds.

    Such a program counts triangles whole, as here: a single large one behind the many of the letters can be enough.
    Those met by rays from behind count, and small ones for those beside them.
    """
    surface, filters = context.carrier.surface, context.options.filters
    heights = context.layouts.line_height(boxes.size).tolist()
    relief = np.abs([context.parameters.relief_at(height) for height in heights])
    met = footprint(boxes, context.carrier.index, context.normals, relief, filters.footprint, margin=0.0)
    ground = np.where(np.isfinite(met.height), met.height, 0.0)
    sunken = context.parameters.mode is Mode.DEBOSS
    low = ground.min(axis=1) - (2 if sunken else 1) * relief
    high = ground.max(axis=1) + (1 if sunken else 2) * relief

    count, rays = met.face.shape
    up = np.repeat(boxes.axes[:, 2], rays, axis=0)
    start = np.concatenate([met.local, np.broadcast_to(low[:, None, None], (count, rays, 1))], axis=2)
    origin = boxes.center[:, None, :] + product(start, boxes.axes)
    _, face = context.carrier.index.first_hit(origin.reshape(-1, 3), up)
    along = np.einsum("ni,ni->n", surface.normals[face], up)
    away = np.flatnonzero((face >= 0) & (along < options.turned_away))
    total = len(surface.faces)
    pair, first, met_by = np.unique(away // rays * total + face[away], return_index=True, return_counts=True)
    box, face, along = pair // total, pair % total, along[away[first]]
    center = surface.positions[surface.faces[face]].mean(axis=1) - boxes.center[box]
    x, y, z = product(boxes.axes[box], center[:, :, None])[:, :, 0].T
    width, height, _ = boxes.size[box].T
    inside = (np.abs(x) <= width / 2) & (np.abs(y) <= height / 2) & (z >= low[box]) & (z <= high[box])
    area = np.maximum(-along * surface.areas[face], met_by * width * height / rays)
    return np.asarray(
        np.bincount(box, np.where(inside, area, 0.0), count) > options.share * boxes.size[:, 0] * boxes.size[:, 1]
    )
