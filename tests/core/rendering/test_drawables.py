"""Parts of an asset that look alike are drawn at once, and the picture does not show it."""

from typing import Any

import numpy as np
import pytest

from core.gltf.scene import Scene, scene_of
from core.rendering.drawables import drawables
from core.rendering.renderer import Renderer
from tests.core.rendering.glb import CORNERS, CUBE_FACES, QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png
from tests.core.rendering.shots import FOUR_COLORS, FRONT, UP

RED, BLUE = (1.0, 0.0, 0.0, 0.5), (0.0, 0.0, 1.0, 0.5)
CLEAR: dict[str, Any] = {"alphaMode": "MASK", "alphaCutoff": 0.1}  # what is opaque all over looks no other with it


def cubes(*materials: dict[str, Any]) -> Scene:
    """Cubes that touch and hide one another in part, each with a material of its own."""
    writer = GlbWriter()
    for place, material in enumerate(materials):
        writer.mesh(CORNERS + np.array([place, 0.4 * place, -0.7 * place]), CUBE_FACES, material=material)
    return scene_of(writer.bytes())


def panes(*colors: tuple[float, float, float, float]) -> Scene:
    """Panes of coloured glass, each before the one before it."""
    writer = GlbWriter()
    for place, color in enumerate(colors):
        material = plain(color, alphaMode="BLEND", doubleSided=True)
        writer.mesh(QUAD + np.array([0, 0, 0.1 * place]), QUAD_FACES, material=material)
    return scene_of(writer.bytes())


def test_parts_with_equal_materials_are_drawn_at_once_and_look_the_same(renderer: Renderer) -> None:
    together, apart = cubes(*[plain((0.3, 0.6, 0.9, 1))] * 40), cubes(*[plain((0.3, 0.6, 0.9, 1))] * 39)
    assert len(drawables(together, 64)) == len(drawables(apart, 64)) == 1
    together, apart = (
        cubes(*[plain((0.3, 0.6, 0.9, 1)), plain((0.3, 0.6, 0.9, 1), **other)] * 3) for other in ({}, CLEAR)
    )
    assert [len(drawables(scene, 64)) for scene in (together, apart)] == [1, 2]
    shown = []
    for scene in (together, apart):
        renderer.load(scene)
        shown.append(renderer.render((1, 2, 3), UP))
    np.testing.assert_array_equal(shown[0], shown[1])


def test_glass_keeps_its_order(renderer: Renderer) -> None:
    assert [len(drawables(panes(*colors), 64)) for colors in ((RED, RED, BLUE), (RED, BLUE, RED))] == [2, 3]
    middle = []
    for colors in ((RED, RED, BLUE), (BLUE, RED, RED)):
        renderer.load(panes(*colors))
        middle.append(renderer.render(FRONT, UP)[renderer.size // 2, renderer.size // 2].tolist())
    assert middle[0][2] > middle[0][0]
    assert middle[1][0] > middle[1][2]


@pytest.mark.parametrize("image", [True, False])
def test_parts_without_coordinates_are_not_joined_with_textured_ones(image: bool) -> None:
    writer = GlbWriter()
    texture = {"index": writer.image_texture(png(FOUR_COLORS))}
    material = {"pbrMetallicRoughness": {"baseColorTexture": texture}} if image else plain((1, 1, 1, 1))
    for place, attributes in enumerate(({"TEXCOORD_0": QUAD_UV}, {}, {"TEXCOORD_0": QUAD_UV})):
        writer.mesh(QUAD + np.array([place, 0, 0]), QUAD_FACES, attributes, material)
    shown = drawables(scene_of(writer.bytes()), 64)
    assert [len(one.faces) for one in shown] == ([4, 2] if image else [6])
