"""Plain documents compressed, with the encoders of the libraries that decode them."""

import copy
from typing import Any

import DracoPy
import meshopt
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.gltf.accessors import read_accessor
from core.gltf.compression import DRACO
from core.gltf.document import COMPONENT_TYPES, Document
from tests.core.gltf.builder import Builder

MESHOPT = "EXT_meshopt_compression"


def draco(document: Document, *, preserve_order: bool = True, metadata: bool = False) -> Document:
    """The document with the attributes and indices of every primitive in a Draco stream of its own."""
    json, binary = copy.deepcopy(document.json), document.binary
    for mesh in json["meshes"]:
        for primitive in mesh["primitives"]:
            names = [name for name in primitive["attributes"] if name != "POSITION"]
            attributes = {
                number: read_accessor(document, primitive["attributes"][name]) for number, name in enumerate(names)
            }
            stream = DracoPy.encode(
                read_accessor(document, primitive["attributes"]["POSITION"]).astype(np.float64),
                read_accessor(document, primitive["indices"]).reshape(-1, 3),
                quantization_bits=20,
                preserve_order=preserve_order,
                create_metadata=metadata,
                generic_attributes={n: values.reshape(len(values), -1) for n, values in attributes.items()},
            )
            decoded = DracoPy.decode(stream)
            position = decoded.get_attribute_by_type(DracoPy.AttributeType.POSITION)["unique_id"]
            binary += bytes(-len(binary) % 4)
            json["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(stream)})
            binary += stream
            for name, accessor in primitive["attributes"].items():
                _strip(json["accessors"][accessor], len(decoded.points))
                if name == "POSITION":
                    low, high = decoded.points.astype("f4").min(axis=0), decoded.points.astype("f4").max(axis=0)
                    json["accessors"][accessor] |= {"min": low.tolist(), "max": high.tolist()}
            _strip(json["accessors"][primitive["indices"]], decoded.faces.size)
            numbers = {name: number for number, name in enumerate(names)} | {"POSITION": position}
            primitive["extensions"] = {DRACO: {"bufferView": len(json["bufferViews"]) - 1, "attributes": numbers}}
    return _document(json, binary, DRACO)


def _strip(accessor: dict[str, Any], count: int) -> None:
    accessor.pop("bufferView", None)
    accessor.pop("byteOffset", None)
    accessor["count"] = count


def meshopted(document: Document, *, mode: str = "TRIANGLES", version: int = 0, name: str = MESHOPT) -> Document:
    """The document with every buffer view behind an accessor compressed, and a fallback buffer without bytes."""
    json, binary, decoded = copy.deepcopy(document.json), document.binary, 0
    indices = {primitive["indices"] for mesh in json["meshes"] for primitive in mesh["primitives"]}
    views = {entry["bufferView"]: number for number, entry in enumerate(json["accessors"]) if "bufferView" in entry}
    for number, accessor in views.items():
        view = json["bufferViews"][number]
        start = view.get("byteOffset", 0)
        plain = np.frombuffer(document.binary[start : start + view["byteLength"]], np.uint8)
        if accessor in indices:
            dtype = COMPONENT_TYPES[json["accessors"][accessor]["componentType"]]
            stride, how, rows = dtype.itemsize, mode, plain.view(dtype)
        else:
            stride, how = view.get("byteStride", plain.size // json["accessors"][accessor]["count"]), "ATTRIBUTES"
            rows = plain.reshape(-1, stride)
        data = meshopt.encode_gltf_buffer(rows, how, version)
        binary += bytes(-len(binary) % 4)
        compressed: dict[str, Any] = {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
        compressed |= {"byteStride": stride, "count": plain.size // stride, "mode": how}
        binary += data
        view |= {"buffer": 1, "byteOffset": decoded, "extensions": {name: compressed}}
        decoded += -(-plain.size // 4) * 4
    json["buffers"].append({"byteLength": decoded, "extensions": {name: {"fallback": True}}})
    return _document(json, binary, name)


def filtered(rows: NDArray[Any], dtype: str, normalized: bool, name: str) -> Document:
    """A document whose first accessor holds ``rows`` of filtered values, still in the form that the filter undoes."""
    builder = Builder()
    width = rows.shape[1] // np.dtype(dtype).itemsize
    builder.accessor(np.zeros((len(rows), width)), dtype, **({"normalized": True} if normalized else {}))
    data = meshopt.encode_gltf_buffer(rows, "ATTRIBUTES")
    document = builder.document()
    document.json["bufferViews"][0] |= {"buffer": 1, "byteOffset": 0}
    compressed: dict[str, Any] = {"buffer": 0, "byteOffset": 0, "byteLength": len(data), "byteStride": rows.shape[1]}
    compressed |= {"count": len(rows), "mode": "ATTRIBUTES", "filter": name}
    document.json["bufferViews"][0]["extensions"] = {MESHOPT: compressed}
    document.json["buffers"].append({"byteLength": rows.size, "extensions": {MESHOPT: {"fallback": True}}})
    return _document(document.json, data, MESHOPT)


def _document(json: dict[str, Any], binary: bytes, extension: str) -> Document:
    json["buffers"][0]["byteLength"] = len(binary)
    json["extensionsUsed"] = json["extensionsRequired"] = [extension]
    return Document(json, binary)


def instanced(positions: ArrayLike, indices: ArrayLike, **attributes: tuple[ArrayLike, str]) -> Document:
    """One mesh that one node draws at several places: ``TRANSLATION=(values, dtype)`` and so on."""
    builder = Builder()
    primitive = builder.primitive(positions, indices)
    accessors = {
        name: builder.accessor(values, dtype, **({"normalized": True} if dtype in ("<i2", "i1") else {}))
        for name, (values, dtype) in attributes.items()
    }
    return builder.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[{"mesh": 0, "name": "many", "extensions": {"EXT_mesh_gpu_instancing": {"attributes": accessors}}}],
        extensionsUsed=["EXT_mesh_gpu_instancing"],
        extensionsRequired=["EXT_mesh_gpu_instancing"],
    )
