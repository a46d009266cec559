from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import flatten
from core.gltf.write import write
from tests.core.gltf.builder import CUBE, CUBE_FACES
from tests.core.gltf.compressed import draco, instanced, meshopted
from tests.core.gltf.edited import values
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

INSTANCING = "EXT_mesh_gpu_instancing"
PLACES: list[list[float]] = [[0.0, 0, 0], [5, 0, 0], [0, 7, 0]]
TURNS: list[list[float]] = [[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0.5, 0.5, 0.5, 0.5]]
SIZES: list[list[float]] = [[1.0, 1, 1], [2, 1, 1], [-1, 1, 3]]
FACES = len(CUBE_FACES) // 3


def _three(**more: tuple[ArrayLike, str]) -> Document:
    attributes: dict[str, tuple[ArrayLike, str]] = {
        "TRANSLATION": (PLACES, "<f4"),
        "ROTATION": (TURNS, "<f4"),
        "SCALE": (SIZES, "<f4"),
    }
    return instanced(CUBE, CUBE_FACES, **(attributes | more))


def _as_nodes() -> Document:
    """The same three cubes, each drawn by a node of its own."""
    document = _three()
    document.json["nodes"] = [
        {"mesh": 0, "translation": place, "rotation": turn, "scale": size}
        for place, turn, size in zip(PLACES, TURNS, SIZES, strict=True)
    ]
    document.json["scenes"] = [{"nodes": [0, 1, 2]}]
    return document


def _marked(document: Document, faces: list[int], color: str | None = None) -> Document:
    scene = flatten(document)
    glb = write(scene, centroid_split(scene, faces, [Kind.CAP] * len(faces)), [Style(color)])
    admit(glb)
    assert not error_counts(glb)
    result = Document.from_glb(glb)
    assert unreferenced_bytes(result) == 0
    before, after = scene.surface, flatten(result).surface
    assert len(after.faces) == len(before.faces) + 2 * len(faces)
    np.testing.assert_allclose(after.areas.sum(), before.areas.sum(), rtol=1e-6)
    np.testing.assert_allclose(_extent(after), _extent(before), rtol=1e-6)
    return result


def _extent(surface: Any) -> NDArray[np.float64]:
    world = surface.to_world(surface.positions[np.unique(surface.faces)])
    return np.stack([world.min(axis=0), world.max(axis=0)])


def _instances(document: Document, name: str, node: int = 0) -> list[Any]:
    accessor = document.json["nodes"][node]["extensions"][INSTANCING]["attributes"][name]
    values: list[Any] = read_accessor(document, accessor).tolist()
    return values


def test_every_instance_is_part_of_the_surface_like_a_node_of_its_own() -> None:
    one, other = flatten(_three()), flatten(_as_nodes())
    np.testing.assert_allclose(one.surface.positions, other.surface.positions, atol=1e-5)
    for name in ("faces", "weld", "face_primitive", "face_triangle"):
        np.testing.assert_array_equal(getattr(one.surface, name), getattr(other.surface, name))
    assert [drawn.instance for drawn in one.primitives] == [0, 1, 2]
    assert [drawn.mirrored for drawn in one.primitives] == [False, False, True]


def test_a_marked_instance_becomes_a_node_and_the_others_stay_instances() -> None:
    document = _three(_ID=([10, 11, 12], "<f4"))
    result = _marked(document, [FACES + 3], "#d02020")
    assert _instances(result, "TRANSLATION") == [PLACES[0], PLACES[2]]
    assert _instances(result, "_ID") == [10, 12]
    node, child = result.json["nodes"]
    assert (node["mesh"], node["name"], node["children"]) == (0, "many", [1])
    np.testing.assert_allclose(child["translation"], PLACES[1])
    np.testing.assert_allclose(child["rotation"], TURNS[1], atol=1e-7)
    np.testing.assert_allclose(child["scale"], SIZES[1])
    assert result.json["meshes"][0] == document.json["meshes"][0]
    letters = values(result, "COLOR_0", mesh=child["mesh"])
    assert len(np.unique(letters, axis=0)) == 2, "of the ground and of the letters"
    assert result.json["extensionsUsed"] == result.json["extensionsRequired"] == [INSTANCING]


def test_when_the_last_instance_goes_the_extension_goes_with_it() -> None:
    result = _marked(_three(), [0, FACES + 1, 2 * FACES + 2])
    node, *children = result.json["nodes"]
    assert node == {"name": "many", "children": [1, 2, 3]}
    # The original mesh is taken by the last of them: none is left that nothing draws.
    assert sorted(child["mesh"] for child in children) == [0, 1, 2]
    assert not {"extensionsUsed", "extensionsRequired"} & result.json.keys()


def test_two_marks_on_one_instance_are_in_one_node() -> None:
    result = _marked(_three(), [2 * FACES, 2 * FACES + 5])
    assert len(result.json["nodes"]) == 2
    assert _instances(result, "TRANSLATION") == PLACES[:2]


def test_children_extras_and_other_extensions_of_the_node_stay() -> None:
    document = _three()
    document.json["nodes"][0] |= {"children": [1], "extras": {"a": 1}}
    document.json["nodes"][0]["extensions"]["ACME_note"] = {"text": "kept"}
    document.json["extensionsUsed"].append("ACME_note")
    document.json["nodes"].append({"name": "child"})
    result = _marked(document, [0, FACES, 2 * FACES])
    node = result.json["nodes"][0]
    assert (node["children"], node["extras"]) == ([1, 2, 3, 4], {"a": 1})
    assert node["extensions"] == {"ACME_note": {"text": "kept"}}


def test_rotations_stored_as_short_integers_are_read_and_kept() -> None:
    turns = np.round(np.array(TURNS) * 32767)
    document = instanced(CUBE, CUBE_FACES, ROTATION=(turns, "<i2"), TRANSLATION=(PLACES, "<f4"))
    result = _marked(document, [FACES])
    assert _instances(result, "ROTATION") == turns[[0, 2]].tolist()
    np.testing.assert_allclose(result.json["nodes"][1]["rotation"], TURNS[1], atol=1e-4)


@pytest.mark.parametrize("compress", [draco, meshopted])
def test_instances_of_a_compressed_mesh_can_be_marked(compress: Any) -> None:
    result = _marked(_three_compressed(compress), [FACES])
    assert len(_instances(result, "TRANSLATION")) == 2
    assert len(result.json["extensionsUsed"]) == 2


def _three_compressed(compress: Any) -> Document:
    document: Document = compress(_three())
    names = [*document.json["extensionsUsed"], INSTANCING]
    document.json["extensionsUsed"] = document.json["extensionsRequired"] = names
    return document


def test_instances_that_a_skin_or_animated_weights_move_are_left_alone() -> None:
    for moved in ("skin", "weights"):
        document = _three()
        document.json["nodes"].append({"mesh": 0})
        document.json["scenes"] = [{"nodes": [0, 1]}]
        if moved == "skin":
            document.json["skins"] = [{"joints": [1]}]
            document.json["nodes"][0]["skin"] = 0
        else:
            channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
            document.json["animations"] = [{"channels": [channel], "samplers": [{"input": 0, "output": 0}]}]
        assert [drawn.node.index for drawn in flatten(document).primitives] == [1]


@pytest.mark.parametrize(
    "attributes",
    [
        {"TRANSLATION": (PLACES, "<f4"), "SCALE": (SIZES[:2], "<f4")},
        {"TRANSLATION": (TURNS, "<f4")},
        {"SCALE": ([[np.nan, 1, 1]], "<f4")},
        {"ROTATION": ([[0, 0, 0, 0]], "<f4")},
    ],
)
def test_instances_that_cannot_be_placed_are_malformed(attributes: dict[str, Any]) -> None:
    with pytest.raises(MeshmarkError) as caught:
        flatten(instanced(CUBE, CUBE_FACES, **attributes))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_instances_count_in_the_budget() -> None:
    admit(_three().to_glb(), Budgets(faces=36, vertices=24, draws=3))
    for budgets in (Budgets(faces=35), Budgets(vertices=23), Budgets(draws=2)):
        with pytest.raises(MeshmarkError) as caught:
            admit(_three().to_glb(), budgets)
        assert caught.value.code is ErrorCode.BUDGET_EXCEEDED
