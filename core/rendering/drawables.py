"""A GLB as input of a renderer: triangles, normals, colours and materials."""

from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document, malformed
from core.gltf.hierarchy import hidden_nodes
from core.gltf.materials import Emission, Material, read_material
from core.gltf.scene import DrawnPrimitive, Scene, determinants
from core.gltf.textures import read_texture

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Drawable:
    """One drawn primitive, only its vertices in use.

    Attributes:
        positions: (N, 3) float32, size-30 frame.
        faces: (T, 3) int64, counter-clockwise from outside.
        normals: (N, 3) float32, or ``None``: flat shading.
        uv: (N, 2) float32 as in glTF (v points down), its transform applied, or ``None``.
        emission_uv: the same for the texture of its emission.
        colors: (N, 4) float32 linear RGBA, or ``None``.
        material: its texture is drawn only where there is ``uv``, its emission, where that has a texture, only where
            there is ``emission_uv``.
    """

    positions: Float32
    faces: Int
    normals: Float32 | None
    uv: Float32 | None
    emission_uv: Float32 | None
    colors: Float32 | None
    material: Material


def drawables(scene: Scene, texture_limit: int) -> list[Drawable]:
    """The drawn primitives of a scene at its default pose, see-through ones last.

    Nodes that KHR_node_visibility hides, triangles without an area, and those outside the frame of all drawn faces
    (:mod:`core.gltf.viewer`), such as a far box of alpha 0, are left out, unless that leaves nothing.
    Positions and normals follow node transforms and skins; morph targets move positions only. Textures are reduced to
    ``texture_limit`` pixels a side.

    Raises:
        MeshmarkError: ``malformed_file`` for attributes and materials that contradict themselves.
    """
    document = scene.document
    texture = cache(partial(read_texture, document, limit=texture_limit))
    material = cache(partial(read_material, document, read_texture=texture))
    surface, hidden = scene.surface, hidden_nodes(document)
    shown = np.array([drawn.node not in hidden for drawn in scene.primitives])[surface.face_primitive]
    framed = np.abs(surface.positions).max(axis=1) <= surface.reach
    shown &= (surface.areas > 0) & framed[surface.faces].all(axis=1)
    shown |= not shown.any()
    found = []
    ends = np.cumsum([len(drawn.triangles) for drawn in scene.primitives])
    for drawn, triangles in zip(scene.primitives, np.split(np.arange(len(shown)), ends[:-1]), strict=True):
        faces = surface.faces[triangles[shown[triangles]]]
        if len(faces):
            seen = material(_entry(document, drawn).get("material"))
            found.append(_drawable(document, drawn, faces, surface.positions, seen))
    return sorted(found, key=lambda drawable: drawable.material.alpha_mode == "BLEND")


def _entry(document: Document, drawn: DrawnPrimitive) -> dict[str, Any]:
    entry: dict[str, Any] = document.json["meshes"][drawn.mesh]["primitives"][drawn.primitive]
    return entry


def _drawable(document: Document, drawn: DrawnPrimitive, faces: Int, positions: Float, material: Material) -> Drawable:
    used, corners = np.unique(faces, return_inverse=True)
    rows = used - drawn.first_vertex
    attributes = _entry(document, drawn)["attributes"]
    normals = _attribute(document, attributes, "NORMAL", rows)
    emission = material.emission
    colors = _attribute(document, attributes, "COLOR_0", rows)
    return Drawable(
        positions=positions[used].astype(np.float32),
        faces=corners.reshape(-1, 3),
        normals=None if normals is None else _to_world(normals, drawn, rows).astype(np.float32),
        uv=_uv(document, attributes, rows, material) if material.texture else None,
        emission_uv=_uv(document, attributes, rows, emission) if emission and emission.texture else None,
        colors=None if colors is None else np.column_stack([colors, np.ones(len(colors))])[:, :4].astype(np.float32),
        material=material,
    )


def _uv(document: Document, attributes: dict[str, Any], rows: Int, layer: Material | Emission) -> Float32 | None:
    """(N, 2) coordinates at which a texture is sampled; ``None`` where the vertices do not have its set."""
    uv = _attribute(document, attributes, f"TEXCOORD_{layer.uv_set}", rows)
    if uv is None:
        return None
    return (uv[:, :2] @ layer.uv_transform[:, :2].T + layer.uv_transform[:, 2]).astype(np.float32)


def _attribute(document: Document, attributes: dict[str, Any], name: str, rows: Int) -> Float | None:
    """The accessor rows of a vertex attribute, numbers that are not finite as 0; ``None`` where there is none."""
    if name not in attributes:
        return None
    accessor = document.entry("accessors", attributes[name])
    values = dequantize(read_accessor(document, attributes[name]), accessor)
    if values.ndim != 2 or not 2 <= values.shape[1] <= 4 or rows.max() >= len(values):
        raise malformed(f"accessors[{attributes[name]}] does not fit the vertices it is the {name} of.")
    return np.nan_to_num(values[rows], nan=0.0, posinf=0.0, neginf=0.0)


def _to_world(normals: Float, drawn: DrawnPrimitive, rows: Int) -> Float:
    """Normals under the cofactor matrix of their transform, which unlike its inverse transpose always exists."""
    matrices = drawn.matrices if len(drawn.matrices) == 1 else drawn.matrices[rows]
    x, y, z = (matrices[:, :, axis] for axis in range(3))
    world = np.cross(y, z) * normals[:, :1] + np.cross(z, x) * normals[:, 1:2] + np.cross(x, y) * normals[:, 2:3]
    length = np.linalg.norm(world, axis=1, keepdims=True)
    # The cofactor matrix is the inverse transpose times the determinant, whose sign is taken back here.
    unit = np.divide(world, length, out=np.zeros_like(world), where=length > 0)
    return np.asarray(np.where(determinants(matrices)[:, None] < 0, -unit, unit))
