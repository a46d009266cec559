import numpy as np
import pytest

from core.analysis.skinning import SkinDeformation, skin_deformation
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.analysis.test_motion import turning
from tests.core.gltf.builder import Builder, grid


def made(weights: list[tuple[float, float]], torn: float = 1.0) -> SkinDeformation:
    """SurfaceSamples along x on a plane, each moved by two joints."""
    points = np.column_stack([np.linspace(-4, 4, len(weights)), np.zeros(len(weights)), np.zeros(len(weights))])
    normals, joints = np.tile([0.0, 0.0, 1.0], (len(weights), 1)), np.tile([3, 7], (len(weights), 1))
    pair = np.array([[0.0, torn], [torn, 0.0]])
    return SkinDeformation(points, normals, joints, np.array(weights), np.array([3, 7]), pair)


def under(found: SkinDeformation) -> float:
    return float(
        found.under(found.pairs_in_boxes(Boxes(np.zeros((1, 3)), np.eye(3)[None], np.array([[10.0, 1.0, 1.0]]))))[0]
    )


def test_text_that_follows_one_joint_is_free_of_joints() -> None:
    assert under(made([(1.0, 0.0)] * 40)) == 0


@pytest.mark.parametrize("weights", [[(1.0, 0.0)] * 20 + [(0.0, 1.0)] * 20, [(0.5, 0.5)] * 40], ids=["split", "shared"])
def test_text_that_two_joints_share_counts_half_whichever_way_they_do(weights: list[tuple[float, float]]) -> None:
    assert under(made(weights)) == pytest.approx(0.5)


def test_joints_that_hardly_turn_against_each_other_count_less() -> None:
    assert under(made([(0.5, 0.5)] * 40, torn=0.2)) == pytest.approx(0.1)


def test_no_boxes_have_no_articulation() -> None:
    found = made([(0.5, 0.5)] * 40)
    assert len(found.under(found.pairs_in_boxes(Boxes.empty()))) == 0


def an_arm(degrees: float | None = None) -> Document:
    """A sheet along x from -3 to 3; its left half follows one bone, its right half another, the middle both. An
    animation turns the right one by ``degrees``."""
    positions, faces = grid(6)
    positions = positions - np.array([3, 3, 0], dtype=np.float32)
    right = np.clip(positions[:, 0] + 0.5, 0, 1)
    builder = Builder()
    primitive = builder.primitive(
        positions,
        faces,
        JOINTS_0=builder.accessor(np.tile([0, 1, 0, 0], (len(positions), 1)), "<u1"),
        WEIGHTS_0=builder.accessor(np.column_stack([1 - right, right, 0 * right, 0 * right])),
    )
    moving = {} if degrees is None else {"animations": [turning(builder, 2, degrees)]}
    return builder.document(
        **moving,
        meshes=[
            {"primitives": [primitive]},
            {"primitives": [builder.primitive(positions + np.array([0, 20, 0], np.float32), faces)]},
        ],
        nodes=[{"mesh": 0, "skin": 0}, {}, {}, {"mesh": 1}],
        scenes=[{"nodes": [0, 1, 2, 3]}],
        skins=[{"joints": [1, 2]}],
    )


def test_the_elbow_of_an_arm_is_shared_and_its_ends_and_what_has_no_skin_are_not() -> None:
    scene = flatten(an_arm())
    points, face = sample(scene.surface, 4000, np.random.default_rng(0))
    found = skin_deformation(scene, scene.surface, points, face)
    assert found is not None
    assert found.weights.sum(axis=1) == pytest.approx(1)
    world = scene.surface.to_world(points)
    total = [np.where(found.joints == node, found.weights, 0).sum(axis=1) for node in range(4)]
    shared = 1 - np.square(total).sum(axis=0)
    arm = world[:, 1] < 10
    assert shared[arm & (np.abs(world[:, 0]) > 1.1)] == pytest.approx(0, abs=1e-9)
    assert shared[arm & (np.abs(world[:, 0]) < 0.1)] == pytest.approx(0.5, abs=0.02)
    assert shared[~arm] == pytest.approx(0)


@pytest.mark.parametrize(("degrees", "torn"), [(None, 0.5), (0.0, 0.2), (45.0, 0.5), (170.0, 1.0)])
def test_an_elbow_tears_text_as_far_as_the_animations_turn_it(degrees: float | None, torn: float) -> None:
    scene = flatten(an_arm(degrees))
    points, face = sample(scene.surface, 1000, np.random.default_rng(0))
    found = skin_deformation(scene, scene.surface, points, face)
    assert found is not None
    one, other = np.searchsorted(found.nodes, [1, 2])
    assert found.torn[one, other] == pytest.approx(torn, abs=0.01)
    assert (found.torn == found.torn.T).all()


def test_an_asset_without_a_skin_has_no_joints() -> None:
    positions, faces = grid(2)
    builder = Builder()
    scene = flatten(builder.document(meshes=[{"primitives": [builder.primitive(positions, faces)]}]))
    points, face = sample(scene.surface, 100, np.random.default_rng(0))
    assert skin_deformation(scene, scene.surface, points, face) is None
