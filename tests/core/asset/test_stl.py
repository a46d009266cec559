import numpy as np
import pytest

from core.asset.stl import is_ascii, read_stl
from core.errors import ErrorCode, MeshmarkError
from tests.core.asset.samples import STL_ASCII, STL_BINARY


@pytest.mark.parametrize("data", [STL_BINARY, STL_ASCII, STL_ASCII.upper(), STL_ASCII.replace(b"\n", b"\r\n")])
def test_equal_corners_become_one_vertex_in_order_of_appearance(data: bytes) -> None:
    mesh = read_stl(data)
    assert len(mesh.positions) == 8
    assert mesh.sizes.tolist() == [3] * 12
    first_seen = list(dict.fromkeys(mesh.corners.tolist()))
    assert first_seen == list(range(8))


def test_ascii_and_binary_agree() -> None:
    text, binary = read_stl(STL_ASCII), read_stl(STL_BINARY)
    np.testing.assert_array_equal(text.positions, binary.positions)
    np.testing.assert_array_equal(text.corners, binary.corners)


def test_the_size_decides_before_the_first_word() -> None:
    assert STL_BINARY.startswith(b"solid")
    assert not is_ascii(STL_BINARY)
    assert is_ascii(STL_ASCII)


def test_several_solids_are_one_mesh_and_degenerate_triangles_stay() -> None:
    flat = b"solid b\nfacet\nouter loop\nvertex 1 1 1\nvertex 1 1 1\nvertex 5 0 0\nendloop\nendfacet\nendsolid\n"
    mesh = read_stl(STL_ASCII + flat)
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
        read_stl(STL_ASCII.replace(old, new, 1))
    assert caught.value.code is ErrorCode.MALFORMED_FILE
