from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.analysis.motion import turns
from core.gltf.document import Document
from core.gltf.scene import Scene, flatten
from tests.core.gltf.builder import Builder, grid


def about_z(degrees: float) -> list[float]:
    return [0.0, 0.0, float(np.sin(np.radians(degrees) / 2)), float(np.cos(np.radians(degrees) / 2))]


def turning(builder: Builder, node: int, degrees: float, interpolation: str = "LINEAR") -> dict[str, Any]:
    """An animation that turns a node about z and back again."""
    values = np.array([about_z(0), about_z(degrees), about_z(0)], dtype=np.float32)
    if interpolation == "CUBICSPLINE":
        values = np.stack([np.zeros_like(values), values, np.zeros_like(values)], axis=1).reshape(-1, 4)
    sampler = {
        "input": builder.accessor(np.array([0.0, 1.0, 2.0], dtype=np.float32)),
        "output": builder.accessor(values),
        "interpolation": interpolation,
    }
    return {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": node, "path": "rotation"}}]}


def chain(*animations: dict[str, Any], builder: Builder) -> Document:
    """Three nodes below each other, the first drawing a sheet; the second has a rotation of its own."""
    positions, faces = grid(2)
    return builder.document(
        meshes=[{"primitives": [builder.primitive(positions, faces)]}],
        nodes=[{"mesh": 0, "children": [1]}, {"rotation": about_z(30), "children": [2]}, {}],
        scenes=[{"nodes": [0]}],
        animations=list(animations),
    )


def angles(document: Document) -> list[float] | None:
    """Degrees between the first node and the second, and between the second and the third."""
    scene: Scene = flatten(document)
    found = turns(scene, np.arange(3))
    return None if found is None else [float(np.degrees(found[a, a + 1])) for a in range(2)]


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_a_node_turns_against_the_one_above_it_and_takes_along_those_below(interpolation: str) -> None:
    builder = Builder()
    found = angles(chain(turning(builder, 1, 90, interpolation), builder=builder))
    assert found == pytest.approx([60, 0], abs=5), "from the 30 degrees of the pose in which it is drawn"


@given(degrees=st.floats(1, 170))
def test_what_counts_is_the_pose_that_turns_them_furthest(degrees: float) -> None:
    builder = Builder()
    found = angles(chain(turning(builder, 2, degrees / 2), turning(builder, 2, degrees), builder=builder))
    assert found is not None
    assert 0.85 * degrees < found[1] <= degrees + 0.1


def test_quaternions_on_the_other_side_are_the_same_turns() -> None:
    builder = Builder()
    animation = turning(builder, 2, 40)
    values = np.array([about_z(0), about_z(40), about_z(0)], dtype=np.float32) * np.array([[1], [-1], [1]], np.float32)
    animation["samplers"][0]["output"] = builder.accessor(values)
    assert angles(chain(animation, builder=builder)) == pytest.approx([0, 40], abs=4)


def test_without_an_animation_nothing_is_known() -> None:
    assert angles(chain(builder=Builder())) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda animation: animation["channels"][0]["target"].pop("node"),
        lambda animation: animation["channels"][0]["target"].update(node=99),
        lambda animation: animation["channels"][0]["target"].update(path="scale"),
        lambda animation: animation["channels"][0].update(sampler=7),
        lambda animation: animation["channels"].append("no channel"),
        lambda animation: animation["samplers"][0].update(output=animation["samplers"][0]["input"]),
    ],
)
def test_channels_that_turn_nothing_or_are_not_well_formed_move_nothing(change: Any) -> None:
    builder = Builder()
    animation, other = turning(builder, 1, 90), turning(builder, 2, 50)
    change(animation)
    other["channels"] += animation["channels"][1:]
    assert angles(chain(animation, other, builder=builder)) in (
        [0, pytest.approx(50, abs=4)],
        [pytest.approx(60, abs=5), pytest.approx(50, abs=4)],
    )
