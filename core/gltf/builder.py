"""A glTF document being made or edited: entries are appended or replaced, and nothing unreferenced is written."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document
from core.gltf.prune import ARRAY_BUFFER, prune

ELEMENT_ARRAY_BUFFER = 34963
SPARSE = 0.5  # share of rows that are not zero; up to it a sparse accessor is smaller

_COMPONENT_CODES = {dtype: code for code, dtype in COMPONENT_TYPES.items()}


class Builder:
    """A document being edited, or made from an empty one; the original stays as it is.

    Attributes:
        document: as it was read.
        json: a deep copy of its JSON, to be changed in place. New accessors and buffer views follow the old ones until
            :meth:`to_document` gives them the numbers of removed ones.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.json: dict[str, Any] = json.loads(json.dumps(document.json))
        self._payloads: dict[int, bytes] = {}  # of the new buffer views, by number

    def append(self, kind: str, entry: dict[str, Any]) -> int:
        """Add ``entry`` to ``json[kind]`` and return its index."""
        entries = self.json.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def is_new(self, accessor: int) -> bool:
        """True where an accessor was added here."""
        return accessor >= len(self.document.json.get("accessors", []))

    def add_attribute(self, values: NDArray[Any], like: int, bounded: bool) -> int:
        """A vertex attribute (N, n) of any component type; returns its accessor.

        Args:
            values: one row a vertex, matrices column by column.
            like: the accessor it replaces, of the same element type and normalisation; where that was all zeros but
                for sparse rows, so is the new one while few rows are not zero.
            bounded: declare ``min`` and ``max``, which positions need.
        """
        source = self.json["accessors"][like]
        rows = values.reshape(len(values), -1)
        accessor: dict[str, Any] = {"componentType": _COMPONENT_CODES[rows.dtype]}
        if rows.dtype.kind != "f" and "normalized" in source:
            accessor["normalized"] = source["normalized"]
        accessor |= {"count": len(rows), "type": source["type"]}
        if bounded:
            accessor |= {
                "min": [column.min().item() for column in rows.T],
                "max": [column.max().item() for column in rows.T],
            }
        columns, height = ELEMENT_TYPES[source["type"]]
        was_stored = "bufferView" in source or like in self.document.draco
        used = np.empty(0, dtype=np.int64) if was_stored else np.flatnonzero(rows.any(axis=1))
        if was_stored or len(used) > SPARSE * len(rows):
            accessor = {"bufferView": self.add_vertex_view(rows, columns, height), **accessor}
        elif len(used):
            packed = rows[used] if columns == 1 else _column_aligned(rows[used], columns, height)[0]
            accessor["sparse"] = {
                "count": len(used),
                "indices": {"bufferView": self.add_view(used.astype("<u4").tobytes(), {}), "componentType": 5125},
                "values": {"bufferView": self.add_view(packed.tobytes(), {})},
            }
        return self.append("accessors", accessor)

    def add_accessor(self, values: NDArray[Any], kind: str, *, bounded: bool = False, normalized: bool = False) -> int:
        """A vertex attribute (N,) or (N, n) of its own; returns its accessor.

        Args:
            values: one row a vertex.
            kind: "SCALAR", "VEC2" and so on.
            bounded: declare ``min`` and ``max``, which positions need.
            normalized: integers represent fractions.
        """
        view = self.add_view(values.tobytes(), {"target": ARRAY_BUFFER})
        code = _COMPONENT_CODES[values.dtype]
        accessor: dict[str, Any] = {"bufferView": view, "componentType": code, "count": len(values), "type": kind}
        if bounded:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        if normalized:
            accessor["normalized"] = True
        return self.append("accessors", accessor)

    def add_indices(self, indices: NDArray[np.int64], smallest: np.dtype[Any]) -> int:
        """Triangle indices in the first of uint8, uint16 and uint32, from ``smallest`` on, that can hold them."""
        # The largest value of each type is reserved for primitive restart.
        fitting = (np.dtype(name) for name in ("<u1", "<u2", "<u4") if indices.max() < np.iinfo(name).max)
        dtype = next(candidate for candidate in fitting if candidate.itemsize >= smallest.itemsize)
        view = self.add_view(indices.astype(dtype).tobytes(), {"target": ELEMENT_ARRAY_BUFFER})
        return self.append(
            "accessors",
            {"bufferView": view, "componentType": _COMPONENT_CODES[dtype], "count": indices.size, "type": "SCALAR"},
        )

    def add_view(self, data: bytes, properties: dict[str, Any]) -> int:
        """A buffer view of its own over ``data``; returns its number."""
        number = self.append("bufferViews", {"buffer": 0, "byteLength": len(data)} | properties)
        self._payloads[number] = data
        return number

    def to_document(self) -> Document:
        """The edited document without unreferenced entries: see :func:`core.gltf.prune.prune`."""
        return prune(self.json, self.document, self._payloads)

    def add_vertex_view(self, rows: NDArray[Any], columns: int, height: int) -> int:
        """A buffer view over the rows (N, n) of a vertex attribute, with every column (a vector is one) aligned."""
        aligned, padded = _column_aligned(rows, columns, height)
        stride = {"byteStride": aligned.itemsize * aligned.shape[1]} if padded and columns == 1 else {}
        return self.add_view(aligned.tobytes(), stride | {"target": ARRAY_BUFFER})


def _column_aligned(rows: NDArray[Any], columns: int, height: int) -> tuple[NDArray[Any], bool]:
    """Rows with every column (a vector is one) padded to a multiple of four bytes; True where that added any."""
    padding = -height * rows.itemsize % 4 // rows.itemsize
    split = rows.reshape(len(rows), columns, height)
    aligned = np.pad(split, ((0, 0), (0, 0), (0, padding))).reshape(len(rows), -1)
    return aligned, padding > 0
