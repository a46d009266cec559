"""STL, binary and ASCII: a soup of triangles whose equal corners become shared vertices."""

import re

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.budgets import Budgets, within
from core.errors import ErrorCode
from core.formats.assembly import Assembly, dropped, single
from core.formats.polygons import Attribute, PolygonMesh
from core.formats.signs import HEAD, Certainty, Sign, head, is_printable
from core.formats.source import Source
from core.formats.text import Lines, parse_numbers, tokens_per_line
from core.geometry.grouping import weld
from core.notices import Notice
from core.refusals import malformed, no_faces, non_finite, truncated

HEADER_BYTES = 84
TRIANGLE_BYTES = 50

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VALID = 0x8000  # bit of an attribute word that marks it as a colour, or as none: see :func:`_colors`


def _is_text(data: bytes) -> bool:
    return is_ascii(data) and re.search(rb"(?i)facet|endsolid", head(data)) is not None


def _is_binary(data: bytes) -> bool:
    """Binary STL has no signature: either the size fits the count exactly, or 80 bytes of padded text precede it."""
    if len(data) < HEADER_BYTES:
        return False
    if len(data) == HEADER_BYTES + TRIANGLE_BYTES * claimed_count(data):
        return True
    return is_printable(data[:80].replace(b"\0", b" ")) and not is_printable(data[:HEAD])


STL_SIGNS = (Sign(Certainty.KEYWORDS, _is_text), Sign(Certainty.PROPORTIONS, _is_binary))


def claimed_count(data: bytes) -> int:
    """Number of triangles that the header of a binary STL declares; ``data`` holds at least the header."""
    return int.from_bytes(data[80:HEADER_BYTES], "little")


def triangle_count(data: bytes) -> int:
    """Number of triangles in a binary STL: as many as fit exactly where its header declares none, else the declared
    number."""
    fitting, rest = divmod(len(data) - HEADER_BYTES, TRIANGLE_BYTES)
    return claimed_count(data) or (fitting if rest == 0 else 0)


def is_ascii(data: bytes) -> bool:
    """True where an STL is text. Exporters also start binary files with "solid", so the size decides first."""
    if len(data) >= HEADER_BYTES and len(data) == HEADER_BYTES + TRIANGLE_BYTES * claimed_count(data):
        return False
    head = data[:1024]
    return b"\0" not in head and re.match(rb"\s*(solid|facet)\b", head, re.IGNORECASE) is not None


def check_stl(source: Source, budgets: Budgets) -> None:
    """Refuse an STL that has fewer bytes than its declared triangles take, or far more; or is beyond the budgets.

    Raises:
        MeshmarkError: ``truncated_file``, ``malformed_file``, ``no_faces`` or ``budget_exceeded``.
    """
    data = source.data
    if is_ascii(data):
        faces = data.lower().count(b"endfacet")
    else:
        faces = triangle_count(data)
        present = len(data) - HEADER_BYTES
        if present < faces * TRIANGLE_BYTES:
            raise truncated(
                f"The STL claims {faces:,} triangles, which take {faces * TRIANGLE_BYTES:,} bytes, "
                f"but {present:,} follow its header."
            )
        # a few stray bytes at the end are common and harmless
        if present > max(2 * faces, 1) * TRIANGLE_BYTES:
            raise malformed(f"The STL claims {faces:,} triangles, but {present:,} bytes follow its header.")
    if faces == 0:
        raise no_faces("The STL has no triangle.")
    within(faces, budgets.faces, "triangles")


def read_stl(source: Source, _parsed: None, _budgets: Budgets) -> Assembly:
    """Read an STL; exactly equal corners are one vertex, numbered by first appearance.

    Facet normals follow from the corners and are not read; degenerate triangles are kept. The attribute words of a
    binary file are colours of facets, as Magics or as VisCAM and SolidView write them.

    Raises:
        MeshmarkError: ``malformed_file`` or ``non_finite_positions``.
    """
    data = source.data
    warnings: list[Notice] = []
    colors = None
    if is_ascii(data):
        corners = _ascii_corners(data)
    else:
        records = np.frombuffer(data, RECORD, triangle_count(data), HEADER_BYTES)
        with np.errstate(invalid="ignore"):  # a signalling NaN, refused below as any other
            corners = records["corners"].reshape(-1, 3).astype(np.float64)
        colors = _colors(data[:80], records["attribute"], warnings)
        if claimed_count(data) == 0:
            warnings.append(_wrong_count(len(records)))
    finite = np.isfinite(corners).all(axis=1)
    if not finite.all():
        raise non_finite(
            f"{np.count_nonzero(~finite):,} of {len(corners):,} corners of the STL are not finite numbers."
        )
    representative = weld(corners)
    is_first = representative == np.arange(len(corners))
    faces = len(corners) // 3
    mesh = PolygonMesh(
        corners[is_first],
        (np.cumsum(is_first) - 1)[representative],
        np.full(faces, 3, np.int64),
        np.zeros(faces, np.int64),
    )
    if colors is not None:
        has_color = ~np.isnan(colors[:, 0])
        index = np.where(has_color, weld(np.nan_to_num(colors, nan=-1)), -1)
        mesh.attributes["COLOR_0"] = Attribute(colors, np.repeat(index, 3))
    return single(mesh, warnings)


def _wrong_count(present: int) -> Notice:
    return Notice(
        ErrorCode.MALFORMED_FILE,
        f"The header of the STL claims 0 triangles, but the bytes of exactly {present:,} follow; these were read.",
        "Export it again if some are missing.",
    )


def _colors(header: bytes, words: NDArray[np.uint16], warnings: list[Notice]) -> Float | None:
    """(F, 4) colours of the facets, NaN for those that have none; ``None`` where the file has none.

    Five bits a channel, https://en.wikipedia.org/wiki/STL_(file_format)#Color: Magics has a colour of the whole part
    in the header, red in the lowest bits, and a bit that is set where the facet has no colour of its own; VisCAM and
    SolidView have blue in the lowest bits, and a bit that is set where it has one.
    """
    part = re.search(rb"(?s)COLOR=(...)", header)
    has_color = (words & _VALID != 0) == (part is None)
    if part is not None and not words.any():  # no colours of facets at all, rather than black throughout
        has_color = np.zeros(len(words), np.bool_)
    if part is None and not has_color.any():
        if words.any():
            facets = np.count_nonzero(words)
            warnings.append(
                dropped(f"The STL has attributes of {facets:,} facets that are no colours of a known kind.")
            )
        return None
    shifts = (0, 5, 10) if part is not None else (10, 5, 0)
    colors = np.column_stack([*((words >> shift & 31) / 31 for shift in shifts), np.ones(len(words))])
    colors[~has_color, :3] = np.nan if part is None else np.frombuffer(part[1], np.uint8) / 255
    return colors


def _ascii_corners(data: bytes) -> Float:
    lines = Lines(data.lower())
    text = lines.select(lines.keyword(b"vertex"), len(b"vertex"))
    facets, vertices = int(lines.keyword(b"facet").sum()), tokens_per_line(text)
    if len(vertices) != 3 * facets:
        raise malformed(f"The STL has {facets:,} facets but {len(vertices):,} vertices instead of {3 * facets:,}.")
    if np.any(vertices != 3):
        raise malformed("A vertex line of the STL does not have three numbers.")
    return parse_numbers(text, np.float64, "vertex").reshape(-1, 3)
