import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.assembly import Assembly
from core.formats.off import check_off, parse_header, read_off
from core.formats.polygons import PolygonMesh
from core.formats.source import Source


def read(data: bytes, budgets: Budgets) -> Assembly:
    source = Source(data)
    return read_off(source, check_off(source, budgets), budgets)


BODY = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def _read(text: str) -> PolygonMesh:
    return read(text.encode(), Budgets()).bodies[0]


@pytest.mark.parametrize(
    "text",
    [
        f"OFF\n4 1 0\n{BODY}4 0 1 2 3\n",
        f"OFF 4 1 4\n{BODY}4 0 1 2 3",
        f"# made by hand\nOFF # comment\n\n# counts\n4 1 0 # too\n\n{BODY}\n# faces\n4 0 1 2 3 # the square\n# end",
        f"OFF\n4 1\n{BODY}4  0\t1 2 3\n".replace("\n", "\r\n"),
    ],
)
def test_comments_blank_lines_and_counts_on_the_first_line_are_read(text: str) -> None:
    mesh = _read(text)
    np.testing.assert_array_equal(mesh.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mesh.corners.tolist() == [0, 1, 2, 3]
    assert mesh.sizes.tolist() == [4]
    assert not mesh.attributes


def test_face_colours_are_read_where_there_are_any() -> None:
    mesh = _read(f"OFF\n4 3 0\n{BODY}3 0 1 2 255 0 51\n3 0 2 3\n3 0 1 2 0 0 0 102\n")
    colors = mesh.attributes["COLOR_0"]
    assert colors.index.tolist() == [0, 0, 0, -1, -1, -1, 2, 2, 2]
    np.testing.assert_allclose(colors.values[[0, 2]], [[1, 0, 0.2, 1], [0, 0, 0, 0.4]])


@pytest.mark.parametrize(
    ("header", "row", "names"),
    [
        ("NOFF", "0 0 1", {"NORMAL"}),
        ("COFF", "255 0 0 255", {"COLOR_0"}),
        ("COFF", "1.0 0 0", {"COLOR_0"}),
        ("STOFF", "0.5 0.25", {"TEXCOORD_0"}),
        ("STCNOFF", "0 0 1 1 0 0 1 0.5 0.25", {"NORMAL", "COLOR_0", "TEXCOORD_0"}),
    ],
)
def test_vertex_columns_follow_the_prefix(header: str, row: str, names: set[str]) -> None:
    mesh = _read(f"{header}\n4 1 0\n" + BODY.replace("\n", f" {row}\n") + "4 0 1 2 3\n")
    first = {name: attribute.values[attribute.index[0]].tolist() for name, attribute in mesh.attributes.items()}
    expected = {"NORMAL": [0, 0, 1], "COLOR_0": [1, 0, 0, 1], "TEXCOORD_0": [0.5, 0.75]}
    assert first == {name: expected[name] for name in names}


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (f"OFF\n4 2 0\n{BODY}4 0 1 2 3\n", ErrorCode.TRUNCATED_FILE),
        (f"OFF\n4 1 0\n{BODY}4 0 1 2\n", ErrorCode.MALFORMED_FILE),
        (f"OFF\n4 1 0\n{BODY}2.5 0 1 2\n", ErrorCode.MALFORMED_FILE),
        (f"OFF\n4 1 0\n{BODY}3 0 1 1.5\n", ErrorCode.MALFORMED_FILE),
        (f"OFF\n4 1 0\n{BODY}3 0 1 two\n", ErrorCode.MALFORMED_FILE),
        (f"OFF\n4 1 0\n{BODY.replace('1 1 0', '1 1')}3 0 1 2\n", ErrorCode.MALFORMED_FILE),
        (f"NOFF\n4 1 0\n{BODY}3 0 1 2\n", ErrorCode.MALFORMED_FILE),
    ],
)
def test_lines_that_do_not_hold_what_is_declared_are_refused(text: str, code: ErrorCode) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _read(text)
    assert caught.value.code is code


def test_the_header_tells_its_columns_and_counts() -> None:
    header = parse_header(b"STCNOFF\n10 20 30\n")
    assert (header.prefix, header.vertices, header.faces) == ("STCN", 10, 20)


@pytest.mark.parametrize(
    "body",
    [
        "0 0 0 1 0 0 1 1 0 0 1 0 4 0 1 2 3 3 2 1 0\n",
        "0 0 0 1 0 0\n1 1 0 0 1 0\n4 0 1 2 3 3\n2 1 0",
        "\n".join(
            ["0", "0", "0", "1", "0", "0", "1", "1", "0", "0", "1", "0", "4", "0", "1", "2", "3", "3", "2", "1", "0"]
        ),
    ],
)
def test_numbers_may_run_on_without_regard_to_lines(body: str) -> None:
    mesh = _read(f"OFF\n4 2 0\n{body}")
    np.testing.assert_array_equal(mesh.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mesh.corners.tolist() == [0, 1, 2, 3, 2, 1, 0]
    assert mesh.sizes.tolist() == [4, 3]


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("0 0 0 1 0 0 1 1 0 0 1 0 4 0 1 2", ErrorCode.TRUNCATED_FILE),
        ("0 0 0 1 0 0 1 1 0", ErrorCode.TRUNCATED_FILE),
        ("0 0 0 1 0 0 1 1 0 0 1 0 3 0 1 2 0.5 0.5 0.5", ErrorCode.MALFORMED_FILE),
        ("0 0 0 1 0 0 1 1 0 0 1 0 -3 0 1 2", ErrorCode.TRUNCATED_FILE),
        ("0 0 0 1 0 0 1 1 0 0 1 0 3.5 0 1 2 0", ErrorCode.MALFORMED_FILE),
    ],
)
def test_numbers_that_run_on_and_do_not_hold_what_is_declared_are_refused(body: str, code: ErrorCode) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _read(f"OFF\n4 1 0\n{body}")
    assert caught.value.code is code


def _binary(prefix: bytes, vertices: list[list[float]], faces: bytes, count: int) -> PolygonMesh:
    words = b"".join(struct.pack(f">{len(row)}f", *row) for row in vertices)
    return read(prefix + b" BINARY\n" + struct.pack(">3i", len(vertices), count, 0) + words + faces, Budgets()).bodies[
        0
    ]


def test_binary_files_have_polygons_of_any_size_with_colours() -> None:
    square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    faces = struct.pack(">6i", 4, 0, 1, 2, 3, 0) + struct.pack(">5i3f", 3, 2, 1, 0, 3, 1.0, 0.5, 0.0)
    mesh = _binary(b"OFF", square, faces, 2)
    assert mesh.positions.tolist() == square
    assert mesh.corners.tolist() == [0, 1, 2, 3, 2, 1, 0]
    colors = mesh.attributes["COLOR_0"]
    assert colors.index.tolist() == [-1, -1, -1, -1, 1, 1, 1]
    assert colors.values[1].tolist() == [1, 0.5, 0, 1]


def test_binary_vertices_have_the_columns_of_the_prefix() -> None:
    rows = [[x, 0.0, 0.0, 1.0, 0.0, 0.5, 1.0] for x in (0.0, 1.0, 2.0)]
    mesh = _binary(b"COFF", rows, struct.pack(">5i", 3, 0, 1, 2, 0), 1)
    assert mesh.attributes["COLOR_0"].values.tolist() == [[1, 0, 0.5, 1]] * 3


@pytest.mark.parametrize("faces", [struct.pack(">5i", 3, 0, 1, 2, 9), struct.pack(">3i", 3, 0, 1), b"\xff" * 20])
def test_binary_faces_that_end_early_are_refused(faces: bytes) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _binary(b"OFF", [[0.0, 0, 0]] * 3, faces, 1)
    assert caught.value.code is ErrorCode.TRUNCATED_FILE


_FACES = st.lists(st.lists(st.integers(0, 3), min_size=1, max_size=6), min_size=1, max_size=8)
_COLORS = st.lists(st.sampled_from([[], [1.0, 0.5, 0.0], [0.0, 0.25, 1.0, 0.5]]), min_size=8, max_size=8)
SQUARE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


def _words(order: str, faces: list[list[int]], colors: list[list[float]] | None) -> bytes:
    """A binary OFF of the square's corners; without ``colors`` faces have no number of components either."""
    data = (
        b"OFF BINARY\n"
        + struct.pack(f"{order}3I", 4, len(faces), 0)
        + struct.pack(f"{order}12f", *(value for point in SQUARE for value in point))
    )
    for number, face in enumerate(faces):
        data += struct.pack(f"{order}{1 + len(face)}I", len(face), *face)
        if colors is not None:
            color = colors[number]
            data += struct.pack(f"{order}I{len(color)}f", len(color), *color)
    return data


@given(order=st.sampled_from("<>"), faces=_FACES, colors=st.one_of(st.none(), _COLORS))
def test_binary_files_of_either_byte_order_with_and_without_colours_are_told_apart(
    order: str, faces: list[list[int]], colors: list[list[float]] | None
) -> None:
    data = _words(order, faces, colors)
    admit(data)
    mesh = read(data, Budgets()).bodies[0]
    assert mesh.positions.tolist() == SQUARE
    assert mesh.sizes.tolist() == [len(face) for face in faces]
    assert mesh.corners.tolist() == [corner for face in faces for corner in face]
    painted = [bool(color) for color in (colors or [])[: len(faces)]]
    if any(painted):
        index = mesh.attributes["COLOR_0"].index
        assert (index >= 0).tolist() == np.repeat(painted, mesh.sizes).tolist()
    else:
        assert not mesh.attributes


def test_a_signalling_nan_is_refused_as_any_other() -> None:
    data = _words("<", [[0, 1, 2], [0, 2, 3]], [[], [0.5, 0.25, 0.125]])
    nan = struct.pack("<I", 0x7FA00000)
    painted = data.replace(struct.pack("<f", 0.25), nan)
    colored = document_of(admit(painted))
    assert "COLOR_0" not in colored.json["meshes"][0]["primitives"][0]["attributes"]
    placed = data.replace(struct.pack("<f", 1), nan, 1)
    with pytest.raises(MeshmarkError) as caught:
        document_of(admit(placed))
    assert caught.value.code is ErrorCode.NON_FINITE_POSITIONS


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_binary_file_that_is_cut_off_is_called_so_with_its_own_counts(order: str) -> None:
    data = _words(order, [[0, 1, 2], [0, 2, 3]], None)
    for cut in (data[:-4], data[:-40]):
        with pytest.raises(MeshmarkError, match="4 vertices and 2 faces") as caught:
            document_of(admit(cut))
        assert caught.value.code is ErrorCode.TRUNCATED_FILE


def test_a_binary_header_that_fits_in_no_byte_order_is_read_in_the_likelier_one() -> None:
    header = parse_header(b"OFF BINARY\n" + struct.pack("<3I", 5000, 9000, 0) + bytes(100))
    assert (header.vertices, header.faces) == (5000, 9000)


@pytest.mark.parametrize(
    ("rows", "colors"),
    [
        (["0.9 0.5 0 1", "1.00391 0.5 0 1"], [[0.9, 0.5, 0, 1], [1, 0.5, 0, 1]]),
        (["255 102 0 255", "0 0 0 51"], [[1, 0.4, 0, 1], [0, 0, 0, 0.2]]),
        (["255 102 0 1", "0 0 0 1"], [[1, 0.4, 0, 1], [0, 0, 0, 1]]),
        (["200.5 0 0 1", "1 1 1 1"], [[200.5 / 255, 0, 0, 1], [1 / 255, 1 / 255, 1 / 255, 1]]),
    ],
)
def test_colours_of_any_range_are_fractions_of_what_they_plainly_go_up_to(rows: list[str], colors: object) -> None:
    vertices = "".join(f"{number} 0 {number * number} {rows[number % 2]}\n" for number in range(4))
    mesh = _read(f"COFF\n4 1 0\n{vertices}4 0 1 2 3\n")
    np.testing.assert_allclose(mesh.attributes["COLOR_0"].values[:2], np.array(colors))
    faces = "".join(f"3 0 1 {2 + number} {row}\n" for number, row in enumerate(rows))
    mesh = _read(f"OFF\n4 2 0\n{BODY}{faces}")
    np.testing.assert_allclose(mesh.attributes["COLOR_0"].values, np.array(colors))


@given(st.lists(st.one_of(st.integers(-2, 9), st.floats(width=32)), max_size=30), st.integers(0, 4), st.integers(0, 4))
def test_any_numbers_behind_a_header_are_read_or_refused(numbers: list[float], vertices: int, faces: int) -> None:
    text = f"OFF {vertices} {faces} 0\n{' '.join(map(str, numbers))}".encode()
    words = b"".join(struct.pack("<i" if isinstance(number, int) else "<f", number) for number in numbers)
    for data in (text, b"OFF BINARY\n" + struct.pack("<3I", vertices, faces, 0) + words):
        with contextlib.suppress(MeshmarkError):
            admit(data)
            mesh = read(data, Budgets()).bodies[0]
            assert len(mesh.positions) == vertices
            assert len(mesh.sizes) == faces
