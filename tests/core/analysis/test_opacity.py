"""Where a square with a picture on it is opaque."""

from typing import Any

import numpy as np
import pytest

from core.analysis.opacity import opacity
from core.gltf.scene import Scene, scene_of
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, png

WINDOW = [[(90, 90, 90, 255), (90, 90, 90, 40)]]  # the right half is glass


def _wall(pixels: Any = WINDOW, mode: str = "BLEND") -> Scene:
    writer = GlbWriter()
    reference = {"index": writer.image_texture(png(pixels), magFilter=9728)}
    material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": reference}}
    writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material)
    writer.mesh(QUAD - (0, 0, 1), QUAD_FACES)
    return scene_of(writer.bytes())


@pytest.mark.parametrize("mode", ["BLEND", "MASK"])
def test_the_opaque_half_of_a_wall_is_told_from_its_window(mode: str) -> None:
    wall = _wall(mode=mode)
    asked = opacity(wall, wall.surface, np.ones(4, dtype=bool))
    assert asked is not None
    z = wall.surface.positions[0, 2]
    points = np.array([[-9.0, -12, z], [9.0, -12, z], [-9.0, 12, z], [9.0, 12, z], [9.0, 12, -z]])
    assert asked(points, np.array([0, 0, 1, 1, 3])).tolist() == [True, False, True, False, True]


def test_there_is_nothing_to_ask_where_all_that_is_meant_is_opaque() -> None:
    wall = _wall()
    assert opacity(wall, wall.surface, np.arange(4) >= 2) is None
    plain = _wall([[(90, 90, 90, 255)]])
    assert opacity(plain, plain.surface, np.ones(4, dtype=bool)) is None
