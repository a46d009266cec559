"""Local Curvature Error (paper, supplement "Asset Utility")."""

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface
from core.metrics.near import near
from core.placement.boxes import Boxes
from core.spatial import SpatialIndex


def lce(original_index: SpatialIndex, watermarked: Surface, boxes: Boxes, relief: NDArray[np.float64]) -> float | None:
    """Variance of the distance to the original over the vertices on each mark's top, mean over marks.

    Squared size-30 units; lower is better, 0 where letters follow the surface exactly. A vertex is on a top when
    it lies in the box, extended by 1.5 reliefs to the front and back, more than half a relief off the original.
    None where no mark has any such vertex. ``relief`` is (B,), the height of each mark's letters.
    """
    reach = Boxes(boxes.center, boxes.axes, boxes.size + 3 * np.abs(relief)[:, None] * [0.0, 0.0, 1.0])
    variances = []
    for number, faces in enumerate(near(watermarked, reach)):
        vertices = np.unique(watermarked.faces[faces])
        local = reach.to_local(number, watermarked.positions[vertices])
        inside = vertices[(np.abs(local) <= reach.size[number] / 2).all(axis=1)]
        distance, _, _ = original_index.closest(watermarked.positions[inside])
        top = distance[distance > abs(relief[number]) / 2]
        if len(top):
            variances.append(float(top.var()))
    return float(np.mean(variances)) if variances else None
