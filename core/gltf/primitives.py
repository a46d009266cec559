"""Mesh primitives: as a file declares them, and as its nodes draw them. Later stages read neither from its JSON."""

from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from core.arrays import Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.gltf.accessors import read_accessor
from core.gltf.document import Document, malformed
from core.gltf.hierarchy import Node
from core.gltf.materials import Material, read_material
from core.gltf.skin import Skin

TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 4, 5, 6


@dataclass(frozen=True, eq=False, slots=True)
class Primitive:
    """A primitive of a mesh, the same one for all nodes and instances that draw it.

    Attributes:
        mesh, number: glTF indices.
        json: its object in the file, for the writer, which carries what it does not know.
        attributes: semantic -> accessor.
        targets: the same of each morph target.
        triangles: (T, 3) int64 accessor rows in the file's winding; strips and fans as triangle lists.
        material: shared by all primitives that name it.
    """

    mesh: int
    number: int
    json: dict[str, Any]
    attributes: dict[str, int]
    targets: list[dict[str, int]]
    triangles: Int
    material: Material

    @property
    def maps(self) -> list[dict[str, int]]:
        """Semantic -> accessor of the base mesh, then of each morph target."""
        return [self.attributes, *self.targets]

    @property
    def is_blended(self) -> bool:
        """True where the material is blended: the picture depends on the order of the triangles."""
        return self.material.alpha_mode == "BLEND"


@dataclass(frozen=True, eq=False, slots=True)
class DrawnPrimitive:
    """One mesh primitive as one node of the scene draws it.

    Attributes:
        node: that draws it.
        primitive: of the node's mesh.
        instance: number of the node's instance (EXT_mesh_gpu_instancing); ``None`` where it has none.
        first_vertex: row of ``Surface.positions`` where accessor row 0 lies. Primitives of one mesh that share all
            their vertex attributes share these rows.
        matrices: (V, 3, 4) for a skinned primitive, else (1, 3, 4): local -> world at the default pose.
        skin: that moves its vertices; ``None`` where they follow the node.
        morph_weights: (K,) the default weights of its morph targets.
        mirrored: the transform of its node has a negative determinant, so its faces in the surface are flipped. Of a
            skin no other transform counts either (3.7.4): where only its joints mirror, viewers show its inside.
        invertible: every vertex in use can be transformed back from world to local.
    """

    node: Node
    primitive: Primitive
    instance: int | None
    first_vertex: int
    matrices: Float
    skin: Skin | None
    morph_weights: Float
    mirrored: bool
    invertible: bool

    @property
    def triangles(self) -> Int:
        """(T, 3) int64 accessor rows, as those of ``primitive``."""
        return self.primitive.triangles


class PrimitiveReader:
    """The primitives of a document, each read once, and so each material of them."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._material = cache(partial(read_material, document))
        self._read: dict[tuple[int, int], Primitive] = {}

    def read(self, mesh: int, number: int, json: dict[str, Any], vertices: int) -> Primitive:
        """A primitive of triangles.

        Args:
            mesh, number: glTF indices.
            json: its object, with well-formed attributes and morph targets.
            vertices: number of rows of its attributes.

        Raises:
            MeshmarkError: ``malformed_file``; ``index_out_of_range`` for a triangle of vertices that do not exist.
        """
        if (mesh, number) not in self._read:
            triangles = _triangles(self._document, json, vertices)
            material = json.get("material")
            if material is not None:
                self._document.entry("materials", material)  # raises where there is none
            self._read[mesh, number] = Primitive(
                mesh, number, json, json["attributes"], json.get("targets", []), triangles, self._material(material)
            )
        return self._read[mesh, number]


def _triangles(document: Document, primitive: dict[str, Any], vertex_count: int) -> Int:
    """(T, 3) accessor rows of a primitive's triangles; strips and fans as in specification 3.7.2.1."""
    if "indices" in primitive:
        accessor = primitive["indices"]
        indices = read_accessor(document, accessor)
        if indices.ndim != 1 or indices.dtype.kind != "u":
            raise malformed(f"accessors[{accessor}] should hold indices, one unsigned integer each.")
        if indices.max() >= vertex_count:
            raise MeshmarkError(
                ErrorCode.INDEX_OUT_OF_RANGE,
                f"A triangle refers to vertex {indices.max()}, but its primitive has {vertex_count} vertices.",
                "Export the asset again; its index data is damaged.",
            )
        indices = indices.astype(np.int64)
    else:
        indices = np.arange(vertex_count)
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    first = np.arange(max(len(indices) - 2, 0))
    if mode == TRIANGLE_STRIP:
        odd = first % 2
        return indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]
    return indices[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
