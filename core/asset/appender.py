"""Grow a GLB at its end: nothing that is there already moves or changes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.gltf import COMPONENT_TYPES, ELEMENT_TYPES, Document

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

_COMPONENT_CODES = {dtype: code for code, dtype in COMPONENT_TYPES.items()}


class Appender:
    """A document being extended; the original stays as it is.

    Attributes:
        json: a copy of the document's JSON, its top-level lists copied too, so that entries can be replaced (not
            changed in place) and appended.
    """

    def __init__(self, document: Document) -> None:
        self.json = {key: list(value) if isinstance(value, list) else value for key, value in document.json.items()}
        # A first buffer in a data URI becomes the BIN chunk: only that one can grow.
        self._parts = [document.buffer(0)]
        self._length = len(self._parts[0])

    def append(self, kind: str, entry: dict[str, Any]) -> int:
        """Add ``entry`` to ``json[kind]`` and return its index."""
        entries = self.json.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def add_attribute(self, values: NDArray[Any], like: dict[str, Any], bounded: bool) -> int:
        """A vertex attribute (N, n) of any component type; returns its accessor.

        Args:
            values: one row a vertex, matrices column by column.
            like: the accessor it stands in for: element type, normalisation, and whether it was stored without a
                buffer view, in which case only its non-zero rows are stored again.
            bounded: whether to declare ``min`` and ``max``, which positions need.
        """
        rows = values.reshape(len(values), -1)
        accessor: dict[str, Any] = {"componentType": _COMPONENT_CODES[rows.dtype]}
        if rows.dtype.kind != "f" and "normalized" in like:
            accessor["normalized"] = like["normalized"]
        accessor |= {"count": len(rows), "type": like["type"]}
        if bounded:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        columns, height = ELEMENT_TYPES[like["type"]]
        if "bufferView" in like:
            accessor = {"bufferView": self._add_vertex_view(rows, columns, height), **accessor}
        elif (used := np.flatnonzero(rows.any(axis=1))).size:
            packed = rows[used] if columns == 1 else _column_aligned(rows[used], columns, height)[0]
            accessor["sparse"] = {
                "count": len(used),
                "indices": {"bufferView": self._add_view(used.astype("<u4").tobytes(), {}), "componentType": 5125},
                "values": {"bufferView": self._add_view(packed.tobytes(), {})},
            }
        return self.append("accessors", accessor)

    def add_indices(self, indices: NDArray[np.int64], smallest: np.dtype[Any]) -> int:
        """Triangle indices in the first of uint8, uint16 and uint32, from ``smallest`` on, that can hold them."""
        # The largest value of each type is reserved for primitive restart.
        fitting = (np.dtype(name) for name in ("<u1", "<u2", "<u4") if indices.max() < np.iinfo(name).max)
        dtype = next(candidate for candidate in fitting if candidate.itemsize >= smallest.itemsize)
        view = self._add_view(indices.astype(dtype).tobytes(), {"target": ELEMENT_ARRAY_BUFFER})
        return self.append(
            "accessors",
            {"bufferView": view, "componentType": _COMPONENT_CODES[dtype], "count": indices.size, "type": "SCALAR"},
        )

    def to_glb(self) -> bytes:
        """The extended GLB: the old BIN bytes, then what was added."""
        binary = b"".join(self._parts)
        first = {key: value for key, value in self.json["buffers"][0].items() if key != "uri"}
        self.json["buffers"][0] = first | {"byteLength": len(binary)}
        return Document(self.json, binary).to_glb()

    def _add_vertex_view(self, rows: NDArray[Any], columns: int, height: int) -> int:
        aligned, padded = _column_aligned(rows, columns, height)
        stride = {"byteStride": aligned.itemsize * aligned.shape[1]} if padded and columns == 1 else {}
        return self._add_view(aligned.tobytes(), stride | {"target": ARRAY_BUFFER})

    def _add_view(self, data: bytes, properties: dict[str, Any]) -> int:
        padding = -self._length % 4
        offset = self._length + padding
        self._parts += [bytes(padding), data]
        self._length = offset + len(data)
        return self.append("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data)} | properties)


def _column_aligned(rows: NDArray[Any], columns: int, height: int) -> tuple[NDArray[Any], bool]:
    """Rows with every column (a vector is one) filled up to a multiple of four bytes, and whether that added any."""
    padding = -height * rows.itemsize % 4 // rows.itemsize
    split = rows.reshape(len(rows), columns, height)
    aligned = np.pad(split, ((0, 0), (0, 0), (0, padding))).reshape(len(rows), -1)
    return aligned, padding > 0
