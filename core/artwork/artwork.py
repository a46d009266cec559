"""Outlines to emboss, independent of their source."""

from dataclasses import dataclass

from core.arrays import Float


@dataclass(frozen=True, eq=False)
class Artwork:
    """Outlines to be embossed, their bounding box centred at the origin and exactly 1 wide.

    Attributes:
        label: the text as it was given.
        rings: closed, (N, 2) float64 each, without a repeated end point; outer ones run counter-clockwise, holes
            clockwise. Rings are simple and disjoint, so every fill rule gives the same shape.
        aspect: height of the bounding box (its width is 1).
        ink: share of the bounding box that the shapes cover.
        line_height: height of one line of the text, by which its legibility goes; of all of it where there is no text.
    """

    label: str
    rings: tuple[Float, ...]
    aspect: float
    ink: float
    line_height: float
