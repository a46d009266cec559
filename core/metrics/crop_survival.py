"""Crop survival: share of crops that leave a whole watermark."""

from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions
from core.geometry.surface import Surface
from core.placement.objective import centroid

HALF_SPACES = 200


def crop_survival(original: Surface, boxes: Boxes) -> float:
    """Share of 200 crops that leave at least one mark whole, 0 to 1; higher is better.

    Each crop keeps the half-space on one side of a plane through the area centroid of the ``original``; the planes'
    normals are Fibonacci directions. A mark is whole where all of its box is kept.
    """
    distance = (boxes.corners() - centroid(original)) @ fibonacci_directions(HALF_SPACES).T
    return float((distance >= 0).all(axis=1).any(axis=0).mean())
