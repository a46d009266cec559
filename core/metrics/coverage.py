"""Watermark visibility over the whole sphere (the paper's Definition 2 with 200 even views)."""

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions
from core.geometry.spatial import SpatialIndex
from core.placement.selection import visibility

DIRECTIONS = 200


def coverage(boxes: Boxes, points: Float, watermarked_index: SpatialIndex) -> float:
    """Share of 200 Fibonacci directions from which at least one mark is unobstructed; higher is better.

    A mark counts from a direction that it faces within 45 degrees when the rays from all its ``points``
    (B, N, 3), see :func:`core.metrics.ray_origins.above_letters`, leave the watermarked asset unobstructed.
    """
    seen = visibility(boxes, points, watermarked_index, fibonacci_directions(DIRECTIONS))
    return float(seen.any(axis=0).mean())
