from typing import Any

import numpy as np
import pytest

from core.asset.edit import Kind
from core.asset.flatten import flatten
from core.asset.gate import admit
from core.asset.gltf import Document, read_accessor
from core.asset.write import write
from tests.core.asset.builder import CUBE, CUBE_FACES, Builder
from tests.core.asset.compressed import MESHOPT, draco, meshopted
from tests.core.asset.edits import centroid_split
from tests.core.asset.meshes import MESHES
from tests.validator import error_counts

DRACO = "KHR_draco_mesh_compression"
FACES = len(CUBE_FACES) // 3


def _two_cubes(**objects: Any) -> Document:
    builder = Builder()
    primitives = [builder.primitive(np.add(CUBE, shift), CUBE_FACES) for shift in (0, 5)]
    return builder.document(meshes=[{"primitives": primitives}], **objects)


def _marked(document: Document, faces: list[int]) -> Document:
    scene = flatten(document)
    glb = write(scene, centroid_split(scene, faces, [Kind.CAP] * len(faces)), [None])
    admit(glb)
    assert not error_counts(glb)
    result = Document.from_glb(glb)
    assert result.binary.startswith(document.binary)
    after = flatten(result).surface
    assert len(after.faces) == len(scene.surface.faces) + 2 * len(faces)
    np.testing.assert_allclose(after.areas.sum(), scene.surface.areas.sum(), rtol=1e-6)
    return result


def _primitives(document: Document) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = document.json["meshes"][0]["primitives"]
    return found


def test_a_touched_draco_primitive_comes_back_plain_and_the_other_as_it_was() -> None:
    document = draco(_two_cubes())
    result = _marked(document, [0])
    assert "extensions" not in _primitives(result)[0]
    assert _primitives(result)[1] == _primitives(document)[1]
    assert result.json["extensionsUsed"] == result.json["extensionsRequired"] == [DRACO]
    position = _primitives(result)[0]["attributes"]["POSITION"]
    np.testing.assert_array_equal(read_accessor(result, position)[:8], read_accessor(document, 0))


def test_when_no_draco_primitive_is_left_both_lists_say_so() -> None:
    document = draco(_two_cubes())
    document.json["extensionsUsed"] = [DRACO, "KHR_lights_punctual"]
    result = _marked(document, [0, FACES])
    assert result.json["extensionsUsed"] == ["KHR_lights_punctual"]
    assert "extensionsRequired" not in result.json


def test_other_extensions_of_a_touched_draco_primitive_stay() -> None:
    document = draco(_two_cubes())
    _primitives(document)[0]["extensions"]["KHR_materials_variants"] = {"mappings": []}
    scene = flatten(document)
    result = Document.from_glb(write(scene, centroid_split(scene, [0], [Kind.CAP]), [None]))
    assert _primitives(result)[0]["extensions"] == {"KHR_materials_variants": {"mappings": []}}


def test_a_mesh_that_stays_compressed_for_another_node_keeps_its_stream() -> None:
    document = draco(_two_cubes(nodes=[{"mesh": 0}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}]))
    result = _marked(document, [0, FACES])
    assert result.json["meshes"][0] == document.json["meshes"][0]
    assert result.json["extensionsRequired"] == [DRACO]


def test_meshopt_views_stay_while_an_untouched_primitive_needs_them() -> None:
    document = meshopted(_two_cubes())
    result = _marked(document, [0])
    views = result.json["bufferViews"]
    touched, untouched = (
        [document.json["accessors"][n]["bufferView"] for n in (p["indices"], p["attributes"]["POSITION"])]
        for p in _primitives(document)
    )
    for view in untouched:
        assert views[view] == document.json["bufferViews"][view]
    for view in touched:
        assert "extensions" not in views[view]
    assert result.json["buffers"][1] == document.json["buffers"][1]
    assert result.json["extensionsUsed"] == result.json["extensionsRequired"] == [MESHOPT]


def test_a_meshopt_view_that_touched_and_untouched_primitives_share_stays() -> None:
    builder = Builder()
    primitives = [builder.primitive(CUBE, CUBE_FACES[part]) for part in (slice(0, 18), slice(18, 36))]
    primitives[1]["attributes"] = {"POSITION": primitives[0]["attributes"]["POSITION"]}
    document = meshopted(builder.document(meshes=[{"primitives": primitives}]))
    shared = document.json["accessors"][0]["bufferView"]
    result = _marked(document, [0])
    assert result.json["bufferViews"][shared] == document.json["bufferViews"][shared]


@pytest.mark.parametrize("extra", [0, 1])
def test_when_no_meshopt_view_is_left_its_fallback_buffer_goes(extra: int) -> None:
    document = meshopted(_two_cubes())
    for _ in range(extra):  # a buffer behind the fallback, whose number changes
        document.json["buffers"].append({"byteLength": 3, "uri": "data:application/octet-stream;base64,AAAA"})
        document.json["bufferViews"].append({"buffer": 2, "byteOffset": 0, "byteLength": 3})
    result = _marked(document, [0, FACES])
    assert not {"extensionsUsed", "extensionsRequired"} & result.json.keys()
    assert len(result.json["buffers"]) == 1 + extra
    assert all(view["buffer"] <= extra for view in result.json["bufferViews"])


def test_an_animation_in_a_compressed_view_is_carried_as_it_is() -> None:
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES)
    times = builder.accessor([0.0, 1.0], min=[0.0], max=[1.0])
    places = builder.accessor([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    animation = {
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
        "samplers": [{"input": times, "output": places}],
    }
    document = meshopted(builder.document(meshes=[{"primitives": [primitive]}], animations=[animation]))
    result = _marked(document, [0])
    assert result.json["animations"] == [animation]
    assert result.json["extensionsUsed"] == [MESHOPT]
    np.testing.assert_array_equal(read_accessor(result, places), [[0, 0, 0], [1, 2, 3]])


def test_inverse_bind_matrices_in_a_compressed_view_move_the_skin() -> None:
    builder = Builder()
    joints = builder.accessor([[0, 0, 0, 0]] * 8, "u1")
    weights = builder.accessor([[1.0, 0, 0, 0]] * 8)
    matrix = np.eye(4)
    matrix[3, :3] = (1, 2, 3)  # column-major
    inverse = builder.accessor([matrix.reshape(-1)])
    document = builder.document(
        meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES, JOINTS_0=joints, WEIGHTS_0=weights)]}],
        nodes=[{"mesh": 0, "skin": 0}, {"name": "bone"}],
        scenes=[{"nodes": [0, 1]}],
        skins=[{"joints": [1], "inverseBindMatrices": inverse}],
    )
    compressed = meshopted(document)
    np.testing.assert_array_equal(flatten(compressed).surface.offset, [1, 2, 3])
    result = _marked(compressed, [0])
    assert result.json["accessors"][inverse] == compressed.json["accessors"][inverse]
    np.testing.assert_allclose(flatten(result).surface.offset, [1, 2, 3])


_REAL = ["chess-board", "box-textured-meshopt", "lamborghini", "nasa-ingenuity"]
_FILES = [path for path in (MESHES / f"{name}.glb" for name in _REAL) if path.exists()]


@pytest.mark.parametrize("path", _FILES, ids=lambda path: path.stem)
def test_a_real_compressed_asset_is_as_valid_as_before_and_keeps_what_was_not_touched(path: Any) -> None:
    data = path.read_bytes()
    document = Document.from_glb(data)
    scene = flatten(document)
    solid = np.flatnonzero(scene.surface.areas > 0)
    glb = write(scene, centroid_split(scene, solid[:6], [Kind.CAP] * 6), ["#d02020"])
    assert not error_counts(glb) - error_counts(data)
    result = Document.from_glb(glb)
    assert result.binary.startswith(document.binary)
    touched = {scene.primitives[0].mesh}
    for number, mesh in enumerate(document.json["meshes"]):
        before, after = mesh["primitives"], result.json["meshes"][number]["primitives"]
        assert after[1 : len(before)] == before[1:]
        assert number in touched or after == before
    for key in ("materials", "images", "textures", "scenes", "nodes"):
        assert result.json[key][: len(document.json[key])] == document.json[key]
    needed = [name for name in (DRACO, MESHOPT) if f'"{name}":' in str(result.json).replace("'", '"')]
    assert [name for name in result.json.get("extensionsUsed", []) if name in (DRACO, MESHOPT)] == needed
