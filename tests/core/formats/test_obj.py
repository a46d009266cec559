import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.assemble import assemble
from core.formats.assembly import single
from core.formats.obj import read_alone, read_mesh
from core.formats.polygons import PolygonMesh

VERTICES = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def _read(data: bytes) -> PolygonMesh:
    return read_mesh(data, Budgets()).bodies[0]


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


@pytest.mark.parametrize(
    ("rows", "colors"),
    [
        (["1.0"], None),
        (["0.9 0.5 0"], [[0.9, 0.5, 0, 1]]),
        (["0.9 0.5 0", "1.00391 0.5 0"], [[0.9, 0.5, 0, 1], [1, 0.5, 0, 1]]),
        (["255 102 0"], [[1, 0.4, 0, 1]]),
        (["127.5 0 0"], [[0.5, 0, 0, 1]]),
        (["2 0 0", "0 1 0"], [[2 / 255, 0, 0, 1], [0, 1 / 255, 0, 1]]),
        (["1 0 1"], [[1, 0, 1, 1]]),
        (["65535 0 13107"], [[1, 0, 0.2, 1]]),
        (["-0.1 0.5 1"], [[0, 0.5, 1, 1]]),
        (["1.0 0.9 0.5 0"], [[0.9, 0.5, 0, 1]]),
        (["0.5 0.9 0.5 0"], [[0.9, 0.5, 0, 1]]),
        (["1.0 255 51 0"], [[1, 0.2, 0, 1]]),
        (["0.9 0.5 0 1"], [[0.9, 0.5, 0, 1]]),
        (["255 51 0 255"], [[1, 0.2, 0, 1]]),
        (["1.0 0.9 0.5 0 0.25"], [[0.9, 0.5, 0, 0.25]]),
    ],
)
def test_colours_of_any_range_stand_behind_the_coordinates(rows: list[str], colors: list[list[float]] | None) -> None:
    lines = "".join(f"v {number} 0 {number * number} {rows[number % len(rows)]}\n" for number in range(3))
    mesh = _read(lines.encode() + b"f 1 2 3\n")
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 1], [2, 0, 4]]
    if colors is None:
        assert not mesh.attributes
    else:
        np.testing.assert_allclose(mesh.attributes["COLOR_0"].values[: len(colors)], np.array(colors))


@pytest.mark.parametrize("bad", ["-1.#IND00 -1.#IND00 -1.#IND00", "nan(ind) 0 1", "1", "", "x y z", "1.#QNAN 0 0"])
def test_a_normal_that_cannot_be_read_counts_as_absent(bad: str) -> None:
    document = assemble(
        single(_read(VERTICES + f"vn {bad}\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//2 3//2 4//2\n".encode()), [])
    )
    attributes = [set(entry["attributes"]) for entry in document.json["meshes"][0]["primitives"]]
    assert attributes == [{"POSITION"}, {"POSITION", "NORMAL"}]


@pytest.mark.parametrize("bad", ["-1.#IND00 0", "0 nan", "", "u v"])
def test_a_texture_coordinate_that_cannot_be_read_counts_as_absent(bad: str) -> None:
    document = assemble(single(_read(VERTICES + f"vt {bad}\nvt 0 0\nf 1/1 2/2 3/2\nf 1/2 3/2 4/2\n".encode()), []))
    attributes = [set(entry["attributes"]) for entry in document.json["meshes"][0]["primitives"]]
    assert attributes == [{"POSITION"}, {"POSITION", "TEXCOORD_0"}]


def test_a_position_that_is_not_a_number_is_refused_as_one() -> None:
    with pytest.raises(MeshmarkError) as caught:
        assemble(single(_read(VERTICES + b"v 1 1.#IND 0\nf 1 2 5\n"), []))
    assert caught.value.code is ErrorCode.NON_FINITE_POSITIONS


def test_the_polypaint_of_zbrush_is_read_without_its_mask() -> None:
    paint = b"#MRGB ffff0000ff00ff00\n#MRGB 000000ff33333333\n#\n"
    colors = _read(b"#File exported by ZBrush\n" + VERTICES + paint + b"f 1 2 3 4\n").attributes["COLOR_0"]
    np.testing.assert_allclose(colors.values, np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0.2, 0.2, 0.2, 1]]))
    assert colors.index.tolist() == [0, 1, 2, 3]


def test_polypaint_of_some_vertices_colours_those_and_nonsense_is_said() -> None:
    some = _read(VERTICES + b"#MRGB ffff0000\nf 1 2 3 4\n").attributes["COLOR_0"]
    assert some.index.tolist() == [0, -1, -1, -1]
    nonsense = read_mesh(VERTICES + b"#MRGB ffxx0000\nf 1 2 3 4\n", Budgets())
    assert not nonsense.bodies[0].attributes
    assert "polypaint" in nonsense.warnings[0].message


def test_a_backslash_in_a_letter_of_shift_jis_does_not_join_lines() -> None:
    name = "\u30af\u30b9\u8868".encode("cp932")
    mesh = _read(VERTICES + b"usemtl " + name + b"\nf 1 2 3\nusemtl b\\\nc\nf 1 2 4\n")
    assert [material.name for material in mesh.materials] == ["", "\u30af\u30b9\u8868", "b c"]


def test_an_obj_on_its_own_says_that_its_materials_are_missing() -> None:
    data = b"mtllib some where.mtl\n" + VERTICES + b"usemtl red\nf 1 2 3\n"
    assert "some where.mtl" in read_alone(data, Budgets()).warnings[0].message
    assert read_alone(data.replace(b"usemtl red\n", b""), Budgets()).warnings == []


_NUMBER = st.floats(-1e6, 1e6).map(repr)
_BROKEN = st.sampled_from(["nan", "-nan(ind)", "1.#IND", "-1.#QNAN0", "x", "1e", "#3", "1_0", "\x01", "0x1"])


@given(
    rows=st.lists(st.lists(st.one_of(_NUMBER, _BROKEN), max_size=4), min_size=1, max_size=6),
    word=st.sampled_from(["vn", "vt"]),
)
def test_whatever_stands_in_a_normal_line_moves_no_other(rows: list[list[str]], word: str) -> None:
    lines = "".join(f"{word} {' '.join(row)}\n{word} 0.5 0.25 0.125\n" for row in rows)
    mesh = _read(VERTICES + lines.encode() + b"f 1 2 3\n")
    values = mesh.attributes[{"vn": "NORMAL", "vt": "TEXCOORD_0"}[word]].values
    assert values.shape == (2 * len(rows), {"vn": 3, "vt": 2}[word])
    expected = {"vn": [0.5, 0.25, 0.125], "vt": [0.5, 0.75]}[word]
    assert values[1::2].tolist() == [expected] * len(rows)


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
        (b"v 0 0 -1.x\nf 1 2 3\n", "'-1.x'"),
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
    assert len(read_mesh(data, Budgets(materials=11)).bodies[0].materials) == 12
    with pytest.raises(MeshmarkError) as caught:
        read_mesh(data, Budgets(materials=10))
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED
