"""glTF materials, reduced to what a preview shows."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.gltf import Document, malformed, typed
from core.asset.pixels import Texture

Float = NDArray[np.float64]

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"

_INVISIBLE = 1 / 512  # alpha that rounds to nothing: dropped, so that it hides nothing behind it


@dataclass(frozen=True, eq=False)
class Material:
    """Base colour and transparency; no metal, gloss, emission, transmission or normal map.

    Attributes:
        color: (4,) linear RGBA factor.
        texture: multiplies ``color``.
        uv_set: which TEXCOORD_n the texture uses.
        uv_transform: (2, 3), applied to (u, v, 1) (KHR_texture_transform).
        alpha_mode: "OPAQUE", "MASK" or "BLEND".
        alpha_cutoff: alpha below which nothing is drawn.
        double_sided: back faces are drawn as well.
    """

    color: Float
    texture: Texture | None
    uv_set: int
    uv_transform: Float
    alpha_mode: str
    alpha_cutoff: float
    double_sided: bool


def read_material(document: Document, index: int | None, read_texture: Callable[[int], Texture | None]) -> Material:
    """``materials[index]``, or the default material for ``None``.

    Where KHR_materials_pbrSpecularGlossiness is given, its diffuse colour is the base colour.

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    material = {} if index is None else document.entry("materials", index)
    extensions = typed(material, "extensions", dict)
    name, base = "baseColor", typed(material, "pbrMetallicRoughness", dict)
    if SPECULAR_GLOSSINESS in extensions:
        name, base = "diffuse", typed(extensions, SPECULAR_GLOSSINESS, dict)
    reference = typed(base, f"{name}Texture", dict)
    transform = typed(typed(reference, "extensions", dict), "KHR_texture_transform", dict)
    mode = material.get("alphaMode", "OPAQUE")
    try:
        return Material(
            color=np.array(base.get(f"{name}Factor", (1, 1, 1, 1)), dtype=np.float64).reshape(4),
            texture=read_texture(reference["index"]) if "index" in reference else None,
            uv_set=int(transform.get("texCoord", reference.get("texCoord", 0))),
            uv_transform=_uv_transform(transform),
            alpha_mode=mode if mode in ("MASK", "BLEND") else "OPAQUE",
            alpha_cutoff={"MASK": float(material.get("alphaCutoff", 0.5)), "BLEND": _INVISIBLE}.get(mode, 0.0),
            double_sided=bool(material.get("doubleSided", False)),
        )
    except (TypeError, ValueError, OverflowError):
        raise malformed(f"materials[{index}] has a value of the wrong type.") from None


def _uv_transform(transform: dict[str, Any]) -> Float:
    """(2, 3) matrix of a KHR_texture_transform: scale, then rotate counter-clockwise (v points down), then move."""
    angle = float(transform.get("rotation", 0.0))
    cosine, sine = np.cos(angle), np.sin(angle)
    scale = np.array(transform.get("scale", (1, 1)), dtype=np.float64).reshape(2)
    offset = np.array(transform.get("offset", (0, 0)), dtype=np.float64).reshape(2)
    return np.column_stack([np.array([[cosine, sine], [-sine, cosine]]) * scale, offset])
