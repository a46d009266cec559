import struct

import numpy as np
import pytest

from core.asset.budgets import Budgets
from core.asset.off import parse_header, read_off
from core.asset.polygons import PolygonMesh
from core.errors import ErrorCode, MeshmarkError

BODY = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def _read(text: str) -> PolygonMesh:
    return read_off(text.encode(), Budgets()).bodies[0]


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
    return read_off(
        prefix + b" BINARY\n" + struct.pack(">3i", len(vertices), count, 0) + words + faces, Budgets()
    ).bodies[0]


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


@pytest.mark.parametrize("faces", [struct.pack(">5i", 3, 0, 1, 2, 9), struct.pack(">4i", 3, 0, 1, 2), b"\xff" * 20])
def test_binary_faces_that_end_early_are_refused(faces: bytes) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _binary(b"OFF", [[0.0, 0, 0]] * 3, faces, 1)
    assert caught.value.code is ErrorCode.TRUNCATED_FILE
