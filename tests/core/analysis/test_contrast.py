"""Marks that no shading shows get a colour, and others do not."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from core.analysis.contrast import (
    CODES,
    CONTRAST,
    OWN,
    ContrastOptions,
    Look,
    contrasting,
    looks_of_letters,
    low_contrast,
    stands_out,
    unreadable_codes,
)
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.gltf.colors import cielab, from_cielab, hex_linear, hex_srgb
from core.gltf.edit import Style
from core.gltf.scene import Scene, scene_of
from core.notices import NoticeCode
from core.parameters import AUTO_COLORS
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png

UNLIT: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}


def on(scene: Scene, *centers: tuple[float, float], asked: str | None = None) -> list[Style]:
    """The letters of marks of 8 x 1.2 at places on a square of 30 x 30."""
    return [look.style for look in chosen(scene, (asked,) if asked else (), *centers)]


def chosen(
    scene: Scene, palette: Sequence[str], *centers: tuple[float, float], options: ContrastOptions = CONTRAST
) -> list[Look]:
    """Likewise, of a palette."""
    count = len(centers)
    boxes = Boxes(
        np.array([[x, y, 0.0] for x, y in centers]).reshape(-1, 3),
        np.tile(np.eye(3), (count, 1, 1)),
        np.tile([8.0, 1.2, 0.5], (count, 1)),
    )
    index = SpatialIndex(scene.surface.positions, scene.surface.faces)
    return looks_of_letters(scene, scene.surface, index, boxes, palette, options)


def square(material: dict[str, Any], image: Any = None, role: str = "emissiveTexture") -> Scene:
    """A square; ``image`` is its base colour or what it emits."""
    writer = GlbWriter()
    attributes = {"TEXCOORD_0": QUAD_UV} if image is not None else None
    if image is not None:
        texture = {"index": writer.image_texture(png(image))}
        material = material | (
            {role: texture} if role == "emissiveTexture" else {"pbrMetallicRoughness": {role: texture}}
        )
    return scene_of(writer.mesh(QUAD, QUAD_FACES, attributes, material).bytes())


def lightness(color: str | None) -> float:
    assert color is not None
    return float(cielab(hex_linear(color)[None])[0, 0])


@pytest.mark.parametrize("grey", [0.0, 0.02, 0.2, 1.0])
def test_letters_on_ordinary_materials_keep_the_colour_of_their_ground(grey: float) -> None:
    assert on(square(plain((grey, grey, grey, 1))), (0, 0)) == [Style()]


@pytest.mark.parametrize("color", [(0, 0, 0), (1, 1, 1), (0.2, 0.2, 0.2), (0.5, 0.02, 0.02), (0.9, 0.8, 0.1)])
def test_letters_on_unlit_materials_differ_from_them(color: tuple[float, float, float]) -> None:
    (found,) = on(square(plain((*color, 1.0), **UNLIT)), (0, 0))
    assert found is not None
    assert abs(lightness(found.color) - cielab(np.array([color]))[0, 0]) > 45
    assert not found.glows


def test_letters_keep_the_hue_of_their_ground() -> None:
    ground = np.array([[0.9, 0.6, 0.02]])
    color = contrasting(cielab(ground))
    hue, before = (cielab(linear)[0, 1:] for linear in (hex_linear(color)[None], ground))
    assert np.linalg.norm(hue) > 10
    assert np.dot(hue, before) / np.linalg.norm(hue) / np.linalg.norm(before) > 0.95


def test_letters_are_on_the_side_of_greater_contrast_to_what_is_most_like_them() -> None:
    """A fifth of the ground is nearly black, the rest is grey: only light letters are seen on both."""
    dark = np.array([[2, 0, 0]] * 20 + [[50, 0, 0]] * 80, dtype=float)
    assert lightness(contrasting(dark)) > 95
    assert lightness(contrasting(dark[20:] * 1.4)) < 15


def test_letters_across_black_and_white_are_grey() -> None:
    ground = np.array([[5, 0, 0]] * 50 + [[95, 0, 0]] * 50, dtype=float)
    assert 40 < lightness(contrasting(ground)) < 60


def test_a_surface_that_glows_outshines_its_shading() -> None:
    (on_bright,) = on(square(plain((0, 0, 0, 1), emissiveFactor=[0.9, 0.9, 0.9])), (0, 0))
    (on_dim,) = on(square(plain((0, 0, 0, 1), emissiveFactor=[0.05, 0.05, 0.05])), (0, 0))
    assert on_bright is not None
    assert on_dim is not None
    assert (lightness(on_bright.color) < 45, on_bright.glows) == (True, False)
    assert (lightness(on_dim.color) > 85, on_dim.glows) == (True, True)


def test_emission_that_leaves_shading_to_be_seen_changes_nothing() -> None:
    assert on(square(plain((0.5, 0.5, 0.5, 1), emissiveFactor=[0.1, 0.1, 0.1])), (0, 0)) == [Style()]


def test_letters_contrast_as_much_as_the_options_ask_for() -> None:
    ground = cielab(np.full((10, 3), 1.0))
    faint, strong = (lightness(contrasting(ground, ContrastOptions(contrast=asked))) for asked in (30.0, 60.0))
    assert (faint, strong) == pytest.approx((70, 40), abs=0.5)


def test_a_small_emissive_detail_does_not_count_a_large_one_does() -> None:
    """A screen that fills the left half, and a lamp in the middle of the right one."""
    image = np.zeros((128, 128, 3), dtype=np.uint8)
    image[:, :64] = 255
    image[62:66, 94:98] = 255
    scene = square(plain((0.5, 0.5, 0.5, 1), emissiveFactor=[1, 1, 1]), image)
    screen, lamp = on(scene, (-8, 0), (8, 0))
    assert screen != Style()
    assert lamp == Style()


def test_each_mark_has_the_colour_that_its_own_ground_needs() -> None:
    image = np.full((64, 64, 3), 20, dtype=np.uint8)
    image[:, 32:] = 235
    left, right = on(square(UNLIT, image, "baseColorTexture"), (-8, 0), (8, 0))
    assert left is not None
    assert right is not None
    assert lightness(left.color) - lightness(right.color) > 30


def test_a_colour_that_is_asked_for_is_kept_and_glows_where_it_would_be_dark_on_light() -> None:
    red = "#d02020"
    assert on(square(plain((1, 1, 1, 1), **UNLIT)), (0, 0), asked=red) == [Style(red, False)]
    assert on(square(plain((0.2, 0.2, 0.2, 1))), (0, 0), asked=red) == [Style(red, False)]
    assert on(square(plain((0, 0, 0, 1), emissiveFactor=[0, 0.08, 0])), (0, 0), asked=red) == [Style(red, True)]
    assert on(square(plain((0, 0, 0, 1), emissiveFactor=[0, 1, 0])), (0, 0), asked=red) == [Style(red, False)]


def test_a_file_without_unlit_or_emissive_materials_costs_no_closest_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SpatialIndex, "closest", None)
    assert on(square(plain((0.2, 0.2, 0.2, 1))), (0, 0)) == [Style()]
    with pytest.raises(TypeError):
        on(square(plain((0, 0, 0, 1), **UNLIT)), (0, 0))


def test_no_marks_need_no_colour() -> None:
    assert on(square(UNLIT)) == []


def test_colours_come_back_from_cielab_and_from_hexadecimal_digits() -> None:
    linear = np.random.default_rng(0).random((50, 3)) ** 2
    np.testing.assert_allclose(from_cielab(cielab(linear)), linear, atol=1e-6)
    for color in ("#000000", "#ffffff", "#0a0b0c", "#d02020"):
        assert hex_srgb(hex_linear(color)) == color


GROUNDS = {
    "light": (0.8, 0.8, 0.8),
    "dark": (0.01, 0.01, 0.01),
    "red": (0.6, 0.02, 0.02),
    "green": (0.05, 0.4, 0.05),
    "grey": (0.2, 0.2, 0.2),
}


@pytest.mark.parametrize("extra", [{}, UNLIT], ids=["lit", "unlit"])
@pytest.mark.parametrize("ground", GROUNDS.values(), ids=GROUNDS.keys())
def test_on_any_ground_one_of_the_automatic_colours_stands_out(
    ground: tuple[float, float, float], extra: dict[str, Any]
) -> None:
    scene = square(plain((*ground, 1.0), **extra))
    (look,) = chosen(scene, AUTO_COLORS, (0, 0))
    assert look.contrast is not None
    assert look.contrast > 45
    assert look.style.color in AUTO_COLORS
    assert not low_contrast([look])


def test_on_a_busy_texture_the_colour_is_far_from_all_of_it() -> None:
    cells = np.indices((16, 16)).sum(axis=0) % 2
    image = np.where(cells[..., None], (200, 30, 30), (40, 40, 45)).astype(np.uint8)
    scene = square({}, image, "baseColorTexture")
    (look,) = chosen(scene, AUTO_COLORS, (0, 0))
    assert look.style.color not in ("#101010", "#d02020")
    assert look.contrast is not None
    assert look.contrast > 40


def test_of_a_brand_s_colours_each_mark_has_the_one_that_stands_out_best_there() -> None:
    image = np.repeat(np.repeat(np.array([[[250] * 3, [10] * 3]], np.uint8), 32, axis=1), 2, axis=0)
    scene = square({}, image, "baseColorTexture")
    looks = chosen(scene, ("#d0d0d0", "#303030"), (-8, 0), (8, 0))
    assert [look.style.color for look in looks] == ["#303030", "#d0d0d0"]
    assert [look.lighter for look in looks] == [False, True]
    assert all(look.contrast is not None and look.contrast > 50 for look in looks)


def test_a_colour_that_hardly_stands_out_is_noticed_with_its_distance() -> None:
    scene = square(plain((0.6, 0.02, 0.02, 1.0)))
    (look,) = chosen(scene, ("#d02020",), (0, 0))
    (notice,) = low_contrast([look])
    assert notice.code is NoticeCode.LOW_CONTRAST
    assert "1 of 1 marks" in notice.message
    assert f"distance is {look.contrast:.0f}" in notice.message


def test_letters_of_the_surface_s_colour_have_no_distance_from_it() -> None:
    assert chosen(square(plain((0.5, 0.5, 0.5, 1.0))), (), (0, 0)) == [OWN]


def test_of_colours_that_stand_out_alike_the_first_is_taken() -> None:
    assert stands_out(np.array([[50.0, 0.0, 0.0]]), ("#102030", "#102030"))[0] == "#102030"


def test_of_colours_for_a_code_the_one_farthest_in_lightness_is_taken_as_readers_see_no_hue() -> None:
    orange, blue, black = square(plain((0.6, 0.2, 0.01, 1.0))), "#1840d0", "#101010"
    (text,), (code,) = (chosen(orange, (blue, black), (0, 0), options=options) for options in (CONTRAST, CODES))
    assert (text.style.color, code.style.color) == (blue, black)


def test_codes_of_the_surface_s_colour_are_noticed_with_their_number_and_what_helps() -> None:
    colored = Look(Style("#101010"), 60.0)
    assert not unreadable_codes([colored, colored])
    (notice,) = unreadable_codes([OWN, OWN, colored])
    assert notice.code is NoticeCode.UNREADABLE_QR
    assert notice.message.startswith("2 of 3 QR codes have the surface's own colour: ")
    assert "`color`" in notice.remedy
    assert "auto" in notice.remedy
