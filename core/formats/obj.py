"""Wavefront OBJ: polygons, texture coordinates, normals, vertex colours and material names."""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.budgets import Budgets, within
from core.formats.assembly import Assembly, dropped, single
from core.formats.names import decode, texts
from core.formats.polygons import Attribute, Material, PolygonMesh, check_sizes, color_fractions
from core.formats.signs import HEAD, Certainty, Sign, head, is_printable
from core.formats.source import Source
from core.formats.text import (
    Lines,
    count_lines,
    joined_lines,
    parse_numbers,
    readable_numbers,
    token_starts,
    tokens_per_line,
)
from core.notices import Notice
from core.refusals import malformed, no_faces

_LINE = re.compile(rb"(?:^|[\r\n])[ \t]*(?:v[ \t]+[-+.\d]|f[ \t]+-?\d)")
_SEARCHED = 2**20  # bytes of a text within which its first vertex or face is searched


def _has_line(data: bytes) -> bool:
    return _LINE.search(data, 0, _SEARCHED if is_printable(head(data)) else HEAD) is not None


OBJ_SIGNS = (Sign(Certainty.LINES, _has_line),)


def check_obj(source: Source, budgets: Budgets) -> None:
    """Refuse an OBJ without a surface, or beyond the budgets.

    Raises:
        MeshmarkError: ``no_faces``, ``malformed_file`` or ``budget_exceeded``.
    """
    vertices, faces = count_lines(source.data, b"vf")
    if faces == 0:
        raise no_faces(f"The OBJ has {vertices:,} vertices but no face.")
    if vertices == 0:
        raise malformed(f"The OBJ has {faces:,} faces but no vertex.")
    within(vertices, budgets.vertices, "vertices")
    within(faces, budgets.faces, "faces")


def read_mesh(data: bytes, budgets: Budgets, library: Mapping[bytes, Material] | None = None) -> Assembly:
    """Read an OBJ; ``mtllib`` is never opened, lines and free-form surfaces are not read.

    Objects and groups are one mesh; ``usemtl`` names are its material groups. Vertices are written as x y z, x y z w,
    x y z r g b, x y z w r g b or x y z w r g b a; ZBrush has its colours in comments.

    Args:
        data: the file.
        budgets: bounds corners, triangles and materials.
        library: materials by the bytes of their names; ``None`` where there is no library.

    Raises:
        MeshmarkError: ``malformed_file`` or ``budget_exceeded``.
    """
    lines = Lines(joined_lines(data))
    is_vertex, is_uv, is_normal, is_face = (lines.keyword(word) for word in (b"v", b"vt", b"vn", b"f"))
    positions, counts, values = _positions(lines.select(is_vertex, 1))
    corner, sizes = _corners(lines.select(is_face, 1), budgets)
    # negative numbers count back from the values defined before the face
    line_of_corner = np.repeat(np.flatnonzero(is_face), sizes)
    for column, mask in enumerate((is_vertex, is_uv, is_normal)):
        defined = np.cumsum(mask)[line_of_corner]
        number = corner[:, column].copy()
        corner[:, column] = np.where(number > 0, number - 1, np.where(number < 0, number + defined, -1))
        if column > 0 and np.any((number < 0) & (corner[:, column] < 0)):
            raise malformed("A face counts back past the first texture coordinate or normal of the OBJ.")
    attributes = {}
    if is_uv.any():
        u, v = _readable(lines.select(is_uv, 2), least=1, width=2).T
        attributes["TEXCOORD_0"] = Attribute(np.column_stack([u, 1 - v]), corner[:, 1])
    if is_normal.any():
        attributes["NORMAL"] = Attribute(_readable(lines.select(is_normal, 2), least=3, width=3), corner[:, 2])
    warnings: list[Notice] = []
    colors = _colors(values, counts) if np.any(counts >= 6) else _polypaint(lines, len(positions), warnings)
    if colors is not None:
        index = np.where(np.isnan(colors[:, 0]), -1, np.arange(len(colors)))
        known = (corner[:, 0] >= 0) & (corner[:, 0] < len(index))
        attributes["COLOR_0"] = Attribute(
            color_fractions(colors), np.where(known, index[np.where(known, corner[:, 0], 0)], -1)
        )
    group, names = _groups(lines, is_face, budgets)
    materials = _materials(names, library, warnings)
    mesh = PolygonMesh(positions, corner[:, 0], sizes, group, attributes, materials)
    return single(mesh, warnings)


def read_alone(data: bytes, budgets: Budgets) -> Assembly:
    """An OBJ without its materials; see :func:`read_mesh`."""
    assembly = read_mesh(data, budgets)
    libraries = material_libraries(data)
    if libraries and any(material.name for material in assembly.bodies[0].materials):
        assembly.warnings.append(
            dropped(
                f"The materials {decode(libraries[0])[:60]!r} are not in the upload; its faces go without.",
                "Send the OBJ in one ZIP archive with its MTL and textures.",
            )
        )
    return assembly


def material_libraries(data: bytes) -> list[bytes]:
    """The paths of the MTL files that an OBJ names; one line may name several, or one with blanks in its name."""
    found: list[bytes] = []
    for match in re.finditer(rb"(?m)^[ \t]*mtllib[ \t]+([^\r\n]+)", data):
        line = match[1].strip()
        names = re.findall(rb"\S.*?\.mtl(?=\s|$)", line, re.IGNORECASE) or [line]
        found += [name.strip(b'"') for name in names]
    return list(dict.fromkeys(found))


def _positions(text: bytes) -> tuple[Float, Int, Float]:
    """(V, 3) the first numbers of each vertex line, (V,) their number, and all of them."""
    counts = tokens_per_line(text)
    if len(counts) and counts.min() < 3:
        raise malformed(f"A vertex line of the OBJ has {counts.min()} numbers instead of 3.")
    values = parse_numbers(text, np.float64, "vertex")
    return np.column_stack([_column(values, counts, column) for column in range(3)]), counts, values


def _readable(text: bytes, least: int, width: int) -> Float:
    """(N, width) the first numbers of each line, 0 where it is shorter, NaN where it has fewer than ``least``."""
    counts = tokens_per_line(text)
    values = readable_numbers(text)
    table = np.column_stack([_column(values, counts, column) for column in range(width)])
    table[counts < least] = np.nan
    return table


def _colors(values: Float, counts: Int) -> Float:
    """(V, 4) the colours of vertices as written, NaN for those without."""
    # six numbers are x y z r g b; seven begin with x y z w, except of writers whose last is an alpha that is opaque
    fourth, last = _column(values, counts, 3)[counts == 7], _column(values, counts, 6)[counts == 7]
    has_alpha = np.any(fourth != 1) and np.all(np.isin(last, (1, 255)))
    first = np.where((counts == 7) & (not has_alpha) | (counts >= 8), 4, 3)
    rgba = np.column_stack([_column(values, counts, first + channel) for channel in range(4)])
    rgba[counts < first + 4, 3] = 1
    rgba[counts < 6] = np.nan
    return rgba


def _polypaint(lines: Lines, vertices: int, warnings: list[Notice]) -> Float | None:
    """(V, 4) the colours that ZBrush writes in comments, MMRRGGBB for each vertex, of which MM is a mask; or none."""
    is_paint = lines.keyword(b"#MRGB")
    if not is_paint.any():
        return None
    digits = b"".join(lines.select(is_paint, len(b"#MRGB")).split())
    try:
        words = np.frombuffer(bytes.fromhex(digits.decode("ascii")), np.uint8)
    except ValueError:
        warnings.append(dropped("The polypaint of the OBJ is not written as ZBrush does, and dropped."))
        return None
    painted = words[: len(words) // 4 * 4].reshape(-1, 4)[:vertices, 1:]
    colors = np.full((vertices, 4), np.nan)
    colors[: len(painted)] = np.column_stack([painted / 255, np.ones(len(painted))])
    return colors


def _column(values: Float, counts: Int, column: int | Int) -> Float:
    """(N,) number ``column`` (or one for each line) of each line, 0 where the line is shorter."""
    start = np.cumsum(counts) - counts
    has = counts > column
    result = np.zeros(len(counts))
    result[has] = values[(start + column)[has]]
    return result


def _corners(text: bytes, budgets: Budgets) -> tuple[Int, Int]:
    """(C, 3) the numbers v/vt/vn of each corner as written, 0 where left out, and (P,) corners of each face."""
    sizes = tokens_per_line(text)
    check_sizes(sizes, budgets)
    if b"/" not in text:
        corner = np.zeros((int(sizes.sum()), 3), np.int64)
        corner[:, 0] = parse_numbers(text, np.int64, "face")
        return corner, sizes
    text = re.sub(rb"/(?=[/\s])", b"/0", text)  # "7//9" and "7/"
    buffer = np.frombuffer(text, np.uint8)
    fields = 1 + np.add.reduceat(buffer == ord("/"), np.flatnonzero(token_starts(buffer)), dtype=np.int64)
    numbers = parse_numbers(text.replace(b"/", b" "), np.int64, "face")
    if fields.max() > 3 or len(numbers) != fields.sum():
        raise malformed("A face line of the OBJ has a corner that is not written as v, v/vt, v//vn or v/vt/vn.")
    start = np.cumsum(fields) - fields
    return np.column_stack(
        [np.where(fields > column, numbers[np.minimum(start + column, len(numbers) - 1)], 0) for column in range(3)]
    ), sizes


def _groups(lines: Lines, is_face: NDArray[np.bool_], budgets: Budgets) -> tuple[Int, list[bytes]]:
    """(P,) the material of each face and the names, of which the first is that of faces before any ``usemtl``."""
    names = {b"": 0}
    switches = np.flatnonzero(lines.keyword(b"usemtl"))
    current = [0]
    for line in switches.tolist():
        current.append(names.setdefault(lines[line][len(b"usemtl") :].strip(), len(names)))
        within(len(names) - 1, budgets.materials, "materials")
    return np.asarray(current, np.int64)[np.searchsorted(switches, np.flatnonzero(is_face))], list(names)


def _materials(
    names: list[bytes], library: Mapping[bytes, Material] | None, warnings: list[Notice]
) -> tuple[Material, ...]:
    """The materials of these names: by their bytes, else by their text, as where only one of the files is UTF-8."""
    text = texts(names)
    by_text = {material.name: material for material in (library or {}).values()}
    found = [(library or {}).get(name) or by_text.get(text[name]) for name in names]
    missing = [text[name] for name, material in zip(names, found, strict=True) if name and material is None]
    if missing and library is not None:
        some = ", ".join(repr(name[:60]) for name in missing[:3]) + (", ..." if len(missing) > 3 else "")
        warnings.append(
            dropped(
                f"The OBJ uses {len(missing):,} materials that its MTL does not have: {some}. Their faces go without.",
                "Write the names alike in both files; capitals matter.",
            )
        )
    return tuple(material or Material(text[name]) for material, name in zip(found, names, strict=True))
