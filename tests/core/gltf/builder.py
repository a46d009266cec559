"""Tiny GLBs, stated in a few lines."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.gltf.document import COMPONENT_TYPES, Document

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

QUAD: list[list[float]] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
QUAD_FACES = [0, 1, 2, 0, 2, 3]
# A cube about the origin, side 2, outward counter-clockwise.
CUBE: list[list[float]] = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
CUBE_FACES = [
    *(0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1),
    *(2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3),
]  # fmt: skip


class Builder:
    """Collects accessors; everything else is plain JSON that the test writes itself."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}
        self.binary = b""

    def view(self, data: bytes, **properties: Any) -> int:
        self.binary += bytes(-len(self.binary) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **properties}
        self.binary += data
        self.json["bufferViews"].append(entry)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: ArrayLike, dtype: str = "<f4", **properties: Any) -> int:
        array = np.asarray(values, dtype=dtype)
        code = next(code for code, known in COMPONENT_TYPES.items() if known == array.dtype)
        width = 1 if array.ndim == 1 else array.shape[1]
        padding = -array.itemsize * width % 4 // array.itemsize if array.ndim == 2 else 0
        rows = np.pad(array, ((0, 0), (0, padding))) if padding else array
        stride = {"byteStride": rows.itemsize * rows.shape[1]} if padding else {}
        entry = {
            "bufferView": self.view(rows.tobytes(), **stride),
            "componentType": code,
            "count": len(array),
            "type": _TYPES[width],
            **properties,
        }
        if width == 3:
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def primitive(self, positions: ArrayLike, indices: ArrayLike | None, **attributes: int) -> dict[str, Any]:
        entry: dict[str, Any] = {"attributes": {"POSITION": self.accessor(positions), **attributes}}
        if indices is not None:
            entry["indices"] = self.accessor(np.asarray(indices).reshape(-1), "<u2")
        return entry

    def document(self, **objects: Any) -> Document:
        """The document with these top-level objects; one node with the first mesh, where none is given."""
        self.json |= {"nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0} | objects
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        return Document(self.json, self.binary)


def simple(positions: ArrayLike = QUAD, indices: ArrayLike | None = QUAD_FACES, **node: Any) -> Document:
    """One mesh with one primitive drawn by one node."""
    builder = Builder()
    primitive = builder.primitive(positions, indices)
    return builder.document(meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0, **node}])


def grid(side: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """A flat square of (side + 1)^2 vertices and 2 side^2 triangles."""
    row, column = np.meshgrid(np.arange(side + 1), np.arange(side + 1), indexing="ij")
    positions = np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + side + 2, corner + side + 1
    return positions, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
