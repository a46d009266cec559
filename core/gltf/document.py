"""A GLB as its chunks, and the bytes that its JSON refers to (glTF 2.0 specification, sections 3.6 and 4.4)."""

import json
import math
import struct
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.gltf.compression import DRACO, decode_draco, decode_meshopt, meshopt_of
from core.gltf.data_uri import decode_data_uri, is_data_uri
from core.notices import Notice

COMPONENT_TYPES: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
# type -> (columns, rows); a matrix is stored column by column
ELEMENT_TYPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}

T = TypeVar("T", list[Any], dict[str, Any])

_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")


def malformed(sentence: str) -> MeshmarkError:
    """The error for a file whose structure contradicts itself."""
    return MeshmarkError(
        ErrorCode.MALFORMED_FILE, sentence, "Run the file through the Khronos glTF validator and export it again."
    )


@dataclass
class Document:
    """A parsed GLB: nothing is interpreted, unknown properties are carried as they are.

    Attributes:
        json: the JSON chunk, keys in file order.
        binary: the payload of the BIN chunk, empty where there is none.
        warnings: content of the file that could not be carried into this document, or is carried unread.
        chunks: the type and payload of each further chunk, in file order; they are carried as they are.
        undecoded: the textures whose pixels could not be decoded.
    """

    json: dict[str, Any]
    binary: bytes
    warnings: list[Notice] = field(default_factory=list)
    chunks: tuple[tuple[bytes, bytes], ...] = ()
    undecoded: set[int] = field(default_factory=set, init=False, repr=False, compare=False)
    _views: dict[int, bytes] = field(default_factory=dict, init=False, repr=False, compare=False)
    _decoded: dict[str, bytes] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def from_glb(cls, data: bytes) -> "Document":
        """Split a GLB into its chunks; bytes behind its declared length are not part of it.

        Raises:
            MeshmarkError: ``malformed_file``, or ``truncated_file`` where the file ends before its declared length.
        """
        if len(data) < _HEADER.size:
            raise _truncated("The file ends inside the GLB header.")
        magic, version, length = _HEADER.unpack_from(data)
        if magic != b"glTF":
            raise malformed("The file does not start with the GLB signature.")
        if version != 2:
            raise malformed(f"The file is a GLB of version {version}, not 2.")
        if length > len(data):
            raise _truncated(f"The GLB header declares {length} bytes, but the file has {len(data)}.")
        chunks: list[tuple[bytes, bytes]] = []
        offset = _HEADER.size
        while offset < length:
            if offset + _CHUNK.size > length:
                raise _truncated("The GLB ends inside a chunk header.")
            size, kind = _CHUNK.unpack_from(data, offset)
            offset += _CHUNK.size
            if offset + size > length:
                raise _truncated(f"A GLB chunk declares {size} bytes, but only {length - offset} are left.")
            chunks.append((kind, data[offset : offset + size]))
            offset += size
        if not chunks or chunks[0][0] != b"JSON":
            raise malformed("The first chunk of the GLB is not its JSON.")
        binaries = [payload for kind, payload in chunks if kind == b"BIN\0"]
        if len(binaries) > 1 or any(kind == b"JSON" for kind, _ in chunks[1:]):
            raise malformed("The GLB has two chunks of JSON, or two of binary data.")
        further = tuple(chunk for chunk in chunks[1:] if chunk[0] != b"BIN\0")
        return cls(parse_json(chunks[0][1]), b"".join(binaries), chunks=further)

    def to_glb(self) -> bytes:
        """The GLB; the same document always gives the same bytes."""
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        chunks = [(b"JSON", text + b" " * (-len(text) % 4))]
        if self.binary:
            chunks.append((b"BIN\0", self.binary + bytes(-len(self.binary) % 4)))
        chunks += [(kind, payload + bytes(-len(payload) % 4)) for kind, payload in self.chunks]
        length = _HEADER.size + sum(_CHUNK.size + len(payload) for _, payload in chunks)
        if length >= 2**32:
            raise MeshmarkError(
                ErrorCode.BUDGET_EXCEEDED,
                f"The result would have {length} bytes; a GLB cannot exceed 4 GiB.",
                "Send a smaller asset.",
            )
        parts = [_HEADER.pack(b"glTF", 2, length)]
        for kind, payload in chunks:
            parts += [_CHUNK.pack(len(payload), kind), payload]
        return b"".join(parts)

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """``json[kind][index]``.

        Raises:
            MeshmarkError: ``malformed_file`` where there is no such object.
        """
        entries = typed(self.json, kind, list)
        if type(index) is not int or not 0 <= index < len(entries):
            raise malformed(f"The file refers to {kind}[{index}], which does not exist.")
        entry = entries[index]
        if not isinstance(entry, dict):
            raise malformed(f"{kind}[{index}] is not a JSON object.")
        return entry

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer: the BIN chunk, or a data URI, which is decoded once.

        Raises:
            MeshmarkError: ``malformed_file``; ``external_reference`` for any other URI.
        """
        entry = self.entry("buffers", index)
        uri = entry.get("uri")
        if uri is not None:
            if not is_data_uri(uri):
                raise MeshmarkError(
                    ErrorCode.EXTERNAL_REFERENCE,
                    f"buffers[{index}] lies in another file; nothing outside the uploaded file is opened.",
                    "Export the asset as one self-contained GLB.",
                )
            if uri not in self._decoded:
                try:
                    self._decoded[uri] = decode_data_uri(uri)
                except ValueError:
                    raise malformed(f"The data URI of buffers[{index}] cannot be decoded.") from None
            return self._decoded[uri]
        if index != 0:
            raise malformed(f"buffers[{index}] has no URI, and only the first buffer can be the BIN chunk.")
        return self.binary

    def view(self, index: Any) -> tuple[bytes, int, int]:
        """The bytes of a buffer view: those of its buffer, its start and its length in them.

        A compressed view is decoded at its first use.

        Raises:
            MeshmarkError: ``malformed_file``, ``external_reference``.
        """
        view = self.entry("bufferViews", index)
        compressed = meshopt_of(view)
        if compressed is None:
            return self._range(view, index)
        if index not in self._views:
            data, start, length = self._range(compressed, index)
            self._views[index] = decode_meshopt(data[start : start + length], compressed, f"bufferViews[{index}]")
        return self._views[index], 0, len(self._views[index])

    def image(self, index: Any) -> memoryview | None:
        """The encoded bytes of an image; ``None`` where it is a file of its own, or a data URI that is damaged.

        Raises:
            MeshmarkError: ``malformed_file``, ``external_reference``.
        """
        image = self.entry("images", index)
        if "bufferView" in image:
            view = self.entry("bufferViews", image["bufferView"])
            data, start, length = self._range(view, image["bufferView"])
            return memoryview(data)[start : start + length]
        if not is_data_uri(uri := image.get("uri")):
            return None
        try:
            return memoryview(decode_data_uri(uri))
        except ValueError:
            return None

    @cached_property
    def draco(self) -> "dict[int, NDArray[Any]]":
        """(count, n) values of every accessor whose only bytes are in a Draco stream; all are decoded at once.

        Raises:
            MeshmarkError: ``malformed_file`` for a stream that is damaged or contradicts its accessors.
        """
        return _decode_draco(self)

    def _range(self, owner: dict[str, Any], index: int) -> tuple[bytes, int, int]:
        data = self.buffer(owner.get("buffer", -1))
        start, length = owner.get("byteOffset", 0), owner.get("byteLength", 0)
        if any(type(number) is not int or number < 0 for number in (start, length)) or start + length > len(data):
            raise malformed(f"bufferViews[{index}] does not lie inside its buffer.")
        return data, start, length


def typed(parent: dict[str, Any], key: str, kind: type[T]) -> T:
    """``parent[key]``, or an empty ``kind`` (list or dict) where there is none.

    Raises:
        MeshmarkError: ``malformed_file`` where it is something else.
    """
    value = parent.get(key, kind())
    if not isinstance(value, kind):
        raise malformed(f"A property {key} is not a JSON {'array' if kind is list else 'object'}.")
    return value


def named(entry: dict[str, Any]) -> str:
    """The name of an object of the file; empty where it has none."""
    name = entry.get("name")
    return name if isinstance(name, str) else ""


def parse_json(payload: bytes) -> dict[str, Any]:
    """The JSON of a glTF.

    Raises:
        MeshmarkError: ``malformed_file``.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    try:
        parsed = json.loads(payload.decode("utf-8"), parse_constant=refuse, parse_float=_finite)
    except (ValueError, RecursionError):
        raise malformed("The JSON of the glTF is not valid JSON.") from None
    if not isinstance(parsed, dict):
        raise malformed("The JSON of the glTF is not a JSON object.")
    return parsed


def _finite(number: str) -> float:
    value = float(number)
    if not math.isfinite(value):
        raise ValueError(f"{number} does not fit a double")
    return value


def _decode_draco(document: Document) -> dict[int, NDArray[Any]]:
    """See :attr:`Document.draco`."""
    decoded: dict[int, NDArray[Any]] = {}
    source: dict[int, tuple[int, int]] = {}
    streams: dict[tuple[int, int], tuple[NDArray[Any], dict[int, NDArray[Any]]]] = {}
    for mesh in typed(document.json, "meshes", list):
        for primitive in typed(mesh, "primitives", list):
            extension = typed(primitive, "extensions", dict).get(DRACO)
            if extension is None:
                continue
            view = extension["bufferView"]
            count = document.entry("accessors", primitive["indices"])["count"]
            if (view, count) not in streams:
                data, start, length = document.view(view)
                where = f"The Draco stream in bufferViews[{view}]"
                streams[view, count] = decode_draco(data[start : start + length], count // 3, where)
            indices, attributes = streams[view, count]
            named = {primitive["attributes"][name]: number for name, number in extension["attributes"].items()}
            for accessor, number in {primitive["indices"]: -1, **named}.items():
                entry = document.entry("accessors", accessor)
                if "bufferView" in entry:  # the same data once more, plain, for readers without a decoder
                    continue
                if source.setdefault(accessor, (view, number)) != (view, number):
                    raise malformed(f"accessors[{accessor}] stands for two different Draco attributes.")
                values = indices[:, None] if number < 0 else attributes.get(number)
                decoded[accessor] = _as_declared(values, entry, accessor)
    return decoded


def _as_declared(values: NDArray[Any] | None, entry: dict[str, Any], accessor: int) -> NDArray[Any]:
    """Decoded values in the component type of their accessor, which must be able to hold them."""
    dtype, (columns, rows) = COMPONENT_TYPES[entry["componentType"]], ELEMENT_TYPES[entry["type"]]
    if values is None or values.shape != (entry["count"], columns * rows) or values.dtype.kind not in "iuf":
        raise malformed(f"accessors[{accessor}] is not what the Draco stream of its primitive holds.")
    if values.dtype == dtype:
        return values
    with np.errstate(invalid="ignore"):
        converted = values.astype(dtype)
    if not np.array_equal(converted, values):
        raise malformed(f"accessors[{accessor}] declares a type that cannot hold the values of its Draco stream.")
    return converted


def _truncated(sentence: str) -> MeshmarkError:
    return MeshmarkError(ErrorCode.TRUNCATED_FILE, sentence, "Upload the complete file again.")
