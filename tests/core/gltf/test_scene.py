from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface
from core.gltf.document import Document
from core.gltf.scene import Scene, flatten
from tests.core.gltf.builder import CUBE, CUBE_FACES, QUAD, QUAD_FACES, Builder, grid, simple

HALF_TURN_X = [1, 0, 0, 0]


def _volume(surface: Surface) -> float:
    a, b, c = (surface.positions[surface.faces[:, corner]] for corner in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def _world(scene: Scene) -> np.ndarray:
    return scene.surface.to_world(scene.surface.positions)


def _failure(document: Document) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        flatten(document)
    return caught.value


def test_the_largest_side_becomes_thirty_and_the_box_is_centred() -> None:
    surface = flatten(simple([[5, 5, 5], [9, 5, 5], [5, 7, 5]], [0, 1, 2])).surface
    np.testing.assert_allclose(surface.positions.min(axis=0), [-15, -7.5, 0])
    np.testing.assert_allclose(surface.positions.max(axis=0), [15, 7.5, 0])
    assert surface.scale == 7.5
    np.testing.assert_allclose(surface.to_world(surface.positions), [[5, 5, 5], [9, 5, 5], [5, 7, 5]])


def test_vertices_that_no_face_uses_do_not_count_for_the_size() -> None:
    scene = flatten(simple([*QUAD, [1000.0] * 3]))
    assert scene.surface.scale == 30


def test_every_face_leads_back_to_its_primitive_and_triangle() -> None:
    builder = Builder()
    meshes = [
        {"primitives": [builder.primitive(QUAD, QUAD_FACES), builder.primitive(CUBE, CUBE_FACES)]},
        {"primitives": [builder.primitive(QUAD, QUAD_FACES)]},
    ]
    scene = flatten(
        builder.document(meshes=meshes, nodes=[{"mesh": 1, "children": [1]}, {"mesh": 0}], scenes=[{"nodes": [0]}])
    )
    assert [(drawn.node.index, drawn.primitive.mesh, drawn.primitive.number) for drawn in scene.primitives] == [
        (0, 1, 0),
        (1, 0, 0),
        (1, 0, 1),
    ]
    surface = scene.surface
    for face, corners in enumerate(surface.faces):
        drawn = scene.primitives[surface.face_primitive[face]]
        np.testing.assert_array_equal(corners - drawn.first_vertex, drawn.triangles[surface.face_triangle[face]])
    assert len(surface.faces) == 2 + 2 + 12


def test_a_mesh_drawn_by_two_nodes_appears_twice() -> None:
    builder = Builder()
    document = builder.document(
        meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)]}],
        nodes=[{"mesh": 0}, {"mesh": 0, "translation": [10, 0, 0], "rotation": HALF_TURN_X}],
        scenes=[{"nodes": [0, 1]}],
    )
    scene = flatten(document)
    assert len(scene.surface.faces) == 24
    np.testing.assert_allclose(_world(scene)[8:], np.array(CUBE) * [1, -1, -1] + [10, 0, 0], atol=1e-12)
    assert not set(scene.surface.weld[:8]) & set(scene.surface.weld[8:])


def test_normals_of_a_mirrored_node_face_outwards() -> None:
    plain, mirrored = flatten(simple(CUBE, CUBE_FACES)), flatten(simple(CUBE, CUBE_FACES, scale=[-1, 2, 1]))
    assert _volume(plain.surface) > 0
    assert _volume(mirrored.surface) > 0
    assert (plain.primitives[0].mirrored, mirrored.primitives[0].mirrored) == (False, True)


def test_a_node_that_flattens_its_mesh_is_not_invertible() -> None:
    assert flatten(simple(CUBE, CUBE_FACES, scale=[1e-3, 1e4, 1])).primitives[0].invertible
    assert not flatten(simple(CUBE, CUBE_FACES, scale=[1, 0, 1])).primitives[0].invertible


@pytest.mark.parametrize(
    ("mode", "order", "triangles"),
    [
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
        (4, [0, 1, 2, 0], [[0, 1, 2]]),
    ],
)
def test_strips_and_fans_become_triangles_of_one_winding(
    mode: int, order: list[int], triangles: list[list[int]]
) -> None:
    document = simple(QUAD, order)
    document.json["meshes"][0]["primitives"][0]["mode"] = mode
    scene = flatten(document)
    assert scene.primitives[0].triangles.tolist() == triangles
    assert (scene.surface.normals[:, 2] == 1).all()


def test_a_primitive_without_indices_is_drawn_in_order() -> None:
    assert flatten(simple(QUAD[:3], None)).surface.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_left_out(mode: int) -> None:
    builder = Builder()
    primitives = [builder.primitive(CUBE, CUBE_FACES) | {"mode": mode}, builder.primitive(QUAD, QUAD_FACES)]
    assert len(flatten(builder.document(meshes=[{"primitives": primitives}])).surface.faces) == 2
    assert _failure(builder.document(meshes=[{"primitives": primitives[:1]}])).code is ErrorCode.NO_FACES


def test_primitives_that_share_their_attributes_share_their_rows() -> None:
    builder = Builder()
    first = builder.primitive(QUAD, [0, 1, 2])
    second = {"attributes": first["attributes"], "indices": builder.accessor([0, 2, 3], "<u2")}
    scene = flatten(builder.document(meshes=[{"primitives": [first, second]}]))
    assert len(scene.surface.positions) == 4
    assert [drawn.first_vertex for drawn in scene.primitives] == [0, 0]


def test_seams_weld_and_negative_zero_is_zero() -> None:
    positions: list[list[float]] = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [0, 1, 0], [-1, 0, 0]]
    weld = flatten(simple(positions, [0, 1, 2, 3, 4, 5])).surface.weld
    assert weld[0] == weld[3]
    assert weld[2] == weld[4]
    assert len(set(weld)) == 4


def _two_bones(weights: ArrayLike, node: tuple[int, ...] = (1, 1, 1), bones: tuple[int, ...] = (1, 1, 1)) -> Document:
    """A quad whose two coincident corners follow different bones; the second bone is lifted by 5."""
    builder = Builder()
    positions = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 1, 0], [-1, 0, 0]]
    primitive = builder.primitive(
        positions,
        [0, 1, 2, 3, 4, 5],
        JOINTS_0=builder.accessor([[0, 1, 0, 0]] * 6, "u1"),
        WEIGHTS_0=builder.accessor(weights),
    )
    bind = np.tile(np.eye(4).reshape(-1), (2, 1))
    return builder.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[
            {"mesh": 0, "skin": 0, "translation": [100, 0, 0], "scale": list(node)},
            {"scale": list(bones)},
            {"translation": [0, 0, 5], "scale": list(bones)},
        ],
        scenes=[{"nodes": [0, 1, 2]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": builder.accessor(bind)}],
    )


def test_a_skin_moves_its_vertices_and_the_transform_of_its_node_does_not() -> None:
    scene = flatten(_two_bones(np.repeat([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]], [3, 2, 1], axis=0)))
    np.testing.assert_allclose(_world(scene)[[0, 3, 5]], np.array([[0, 0, 0], [0, 0, 5], [-1, 0, 2.5]]), atol=1e-12)


def test_coincident_vertices_that_the_pose_parts_are_not_welded() -> None:
    together = flatten(_two_bones([[1, 0, 0, 0]] * 6)).surface.weld
    apart = flatten(_two_bones([[1, 0, 0, 0]] * 3 + [[0, 1, 0, 0]] * 3)).surface.weld
    assert together[0] == together[3]
    assert apart[0] != apart[3]


@pytest.mark.parametrize("node", [(1, 1, 1), (-1, 1, 1)])
@pytest.mark.parametrize("bones", [(1, 1, 1), (1, -1, 1)])
def test_which_side_of_a_skin_is_its_front_is_decided_by_its_node_alone(
    node: tuple[int, int, int], bones: tuple[int, int, int]
) -> None:
    """As the specification has it (3.7.4), and as viewers do; bones mirror where vertices are, not what is front."""
    normals = flatten(_two_bones([[1, 0, 0, 0]] * 6, node, bones)).surface.normals
    assert normals[0].tolist() == [0, 0, node[0] * bones[1]]


def test_morph_targets_are_drawn_at_their_default_weights() -> None:
    builder = Builder()
    primitive = builder.primitive(QUAD, QUAD_FACES)
    primitive["targets"] = [{"POSITION": builder.accessor([[0, 0, 4]] * 4)}, {"POSITION": builder.accessor(QUAD)}]
    mesh = {"primitives": [primitive], "weights": [0.5, 0]}
    of_mesh = flatten(builder.document(meshes=[mesh]))
    of_node = flatten(builder.document(meshes=[mesh], nodes=[{"mesh": 0, "weights": [0, 1]}]))
    np.testing.assert_allclose(_world(of_mesh), np.add(QUAD, [0, 0, 2]))
    np.testing.assert_allclose(_world(of_node), np.array(QUAD) * 2, atol=1e-12)
    assert of_node.primitives[0].morph_weights.tolist() == [0, 1]


@pytest.mark.parametrize(("normalized", "size"), [(True, 100 / 32767), (False, 100)])
def test_quantised_positions_are_read_as_meant(normalized: bool, size: float) -> None:
    builder = Builder()
    position = builder.accessor(np.array(QUAD) * 100, "<i2", normalized=normalized)
    primitive = {"attributes": {"POSITION": position}, "indices": builder.accessor(QUAD_FACES, "<u2")}
    scene = flatten(builder.document(meshes=[{"primitives": [primitive]}]))
    np.testing.assert_allclose(_world(scene).max(axis=0), [size, size, 0], rtol=1e-12)


def _changed(**changes: Any) -> Document:
    document = simple()
    document.json["meshes"][0]["primitives"][0] |= changes
    return document


def test_an_index_past_the_last_vertex_is_out_of_range() -> None:
    assert _failure(simple(QUAD, [0, 1, 4])).code is ErrorCode.INDEX_OUT_OF_RANGE


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_positions_that_are_not_finite_are_refused(value: float) -> None:
    assert _failure(simple(np.diag([value, 1, 1]), [0, 1, 2])).code is ErrorCode.NON_FINITE_POSITIONS


@pytest.mark.parametrize(
    "document",
    [
        simple([[1, 2, 3]] * 3, [0, 1, 2]),
        simple(scale=[0, 0, 0]),
        simple(QUAD, [0, 1]),
        Document({"asset": {"version": "2.0"}}, b""),
    ],
)
def test_an_asset_without_extent_or_triangles_has_no_faces(document: Document) -> None:
    assert _failure(document).code is ErrorCode.NO_FACES


@pytest.mark.parametrize(
    "changes",
    [
        {"attributes": {"POSITION": 1}},
        {"attributes": {"POSITION": 9}},
        {"attributes": {"POSITION": 0, "NORMAL": 1}},
        {"attributes": []},
        {"indices": 0},
        {"targets": [3]},
        {"targets": [{"POSITION": 1}]},
    ],
)
def test_a_primitive_that_contradicts_itself_is_malformed(changes: dict[str, Any]) -> None:
    assert _failure(_changed(**changes)).code is ErrorCode.MALFORMED_FILE


def test_flattening_does_not_depend_on_the_run_and_leaves_the_document_alone() -> None:
    positions, faces = grid(20)
    document = simple(positions, faces)
    before = document.to_glb()
    first, second = flatten(document).surface, flatten(document).surface
    for name in ("positions", "faces", "weld", "face_primitive", "face_triangle"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert document.to_glb() == before
