"""Colours of letters without a material of their own: vertex colours, on a texel of the asset's own texture.

A material of their own would be the handle by which letters are selected and deleted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from core.arrays import Bool, Float
from core.errors import MeshmarkError
from core.geometry.products import product
from core.gltf.accessors import dequantize
from core.gltf.attributes import encode
from core.gltf.base_color import LINEAR
from core.gltf.colored_by import ColoredBy
from core.gltf.colors import cielab, hex_linear
from core.gltf.document import COMPONENT_TYPES, Document, typed
from core.gltf.edit import LETTERS, Style, SurfaceEdit
from core.gltf.materials import UNLIT, Material, sampled
from core.gltf.primitives import Primitive
from core.gltf.scene import Scene
from core.gltf.textures import ReadTexture, Texture, texture_reader

VARIANTS, ANIMATION_POINTER = "KHR_materials_variants", "KHR_animation_pointer"
# Extensions of a material that leave its base colour what is seen, where they have no texture.
HARMLESS = {
    UNLIT,
    *("KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_specular"),
}
# CIELAB units between the colour asked for and the one reached, at most; and by which two of these are alike.
NEAR, ALIKE = 8.0, 0.1
SWATCH = 8  # pixels a side of the patches of even colour that a texture is searched for; fewer where it is small
EVEN = 24  # levels of 255 between the pixels of a patch, at most
# Of a patch in the other textures: metal shows what it mirrors where it is smooth; a normal map should be flat there,
# and not in the shadow of something.
METAL, ROUGH, TILTED, IN_LIGHT = 0.5, 0.4, 0.2, 0.7
METAL_MAP, NORMAL_MAP, SHADOW_MAP = "metallicRoughnessTexture", "normalTexture", "occlusionTexture"
FLOAT = 5126  # component type
SINGULAR = 1e-9  # determinant of a transform of texture coordinates


@dataclass(frozen=True, eq=False)
class Tint:
    """The colour of letters in the source's own primitive and material.

    Attributes:
        color: (3,) linear, 0 to 1: their COLOR_0; in steps of 1/255 where that is in 8 bits.
        uv: (2,) their texture coordinates, as the attribute stores them; None without a texture.
        moved: the material's factor is darker than the letters: it goes into the vertex colours of the primitive.
        error: CIELAB distance of what is reached from what was asked for.
    """

    color: Float
    uv: Float | None
    moved: bool
    error: float

    @property
    def colored_by(self) -> ColoredBy:
        """The way that a report names."""
        return ColoredBy.VERTEX_COLORS if self.uv is None else ColoredBy.TEXEL


@dataclass(frozen=True, eq=False)
class Swatches:
    """N patches of even colour in a texture.

    Attributes:
        uv: (N, 2) their centres, as the attribute stores them.
        color: (N, 3) linear, 0 to 1.
    """

    uv: Float
    color: Float


PLAIN = Swatches(np.zeros((1, 2)), np.ones((1, 3)))  # where there is no texture


@dataclass(frozen=True)
class Coloring:
    """The most conspicuous way in which the letters of one mark have their colour, of those on its primitives, and the
    largest CIELAB distance from what was asked for."""

    colored_by: ColoredBy
    error: float


class Tints:
    """The tints of letters on the primitives of a document, each decided once.

    Args:
        document: that the primitives are of.
        read: its textures; one of its own if None.
    """

    def __init__(self, document: Document, read: ReadTexture | None = None) -> None:
        self._document = document
        self._read = read or texture_reader(document)
        self._tint = lru_cache(None)(self._find)
        self._swatches = lru_cache(None)(self._search)

    def of(self, primitive: Primitive, style: Style) -> Tint | None:
        """The tint of letters of a ``style``, which has a colour; None where they need a material of their own.

        That is where more than the base colour decides what is seen (emission, transparency, mirrors, variants), where
        no patch of the texture can be made to look like the colour, and where a part of the material that nothing else
        reads is malformed.
        """
        material, uv = primitive.material, None
        try:
            if (style.glows and not material.unlit) or not self._is_plain(primitive):
                return None
            if material.texture is not None:
                uv = primitive.attributes.get(f"TEXCOORD_{material.uv_set}", -1)
            return self._tint(material, uv, str(style.color))
        except (TypeError, ValueError, OverflowError, MeshmarkError):
            return None

    def of_marks(self, scene: Scene, edit: SurfaceEdit, styles: Sequence[Style]) -> list[Coloring | None]:
        """The :class:`Coloring` of each mark; None where its letters have the colour of the surface."""
        letter = np.isin(edit.kind, LETTERS)
        owner = scene.surface.face_primitive[edit.source_face]
        found: list[Coloring | None] = []
        for number, style in enumerate(styles):
            if style.color is None:
                found.append(None)
                continue
            mine = np.unique(owner[letter & (edit.mark == number)]).tolist()
            tints = [self.of(scene.primitives[index].primitive, style) for index in mine]
            ways = [ColoredBy.MATERIAL if tint is None else tint.colored_by for tint in tints]
            error = max((tint.error for tint in tints if tint is not None), default=0.0)
            found.append(Coloring(max(ways, key=list(ColoredBy).index), error))
        return found

    def _is_plain(self, primitive: Primitive) -> bool:
        """True where what is seen of a primitive is its base colour, in every variant and pose."""
        material, source = primitive.material, self._source(primitive.material)
        if material.alpha_mode != "OPAQUE" or material.emission is not None or not (material.color <= 1).all():
            return False
        if VARIANTS in primitive.json.get("extensions", {}) or any("COLOR_0" in one for one in primitive.targets):
            return False
        if "COLOR_0" in primitive.attributes:
            colors = self._document.entry("accessors", primitive.attributes["COLOR_0"])
            if colors["componentType"] != FLOAT and not colors.get("normalized", False):
                return False
        extensions = typed(source, "extensions", dict)
        if not extensions.keys() <= HARMLESS or any(
            key.endswith("Texture") for name in extensions for key in typed(extensions, name, dict)
        ):
            return False
        mapped = METAL_MAP in typed(source, "pbrMetallicRoughness", dict)
        return material.unlit or mapped or bool(_is_matt(*_metal(source)))

    def _source(self, material: Material) -> dict[str, Any]:
        return {} if material.index is None else self._document.entry("materials", material.index)

    def _find(self, material: Material, uv: int | None, color: str) -> Tint | None:
        found = PLAIN if uv is None else None if uv < 0 else self._swatches(material, uv)
        if found is None:
            return None
        wanted = hex_linear(color)
        asked, own = cielab(wanted[None]), cielab(found.color)
        fixed = ANIMATION_POINTER in self._document.json.get("extensionsUsed", [])
        for moved in (False,) if fixed else (False, True):
            ground = found.color * (1.0 if moved else np.clip(material.color[:3], 0, 1))
            share = np.divide(wanted, ground, out=np.ones_like(ground), where=ground > wanted)
            share = share if moved else np.round(share * 255) / 255  # 8 bits, as they are written
            error = np.linalg.norm(cielab(share * ground) - asked, axis=1)
            # Of those that come as near as the nearest does, the patch that needs the least tint.
            alike = np.flatnonzero(error <= error.min() + ALIKE)
            best = alike[np.linalg.norm(own[alike] - asked, axis=1).argmin()]
            if error[best] <= NEAR:
                return Tint(share[best], None if uv is None else found.uv[best], moved, float(error[best]))
        return None

    def _search(self, material: Material, accessor: int) -> Swatches | None:
        """Patches of the base colour's texture that are even in it, and plain in the others that lie on it; None where
        there are none, or a texture cannot be decoded."""
        assert material.texture is not None
        source = self._source(material)
        base = typed(source, "pbrMetallicRoughness", dict)
        texture = self._read(material.texture)
        if texture is None:
            return None
        at, color = _even(texture)
        good = np.ones(len(at), dtype=bool)
        for owner, name in ((base, METAL_MAP), (source, NORMAL_MAP), (source, SHADOW_MAP)):
            reference = typed(owner, name, dict)
            number, uv_set, transform = sampled(reference)
            if number is None or material.unlit or uv_set != material.uv_set:
                continue
            other = self._read(number)
            if other is None or not np.array_equal(transform, material.uv_transform):
                return None
            good &= _is_plain_there(name, _pixels(other, at) / 255, source)
        uv, exact = self._stored(at[good], material, accessor, texture)
        return Swatches(uv[exact], color[good][exact]) if exact.any() else None

    def _stored(self, at: Float, material: Material, accessor: int, texture: Texture) -> tuple[Float, Bool]:
        """(N, 2) places ``at`` in the image as the attribute stores them, and (N,) those where it is exact enough."""
        turn, shift = material.uv_transform[:, :2], material.uv_transform[:, 2]
        if not abs(np.linalg.det(turn)) > SINGULAR:
            return at, np.zeros(len(at), dtype=bool)
        uv = np.asarray(np.linalg.solve(turn, (at - shift).T).T, dtype=np.float64)
        entry = self._document.entry("accessors", accessor)
        stored = encode(uv, COMPONENT_TYPES[entry["componentType"]], entry.get("normalized", False))
        again = product(dequantize(stored, entry), turn.T) + shift
        off = np.abs(again - at) * texture.pixels.shape[1::-1]
        return uv, np.asarray((off < SWATCH / 4).all(axis=1))


def _even(texture: Texture) -> tuple[Float, Float]:
    """(N, 2) centres, as shares of the image, and (N, 3) linear colours of square patches of even colour."""
    height, width = texture.pixels.shape[:2]
    side = max(1, min(SWATCH, min(height, width) // 16))
    rows, columns = height // side, width // side
    pixels = texture.pixels[: rows * side, : columns * side]
    low, high = (
        reduce(bound, (by_row[:, pixel::side] for pixel in range(side)))[..., :3]
        for bound in (np.minimum, np.maximum)
        for by_row in (reduce(bound, (pixels[pixel::side] for pixel in range(side))),)
    )
    row, column = np.nonzero((high - low <= EVEN).all(axis=2))
    at = (np.column_stack([column, row]) + 0.5) * side / (width, height)
    whole = np.ascontiguousarray(pixels).view(np.uint32).reshape(rows, side, columns, side)[row, :, column]
    by_pixel = np.ascontiguousarray(whole.reshape(len(row), side**2).T).view(np.uint8).reshape(side**2, len(row), 4)
    return at, sum(LINEAR[colors[:, :3]] for colors in by_pixel) / side**2


def _pixels(texture: Texture, at: Float) -> Float:
    """(N, 4) pixels of a texture, 0 to 255, at (N, 2) shares of its image."""
    height, width = texture.pixels.shape[:2]
    column, row = np.minimum(at * (width, height), (width - 1, height - 1)).astype(np.int64).T
    return np.asarray(texture.pixels[row, column], dtype=np.float64)


def _is_plain_there(name: str, values: Float, source: dict[str, Any]) -> Bool:
    """(N,) patches that a map of a material, with ``values`` (N, 4) in 0 to 1, leaves as plain as their base colour."""
    if name == METAL_MAP:
        metallic, roughness = _metal(source)
        return _is_matt(metallic * values[:, 2], roughness * values[:, 1])
    if name == NORMAL_MAP:
        return np.asarray(np.linalg.norm(2 * values[:, :2] - 1, axis=1) <= TILTED)
    return np.asarray(values[:, 0] >= IN_LIGHT)


def _is_matt(metallic: Float | float, roughness: Float | float) -> Bool:
    return np.asarray((np.asarray(metallic) <= METAL) | (np.asarray(roughness) >= ROUGH))


def _metal(source: dict[str, Any]) -> tuple[float, float]:
    """The metallic and the roughness factor of a material."""
    base = typed(source, "pbrMetallicRoughness", dict)
    return float(base.get("metallicFactor", 1.0)), float(base.get("roughnessFactor", 1.0))
