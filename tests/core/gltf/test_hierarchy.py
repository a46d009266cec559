from typing import Any

import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.hierarchy import read_nodes, scene_nodes, world_matrices

QUARTER_TURN_Z = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]


def _document(*nodes: dict[str, Any], **objects: Any) -> Document:
    return Document({"asset": {"version": "2.0"}, "nodes": list(nodes), **objects}, b"")


def test_translation_rotation_and_scale_apply_in_the_order_of_the_specification() -> None:
    document = _document({"translation": [10, 0, 0], "rotation": QUARTER_TURN_Z, "scale": [2, 3, 4]})
    np.testing.assert_allclose(world_matrices(document)[0] @ [1, 1, 1, 1], [10 - 3, 2, 4, 1], atol=1e-12)


def test_a_child_moves_with_its_parent() -> None:
    document = _document({"children": [1], "rotation": QUARTER_TURN_Z}, {"translation": [1, 0, 0]})
    np.testing.assert_allclose(world_matrices(document)[1] @ [0, 0, 0, 1], [0, 1, 0, 1], atol=1e-12)


def test_a_matrix_is_stored_column_by_column() -> None:
    document = _document({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]})
    np.testing.assert_array_equal(world_matrices(document)[0][:3, 3], [7, 8, 9])


def test_only_the_default_scene_is_drawn_depth_first() -> None:
    nodes = [{"children": [3]}, {}, {"children": [0]}, {}]
    document = _document(*nodes, scenes=[{"nodes": [1]}, {"nodes": [2, 1]}], scene=1)
    assert scene_nodes(document) == [2, 0, 3, 1]


def test_without_a_default_the_first_scene_is_drawn() -> None:
    assert scene_nodes(_document({}, {}, scenes=[{"nodes": [1]}])) == [1]


def test_without_scenes_every_root_is_drawn() -> None:
    assert scene_nodes(_document({"children": [1]}, {}, {})) == [0, 1, 2]


@pytest.mark.parametrize(
    "nodes",
    [
        [{"children": [0]}],
        [{"children": [1]}, {"children": [0]}],
        [{"children": [2]}, {"children": [2]}, {}],
        [{"children": [1, 1]}, {}],
        [{"children": [5]}],
        [{"matrix": [1, 2, 3]}],
        [{"rotation": [0, 0, 1]}],
        [{"scale": ["a", "b", "c"]}],
        [{"scale": [1e200, 1, 1], "children": [1]}, {"scale": [1e200, 1, 1]}],
    ],
)
def test_a_broken_hierarchy_is_malformed(nodes: list[dict[str, Any]]) -> None:
    with pytest.raises(MeshmarkError) as caught:
        world_matrices(_document(*nodes))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_a_scene_that_lists_a_node_twice_is_malformed() -> None:
    with pytest.raises(MeshmarkError) as caught:
        scene_nodes(_document({}, scenes=[{"nodes": [0, 0]}]))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_a_chain_of_ten_thousand_nodes_does_not_exhaust_the_stack() -> None:
    count = 10_000
    nodes = [{"children": [index + 1], "translation": [1, 0, 0]} for index in range(count - 1)] + [{}]
    document = _document(*nodes, scenes=[{"nodes": [0]}])
    assert world_matrices(document)[-1][0, 3] == count - 1
    assert len(scene_nodes(document)) == count


def test_nodes_know_their_names_children_mesh_and_visibility() -> None:
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = read_nodes(
        _document(
            {"name": "stand", "children": [2]},
            {"mesh": 0},
            {"mesh": 0, "name": "lamp", "children": [3], **hidden},
            {},
            meshes=[{"name": "bulb", "primitives": []}],
        )
    )
    assert [node.index for node in nodes] == [0, 2, 3, 1]
    assert [node.label for node in nodes] == ["stand", "lamp", "", "bulb"]
    assert [node.children for node in nodes] == [(2,), (3,), (), ()]
    assert [node.mesh for node in nodes] == [None, 0, None, 0]
    assert [node.hidden for node in nodes] == [False, True, True, False]
