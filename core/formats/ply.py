"""PLY (Stanford), ASCII and binary of either byte order."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.budgets import Budgets, within
from core.formats.assembly import Assembly, dropped, single
from core.formats.names import decode
from core.formats.ply_elements import Columns, Lists, read_element
from core.formats.ply_header import BYTE_ORDERS, STRIPS, Element, Header, Property, parse_header
from core.formats.polygons import Attribute, Material, PolygonMesh, check_sizes, color_fractions
from core.formats.source import Source
from core.formats.text import parse_numbers
from core.formats.textures import IMAGE_ENDINGS, check_pixels, usable_image
from core.geometry.grouping import weld
from core.notices import Notice
from core.refusals import malformed, no_faces, truncated

FACE_LISTS = ("vertex_indices", "vertex_index")

COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))

Load = Callable[[bytes], bytes | None]


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
        header: from :func:`check_ply`.
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
        header: from :func:`check_ply`.
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
        tables[element.name], offset = read_element(element, body, offset, BYTE_ORDERS[header.format])
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
    turned = rank[third] % 2 == 0  # every second triangle of a strip is flipped
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
    names = next((names for names in UV_NAMES if set(names) <= vertex.keys()), None)
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
    """(N, 4) colours in 0-1: bytes are fractions of 255, numbers of other types fractions of their apparent range."""
    names = next((names for names in COLOR_NAMES if set(names) <= table.keys()), None)
    element = header.element(name)
    if names is None or element is None:
        return None
    kinds = {column.name: column.kind for column in element.properties}
    rgba = np.ones((len(table[names[0]]), 4))
    for column, channel in enumerate((*names, names[0].replace("red", "alpha"))):
        if channel in table:
            values = _matrix(table, [channel])[:, 0]
            if kinds[channel] in "bB":  # a signed byte is the same eight bits; in text it may be no number at all
                finite = np.isfinite(values)
                values[finite] = values[finite] % 256 / 255
            rgba[:, column] = values
    return color_fractions(rgba)
