"""glTF materials, reduced to the properties that a preview shows."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from core.arrays import Float
from core.gltf.document import Document, malformed, named, typed

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
UNLIT = "KHR_materials_unlit"
EMISSIVE_STRENGTH = "KHR_materials_emissive_strength"

_BRIGHTEST = 1e4  # linear emission, at most: far beyond white in any picture
_INVISIBLE = 1 / 512  # alpha that rounds to 0 in 8 bits: faces of less are dropped, so that they occlude nothing


@dataclass(frozen=True, eq=False)
class Emission:
    """Light that a surface emits; vertex colours do not change it.

    Attributes:
        color: (3,) linear RGB factor, its strength included (KHR_materials_emissive_strength): may exceed 1.
        texture: number of the one that multiplies ``color``; where it cannot be shown, the emission counts as none:
            most of such textures are dark.
        uv_set: number n of the texture's TEXCOORD_n.
        uv_transform: (2, 3), applied to (u, v, 1) (KHR_texture_transform).
    """

    color: Float
    texture: int | None
    uv_set: int
    uv_transform: Float


@dataclass(frozen=True, eq=False)
class Material:
    """Base colour, transparency and emission; no metal, gloss, transmission or normal map.

    Textures are named only: :func:`core.gltf.textures.texture_reader` decodes them.

    Attributes:
        index: glTF index; None for the default material.
        name: empty where the file gives none.
        color: (4,) linear RGBA factor.
        texture: number of the one that multiplies ``color``.
        uv_set: number n of the texture's TEXCOORD_n.
        uv_transform: (2, 3), applied to (u, v, 1) (KHR_texture_transform).
        alpha_mode: "OPAQUE", "MASK" or "BLEND".
        alpha_cutoff: alpha below which nothing is drawn.
        double_sided: back faces are drawn as well.
        unlit: the base colour is shown as it is, independent of lights (KHR_materials_unlit).
        emission: added to the lit colour; ``None`` where there is none.
    """

    index: int | None
    name: str
    color: Float
    texture: int | None
    uv_set: int
    uv_transform: Float
    alpha_mode: str
    alpha_cutoff: float
    double_sided: bool
    unlit: bool
    emission: Emission | None


def read_material(document: Document, index: int | None) -> Material:
    """``materials[index]``, or the default material for ``None``.

    Where KHR_materials_pbrSpecularGlossiness is given, its diffuse colour is the base colour. The emission of an unlit
    material is ignored (KHR_materials_unlit).

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    material = {} if index is None else document.entry("materials", index)
    extensions = typed(material, "extensions", dict)
    prefix, base = "baseColor", typed(material, "pbrMetallicRoughness", dict)
    if SPECULAR_GLOSSINESS in extensions:
        prefix, base = "diffuse", typed(extensions, SPECULAR_GLOSSINESS, dict)
    mode = material.get("alphaMode", "OPAQUE")
    unlit = UNLIT in extensions
    try:
        texture, uv_set, uv_transform = sampled(typed(base, f"{prefix}Texture", dict))
        return Material(
            index=index,
            name=named(material),
            color=np.array(base.get(f"{prefix}Factor", (1, 1, 1, 1)), dtype=np.float64).reshape(4),
            texture=texture,
            uv_set=uv_set,
            uv_transform=uv_transform,
            alpha_mode=mode if mode in ("MASK", "BLEND") else "OPAQUE",
            alpha_cutoff={"MASK": float(material.get("alphaCutoff", 0.5)), "BLEND": _INVISIBLE}.get(mode, 0.0),
            double_sided=bool(material.get("doubleSided", False)),
            unlit=unlit,
            emission=None if unlit else _emission(material, extensions),
        )
    except (TypeError, ValueError, OverflowError):
        raise malformed(f"materials[{index}] has a value of the wrong type.") from None


def _emission(material: dict[str, Any], extensions: dict[str, Any]) -> Emission | None:
    """The emission of a material."""
    strength = float(typed(extensions, EMISSIVE_STRENGTH, dict).get("emissiveStrength", 1.0))
    color = np.array(material.get("emissiveFactor", (0, 0, 0)), dtype=np.float64).reshape(3) * strength
    color = np.clip(np.nan_to_num(color), 0, _BRIGHTEST)
    reference = typed(material, "emissiveTexture", dict)
    if not color.any():
        return None
    texture, uv_set, uv_transform = sampled(reference)
    return None if reference and texture is None else Emission(color, texture, uv_set, uv_transform)


def sampled(reference: dict[str, Any]) -> tuple[int | None, int, Float]:
    """The texture that a glTF textureInfo refers to, the UV set it uses and the (2, 3) transform of these."""
    transform = typed(typed(reference, "extensions", dict), "KHR_texture_transform", dict)
    texture = reference.get("index")
    if texture is not None and type(texture) is not int:
        raise TypeError("the index of a texture is not an integer")
    return texture, int(transform.get("texCoord", reference.get("texCoord", 0))), _uv_transform(transform)


def _uv_transform(transform: dict[str, Any]) -> Float:
    """(2, 3) matrix of a KHR_texture_transform: scale, then rotate counter-clockwise (v points down), then move."""
    angle = float(transform.get("rotation", 0.0))
    cosine, sine = np.cos(angle), np.sin(angle)
    scale = np.array(transform.get("scale", (1, 1)), dtype=np.float64).reshape(2)
    offset = np.array(transform.get("offset", (0, 0)), dtype=np.float64).reshape(2)
    return np.column_stack([np.array([[cosine, sine], [-sine, cosine]]) * scale, offset])
