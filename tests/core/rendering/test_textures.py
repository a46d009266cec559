"""Textures and colours of vertices in pictures."""

from typing import Any

import numpy as np
import pytest

from core.gltf.scene import scene_of
from core.rendering.renderer import Renderer
from tests.core.gltf.ktx2_samples import ETC1S, UASTC
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png
from tests.core.rendering.shots import BLUE, FOUR_COLORS, GREEN, RED, SIZE, YELLOW, hue, quadrants, shoot


def textured_quad(texture_info: dict[str, Any] | None = None) -> bytes:
    writer = GlbWriter()
    texture = writer.image_texture(png(FOUR_COLORS))
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture, **(texture_info or {})}},
        "doubleSided": True,
    }
    return writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material).bytes()


def test_a_texture_shows_its_texels_the_right_way_up(renderer: Renderer) -> None:
    expected = [hue(np.array(color, dtype=np.uint8)) for color in (RED, GREEN, BLUE, YELLOW)]
    assert quadrants(shoot(renderer, textured_quad())) == expected


def test_seen_from_behind_a_texture_is_mirrored(renderer: Renderer) -> None:
    expected = [hue(np.array(color, dtype=np.uint8)) for color in (GREEN, RED, YELLOW, BLUE)]
    assert quadrants(shoot(renderer, textured_quad(), (0, 0, -1))) == expected


def test_a_texture_transform_moves_and_turns_the_image(renderer: Renderer) -> None:
    moved = {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0.0]}}}
    turned = {"extensions": {"KHR_texture_transform": {"rotation": np.pi / 2, "offset": [0.0, 1.0]}}}
    names = {RED: "red", GREEN: "green", BLUE: "blue", YELLOW: "yellow"}
    by_hue = {hue(np.array(color, dtype=np.uint8)): name for color, name in names.items()}
    assert [by_hue[h] for h in quadrants(shoot(renderer, textured_quad(moved)))] == ["green", "red", "yellow", "blue"]
    # uv' = (v, 1 - u): the upper left corner of the quad shows the lower left one of the image.
    assert [by_hue[h] for h in quadrants(shoot(renderer, textured_quad(turned)))] == ["blue", "red", "yellow", "green"]


def test_the_second_set_of_texture_coordinates_is_used_where_asked_for(renderer: Renderer) -> None:
    writer = GlbWriter()
    texture = writer.image_texture(png(FOUR_COLORS))
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture, "texCoord": 1}}}
    sets = {"TEXCOORD_0": np.zeros_like(QUAD_UV), "TEXCOORD_1": QUAD_UV}
    picture = shoot(renderer, writer.mesh(QUAD, QUAD_FACES, sets, material).bytes())
    assert len(set(quadrants(picture))) == 4


def test_an_image_that_cannot_be_decoded_leaves_the_plain_base_colour(renderer: Renderer) -> None:
    writer = GlbWriter()
    texture = writer.image_texture(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(64))
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1], "baseColorTexture": {"index": texture}}}
    picture = shoot(renderer, writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material).bytes())
    assert set(quadrants(picture)) == {(False, True, False)}


@pytest.mark.parametrize("image", [ETC1S, UASTC], ids=["ETC1S", "UASTC"])
@pytest.mark.parametrize("role", ["baseColorTexture", "emissiveTexture"])
def test_ktx2_textures_are_shown(renderer: Renderer, image: bytes, role: str) -> None:
    writer = GlbWriter()
    source = writer.add("images", {"bufferView": writer.view(image), "mimeType": "image/ktx2"})
    texture = {"index": writer.add("textures", {"extensions": {"KHR_texture_basisu": {"source": source}}})}
    material: dict[str, Any] = plain((0, 0, 0, 1), emissiveFactor=[1, 1, 1], emissiveTexture=texture)
    if role == "baseColorTexture":
        material = {"pbrMetallicRoughness": {role: texture}}
    picture = shoot(renderer, writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material).bytes())
    assert quadrants(picture) == [hue(np.array(color, dtype=np.uint8)) for color in (RED, GREEN, BLUE, YELLOW)]


def test_vertex_colours_are_shown(renderer: Renderer) -> None:
    colors = np.array([[0, 0, 255], [0, 255, 0], [255, 0, 0], [255, 0, 0]], dtype=np.uint8)
    for values in (colors, (colors / 255).astype(np.float32)):
        picture = shoot(renderer, GlbWriter().mesh(QUAD, QUAD_FACES, {"COLOR_0": values}).bytes())
        assert picture[int(SIZE * 0.25), SIZE // 2].argmax() == 0
        assert picture[int(SIZE * 0.72), int(SIZE * 0.28)].argmax() == 2
        assert picture[int(SIZE * 0.72), int(SIZE * 0.72)].argmax() == 1


def test_primitives_that_share_a_texture_draw_it_from_one_copy(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    make = Renderer._texture

    def counted(self: Renderer, texture: Any) -> Any:
        made.append(texture)
        return make(self, texture)

    monkeypatch.setattr(Renderer, "_texture", counted)
    writer = GlbWriter()
    texture = {"index": writer.image_texture(png(FOUR_COLORS))}
    for place in range(5):
        material = {"pbrMetallicRoughness": {"baseColorTexture": texture}, "name": str(place)}
        writer.mesh(QUAD + np.array([place, 0, 0]), QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material)
    renderer.load(scene_of(writer.bytes()))
    assert len(made) == 1
