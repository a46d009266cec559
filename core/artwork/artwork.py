"""Outlines to emboss, independent of their source."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from core.arrays import Float

SOFT_REACH = 1.8  # mean stroke widths round letters of a soft profile in which the ground changes: their trench

Logo: TypeAlias = Literal["svg", "qr"]


@dataclass(frozen=True)
class FaceUse:
    """A typeface that letters of an artwork come from.

    Attributes:
        name, version: as the font says itself.
        offset: how far its outlines were moved outwards to thicken them, in ems.
    """

    name: str
    version: str
    offset: float


@dataclass(frozen=True, eq=False)
class Artwork:
    """Outlines to be embossed, their bounding box centred at the origin and exactly 1 wide.

    Attributes:
        label: the text as it was given; empty where there is none.
        rings: closed, (N, 2) float64 each, without a repeated end point; outer ones run counter-clockwise, holes
            clockwise. Rings are simple and disjoint, so every fill rule gives the same shape.
        aspect: height of the bounding box (its width is 1).
        ink: share of the bounding box that the shapes cover.
        line_height: height of one line of the text, by which its legibility goes; of all of it where there is no text.
        lines: of the text; none where there is no text.
        faces: the typefaces that served, in the order of their first letters.
        logo: "svg" for a logo, "qr" for a QR code, alone or beside the text.
        least_width: below which its QR code cannot be read, where the asset's largest side is 30; 0 without one.
        light: the rings for letters lighter than the ground, where these are others: a QR code is dark on light.
    """

    label: str
    rings: tuple[Float, ...]
    aspect: float
    ink: float
    line_height: float
    lines: tuple[str, ...] = ()
    faces: tuple[FaceUse, ...] = ()
    logo: Logo | None = None
    least_width: float = 0.0
    light: tuple[Float, ...] | None = None

    @property
    def stroke(self) -> float:
        """Mean width of the shapes' strokes, text widths: as a strip of their area and perimeter has."""
        around = sum(float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum()) for ring in self.rings)
        return 2 * self.ink * self.aspect / around
