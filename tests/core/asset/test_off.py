import numpy as np
import pytest

from core.asset.budgets import Budgets
from core.asset.off import parse_header, read_off
from core.asset.polygons import PolygonMesh
from core.errors import ErrorCode, MeshmarkError

BODY = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def _read(text: str) -> PolygonMesh:
    return read_off(text.encode(), Budgets())


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
