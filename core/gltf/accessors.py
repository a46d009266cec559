"""The values of accessors (glTF 2.0 specification, section 3.6.2)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document, malformed


def read_accessor(document: Document, index: int) -> NDArray[Any]:
    """The values of an accessor in its native dtype, possibly read-only.

    Args:
        document: the GLB.
        index: of the accessor.

    Returns:
        (count,) for SCALAR, (count, n) for VECn, (count, n * n) column-major for MATn. ``byteStride``, sparse
        substitution, compression and a missing buffer view (zeros) are honoured; ``normalized`` is not: see
        :func:`dequantize`.

    Raises:
        MeshmarkError: ``malformed_file``, ``index_out_of_range`` (sparse) or ``external_reference``.
    """
    accessor = document.entry("accessors", index)
    code, kind, count = (accessor.get(key) for key in ("componentType", "type", "count"))
    dtype = COMPONENT_TYPES.get(code) if isinstance(code, int) else None
    shape = ELEMENT_TYPES.get(kind) if isinstance(kind, str) else None
    if dtype is None or shape is None or type(count) is not int or count < 1:
        raise malformed(f"accessors[{index}] does not declare a valid type, component type and count.")
    if "bufferView" in accessor:
        values = read_view(document, accessor["bufferView"], accessor.get("byteOffset", 0), count, dtype, shape)
    elif index in document.draco:
        values = document.draco[index]
    else:
        values = np.zeros((count, shape[0] * shape[1]), dtype)
    if "sparse" in accessor:
        values = _substitute(document, index, values, dtype, shape)
    return values[:, 0] if kind == "SCALAR" else values


def read_values(document: Document, index: int) -> Float:
    """The values of an accessor as numbers: :func:`read_accessor`, dequantized.

    Raises:
        MeshmarkError: as :func:`read_accessor`.
    """
    return dequantize(read_accessor(document, index), document.entry("accessors", index))


def dequantize(array: NDArray[Any], accessor: dict[str, Any]) -> Float:
    """Accessor values as float64, integers of a ``normalized`` accessor as fractions (specification 3.6.2.2)."""
    values = array.astype(np.float64)
    if accessor.get("normalized", False) and array.dtype.kind in "iu":
        values /= np.iinfo(array.dtype).max
        np.maximum(values, -1.0, out=values)
    return values


def read_view(
    document: Document,
    view_index: Any,
    byte_offset: Any,
    count: int,
    dtype: np.dtype[Any],
    shape: tuple[int, int],
) -> NDArray[Any]:
    """(count, columns * rows) values that start ``byte_offset`` bytes into a buffer view."""
    view = document.entry("bufferViews", view_index)
    data, start, length = document.view(view_index)
    columns, rows = shape
    column_bytes = rows * dtype.itemsize
    column_stride = column_bytes if columns == 1 else -(-column_bytes // 4) * 4  # matrix columns are 4-byte aligned
    stride = view.get("byteStride", columns * column_stride)
    if any(type(number) is not int or number < 0 for number in (stride, byte_offset)):
        raise malformed(f"bufferViews[{view_index}] or its accessor has offsets that are not non-negative integers.")
    last = byte_offset + (count - 1) * stride + (columns - 1) * column_stride + column_bytes
    if last > length:
        raise malformed(f"An accessor reads past the end of bufferViews[{view_index}].")
    strided = np.ndarray(
        (count, columns, rows), dtype, data, start + byte_offset, (stride, column_stride, dtype.itemsize)
    )
    return np.ascontiguousarray(strided).reshape(count, columns * rows)


def _substitute(
    document: Document, index: int, values: NDArray[Any], dtype: np.dtype[Any], shape: tuple[int, int]
) -> NDArray[Any]:
    """``values`` with the rows of the accessor's ``sparse`` object replaced."""
    sparse = document.entry("accessors", index)["sparse"]
    try:
        count = sparse["count"]
        where, what = sparse["indices"], sparse["values"]
        index_type = COMPONENT_TYPES[where["componentType"]]
        views = where["bufferView"], what["bufferView"]
    except (KeyError, TypeError):
        raise malformed(f"The sparse part of accessors[{index}] is incomplete.") from None
    if type(count) is not int or count < 1 or index_type.kind != "u":
        raise malformed(f"The sparse part of accessors[{index}] does not declare a valid count and index type.")
    rows = read_view(document, views[0], where.get("byteOffset", 0), count, index_type, (1, 1))[:, 0]
    if rows.max() >= len(values):
        raise MeshmarkError(
            ErrorCode.INDEX_OUT_OF_RANGE,
            f"The sparse part of accessors[{index}] replaces row {rows.max()} of {len(values)}.",
            "Export the asset again; its sparse accessor is damaged.",
        )
    result = values.copy()
    result[rows] = read_view(document, views[1], what.get("byteOffset", 0), count, dtype, shape)
    return result
