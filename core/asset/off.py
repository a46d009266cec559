"""OFF (Geomview): vertices with optional normals, colours and texture coordinates; polygons with optional colours."""

import re
from dataclasses import dataclass

import numpy as np

from core.asset.budgets import Budgets
from core.asset.polygons import Attribute, Float, Int, PolygonMesh, check_sizes
from core.asset.refusals import malformed, truncated
from core.asset.text import parse_numbers, tokens_per_line
from core.errors import ErrorCode, MeshmarkError

_BLANKS = rb"(?:[ \t\r\n]|#[^\n]*\n)"
_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?" + _BLANKS + rb"*(?P<prefix>(?:ST)?C?N?4?n?)OFF(?P<binary>[ \t]+BINARY)?\b"
    rb"(?:" + _BLANKS + rb"+(\d{1,18})" + _BLANKS + rb"+(\d{1,18}))?"
)
_HEADER_LIMIT = 2**16


@dataclass(frozen=True)
class Header:
    """Which vertex columns an OFF declares, its counts, and where the line of the counts starts to be body."""

    prefix: str
    vertices: int
    faces: int
    end: int


def parse_header(data: bytes) -> Header:
    """Read the first lines of an OFF.

    Raises:
        MeshmarkError: ``malformed_file``, or ``unsupported_feature`` for binary or higher-dimensional files.
    """
    match = _HEADER.match(data[:_HEADER_LIMIT])
    if match is None:
        raise malformed("The file does not start with an OFF header.")
    prefix = match["prefix"].decode()
    if match["binary"] or "4" in prefix or "n" in prefix:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"The file is a {prefix}OFF{' BINARY' if match['binary'] else ''}; only three-dimensional text is read.",
            "Export it as a plain OFF or as a GLB.",
        )
    if match[3] is None:
        raise malformed("The OFF header does not declare how many vertices and faces follow.")
    return Header(prefix, int(match[3]), int(match[4]), match.end())


def read_off(data: bytes, budgets: Budgets) -> PolygonMesh:
    """Read an OFF with one vertex or polygon on each line.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file`` or ``budget_exceeded``.
    """
    header = parse_header(data)
    body = data[header.end :].replace(b"\r\n", b"\n").replace(b"\r", b"\n").partition(b"\n")[2] + b"\n"
    body = re.sub(rb"#[^\n]*", b"", body) if b"#" in body else body
    counts = tokens_per_line(body)
    counts = counts[counts > 0]
    if len(counts) < header.vertices + header.faces:
        raise truncated(
            f"The OFF declares {header.vertices:,} vertices and {header.faces:,} faces, each on a line of its own, "
            f"but only {len(counts):,} lines follow."
        )
    values = parse_numbers(body, np.float64, "vertex or face")
    start = np.cumsum(counts) - counts
    vertex_rows, face_rows = slice(header.vertices), slice(header.vertices, header.vertices + header.faces)
    columns, width = _vertex_columns(header, counts[vertex_rows])
    table = values[start[vertex_rows][:, None] + np.arange(width)]
    sizes, corners, face_colors = _polygons(values, start[face_rows], counts[face_rows], budgets)
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
    return PolygonMesh(table[:, :3], corners, sizes, np.zeros(header.faces, np.int64), attributes)


def _vertex_columns(header: Header, counts: Int) -> tuple[dict[str, slice], int]:
    """Where each attribute lies in a vertex line, in the order position, normal, colour, texture; and its width."""
    width = int(counts.min()) if len(counts) else 3
    columns, end = {}, 3
    if "N" in header.prefix:
        columns["NORMAL"] = slice(end, end := end + 3)
    texture = 2 if "ST" in header.prefix else 0
    if "C" in header.prefix:  # three or four components, whatever the line has room for
        columns["COLOR_0"] = slice(end, end := end + (4 if width - end - texture >= 4 else 3))
    if texture:
        columns["TEXCOORD_0"] = slice(end, end := end + 2)
    if width < end:
        raise malformed(f"A vertex line of the {header.prefix}OFF has {width} numbers instead of {end}.")
    return columns, end


def _polygons(values: Float, start: Int, counts: Int, budgets: Budgets) -> tuple[Int, Int, Float | None]:
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
    """(K, 4) in 0-1 from (K, 3) or (K, 4) in 0-1 or 0-255; a missing alpha is opaque."""
    rgba = np.full((len(colors), 4), np.nan)
    rgba[:, : colors.shape[1]] = colors
    rgba /= 255.0 if np.nanmax(rgba[:, :3], initial=0.0) > 1 else 1.0
    rgba[np.isnan(rgba[:, 3]), 3] = 1.0
    return rgba
