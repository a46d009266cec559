from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from core.analysis.color import appearance, base_color
from core.arrays import Float
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import Scene, scene_of
from tests.core.placement.shapes import inside_out
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png

RED, GREEN, BLUE, WHITE = [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]
QUARTERS = np.array([[RED, GREEN], [BLUE, WHITE]], dtype=np.uint8) * 255  # rows from the top
NEAREST, REPEAT, CLAMP, MIRROR = 9728, 10497, 33071, 33648


def quad(pixels: ArrayLike = QUARTERS, uv: ArrayLike = QUAD_UV, material: Any = None, **more: Any) -> Scene:
    """A picture on a square of 30 x 30 in z = 0; ``more``: samplers, attributes, and properties of its reference."""
    writer = GlbWriter()
    sampler = {"magFilter": NEAREST} | more.pop("sampler", {})
    attributes = {"TEXCOORD_0": np.asarray(uv, dtype=np.float32)} | more.pop("attributes", {})
    reference = {"index": writer.image_texture(png(pixels), **sampler), **more}
    base = {"baseColorTexture": reference, **(material or {})}
    return flat(writer.mesh(QUAD, QUAD_FACES, attributes, {"pbrMetallicRoughness": base}))


def flat(writer: GlbWriter) -> Scene:
    return scene_of(writer.bytes())


def at(shown: Scene, *places: tuple[float, float]) -> Float:
    """The colours at places on the square."""
    points = np.array([[x, y, 0.0] for x, y in places])
    face = np.where(points[:, 0] >= points[:, 1], 0, 1)  # the lower right and the upper left half
    return base_color(shown, shown.surface, points, face)


QUARTER_MIDDLES = ((-8, 7), (7, 8), (-7, -8), (8, -7))


def test_a_picture_is_seen_where_its_uvs_put_it() -> None:
    assert at(quad(), *QUARTER_MIDDLES) == pytest.approx(np.array([RED, GREEN, BLUE, WHITE]))


def test_faces_that_are_wound_the_other_way_round_show_the_same() -> None:
    shown = quad()
    points = shown.surface.positions[shown.surface.faces].mean(axis=1)
    seen = base_color(shown, inside_out(shown.surface), points, np.arange(2))
    assert (seen == base_color(shown, shown.surface, points, np.arange(2))).all()
    assert seen.tolist() == [WHITE, RED]


def test_colours_are_linear_and_multiplied_by_the_factor() -> None:
    grey = np.full((2, 2, 3), 188, dtype=np.uint8)
    seen = at(quad(grey, material={"baseColorFactor": [1, 0.5, 0, 1]}), (1, 0))
    assert seen[0] == pytest.approx([0.5029, 0.2514, 0], abs=1e-4)


def test_colours_between_texels_are_mixed_unless_the_sampler_forbids_it() -> None:
    pair = np.array([[[0] * 3, [255] * 3]] * 2, dtype=np.uint8)
    smooth = quad(pair, sampler={"magFilter": 9729, "wrapS": CLAMP})
    assert at(smooth, (-14, -14.5), (0, -1), (3.75, 0), (14, 0))[:, 0] == pytest.approx([0, 0.5, 0.75, 1])
    assert at(quad(pair), (-3.75, -5), (3.75, 0))[:, 0].tolist() == [0, 1]


@pytest.mark.parametrize(
    ("wrap", "expected"), [(REPEAT, [0, 1, 0, 1, 0, 1]), (MIRROR, [0, 1, 1, 0, 0, 1]), (CLAMP, [0, 0, 0, 1, 1, 1])]
)
def test_pictures_repeat_mirror_or_end_as_the_sampler_says(wrap: int, expected: list[int]) -> None:
    pair = np.array([[[0] * 3, [255] * 3]] * 2, dtype=np.uint8)
    thrice = QUAD_UV * [3, 1] - [1, 0]  # u from -1 to 2
    shown = quad(pair, thrice, sampler={"wrapS": wrap})
    if wrap == MIRROR:  # u from -1 to 0 runs backwards
        expected = [1, 0, 0, 1, 1, 0]
    places = [(x, -14.0 if x > -14 else -14.9) for x in (-12.5, -7.5, -2.5, 2.5, 7.5, 12.5)]
    assert at(shown, *places)[:, 0].tolist() == expected


def test_texture_coordinates_beyond_all_bounds_still_have_a_colour() -> None:
    seen = at(quad(uv=QUAD_UV * 3e38), (1, 0), (-14, 14))
    assert np.isfinite(seen).all()
    assert np.isfinite(at(quad(uv=np.full((4, 2), np.nan)), (1, 0))).all()


def test_factors_and_transforms_beyond_all_bounds_still_have_a_colour() -> None:
    wild = quad(
        material={"baseColorFactor": [1e308, -1e308, 0, 1]},
        extensions={"KHR_texture_transform": {"scale": [1e308, -1e308], "rotation": 1}},
    )
    seen = at(wild, *QUARTER_MIDDLES)
    assert ((seen >= 0) & (seen <= 1)).all()


@pytest.mark.parametrize(
    "material",
    [
        {"extensions": []},
        {"pbrMetallicRoughness": 1},
        {"pbrMetallicRoughness": {"baseColorTexture": [0]}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": "0"}}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": 1}}}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": []}}},
        {"pbrMetallicRoughness": {"baseColorFactor": [10**400, 1, 1, 1]}},
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": None}},
    ],
)
def test_a_material_that_is_not_well_formed_is_refused(material: dict[str, Any]) -> None:
    writer = GlbWriter()
    writer.image_texture(png(QUARTERS))
    writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material)
    with pytest.raises(MeshmarkError) as caught:
        at(flat(writer), (1, 0))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"offset": [0.5, 0]}, [GREEN, RED, WHITE, BLUE]),
        ({"offset": [0, 0.5]}, [BLUE, WHITE, RED, GREEN]),
        ({"scale": [0.5, 0.5]}, [RED, RED, RED, RED]),
        ({"rotation": np.pi / 2, "offset": [0, 1]}, [BLUE, RED, WHITE, GREEN]),
        ({"texCoord": 1}, [GREEN, RED, WHITE, BLUE]),
    ],
)
def test_texture_transforms_apply(transform: dict[str, Any], expected: list[list[int]]) -> None:
    mirrored = (QUAD_UV * [-1, 1] + [1, 0]).astype(np.float32)
    shown = quad(attributes={"TEXCOORD_1": mirrored}, extensions={"KHR_texture_transform": transform})
    assert at(shown, *QUARTER_MIDDLES) == pytest.approx(np.array(expected))


def test_vertex_colours_are_mixed_across_a_face() -> None:
    colors = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
    shown = flat(GlbWriter().mesh(QUAD, QUAD_FACES, {"COLOR_0": colors}))
    assert at(shown, (0, 0), (7.5, -7.5), (-15, 0)) == pytest.approx(
        np.array([[0.5, 0.5, 0], [0.75, 0.25, 0], [0, 0.5, 0]])
    )


def test_every_primitive_has_its_own_material() -> None:
    writer = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 0, 0, 1)))
    writer.mesh(np.add(QUAD, [2, 0, 0]), QUAD_FACES, material=plain((0, 0, 1, 1)))
    shown = flat(writer.mesh(np.add(QUAD, [4, 0, 0]), QUAD_FACES))
    points = shown.surface.positions[shown.surface.faces].mean(axis=1)
    seen = base_color(shown, shown.surface, points, np.arange(6))
    assert seen.tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1], [1, 1, 1], [1, 1, 1]]


def test_a_vertex_colour_of_too_few_components_is_refused() -> None:
    shown = flat(GlbWriter().mesh(QUAD, QUAD_FACES, {"COLOR_0": np.zeros((4, 2), dtype=np.float32)}))
    with pytest.raises(MeshmarkError) as caught:
        at(shown, (1, 0))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_emission_is_added_to_the_base_colour() -> None:
    dark = {"emissiveFactor": [0, 0.25, 0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}}
    shown = flat(GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((0.25, 0.75, 0, 1), **dark)))
    assert at(shown, (1, 0))[0] == pytest.approx([0.25, 1, 0])  # no more than full light
    seen = appearance(shown, shown.surface, np.array([[1.0, 0, 0]]), np.array([0]))
    assert (seen.lit[0], seen.glow[0]) == (pytest.approx([0.25, 0.75, 0]), pytest.approx([0, 0.5, 0]))
    assert not seen.unlit[0]


def test_an_emissive_texture_glows_where_its_own_uvs_put_it() -> None:
    writer = GlbWriter()
    texture = {"index": writer.image_texture(png(QUARTERS), magFilter=NEAREST), "texCoord": 1}
    sets = {"TEXCOORD_0": np.zeros_like(QUAD_UV), "TEXCOORD_1": QUAD_UV}
    material = plain((0, 0, 0, 1), emissiveFactor=[1, 1, 1], emissiveTexture=texture)
    assert at(flat(writer.mesh(QUAD, QUAD_FACES, sets, material)), *QUARTER_MIDDLES) == pytest.approx(
        np.array([RED, GREEN, BLUE, WHITE])
    )
    without = GlbWriter()
    without.image_texture(png(QUARTERS))
    assert (at(flat(without.mesh(QUAD, QUAD_FACES, material=material)), *QUARTER_MIDDLES) == 0).all()


def test_an_unlit_material_shows_its_base_colour_and_emits_nothing() -> None:
    unlit = {"extensions": {"KHR_materials_unlit": {}}, "emissiveFactor": [1, 1, 1]}
    shown = flat(GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((0.5, 0.25, 0, 1), **unlit)))
    seen = appearance(shown, shown.surface, np.array([[1.0, 0, 0]]), np.array([0]))
    assert seen.unlit.all()
    assert seen.lit[0].tolist() == [0, 0, 0]
    assert seen.shown[0] == pytest.approx([0.5, 0.25, 0])
