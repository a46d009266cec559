"""The colour that is seen at points of a surface, read without a renderer."""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.attributes import Points, interpolate_attribute
from core.asset.flatten import Scene
from core.asset.gltf import Document, malformed
from core.asset.materials import Emission, Material, read_material
from core.asset.pixels import Texture, read_texture
from core.asset.surface import Surface

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]

TEXTURE_LIMIT = 1024  # pixels a side: a pixel of one that spans the asset is 0.03 size-30 units, a tenth of a letter
TEXTURES_KEPT = 8  # decoded at a time, 4 MiB each
CLAMP, MIRROR = 33071, 33648

_ENCODED = np.arange(256) / 255
LINEAR = np.where(_ENCODED <= 0.04045, _ENCODED / 12.92, ((_ENCODED + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1


@dataclass(frozen=True, eq=False)
class Appearance:
    """What N points of a surface look like.

    Attributes:
        lit: (N, 3) linear RGB, 0 to 1, what the light that falls on them is multiplied by: the base colour; 0 where it
            is shown unlit.
        glow: (N, 3) linear RGB, what is seen without any light: the base colour of unlit materials, the emission of
            others. May exceed 1.
        unlit: (N,) bool, whose materials are unlit.
    """

    lit: Float
    glow: Float
    unlit: Bool

    def __getitem__(self, index: Int) -> "Appearance":
        return Appearance(self.lit[index], self.glow[index], self.unlit[index])

    @property
    def shown(self) -> Float:
        """(N, 3) linear RGB, 0 to 1, what a viewer shows in full light."""
        return np.clip(self.lit + self.glow, 0, 1)


def base_color(scene: Scene, surface: Surface, points: Float, face: Int) -> Float:
    """(N, 3) linear RGB, 0 to 1, that a viewer shows in full light at points of a surface: base colour and emission.

    Arguments and errors are those of :func:`appearance`.
    """
    return appearance(scene, surface, points, face).shown


@np.errstate(over="ignore", invalid="ignore")  # factors and transforms that no picture survives
def appearance(scene: Scene, surface: Surface, points: Float, face: Int) -> Appearance:
    """The :class:`Appearance` of ``points`` (N, 3) on the faces ``face`` (N,) of a scene's surface.

    Base colour factor x texture (KHR_texture_transform, wrap modes, its own UV set) x COLOR_0, as the renderer shows
    it: textures that it cannot show, and those of primitives without their UV set, count as white. Alpha is ignored.

    Args:
        scene: the asset.
        surface: the scene's, in which faces may be wound the other way round.
        points: size-30 frame.
        face: the face that each point lies on, with an area.

    Raises:
        MeshmarkError: ``malformed_file`` for materials that are not well formed or refer to what does not exist, and
            for vertex attributes of too few components.
    """
    owner = surface.face_primitive[face]
    first = np.array([drawn.first_vertex for drawn in scene.primitives])
    corners = surface.faces[face]
    inside = Points(corners - first[owner, None], barycentric(surface.positions[corners], points))

    # Primitives that share attributes and material, such as instances, are read once.
    kinds: dict[tuple[Any, ...], int] = {}
    kind_of = np.zeros(len(scene.primitives), dtype=np.int64)
    for number in np.unique(owner).tolist():
        drawn = scene.primitives[number]
        primitive = scene.document.entry("meshes", drawn.mesh)["primitives"][drawn.primitive]
        key = primitive.get("material"), tuple(sorted(primitive["attributes"].items()))
        kind_of[number] = kinds.setdefault(key, len(kinds))

    texture = lru_cache(TEXTURES_KEPT)(partial(read_texture, scene.document, limit=TEXTURE_LIMIT))
    lit, glow, unlit = np.zeros((len(points), 3)), np.zeros((len(points), 3)), np.zeros(len(points), dtype=bool)
    for (material, attributes), kind in kinds.items():
        mine = np.flatnonzero(kind_of[owner] == kind)
        seen = read_material(scene.document, material, texture)
        color = np.clip(np.nan_to_num(_seen(scene.document, seen, dict(attributes), inside[mine])), 0, 1)
        (glow if seen.unlit else lit)[mine] = color
        if seen.emission is not None:
            glow[mine] = _emitted(scene.document, seen.emission, dict(attributes), inside[mine])
        unlit[mine] = seen.unlit
    return Appearance(lit, glow, unlit)


def _seen(document: Document, material: Material, attributes: dict[str, int], points: Points) -> Float:
    """(C, 3) linear colours at points of primitives with one material and the same attributes."""
    color = np.repeat(material.color[None, :3], len(points.rows), axis=0)
    uv = _attribute(document, f"TEXCOORD_{material.uv_set}", attributes, points, columns=2)
    if material.texture is not None and uv is not None:
        moved = uv @ material.uv_transform[:, :2].T + material.uv_transform[:, 2]
        color *= _texels(material.texture, np.nan_to_num(moved))
    tint = _attribute(document, "COLOR_0", attributes, points, columns=3)
    return color if tint is None else color * tint


def _emitted(document: Document, emission: Emission, attributes: dict[str, int], points: Points) -> Float:
    """(C, 3) linear light that points of such primitives give off; 0 where the UV set of its texture is missing."""
    color = np.repeat(emission.color[None], len(points.rows), axis=0)
    if emission.texture is None:
        return color
    uv = _attribute(document, f"TEXCOORD_{emission.uv_set}", attributes, points, columns=2)
    if uv is None:
        return np.zeros_like(color)
    moved = uv @ emission.uv_transform[:, :2].T + emission.uv_transform[:, 2]
    return np.asarray(color * _texels(emission.texture, np.nan_to_num(moved)))


def _attribute(document: Document, name: str, attributes: dict[str, int], points: Points, columns: int) -> Float | None:
    """(C, columns) values at the points, what is not finite as 0; ``None`` where there is no such attribute."""
    if name not in attributes:
        return None
    values = interpolate_attribute(document, name, attributes[name], points)
    if values.shape[1] < columns:
        raise malformed(f"accessors[{attributes[name]}] has too few components to be a {name}.")
    return np.nan_to_num(values[:, :columns], nan=0.0, posinf=0.0, neginf=0.0)


def _texels(texture: Texture, uv: Float) -> Float:
    """(C, 3) linear colours of a texture at ``uv`` (C, 2), between texels as its sampler says."""
    height, width = texture.pixels.shape[:2]
    (left, right, along), (upper, lower, down) = (
        _neighbours(uv[:, axis], size, texture.wrap[axis], texture.nearest) for axis, size in ((0, width), (1, height))
    )
    color = np.zeros((len(uv), 3))
    for column, across in ((left, 1 - along), (right, along)):
        for row, share in ((upper, across * (1 - down)), (lower, across * down)):
            color += share[:, None] * LINEAR[texture.pixels[row, column, :3]]
    return color


def _neighbours(at: Float, size: int, wrap: int, nearest: bool) -> tuple[Int, Int, Float]:
    """The two of ``size`` texels around each texture coordinate (C,), and the share of the second."""
    if wrap == CLAMP:
        inside = np.clip(at, 0, 1)
    elif wrap == MIRROR:
        inside = 1 - np.abs(at % 2 - 1)
    else:
        inside = at % 1
    place = inside * size - 0.5
    first = np.floor(place)
    share = place - first
    low = first.astype(np.int64)
    ends = np.stack([low, low + 1])
    ends = np.clip(ends, 0, size - 1) if wrap in (CLAMP, MIRROR) else ends % size
    return ends[0], ends[1], np.round(share) if nearest else share


def barycentric(corners: Float, points: Float) -> Float:
    """(N, 3) coordinates of ``points`` (N, 3) in the triangles ``corners`` (N, 3, 3) they lie in."""
    a, b, to = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    normal = np.cross(a, b)
    area = np.einsum("ni,ni->n", normal, normal)
    second = np.einsum("ni,ni->n", np.cross(to, b), normal) / area
    third = np.einsum("ni,ni->n", np.cross(a, to), normal) / area
    inside = np.clip(np.column_stack([1 - second - third, second, third]), 0, 1)
    return np.asarray(inside / inside.sum(axis=1, keepdims=True))
