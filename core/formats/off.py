"""OFF (Geomview): vertices with optional normals, colours and texture coordinates; polygons with optional colours."""

import re
from dataclasses import dataclass

import numpy as np

from core.arrays import Float, Int
from core.budgets import Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.formats.assembly import Assembly, single
from core.formats.polygons import Attribute, PolygonMesh, check_sizes, color_fractions
from core.formats.source import Source
from core.formats.text import parse_numbers, tokens_per_line
from core.refusals import malformed, no_faces, truncated

_BLANKS = rb"(?:[ \t\r\n]|#[^\n]*\n)"
_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?" + _BLANKS + rb"*(?P<prefix>(?:ST)?C?N?4?n?)OFF(?P<binary>[ \t]+BINARY)?\b"
    rb"(?:" + _BLANKS + rb"+(\d{1,18})" + _BLANKS + rb"+(\d{1,18}))?"
)
_HEADER_LIMIT = 2**16

Polygons = tuple[Int, Int, Float | None]  # sizes, corners, and colours where some have one


@dataclass(frozen=True)
class Header:
    """Header of an OFF: the prefix that declares its vertex columns, its counts, and their end, where the body starts.

    ``order`` is the byte order of a binary file, as numpy writes it, and empty for a text.
    """

    prefix: str
    vertices: int
    faces: int
    end: int
    order: str = ""

    @property
    def least_bytes(self) -> int:
        """Least length of the body in bytes, with faces of no corners."""
        if self.order:
            return 4 * (3 * self.vertices + self.faces)
        return len("0 0 0\n") * self.vertices + len("0\n") * self.faces - 1


def parse_header(data: bytes) -> Header:
    """Read the first lines of an OFF.

    Raises:
        MeshmarkError: ``malformed_file``, or ``unsupported_feature`` for binary or higher-dimensional files.
    """
    match = _HEADER.match(data[:_HEADER_LIMIT])
    if match is None:
        raise malformed("The file does not start with an OFF header.")
    prefix = match["prefix"].decode()
    if "4" in prefix or "n" in prefix:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"The file is a {prefix}OFF; only three-dimensional files are read.",
            "Export it as a plain OFF or as a GLB.",
        )
    if match["binary"]:
        start = data.find(b"\n", match.end("binary")) + 1
        if start == 0 or len(data) < start + 12:
            raise truncated("The binary OFF ends before its counts.")
        return _binary_header(prefix, data, start)
    if match[3] is None:
        raise malformed("The OFF header does not declare how many vertices and faces follow.")
    return Header(prefix, int(match[3]), int(match[4]), match.end())


def _binary_header(prefix: str, data: bytes, start: int) -> Header:
    """The counts at ``start`` in the byte order in which the file can hold them.

    Geomview writes big-endian words on every machine, the PMP library those of the machine.
    """
    headers = []
    for order in ">", "<":
        vertices, faces, _ = np.frombuffer(data, f"{order}u4", 3, start).tolist()
        headers.append(Header(prefix, vertices, faces, start + 12, order))
    fitting = [header for header in headers if header.least_bytes <= len(data) - header.end]
    return fitting[0] if fitting else min(headers, key=lambda header: header.least_bytes)


def check_off(source: Source, budgets: Budgets) -> Header:
    """Refuse an OFF whose header declares no surface, more than the file holds, or more than the budgets allow.

    Returns:
        The header.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces`` or ``budget_exceeded``.
    """
    data = source.data
    header = parse_header(data)
    if header.faces == 0:
        raise no_faces(f"The OFF has {header.vertices:,} vertices but no face.")
    within(header.vertices, budgets.vertices, "vertices")
    within(header.faces, budgets.faces, "faces")
    if header.least_bytes > len(data) - header.end:
        raise truncated(
            f"The OFF declares {header.vertices:,} vertices and {header.faces:,} faces, "
            f"but {len(data) - header.end:,} bytes follow its header."
        )
    return header


def read_off(source: Source, header: Header, budgets: Budgets) -> Assembly:
    """Read an OFF, text or binary.

    A text with one vertex or polygon on each line may have colours of faces; one whose numbers run on freely may not,
    since only the end of its line shows the end of a polygon.

    Args:
        source: the file.
        header: from :func:`check_off`.
        budgets: bounds corners and triangles.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file`` or ``budget_exceeded``.
    """
    if header.order:
        table, columns, polygons = _read_binary(header, source.data, budgets)
    else:
        table, columns, polygons = _read_text(header, source.data, budgets)
    sizes, corners, face_colors = polygons
    attributes = {}
    if "NORMAL" in columns:
        attributes["NORMAL"] = Attribute(table[:, columns["NORMAL"]], corners)
    if "TEXCOORD_0" in columns:
        uv = table[:, columns["TEXCOORD_0"]]
        attributes["TEXCOORD_0"] = Attribute(np.column_stack([uv[:, 0], 1 - uv[:, 1]]), corners)
    if "COLOR_0" in columns:
        attributes["COLOR_0"] = Attribute(_rgba(table[:, columns["COLOR_0"]]), corners)
    elif face_colors is not None:
        has_color = np.isfinite(face_colors[:, 0])
        index = np.where(has_color, np.arange(header.faces), -1)
        attributes["COLOR_0"] = Attribute(face_colors, np.repeat(index, sizes))
    return single(PolygonMesh(table[:, :3], corners, sizes, np.zeros(header.faces, np.int64), attributes), [])


def _read_text(header: Header, data: bytes, budgets: Budgets) -> tuple[Float, dict[str, slice], Polygons]:
    body = data[header.end :].replace(b"\r\n", b"\n").replace(b"\r", b"\n").partition(b"\n")[2] + b"\n"
    body = re.sub(rb"#[^\n]*", b"", body) if b"#" in body else body
    counts = tokens_per_line(body)
    counts = counts[counts > 0]
    values = parse_numbers(body, np.float64, "vertex or face")
    by_line = len(counts) >= header.vertices + header.faces and counts[: header.vertices].min(initial=3) >= 3
    if not by_line:
        return _read_free(header, values, budgets)
    start = np.cumsum(counts) - counts
    vertex_rows, face_rows = slice(header.vertices), slice(header.vertices, header.vertices + header.faces)
    columns, width = _vertex_columns(header, int(counts[vertex_rows].min(initial=2**31)))
    table = values[start[vertex_rows][:, None] + np.arange(width)]
    return table, columns, _polygons(values, start[face_rows], counts[face_rows], budgets)


def _read_free(header: Header, values: Float, budgets: Budgets) -> tuple[Float, dict[str, slice], Polygons]:
    """Numbers without regard to lines; colours of vertices have four components."""
    columns, width = _vertex_columns(header, 2**31)
    faces = values[header.vertices * width :]
    table = values[: header.vertices * width].reshape(-1, width) if len(faces) else values[:0].reshape(0, width)
    if (found := _walk(faces.data, header.faces, colored=False)) is None:
        raise _cut_off(header, len(values))
    if found.end < len(faces):
        behind = len(faces) - found.end
        raise malformed(f"The OFF has {behind:,} numbers behind its last face; their lines do not tell why.")
    return table, columns, _polygons(faces, found.start, np.diff(found.start, append=found.end), budgets)


def _read_binary(header: Header, data: bytes, budgets: Budgets) -> tuple[Float, dict[str, slice], Polygons]:
    """Words of four bytes: the vertices as floats, then each polygon with its size, its corners, and its colour.

    Geomview puts the number of components before the colour, 0 where there is none; the PMP library has no colours
    and no such number. The length of the file decides between both.
    """
    columns, width = _vertex_columns(header, 2**31)
    words = np.frombuffer(data, f"{header.order}i4", (len(data) - header.end) // 4, header.end).astype(np.int32)
    table = words[: header.vertices * width].view(np.float32)
    faces = words[header.vertices * width :]
    walk, plain = (_walk(faces.data, header.faces, colored) for colored in (True, False))
    if (walk is None or walk.end < len(faces)) and plain is not None and plain.end == len(faces):
        walk = plain
    if walk is None or len(table) < header.vertices * width:
        raise _cut_off(header, len(words))
    count = np.diff(walk.start, append=walk.end)
    values, keep = faces.astype(np.float64), np.ones(len(faces), np.bool_)
    keep[walk.end :] = False
    behind = np.zeros(header.faces, np.int64)
    if walk.components is not None:  # as in a text: without the number of components, colours as numbers
        color = np.zeros(len(faces), np.bool_)
        place = (walk.start + count)[:, None] - 1 - np.arange(4)
        color[place[np.arange(4) < walk.components[:, None]]] = True
        with np.errstate(invalid="ignore"):
            values[color] = faces.view(np.float32)[color]
        keep[walk.start + count - 1 - walk.components] = False
        behind += 1
    start = walk.start - (np.cumsum(behind) - behind)
    polygons = _polygons(values[keep], start, count - behind, budgets)
    with np.errstate(invalid="ignore"):  # a signalling NaN, refused later as any other
        return table.reshape(-1, width).astype(np.float64), columns, polygons


@dataclass(frozen=True, eq=False)
class _Walk:
    """Start (P,) of each face, number of components (P,) of its colour where faces declare it, and the end of all."""

    start: Int
    components: Int | None
    end: int


def _walk(numbers: memoryview, faces: int, colored: bool) -> _Walk | None:
    """The faces one after another, as each determines the start of the next; ``None`` where they are inconsistent."""
    start, components, at = [], [], 0
    try:
        for _ in range(faces):
            start.append(at)
            if not 0 <= (size := numbers[at]) < 2**31:
                return None
            at += 1 + int(size)
            if colored:
                if not 0 <= (count := numbers[at]) <= 4:
                    return None
                components.append(count)
                at += 1 + count
    except IndexError:
        return None
    if at > len(numbers):
        return None
    return _Walk(np.asarray(start, np.int64), np.asarray(components, np.int64) if colored else None, at)


def _cut_off(header: Header, found: int) -> MeshmarkError:
    return truncated(
        f"The OFF declares {header.vertices:,} vertices and {header.faces:,} faces, "
        f"but the {found:,} numbers that follow do not hold them."
    )


def _vertex_columns(header: Header, width: int) -> tuple[dict[str, slice], int]:
    """Columns of each attribute in a vertex of ``width`` numbers, in the order position, normal, colour, texture; and
    the number of columns that they take."""
    columns, end = {}, 3
    if "N" in header.prefix:
        columns["NORMAL"] = slice(end, end := end + 3)
    texture = 2 if "ST" in header.prefix else 0
    if "C" in header.prefix:  # three or four components, by the length of the line
        columns["COLOR_0"] = slice(end, end := end + (4 if width - end - texture >= 4 else 3))
    if texture:
        columns["TEXCOORD_0"] = slice(end, end := end + 2)
    if width < end:
        raise malformed(f"A vertex line of the {header.prefix}OFF has {width} numbers instead of {end}.")
    return columns, end


def _polygons(values: Float, start: Int, counts: Int, budgets: Budgets) -> Polygons:
    """(P,) sizes, (C,) corners and (P, 4) colours (NaN where a face has none, ``None`` where no face has one)."""
    declared = values[start]
    if not np.all((declared >= 0) & (declared == np.floor(declared)) & (declared < counts)):
        raise malformed("A face line of the OFF has fewer vertex numbers than it declares.")
    sizes = declared.astype(np.int64)
    check_sizes(sizes, budgets)
    corner_rank = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    numbers = values[np.repeat(start + 1, sizes) + corner_rank]
    if not np.all(numbers == np.floor(numbers)):
        raise malformed("A face line of the OFF has a vertex number that is not an integer.")
    corners = np.clip(numbers, -1, 2**53).astype(np.int64)
    rest = counts - 1 - sizes
    colored = rest >= 3
    if not colored.any():
        return sizes, corners, None
    colors = np.full((len(start), 4), np.nan)
    first = (start + 1 + sizes)[colored]
    colors[colored, :3] = values[first[:, None] + np.arange(3)]
    colors[colored, 3] = np.where(rest[colored] >= 4, values[first + np.minimum(3, rest[colored] - 1)], np.nan)
    return sizes, corners, _rgba(colors)


def _rgba(colors: Float) -> Float:
    """(K, 4) in 0-1 from (K, 3) or (K, 4) of any range; a missing alpha is opaque."""
    rgba = np.full((len(colors), 4), np.nan)
    rgba[:, : colors.shape[1]] = colors
    rgba = color_fractions(rgba)
    rgba[np.isnan(rgba[:, 3]), 3] = 1.0
    return rgba
