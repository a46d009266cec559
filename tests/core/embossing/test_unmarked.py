"""What is said of the parts of an asset that carry no mark: a product on a stage, only the stage marked."""

from typing import Any

import numpy as np

from core.analysis.analyse import analyse
from core.analysis.saliency import saliency
from core.embossing.unmarked import unmarked_parts
from core.gltf.scene import scene_of
from core.notices import Notice
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain


def _said(writer: GlbWriter, *marked: int) -> Notice | None:
    scene = scene_of(writer.bytes())
    ground = analyse(scene)
    samples = saliency(ground.surface, 0)
    return unmarked_parts(scene, ground.surface, samples, ground.index, np.array(marked, dtype=np.int64))


def _scene(*parts: tuple[float, dict[str, Any]]) -> GlbWriter:
    """Cubes of these sizes beside each other."""
    writer = GlbWriter()
    for number, (size, node) in enumerate(parts):
        writer.mesh(CORNERS * size, CUBE_FACES, translation=[4.0 * number, 0, 0], **node)
    return writer


STAGE = (1.0, {"name": "stage"})


def test_products_without_a_mark_are_named_where_only_their_stage_has_some() -> None:
    said = _said(_scene(STAGE, (0.8, {"name": "robot"}), (0.7, {}), (0.7, {}), (0.1, {"name": "screw"})), 0, 0)
    assert said is not None
    assert said.code == "unmarked_parts"
    assert said.message.index("'robot' (") < said.message.index("nodes[2] (")
    assert "stage" not in said.message


def test_marks_on_several_parts_or_one_on_each_are_as_many_as_one_can_ask_for() -> None:
    products: list[tuple[float, dict[str, Any]]] = [(0.8, {})] * 4
    assert _said(_scene(STAGE, *products), 0) is None
    assert _said(_scene(STAGE, *products), 0, 0, 1, 1, 2, 2) is None


def test_small_parts_without_a_mark_are_no_matter() -> None:
    assert _said(_scene(STAGE, *[(0.15, {})] * 5), 0, 0) is None


def test_what_nobody_sees_and_what_is_glass_needs_no_mark() -> None:
    glass = plain((1, 1, 1, 0.2), alphaMode="BLEND")
    writer = GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 2, CUBE_FACES, material=glass)
    for size in (0.6, 0.7, 0.8, 0.9):
        writer.mesh(CORNERS * size, CUBE_FACES)
    assert _said(writer, 0, 0) is None


def test_of_one_node_the_materials_are_named() -> None:
    writer = _scene(*[(1.0, {})] * 4)
    primitives = [mesh["primitives"][0] for mesh in writer.json["meshes"]]
    for number, primitive in enumerate(primitives):
        moved = (CORNERS + np.array([4 * number, 0, 0])).astype(np.float32)
        primitive["attributes"] = {"POSITION": writer.accessor(moved)}
        primitive["material"] = writer.add("materials", plain((1, 0, 0, 1), name=f"cloth {number}"))
    writer.json |= {"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0}]}
    writer.json["scenes"] = [{"nodes": [0]}]
    said = _said(writer, 2, 2)
    assert said is not None
    assert all(f"'cloth {number}' (" in said.message for number in (0, 1, 3))
    assert "cloth 2" not in said.message
