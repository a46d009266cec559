"""What light makes of a surface: normals, unlit materials, emission."""

from typing import Any

import numpy as np
import pytest

from core.gltf.scene import scene_of
from core.rendering.renderer import Renderer
from tests.core.rendering.glb import CORNERS, CUBE_FACES, QUAD, QUAD_FACES, QUAD_UV, GlbWriter, cube, plain, png
from tests.core.rendering.shots import (
    BLUE,
    FOUR_COLORS,
    FRONT,
    GREEN,
    RED,
    SIZE,
    UP,
    YELLOW,
    hue,
    quadrants,
    shoot,
    shown,
)


def test_a_surface_that_faces_the_camera_keeps_its_colour(renderer: Renderer) -> None:
    srgb = np.array([200, 120, 40])
    factor = (*((srgb / 255) ** 2.2), 1.0)
    middle = shoot(renderer, GlbWriter().mesh(QUAD, QUAD_FACES, material=plain(factor)).bytes())[SIZE // 2, SIZE // 2]
    np.testing.assert_allclose(middle / middle.max(), srgb / srgb.max(), atol=0.02)
    assert 0.8 < middle[0] / srgb[0] <= 1.0


def test_a_cube_without_normals_has_evenly_shaded_faces(renderer: Renderer) -> None:
    picture = shoot(renderer, cube(), (1, 1, 1))
    colors, counts = np.unique(picture[shown(picture)].reshape(-1, 3), axis=0, return_counts=True)
    three = np.sort(counts)[::-1][:3]
    assert three.sum() > 0.85 * counts.sum()  # the rest are edges
    assert len(np.unique(colors[np.argsort(counts)[::-1][:3], 0])) == 3


def test_normals_of_the_file_are_used(renderer: Renderer) -> None:
    """A quad whose normals lean to the light is brighter than one whose normals lean away."""
    bright, dark = (
        shoot(
            renderer,
            GlbWriter()
            .mesh(QUAD, QUAD_FACES, {"NORMAL": np.tile(np.array([x, 0, 0.8], dtype=np.float32), (4, 1))})
            .bytes(),
        )[SIZE // 2, SIZE // 2, 0]
        for x in (-0.6, 0.6)
    )
    assert bright > dark + 30


@pytest.mark.parametrize(
    "node",
    [
        {"scale": [-1, 1, 1]},
        {"scale": [1, 3, 0.5]},
        {"rotation": [0, 0.6, 0, 0.8], "scale": [2, 1, 1]},
        {"matrix": [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 5, 5, 5, 1]},
    ],
)
def test_normals_follow_the_transform_of_their_node(renderer: Renderer, node: dict[str, Any]) -> None:
    """Normals that a file states as the true ones of its faces look the same as none at all."""
    corners = CORNERS[CUBE_FACES]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).repeat(3, axis=0).astype(np.float32)
    faces = np.arange(36).reshape(-1, 3)
    stated = shoot(
        renderer, GlbWriter().mesh(corners.reshape(-1, 3), faces, {"NORMAL": normal}, **node).bytes(), (2, 1, 3)
    )
    flat = shoot(renderer, GlbWriter().mesh(corners.reshape(-1, 3), faces, **node).bytes(), (2, 1, 3))
    assert np.abs(stated.astype(int) - flat).max() <= 3


def test_an_unlit_cube_has_its_one_colour_on_all_sides(renderer: Renderer) -> None:
    srgb = np.array([200, 120, 40])
    material = plain((*((srgb / 255) ** 2.2), 1.0), extensions={"KHR_materials_unlit": {}}, emissiveFactor=[1, 1, 1])
    glb = GlbWriter().mesh(CORNERS, CUBE_FACES, material=material).bytes()
    for direction in ((1, 1, 1), (-1, -2, 0.5)):
        picture = shoot(renderer, glb, direction)
        inside = picture[SIZE // 2 - 20 : SIZE // 2 + 20, SIZE // 2 - 20 : SIZE // 2 + 20]
        np.testing.assert_allclose(inside.reshape(-1, 3), np.tile(srgb, (1600, 1)), atol=1)


def test_a_cube_that_glows_is_seen_though_its_base_is_black(renderer: Renderer) -> None:
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}}
    material = plain((0, 0, 0, 1), emissiveFactor=[0.25, 0, 0], extensions=strength)
    picture = shoot(renderer, GlbWriter().mesh(CORNERS, CUBE_FACES, material=material).bytes(), (1, 1, 1))
    inside = picture[SIZE // 2 - 20 : SIZE // 2 + 20, SIZE // 2 - 20 : SIZE // 2 + 20].reshape(-1, 3)
    np.testing.assert_allclose(inside, np.tile([255 * 0.5 ** (1 / 2.2), 0, 0], (1600, 1)), atol=1)


def test_emission_is_added_to_what_light_shows(renderer: Renderer) -> None:
    lit, both = (
        shoot(
            renderer,
            GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((0.2, 0.2, 0.2, 1), emissiveFactor=glow)).bytes(),
        )[SIZE // 2, SIZE // 2]
        for glow in ([0, 0, 0], [0, 0.3, 0])
    )
    linear = (np.stack([lit, both]) / 255) ** 2.2
    np.testing.assert_allclose(linear[1] - linear[0], [0, 0.3, 0], atol=0.01)


@pytest.mark.parametrize("base_too", [False, True])
def test_an_emissive_texture_has_coordinates_of_its_own(renderer: Renderer, base_too: bool) -> None:
    writer = GlbWriter()
    moved = {"KHR_texture_transform": {"offset": [0.5, 0.0]}}
    glow = {"index": writer.image_texture(png(FOUR_COLORS)), "texCoord": 1, "extensions": moved}
    material = plain((0, 0, 0, 1), emissiveFactor=[1, 1, 1], emissiveTexture=glow)
    if base_too:
        black = np.zeros((2, 2, 3), dtype=np.uint8)
        material["pbrMetallicRoughness"] = {"baseColorTexture": {"index": writer.image_texture(png(black))}}
    sets = {"TEXCOORD_0": np.zeros_like(QUAD_UV), "TEXCOORD_1": QUAD_UV}
    picture = shoot(renderer, writer.mesh(QUAD, QUAD_FACES, sets, material).bytes())
    assert quadrants(picture) == [hue(np.array(color, dtype=np.uint8)) for color in (GREEN, RED, YELLOW, BLUE)]


def test_vertex_colours_do_not_dim_emission(renderer: Renderer) -> None:
    material = plain((1, 1, 1, 1), emissiveFactor=[0, 1, 0])
    black = {"COLOR_0": np.zeros((4, 3), dtype=np.uint8)}
    middle = shoot(renderer, GlbWriter().mesh(QUAD, QUAD_FACES, black, material).bytes())[SIZE // 2, SIZE // 2]
    assert middle.tolist() == [0, 255, 0]


@pytest.mark.parametrize("broken", [b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(64), None])
def test_an_emissive_texture_that_cannot_be_shown_does_not_glow(renderer: Renderer, broken: bytes | None) -> None:
    """Neither does one whose coordinates are not there: most of such textures are dark nearly everywhere."""
    writer = GlbWriter()
    texture = {"index": writer.image_texture(broken or png(FOUR_COLORS))}
    uv = {"TEXCOORD_0": QUAD_UV} if broken else {}
    material = plain((1, 0, 0, 1), emissiveFactor=[1, 1, 1], emissiveTexture=texture)
    picture = shoot(renderer, writer.mesh(QUAD, QUAD_FACES, uv, material).bytes())
    assert set(quadrants(picture)) == {hue(np.array(RED, dtype=np.uint8))}


@pytest.mark.parametrize(
    ("material", "low", "high"),
    [
        (plain((0.5, 0.5, 0.5, 1)), 1, 1),
        (plain((0, 0, 0, 1)), 1, 1),
        (plain((0.5, 0.5, 0.5, 0.4), alphaMode="BLEND"), 1, 1),
        (plain((0.5, 0.5, 0.5, 1), alphaMode="MASK"), 1, 1),
        (plain((0.5, 0.5, 0.5, 1), extensions={"KHR_materials_unlit": {}}), 0, 0),
        (plain((0, 0, 0, 1), emissiveFactor=[1, 0, 0]), 0, 0),
        (plain((0.5, 0.5, 0.5, 1), emissiveFactor=[0.5, 0.5, 0.5]), 0.3, 0.9),
    ],
)
def test_it_is_known_how_much_of_what_is_seen_is_made_by_light(
    renderer: Renderer, material: dict[str, Any], low: float, high: float
) -> None:
    writer = GlbWriter().mesh(QUAD * 2 - [0, 0, 0.5], QUAD_FACES, material=plain((1, 1, 1, 1)))
    renderer.load(scene_of(writer.mesh(QUAD, QUAD_FACES, material=material).bytes()))
    picture, depth, shaded = renderer.render_with_depth(FRONT, UP)
    assert low <= shaded[SIZE // 2, SIZE // 2] <= high
    assert picture.shape == (SIZE, SIZE, 3)
    assert depth[SIZE // 2, SIZE // 2] > 0
