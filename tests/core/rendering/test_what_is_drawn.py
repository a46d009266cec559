"""What is drawn and what is not: back faces, hidden nodes, holes, glass."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.gltf.scene import scene_of
from core.rendering.renderer import Renderer
from tests.core.rendering.glb import CORNERS, CUBE_FACES, QUAD, QUAD_FACES, QUAD_UV, GlbWriter, cube, plain, png
from tests.core.rendering.shots import FRONT, SIZE, UP, shoot, shown


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
    renderer.load(scene_of(glb))
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
