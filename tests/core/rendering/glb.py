"""Small GLBs written out accessor by accessor, so that each test shows what it draws."""

import json
import struct
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float32)
CUBE_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]])
QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)  # glTF: v = 0 is the image's first row


def png(pixels: ArrayLike) -> bytes:
    stream = BytesIO()
    Image.fromarray(np.asarray(pixels, dtype=np.uint8)).save(stream, format="PNG")
    return stream.getvalue()


class GlbWriter:
    """One buffer and the JSON that grows with it; each call of :meth:`mesh` adds a node with one primitive."""

    def __init__(self) -> None:
        self.binary = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        self.json.setdefault(kind, []).append(entry)
        return len(self.json[kind]) - 1

    def view(self, data: bytes) -> int:
        start = len(self.binary)
        self.binary += data + bytes(-len(data) % 4)
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data)})

    def accessor(self, values: NDArray[Any], normalized: bool = False) -> int:
        values = np.ascontiguousarray(values)
        kind = {np.dtype("f4"): 5126, np.dtype("u4"): 5125, np.dtype("u1"): 5121}[values.dtype]
        return self.add(
            "accessors",
            {
                "bufferView": self.view(values.tobytes()),
                "componentType": kind,
                "count": len(values),
                "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}",
                **({"normalized": True} if normalized else {}),
            },
        )

    def image_texture(self, data: bytes, **sampler: int) -> int:
        image = self.add("images", {"bufferView": self.view(data), "mimeType": "image/png"})
        return self.add("textures", {"source": image, "sampler": self.add("samplers", dict(sampler))})

    def mesh(
        self,
        positions: ArrayLike,
        faces: ArrayLike,
        attributes: dict[str, NDArray[Any]] | None = None,
        material: dict[str, Any] | None = None,
        **node: Any,
    ) -> "GlbWriter":
        accessors = {"POSITION": self.accessor(np.asarray(positions, dtype=np.float32))}
        for name, values in (attributes or {}).items():
            accessors[name] = self.accessor(values, normalized=values.dtype.kind == "u")
        primitive: dict[str, Any] = {
            "attributes": accessors,
            "indices": self.accessor(np.asarray(faces, dtype=np.uint32).ravel()),
        }
        if material is not None:
            primitive["material"] = self.add("materials", material)
        mesh = self.add("meshes", {"primitives": [primitive]})
        self.json["scenes"][0]["nodes"].append(self.add("nodes", {"mesh": mesh, **node}))
        return self

    def bytes(self) -> bytes:
        text = json.dumps(self.json | {"buffers": [{"byteLength": len(self.binary)}]}).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def plain(color: tuple[float, float, float, float], **material: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorFactor": list(color)}, **material}


def cube(color: tuple[float, float, float, float] = (1, 1, 1, 1), **node: Any) -> bytes:
    """A cube of side 2 without normals."""
    return GlbWriter().mesh(CORNERS, CUBE_FACES, material=plain(color), **node).bytes()
