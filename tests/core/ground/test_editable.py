from typing import Any

import pytest

from core.asset.flatten import Scene, flatten
from core.ground.editable import editable
from tests.core.asset.builder import CUBE, CUBE_FACES, Builder


def _scene(material: dict[str, Any] | None = None, **node: Any) -> Scene:
    """A plain cube, and one that is made and drawn as told, under a node of its own."""
    builder = Builder()
    plain, other = builder.primitive(CUBE, CUBE_FACES), builder.primitive(CUBE, CUBE_FACES)
    other["material"] = 0
    return flatten(
        builder.document(
            meshes=[{"primitives": [plain]}, {"primitives": [other]}],
            materials=[material or {}],
            nodes=[{"mesh": 0}, {"children": [2], **node}, {"mesh": 1}],
            scenes=[{"nodes": [0, 1]}],
        )
    )


def test_opaque_parts_are_places() -> None:
    found = editable(_scene({"alphaMode": "OPAQUE"}))
    assert found.solid.all()
    assert found.shown.all()


def test_glass_is_a_place() -> None:
    assert editable(_scene({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}})).solid.all()


@pytest.mark.parametrize("material", [{"alphaMode": "MASK"}, {"alphaMode": "BLEND"}], ids=["masked", "blended"])
def test_what_is_seen_through_is_a_last_resort(material: dict[str, Any]) -> None:
    found = editable(_scene(material))
    assert found.solid.tolist() == [True] * 12 + [False] * 12
    assert found.possible.all()


def test_what_hangs_below_a_hidden_node_is_no_place_and_not_in_the_way() -> None:
    found = editable(_scene(extensions={"KHR_node_visibility": {"visible": False}}))
    assert found.possible.tolist() == found.shown.tolist() == [True] * 12 + [False] * 12


def test_a_flattened_part_is_no_place() -> None:
    found = editable(_scene(scale=[1, 0, 1]))
    assert found.possible.tolist() == [True] * 12 + [False] * 12
