"""Wavefront OBJ: polygons, texture coordinates, normals, vertex colours and material names."""

import re

import numpy as np
from numpy.typing import NDArray

from core.asset.budgets import Budgets, within
from core.asset.polygons import Attribute, Float, Int, Material, PolygonMesh, check_sizes
from core.asset.refusals import malformed
from core.asset.text import Lines, parse_numbers, token_starts, tokens_per_line


def read_obj(data: bytes, budgets: Budgets) -> PolygonMesh:
    """Read an OBJ; ``mtllib`` is never opened, lines and free-form surfaces are not read.

    Objects and groups are one mesh; ``usemtl`` names are its material groups.

    Raises:
        MeshmarkError: ``malformed_file`` or ``budget_exceeded``.
    """
    lines = Lines(data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" "))
    is_vertex, is_uv, is_normal, is_face = (lines.keyword(word) for word in (b"v", b"vt", b"vn", b"f"))
    positions, counts, values = _rows(lines.select(is_vertex, 1), 3, "vertex")
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
        uv, uv_counts, uv_values = _rows(lines.select(is_uv, 2), 1, "texture coordinate")
        second = _column(uv_values, uv_counts, 1)
        attributes["TEXCOORD_0"] = Attribute(np.column_stack([uv[:, 0], 1 - second]), corner[:, 1])
    if is_normal.any():
        attributes["NORMAL"] = Attribute(_rows(lines.select(is_normal, 2), 3, "normal")[0], corner[:, 2])
    colored = counts >= 6
    if colored.any():
        rgb = np.column_stack([_column(values, counts, column) for column in (3, 4, 5)])
        scale = 255.0 if rgb[colored].max() > 1 else 1.0
        index = np.where(colored, np.arange(len(colored)), -1)
        known = (corner[:, 0] >= 0) & (corner[:, 0] < len(index))
        attributes["COLOR_0"] = Attribute(
            np.column_stack([rgb / scale, np.ones(len(rgb))]),
            np.where(known, index[np.where(known, corner[:, 0], 0)], -1),
        )
    group, materials = _materials(lines, is_face, budgets)
    return PolygonMesh(positions, corner[:, 0], sizes, group, attributes, materials)


def material_libraries(data: bytes) -> list[str]:
    """The paths of the MTL files that an OBJ names; one line may name several, or one with blanks in its name."""
    found: list[str] = []
    for match in re.finditer(rb"(?m)^[ \t]*mtllib[ \t]+([^\r\n]+)", data):
        line = match[1].decode("utf-8", "replace").strip()
        names = re.findall(r"\S.*?\.mtl(?=\s|$)", line, re.IGNORECASE) or [line]
        found += [name.strip('"') for name in names]
    return list(dict.fromkeys(found))


def _rows(text: bytes, width: int, what: str) -> tuple[Float, Int, Float]:
    """The first ``width`` numbers of each line, how many it has, and all of them."""
    counts = tokens_per_line(text)
    if len(counts) and counts.min() < width:
        raise malformed(f"A {what} line of the OBJ has {counts.min()} numbers instead of {width}.")
    values = parse_numbers(text, np.float64, what)
    return np.column_stack([_column(values, counts, column) for column in range(width)]), counts, values


def _column(values: Float, counts: Int, column: int) -> Float:
    """(N,) number ``column`` of each line, 0 where the line is shorter."""
    start = np.cumsum(counts) - counts
    has = counts > column
    result = np.zeros(len(counts))
    result[has] = values[start[has] + column]
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


def _materials(lines: Lines, is_face: NDArray[np.bool_], budgets: Budgets) -> tuple[Int, tuple[Material, ...]]:
    """(P,) the material of each face and the names, of which the first is that of faces before any ``usemtl``."""
    names = {b"": 0}
    switches = np.flatnonzero(lines.keyword(b"usemtl"))
    current = [0]
    for line in switches.tolist():
        current.append(names.setdefault(lines[line][len(b"usemtl") :].strip(), len(names)))
        within(len(names) - 1, budgets.materials, "materials")
    group = np.asarray(current, np.int64)[np.searchsorted(switches, np.flatnonzero(is_face))]
    return group, tuple(Material(name.decode("utf-8", "replace")) for name in names)
