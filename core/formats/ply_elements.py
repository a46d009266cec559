"""The rows of the elements of a PLY, as columns."""

import struct
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Int
from core.errors import MeshmarkError
from core.formats.ply_header import Element
from core.geometry.grouping import group_rows
from core.refusals import malformed, truncated

Columns = dict[str, NDArray[Any]]
Lists = dict[str, tuple[Int, NDArray[Any]]]  # their lengths, and the values one after another


def read_element(element: Element, body: memoryview, offset: int, order: str) -> tuple[dict[str, Any], int]:
    """The columns of an element, lists as (lengths, values), and the offset behind it."""
    if not any(column.count_kind for column in element.properties):
        rows = _table(element, (), body, offset, order)
        return {column.name: rows[column.name] for column in element.properties}, offset + rows.nbytes
    if element.count == 0:
        return {
            column.name: (np.empty(0, np.int64),) * 2 if column.count_kind else np.empty(0)
            for column in element.properties
        }, offset
    # Most files have lists of one length throughout: then the element is one table.
    lengths, _ = _walk(element, 1, body, offset, order)
    shape = tuple(lengths[0].tolist())
    row_bytes = _row_dtype(element, shape, order).itemsize
    if offset + row_bytes * element.count <= len(body):
        rows = _table(element, shape, body, offset, order)
        if all(np.all(rows[f"{column} length"] == length) for column, length in enumerate(shape)):
            everything = np.arange(element.count)
            return _columns(element, np.tile(shape, (element.count, 1)), [(everything, rows)]), offset + rows.nbytes
    return _read_uneven(element, body, offset, order)


def _read_uneven(element: Element, body: memoryview, offset: int, order: str) -> tuple[dict[str, Any], int]:
    """As :func:`read_element` for lists of several lengths: walk the rows, then gather those of equal lengths."""
    length, end = _walk(element, element.count, body, offset, order)
    start = np.concatenate([[offset], end[:-1]])
    kind = group_rows(length.astype(np.uint32))
    first = np.unique(kind, return_index=True)[1]
    by_kind = np.argsort(kind, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(kind))])
    buffer, groups = np.frombuffer(body, np.uint8), []
    for shape, (low, high) in zip(length[first].tolist(), pairwise(bounds.tolist()), strict=True):
        rows = by_kind[low:high]
        dtype = _row_dtype(element, tuple(shape), order)
        groups.append((rows, buffer[start[rows][:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]))
    return _columns(element, length, groups), int(end[-1])


def _walk(element: Element, count: int, body: memoryview, offset: int, order: str) -> tuple[Int, Int]:
    """The list lengths (count, L) of the rows from ``offset`` on, and the end of each.

    A row starts where the one before ends, so that this is one step after another: they are kept small.
    """
    steps, fixed = [], 0  # of each list: the bytes from the end of the one before to its length, and how to read it
    for column in element.properties:
        if column.count_kind:
            reader = struct.Struct(order + column.count_kind)
            steps.append((fixed, reader.unpack_from, reader.size, struct.calcsize(order + column.kind)))
            fixed = 0
        else:
            fixed += struct.calcsize(order + column.kind)
    lengths, ends, at = [], [], offset
    try:
        for _ in range(count):
            for before, unpack, width, item in steps:
                at += before
                (length,) = unpack(body, at)
                if not 0 <= length < 2**31:
                    raise _no_length(element, length)
                lengths.append(length)
                at += width + int(length) * item
            at += fixed
            ends.append(at)
    except struct.error:
        raise _truncated(element) from None
    if at > len(body):
        raise _truncated(element)
    table = np.asarray(lengths, np.float64).reshape(count, len(steps))
    if np.any(broken := table != np.floor(table)):
        raise _no_length(element, float(table[broken][0]))
    return table.astype(np.int64), np.asarray(ends)


def _no_length(element: Element, length: float) -> MeshmarkError:
    return malformed(f"A {element.name} of the PLY has a list of {length} numbers.")


def _row_dtype(element: Element, lengths: tuple[int, ...], order: str) -> np.dtype[Any]:
    """The layout of a row whose lists have these lengths."""
    fields: list[Any] = []
    remaining = iter(enumerate(lengths))
    for column in element.properties:
        if column.count_kind:
            number, length = next(remaining)
            fields.append((f"{number} length", order + column.count_kind))
            fields.append((column.name, order + column.kind, (length,)))
        else:
            fields.append((column.name, order + column.kind))
    return np.dtype(fields)


def _table(element: Element, lengths: tuple[int, ...], body: memoryview, offset: int, order: str) -> NDArray[Any]:
    dtype = _row_dtype(element, lengths, order)
    if offset + dtype.itemsize * element.count > len(body):
        raise _truncated(element)
    return np.frombuffer(body, dtype, element.count, offset) if element.count else np.empty(0, dtype)


def _columns(element: Element, lengths: Int, groups: list[tuple[Int, NDArray[Any]]]) -> dict[str, Any]:
    """Columns in row order out of groups of rows: arrays, and (lengths, values) for lists."""
    columns: dict[str, Any] = {}
    number = 0
    for column in element.properties:
        if not column.count_kind:
            values = np.empty(element.count, groups[0][1][column.name].dtype)
            for rows, table in groups:
                values[rows] = table[column.name]
            columns[column.name] = values
            continue
        length = lengths[:, number]
        number += 1
        first = np.cumsum(length) - length
        flat = np.empty(int(length.sum()), groups[0][1][column.name].dtype)
        for rows, table in groups:
            flat[first[rows][:, None] + np.arange(table[column.name].shape[1])] = table[column.name]
        columns[column.name] = (length, flat)
    return columns


def _truncated(element: Element) -> MeshmarkError:
    return truncated(
        f"The PLY declares {element.count:,} rows of {element.name}, but the file ends before the last one."
    )
