import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit
from core.formats.assembly import Assembly
from core.formats.format import Format
from core.formats.source import Source
from core.formats.stl import is_ascii, read_stl
from tests.core.formats.samples import STL_ASCII, STL_BINARY


def read(data: bytes) -> Assembly:
    return read_stl(Source(data), None, Budgets())


@pytest.mark.parametrize("data", [STL_BINARY, STL_ASCII, STL_ASCII.upper(), STL_ASCII.replace(b"\n", b"\r\n")])
def test_equal_corners_become_one_vertex_in_order_of_appearance(data: bytes) -> None:
    mesh = read(data).bodies[0]
    assert len(mesh.positions) == 8
    assert mesh.sizes.tolist() == [3] * 12
    first_seen = list(dict.fromkeys(mesh.corners.tolist()))
    assert first_seen == list(range(8))


def test_ascii_and_binary_agree() -> None:
    text, binary = read(STL_ASCII).bodies[0], read(STL_BINARY).bodies[0]
    np.testing.assert_array_equal(text.positions, binary.positions)
    np.testing.assert_array_equal(text.corners, binary.corners)


def test_the_size_decides_before_the_first_word() -> None:
    assert STL_BINARY.startswith(b"solid")
    assert not is_ascii(STL_BINARY)
    assert is_ascii(STL_ASCII)


def test_several_solids_are_one_mesh_and_degenerate_triangles_stay() -> None:
    flat = b"solid b\nfacet\nouter loop\nvertex 1 1 1\nvertex 1 1 1\nvertex 5 0 0\nendloop\nendfacet\nendsolid\n"
    mesh = read(STL_ASCII + flat).bodies[0]
    assert len(mesh.sizes) == 13
    assert mesh.corners[-3] == mesh.corners[-2]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"   vertex 1 1 1\n", b""),
        (b"vertex 1 1 1\n", b"vertex 1 1\n"),
        (b"vertex 1 1 1\n", b"vertex 1 1 one\n"),
        (b" endfacet\nendsolid cube\n", b" endfacet\nfacet normal 0 0 1\n"),
    ],
)
def test_a_text_with_missing_numbers_is_malformed(old: bytes, new: bytes) -> None:
    assert old in STL_ASCII
    with pytest.raises(MeshmarkError) as caught:
        read(STL_ASCII.replace(old, new, 1))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


MAGICS = b"solid COLOR=\xff\x00\x33\xff,MATERIAL="


def _stl(words: list[int], header: bytes = b"", count: int | None = None) -> bytes:
    """The cube in binary, with attribute words for its first facets."""
    data = bytearray(header.ljust(80) + STL_BINARY[80:])
    for facet, word in enumerate(words):
        struct.pack_into("<H", data, 84 + 50 * facet + 48, word)
    struct.pack_into("<I", data, 80, 12 if count is None else count)
    return bytes(data)


def _facet_colors(data: bytes) -> list[list[float] | None]:
    color = read(data).bodies[0].attributes["COLOR_0"]
    assert color.index.reshape(-1, 3).min(axis=1).tolist() == color.index.reshape(-1, 3).max(axis=1).tolist()
    return [None if row < 0 else color.values[row].round(4).tolist() for row in color.index[::3].tolist()]


def test_colours_of_magics_are_read_red_first_and_the_part_s_colour_where_a_facet_has_none() -> None:
    colors = _facet_colors(_stl([31, 31 << 5, 31 << 10] + [0x8000] * 9, MAGICS))
    assert colors == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]] + [[1, 0, 0.2, 1]] * 9
    assert _facet_colors(_stl([0] * 12, MAGICS)) == [[1, 0, 0.2, 1]] * 12


def test_colours_of_viscam_are_read_blue_first_where_their_bit_says_so() -> None:
    colors = _facet_colors(_stl([0x8000 | 31, 0x8000 | 31 << 10, 31, 0x8000]))
    assert colors[:4] == [[0, 0, 1, 1], [1, 0, 0, 1], None, [0, 0, 0, 1]]
    assert colors[4:] == [None] * 8


def test_attributes_that_are_no_colours_are_said_and_none_is_nothing() -> None:
    plain, other = read(_stl([])), read(_stl([7, 9]))
    assert plain.warnings == []
    assert "2 facets" in other.warnings[0].message
    assert not plain.bodies[0].attributes
    assert not other.bodies[0].attributes


@given(words=st.lists(st.integers(0, 65535), min_size=12, max_size=12), magics=st.booleans())
def test_colours_never_move_a_triangle(words: list[int], magics: bool) -> None:
    data = _stl(words, MAGICS if magics else b"made by somebody")
    assert admit(data).format is Format.STL
    mesh = read(data).bodies[0]
    np.testing.assert_array_equal(mesh.corners, read(STL_BINARY).bodies[0].corners)
    if "COLOR_0" in mesh.attributes:
        color = mesh.attributes["COLOR_0"]
        assert len(color.index) == 36
        assert np.all(
            (color.values[color.index[color.index >= 0]] >= 0) & (color.values[color.index[color.index >= 0]] <= 1)
        )


@pytest.mark.parametrize("header", [b"", b"solid cube", b"exported \0 by somebody"])
def test_a_header_that_claims_no_triangle_is_corrected_where_the_bytes_fit_exactly(header: bytes) -> None:
    data = _stl([], header, count=0)
    assert admit(data).format is Format.STL
    assembly = read(data)
    assert len(assembly.bodies[0].sizes) == 12
    assert "claims 0 triangles" in assembly.warnings[0].message
    assert "12" in assembly.warnings[0].message


def test_a_header_that_claims_no_triangle_is_blamed_where_the_bytes_do_not_fit() -> None:
    with pytest.raises(MeshmarkError, match="claims 0 triangles, but 601 bytes follow") as caught:
        admit(_stl([], count=0) + b"\0")
    assert caught.value.code is ErrorCode.MALFORMED_FILE
