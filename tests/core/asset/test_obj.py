import numpy as np
import pytest

from core.asset.budgets import Budgets
from core.asset.obj import read_obj
from core.asset.polygons import PolygonMesh
from core.errors import ErrorCode, MeshmarkError

VERTICES = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def _read(data: bytes) -> PolygonMesh:
    return read_obj(data, Budgets())


@pytest.mark.parametrize(
    ("faces", "uv", "normal"),
    [
        (b"f 1 2 3 4\n", None, None),
        (b"f 1/4 2/3 3/2 4/1\n", [3, 2, 1, 0], None),
        (b"f 1//2 2//2 3//1 4//1\n", None, [1, 1, 0, 0]),
        (b"f 1/1/2 2/2/2 3/3/1 4/4/1\n", [0, 1, 2, 3], [1, 1, 0, 0]),
        (b"f 1/1/ 2/2/ 3/3/ 4/4/\n", [0, 1, 2, 3], None),
        (b"f 1/ 2/ 3/ 4/\n", None, None),
        (b"f 1/1 2 3//2 4/4/2\n", [0, -1, -1, 3], [-1, -1, 1, 1]),
        (b"f -4/-4/-1 -3/-3/-1 -2/-2/-2 -1/-1/-2\n", [0, 1, 2, 3], [1, 1, 0, 0]),
    ],
)
def test_every_way_to_write_a_corner_is_read(faces: bytes, uv: list[int] | None, normal: list[int] | None) -> None:
    mesh = _read(VERTICES + b"vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nvn 0 1 0\n" + faces)
    assert mesh.corners.tolist() == [0, 1, 2, 3]
    assert mesh.sizes.tolist() == [4]
    assert mesh.attributes["TEXCOORD_0"].index.tolist() == (uv or [-1] * 4)
    assert mesh.attributes["NORMAL"].index.tolist() == (normal or [-1] * 4)


def test_negative_numbers_count_back_from_the_line_of_the_face() -> None:
    mesh = _read(VERTICES + b"f -4 -3 -2\n" + VERTICES + b"f -4 -3 -2\nf 1 2 -1\n")
    assert mesh.corners.tolist() == [0, 1, 2, 4, 5, 6, 0, 1, 7]


@pytest.mark.parametrize(
    "data",
    [
        VERTICES.replace(b"\n", b"\r\n") + b"f 1 2 3\r\nf 1 3 4\r\n",
        VERTICES.replace(b"\n", b"\r") + b"f 1 2 3\rf 1 3 4\r",
        b"\xef\xbb\xbf" + VERTICES + b"f 1 2 3\nf 1 3 4",
        VERTICES.replace(b"v ", b"  v\t  ") + b"\tf 1  2\t3  \n\n f 1 3 4",
        VERTICES + b"f 1 \\\n2 3\nf 1 \\\r\n 3 4\n",
        b"# f 9 9 9\n#v 1 2\n" + VERTICES + b"f 1 2 3 # first\n# between\nf 1 3 4 #last",
        VERTICES + b"l 1 2\np 1\nvp 0.1\ng f 1\no v 2\ns 1\nfo 1 2 3\nf 1 2 3\nf 1 3 4\ncurv 0 1 1 2\n",
    ],
)
def test_line_endings_blanks_comments_and_other_statements_do_not_matter(data: bytes) -> None:
    mesh = _read(data)
    np.testing.assert_array_equal(mesh.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mesh.corners.tolist() == [0, 1, 2, 0, 2, 3]


def test_a_fourth_coordinate_is_not_a_colour() -> None:
    mesh = _read(VERTICES.replace(b"\n", b" 1.0\n") + b"f 1 2 3\n")
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert not mesh.attributes


def test_colours_of_some_vertices_are_colours_of_those() -> None:
    mesh = _read(b"v 0 0 0 255 0 0\nv 1 0 0\nv 0 1 0 0 51 0\nf 1 2 3\n")
    colors = mesh.attributes["COLOR_0"]
    assert colors.index.tolist() == [0, -1, 2]
    assert colors.values[[0, 2]].tolist() == [[1, 0, 0, 1], [0, 0.2, 0, 1]]


def test_references_to_texture_coordinates_that_the_file_does_not_have_are_left_out() -> None:
    assert "TEXCOORD_0" not in _read(VERTICES + b"f 1/1 2/2 3/3\n").attributes


@pytest.mark.parametrize(
    ("line", "quoted"),
    [
        (b"f 1 2 x\n", "'x'"),
        (b"f 1 2 3.5\n", "'3.5'"),
        (b"f 1/1/1/1 2/2/2/2 3/3/3/3\n", "v/vt/vn"),
        (b"f / / /\n", "v/vt/vn"),
        (b"v 1 2\nf 1 2 3\n", "2 numbers"),
        (b"v 1 2 zero\nf 1 2 3\n", "'zero'"),
        (b"v 1,5 2,5 0\nf 1 2 3\n", "'1,5'"),
        (b"vn 1\nf 1//1 2//1 3//1\n", "1 numbers"),
        (b"vt 0 0\nf 1/-2 2/1 3/1\n", "counts back"),
    ],
)
def test_a_line_that_breaks_the_rules_is_quoted(line: bytes, quoted: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _read(VERTICES + line)
    assert caught.value.code is ErrorCode.MALFORMED_FILE
    assert quoted in caught.value.message


def test_more_materials_than_the_budget_are_refused() -> None:
    data = VERTICES + b"".join(b"usemtl m%d\nf 1 2 3\n" % number for number in range(11))
    assert len(read_obj(data, Budgets(materials=11)).materials) == 12
    with pytest.raises(MeshmarkError) as caught:
        read_obj(data, Budgets(materials=10))
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED
