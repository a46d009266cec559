"""What is said of the parts of an asset that carry no mark: a product on a stage, only the stage marked."""

from typing import Any

import numpy as np

from core.asset.flatten import flatten
from core.asset.gltf import Document
from core.embossing.unmarked import unmarked_parts
from core.ground.ground import survey
from core.ground.saliency import saliency
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain


def _said(writer: GlbWriter, *marked: int) -> dict[str, str] | None:
    scene = flatten(Document.from_glb(writer.bytes()))
    ground = survey(scene)
    samples = saliency(ground.surface, 0)
    return unmarked_parts(scene, ground.surface, samples, ground.index, np.array(marked, dtype=np.int64))


def _scene(*parts: tuple[float, dict[str, Any]]) -> GlbWriter:
    """Cubes of these sizes beside each other."""
    writer = GlbWriter()
    for number, (size, node) in enumerate(parts):
        writer.mesh(CORNERS * size, CUBE_FACES, translation=[4.0 * number, 0, 0], **node)
    return writer


def test_a_product_without_a_mark_is_named_with_the_share_that_is_seen_of_it() -> None:
    writer = _scene((1.0, {"name": "stage"}), (1.0, {"name": "robot"}), (0.1, {}))
    said = _said(writer, 0)
    assert said is not None
    assert said["code"] == "unmarked_parts"
    assert "'robot' (" in said["message"]
    assert "nodes[2]" in said["message"]
    assert "stage" not in said["message"]


def test_small_parts_without_a_mark_are_no_matter() -> None:
    assert _said(_scene((1.0, {}), (0.2, {}), (0.2, {})), 0) is None


def test_what_nobody_sees_needs_no_mark() -> None:
    writer = GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 0.9, CUBE_FACES)
    assert _said(writer, 0) is None
    said = _said(writer, 1)
    assert said is not None
    assert "nodes[0] (100%)" in said["message"]


def test_of_one_node_the_materials_are_named() -> None:
    writer = _scene((1.0, {}), (1.0, {}))
    writer.json["meshes"] = [{"primitives": [mesh["primitives"][0] for mesh in writer.json["meshes"]]}]
    writer.json["meshes"][0]["primitives"][0]["material"] = writer.add("materials", plain((1, 0, 0, 1), name="skin"))
    moved = writer.accessor((CORNERS + np.array([4, 0, 0])).astype(np.float32))
    writer.json["meshes"][0]["primitives"][1] |= {
        "attributes": {"POSITION": moved},
        "material": writer.add("materials", plain((0, 1, 0, 1), name="cloth")),
    }
    writer.json["nodes"], writer.json["scenes"] = [{"mesh": 0}], [{"nodes": [0]}]
    said = _said(writer, 0)
    assert said is not None
    assert "'cloth' (" in said["message"]
    assert "skin" not in said["message"]


def test_glass_needs_no_mark() -> None:
    glass = plain((1, 1, 1, 0.2), alphaMode="BLEND")
    assert _said(GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 2, CUBE_FACES, material=glass), 0) is None
