import struct

import numpy as np
import pytest

from core.asset.budgets import Budgets
from core.asset.ply import parse_header, read_ply
from core.asset.polygons import PolygonMesh
from core.errors import ErrorCode, MeshmarkError
from tests.core.asset.samples import PLY_ASCII, ply_binary

XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"


def _read(data: bytes) -> PolygonMesh:
    return read_ply(data, Budgets()).bodies[0]


def _ascii(vertex: str, face: str, body: str, vertices: int = 3, faces: int = 1) -> bytes:
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertices}\n{vertex}element face {faces}\n{face}end_header\n{body}"
    ).encode()


@pytest.mark.parametrize("data", [ply_binary("<"), ply_binary(">"), PLY_ASCII.replace(b"\n", b"\r\n")])
def test_text_and_both_byte_orders_agree_on_quads_and_triangles(data: bytes) -> None:
    expected, mesh = _read(PLY_ASCII), _read(data)
    assert mesh.sizes.tolist() == [4, 4, 4, 4, 4, 3, 3]
    np.testing.assert_array_equal(mesh.corners, expected.corners)
    np.testing.assert_array_equal(mesh.positions, expected.positions)
    np.testing.assert_array_equal(mesh.attributes["COLOR_0"].values, expected.attributes["COLOR_0"].values)
    np.testing.assert_allclose(mesh.attributes["COLOR_0"].values[0], [1, 128 / 255, 0, 1])


def test_normals_texture_coordinates_and_unknown_columns_are_told_apart() -> None:
    columns = "property float quality\nproperty float nx\nproperty float ny\nproperty float nz\n"
    columns += "property double s\nproperty double t\n"
    mesh = _read(_ascii(XYZ + columns, LIST, "0 0 0 9 0 0 1 0.5 0.25\n1 0 0 9 0 0 1 0 0\n0 1 0 9 0 0 1 0 0\n3 0 1 2\n"))
    assert mesh.attributes["NORMAL"].values.tolist() == [[0, 0, 1]] * 3
    assert mesh.attributes["TEXCOORD_0"].values[0].tolist() == [0.5, 0.75]
    assert set(mesh.attributes) == {"NORMAL", "TEXCOORD_0"}


def test_texture_coordinates_of_corners_are_read() -> None:
    face = LIST + "property list uchar float texcoord\n"
    body = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2 6 0 0 1 0 0 1\n3 1 3 2 6 1 0 1 1 0 1\n"
    uv = _read(_ascii(XYZ, face, body, vertices=4, faces=2)).attributes["TEXCOORD_0"]
    assert uv.values[uv.index].tolist() == [[0, 1], [1, 1], [0, 0], [1, 1], [1, 0], [0, 0]]
    assert uv.index[1] == uv.index[3]


def test_face_colours_serve_where_vertices_have_none() -> None:
    face = LIST + "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    colors = _read(_ascii(XYZ, face, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n")).attributes["COLOR_0"]
    assert colors.values[colors.index].tolist() == [[1, 0, 0, 1]] * 3


def test_elements_between_and_behind_are_skipped() -> None:
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment x\nobj_info y\nelement face 1\n"
        f"property uchar flags\n{LIST}element edge 2\nproperty list ushort short parts\nelement vertex 3\n{XYZ}"
        "element extra 1\nproperty int n\nend_header\n"
    )
    body = struct.pack("<BB3i", 7, 3, 0, 1, 2) + struct.pack("<H2hH", 2, 5, 5, 0)
    body += struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<i", 1)
    mesh = _read(header.encode() + body)
    assert mesh.corners.tolist() == [0, 1, 2]
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("data", [ply_binary("<")[:-1], ply_binary(">")[:-30], PLY_ASCII[:-4]])
def test_a_body_that_ends_early_is_truncated(data: bytes) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _read(data)
    assert caught.value.code is ErrorCode.TRUNCATED_FILE


@pytest.mark.parametrize(
    "body",
    [
        "0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n",
        "0 0 0\n1 0 0\n0 1 0\n2.5 0 1 2\n",
        "0 0 0\n1 0 0\n0 1 0\nnan 0 1 2\n",
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n",
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 nan\n",
        "0 0 zero\n1 0 0\n0 1 0\n3 0 1 2\n",
    ],
)
def test_lists_that_make_no_sense_are_malformed(body: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        _read(_ascii(XYZ, LIST, body))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_the_header_is_the_table_of_contents() -> None:
    header = parse_header(PLY_ASCII)
    assert [(element.name, element.count) for element in header.elements] == [("vertex", 8), ("face", 7)]
    assert PLY_ASCII[header.end :].startswith(b"-1 -1 -1 255")
    assert header.element("edge") is None


def _strips(body: str, rows: int = 1, order: str = "ascii") -> bytes:
    header = f"element tristrips {rows}\nproperty list int int vertex_indices\n"
    points = "".join(f"{number} 0 0\n" for number in range(6))
    return f"ply\nformat {order} 1.0\nelement vertex 6\n{XYZ}{header}end_header\n{points}{body}".encode()


def test_triangle_strips_turn_every_second_triangle_and_restart_at_minus_one() -> None:
    mesh = _read(_strips("9 0 1 2 3 4 -1 3 4 5\n3 5 4 3\n", rows=2))
    assert mesh.corners.reshape(-1, 3).tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [3, 4, 5], [5, 4, 3]]
    assert mesh.sizes.tolist() == [3] * 5


def test_triangles_that_only_stitch_strips_together_are_left_out() -> None:
    mesh = _read(_strips("8 0 1 2 2 3 3 4 5\n"))
    assert len(mesh.sizes) == 2
    assert all(len(set(triangle)) == 3 for triangle in mesh.corners.reshape(-1, 3).tolist())


def test_strips_over_the_budget_of_triangles_are_refused() -> None:
    with pytest.raises(MeshmarkError) as caught:
        read_ply(_strips("6 0 1 2 3 4 5\n"), Budgets(faces=3))
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED
