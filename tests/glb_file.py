"""A GLB as the judges of a result read it: on their own, so that they share no fault with the engine's reader.

It reads sound files only, and every kind of them: data URIs, several buffers, strides, sparse accessors, Draco and
meshopt streams.
"""

import base64
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from urllib.parse import unquote_to_bytes

import DracoPy
import meshopt
import numpy as np
from numpy.typing import NDArray

from core.arrays import Float

Json = dict[str, Any]
Array = NDArray[Any]

DRACO, INSTANCING = "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": (1, 1), "VEC2": (1, 2), "VEC3": (1, 3), "VEC4": (1, 4), "MAT2": (2, 2), "MAT3": (3, 3)}
WIDTHS["MAT4"] = (4, 4)


def meshopt_stream(entry: Json) -> Json | None:
    """What a view or a buffer says about its meshopt compression."""
    extensions = entry.get("extensions", {})
    return next((extensions[name] for name in MESHOPT if name in extensions), None)


def attribute_maps(primitive: Json) -> list[dict[str, int]]:
    """Name -> accessor of a primitive's attributes, and of each of its morph targets."""
    return [primitive["attributes"], *primitive.get("targets", [])]


def accessors_of(primitive: Json) -> set[int]:
    found = {number for each in attribute_maps(primitive) for number in each.values()}
    return found | ({primitive["indices"]} if "indices" in primitive else set())


@dataclass(eq=False)
class GlbFile:
    """A GLB.

    Attributes:
        data: all of it.
        json: its first chunk.
        binary: its second, if that is BIN.
        declared: the length in its header.
    """

    data: bytes
    json: Json = field(init=False)
    binary: bytes = field(init=False, default=b"")
    declared: int = field(init=False)

    def __post_init__(self) -> None:
        self.declared, size = struct.unpack_from("<II", self.data, 8)
        self.json = json.loads(self.data[20 : 20 + size])
        rest = self.data[20 + size : self.declared]
        if rest[4:8] == b"BIN\0":
            self.binary = rest[8 : 8 + struct.unpack_from("<I", rest)[0]]

    def entries(self, kind: str) -> list[Json]:
        found: list[Json] = self.json.get(kind, [])
        return found

    @cached_property
    def buffers(self) -> list[bytes]:
        """The bytes of each; none of one that only stands for decoded bytes."""
        found = []
        for number, buffer in enumerate(self.entries("buffers")):
            header, _, payload = buffer.get("uri", "").partition(",")
            if "uri" not in buffer:
                found.append(self.binary if number == 0 else b"")
            else:
                raw = unquote_to_bytes(payload)
                found.append(base64.b64decode(raw + b"=" * (-len(raw) % 4)) if header.endswith(";base64") else raw)
        return found

    def stored(self, view: Json) -> bytes:
        """The bytes at the place that a buffer view, or what it says of its compression, names."""
        start = view.get("byteOffset", 0)
        return self.buffers[view["buffer"]][start : start + view["byteLength"]]

    @cached_property
    def views(self) -> list[bytes]:
        """The plain bytes of each buffer view."""
        return [self._plain(view) for view in self.entries("bufferViews")]

    def _plain(self, view: Json) -> bytes:
        stream = meshopt_stream(view)
        if stream is None:
            return self.stored(view)
        arguments = stream["count"], stream["byteStride"], stream["mode"], stream.get("filter")
        return np.ascontiguousarray(meshopt.decode_gltf_buffer(self.stored(stream), *arguments)).tobytes()

    def layout(self, entry: Json) -> tuple[int, int, int, int]:
        """Of an accessor: bytes from element to element, from column to column, of a column, and columns."""
        columns, rows = WIDTHS[entry["type"]]
        size = rows * np.dtype(KINDS[entry["componentType"]]).itemsize
        step = size if columns == 1 else -(-size // 4) * 4
        view = self.entries("bufferViews")[entry["bufferView"]] if "bufferView" in entry else {}
        return view.get("byteStride") or columns * step, step, size, columns

    @cached_property
    def draco(self) -> dict[int, Array]:
        """The values of accessors that are in Draco streams, indices as (3 F, 1)."""
        found: dict[int, Array] = {}
        for primitive in self.primitives():
            said = primitive.get("extensions", {}).get(DRACO)
            if said is None:
                continue
            mesh = DracoPy.decode(self.stored(self.entries("bufferViews")[said["bufferView"]]))
            values = {int(item["unique_id"]): np.asarray(item["data"]) for item in mesh.attributes}
            found[primitive["indices"]] = np.asarray(mesh.faces).reshape(-1, 1)
            found |= {primitive["attributes"][name]: values[number] for name, number in said["attributes"].items()}
        return found

    def read(self, number: int) -> Array:
        """The (N, n) values of an accessor as they are stored."""
        entry = self.entries("accessors")[number]
        dtype, (columns, rows) = np.dtype(KINDS[entry["componentType"]]), WIDTHS[entry["type"]]
        if "bufferView" in entry:
            values = self._strided(entry, self.views[entry["bufferView"]], dtype)
        elif number in self.draco:
            values = self.draco[number].astype(dtype)
        else:
            values = np.zeros((entry["count"], columns * rows), dtype)
        if (sparse := entry.get("sparse")) is not None:
            values = values.copy()
            index = {"componentType": sparse["indices"]["componentType"], "type": "SCALAR", "count": sparse["count"]}
            which = index | {"byteOffset": sparse["indices"].get("byteOffset", 0)}
            what = {**entry, "count": sparse["count"], "byteOffset": sparse["values"].get("byteOffset", 0)}
            what.pop("bufferView", None)
            at = self._strided(
                which, self.views[sparse["indices"]["bufferView"]], np.dtype(KINDS[index["componentType"]])
            )
            values[at[:, 0]] = self._strided(what, self.views[sparse["values"]["bufferView"]], dtype)
        return values

    def _strided(self, entry: Json, data: bytes, dtype: np.dtype[Any]) -> Array:
        columns, rows = WIDTHS[entry["type"]]
        stride, step, _, _ = self.layout(entry)
        strides = (stride, step, dtype.itemsize)
        shape = (entry["count"], columns, rows)
        values = np.ndarray(shape, dtype, data, entry.get("byteOffset", 0), strides)
        return np.ascontiguousarray(values).reshape(entry["count"], columns * rows)

    def numbers(self, number: int) -> Float:
        """The (N, n) values of an accessor as they are meant: integers of normalised ones as fractions."""
        values, entry = self.read(number), self.entries("accessors")[number]
        meant = values.astype(np.float64)
        if entry.get("normalized") and values.dtype.kind in "iu":
            meant = np.maximum(meant / np.iinfo(values.dtype).max, -1.0)
        return meant

    def primitives(self) -> Iterator[Json]:
        for mesh in self.entries("meshes"):
            yield from mesh["primitives"]

    def corners(self, primitive: Json) -> NDArray[np.int64]:
        """The row of each index of a primitive, or all rows of one without."""
        if "indices" in primitive:
            return self.read(primitive["indices"])[:, 0].astype(np.int64)
        return np.arange(self.entries("accessors")[primitive["attributes"]["POSITION"]]["count"])

    def triangles(self, primitive: Json) -> NDArray[np.int64]:
        """The (F, 3) rows of a primitive's triangles; none of points and lines."""
        rows, mode = self.corners(primitive), primitive.get("mode", 4)
        if mode == 4:
            return rows[: len(rows) // 3 * 3].reshape(-1, 3)
        at = np.arange(max(len(rows) - 2, 0))
        if mode == 5:
            return rows[np.column_stack([at, at + 1 + at % 2, at + 2 - at % 2])]
        return rows[np.column_stack([at + 1, at + 2, 0 * at])] if mode == 6 else np.zeros((0, 3), np.int64)
