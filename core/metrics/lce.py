"""Local Curvature Error (paper, supplement "Asset Utility")."""

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface
from core.placement.boxes import Boxes
from core.spatial import SpatialIndex


def lce(original_index: SpatialIndex, watermarked: Surface, boxes: Boxes, relief: NDArray[np.float64]) -> float | None:
    """Variance of the distance to the original over the vertices on each mark's top, mean over marks.

    Squared size-30 units; lower is better, 0 where letters follow the surface exactly. A vertex is on a top when
    it lies in the box, extended by 1.5 reliefs to the front and back, more than half a relief off the original.
    None where no mark has any such vertex. ``relief`` is (B,), the height of each mark's letters.
    """
    variances = []
    for number, height in enumerate(np.abs(relief)):
        half = boxes.size[number] / 2 + np.array([0.0, 0.0, 1.5 * height])
        local = boxes.to_local(number, watermarked.positions)
        inside = (np.abs(local) <= half).all(axis=1)
        distance, _, _ = original_index.closest(watermarked.positions[inside])
        top = distance[distance > height / 2]
        if len(top):
            variances.append(float(top.var()))
    return float(np.mean(variances)) if variances else None
