"""Other scenes, levels of detail, and what no scene shows."""

from typing import Any

import numpy as np
import pytest

from core.choices import Evaluate, UnmarkedCopies
from core.gltf.document import Document
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import flatten
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder
from tests.validator import error_counts

FEW = Parameters(text="W", count=3, size=1.5, evaluate=Evaluate.NONE)
TETRAHEDRON = [[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
TETRAHEDRON_FACES = [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]


def _marked(document: Document, parameters: Parameters = FEW) -> tuple[Result, Document]:
    result = watermark(document.to_glb(), parameters, preview=False)
    assert not error_counts(result.model)
    after = Document.from_glb(result.model)
    assert unreferenced_bytes(after) == 0
    return result, after


def _file(*nodes: dict[str, Any], scenes: list[list[int]], meshes: int = 2, **objects: Any) -> Document:
    """Mesh 0 is a cube of side 2; the others are one of side 2.001, or a speck where no text fits."""
    builder = Builder()
    positions = [np.array(CUBE), np.array(CUBE) * 1.0005, np.array(TETRAHEDRON)]
    faces = [CUBE_FACES, CUBE_FACES, TETRAHEDRON_FACES]
    return builder.document(
        meshes=[
            {"name": f"mesh {number}", "primitives": [builder.primitive(positions[number], faces[number])]}
            for number in range(meshes)
        ],
        nodes=list(nodes),
        scenes=[{"name": f"scene {number}", "nodes": roots} for number, roots in enumerate(scenes)],
        **objects,
    )


def _faces(document: Document, mesh: int) -> int:
    """Triangles of a mesh."""
    primitives = document.json["meshes"][mesh]["primitives"]
    return int(sum(document.json["accessors"][primitive["indices"]]["count"] for primitive in primitives)) // 3


def test_another_scene_that_draws_the_same_mesh_draws_the_marked_one() -> None:
    document = _file({"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}, scenes=[[0], [1]], meshes=1)
    result, after = _marked(document)
    assert len(after.json["meshes"]) == 1
    assert _faces(after, 0) > 12
    assert [node["mesh"] for node in after.json["nodes"]] == [0, 0]
    (copy,) = result.report["copies"]
    assert (copy["kind"], copy["outcome"]) == ("scene", "shared")
    assert result.report["warnings"] == []


def test_another_scene_with_a_mesh_of_its_own_gets_the_same_marks() -> None:
    result, after = _marked(_file({"mesh": 0}, {"mesh": 1}, scenes=[[0], [1]]))
    (copy,) = result.report["copies"]
    assert copy == {"kind": "scene", "name": "scene 1", "watermarks": 3, "outcome": "marked"}
    assert _faces(after, 0) > 12
    assert _faces(after, 1) > 12


def test_a_level_of_detail_gets_the_same_marks_where_its_node_stands() -> None:
    levels = {"extensions": {"MSFT_lod": {"ids": [2]}}, "extras": {"MSFT_screencoverage": [0.5, 0.1]}}
    document = _file(
        {"children": [1], "translation": [4, 5, 6]},
        {"mesh": 0, **levels},
        {"name": "coarse", "mesh": 1},
        scenes=[[0]],
        extensionsUsed=["MSFT_lod"],
    )
    result, after = _marked(document)
    (copy,) = result.report["copies"]
    assert copy == {"kind": "level_of_detail", "name": "coarse", "watermarks": 3, "outcome": "marked"}
    assert after.json["nodes"][1]["extensions"] == levels["extensions"]
    letters = flatten(after).surface
    after.json["nodes"][1]["mesh"] = after.json["nodes"][2]["mesh"]
    coarse = flatten(after).surface.in_frame_of(letters)
    assert len(coarse.faces) == len(letters.faces)
    assert np.abs(np.sort(coarse.positions, axis=0) - np.sort(letters.positions, axis=0)).max() < 0.05


@pytest.mark.parametrize("keep", [False, True])
def test_what_no_mark_fits_into_is_left_out_unless_it_is_asked_for(keep: bool) -> None:
    levels = {"extensions": {"MSFT_lod": {"ids": [1]}}, "extras": {"MSFT_screencoverage": [0.5, 0.1], "mine": 1}}
    document = _file(
        {"mesh": 0, **levels},
        {"name": "coarse", "mesh": 2},
        {"mesh": 2, "translation": [3, 0, 0]},
        scenes=[[0], [2]],
        meshes=3,
        extensionsUsed=["MSFT_lod", "VRM"],
        extensions={"VRM": {"binds": [{"mesh": 0}]}},
    )
    parameters = FEW.model_copy(update={"unmarked_copies": UnmarkedCopies.KEEP}) if keep else FEW
    result, after = _marked(document, parameters)
    assert [warning["code"] for warning in result.report["warnings"]] == ["unmarked_copies"]
    outcomes = {copy["kind"]: copy["outcome"] for copy in result.report["copies"]}
    assert outcomes == dict.fromkeys(("level_of_detail", "scene", "unused_meshes"), "unmarked" if keep else "left_out")
    assert "scene 1" in result.report["warnings"][0]["message"]
    if keep:
        assert len(after.json["meshes"]) == 3
        assert after.json["nodes"][1:] == document.json["nodes"][1:]
        return
    assert [mesh["name"] for mesh in after.json["meshes"]] == ["mesh 0"]
    assert after.json["nodes"][1:] == [{"name": "coarse"}, {"translation": [3, 0, 0]}]
    assert after.json["nodes"][0]["extras"] == {"MSFT_screencoverage": [0.5], "mine": 1}
    assert "extensions" not in after.json["nodes"][0]
    assert "MSFT_lod" not in after.json.get("extensionsUsed", [])
    assert after.json["scenes"] == document.json["scenes"]


def test_a_mesh_that_only_a_collider_refers_to_stays() -> None:
    shapes = {"X_physics": {"shapes": [{"convex": {"mesh": 1}}]}}
    document = _file({"mesh": 0}, scenes=[[0]], extensions=shapes, extensionsUsed=["X_physics"])
    _, after = _marked(document)
    assert after.json["extensions"] == document.json["extensions"]
    assert [mesh["name"] for mesh in after.json["meshes"]] == ["mesh 0", "mesh 1"]


def test_bones_and_animated_weights_of_what_is_left_out_go_with_it() -> None:
    builder = Builder()
    moved = builder.accessor(np.array(TETRAHEDRON) * 0.1)
    speck = builder.primitive(TETRAHEDRON, TETRAHEDRON_FACES) | {"targets": [{"POSITION": moved}]}
    times, weights = builder.accessor([0.0, 1.0], min=[0.0], max=[1.0]), builder.accessor([0.0, 1.0])
    sampler = {"input": times, "output": weights}
    document = builder.document(
        meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)]}, {"primitives": [speck], "weights": [0]}],
        nodes=[{"mesh": 0}, {"mesh": 1, "weights": [0.5]}],
        animations=[
            {"channels": [{"sampler": 0, "target": {"node": 1, "path": "weights"}}], "samplers": [sampler]},
        ],
    )
    _, after = _marked(document)
    assert after.json["nodes"][1] == {}
    assert "animations" not in after.json


def test_hidden_nodes_are_marked_too_and_stay_where_they_cannot_be() -> None:
    hide = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    document = _file(
        {"mesh": 0},
        {"mesh": 0, **hide},
        {"mesh": 2, **hide},
        {"mesh": 1, **hide},
        scenes=[[0, 1, 2, 3]],
        meshes=3,
        extensionsUsed=["KHR_node_visibility"],
    )
    result, after = _marked(document)
    assert after.json["nodes"][:2] == document.json["nodes"][:2]
    assert [_faces(after, mesh) > 12 for mesh in range(3)] == [True, True, False]
    assert [(copy["kind"], copy["outcome"]) for copy in result.report["copies"]] == [("hidden_nodes", "marked")]


def test_what_is_hidden_and_cannot_be_marked_stays_with_a_warning() -> None:
    hide = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    document = _file(
        {"mesh": 0},
        {"mesh": 1, "translation": [9, 0, 0], **hide},
        scenes=[[0, 1]],
        extensionsUsed=["KHR_node_visibility"],
    )
    result, after = _marked(document)
    assert after.json["nodes"] == document.json["nodes"]
    assert [warning["code"] for warning in result.report["warnings"]] == ["unmarked_copies"]


def test_a_file_with_one_scene_has_no_copies() -> None:
    result, _ = _marked(_file({"mesh": 0}, scenes=[[0]], meshes=1))
    assert result.report["copies"] == []
