"""Height of the letters in pictures, which rules on labels ask for."""

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.geometry.spatial import SpatialIndex
from core.placement.label_height import label_heights
from core.placement.selection import visibility


def label_height(boxes: Boxes, height: Float, points: Float, watermarked_index: SpatialIndex, radius: float) -> float:
    """Height of the highest letters that are seen, over the side of the picture, mean over the paper's 24 views; high
    is good.

    A mark is seen in a view as for :func:`core.metrics.ray.ray`.

    Args:
        boxes: of the B marks.
        height: (B,) of their letters, size-30 units.
        points: (B, N, 3) ray origins of each mark.
        watermarked_index: over the watermarked surface.
        radius: of the asset about the middle of its frame, size-30 units.
    """
    seen = visibility(boxes, points, watermarked_index, view_directions()[0])
    return float(label_heights(boxes, height, seen, radius).mean())
