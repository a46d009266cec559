"""The edit that embossing passes to the writer: removed faces, and the triangles in their place."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int


class Kind(IntEnum):
    """Part of a mark that a new triangle belongs to."""

    SURFACE = 0
    CAP = 1
    WALL = 2
    TRENCH = 3
    """Of smooth letters: the ground round them."""


LETTERS = (Kind.CAP, Kind.WALL)
"""Parts in the colour of the letters."""


@dataclass(frozen=True, eq=False)
class SurfaceEdit:
    """A change of a :class:`~core.geometry.surface.Surface`: F faces, some of them removed, and M new triangles.

    Attributes:
        keep: (F,) bool, the faces that stay exactly as they are.
        vertex: (M, 3) int64 ids; corners with equal ids are one point and have equal ``position``.
        position: (M, 3, 3) float64, size-30 frame, final (after lifting).
        source_face: (M,) int64, the surface face that a triangle was cut from; where it reaches over several, that of
            its first corner.
        corner_face: (M, 3) int64, the surface face that the attributes of each corner are interpolated in, of
            the same drawn primitive as ``source_face``.
        barycentric: (M, 3, 3) float64, coordinates of each corner in its ``corner_face``, in the corner order of
            ``surface.faces``; for a lifted corner those of its foot point.
        original: (M, 3) int64, the row of ``surface.positions`` where the corner is that untouched original vertex,
            of the same drawn primitive as ``source_face``; else -1.
        tilt: (M, 3, 3) float64, size-30 frame; what the unit normal of the ground at each corner is to be moved by, at
            right angles to it, to be along that of smooth letters. 0 elsewhere.
        kind: (M,) int8, a :class:`Kind`.
        mark: (M,) int64, the number of the mark that a triangle was added by, in the order of embossing.
    """

    keep: Bool
    vertex: Int
    position: Float
    source_face: Int
    corner_face: Int
    barycentric: Float
    original: Int
    tilt: Float
    kind: NDArray[np.int8]
    mark: Int


@dataclass(frozen=True)
class Style:
    """The look of one mark's letters.

    Attributes:
        color: "#rrggbb", in a plain material; None for the material of the ground.
        glows: whether the colour is given off as light, to be seen on ground that glows and is darker.
    """

    color: str | None = None
    glows: bool = False
