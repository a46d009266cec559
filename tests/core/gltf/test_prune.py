from typing import Any

import numpy as np
import pytest

from core.formats.admission import admit
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import flatten
from core.gltf.write import write
from tests.core.formats.meshes import MESHES
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, grid
from tests.core.gltf.compressed import MESHOPT, draco, meshopted
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

DRACO = "KHR_draco_mesh_compression"
FACES = len(CUBE_FACES) // 3


def _two_cubes(**objects: Any) -> Document:
    builder = Builder()
    primitives = [builder.primitive(np.add(CUBE, shift), CUBE_FACES) for shift in (0, 5)]
    return builder.document(meshes=[{"primitives": primitives}], **objects)


def _marked(document: Document, faces: list[int]) -> Document:
    scene = flatten(document)
    glb = write(scene, centroid_split(scene, faces, [Kind.CAP] * len(faces)), [Style()])
    admit(glb)
    assert not error_counts(glb)
    result = Document.from_glb(glb)
    assert unreferenced_bytes(result) == 0
    after = flatten(result).surface
    assert len(after.faces) == len(scene.surface.faces) + 2 * len(faces)
    np.testing.assert_allclose(after.areas.sum(), scene.surface.areas.sum(), rtol=1e-6)
    return result


def _primitives(document: Document) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = document.json["meshes"][0]["primitives"]
    return found


def _stream(document: Document, primitive: int) -> bytes:
    data, start, length = document.view(_primitives(document)[primitive]["extensions"][DRACO]["bufferView"])
    return data[start : start + length]


def test_a_touched_draco_primitive_comes_back_plain_and_the_other_as_it_was() -> None:
    document = draco(_two_cubes())
    result = _marked(document, [0])
    assert "extensions" not in _primitives(result)[0]
    assert _stream(result, 1) == _stream(document, 1)
    assert _stream(document, 0) not in result.binary
    assert result.json["extensionsUsed"] == result.json["extensionsRequired"] == [DRACO]
    entry = result.json["accessors"][_primitives(result)[0]["attributes"]["POSITION"]]
    assert "sparse" not in entry, "rows from a stream are stored one after the other"


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
    result = Document.from_glb(write(scene, centroid_split(scene, [0], [Kind.CAP]), [Style()]))
    assert _primitives(result)[0]["extensions"] == {"KHR_materials_variants": {"mappings": []}}


def test_a_mesh_that_stays_compressed_for_another_node_keeps_its_stream() -> None:
    document = draco(_two_cubes(nodes=[{"mesh": 0}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}]))
    result = _marked(document, [0, FACES])
    assert result.json["meshes"][0] == document.json["meshes"][0]
    assert result.json["extensionsRequired"] == [DRACO]


def test_meshopt_views_stay_while_an_untouched_primitive_needs_them() -> None:
    document = meshopted(_two_cubes())
    result = _marked(document, [0])
    for number, compressed in enumerate((False, True)):
        primitive = _primitives(result)[number]
        for accessor in (primitive["indices"], primitive["attributes"]["POSITION"]):
            view = result.json["bufferViews"][result.json["accessors"][accessor]["bufferView"]]
            assert (MESHOPT in view.get("extensions", {})) == compressed
    for name in ("indices", "POSITION"):
        old, new = (
            read_accessor(part, (_primitives(part)[1] | _primitives(part)[1]["attributes"])[name])
            for part in (document, result)
        )
        np.testing.assert_array_equal(new, old)
    assert result.json["buffers"][1] == document.json["buffers"][1]
    assert result.json["extensionsUsed"] == result.json["extensionsRequired"] == [MESHOPT]


def test_of_a_meshopt_view_that_touched_and_untouched_primitives_share_the_untouched_rows_stay() -> None:
    builder = Builder()
    primitives = [builder.primitive(CUBE, CUBE_FACES[part]) for part in (slice(0, 30), slice(30, 36))]
    primitives[1]["attributes"] = {"POSITION": primitives[0]["attributes"]["POSITION"]}
    document = meshopted(builder.document(meshes=[{"primitives": primitives}]))
    result = _marked(document, [0])
    rest = _primitives(result)[1]
    used = np.unique(CUBE_FACES[30:])
    np.testing.assert_array_equal(read_accessor(result, rest["attributes"]["POSITION"]), np.array(CUBE)[used])
    view = result.json["bufferViews"][result.json["accessors"][rest["attributes"]["POSITION"]]["bufferView"]]
    assert "extensions" not in view, "their rows are written anew"


@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
def test_what_is_left_of_a_compressed_view_stays_compressed(mode: str) -> None:
    """One view over the positions of both primitives, one over their indices, as gltfpack writes them."""
    builder = Builder()
    positions = np.concatenate([CUBE, np.add(CUBE, 5)])
    both = builder.accessor(positions), builder.accessor([*CUBE_FACES, *CUBE_FACES], "<u2")
    accessors = builder.json["accessors"]
    for number, size in zip(both, (12 * 8, 2 * 36), strict=True):
        whole = accessors[number]
        halves = [whole | {"count": whole["count"] // 2, "byteOffset": start} for start in (0, size)]
        accessors += halves
    for place, number in enumerate((2, 3)):
        part = positions[8 * place : 8 * place + 8]
        accessors[number] |= {"min": part.min(axis=0).tolist(), "max": part.max(axis=0).tolist()}
    primitives = [{"attributes": {"POSITION": 2 + which}, "indices": 4 + which} for which in (0, 1)]
    document = meshopted(builder.document(meshes=[{"primitives": primitives}]), mode=mode)
    before = read_accessor(document, 5)
    result = _marked(document, [0])
    rest = _primitives(result)[1]
    np.testing.assert_array_equal(read_accessor(result, rest["attributes"]["POSITION"]), positions[8:])
    np.testing.assert_array_equal(read_accessor(result, rest["indices"]), before)
    for accessor in (rest["attributes"]["POSITION"], rest["indices"]):
        view = result.json["bufferViews"][result.json["accessors"][accessor]["bufferView"]]
        stream = view["extensions"][MESHOPT]
        assert view["byteLength"] == stream["count"] * stream["byteStride"]
        assert view["byteLength"] in (8 * 12, 36 * 2)


@pytest.mark.parametrize("extra", [0, 1])
def test_when_no_meshopt_view_is_left_its_fallback_buffer_goes(extra: int) -> None:
    document = meshopted(_two_cubes())
    for _ in range(extra):  # a buffer behind the fallback, whose number changes
        document.json["buffers"].append({"byteLength": 3, "uri": "data:application/octet-stream;base64,AAAA"})
        document.json["bufferViews"].append({"buffer": 2, "byteOffset": 0, "byteLength": 3})
    result = _marked(document, [0, FACES])
    assert not {"extensionsUsed", "extensionsRequired"} & result.json.keys()
    assert len(result.json["buffers"]) == 1
    assert all(view["buffer"] == 0 for view in result.json["bufferViews"])


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
    assert result.json["animations"][0]["channels"] == animation["channels"]
    assert result.json["extensionsUsed"] == [MESHOPT]
    output = result.json["animations"][0]["samplers"][0]["output"]
    np.testing.assert_array_equal(read_accessor(result, output), [[0, 0, 0], [1, 2, 3]])


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
    bones = result.json["skins"][0]["inverseBindMatrices"]
    np.testing.assert_array_equal(read_accessor(result, bones), read_accessor(compressed, inverse))
    np.testing.assert_allclose(flatten(result).surface.offset, [1, 2, 3])


def _drawn(document: Document, primitive: dict[str, Any]) -> Any:
    """The positions of a primitive's corners, in order."""
    positions = read_accessor(document, primitive["attributes"]["POSITION"])
    return positions[read_accessor(document, primitive["indices"])] if "indices" in primitive else positions


_REAL = ["chess-board", "box-textured-meshopt", "lamborghini", "nasa-ingenuity"]
_FILES = [path for path in (MESHES / f"{name}.glb" for name in _REAL) if path.exists()]


@pytest.mark.parametrize("path", _FILES, ids=lambda path: path.stem)
def test_a_real_compressed_asset_is_as_valid_as_before_and_keeps_what_was_not_touched(path: Any) -> None:
    data = path.read_bytes()
    document = Document.from_glb(data)
    scene = flatten(document)
    solid = np.flatnonzero(scene.surface.areas > 0)
    glb = write(scene, centroid_split(scene, solid[:6], [Kind.CAP] * 6), [Style("#d02020")])
    assert not error_counts(glb) - error_counts(data)
    result = Document.from_glb(glb)
    assert unreferenced_bytes(result) == 0
    touched = {scene.primitives[0].primitive.mesh}
    for number, mesh in enumerate(document.json["meshes"]):
        after = result.json["meshes"][number]["primitives"]
        for which, primitive in enumerate(mesh["primitives"]):
            if number not in touched or which:
                np.testing.assert_array_equal(_drawn(result, after[which]), _drawn(document, primitive))
    for key in ("materials", "textures", "scenes", "nodes"):
        assert result.json[key][: len(document.json[key])] == document.json[key]
    needed = [name for name in (DRACO, MESHOPT) if f'"{name}":' in str(result.json).replace("'", '"')]
    assert [name for name in result.json.get("extensionsUsed", []) if name in (DRACO, MESHOPT)] == needed


def test_a_view_that_only_some_accessors_still_need_is_cut_to_them() -> None:
    """Positions and normals of two primitives interleaved in one view, one of them touched."""
    builder = Builder()
    rows = np.array([np.hstack([np.add(CUBE, shift), np.eye(3)[[0] * 8]]) for shift in (0, 5)], "<f4").reshape(16, 6)
    view = builder.view(rows.tobytes(), byteStride=24, target=34962)
    primitives = []
    for first in (0, 8):
        attributes = {}
        for column, name in enumerate(("POSITION", "NORMAL")):
            part = rows[first : first + 8, 3 * column : 3 * column + 3]
            bounds = {"min": part.min(axis=0).tolist(), "max": part.max(axis=0).tolist()}
            entry = {"bufferView": view, "byteOffset": 24 * first + 12 * column, "componentType": 5126, "count": 8}
            builder.json["accessors"].append(entry | {"type": "VEC3"} | bounds)
            attributes[name] = len(builder.json["accessors"]) - 1
        primitives.append({"attributes": attributes, "indices": builder.accessor(CUBE_FACES, "<u2")})
    document = builder.document(meshes=[{"primitives": primitives}])
    result = _marked(document, [0])
    rest = _primitives(result)[1]["attributes"]
    np.testing.assert_array_equal(read_accessor(result, rest["POSITION"]), rows[8:, :3])
    np.testing.assert_array_equal(read_accessor(result, rest["NORMAL"]), rows[8:, 3:])
    assert rows[:8].tobytes() not in result.binary
    assert rows.tobytes() not in result.binary


def test_nothing_hides_between_the_rows_of_a_view() -> None:
    """A stride may leave room between rows; what lies there is not written."""
    builder = Builder()
    rows = np.full((8, 16), 77, "u1")
    rows[:, :12] = np.array(CUBE, "<f4").view("u1").reshape(8, 12)
    view = builder.view(rows.tobytes(), byteStride=16, target=34962)
    bounds = {"min": [-1.0] * 3, "max": [1.0] * 3}
    builder.json["accessors"].append({"bufferView": view, "componentType": 5126, "count": 8, "type": "VEC3"} | bounds)
    whole = builder.primitive(np.add(CUBE, 5), CUBE_FACES)
    points = {"attributes": {"POSITION": 0}, "mode": 0}
    result = _marked(builder.document(meshes=[{"primitives": [whole, points]}]), [0])
    assert bytes([77] * 4) not in result.binary


def test_rows_that_only_the_touched_primitive_drew_are_not_left_with_the_other() -> None:
    builder = Builder()
    first = builder.primitive([*CUBE, *np.add(CUBE, 5).tolist()], CUBE_FACES)
    second = {"attributes": first["attributes"], "indices": builder.accessor(np.add(CUBE_FACES, 8), "<u2")}
    result = _marked(builder.document(meshes=[{"primitives": [first, second]}]), [0])
    np.testing.assert_array_equal(
        read_accessor(result, _primitives(result)[1]["attributes"]["POSITION"]), np.add(CUBE, 5)
    )
    np.testing.assert_array_equal(read_accessor(result, _primitives(result)[1]["indices"]), CUBE_FACES)


def test_what_lay_unreferenced_in_the_input_is_counted_and_not_written() -> None:
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES)
    builder.accessor(np.full((7, 3), 2.5))
    document = builder.document(meshes=[{"primitives": [primitive]}])
    document.binary += b"\0\0\0\0secret"
    document.json["buffers"][0]["byteLength"] = len(document.binary)
    assert unreferenced_bytes(document) == 7 * 12 + 6
    result = _marked(document, [0])
    assert b"secret" not in result.binary
    assert np.full(3, 2.5, "<f4").tobytes() not in result.binary


def test_objects_that_extensions_may_count_keep_their_numbers() -> None:
    """Accessors and views too, as long as as many come as go."""
    builder = Builder()
    primitives = [builder.primitive(np.add(CUBE, shift), CUBE_FACES) for shift in (0, 5, 10)]
    sound = builder.view(b"sound")
    document = builder.document(
        meshes=[{"primitives": primitives}],
        materials=[{"name": "unused"}],
        extensions={"X_sound": {"clips": [{"bufferView": sound}]}},
        extensionsUsed=["X_sound"],
    )
    result = _marked(document, [0])
    assert _primitives(result)[1:] == _primitives(document)[1:]
    assert result.json["extensions"] == document.json["extensions"]
    data, start, length = result.view(sound)
    assert data[start : start + length] == b"sound"


def test_an_outline_follows_its_rows_and_loses_the_lines_that_lost_an_end() -> None:
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES)
    lines = builder.accessor([0, 1, 1, 3], "<u2")
    primitive["extensions"] = {"CESIUM_primitive_outline": {"indices": lines}}
    document = builder.document(meshes=[{"primitives": [primitive]}], extensionsUsed=["CESIUM_primitive_outline"])
    result = _marked(document, [0])
    after = _primitives(result)[0]
    positions = read_accessor(result, after["attributes"]["POSITION"])
    rows = read_accessor(result, after["extensions"]["CESIUM_primitive_outline"]["indices"])
    np.testing.assert_array_equal(positions[rows], np.array(CUBE)[[0, 1, 1, 3]])


def test_the_order_of_rows_and_triangles_does_not_tell_old_from_new() -> None:
    positions, faces = grid(20)
    builder = Builder()
    document = builder.document(meshes=[{"primitives": [builder.primitive(positions, faces)]}])
    result = _marked(document, list(range(0, 800, 3)))
    rows = read_accessor(result, _primitives(result)[0]["attributes"]["POSITION"])
    is_old = (rows == np.round(rows)).all(axis=1)
    # Old and new rows follow each other about as often as if they were drawn from one hat.
    changes, expected = np.count_nonzero(np.diff(is_old)), 2 * is_old.mean() * (1 - is_old.mean()) * len(rows)
    assert changes > 0.5 * expected
    corners = read_accessor(result, _primitives(result)[0]["indices"]).reshape(-1, 3)
    untouched = is_old[corners].all(axis=1)
    share = untouched.mean()
    assert np.count_nonzero(np.diff(untouched)) > 0.5 * 2 * share * (1 - share) * len(corners)
    assert (corners[:, 0] < corners[:, 1:].min(axis=1)).all(), "every triangle begins with its lowest row"


def test_blended_triangles_keep_their_order_for_viewers_draw_them_one_after_the_other() -> None:
    positions, faces = grid(4)
    builder = Builder()
    primitive = builder.primitive(positions, faces) | {"material": 0}
    document = builder.document(meshes=[{"primitives": [primitive]}], materials=[{"alphaMode": "BLEND"}])
    result = _marked(document, [5, 9])
    rows = read_accessor(result, _primitives(result)[0]["attributes"]["POSITION"])
    centers = rows[read_accessor(result, _primitives(result)[0]["indices"]).reshape(-1, 3)].mean(axis=1)
    kept = np.delete(np.arange(32), [5, 9])
    place = [int(np.abs(centers - positions[faces[face]].mean(axis=0)).sum(axis=1).argmin()) for face in kept]
    assert place == sorted(place)
