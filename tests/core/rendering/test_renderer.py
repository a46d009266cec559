import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.rendering.renderer import BACKGROUND, Renderer
from core.rendering.views import fibonacci_directions, view_directions
from tests.core.asset.ktx2_samples import ETC1S, UASTC
from tests.core.rendering.glb import (
    CORNERS,
    CUBE_FACES,
    QUAD,
    QUAD_FACES,
    QUAD_UV,
    GlbWriter,
    cube,
    plain,
    png,
)

Picture = NDArray[np.uint8]

SIZE = 128
FRONT, UP = (0, 0, 1), (0, 1, 0)
GREY = round(BACKGROUND * 255)
RED, GREEN, BLUE, YELLOW = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
FOUR_COLORS = np.array([[RED, GREEN], [BLUE, YELLOW]], dtype=np.uint8).repeat(8, axis=0).repeat(8, axis=1)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(SIZE) as renderer:
        yield renderer


def shoot(renderer: Renderer, glb: bytes, direction: tuple[float, ...] = FRONT) -> Picture:
    renderer.load(glb)
    return renderer.render(direction, UP)


def shown(picture: Picture) -> NDArray[np.bool_]:
    """Pixels that are not background."""
    return np.asarray((np.abs(picture.astype(int) - GREY) > 2).any(axis=2))


def hue(pixel: NDArray[np.uint8]) -> tuple[bool, ...]:
    """Which channels are bright, whatever the light."""
    return tuple(bool(channel > 90) for channel in pixel)


def quadrants(picture: Picture) -> list[tuple[bool, ...]]:
    """Hues at the middles of a centred square's quarters: upper left, upper right, lower left, lower right."""
    low, high = int(SIZE * 0.4), int(SIZE * 0.6)
    return [hue(picture[y, x]) for y in (low, high) for x in (low, high)]


def textured_quad(texture_info: dict[str, Any] | None = None) -> bytes:
    writer = GlbWriter()
    texture = writer.image_texture(png(FOUR_COLORS))
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture, **(texture_info or {})}},
        "doubleSided": True,
    }
    return writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material).bytes()


def test_a_picture_is_a_square_of_rgb_bytes_on_a_neutral_background(renderer: Renderer) -> None:
    picture = shoot(renderer, cube())
    assert picture.shape == (SIZE, SIZE, 3)
    assert picture.dtype == np.uint8
    for corner in (picture[0, 0], picture[0, -1], picture[-1, 0], picture[-1, -1]):
        np.testing.assert_allclose(corner.astype(int), GREY, atol=1)


def test_a_red_cube_is_red(renderer: Renderer) -> None:
    picture = shoot(renderer, cube((1, 0, 0, 1)), (1, 1, 1))
    inside = picture[shown(picture)]
    inside = inside[(inside != GREY).all(axis=1)]
    assert len(inside) > 500
    core = picture[SIZE // 2 - 20 : SIZE // 2 + 20, SIZE // 2 - 20 : SIZE // 2 + 20].reshape(-1, 3)
    assert (core[:, 0] > 80).all()
    assert (core[:, 1:] == 0).all()


def test_a_surface_that_faces_the_camera_keeps_its_colour(renderer: Renderer) -> None:
    srgb = np.array([200, 120, 40])
    factor = (*((srgb / 255) ** 2.2), 1.0)
    middle = shoot(renderer, GlbWriter().mesh(QUAD, QUAD_FACES, material=plain(factor)).bytes())[SIZE // 2, SIZE // 2]
    np.testing.assert_allclose(middle / middle.max(), srgb / srgb.max(), atol=0.02)
    assert 0.8 < middle[0] / srgb[0] <= 1.0


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


def test_back_faces_are_drawn_and_lit_only_where_the_material_is_double_sided(renderer: Renderer) -> None:
    def quad(double_sided: bool) -> bytes:
        return GlbWriter().mesh(QUAD, QUAD_FACES, material={"doubleSided": double_sided}).bytes()

    assert not shown(shoot(renderer, quad(False), (0, 0, -1))).any()
    behind, front = (shoot(renderer, quad(True), (0, 0, z))[SIZE // 2, SIZE // 2] for z in (-1, 1))
    np.testing.assert_array_equal(behind, front)


def room(**node: Any) -> bytes:
    """A cube whose single-sided faces look inwards."""
    return GlbWriter().mesh(CORNERS, CUBE_FACES[:, ::-1], material=plain((1, 1, 1, 1)), **node).bytes()


def depth_of_middle(renderer: Renderer, glb: bytes) -> float:
    renderer.load(glb)
    return float(renderer.render_with_depth(FRONT, UP)[1][SIZE // 2, SIZE // 2])


MIRRORS: list[dict[str, Any]] = [
    {},
    {"scale": [-1, 1, 1]},
    {"scale": [-2, -1, -1]},
    {"matrix": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},  # x and y change places
]


@pytest.mark.parametrize("node", MIRRORS)
def test_a_single_sided_room_is_seen_into(renderer: Renderer, node: dict[str, Any]) -> None:
    """Its near walls are not drawn, however its node mirrors it: in the middle the far wall is seen."""
    far, near = (depth_of_middle(renderer, glb) for glb in (room(**node), cube(**node)))
    assert far > near + 10


@pytest.mark.parametrize("node", MIRRORS)
def test_a_closed_cube_looks_the_same_single_and_double_sided(renderer: Renderer, node: dict[str, Any]) -> None:
    single, double = (
        shoot(
            renderer, GlbWriter().mesh(CORNERS, CUBE_FACES, material={"doubleSided": both}, **node).bytes(), (1, 2, 3)
        )
        for both in (False, True)
    )
    np.testing.assert_allclose(single.astype(int), double, atol=8)  # smoothed outlines


@pytest.mark.parametrize("node", [1, -1])
@pytest.mark.parametrize("bone", [1, -1])
def test_of_a_skin_that_side_is_shown_which_its_node_says(renderer: Renderer, node: int, bone: int) -> None:
    """A square that faces the camera; a bone that mirrors it does not change the side that is drawn, its node does."""
    writer = GlbWriter()
    skinned: dict[str, NDArray[Any]] = {
        "JOINTS_0": np.zeros((4, 4), dtype=np.uint8),
        "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 4],
    }
    writer.mesh(QUAD, QUAD_FACES, skinned, plain((1, 0, 0, 1)), skin=0, scale=[node, 1, 1])
    del writer.json["accessors"][writer.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"]]["normalized"]
    writer.json["scenes"][0]["nodes"].append(writer.add("nodes", {"scale": [bone, 1, 1]}))
    writer.add("skins", {"joints": [1]})
    drawn = [shown(shoot(renderer, writer.bytes(), (0, 0, z)))[SIZE // 2, SIZE // 2] for z in (1, -1)]
    assert drawn == ([True, False] if node * bone > 0 else [False, True])


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
    renderer.load(writer.bytes())
    assert len(made) == 1


GREEN_CUBE = plain((0, 1, 0, 1))
HIDDEN: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({"extensions": {"KHR_node_visibility": {"visible": False}}}, GREEN_CUBE),
    ({"scale": [0, 0, 0]}, GREEN_CUBE),
    ({"scale": [1, 0, 0]}, GREEN_CUBE),
    ({}, plain((0, 1, 0, 0), alphaMode="BLEND")),
    ({}, plain((0, 1, 0, 0.4), alphaMode="MASK")),
]


@pytest.mark.parametrize("place", [2.0, 1e5])
@pytest.mark.parametrize(("node", "material"), HIDDEN)
def test_what_is_hidden_is_neither_drawn_nor_framed(
    renderer: Renderer, node: dict[str, Any], material: dict[str, Any], place: float
) -> None:
    alone = shoot(renderer, cube((1, 0, 0, 1)))
    writer = GlbWriter().mesh(CORNERS, CUBE_FACES, material=plain((1, 0, 0, 1)))
    writer.mesh(CORNERS, CUBE_FACES, material=material, translation=[place, 0.5, 0.0], **node)
    np.testing.assert_allclose(shoot(renderer, writer.bytes()).astype(int), alone, atol=2)


def test_what_is_hidden_as_a_whole_is_shown(renderer: Renderer) -> None:
    assert shown(shoot(renderer, cube(extensions={"KHR_node_visibility": {"visible": False}}))).any()


def test_masked_texels_below_the_cutoff_are_holes(renderer: Renderer) -> None:
    writer = GlbWriter()
    pixels = np.full((16, 16, 4), 255, dtype=np.uint8)
    pixels[:, :8, 3] = 100
    texture = {"index": writer.image_texture(png(pixels))}
    base = {"baseColorTexture": texture, "baseColorFactor": [1, 0, 0, 1]}
    for cutoff, left in ((0.5, False), (0.3, True)):
        material = {"pbrMetallicRoughness": base, "alphaMode": "MASK", "alphaCutoff": cutoff}
        masked = GlbWriter()
        masked.binary, masked.json = writer.binary, {**writer.json, "scenes": [{"nodes": []}]}
        visible = shown(shoot(renderer, masked.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material).bytes()))
        assert visible[SIZE // 2, int(SIZE * 0.4)] == left
        assert visible[SIZE // 2, int(SIZE * 0.6)]


def test_alpha_is_ignored_where_the_material_is_opaque(renderer: Renderer) -> None:
    transparent = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 0, 0, 0))).bytes()
    opaque = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 0, 0, 1))).bytes()
    np.testing.assert_array_equal(shoot(renderer, transparent), shoot(renderer, opaque))


def test_what_stands_behind_glass_shines_through_whatever_the_order_in_the_file(renderer: Renderer) -> None:
    glass = plain((0, 0, 1, 0.5), alphaMode="BLEND")
    for order in (0, 1):
        writer = GlbWriter()
        parts = [(QUAD + np.array([0, 0, 0.5]), glass), (QUAD, plain((1, 0, 0, 1)))]
        for positions, material in parts[:: -1 if order else 1]:
            writer.mesh(positions, QUAD_FACES, material=material)
        red, green, blue = shoot(renderer, writer.bytes())[SIZE // 2, SIZE // 2]
        assert red > 60
        assert blue > 60
        assert green == 0


@pytest.mark.parametrize("stretch", [(1, 1, 1), (20, 1, 1), (1, 20, 0.1)])
def test_an_object_is_wholly_in_the_frame_from_everywhere(renderer: Renderer, stretch: tuple[float, ...]) -> None:
    renderer.load(cube((0.2, 0.2, 0.2, 1), scale=list(stretch), translation=[100.0, -50.0, 3.0]))
    directions, ups = view_directions()
    more = fibonacci_directions(16)
    for direction, up in zip(np.r_[directions, more], np.r_[ups, np.tile(UP, (16, 1))], strict=True):
        visible = shown(renderer.render(direction, up))
        assert visible.any()
        assert visible[1:-1, 1:-1].sum() == visible.sum()


def test_the_same_view_gives_the_same_pixels_in_a_new_context(renderer: Renderer) -> None:
    del renderer  # contexts of one process share a display, so the other picture is taken in another process
    code = (
        "import hashlib; from core.rendering.renderer import Renderer; from tests.core.rendering.glb import cube\n"
        "with Renderer(64) as renderer:\n"
        "    renderer.load(cube((0.3, 0.6, 0.9, 1)))\n"
        "    print(hashlib.sha256(renderer.render((1, 2, 3), (0, 1, 0)).tobytes()).hexdigest())"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout != ""


def test_malformed_attributes_are_refused(renderer: Renderer) -> None:
    glb = GlbWriter().mesh(QUAD, QUAD_FACES, {"NORMAL": QUAD[:2]}).bytes()
    with pytest.raises(MeshmarkError, match="NORMAL") as caught:
        renderer.load(glb)
    assert caught.value.code == ErrorCode.MALFORMED_FILE


def test_numbers_that_are_not_finite_do_not_reach_the_picture(renderer: Renderer) -> None:
    uv = np.full_like(QUAD_UV, np.nan)
    normals = np.full_like(QUAD, np.inf)
    glb = GlbWriter().mesh(QUAD, QUAD_FACES, {"NORMAL": normals, "TEXCOORD_0": uv}).bytes()
    assert shown(shoot(renderer, glb))[SIZE // 2, SIZE // 2]


def test_without_opengl_the_error_says_what_to_install() -> None:
    code = (
        "from core.errors import MeshmarkError\nfrom core.rendering.renderer import Renderer\n"
        "try:\n    Renderer(64)\nexcept MeshmarkError as error:\n    print(error.code, error.remedy)"
    )
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.strip() == "rendering_unavailable Install libegl1 and libgl1-mesa-dri."


def test_pictures_are_drawn_where_there_are_no_libraries_of_x11() -> None:
    code = (
        "import pyglet.lib\n"
        "load = pyglet.lib.load_library\n"
        "def without_x11(*names, **options):\n"
        "    if any(str(name).startswith('X') for name in names):\n"
        "        raise ImportError(f'{names} is not installed')\n"
        "    return load(*names, **options)\n"
        "pyglet.lib.load_library = without_x11\n"
        "from core.rendering.renderer import Renderer\n"
        "from tests.core.rendering.glb import cube\n"
        "with Renderer(64) as renderer:\n"
        "    renderer.load(cube((0.3, 0.6, 0.9, 1)))\n"
        "    print(len(renderer.render((1, 2, 3), (0, 1, 0))))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "64"


def test_importing_the_renderer_needs_no_opengl() -> None:
    code = "import sys, core.rendering.preview; print({'OpenGL', 'pyrender'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_no_cache_of_shaders_is_written_nor_warned_of(tmp_path: Path) -> None:
    code = "from core.rendering.renderer import Renderer\nwith Renderer(64): pass"
    environment = os.environ | {
        "MESA_SHADER_CACHE_DIR": str(tmp_path / "missing"),
        "HOME": "/proc",
        "XDG_CACHE_HOME": "/proc",
    }
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stderr == ""


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
    renderer.load(writer.mesh(QUAD, QUAD_FACES, material=material).bytes())
    picture, depth, shaded = renderer.render_with_depth(FRONT, UP)
    assert low <= shaded[SIZE // 2, SIZE // 2] <= high
    assert picture.shape == (SIZE, SIZE, 3)
    assert depth[SIZE // 2, SIZE // 2] > 0
