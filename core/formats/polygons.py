"""Polygons with indexed corners, as OBJ, PLY and OFF store them."""

from dataclasses import dataclass, field

import numpy as np

from core.arrays import Float, Int
from core.budgets import Budgets, within


@dataclass(frozen=True, eq=False)
class Attribute:
    """Values that corners refer to.

    Attributes:
        values: (K, n) float64.
        index: (C,) int64, the row of each corner; -1 where a corner has none.
    """

    values: Float
    index: Int


@dataclass(frozen=True)
class Material:
    """Material of a group of polygons; all colours are linear.

    Attributes:
        name: as in the file, empty where it has none.
        color: base colour with alpha; ``None`` where the file has none.
        metallic: 0 to 1.
        roughness: 0 to 1, as perceived.
        emissive: emission.
        texture: an encoded image that gives the base colour on TEXCOORD_0; its bytes are never changed.
        normal_map: an encoded tangent-space normal map.
        masked: the alpha of the texture cuts the surface out.
    """

    name: str = ""
    color: tuple[float, float, float, float] | None = None
    metallic: float = 0.0
    roughness: float = 0.7
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: bytes | None = None
    normal_map: bytes | None = None
    masked: bool = False


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """Polygons in file order.

    Attributes:
        positions: (V, 3) float64.
        corners: (C,) int64 into ``positions``, polygon after polygon; may be out of range as read from a file.
        sizes: (P,) int64, corners of each polygon.
        attributes: by glTF name: NORMAL (K, 3), TEXCOORD_0 (K, 2) with V downwards, COLOR_0 (K, 4) sRGB in 0-1.
        group: (P,) int64 into ``materials``.
        materials: one without a name where the format has none.
    """

    positions: Float
    corners: Int
    sizes: Int
    group: Int
    attributes: dict[str, Attribute] = field(default_factory=dict)
    materials: tuple[Material, ...] = (Material(),)


def color_fractions(colors: Float) -> Float:
    """Colours (N, 3 or 4) in 0-1 from numbers of an undeclared range; values that are not finite stay.

    They are in 0-255 where whole numbers exceed 1 or any exceed 2, and in 0-65535 over 255; values that an optimiser
    left slightly over 1 are clipped. An alpha of at most 1 is a fraction in every range of the others.
    """
    result = colors.copy()
    for channels in (slice(0, 3), slice(3, 4)):
        values = colors[:, channels]
        finite = values[np.isfinite(values)]
        most = finite.max(initial=0.0)
        if most > 2 or (most > 1 and np.all(finite == np.floor(finite))):
            result[:, channels] = values / (65535.0 if most > 255 else 255.0)
    return np.clip(result, 0, 1)


def check_sizes(sizes: Int, budgets: Budgets) -> None:
    """Refuse polygons, given the corners (P,) of each, that are too large or make too many triangles.

    Raises:
        MeshmarkError: ``budget_exceeded``.
    """
    within(int(sizes.max(initial=0)), budgets.polygon_corners, "corners in one polygon")
    within(int(np.maximum(sizes - 2, 0).sum()), budgets.faces, "triangles")
