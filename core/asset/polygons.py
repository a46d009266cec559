"""Polygons with indexed corners, as OBJ, PLY and OFF store them, and their triangulation."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.asset.budgets import Budgets, within
from core.asset.grouping import float_words, group_rows

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_BLOCK = 2**20  # corners worked on at a time: bounds the memory of a five-million-quad file


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
    """How a group of polygons looks; all colours are linear.

    Attributes:
        name: as in the file, empty where it has none.
        color: base colour with alpha; ``None`` where the file says nothing.
        metallic: 0 to 1.
        roughness: 0 to 1, as perceived.
        emissive: light of its own.
        texture: an encoded image that gives the base colour on TEXCOORD_0; its bytes are never changed.
        normal_map: an encoded tangent-space normal map.
        masked: whether the alpha of the texture cuts the surface out.
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


def linear(colors: Float) -> Float:
    """Colours (..., 3 or 4) in 0-1 from sRGB, as files store them, to linear, as glTF does; alpha stays."""
    rgb = colors[..., :3]
    result = colors.copy()
    result[..., :3] = np.where(rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0) + 0.055) / 1.055) ** 2.4)
    return result


def color_fractions(colors: Float) -> Float:
    """Colours (N, 3 or 4) in 0-1 from numbers of a range that nothing tells; what is not finite stays.

    They are in 0-255 where they plainly are, by whole numbers over 1 or by any over 2, and in 0-65535 over 255; what
    an optimiser left slightly over 1 is clipped. An alpha of at most 1 is a fraction whatever the range of the others.
    """
    result = colors.copy()
    for channels in (slice(0, 3), slice(3, 4)):
        values = colors[:, channels]
        finite = values[np.isfinite(values)]
        most = finite.max(initial=0.0)
        if most > 2 or (most > 1 and np.all(finite == np.floor(finite))):
            result[:, channels] = values / (65535.0 if most > 255 else 255.0)
    return np.clip(result, 0, 1)


def hex_linear(color: str) -> Float:
    """(3,) linear RGB, 0-1, of ``"#rrggbb"``."""
    return linear(np.array([int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]))


def hex_srgb(color: Float) -> str:
    """The nearest ``"#rrggbb"`` to linear RGB (3,) in 0-1: the inverse of :func:`hex_linear`."""
    encoded = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{level:02x}" for level in np.rint(encoded * 255).astype(int).tolist())


def check_sizes(sizes: Int, budgets: Budgets) -> None:
    """Refuse polygons, given the corners (P,) of each, that are too large or make too many triangles.

    Raises:
        MeshmarkError: ``budget_exceeded``.
    """
    within(int(sizes.max(initial=0)), budgets.polygon_corners, "corners in one polygon")
    within(int(np.maximum(sizes - 2, 0).sum()), budgets.faces, "triangles")


def triangulate(positions: Float, corners: Int, sizes: Int) -> tuple[Int, Int]:
    """Split polygons into triangles, in polygon order.

    Convex polygons become fans about their first corner; a concave quad is cut at its reflex corner; other concave
    polygons are clipped in their plane. Polygons with fewer than three corners draw nothing and vanish.

    Args:
        positions: (V, 3).
        corners: (C,) vertex of each corner, in range.
        sizes: (P,) corners of each polygon, summing to C.

    Returns:
        (T, 3) corner numbers and (T,) the polygon of each triangle.
    """
    first = np.cumsum(sizes) - sizes
    count = np.maximum(sizes - 2, 0)
    offset = np.cumsum(count) - count
    triangles = np.empty((int(count.sum()), 3), np.int64)
    for size, rows in _blocks(sizes):
        local = np.broadcast_to(_fan(size, 0), (len(rows), size - 2, 3))
        if size > 3:
            local = _cut(positions[corners[first[rows][:, None] + np.arange(size)]], local)
        triangles[offset[rows][:, None] + np.arange(size - 2)] = local + first[rows][:, None, None]
    return triangles, np.repeat(np.arange(len(sizes)), count)


def weld(values: Float) -> Int:
    """(N,) for each row of (N, n) values, the first row that is exactly equal to it."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32)
    # half the words to sort where nothing is lost, as in every binary STL
    label = group_rows(float_words(single if np.array_equal(single, values) else values))
    return np.asarray(np.unique(label, return_index=True)[1][label])


def _blocks(sizes: Int) -> Iterator[tuple[int, Int]]:
    """Polygon numbers by size, at most ``_BLOCK`` corners (or one polygon) at a time."""
    order = np.argsort(sizes, kind="stable")
    order = order[sizes[order] >= 3]
    for rows in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1):
        if len(rows):  # there is one empty group where there is no polygon
            size = int(sizes[rows[0]])
            step = max(1, _BLOCK // size)
            for block in range(0, len(rows), step):
                yield size, rows[block : block + step]


def _fan(size: int, start: int) -> Int:
    """(size - 2, 3) the fan of one polygon about corner ``start``."""
    middle = np.arange(1, size - 1)
    return (np.column_stack([np.zeros_like(middle), middle, middle + 1]) + start) % size


def _cut(points: Float, fans: Int) -> Int:
    """(R, n - 2, 3) triangles of R polygons (R, n, 3), given their fans."""
    size = points.shape[1]
    ahead = np.roll(points, -1, axis=1) - points
    turn = np.cross(np.roll(ahead, 1, axis=1), ahead)
    normal = np.cross(points - points[:, :1], np.roll(points, -1, axis=1) - points[:, :1]).sum(axis=1)
    reflex = np.einsum("rnk,rk->rn", turn, normal) < 0
    concave = np.flatnonzero(reflex.any(axis=1))
    if len(concave) == 0:
        return fans
    result = fans.copy()
    if size == 4:
        result[reflex[:, 1] | reflex[:, 3]] = _fan(4, 1)
        return result
    for row in concave:
        clipped = _clip(points[row], normal[row])
        if len(clipped) == size - 2:  # fewer for an outline that crosses itself: it has no triangulation, keep the fan
            result[row] = clipped
    return result


def _clip(points: Float, normal: Float) -> Int:
    """Triangles of a simple polygon (n, 3), seen along ``normal``."""
    # Imported here because the API imports this module for its gate, and must stay small.
    from manifold3d import triangulate as triangulate_outlines

    drop = int(np.argmax(np.abs(normal)))
    flat = points[:, [(drop + 1) % 3, (drop + 2) % 3]]
    flat = flat - flat.min(axis=0)
    flat /= max(float(flat.max()), np.finfo(np.float64).tiny)
    if normal[drop] < 0:
        flat = flat[:, ::-1]
    return np.asarray(triangulate_outlines([np.ascontiguousarray(flat)]), np.int64)
