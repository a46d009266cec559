"""PLY (Stanford), ASCII and binary of either byte order."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.assembly import Assembly, single
from core.asset.budgets import Budgets
from core.asset.polygons import Attribute, Float, Int, PolygonMesh, check_sizes, weld
from core.asset.refusals import malformed, truncated
from core.asset.text import parse_numbers
from core.errors import MeshmarkError

FACE_LISTS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"

_HEADER_LIMIT = 2**20
_BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
_COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


@dataclass(frozen=True)
class Property:
    """A column of an element: one number of ``kind``, or a list of them whose length is a ``count_kind``."""

    name: str
    kind: str
    count_kind: str = ""


@dataclass(frozen=True)
class Element:
    """A table of the file: ``count`` rows of properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def least_row_bytes(self) -> int:
        """Bytes of a row whose lists are all empty."""
        return sum(struct.calcsize("<" + (column.count_kind or column.kind)) for column in self.properties)


@dataclass(frozen=True)
class Header:
    """What a PLY declares, and where its body starts. ASCII numbers are parsed as doubles: ``kind`` still says what
    they were, since colours are scaled by their type."""

    format: str
    elements: tuple[Element, ...]
    end: int

    def element(self, name: str) -> Element | None:
        """The element of this name, if any."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def surface(self) -> Element | None:
        """The element that holds the surface: faces, or triangle strips where there are none."""
        named = (self.element(name) for name in ("face", STRIPS))
        return next((element for element in named if element is not None and element.count), None)


def parse_header(data: bytes) -> Header:
    """Read a PLY header.

    Raises:
        MeshmarkError: ``malformed_file``, or ``truncated_file`` where the header never ends.
    """
    marker = data.find(b"end_header", 0, _HEADER_LIMIT)
    end = min((at for at in (data.find(b"\n", marker), data.find(b"\r", marker)) if at >= 0), default=len(data))
    if marker < 0:
        raise truncated("The PLY header never ends.")
    end += 2 if data[end : end + 2] == b"\r\n" else 1
    file_format, elements = "", []
    for line in data[:marker].decode("ascii", "replace").splitlines()[1:]:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in _BYTE_ORDERS:
                file_format = name
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append((name, int(count), list[Property]()))
            case ["property", "list", count_kind, kind, name] if elements and {count_kind, kind} <= _TYPES.keys():
                elements[-1][2].append(Property(name, _TYPES[kind], _TYPES[count_kind]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(Property(name, _TYPES[kind]))
            case _:
                raise malformed(f"The PLY header has a line that is not understood: {line.strip()[:60]!r}.")
    if not file_format:
        raise malformed("The PLY header does not say whether the file is text or binary.")
    return Header(file_format, tuple(Element(name, count, tuple(columns)) for name, count, columns in elements), end)


def read_ply(data: bytes, budgets: Budgets) -> Assembly:
    """Read the vertices and faces (or triangle strips) of a PLY that passed the gate; every other element is skipped.

    Vertex colours win over face colours. Texture files named in comments are never opened.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file`` or ``budget_exceeded``.
    """
    header = parse_header(data)
    body, offset, elements = memoryview(data), header.end, header.elements
    if header.format == "ascii":
        body, offset = memoryview(parse_numbers(data[header.end :], np.float64, "data").tobytes()), 0
        elements = tuple(_as_doubles(element) for element in elements)
    surface = header.surface
    assert surface is not None, "the gate refuses a PLY without"
    tables: dict[str, dict[str, Any]] = {}
    for element in elements:
        if {"vertex", surface.name} <= tables.keys():
            break
        tables[element.name], offset = _read_element(element, body, offset, _BYTE_ORDERS[header.format])
    vertex, face = tables["vertex"], tables[surface.name]
    sizes, corners = next(face[name] for name in FACE_LISTS if name in face)
    if corners.dtype.kind == "f" and not np.all(np.isfinite(corners) & (corners == np.floor(corners))):
        raise malformed("A face of the PLY has a vertex number that is not an integer.")
    corners = np.clip(corners, -1, 2**53).astype(np.int64)
    if surface.name == STRIPS:
        corners, face = _strip_corners(sizes, corners), {}
        sizes = np.full(len(corners) // 3, 3)
    check_sizes(sizes, budgets)
    positions = _matrix(vertex, "xyz")
    mesh = PolygonMesh(positions, corners, sizes, np.zeros(len(sizes), np.int64))
    mesh.attributes.update(_attributes(header, vertex, face, mesh))
    return single(mesh, [])


def _strip_corners(sizes: Int, corners: Int) -> Int:
    """(3 T,) the triangles of strips, each row one strip or several with -1 between them.

    Triangles with two equal corners only lead a strip to its next place, and are left out.
    """
    flat = np.insert(corners, np.cumsum(sizes), -1)
    at = np.arange(len(flat))
    rank = at - np.maximum.accumulate(np.where(flat == -1, at, -1))  # 1, 2, 3, ... in each strip
    third = np.flatnonzero((rank >= 3) & (flat != -1))
    triangles = flat[third[:, None] + np.array([-2, -1, 0])]
    turned = rank[third] % 2 == 0  # every second triangle of a strip is wound the other way
    triangles[turned, :2] = triangles[turned, 1::-1]
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (c != a)].ravel())


def _as_doubles(element: Element) -> Element:
    columns = (Property(column.name, "d", "d" if column.count_kind else "") for column in element.properties)
    return Element(element.name, element.count, tuple(columns))


def _attributes(
    header: Header, vertex: dict[str, Any], face: dict[str, Any], mesh: PolygonMesh
) -> dict[str, Attribute]:
    """Normals, texture coordinates and colours of the vertices, else of the corners or faces."""
    attributes = {}
    if {"nx", "ny", "nz"} <= vertex.keys():
        attributes["NORMAL"] = Attribute(_matrix(vertex, ("nx", "ny", "nz")), mesh.corners)
    names = next((names for names in _UV_NAMES if set(names) <= vertex.keys()), None)
    if names:
        attributes["TEXCOORD_0"] = Attribute(_flip(_matrix(vertex, names)), mesh.corners)
    elif "texcoord" in face and np.array_equal(face["texcoord"][0], 2 * mesh.sizes):
        uv = _matrix({"uv": face["texcoord"][1]}, ["uv"]).reshape(-1, 2)
        attributes["TEXCOORD_0"] = Attribute(_flip(uv), weld(uv))
    if (colors := _colors(header, "vertex", vertex)) is not None:
        attributes["COLOR_0"] = Attribute(colors, mesh.corners)
    elif (colors := _colors(header, "face", face)) is not None:
        attributes["COLOR_0"] = Attribute(colors, np.repeat(weld(colors), mesh.sizes))
    return attributes


def _matrix(table: dict[str, Any], names: Iterable[str]) -> Float:
    """(N, n) columns of a table as numbers."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any other
        return np.column_stack([table[name].astype(np.float64) for name in names])


def _flip(uv: Float) -> Float:
    return np.column_stack([uv[:, 0], 1 - uv[:, 1]])


def _colors(header: Header, name: str, table: dict[str, Any]) -> Float | None:
    """(N, 4) colours in 0-1; integers are fractions of the largest number of their type."""
    names = next((names for names in _COLOR_NAMES if set(names) <= table.keys()), None)
    element = header.element(name)
    if names is None or element is None:
        return None
    kinds = {column.name: column.kind for column in element.properties}
    rgba = np.ones((len(table[names[0]]), 4))
    for column, channel in enumerate((*names, names[0].replace("red", "alpha"))):
        if channel in table:
            scale = {"B": 255.0, "H": 65535.0, "f": 1.0, "d": 1.0}.get(kinds[channel], 255.0)
            rgba[:, column] = table[channel] / scale
    return rgba


def _read_element(element: Element, body: memoryview, offset: int, order: str) -> tuple[dict[str, Any], int]:
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
    lengths, _ = _walk_row(element, body, offset, order)
    row_bytes = _row_dtype(element, lengths, order).itemsize
    if offset + row_bytes * element.count <= len(body):
        rows = _table(element, lengths, body, offset, order)
        if all(np.all(rows[f"{column} length"] == length) for column, length in enumerate(lengths)):
            everything = np.arange(element.count)
            return _columns(element, np.tile(lengths, (element.count, 1)), [(everything, rows)]), offset + rows.nbytes
    return _read_uneven(element, body, offset, order)


def _read_uneven(element: Element, body: memoryview, offset: int, order: str) -> tuple[dict[str, Any], int]:
    """The same for lists of several lengths: walk the rows, then gather those of equal lengths together."""
    lengths, starts = [], [offset]
    for _ in range(element.count):
        row_lengths, offset = _walk_row(element, body, offset, order)
        lengths.append(row_lengths)
        starts.append(offset)
    start, length = np.asarray(starts[:-1]), np.asarray(lengths, np.int64)
    kinds, kind = np.unique(length, axis=0, return_inverse=True)
    by_kind = np.argsort(kind, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(kind.ravel()))])
    buffer, groups = np.frombuffer(body, np.uint8), []
    for shape, (low, high) in zip(kinds.tolist(), pairwise(bounds.tolist()), strict=True):
        rows = by_kind.ravel()[low:high]
        dtype = _row_dtype(element, tuple(shape), order)
        groups.append((rows, buffer[start[rows][:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]))
    return _columns(element, length, groups), offset


def _walk_row(element: Element, body: memoryview, offset: int, order: str) -> tuple[tuple[int, ...], int]:
    """The list lengths of the row at ``offset``, and the offset of the next row."""
    lengths = []
    for column in element.properties:
        if column.count_kind:
            if offset + struct.calcsize(order + column.count_kind) > len(body):
                raise _truncated(element)
            length = struct.unpack_from(order + column.count_kind, body, offset)[0]
            if not 0 <= length < 2**31 or length != int(length):
                raise malformed(f"A {element.name} of the PLY has a list of {length} numbers.")
            lengths.append(int(length))
            offset += struct.calcsize(order + column.count_kind) + int(length) * struct.calcsize(order + column.kind)
        else:
            offset += struct.calcsize(order + column.kind)
    if offset > len(body):
        raise _truncated(element)
    return tuple(lengths), offset


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
