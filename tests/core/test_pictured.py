"""Marks on made-up documents, and pictures of them as a viewer draws them: fronts only, unless a material has two.

Mirrors, shears, windings, sides, alpha and light are drawn by chance. Every mark that is reported must change the
picture where it is looked at head-on. The same file with all its triangles turned shows which marks a viewer does not
draw; there the judge of the suite and the picture must agree.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.choices import Evaluate
from core.errors import MeshmarkError
from core.geometry.directions import EYE_DISTANCE
from core.gltf.document import Document
from core.gltf.scene import scene_of
from core.parameters import Parameters
from core.pipeline import watermark
from core.rendering.renderer import Frame, Renderer
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder
from tests.drawn import undrawn
from tests.glb_file import GlbFile, Json

ASKED = Parameters(text="HOLD", count=2, size=2.0, color="#e00000", evaluate=Evaluate.NONE)
SIZE = 192
CHANGED = 24  # of 255, in some channel
LEAST = 0.04  # of the pixels that a mark's box takes up


@dataclass(frozen=True)
class Part:
    """A box that a node draws below another one.

    Attributes:
        scale, above: of the node and of the one above it; where that one is uneven, the turn between them shears.
        turn: about z, radians.
        inwards: its triangles face inwards.
        material: of the glTF.
    """

    scale: tuple[float, float, float]
    above: tuple[float, float, float]
    turn: float
    inwards: bool
    material: Json


sides = st.sampled_from([0.5, 0.8, 1.0, -0.7, -1.0])
scales = st.tuples(sides, sides, sides)


@st.composite
def materials(draw: st.DrawFn) -> Json:
    mode = draw(st.sampled_from(["OPAQUE", "OPAQUE", "BLEND", "MASK"]))
    alpha = draw(st.sampled_from([1.0, 0.95, 0.3, 0.0]))
    surface = {"baseColorFactor": [0.6, 0.6, 0.65, alpha], "metallicFactor": 0.0}
    extra: Json = {"extensions": {"KHR_materials_unlit": {}}} if draw(st.booleans()) else {}
    return {"alphaMode": mode, "doubleSided": draw(st.booleans()), "pbrMetallicRoughness": surface, **extra}


def visible(part: Part) -> bool:
    """Whether a viewer draws anything of it."""
    alpha = part.material["pbrMetallicRoughness"]["baseColorFactor"][3]
    seen = {"OPAQUE": True, "BLEND": alpha > 0, "MASK": alpha >= 0.5}
    return bool(seen[part.material["alphaMode"]])


parts = st.builds(Part, scales, scales, st.floats(0, 3), st.booleans(), materials())


def document(shown: list[Part]) -> Document:
    builder = Builder()
    nodes: list[Json] = []
    meshes = []
    for number, part in enumerate(shown):
        faces = np.array(CUBE_FACES).reshape(-1, 3)[:, :: -1 if part.inwards else 1]
        meshes.append({"primitives": [{**builder.primitive(CUBE, faces), "material": number}]})
        turned = [0, 0, float(np.sin(part.turn / 2)), float(np.cos(part.turn / 2))]
        nodes.append({"scale": list(part.above), "translation": [4.0 * number, 0, 0], "children": [2 * number + 1]})
        nodes.append({"mesh": number, "rotation": turned, "scale": list(part.scale)})
    unlit = any("extensions" in part.material for part in shown)
    return builder.document(
        meshes=meshes,
        nodes=nodes,
        scenes=[{"nodes": list(range(0, len(nodes), 2))}],
        materials=[part.material for part in shown],
        **({"extensionsUsed": ["KHR_materials_unlit"]} if unlit else {}),
    )


def turned(glb: bytes) -> bytes:
    """The file with every triangle the other way round."""
    document = Document.from_glb(glb)
    binary = bytearray(document.binary)
    for number in {primitive["indices"] for primitive in GlbFile(glb).primitives()}:
        entry = document.json["accessors"][number]
        view = document.json["bufferViews"][entry["bufferView"]]
        kind = {5121: "<u1", 5123: "<u2", 5125: "<u4"}[entry["componentType"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        rows = np.frombuffer(binary, kind, entry["count"], start).reshape(-1, 3)[:, ::-1].copy()
        binary[start : start + rows.nbytes] = rows.tobytes()
    return Document(document.json, bytes(binary)).to_glb()


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(SIZE) as renderer:
        yield renderer


def head_on(renderer: Renderer, glb: bytes, mark: Json) -> NDArray[np.int16]:
    """A mark in the middle of the picture; what stands between it and the camera is cut away."""
    surface = scene_of(glb).surface
    x, y, z = ((np.array(mark["center"]) - surface.offset) * surface.scale).tolist()
    renderer.load(scene_of(glb), Frame((x, y, z), float(np.hypot(*mark["size"][:2])) / 2 * surface.scale))
    camera: Any = renderer._camera.camera
    camera.znear = EYE_DISTANCE - max(mark["size"][2], 4 * mark["relief"]) * surface.scale
    return renderer.render(mark["normal"], mark["up"]).astype(np.int16)


def share_changed(renderer: Renderer, before: bytes, after: bytes, mark: Json) -> float:
    """Of the pixels within a mark's box, the share that the mark changed."""
    pair = [head_on(renderer, glb, mark) for glb in (before, after)]
    width, height = np.array(mark["size"][:2]) / np.hypot(*mark["size"][:2]) * SIZE / 2 / 1.03
    middle = SIZE // 2
    rows = slice(int(middle - height), int(middle + height) + 1)
    columns = slice(int(middle - width), int(middle + width) + 1)
    return float((np.abs(pair[1] - pair[0])[rows, columns].max(axis=2) > CHANGED).mean())


def warned_or_refused(data: bytes) -> bool:
    try:
        notices = watermark(data, ASKED, preview=False).report["warnings"]
    except MeshmarkError:
        return True
    return "see_through_surface" in [notice["code"] for notice in notices]


@settings(max_examples=6)
@given(st.lists(parts, min_size=1, max_size=2))
def test_every_mark_that_is_reported_shows_head_on_and_the_judge_agrees_with_the_picture(
    renderer: Renderer, shown: list[Part]
) -> None:
    data = document(shown).to_glb()
    if not any(map(visible, shown)):
        assert warned_or_refused(data)
        return
    result = watermark(data, ASKED, preview=False)
    marks = result.report["watermarks"]
    assert marks
    assert undrawn(result.model, marks, data) == []
    for mark in marks:
        assert share_changed(renderer, data, result.model, mark) > LEAST
    before, after = turned(data), turned(result.model)
    missing = undrawn(after, marks, before)
    for mark in marks:
        assert (share_changed(renderer, before, after, mark) > LEAST) == (mark["id"] not in missing)
