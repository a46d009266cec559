"""Ray Casting Visibility (paper, supplement "Watermark Quality")."""

import numpy as np

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.geometry.spatial import SpatialIndex
from core.placement.objective import facing
from core.placement.selection import visibility


def ray(boxes: Boxes, points: Float, watermarked_index: SpatialIndex) -> float:
    """Visibility of the marks in the paper's 24 views, 0 to 1; higher is better.

    In each view the marks that face the camera within 45 degrees score 1 if the rays from all their points reach the
    camera unobstructed by the watermarked asset, else 0; the view scores their mean, 0 where no mark faces it. The
    result is the mean over views.

    Args:
        boxes: the marks.
        points: (B, N, 3) ray origins of each mark: :func:`core.metrics.ray_origins.above_letters` for ``ray``,
            :func:`core.metrics.ray_origins.top_face` for the supplement's ``ray_box``.
        watermarked_index: over the watermarked surface.
    """
    directions, _ = view_directions()
    candidates = facing(boxes, directions).sum(axis=0)
    seen = visibility(boxes, points, watermarked_index, directions).sum(axis=0)
    return float(np.mean(seen / np.maximum(candidates, 1)))
