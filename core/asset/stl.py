"""STL, binary and ASCII: a soup of triangles whose equal corners become shared vertices."""

import re

import numpy as np

from core.asset.polygons import Float, PolygonMesh, weld
from core.asset.refusals import malformed, non_finite
from core.asset.text import Lines, parse_numbers, tokens_per_line

HEADER_BYTES = 84
TRIANGLE_BYTES = 50

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


def triangle_count(data: bytes) -> int:
    """How many triangles the header of a binary STL claims; ``data`` holds at least the header."""
    return int.from_bytes(data[80:HEADER_BYTES], "little")


def is_ascii(data: bytes) -> bool:
    """Whether an STL is text. Exporters also start binary files with "solid", so the size decides first."""
    if len(data) >= HEADER_BYTES and len(data) == HEADER_BYTES + TRIANGLE_BYTES * triangle_count(data):
        return False
    head = data[:1024]
    return b"\0" not in head and re.match(rb"\s*(solid|facet)\b", head, re.IGNORECASE) is not None


def read_stl(data: bytes) -> PolygonMesh:
    """Read an STL; exactly equal corners are one vertex, numbered by first appearance.

    Facet normals repeat what the corners say and are not read; degenerate triangles are kept.

    Raises:
        MeshmarkError: ``malformed_file`` or ``non_finite_positions``.
    """
    corners = _ascii_corners(data) if is_ascii(data) else _binary_corners(data)
    finite = np.isfinite(corners).all(axis=1)
    if not finite.all():
        raise non_finite(
            f"{np.count_nonzero(~finite):,} of {len(corners):,} corners of the STL are not finite numbers."
        )
    representative = weld(corners)
    is_first = representative == np.arange(len(corners))
    faces = len(corners) // 3
    return PolygonMesh(
        corners[is_first],
        (np.cumsum(is_first) - 1)[representative],
        np.full(faces, 3, np.int64),
        np.zeros(faces, np.int64),
    )


def _binary_corners(data: bytes) -> Float:
    records = np.frombuffer(data, _RECORD, triangle_count(data), HEADER_BYTES)
    with np.errstate(invalid="ignore"):  # a signalling NaN, refused above us as any other
        return records["corners"].reshape(-1, 3).astype(np.float64)


def _ascii_corners(data: bytes) -> Float:
    lines = Lines(data.lower())
    text = lines.select(lines.keyword(b"vertex"), len(b"vertex"))
    facets, vertices = int(lines.keyword(b"facet").sum()), tokens_per_line(text)
    if len(vertices) != 3 * facets:
        raise malformed(f"The STL has {facets:,} facets but {len(vertices):,} vertices instead of {3 * facets:,}.")
    if np.any(vertices != 3):
        raise malformed("A vertex line of the STL does not have three numbers.")
    return parse_numbers(text, np.float64, "vertex").reshape(-1, 3)
