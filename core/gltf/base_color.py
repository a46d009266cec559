"""The colours of points of a primitive as a viewer calculates them: base colour, alpha and emission."""

import numpy as np

from core.arrays import Float, Int
from core.geometry.products import product
from core.gltf.attributes import Points, interpolate_attribute
from core.gltf.document import Document, malformed
from core.gltf.materials import Emission, Material
from core.gltf.textures import Texture

CLAMP, MIRROR = 33071, 33648

_ENCODED = np.arange(256) / 255
LINEAR = np.where(_ENCODED <= 0.04045, _ENCODED / 12.92, ((_ENCODED + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1


@np.errstate(over="ignore", invalid="ignore")  # factors and transforms of any size
def base_color(
    document: Document, material: Material, texture: Texture | None, attributes: dict[str, int], points: Points
) -> Float:
    """(C, 4) linear RGBA, 0 to 1, at points of primitives with one material, its texture, and the same attributes.

    Factor x texture (KHR_texture_transform, wrap modes, its own UV set) x COLOR_0; a texture that cannot be shown, or
    whose UV set is missing, counts as white. Alpha is the file's, before ``alphaMode`` applies.

    Raises:
        MeshmarkError: ``malformed_file`` for vertex attributes of too few components.
    """
    color = np.repeat(material.color[None], len(points.rows), axis=0)
    uv = _attribute(document, f"TEXCOORD_{material.uv_set}", attributes, points, columns=2)
    if texture is not None and uv is not None:
        moved = product(uv, material.uv_transform[:, :2].T) + material.uv_transform[:, 2]
        color *= _texels(texture, np.nan_to_num(moved))
    tint = _attribute(document, "COLOR_0", attributes, points, columns=3)
    if tint is not None:
        color[:, : tint.shape[1]] *= tint
    return np.asarray(np.clip(np.nan_to_num(color), 0, 1))


@np.errstate(over="ignore", invalid="ignore")
def emitted(
    document: Document, emission: Emission, texture: Texture | None, attributes: dict[str, int], points: Points
) -> Float:
    """(C, 3) linear RGB emission at points of such primitives; 0 where its texture cannot be shown or lacks its UV set.

    Raises:
        MeshmarkError: as :func:`base_color`.
    """
    color = np.repeat(emission.color[None], len(points.rows), axis=0)
    if emission.texture is None:
        return color
    if texture is None:
        return np.zeros_like(color)
    uv = _attribute(document, f"TEXCOORD_{emission.uv_set}", attributes, points, columns=2)
    if uv is None:
        return np.zeros_like(color)
    moved = product(uv, emission.uv_transform[:, :2].T) + emission.uv_transform[:, 2]
    return np.asarray(color * _texels(texture, np.nan_to_num(moved))[:, :3])


def _attribute(document: Document, name: str, attributes: dict[str, int], points: Points, columns: int) -> Float | None:
    """(C, ``columns`` to 4) values at the points, 0 where they are not finite; ``None`` where there are none."""
    if name not in attributes:
        return None
    values = interpolate_attribute(document, name, attributes[name], points)
    if values.shape[1] < columns:
        raise malformed(f"accessors[{attributes[name]}] has too few components to be a {name}.")
    kept = 4 if name == "COLOR_0" else columns
    return np.nan_to_num(values[:, :kept], nan=0.0, posinf=0.0, neginf=0.0)


def _texels(texture: Texture, uv: Float) -> Float:
    """(C, 4) linear colours and alpha of a texture at ``uv`` (C, 2), between texels as its sampler says."""
    height, width = texture.pixels.shape[:2]
    (left, right, along), (upper, lower, down) = (
        _neighbours(uv[:, axis], size, texture.wrap[axis], texture.nearest) for axis, size in ((0, width), (1, height))
    )
    color = np.zeros((len(uv), 4))
    for column, across in ((left, 1 - along), (right, along)):
        for row, share in ((upper, across * (1 - down)), (lower, across * down)):
            texel = texture.pixels[row, column]
            color[:, :3] += share[:, None] * LINEAR[texel[:, :3]]
            color[:, 3] += share * _ENCODED[texel[:, 3]]
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
