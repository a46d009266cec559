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


@dataclass(frozen=True, eq=False)
class SurfaceEdit:
    """A change of a :class:`~core.geometry.surface.Surface`: F faces, some of them removed, and M new triangles.

    Attributes:
        keep: (F,) bool, the faces that stay exactly as they are.
        vertex: (M, 3) int64 ids; corners with equal ids are one point and have equal ``position``.
        position: (M, 3, 3) float64, size-30 frame, final (after lifting).
        source_face: (M,) int64, the surface face that a triangle was cut from; its attributes are interpolated there.
        barycentric: (M, 3, 3) float64, coordinates of each corner in ``source_face``, in the corner order of
            ``surface.faces[source_face]``; for a lifted corner those of its foot point.
        original: (M, 3) int64, the row of ``surface.positions`` where the corner is that untouched original vertex,
            of the same drawn primitive as ``source_face``; else -1.
        kind: (M,) int8, a :class:`Kind`.
        mark: (M,) int64, the number of the mark that a triangle was added by, in the order of embossing.
    """

    keep: Bool
    vertex: Int
    position: Float
    source_face: Int
    barycentric: Float
    original: Int
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
