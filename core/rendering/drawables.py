"""A GLB as input of a renderer: triangles, normals, colours and materials."""

from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.geometry.products import cross
from core.gltf.accessors import read_values
from core.gltf.document import Document, malformed
from core.gltf.materials import Emission, Material
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import Scene, determinants
from core.gltf.textures import ReadTexture, Texture, texture_reader

Float32 = NDArray[np.float32]

_OPTIONAL = ("normals", "uv", "emission_uv", "colors")  # attributes of vertices that a drawable may lack


@dataclass(frozen=True, eq=False)
class Drawable:
    """One drawn primitive or several that look alike, only their vertices in use.

    Attributes:
        positions: (N, 3) float32, size-30 frame.
        faces: (T, 3) int64, counter-clockwise from outside.
        normals: (N, 3) float32, or ``None``: flat shading.
        uv: (N, 2) float32 as in glTF (v points down), its transform applied, or ``None``.
        emission_uv: the same for the texture of its emission.
        colors: (N, 4) float32 linear RGBA, or ``None``.
        material: its emission, where that has a texture, is drawn only where there is ``emission_uv``.
        texture: of the material; ``None`` where it has none, it cannot be shown, or there is no ``uv``.
        emission_texture: the same of its emission and ``emission_uv``.
    """

    positions: Float32
    faces: Int
    normals: Float32 | None
    uv: Float32 | None
    emission_uv: Float32 | None
    colors: Float32 | None
    material: Material
    texture: Texture | None
    emission_texture: Texture | None


def drawables(scene: Scene, texture_limit: int) -> list[Drawable]:
    """The drawn primitives of a scene at its default pose, see-through ones last, those that look alike in one.

    Nodes that KHR_node_visibility hides, triangles without an area, and those outside the frame of all drawn faces
    (:mod:`core.gltf.viewer`), such as a far box of alpha 0, are left out, unless that leaves nothing.
    Positions and normals follow node transforms and skins; morph targets move positions only. Textures are reduced to
    ``texture_limit`` pixels a side.

    Raises:
        MeshmarkError: ``malformed_file`` for attributes and materials that contradict themselves.
    """
    read, surface = texture_reader(scene.document, texture_limit, kept=None), scene.surface
    shown = np.array([not drawn.node.hidden for drawn in scene.primitives])[surface.face_primitive]
    framed = np.abs(surface.positions).max(axis=1) <= surface.reach
    shown &= (surface.areas > 0) & framed[surface.faces].all(axis=1)
    shown |= not shown.any()
    found = []
    ends = np.cumsum([len(drawn.triangles) for drawn in scene.primitives])
    for drawn, triangles in zip(scene.primitives, np.split(np.arange(len(shown)), ends[:-1]), strict=True):
        faces = surface.faces[triangles[shown[triangles]]]
        if len(faces):
            found.append(_drawable(scene.document, drawn, faces, surface.positions, read))
    return _merged(sorted(found, key=lambda drawable: drawable.material.alpha_mode == "BLEND"))


def _merged(found: list[Drawable]) -> list[Drawable]:
    """Drawables that show the same: an asset of thousands of parts in a few materials takes a few calls of OpenGL. The
    order of blended ones counts, so only neighbours among them are joined."""
    alike: dict[Hashable, list[Drawable]] = {}
    run, before = 0, None
    for drawable in found:
        look = _look(drawable)
        if drawable.material.alpha_mode == "BLEND" and look != before:
            run, before = run + 1, look
        alike.setdefault((run, look), []).append(drawable)
    return [_joined(group) for group in alike.values()]


def _look(drawable: Drawable) -> Hashable:
    """All that drawables must share to be drawn at once."""
    material, emission = drawable.material, drawable.material.emission
    return (
        material.color.tobytes(),
        (material.alpha_mode, material.alpha_cutoff, material.double_sided, material.unlit),
        None if emission is None else (emission.color.tobytes(), emission.texture is None),
        (drawable.texture, drawable.emission_texture),
        tuple(getattr(drawable, name) is None for name in _OPTIONAL),
    )


def _joined(group: list[Drawable]) -> Drawable:
    if len(group) == 1:
        return group[0]
    first = np.cumsum([0, *(len(drawable.positions) for drawable in group[:-1])])

    def rows(name: str) -> Float32 | None:
        return None if getattr(group[0], name) is None else np.concatenate([getattr(one, name) for one in group])

    return replace(
        group[0],
        positions=np.concatenate([drawable.positions for drawable in group]),
        faces=np.concatenate([drawable.faces + start for drawable, start in zip(group, first, strict=True)]),
        normals=rows("normals"),
        uv=rows("uv"),
        emission_uv=rows("emission_uv"),
        colors=rows("colors"),
    )


def _drawable(document: Document, drawn: DrawnPrimitive, faces: Int, positions: Float, read: ReadTexture) -> Drawable:
    used, corners = np.unique(faces, return_inverse=True)
    rows = used - drawn.first_vertex
    attributes, material = drawn.primitive.attributes, drawn.primitive.material
    normals = _attribute(document, attributes, "NORMAL", rows)
    texture, uv = _sampled(document, attributes, rows, material, read)
    emission_texture, emission_uv = _sampled(document, attributes, rows, material.emission, read)
    colors = _attribute(document, attributes, "COLOR_0", rows)
    return Drawable(
        positions=positions[used].astype(np.float32),
        faces=corners.reshape(-1, 3),
        normals=None if normals is None else _to_world(normals, drawn, rows).astype(np.float32),
        uv=uv,
        emission_uv=emission_uv,
        colors=None if colors is None else np.column_stack([colors, np.ones(len(colors))])[:, :4].astype(np.float32),
        material=material,
        texture=texture,
        emission_texture=emission_texture,
    )


def _sampled(
    document: Document, attributes: dict[str, int], rows: Int, layer: Material | Emission | None, read: ReadTexture
) -> tuple[Texture, Float32] | tuple[None, None]:
    """A texture, and the (N, 2) coordinates at which it is sampled; ``None`` where it cannot be shown, or the vertices
    do not have its set."""
    if layer is None or layer.texture is None or (texture := read(layer.texture)) is None:
        return None, None
    uv = _attribute(document, attributes, f"TEXCOORD_{layer.uv_set}", rows)
    if uv is None:
        return None, None
    return texture, (uv[:, :2] @ layer.uv_transform[:, :2].T + layer.uv_transform[:, 2]).astype(np.float32)


def _attribute(document: Document, attributes: dict[str, int], name: str, rows: Int) -> Float | None:
    """The accessor rows of a vertex attribute, numbers that are not finite as 0; ``None`` where there is none."""
    if name not in attributes:
        return None
    values = read_values(document, attributes[name])
    if values.ndim != 2 or not 2 <= values.shape[1] <= 4 or rows.max() >= len(values):
        raise malformed(f"accessors[{attributes[name]}] does not fit the vertices it is the {name} of.")
    return np.nan_to_num(values[rows], nan=0.0, posinf=0.0, neginf=0.0)


def _to_world(normals: Float, drawn: DrawnPrimitive, rows: Int) -> Float:
    """Normals under the cofactor matrix of their transform, which unlike its inverse transpose always exists."""
    matrices = drawn.matrices if len(drawn.matrices) == 1 else drawn.matrices[rows]
    x, y, z = (matrices[:, :, axis] for axis in range(3))
    world = cross(y, z) * normals[:, :1] + cross(z, x) * normals[:, 1:2] + cross(x, y) * normals[:, 2:3]
    length = np.linalg.norm(world, axis=1, keepdims=True)
    # The cofactor matrix is the inverse transpose times the determinant, whose sign is taken back here.
    unit = np.divide(world, length, out=np.zeros_like(world), where=length > 0)
    return np.asarray(np.where(determinants(matrices)[:, None] < 0, -unit, unit))
