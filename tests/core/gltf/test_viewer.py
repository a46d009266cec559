"""What a viewer draws of small scenes: a plain cube, and one that is made and drawn as each test tells."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from core.gltf.scene import Scene, flatten, scene_of
from core.gltf.viewer import Viewed
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png

ALL, NONE = [True] * 12, [False] * 12
CLEAR_WHITE = (1.0, 1.0, 1.0, 0.0)


def _scene(material: dict[str, Any] | None = None, positions: ArrayLike = CUBE, **node: Any) -> Scene:
    """A plain cube, and another under a node of its own."""
    builder = Builder()
    ordinary, other = builder.primitive(CUBE, CUBE_FACES), builder.primitive(positions, CUBE_FACES)
    other["material"] = 0
    return flatten(
        builder.document(
            meshes=[{"primitives": [ordinary]}, {"primitives": [other]}],
            materials=[material or {}],
            nodes=[{"mesh": 0}, {"children": [2], **node}, {"mesh": 1}],
            scenes=[{"nodes": [0, 1]}],
        )
    )


def _square(pixels: ArrayLike, **material: Any) -> Viewed:
    """A square with a picture on it, in front of a cube."""
    writer = GlbWriter()
    reference = {"index": writer.image_texture(png(pixels), magFilter=9728)}
    material = {"pbrMetallicRoughness": {"baseColorTexture": reference}, **material}
    writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material)
    return scene_of(writer.bytes()).viewed


def _texels(alpha: list[list[int]]) -> NDArray[np.uint8]:
    opacity = np.array(alpha, dtype=np.uint8)
    return np.dstack([np.full((*opacity.shape, 3), 200, dtype=np.uint8), opacity])


def test_an_opaque_part_is_drawn_and_hides_what_is_behind_it() -> None:
    seen = _scene(plain(CLEAR_WHITE, alphaMode="OPAQUE")).viewed
    assert seen.drawn.all()
    assert (seen.opacity == 1).all()


def test_glass_that_refracts_is_all_there() -> None:
    assert (_scene({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}).viewed.opacity == 1).all()


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_alpha_decides_what_is_seen_through_and_not_the_mode_that_an_exporter_wrote(mode: str) -> None:
    assert (_scene(plain((1, 1, 1, 1), alphaMode=mode)).viewed.opacity == 1).all()
    assert (_scene(plain((1, 1, 1, 0.95), alphaMode=mode)).viewed.opacity == 1).all()


def test_glass_is_seen_through() -> None:
    seen = _scene(plain((1, 1, 1, 0.2), alphaMode="BLEND")).viewed
    assert seen.drawn.all()
    assert seen.opacity.tolist() == [1.0] * 12 + [0.0] * 12


@pytest.mark.parametrize(("mode", "alpha"), [("MASK", 0.49), ("BLEND", 0.0), ("BLEND", 0.01)])
def test_what_is_clear_everywhere_is_not_drawn(mode: str, alpha: float) -> None:
    assert _scene(plain((1, 1, 1, alpha), alphaMode=mode)).viewed.drawn.tolist() == ALL + NONE


def test_a_cutoff_of_the_file_counts() -> None:
    faint = plain((1, 1, 1, 0.3), alphaMode="MASK", alphaCutoff=0.2)
    assert (_scene(faint).viewed.opacity == 1).all()


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_of_a_picture_with_holes_the_share_of_each_face_that_is_not_a_hole_counts(mode: str) -> None:
    seen = _square(_texels([[255, 255], [0, 0]]), alphaMode=mode)  # the upper half, a quarter of the lower face
    assert seen.opacity == pytest.approx([0.25, 0.75], abs=0.03)
    assert seen.drawn.all()


def test_a_picture_without_holes_is_opaque_and_one_of_nothing_but_holes_is_not_drawn() -> None:
    assert (_square(_texels([[255, 240], [230, 255]]), alphaMode="BLEND").opacity == 1).all()
    builder = _scene(plain((1, 1, 1, 0), alphaMode="BLEND"), np.array(CUBE) + 100.0)
    assert builder.viewed.drawn.tolist() == ALL + NONE


def test_vertex_colours_have_alpha_too() -> None:
    writer = GlbWriter()
    colors = np.array([[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0]], dtype=np.float32)
    writer.mesh(QUAD, QUAD_FACES, {"COLOR_0": colors}, {"alphaMode": "BLEND"})
    opacity = scene_of(writer.bytes()).viewed.opacity
    assert opacity[0] == 1
    assert opacity[1] == pytest.approx(1 - 0.9**2, abs=0.03)  # a tenth of one corner is all that may be missing


@pytest.mark.parametrize("double_sided", [True, False])
def test_only_a_double_sided_material_shows_backs(double_sided: bool) -> None:
    seen = _scene({"doubleSided": double_sided}).viewed
    assert seen.one_sided.tolist() == [True] * 12 + [not double_sided] * 12


def test_what_hangs_below_a_hidden_node_is_not_drawn() -> None:
    seen = _scene(extensions={"KHR_node_visibility": {"visible": False}}).viewed
    assert seen.drawn.tolist() == ALL + NONE


@pytest.mark.parametrize("scale", [[0, 0, 0], [2, 0, 0]])
def test_what_is_scaled_to_nothing_is_not_drawn(scale: list[float]) -> None:
    turned = _scene(scale=scale, rotation=[0.2, 0.3, 0.1, 0.9273618])
    assert turned.viewed.drawn.tolist() == ALL + NONE


def test_what_is_flattened_to_a_plane_is_drawn() -> None:
    assert _scene(scale=[1, 0, 1]).viewed.drawn.all()


@pytest.mark.parametrize(
    "unseen",
    [
        {"extensions": {"KHR_node_visibility": {"visible": False}}},
        {"scale": [0, 0, 0]},
        {"scale": [0, 3, 0], "rotation": [0.2, 0.3, 0.1, 0.9273618]},
        {"material": plain(CLEAR_WHITE, alphaMode="BLEND")},
        {"positions": [[0, 0, t] for t in range(8)]},
        {"positions": [[0.1 * t, 0.2 * t, 0.3 * t] for t in range(8)]},
    ],
    ids=["hidden", "scaled to a point", "scaled to a line", "clear", "collapsed", "on a line"],
)
def test_what_is_not_seen_far_away_does_not_make_the_frame_larger(unseen: dict[str, Any]) -> None:
    scene = _scene(translation=[5000, 0, 300], **unseen)
    assert scene.surface.scale == 15
    assert scene.viewed.drawn.tolist() == ALL + NONE


def test_a_speck_that_is_seen_far_away_does() -> None:
    assert _scene(translation=[5000, 0, 0], scale=[0.001, 0.001, 0.001]).surface.scale < 0.01


def test_where_all_is_hidden_all_counts_as_seen() -> None:
    builder = Builder()
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    one = builder.primitive(CUBE, CUBE_FACES)
    scene = flatten(builder.document(meshes=[{"primitives": [one]}], nodes=[{"mesh": 0, **hidden}]))
    assert scene.surface.scale == 15
    assert scene.viewed.drawn.all()


def test_what_overflows_out_of_sight_harms_nothing() -> None:
    scene = _scene(translation=[1e300, 0, 0], extensions={"KHR_node_visibility": {"visible": False}})
    assert scene.surface.scale == 15
    assert np.isfinite(scene.surface.positions).all()
