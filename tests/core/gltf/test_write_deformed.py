from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.scene import Scene, flatten, scene_of
from core.gltf.write import write
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.core.gltf.edited import NORMALS, edited, indices, primitives_of, values
from tests.core.gltf.edits import centroid_split

SURFACE, CAP, WALL = Kind.SURFACE, Kind.CAP, Kind.WALL
pytestmark = pytest.mark.usefixtures("in_file_order")


def _skinned(weights: ArrayLike, dtype: str = "<f4", joints: ArrayLike = ((0, 1, 2, 3),) * 4) -> Document:
    """A quad on six bones that the default pose moves apart."""
    builder = Builder()
    primitive = builder.primitive(
        QUAD,
        QUAD_FACES,
        NORMAL=builder.accessor(NORMALS),
        JOINTS_0=builder.accessor(joints, "u1"),
        WEIGHTS_0=builder.accessor(weights, dtype, **({"normalized": True} if dtype != "<f4" else {})),
    )
    bones = [{"translation": [0.1 * number, 0.3 * number**2, number]} for number in range(6)]
    return builder.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[{"mesh": 0, "skin": 0}, *bones, {"children": list(range(1, 7))}],
        scenes=[{"nodes": [0, 7]}],
        skins=[
            {
                "joints": list(range(1, 7)),
                "inverseBindMatrices": builder.accessor(np.tile(np.eye(4).reshape(-1), (6, 1))),
            }
        ],
    )


def _world_of_new_corners(scene: Scene, edit: Any, result: Document) -> float:
    """The largest distance of a new corner from where the edit wants it."""
    after = flatten(result).surface
    wanted = scene.surface.to_world(edit.position.reshape(-1, 3))
    new = after.faces[edit.keep.sum() :].reshape(-1)
    return float(np.abs(after.to_world(after.positions[new]) - wanted).max())


def test_lifted_corners_of_a_skinned_mesh_end_up_where_they_should_in_the_default_pose() -> None:
    scene = flatten(_skinned([[0.5, 0.5, 0, 0], [0.2, 0.3, 0.5, 0], [0.0, 0, 0, 1], [0.25] * 4]))
    edit = centroid_split(scene, [0, 1], [CAP, WALL], lift=1.0)
    result = Document.from_glb(write(scene, edit, [Style()]))
    assert _world_of_new_corners(scene, edit, result) < 1e-5


def test_a_new_vertex_follows_the_strongest_four_bones_of_its_corners() -> None:
    joints = [[0, 1, 0, 0], [2, 3, 0, 0], [4, 5, 0, 0], [0, 0, 0, 0]]
    weights: list[list[float]] = [[0.9, 0.1, 0, 0], [0.6, 0.4, 0, 0], [0.8, 0.2, 0, 0], [1, 0, 0, 0]]
    result = edited(_skinned(weights, joints=joints), [0], [SURFACE])
    assert values(result, "JOINTS_0")[4].tolist() == [0, 4, 2, 3]
    np.testing.assert_allclose(values(result, "WEIGHTS_0")[4], np.array([9, 8, 6, 4]) / 27, rtol=1e-6)


@pytest.mark.parametrize("dtype", ["u1", "<u2"])
def test_integer_weights_keep_their_type_and_sum_exactly(dtype: str) -> None:
    maximum = np.iinfo(dtype).max
    third = maximum // 3
    weights = [[maximum, 0, 0, 0], [third, maximum - third, 0, 0], [1, 2, 3, maximum - 6], [0, 0, maximum, 0]]
    document = _skinned(weights, dtype)
    result = edited(document, [0, 1], [CAP, WALL], lift=0.5)
    stored = read_accessor(result, primitives_of(result)[0]["attributes"]["WEIGHTS_0"])
    assert stored.dtype == np.dtype(dtype)
    assert (stored.sum(axis=1, dtype=np.int64) == maximum).all()
    scene = flatten(document)
    edit = centroid_split(scene, [0, 1], [CAP, WALL], lift=0.5)
    assert _world_of_new_corners(scene, edit, Document.from_glb(write(scene, edit, [Style()]))) < 1e-5


def test_walls_at_an_untouched_vertex_follow_its_bones_to_the_last_bit() -> None:
    weights = np.array([[0.1, 0.2, 0.3, 0.4], [0.3, 0.3, 0.3, 0.1], [0.7, 0.1, 0.1, 0.1], [0.6, 0.2, 0.1, 0.1]])
    result = edited(_skinned(weights), [1], [WALL])
    surface = flatten(result).surface
    welded = surface.weld[surface.faces]
    edges = np.sort(welded[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 1).sum() == 4  # the quad's own boundary


def _morphing(sparse: bool) -> Document:
    builder = Builder()
    primitive = builder.primitive(QUAD, QUAD_FACES, NORMAL=builder.accessor(NORMALS))
    moved = builder.accessor([[0, 0, 0], [0, 0, 0], [0, 0, 3], [0, 0, 0]])
    if sparse:
        builder.json["accessors"][moved] |= {
            "sparse": {
                "count": 1,
                "indices": {"bufferView": builder.view(bytes([2])), "componentType": 5121},
                "values": {"bufferView": builder.view(np.array([0, 0, 3], "<f4").tobytes())},
            }
        }
        del builder.json["accessors"][moved]["bufferView"]
    turned = builder.accessor(np.outer([0, 0, 1, 0], [0.5, 0, -0.1]))
    primitive["targets"] = [{"POSITION": moved, "NORMAL": turned}, {"POSITION": builder.accessor(np.negative(QUAD))}]
    return builder.document(meshes=[{"primitives": [primitive], "weights": [0.5, 0]}])


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("color", [None, "#ff0000"])
def test_morph_targets_reach_the_new_vertices_of_every_primitive(sparse: bool, lit: bool, color: str | None) -> None:
    document = _morphing(sparse)
    if lit:
        document.json["materials"] = [{"emissiveFactor": [0.1, 0.1, 0.1]}]
        primitives_of(document)[0]["material"] = 0
    scene = flatten(document)
    edit = centroid_split(scene, [0, 1], [SURFACE, CAP], lift=0.0)
    result = edited(document, [0, 1], [SURFACE, CAP], color=color)
    assert [len(primitive["targets"]) for primitive in primitives_of(result)] == [2] * (2 if lit and color else 1)
    moved = [read_accessor(result, part["targets"][0]["POSITION"]) for part in primitives_of(result)]
    centroids = np.concatenate([delta[(delta != 0).any(axis=1) & (delta[:, 2] < 3)] for delta in moved])
    np.testing.assert_allclose(centroids, [[0, 0, 1]] * 2, atol=1e-6)
    first = result.json["accessors"][primitives_of(result)[0]["targets"][0]["POSITION"]]
    assert ("sparse" in first) == sparse
    assert _world_of_new_corners(scene, edit, Document.from_glb(write(scene, edit, [Style()]))) < 1e-6


def test_normals_of_walls_turn_with_a_morph_target() -> None:
    result = edited(_morphing(False), [0], [WALL], lift=20.0)
    faces = indices(result)[1:]
    target = primitives_of(result)[0]["targets"][0]
    positions = values(result, "POSITION") + read_accessor(result, target["POSITION"])
    normals = values(result, "NORMAL") + read_accessor(result, target["NORMAL"])
    cross = np.cross(positions[faces[:, 1]] - positions[faces[:, 0]], positions[faces[:, 2]] - positions[faces[:, 0]])
    flat = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-5)


@pytest.mark.parametrize("node", [1, -1])
@pytest.mark.parametrize("bone", [1, -1])
def test_walls_on_a_skin_are_shaded_from_their_front_whatever_mirrors_it(node: int, bone: int) -> None:
    document = _skinned([[1, 0, 0, 0]] * 4, joints=[[0, 0, 0, 0]] * 4)
    document.json["nodes"][0]["scale"] = [node, 1, 1]
    document.json["nodes"][1]["scale"] = [bone, 1, 1]
    scene = flatten(document)
    edit = centroid_split(scene, [0, 1], [WALL, WALL], lift=1.0)
    written = scene_of(write(scene, edit, [Style()]))
    normals = values(written.document, "NORMAL")[written.primitives[0].triangles] * (bone, 1, 1)
    assert (np.einsum("fi,fci->fc", written.surface.normals, normals) > 0.8).all()
