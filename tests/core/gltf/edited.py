"""Edited documents, and what is in them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.analysis.color import base_color
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import Scene, flatten
from core.gltf.write import write
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

NORMALS = [[0, 0, 1]] * 4
UV = [[0, 0], [1, 0], [1, 1], [0, 1]]


def edited(
    document: Document, faces: list[int], kinds: list[Kind], *, color: str | None = None, lift: float = 0.0
) -> Document:
    """The document after a centroid split; whatever it is, it must be valid and hold nothing that nothing refers to."""
    scene = flatten(document)
    before = document.to_glb()
    glb = write(scene, centroid_split(scene, faces, kinds, lift), [Style(color)])
    assert not error_counts(glb)
    assert document.to_glb() == before
    result = Document.from_glb(glb)
    assert unreferenced_bytes(result) == 0
    return result


def primitives_of(document: Document, mesh: int = 0) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = document.json["meshes"][mesh]["primitives"]
    return found


def values(document: Document, name: str, primitive: int = 0, mesh: int = 0) -> NDArray[np.float64]:
    accessor = primitives_of(document, mesh)[primitive]["attributes"][name]
    return dequantize(read_accessor(document, accessor), document.json["accessors"][accessor])


def indices(document: Document, primitive: int = 0, mesh: int = 0) -> NDArray[Any]:
    return read_accessor(document, primitives_of(document, mesh)[primitive]["indices"]).reshape(-1, 3)


def quad(indices: ArrayLike = QUAD_FACES, **attributes: tuple[ArrayLike, str, bool]) -> Document:
    builder = Builder()
    added = {
        name: builder.accessor(values, dtype, **({"normalized": True} if normalized else {}))
        for name, (values, dtype, normalized) in attributes.items()
    }
    return builder.document(meshes=[{"primitives": [builder.primitive(QUAD, indices, **added)]}])


def colors_of_corners(scene: Scene) -> NDArray[np.float64]:
    """(F, 3, 3) linear RGB that a viewer shows in full light at the corners of each face."""
    surface = scene.surface
    points = surface.positions[surface.faces].reshape(-1, 3)
    return base_color(scene, surface, points, np.repeat(np.arange(len(surface.faces)), 3)).reshape(-1, 3, 3)
