"""The formats without culling: what comes out must look out, and carry its attributes along."""

import struct
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from core.arrays import Float, Int
from core.formats.admission import admit, document_of
from core.formats.assemble import assemble
from core.formats.assembly import Assembly, Instance
from core.formats.polygons import Attribute, PolygonMesh
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.formats.samples import dae, threemf_model, zipped
from tests.core.gltf.builder import CUBE, CUBE_FACES
from tests.validator import error_counts

CORNERS = np.array(CUBE_FACES).reshape(-1, 3)
POINTS = np.array(CUBE, float)


def _obj(faces: Int) -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in POINTS] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    return "\n".join(lines).encode()


def _stl(faces: Int) -> bytes:
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *POINTS[face].ravel(), 0) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + records


def _ply(faces: Int) -> bytes:
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in POINTS] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return (header + "\n".join(rows) + "\n").encode()


def _off(faces: Int) -> bytes:
    rows = [f"{x} {y} {z}" for x, y, z in POINTS] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return (f"OFF\n8 {len(faces)} 0\n" + "\n".join(rows) + "\n").encode()


def _threemf_object(faces: Int) -> str:
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in POINTS)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    return f'<object id="1">{mesh}</object>'


def _threemf(faces: Int, transform: str = "1 0 0 0 1 0 0 0 1 0 0 0") -> bytes:
    model = threemf_model(_threemf_object(faces), f'<item objectid="1" transform="{transform}"/>')
    return zipped({"3D/3dmodel.model": model})


def _dae(faces: Int, node: str = "") -> bytes:
    text = dae(f'<node>{node}<instance_geometry url="#g"/></node>').decode()
    before, _, rest = text.partition("<p>")
    corners = " ".join(f"{corner} {number % 3}" for number, corner in enumerate(faces.ravel()))
    return (
        (before + "<p>" + corners + rest[rest.index("</p>") :]).replace('count="12"', f'count="{len(faces)}"').encode()
    )


FORMATS = [_obj, _stl, _ply, _off, _threemf, _dae]


def _volume(document: Document) -> float:
    surface = flatten(document).surface
    a, b, c = (surface.positions[surface.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6


def _double_sided(document: Document) -> set[bool]:
    return {material["doubleSided"] for material in document.json["materials"]}


@pytest.mark.parametrize("write", FORMATS)
@pytest.mark.parametrize("which", [slice(0), slice(None), slice(0, 5), slice(1, None, 2)])
def test_a_cube_looks_out_however_the_file_winds_its_faces(write: Any, which: slice) -> None:
    faces = CORNERS.copy()
    faces[which] = faces[which][:, ::-1]
    data = write(faces)
    document = document_of(admit(data))
    assert _double_sided(document) == {False}
    assert _volume(document) == pytest.approx(30**3)
    assert not error_counts(document.to_glb())


@pytest.mark.parametrize("write", FORMATS)
def test_an_open_box_is_double_sided_and_keeps_its_winding(write: Any) -> None:
    data = write(CORNERS[2:, ::-1])
    document = document_of(admit(data))
    assert _double_sided(document) == {True}
    assert _volume(document) < 0


MIRROR = "-1 0 0 0 1 0 0 0 1 7 0 0"
SHEAR = "1 0 0 0.5 1 0 0 0 1 0 3 0"
BOTH = "-1 0 0 0.5 1 0 0.25 0 1 0 3 0"


@pytest.mark.parametrize("transform", [MIRROR, SHEAR, BOTH])
@pytest.mark.parametrize("closed", [True, False])
def test_mirrored_and_sheared_parts_look_the_way_they_did(transform: str, closed: bool) -> None:
    matrix = np.array(transform.split(), float).reshape(4, 3)
    node = "<matrix>" + " ".join(map(str, np.vstack([matrix.T, [0, 0, 0, 1]]).ravel())) + "</matrix>"
    faces = CORNERS if closed else CORNERS[:-1]
    for data in (_threemf(faces, transform), _dae(faces, node)):
        document = document_of(admit(data))
        assert _volume(document) > 0
        assert _double_sided(document) == {not closed}


def _corner_values(document: Document, name: str) -> tuple[Float, Float]:
    """(T, 3, 3) positions and (T, 3, n) values of a document's only primitive."""
    primitive = document.json["meshes"][0]["primitives"][0]
    rows = read_accessor(document, primitive["indices"]).astype(int).reshape(-1, 3)
    attributes = primitive["attributes"]
    positions, values = (read_accessor(document, attributes[key]).astype(float) for key in ("POSITION", name))
    return positions[rows], values[rows]


def _flat_cube(faces: Int, normals_follow: bool) -> PolygonMesh:
    """A cube with flat normals that look out, or the way the faces are wound, and a UV of its own for each corner."""
    a, b, c = (POINTS[faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a) / 4
    outside = np.sign(np.einsum("ni,ni->n", normals, a))[:, None]
    corner = np.arange(faces.size)
    uv = np.column_stack([POINTS[faces.ravel()] @ [0.1, 0.2, 0.3], np.repeat(np.arange(len(faces)), 3) / 16])
    attributes = {
        "NORMAL": Attribute(normals if normals_follow else normals * outside, corner // 3),
        "TEXCOORD_0": Attribute(uv, corner),
    }
    count = len(faces)
    return PolygonMesh(POINTS, faces.ravel(), np.full(count, 3), np.zeros(count, np.int64), attributes)


@given(
    which=st.lists(st.booleans(), min_size=12, max_size=12),
    normals_follow=st.booleans(),
    mirrored=st.booleans(),
    sheared=st.booleans(),
)
def test_normals_and_texture_coordinates_follow_the_faces_that_are_turned(
    which: list[bool], normals_follow: bool, mirrored: bool, sheared: bool
) -> None:
    faces = np.where(np.array(which)[:, None], CORNERS[:, ::-1], CORNERS)
    matrix = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
    matrix[0, 1] = 0.5 if sheared else 0.0
    body = _flat_cube(faces, normals_follow)
    document = assemble(Assembly([body], ["cube"], [Instance("cube", 0, matrix)]))
    baked = matrix if sheared else np.eye(4)
    positions, normals = _corner_values(document, "NORMAL")
    facing = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
    assert np.all(np.einsum("ni,nki->nk", facing, normals) > 0.99 * np.linalg.norm(facing, axis=1)[:, None])
    assert np.all(np.einsum("ni,ni->n", facing, positions.mean(axis=1)) > 0)
    positions, uv = _corner_values(document, "TEXCOORD_0")
    np.testing.assert_allclose(uv[..., 0], positions @ np.linalg.inv(baked)[:3, :3].T @ [0.1, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(np.ptp(uv[..., 1], axis=1), 0)


def test_smooth_normals_of_an_inverted_ball_are_turned_with_it_but_right_ones_stay() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    positions, faces = np.asarray(ball.vertices, float), np.asarray(ball.faces, np.int64)[:, ::-1]
    count = len(faces)
    for normals in (-positions, positions):
        body = PolygonMesh(
            positions,
            faces.ravel(),
            np.full(count, 3),
            np.zeros(count, np.int64),
            {"NORMAL": Attribute(normals, faces.ravel())},
        )
        document = assemble(Assembly([body], ["ball"], [Instance("ball", 0)]))
        at, stored = _corner_values(document, "NORMAL")
        assert np.all(np.einsum("nki,nki->nk", at, stored) > 0.99)
        primitive = document.json["meshes"][0]["primitives"][0]
        assert document.json["accessors"][primitive["attributes"]["POSITION"]]["count"] == len(positions)


@pytest.mark.parametrize("normals_follow", [True, False])
def test_the_front_of_an_open_part_is_where_its_normals_look(normals_follow: bool) -> None:
    body = _flat_cube(CORNERS[2:, ::-1], normals_follow)
    document = assemble(Assembly([body], ["cube"], [Instance("cube", 0)]))
    positions, normals = _corner_values(document, "NORMAL")
    facing = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
    assert np.all(np.einsum("ni,nki->nk", facing, normals) > 0)
    assert np.all((np.einsum("nki,nki->nk", positions, normals) > 0) == (not normals_follow))
    assert _double_sided(document) == {True}


def test_corners_without_a_normal_stay_without_one() -> None:
    body = _flat_cube(CORNERS[:, ::-1], normals_follow=True)
    index = body.attributes["NORMAL"].index.copy()
    index[:9] = -1
    body.attributes["NORMAL"] = Attribute(body.attributes["NORMAL"].values, index)
    document = assemble(Assembly([body], ["cube"], [Instance("cube", 0)]))
    primitives = document.json["meshes"][0]["primitives"]
    counts = {
        "NORMAL" in entry["attributes"]: document.json["accessors"][entry["indices"]]["count"] for entry in primitives
    }
    assert counts == {False: 9, True: 27}
    assert _volume(document) > 0
