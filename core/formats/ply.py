"""PLY (Stanford), ASCII and binary of either byte order."""

import re
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.budgets import Budgets, within
from core.errors import MeshmarkError
from core.formats.assembly import Assembly, dropped, single
from core.formats.names import decode
from core.formats.polygons import Attribute, Material, PolygonMesh, check_sizes, color_fractions
from core.formats.source import Source
from core.formats.text import parse_numbers
from core.formats.textures import IMAGE_ENDINGS, check_pixels, usable_image
from core.geometry.grouping import group_rows, weld
from core.notices import Notice
from core.refusals import malformed, no_faces, truncated

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
_TEXTURE = re.compile(
    rb"\s*comment\s+TextureFile\s+(.*\S)", re.IGNORECASE
)  # of MeshLab, and all that read and write alike

Load = Callable[[bytes], bytes | None]
Columns = dict[str, NDArray[Any]]
Lists = dict[str, tuple[Int, NDArray[Any]]]  # their lengths, and the values one after another


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
    they were, since colours are scaled by their type. ``textures`` are names of files, in whatever code page."""

    format: str
    elements: tuple[Element, ...]
    end: int
    textures: tuple[bytes, ...] = ()

    def element(self, name: str) -> Element | None:
        """The element of this name, if any."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def surface(self) -> Element | None:
        """The element that holds the surface: faces, or triangle strips where there are none."""
        named = (self.element(name) for name in ("face", STRIPS))
        return next((element for element in named if element is not None and element.count), None)


def parse_header(data: bytes) -> Header:
    """Read a PLY header; lines that start with a word of no meaning there, as old exporters write them, are skipped.

    Raises:
        MeshmarkError: ``malformed_file``, or ``truncated_file`` where the header never ends.
    """
    marker = data.find(b"end_header", 0, _HEADER_LIMIT)
    end = min((at for at in (data.find(b"\n", marker), data.find(b"\r", marker)) if at >= 0), default=len(data))
    if marker < 0:
        raise truncated("The PLY header never ends.")
    end += 2 if data[end : end + 2] == b"\r\n" else 1
    file_format, elements, textures = "", [], []
    for raw in data[:marker].splitlines()[1:]:
        if (texture := _TEXTURE.fullmatch(raw)) is not None:
            textures.append(texture[1])
        line = raw.decode("ascii", "replace")
        match line.split():
            case ["format", name, _] if name in _BYTE_ORDERS:
                file_format = name
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append((name, int(count), list[Property]()))
            case ["property", "list", count_kind, kind, name] if elements and {count_kind, kind} <= _TYPES.keys():
                elements[-1][2].append(Property(name, _TYPES[kind], _TYPES[count_kind]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(Property(name, _TYPES[kind]))
            case ["format" | "element" | "property", *_]:
                raise malformed(f"The PLY header has a line that is not understood: {line.strip()[:60]!r}.")
    if not file_format:
        raise malformed("The PLY header does not say whether the file is text or binary.")
    tables = tuple(Element(name, count, tuple(columns)) for name, count, columns in elements)
    return Header(file_format, tables, end, tuple(textures))


def check_ply(source: Source, budgets: Budgets) -> Header:
    """Refuse a PLY whose header declares no surface, more than the file holds, or more than the budgets allow.

    Returns:
        The header.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces`` or ``budget_exceeded``.
    """
    data = source.data
    header = parse_header(data)
    vertex, surface = header.element("vertex"), header.surface
    if vertex is None or not set("xyz") <= {column.name for column in vertex.properties if not column.count_kind}:
        raise malformed("The PLY declares no vertices with x, y and z.")
    if surface is None:
        raise no_faces(f"The PLY has {vertex.count:,} vertices but no face.")
    if not any(column.name in FACE_LISTS and column.count_kind for column in surface.properties):
        raise malformed("The faces of the PLY have no list of vertex indices.")
    for element in header.elements:
        names = [column.name for column in element.properties]
        if len(set(names)) != len(names):
            raise malformed(f"The PLY declares a property of {element.name} twice.")
    if len({element.name for element in header.elements}) != len(header.elements):
        raise malformed("The PLY declares an element twice.")
    within(vertex.count, budgets.vertices, "vertices")
    within(surface.count, budgets.faces, "faces")
    # in a text every number takes at least a digit and a blank
    least = sum(
        element.count * (2 * len(element.properties) if header.format == "ascii" else element.least_row_bytes)
        for element in header.elements
    )
    present = len(data) - header.end + (header.format == "ascii")  # the last blank may be missing
    if least > present:
        raise truncated(f"What the PLY declares takes at least {least:,} bytes, but {present:,} follow its header.")
    return header


def read_ply(source: Source, header: Header, budgets: Budgets) -> Assembly:
    """A PLY with the textures that its comments name, as far as they came with it; see :func:`read_mesh`.

    Args:
        source: the file.
        header: what :func:`check_ply` returned.
        budgets: bounds corners, triangles and the pixels of textures.

    Raises:
        MeshmarkError: as :func:`read_mesh`.
    """
    assembly = read_mesh(source.data, header, budgets, partial(source.load, escaped=False))
    beside = source.archive.names if source.archive else []
    images = [entry for entry in beside if entry.lower().endswith(IMAGE_ENDINGS)]
    if images and not header.textures and "TEXCOORD_0" in assembly.bodies[0].attributes:
        assembly.warnings.append(
            dropped(
                f"The PLY has texture coordinates but names no texture; {images[0][:60]!r} beside it is not used.",
                f"Add the line 'comment TextureFile {images[0][:60]}' to its header.",
            )
        )
    return assembly


def read_mesh(data: bytes, header: Header, budgets: Budgets, load: Load = lambda _path: None) -> Assembly:
    """Read the vertices and faces (or triangle strips) of a PLY that passed the gate; every other element is skipped.

    Vertex colours win over face colours.

    Args:
        data: the file.
        header: what :func:`check_ply` returned.
        budgets: bounds corners, triangles and the pixels of textures.
        load: the bytes of a texture by the name in a comment; ``None`` where it is not in the upload.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file`` or ``budget_exceeded``.
    """
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
    (vertex, _), (face, lists) = (_numbers_and_lists(tables[name]) for name in ("vertex", surface.name))
    sizes, corners = next(lists[name] for name in FACE_LISTS if name in lists)
    if corners.dtype.kind == "f" and not np.all(np.isfinite(corners) & (corners == np.floor(corners))):
        raise malformed("A face of the PLY has a vertex number that is not an integer.")
    corners = np.clip(corners, -1, 2**53).astype(np.int64)
    if surface.name == STRIPS:
        corners, face, lists = _strip_corners(sizes, corners), {}, {}
        sizes = np.full(len(corners) // 3, 3)
    check_sizes(sizes, budgets)
    positions = _matrix(vertex, "xyz")
    mesh = PolygonMesh(positions, corners, sizes, np.zeros(len(sizes), np.int64))
    mesh.attributes.update(_attributes(header, vertex, face, lists, mesh))
    warnings: list[Notice] = []
    if header.textures:
        mesh = _textured(mesh, header, face, load, warnings)
        check_pixels(mesh.materials, budgets)
    return single(mesh, warnings)


def _textured(mesh: PolygonMesh, header: Header, face: Columns, load: Load, warnings: list[Notice]) -> PolygonMesh:
    """The mesh with its textures, of which the faces have a number where there are several."""
    if "TEXCOORD_0" not in mesh.attributes:
        name = decode(header.textures[0])[:60]
        warnings.append(dropped(f"The PLY has no texture coordinates, so its texture {name!r} is dropped."))
        return mesh
    number = np.asarray(face.get("texnumber", np.zeros(len(mesh.sizes))), np.float64)
    count = len(header.textures)
    used = np.where((number >= 0) & (number < count), number, count).astype(np.int64)  # none where out of range
    images = {number: header.textures[number] for number in np.unique(used).tolist() if number < count}
    materials = [Material()] * (count + 1)
    for at, path in images.items():
        materials[at] = Material(texture=usable_image(decode(path), load(path), warnings))
    if unused := [decode(path)[:60] for at, path in enumerate(header.textures) if at not in images]:
        warnings.append(dropped(f"No face of the PLY is in its texture {unused[0]!r}, which is dropped."))
    return replace(mesh, group=used, materials=tuple(materials))


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


def _numbers_and_lists(table: dict[str, Any]) -> tuple[Columns, Lists]:
    """The columns of a table that are numbers, and those that are lists."""
    lists = {name: column for name, column in table.items() if isinstance(column, tuple)}
    return {name: column for name, column in table.items() if name not in lists}, lists


def _as_doubles(element: Element) -> Element:
    columns = (Property(column.name, "d", "d" if column.count_kind else "") for column in element.properties)
    return Element(element.name, element.count, tuple(columns))


def _attributes(
    header: Header, vertex: Columns, face: Columns, lists: Lists, mesh: PolygonMesh
) -> dict[str, Attribute]:
    """Normals, texture coordinates and colours of the vertices, else of the corners or faces."""
    attributes = {}
    if {"nx", "ny", "nz"} <= vertex.keys():
        attributes["NORMAL"] = Attribute(_matrix(vertex, ("nx", "ny", "nz")), mesh.corners)
    names = next((names for names in _UV_NAMES if set(names) <= vertex.keys()), None)
    if names:
        attributes["TEXCOORD_0"] = Attribute(_flip(_matrix(vertex, names)), mesh.corners)
    elif "texcoord" in lists:
        lengths, values = lists["texcoord"]
        attributes["TEXCOORD_0"] = _corner_uv(lengths, values, mesh.sizes)
    if (colors := _colors(header, "vertex", vertex)) is not None:
        attributes["COLOR_0"] = Attribute(colors, mesh.corners)
    elif (colors := _colors(header, "face", face)) is not None:
        attributes["COLOR_0"] = Attribute(colors, np.repeat(weld(colors), mesh.sizes))
    return attributes


def _matrix(table: Columns, names: Iterable[str]) -> Float:
    """(N, n) columns of a table as numbers."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any other
        return np.column_stack([table[name].astype(np.float64) for name in names])


def _flip(uv: Float) -> Float:
    return np.column_stack([uv[:, 0], 1 - uv[:, 1]])


def _corner_uv(lengths: Int, values: NDArray[Any], sizes: Int) -> Attribute:
    """Texture coordinates out of a list for each face, which has one pair for each corner, or none for any."""
    has = lengths == 2 * sizes
    uv = _matrix({"uv": values[np.repeat(has, lengths)]}, ["uv"]).reshape(-1, 2)
    index = np.full(int(sizes.sum()), -1)
    if len(uv):
        index[np.repeat(has, sizes)] = weld(uv)
    return Attribute(_flip(uv), index)


def _colors(header: Header, name: str, table: Columns) -> Float | None:
    """(N, 4) colours in 0-1: bytes are fractions of 255, numbers of other types of what they plainly go up to."""
    names = next((names for names in _COLOR_NAMES if set(names) <= table.keys()), None)
    element = header.element(name)
    if names is None or element is None:
        return None
    kinds = {column.name: column.kind for column in element.properties}
    rgba = np.ones((len(table[names[0]]), 4))
    for column, channel in enumerate((*names, names[0].replace("red", "alpha"))):
        if channel in table:
            rgba[:, column] = _matrix(table, [channel])[:, 0]
            if kinds[channel] in "bB":  # a signed byte is the same eight bits
                rgba[:, column] = rgba[:, column] % 256 / 255
    return color_fractions(rgba)


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
    """The same for lists of several lengths: walk the rows, then gather those of equal lengths together."""
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
    """The list lengths (count, L) of the rows from ``offset`` on, and where each ends.

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
