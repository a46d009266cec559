import base64
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import Scene, flatten, scene_of
from core.gltf.write import write
from tests.core.formats.meshes import real_glbs
from tests.core.gltf.builder import CUBE, CUBE_FACES, QUAD, QUAD_FACES, Builder, grid, simple
from tests.core.gltf.edited import NORMALS, UV, edited, indices, primitives_of, quad, values
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

SURFACE, CAP, WALL = Kind.SURFACE, Kind.CAP, Kind.WALL
LIT: dict[str, Any] = {"emissiveFactor": [0.1, 0.1, 0.1]}  # vertex colours would not change what it gives off
pytestmark = pytest.mark.usefixtures("in_file_order")


def test_old_rows_stay_and_new_rows_follow_them() -> None:
    result = edited(quad(NORMAL=(NORMALS, "<f4", False), TEXCOORD_0=(UV, "<f4", False)), [1], [SURFACE])
    np.testing.assert_array_equal(values(result, "POSITION")[:4], QUAD)
    np.testing.assert_allclose(values(result, "POSITION")[4:], [[1 / 3, 2 / 3, 0]], atol=1e-7)
    np.testing.assert_allclose(values(result, "TEXCOORD_0")[4:], [[1 / 3, 2 / 3]], atol=1e-7)
    np.testing.assert_allclose(values(result, "NORMAL"), [[0, 0, 1]] * 5)
    assert indices(result).tolist() == [[0, 1, 2], [0, 2, 4], [2, 3, 4], [3, 0, 4]]


@pytest.mark.parametrize(("kind", "lift"), [(SURFACE, 0.0), (CAP, 9.0)])
def test_a_second_uv_set_is_linear_on_the_cut_surface_and_stays_that_of_the_foot_on_letters(
    kind: Kind, lift: float
) -> None:
    to_uv = np.array([[0.5, -0.25], [0.125, 0.75], [3.0, 5.0]])  # affine in the position, height included
    second = np.array(QUAD) @ to_uv + 0.1
    document = quad(TEXCOORD_0=(UV, "<f4", False), TEXCOORD_1=(second, "<f4", False))
    result = edited(document, [0, 1], [kind, kind], lift=lift)
    positions = values(result, "POSITION")
    foot = positions * (1, 1, 0)  # QUAD lies in the plane z = 0
    assert (positions[4:, 2] > 0).all() == (kind is CAP)
    assert len(positions) == 6
    np.testing.assert_allclose(values(result, "TEXCOORD_1"), foot @ to_uv + 0.1, atol=1e-6)


def test_an_edit_of_nothing_changes_nothing() -> None:
    document = quad()
    scene = flatten(document)
    assert write(scene, centroid_split(scene, [], []), [Style("#ff0000")]) == document.to_glb()


def test_the_same_edit_gives_the_same_bytes() -> None:
    scene = flatten(quad(NORMAL=(NORMALS, "<f4", False)))
    edit = centroid_split(scene, [0, 1], [CAP, WALL], 0.3)
    assert write(scene, edit, [Style("#123456")]) == write(scene, edit, [Style("#123456")])


def test_untouched_primitives_nodes_and_unknown_properties_stay_as_they_are() -> None:
    builder = Builder()
    primitives = [builder.primitive(QUAD, QUAD_FACES), builder.primitive(np.add(QUAD, 3), QUAD_FACES)]
    document = builder.document(
        meshes=[{"name": "m", "primitives": primitives, "extras": {"a": 1}}], extras={"custom": [1, None, "x"]}
    )
    result = edited(document, [2], [SURFACE])
    assert primitives_of(result)[0] == primitives[0]
    for key in ("asset", "nodes", "scenes", "extras"):
        assert result.json[key] == document.json[key]
    assert result.json["meshes"][0]["extras"] == {"a": 1}
    assert list(result.json) == list(document.json)


@pytest.mark.parametrize(("side", "before", "after"), [(254, "<u2", "<u2"), (255, "<u4", "<u4"), (254, "<u4", "<u2")])
def test_indices_take_two_bytes_where_these_suffice(side: int, before: str, after: str) -> None:
    builder = Builder()
    positions, faces = grid(side)
    primitive = builder.primitive(positions, None) | {"indices": builder.accessor(faces.reshape(-1), before)}
    result = edited(builder.document(meshes=[{"primitives": [primitive]}]), [7], [SURFACE])
    assert indices(result).dtype == np.dtype(after)


@pytest.mark.parametrize(("count", "before", "after"), [(255, "u1", "<u2"), (65535, "<u2", "<u4"), (252, "u1", "<u2")])
def test_indices_widen_where_the_new_rows_no_longer_fit(count: int, before: str, after: str) -> None:
    builder = Builder()
    positions = np.random.default_rng(0).random((count, 3))
    primitive = builder.primitive(positions, None) | {
        "indices": builder.accessor(np.arange(count // 3 * 3) % count, before)
    }
    result = edited(builder.document(meshes=[{"primitives": [primitive]}]), [0], [SURFACE])
    assert indices(result).dtype == np.dtype(after)
    assert indices(result).max() == count


def test_a_primitive_without_indices_gets_some() -> None:
    result = edited(simple([*QUAD[:3], *QUAD[:1], *QUAD[2:]], None), [1], [SURFACE])
    assert indices(result).tolist() == [[0, 1, 2], [3, 4, 6], [4, 5, 6], [5, 3, 6]]


def test_a_strip_becomes_a_triangle_list() -> None:
    document = simple(QUAD, [0, 1, 3, 2])
    primitives_of(document)[0]["mode"] = 5
    result = edited(document, [1], [SURFACE])
    assert primitives_of(result)[0]["mode"] == 4
    assert indices(result).tolist() == [[0, 1, 3], [1, 2, 4], [2, 3, 4], [3, 1, 4]]


def test_a_seam_gives_one_point_several_rows_at_one_position() -> None:
    """Two faces with different UVs, whose new points on the common edge have the same id."""
    builder = Builder()
    positions: list[list[float]] = [[0.1, 0, 0], [1, 0, 0], [1, 1, 0.7], [0.1, 0, 0], [1, 1, 0.7], [0, 1, 0]]
    uv = builder.accessor([[0, 0], [1, 0], [1, 1], [5, 5], [6, 6], [5, 6]])
    document = builder.document(meshes=[{"primitives": [builder.primitive(positions, range(6), TEXCOORD_0=uv)]}])
    scene = flatten(document)
    edit = centroid_split(scene, [0, 1], [SURFACE, SURFACE])
    middle = scene.surface.positions[[0, 2]].mean(axis=0)
    edit.vertex[:, 2], edit.position[:, 2] = 99, middle
    edit.barycentric[:3, 2], edit.barycentric[3:, 2] = [0.5, 0, 0.5], [0.5, 0.5, 0]

    result = Document.from_glb(write(scene, edit, [Style()]))

    rows = values(result, "POSITION")
    np.testing.assert_array_equal(rows[6], rows[7])
    assert len(rows) == 8
    np.testing.assert_allclose(values(result, "TEXCOORD_0")[6:], [[0.5, 0.5], [5.5, 5.5]])


def test_walls_are_flat_shaded_on_rows_of_their_own() -> None:
    document = quad(NORMAL=(NORMALS, "<f4", False))
    result = edited(document, [0, 1], [SURFACE, WALL], lift=20.0)
    normals, positions, faces = values(result, "NORMAL"), values(result, "POSITION"), indices(result)
    walls = faces[3:]
    assert not set(walls.reshape(-1)) & set(faces[:3].reshape(-1))
    cross = np.cross(positions[walls[:, 1]] - positions[walls[:, 0]], positions[walls[:, 2]] - positions[walls[:, 0]])
    flat = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[walls], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)
    np.testing.assert_array_equal(np.unique(positions[walls[:, :2].reshape(-1)], axis=0), np.unique(
        np.array(QUAD)[[0, 2, 3]], axis=0
    ))  # fmt: skip


def test_interpolated_normals_and_tangents_are_unit_and_orthogonal() -> None:
    normals = np.array([[0, 0.6, 0.8], [0, -0.6, 0.8], [0.6, 0, 0.8], [0, 0, 1]])
    tangents: list[list[float]] = [[1, 0, 0, -1], [1, 0, 0, -1], [0.8, 0, -0.6, -1], [1, 0, 0, -1]]
    document = quad(NORMAL=(normals, "<f4", False), TANGENT=(tangents, "<f4", False), TEXCOORD_0=(UV, "<f4", False))
    result = edited(document, [0, 1], [CAP, WALL], lift=1.0)
    normal, tangent = values(result, "NORMAL")[4:], values(result, "TANGENT")[4:]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(tangent[:, :3], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(np.einsum("ni,ni->n", normal, tangent[:, :3]), 0, atol=1e-6)
    assert (tangent[:, 3] == -1).all()


def test_integer_attributes_keep_their_type_and_identifiers_are_not_mixed() -> None:
    document = quad(
        TEXCOORD_0=(np.array(UV) * 60000, "<u2", True),
        COLOR_0=(np.array([[0, 10, 20]] * 3 + [[240, 10, 20]]), "u1", True),
        _FEATURE_ID_0=([3.0, 3, 7, 7], "<f4", False),
        _PART=([1, 1, 9, 9], "<u2", False),
    )
    result = edited(document, [1], [SURFACE])
    types = {
        name: result.json["accessors"][accessor]["componentType"]
        for name, accessor in primitives_of(result)[0]["attributes"].items()
    }
    assert types == {"POSITION": 5126, "TEXCOORD_0": 5123, "COLOR_0": 5121, "_FEATURE_ID_0": 5126, "_PART": 5123}
    np.testing.assert_allclose(values(result, "COLOR_0")[4] * 255, [80, 10, 20])
    np.testing.assert_allclose(values(result, "TEXCOORD_0")[4] * 65535, [20000, 40000])
    assert values(result, "_FEATURE_ID_0")[4] in (3, 7)
    assert values(result, "_PART")[4] in (1, 9)


def test_quantised_geometry_becomes_float_without_a_change_of_value() -> None:
    builder = Builder()
    attributes = {
        "POSITION": builder.accessor(np.array(QUAD) * 1000, "<i2"),
        "NORMAL": builder.accessor(np.array(NORMALS) * 127, "i1", normalized=True),
    }
    primitive = {"attributes": attributes, "indices": builder.accessor(QUAD_FACES, "<u2")}
    document = builder.document(
        meshes=[{"primitives": [primitive]}],
        extensionsUsed=["KHR_mesh_quantization"],
        extensionsRequired=["KHR_mesh_quantization"],
    )
    result = edited(document, [0], [SURFACE])
    assert result.json["accessors"][primitives_of(result)[0]["attributes"]["POSITION"]]["componentType"] == 5126
    np.testing.assert_array_equal(values(result, "POSITION")[:4], np.array(QUAD) * 1000)
    np.testing.assert_array_equal(values(result, "NORMAL")[:4], NORMALS)
    assert result.json["extensionsRequired"] == ["KHR_mesh_quantization"]


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [2, -0.5, -3], [-1e-3, 1e-3, 1e-3]])
def test_a_lift_goes_outwards_whatever_the_node_does(scale: list[float]) -> None:
    builder = Builder()
    normal = builder.accessor(np.array(CUBE) / np.sqrt(3))
    document = builder.document(
        meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES, NORMAL=normal)]}],
        nodes=[{"children": [1], "scale": scale}, {"mesh": 0, "rotation": [0.5, 0.5, 0.5, 0.5]}],
        scenes=[{"nodes": [0]}],
    )
    scene = flatten(document)
    edit = centroid_split(scene, range(12), [CAP, WALL] * 6, lift=2.0)
    after = scene_of(write(scene, edit, [Style()]))

    expected = scene.surface.to_world(edit.position.reshape(-1, 3))
    size = float(np.ptp(expected, axis=0).max())
    world = after.surface.to_world(after.surface.positions)[after.surface.faces]
    assert after.primitives[0].mirrored == scene.primitives[0].mirrored
    np.testing.assert_allclose(world.reshape(-1, 3), expected, atol=1e-6 * size)
    a, b, c = world[:, 0], world[:, 1], world[:, 2]
    assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0
    # the walls' own normals agree with the winding in the file
    result = after.document
    faces, positions = indices(result), values(result, "POSITION")
    flat = np.cross(positions[faces[:, 1]] - positions[faces[:, 0]], positions[faces[:, 2]] - positions[faces[:, 0]])
    assert (np.einsum("fi,fi->f", flat, values(result, "NORMAL")[faces].mean(axis=1)) > 0).all()


def test_a_node_that_flattens_its_mesh_cannot_carry_letters() -> None:
    scene = flatten(simple(CUBE, CUBE_FACES, scale=[1, 0, 1]))
    with pytest.raises(MeshmarkError) as caught:
        write(scene, centroid_split(scene, [0], [CAP]), [Style()])
    assert caught.value.code is ErrorCode.UNSUPPORTED_FEATURE


def _instanced() -> Document:
    builder = Builder()
    return builder.document(
        meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)], "name": "wheel"}],
        nodes=[{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}],
        scenes=[{"nodes": [0, 1]}],
    )


def test_a_mesh_that_another_node_draws_too_is_cloned() -> None:
    document = _instanced()
    result = edited(document, [12], [SURFACE])
    assert result.json["nodes"] == [{"mesh": 0}, {"mesh": 1, "translation": [5, 0, 0]}]
    assert result.json["meshes"][0] == document.json["meshes"][0]
    assert result.json["meshes"][1]["name"] == "wheel"
    assert len(indices(result, mesh=1)) == 14


def test_no_mesh_is_left_unused_when_every_node_was_touched() -> None:
    result = edited(_instanced(), [0, 12, 13], [SURFACE] * 3)
    assert [node["mesh"] for node in result.json["nodes"]] == [1, 0]
    assert (len(indices(result, mesh=1)), len(indices(result, mesh=0))) == (14, 16)


def test_primitives_that_shared_their_rows_still_do() -> None:
    builder = Builder()
    first = builder.primitive(QUAD, [0, 1, 2])
    second = {"attributes": first["attributes"], "indices": builder.accessor([0, 2, 3], "<u2")}
    result = edited(builder.document(meshes=[{"primitives": [first, second]}]), [0, 1], [SURFACE] * 2)
    assert primitives_of(result)[0]["attributes"] == primitives_of(result)[1]["attributes"]
    assert len(values(result, "POSITION")) == 6


def test_a_point_between_two_primitives_of_a_node_is_at_one_position_in_both() -> None:
    builder = Builder()
    near = [[0.1, 0.3, 0.7], [1 / 3, 0, 0], [1, 1, 0.9]]
    far = [[0.1, 0.3, 0.7], [1, 1, 0.9], [0, 1.7, 0]]
    primitives = [builder.primitive(positions, [0, 1, 2]) for positions in (near, far)]
    scene = flatten(builder.document(meshes=[{"primitives": primitives}], nodes=[{"mesh": 0, "scale": [0.7] * 3}]))
    edit = centroid_split(scene, [0, 1], [SURFACE, SURFACE])
    edit.vertex[:, 2] = 99
    edit.position[:3, 2] = scene.surface.positions[[0, 2]].mean(axis=0)
    edit.position[3:, 2] = edit.position[0, 2] + 1e-9  # what rounding may do
    edit.barycentric[:3, 2], edit.barycentric[3:, 2] = [0.5, 0, 0.5], [0.5, 0.5, 0]
    result = Document.from_glb(write(scene, edit, [Style()]))
    np.testing.assert_array_equal(values(result, "POSITION", 0)[3], values(result, "POSITION", 1)[3])


def test_letters_in_colour_become_a_primitive_with_a_material_of_their_own() -> None:
    document = quad(
        NORMAL=(NORMALS, "<f4", False), TEXCOORD_0=(UV, "<f4", False), COLOR_0=([[1, 0, 0]] * 4, "<f4", False)
    )
    primitives_of(document)[0] |= {
        "material": 0,
        "extensions": {"KHR_materials_variants": {"mappings": [{"material": 0, "variants": [0]}]}},
    }
    document.json |= {
        "materials": [{"name": "wood", "doubleSided": True}],
        "extensionsUsed": ["KHR_materials_variants"],
        "extensions": {"KHR_materials_variants": {"variants": [{"name": "a"}]}},
    }
    result = edited(document, [0, 1], [SURFACE, CAP], color="#ff8000", lift=0.1)
    base, letters = primitives_of(result)
    assert base["material"] == 0
    assert "KHR_materials_variants" in base["extensions"]
    assert letters.keys() == {"attributes", "indices", "material"}
    assert letters["attributes"].keys() == {"POSITION", "NORMAL"}
    assert (len(indices(result, 0)), len(indices(result, 1))) == (3, 3)
    material = result.json["materials"][letters["material"]]
    assert material["doubleSided"] is True
    assert material["name"] == "wood.001", "as an editor names a copy"
    np.testing.assert_allclose(
        material["pbrMetallicRoughness"]["baseColorFactor"], [1, 0.215861, 0, 1], atol=1e-6
    )  # sRGB 128 is 21.6% of the light


def test_one_material_serves_all_primitives_of_the_same_sidedness() -> None:
    builder = Builder()
    primitives = [builder.primitive(np.add(QUAD, number), QUAD_FACES) | {"material": number} for number in range(3)]
    materials = [LIT, LIT | {"doubleSided": True}, LIT]
    document = builder.document(meshes=[{"primitives": primitives}], materials=materials)
    result = edited(document, [0, 2, 4], [CAP, CAP, WALL], color="#000000")
    assert [primitive.get("material") for primitive in primitives_of(result)] == [0, 1, 2, 3, 4, 3]
    assert len(result.json["materials"]) == 5


def test_a_primitive_that_is_all_letters_is_replaced_by_them() -> None:
    document = quad()
    document.json["materials"] = [LIT]
    primitives_of(document)[0]["material"] = 0
    result = edited(document, [0, 1], [CAP, CAP], color="#00ff00")
    assert [primitive["material"] for primitive in primitives_of(result)] == [1]


def test_a_buffer_in_a_data_uri_becomes_the_bin_chunk() -> None:
    document = quad()
    document.json["buffers"][0]["uri"] = (
        "data:application/octet-stream;base64," + base64.b64encode(document.binary).decode()
    )
    scene = flatten(Document(document.json, b""))
    result = Document.from_glb(write(scene, centroid_split(scene, [0], [SURFACE]), [Style()]))
    assert "uri" not in result.json["buffers"][0]
    assert len(result.json["buffers"]) == 1
    np.testing.assert_array_equal(values(result, "POSITION")[:4], QUAD)


def test_further_chunks_come_through_an_edit() -> None:
    chunks = ((b"HAIR", b"1234"), (b"MORE", b""))
    assert edited(replace(quad(), chunks=chunks), [0], [Kind.CAP]).chunks == chunks


def _image(document: Document, number: int) -> bytes:
    image = document.json["images"][number]
    if "uri" in image:
        return str(image["uri"]).encode()
    data, start, length = document.view(image["bufferView"])
    return data[start : start + length]


def _edge_counts(scene: Scene) -> tuple[int, int]:
    """Boundary and non-manifold edges after welding."""
    corners = scene.surface.weld[scene.surface.faces]
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    return int((counts == 1).sum()), int((counts > 2).sum())


def _uncompressed() -> list[Path]:
    compressions = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
    found = real_glbs()
    return [path for path in found if compressions.isdisjoint(_read(path).json.get("extensionsUsed", []))]


def _read(path: Path) -> Document:
    return Document.from_glb(path.read_bytes())


@pytest.mark.parametrize("color", [None, "#d02020"])
@pytest.mark.parametrize("path", _uncompressed(), ids=lambda path: path.stem)
def test_real_assets_stay_as_valid_as_they_were(path: Path, color: str | None) -> None:
    data = path.read_bytes()
    document = Document.from_glb(data)
    scene = flatten(document)
    solid = np.flatnonzero(scene.surface.areas > 0)
    faces = solid[np.linspace(0, len(solid) - 1, 6).astype(int)]
    glb = write(scene, centroid_split(scene, faces, [SURFACE, SURFACE, SURFACE, CAP, WALL, WALL]), [Style(color)])

    assert not error_counts(glb).keys() - error_counts(data).keys()
    result = Document.from_glb(glb)
    assert unreferenced_bytes(result) == 0
    places = {"accessors", "bufferViews", "buffers", "meshes", "nodes", "materials", "images"}
    for key in document.json.keys() - places:
        assert result.json[key] == document.json[key]
    for number in range(len(document.json.get("images", []))):
        assert _image(result, number) == _image(document, number)
    after = flatten(result)
    assert len(after.surface.faces) == len(scene.surface.faces) + 12
    assert _edge_counts(after) == _edge_counts(scene)
    np.testing.assert_allclose(after.surface.areas.sum(), scene.surface.areas.sum(), rtol=1e-6)


def _strip_of_walls(angle: float) -> tuple[Document, Any]:
    """Two faces that meet at ``angle`` degrees along x = 1, both walls of one letter."""
    bend = np.radians(angle)
    positions = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1 + np.cos(bend), 0, -np.sin(bend)]]
    positions.append([1 + np.cos(bend), 1, -np.sin(bend)])
    builder = Builder()
    primitive = builder.primitive(
        positions, [0, 1, 2, 0, 2, 3, 1, 4, 5, 1, 5, 2], NORMAL=builder.accessor([[0, 1, 0]] * 6)
    )
    document = builder.document(meshes=[{"primitives": [primitive]}])
    scene = flatten(document)
    return document, centroid_split(scene, range(4), [WALL] * 4)


@pytest.mark.parametrize(("angle", "rows"), [(0, 10), (10, 10), (29, 10), (31, 12), (90, 12)])
def test_walls_along_a_curve_are_shaded_as_one_and_share_their_rows(angle: float, rows: int) -> None:
    document, edit = _strip_of_walls(angle)
    result = Document.from_glb(write(flatten(document), edit, [Style()]))
    normals, positions = values(result, "NORMAL"), values(result, "POSITION")
    assert len(positions) == rows
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    half = np.radians(angle / 2)
    middle = normals[(positions == [1, 0, 0]).all(axis=1)]
    if angle < 30:
        np.testing.assert_allclose(middle, [[np.sin(half), 0, np.cos(half)]], atol=1e-6)
    else:
        assert len(middle) == 2, "an edge stays sharp"


def test_without_normals_walls_share_the_rows_of_their_points() -> None:
    result = edited(quad(), [0, 1], [SURFACE, WALL], lift=3.0)
    assert len(values(result, "POSITION")) == 6


@pytest.mark.parametrize("outwards", [1, -1])
@pytest.mark.parametrize("node", [{}, {"scale": [2, 1, 1]}, {"scale": [-1, 1, 1]}])
def test_normals_of_soft_letters_are_those_of_the_ground_tilted_in_the_world(
    outwards: int, node: dict[str, Any]
) -> None:
    document = quad(NORMAL=(np.array(NORMALS) * outwards, "<f4", False))
    document.json["nodes"][0] |= node
    scene = flatten(document)
    edit = centroid_split(scene, [1], [CAP])
    facing = np.array([0.0, 0.0, np.sign(scene.surface.normals[1, 2])])
    tilt = np.array([0.5, 0.0, 0.0])
    edit.tilt[:, 2] = tilt
    result = Document.from_glb(write(scene, edit, [Style()]))
    assert not error_counts(result.to_glb())
    stretch = np.array(node.get("scale", [1, 1, 1]))
    file_facing = facing if stretch[0] > 0 else -facing  # a mirroring node turns the winding over, the normals not
    up = np.array([0.0, 0.0, outwards])
    wanted = (up + tilt * (1 if up @ file_facing * np.sign(stretch[0]) > 0 else -1)) * stretch
    np.testing.assert_allclose(values(result, "NORMAL")[4], wanted / np.linalg.norm(wanted), atol=1e-6)
    np.testing.assert_allclose(values(result, "NORMAL")[:4], np.array(NORMALS) * outwards, atol=1e-6)
