"""The judge of what is drawn tells what is culled, clear, hidden or covered from what is seen."""

from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from core.gltf.document import Document
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.drawn import undrawn

MARK = {"id": 7, "center": [0.5, 0.5, 0], "up": [0, 1, 0], "normal": [0, 0, 1], "size": [0.8, 0.5, 0.1], "relief": 0.02}
BACK = [0, 2, 1, 0, 3, 2]
HIDDEN = {"KHR_node_visibility": {"visible": False}}


def quad(
    faces: list[int] = QUAD_FACES, material: dict[str, Any] | None = None, alpha: float | None = None, **node: Any
) -> Document:
    """A square that faces +z, or -z, drawn by one node below another."""
    builder = Builder()
    attributes = {"TEXCOORD_0": builder.accessor(np.array(QUAD)[:, :2])}
    if alpha is not None:
        attributes["COLOR_0"] = builder.accessor(np.tile([1, 1, 1, alpha], (4, 1)))
    primitive = {**builder.primitive(QUAD, faces, **attributes), "material": 0}
    picture = BytesIO()
    Image.new("RGBA", (2, 2), (255, 255, 255, 0)).save(picture, "PNG")
    image = builder.view(picture.getvalue())
    parent = node.pop("parent", {})
    return builder.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[{"children": [1], **parent}, {"mesh": 0, **node}],
        materials=[material or {}],
        images=[{"bufferView": image, "mimeType": "image/png"}],
        textures=[{"source": 0}],
    )


def blend(alpha: float, **more: Any) -> dict[str, Any]:
    return {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}, **more}


def skinned(faces: list[int]) -> Document:
    """The square stands elsewhere, and is brought to its place by its joint."""
    builder = Builder()
    joints = {
        "JOINTS_0": builder.accessor([[0, 0, 0, 0]] * 4, "<u1"),
        "WEIGHTS_0": builder.accessor([[1, 0, 0, 0]] * 4),
    }
    primitive = builder.primitive(np.array([-5, 0, 0]) + QUAD, faces, **joints)
    nodes = [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"translation": [5, 0, 0]}]
    return builder.document(
        meshes=[{"primitives": [primitive]}], nodes=nodes, scenes=[{"nodes": [0, 1]}], skins=[{"joints": [1]}]
    )


def instance(scale: list[float], translation: list[float], faces: list[int] = QUAD_FACES) -> Document:
    builder = Builder()
    primitive = builder.primitive(QUAD, faces)
    places = {"SCALE": builder.accessor([scale]), "TRANSLATION": builder.accessor([translation])}
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    return builder.document(meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0, "extensions": extensions}])


def morphed() -> Document:
    """The square lies behind its place, and its default weight brings it there."""
    builder = Builder()
    primitive = builder.primitive(np.array([0, 0, -3]) + QUAD, QUAD_FACES)
    primitive["targets"] = [{"POSITION": builder.accessor(np.tile([0, 0, 6], (4, 1)))}]
    return builder.document(meshes=[{"primitives": [primitive], "weights": [0.5]}])


DRAWN: dict[str, Callable[[], Document]] = {
    "front": quad,
    "double-sided from behind": lambda: quad(BACK, {"doubleSided": True}),
    "blended but opaque": lambda: quad(material=blend(1.0)),
    "seen through": lambda: quad(material=blend(0.3)),
    "opaque whatever its alpha says": lambda: quad(material=blend(0.0, alphaMode="OPAQUE"), alpha=0.0),
    "mirrored": lambda: quad(scale=[-1, 1, 1], translation=[1, 0, 0]),
    "mirrored above": lambda: quad(parent={"scale": [-1, 1, 1], "translation": [1, 0, 0]}),
    "mirrored twice": lambda: quad(scale=[-1, 1, 1], parent={"scale": [-1, 1, 1]}),
    "mask over its cutoff": lambda: quad(material=blend(0.6, alphaMode="MASK")),
    "skinned": lambda: skinned(QUAD_FACES),
    "instance": lambda: instance([1, 1, 1], [0, 0, 0]),
    "mirrored instance": lambda: instance([-1, 1, 1], [1, 0, 0]),
    "morphed": morphed,
}
UNDRAWN: dict[str, Callable[[], Document]] = {
    "back": lambda: quad(BACK),
    "back of a mirrored one": lambda: quad(BACK, scale=[-1, 1, 1], translation=[1, 0, 0]),
    "turned over by a mirror along its normal": lambda: quad(scale=[1, 1, -1]),
    "clear factor": lambda: quad(material=blend(0.0)),
    "clear vertex colours": lambda: quad(material=blend(1.0), alpha=0.0),
    "clear texture": lambda: quad(
        material={"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    ),
    "mask under its cutoff": lambda: quad(material=blend(0.4, alphaMode="MASK")),
    "hidden": lambda: quad(extensions=HIDDEN),
    "hidden above": lambda: quad(parent={"extensions": HIDDEN}),
    "without size": lambda: quad(scale=[0, 0, 0]),
    "elsewhere": lambda: quad(translation=[5, 0, 0]),
    "back of a skinned one": lambda: skinned(BACK),
    "back of an instance": lambda: instance([1, 1, 1], [0, 0, 0], BACK),
    "back of a mirrored instance": lambda: instance([-1, 1, 1], [1, 0, 0], BACK),
}


@pytest.mark.parametrize("name", DRAWN)
def test_what_a_viewer_draws_counts_as_drawn(name: str) -> None:
    assert undrawn(DRAWN[name]().to_glb(), [MARK]) == []


@pytest.mark.parametrize("name", UNDRAWN)
def test_what_no_viewer_draws_does_not(name: str) -> None:
    assert undrawn(UNDRAWN[name]().to_glb(), [MARK]) == [7]


@pytest.mark.parametrize("front", [True, False])
def test_what_lies_behind_something_drawn_is_not_seen_and_the_back_of_a_hull_hides_nothing(front: bool) -> None:
    """Letters just under a sheet of the asset itself: its front hides them, its back does not."""
    sheet = np.array([0, 0, 0.03]) + QUAD
    builder = Builder()
    over = builder.primitive(sheet, QUAD_FACES if front else BACK)
    before = builder.document(meshes=[{"primitives": [over]}]).to_glb()
    builder = Builder()
    both = [builder.primitive(sheet, QUAD_FACES if front else BACK), builder.primitive(QUAD, QUAD_FACES)]
    after = builder.document(meshes=[{"primitives": both}]).to_glb()
    assert undrawn(after, [MARK], before) == ([7] if front else [])
