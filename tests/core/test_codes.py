"""QR codes are decoded from pictures of the marked asset, on light ground and on dark ground."""

import cv2
import numpy as np
import pytest
import trimesh

from core.gltf.scene import scene_of
from core.parameters import Parameters
from core.pipeline import watermark
from core.rendering.renderer import Frame, Renderer
from tests.core.rendering.glb import GlbWriter, plain

ADDRESS = "https://shop.example/4711"


def plate(grey: float) -> bytes:
    """A GLB with a plate of 30 x 24 in one colour."""
    box = trimesh.creation.box(extents=(30.0, 24.0, 2.0))
    return GlbWriter().mesh(box.vertices, box.faces, material=plain((grey, grey, grey, 1.0))).bytes()


@pytest.mark.parametrize("text", ["", "4711"], ids=["alone", "beside a text"])
@pytest.mark.parametrize("grey", [0.9, 0.01], ids=["light", "dark"])
def test_a_code_is_decoded_from_the_front(grey: float, text: str) -> None:
    asked = Parameters.model_validate({"qr": ADDRESS, "text": text, "count": 1, "evaluate": "none"})
    result = watermark(plate(grey), asked, preview=False)
    (mark,) = result.report["watermarks"]
    assert result.report["warnings"] == []
    scene = scene_of(result.model)
    x, y, z = ((np.array(mark["center"]) - scene.surface.offset) * scene.surface.scale).tolist()
    with Renderer(1024) as renderer:
        renderer.load(scene, Frame((x, y, z), 0.7 * mark["size"][0] * scene.surface.scale))
        front = renderer.render(mark["normal"], mark["up"])
    assert cv2.QRCodeDetector().detectAndDecode(front)[0] == ADDRESS
