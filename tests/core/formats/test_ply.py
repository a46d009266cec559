import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.assembly import Assembly
from core.formats.ply import check_ply, read_ply
from core.formats.ply_header import parse_header
from core.formats.polygons import PolygonMesh
from core.formats.source import Source
from core.gltf.document import Document
from tests.core.formats.samples import PLY_ASCII, ply_binary, png, zipped


def read(data: bytes, budgets: Budgets) -> Assembly:
    source = Source(data)
    return read_ply(source, check_ply(source, budgets), budgets)


XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"


def _read(data: bytes) -> PolygonMesh:
    return read(data, Budgets()).bodies[0]


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
        read(_strips("6 0 1 2 3 4 5\n"), Budgets(faces=3))
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED


@pytest.mark.parametrize("line", ["Created by Blender3D 2.45 - www.blender.org\n", "author me\n", "generator x y z\n"])
def test_a_header_line_of_an_unknown_word_is_skipped(line: str) -> None:
    data = _ascii(XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").replace(b"element face", line.encode() + b"element face")
    assert _read(data).corners.tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("kind", "rows", "colors"),
    [
        ("float", ["200 90 30", "255 0 0.5"], [[200 / 255, 90 / 255, 30 / 255], [1, 0, 0.5 / 255]]),
        ("float", ["0.5 0.25 0", "1 1 1"], [[0.5, 0.25, 0], [1, 1, 1]]),
        ("float", ["1.004 0.25 0", "1 -0.1 1"], [[1, 0.25, 0], [1, 0, 1]]),
        ("double", ["127.5 0 0", "0 0 0"], [[0.5, 0, 0], [0, 0, 0]]),
        ("uchar", ["255 51 0", "1 0 0"], [[1, 0.2, 0], [1 / 255, 0, 0]]),
        ("uchar", ["1 0 0", "0 0 0"], [[1 / 255, 0, 0], [0, 0, 0]]),
        ("char", ["-1 51 0", "0 0 0"], [[1, 0.2, 0], [0, 0, 0]]),
        ("ushort", ["65535 13107 0", "0 0 0"], [[1, 0.2, 0], [0, 0, 0]]),
        ("ushort", ["255 51 0", "0 0 0"], [[1, 0.2, 0], [0, 0, 0]]),
        ("int", ["255 51 0", "0 0 0"], [[1, 0.2, 0], [0, 0, 0]]),
        ("uint", ["65535 13107 0", "0 0 0"], [[1, 0.2, 0], [0, 0, 0]]),
    ],
)
def test_colours_of_any_type_are_fractions_of_what_they_go_up_to(kind: str, rows: list[str], colors: object) -> None:
    columns = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    body = "".join(f"{number} 0 {number * number} {rows[number % 2]}\n" for number in range(3))
    values = _read(_ascii(XYZ + columns, LIST, body + "3 0 1 2\n")).attributes["COLOR_0"].values
    np.testing.assert_allclose(values[:2, :3], np.array(colors))
    assert values[:, 3].tolist() == [1, 1, 1]


@pytest.mark.parametrize("kind", ["uchar", "char", "ushort", "int", "float"])
def test_a_colour_written_as_infinity_is_the_brightest_and_spoils_no_other(kind: str) -> None:
    columns = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    body = "0 0 0 1e999 -1e999 0\n1 0 0 255 51 0\n0 1 0 255 51 0\n"
    values = _read(_ascii(XYZ + columns, LIST, body + "3 0 1 2\n")).attributes["COLOR_0"].values
    np.testing.assert_allclose(values, [[1.0, 0, 0, 1], [1, 0.2, 0, 1], [1, 0.2, 0, 1]])


RED, BLUE = png(255, 0, 0), png(0, 0, 255)
UV = "property float s\nproperty float t\n"
WEDGES = LIST + "property list uchar float texcoord\n"
SQUARE = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n"
BARE_SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def _textured(
    *names: str, vertex: str = XYZ + UV, face: str = LIST, body: str = SQUARE + "4 0 1 2 3\n", faces: int = 1
) -> bytes:
    comments = "".join(f"comment TextureFile {name}\n" for name in names).encode("cp1252")
    return _ascii(vertex, face, body, 4, faces).replace(b"element vertex", comments + b"element vertex")


def _convert(data: bytes) -> Document:
    return document_of(admit(data))


def _textures(document: Document) -> list[bytes | None]:
    """The image of each primitive."""
    found: list[bytes | None] = []
    for primitive in document.json["meshes"][0]["primitives"]:
        surface = document.json["materials"][primitive["material"]]["pbrMetallicRoughness"]
        if "baseColorTexture" not in surface:
            found.append(None)
            continue
        assert "TEXCOORD_0" in primitive["attributes"]
        source = document.json["textures"][surface["baseColorTexture"]["index"]]["source"]
        view = document.json["bufferViews"][document.json["images"][source]["bufferView"]]
        found.append(document.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
    return found


@pytest.mark.parametrize("name", ["skin.png", "my skin #1.png", "h\u00fclle.png"])
@pytest.mark.parametrize(
    ("vertex", "face", "body"),
    [
        (XYZ + UV, LIST, SQUARE + "4 0 1 2 3\n"),
        (XYZ + UV.replace(" t", " texture_v").replace(" s", " texture_u"), LIST, SQUARE + "4 0 1 2 3\n"),
        (XYZ, WEDGES, BARE_SQUARE + "4 0 1 2 3 8 0 0 1 0 1 1 0 1\n"),
    ],
)
def test_the_texture_that_a_ply_names_is_drawn_where_the_archive_has_it(
    name: str, vertex: str, face: str, body: str
) -> None:
    data = _textured(name, vertex=vertex, face=face, body=body)
    document = _convert(zipped({"m/model.ply": data, f"m/{name}": RED, "preview.jpg": b"x"}))
    assert _textures(document) == [RED]
    assert document.warnings == []


@pytest.mark.parametrize("data", [_textured("skin.png"), zipped({"a.ply": _textured("skin.png"), "b.png": RED})])
def test_a_texture_that_is_not_in_the_upload_is_named(data: bytes) -> None:
    document = _convert(data)
    assert _textures(document) == [None]
    assert ["skin.png" in warning.message for warning in document.warnings] == [True]


def test_a_texture_without_texture_coordinates_is_named() -> None:
    data = _textured("skin.png", vertex=XYZ, body=BARE_SQUARE + "4 0 1 2 3\n")
    document = _convert(zipped({"a.ply": data, "skin.png": RED}))
    assert _textures(document) == [None]
    assert "'skin.png' is dropped" in document.warnings[0].message


def test_an_image_that_the_ply_does_not_name_is_not_used_and_said() -> None:
    document = _convert(zipped({"a.ply": _textured(), "skin.png": RED}))
    assert _textures(document) == [None]
    assert "'skin.png' beside it is not used" in document.warnings[0].message


def test_faces_may_have_several_textures_and_some_none() -> None:
    body = BARE_SQUARE + "3 0 1 2 6 0 0 1 0 1 1 0\n3 0 2 3 6 0 0 1 1 0 1 1\n3 3 2 1 0 0\n3 3 2 0 6 0 0 1 1 0 1 7\n"
    face = WEDGES + "property int texnumber\n"
    data = _textured("red.png", "blue.png", vertex=XYZ, face=face, body=body, faces=4)
    document = _convert(zipped({"a.ply": data, "red.png": RED, "blue.png": BLUE}))
    assert _textures(document) == [RED, BLUE, None, None]
    assert document.warnings == []


def test_a_texture_that_no_face_is_in_is_named() -> None:
    document = _convert(zipped({"a.ply": _textured("a.png", "b.png"), "a.png": RED, "b.png": BLUE}))
    assert _textures(document) == [RED]
    assert "'b.png'" in document.warnings[0].message


@pytest.mark.parametrize("name", ["nx", "s", "red", "alpha", "texture_u"])
def test_a_list_where_a_number_belongs_is_no_attribute(name: str) -> None:
    vertex = XYZ + f"property list uchar float {name}\n"
    mesh = _read(_ascii(vertex, LIST, "0 0 0 1 5\n1 0 0 0\n0 1 0 2 5 6\n3 0 1 2\n"))
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert not mesh.attributes


def test_a_number_where_a_list_belongs_is_no_texture_coordinate() -> None:
    mesh = _read(_ascii(XYZ, LIST + "property float texcoord\n", "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 9\n"))
    assert not mesh.attributes


_CORNERS = st.lists(st.integers(0, 3), min_size=0, max_size=5)


@given(
    faces=st.lists(st.tuples(_CORNERS, st.booleans(), st.integers(0, 255)), min_size=1, max_size=9),
    order=st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]),
    count=st.sampled_from([("uchar", "B"), ("int", "i"), ("ushort", "H"), ("float", "f")]),
)
def test_lists_of_any_lengths_are_read_alike_in_every_layout(
    faces: list[tuple[list[int], bool, int]], order: str, count: tuple[str, str]
) -> None:
    name, kind = count
    header = (
        f"ply\nformat {order} 1.0\nelement vertex 4\n{XYZ}element face {len(faces)}\nproperty uchar flags\n"
        f"property list {name} int vertex_indices\nproperty list uchar float texcoord\nproperty uchar red\n"
        "property uchar green\nproperty uchar blue\nend_header\n"
    ).encode()
    rows = [(flag, corners, [0.5, 0.25] * len(corners) if mapped else []) for corners, mapped, flag in faces]
    if order == "ascii":
        body = (
            BARE_SQUARE
            + "".join(
                " ".join(map(str, [flag, len(corners), *corners, len(uv), *uv, flag, 0, 0])) + "\n"
                for flag, corners, uv in rows
            )
        ).encode()
    else:
        mark = "<" if "little" in order else ">"
        body = struct.pack(f"{mark}12f", *map(float, BARE_SQUARE.split()))
        for flag, corners, uv in rows:
            layout = f"{mark}B{kind}{len(corners)}iB{len(uv)}f3B"
            body += struct.pack(layout, flag, len(corners), *corners, len(uv), *uv, flag, 0, 0)
    mesh = _read(header + body)
    assert mesh.sizes.tolist() == [len(corners) for _, corners, _ in rows]
    assert mesh.corners.tolist() == [corner for _, corners, _ in rows for corner in corners]
    mapped = [bool(uv) for _, corners, uv in rows for _ in corners]
    assert (mesh.attributes["TEXCOORD_0"].index >= 0).tolist() == mapped
    red = mesh.attributes["COLOR_0"]
    assert (red.values[red.index, 0] * 255).round().tolist() == [flag for flag, corners, _ in rows for _ in corners]
