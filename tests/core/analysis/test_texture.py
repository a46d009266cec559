import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from core.analysis.saliency import saliency
from core.analysis.texture import TextureOptions, TextureSaliency, texture_saliency
from core.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.gltf.scene import Scene, flatten, scene_of
from core.placement.objective import LUMINANCE
from tests.core.placement.shapes import box, boxes, rotation
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
DATA = Path(__file__).parents[2] / "data"

SIZE = 512
WHITE = np.full((SIZE, SIZE, 3), 235, dtype=np.uint8)


def drawn(*ellipses: tuple[tuple[float, float], float, int], ground: NDArray[np.uint8] = WHITE) -> NDArray[np.uint8]:
    """A picture of the plate with discs: centre and radius in size-30 units, x right and y up, and a grey."""
    image = Image.fromarray(ground)
    pen, scale = ImageDraw.Draw(image), SIZE / 30
    for (x, y), radius, grey in ellipses:
        left, top = (x - radius + 15) * scale, (15 - y - radius) * scale
        pen.ellipse((left, top, left + 2 * radius * scale, top + 2 * radius * scale), fill=(grey, grey, grey))
    return np.asarray(image)


def eye(x: float, y: float) -> list[tuple[tuple[float, float], float, int]]:
    return [((x, y), 1.0, 20), ((x + 0.2, y + 0.2), 0.4, 250)]


def plate(pixels: NDArray[np.uint8], uv: NDArray[np.float32] = QUAD_UV, **transform: Any) -> Scene:
    """A picture on a square of 30 x 30 in z = 0 that faces +Z."""
    writer = GlbWriter()
    texture: dict[str, Any] = {"index": writer.image_texture(png(pixels))}
    if transform:
        texture["extensions"] = {"KHR_texture_transform": transform}
    material = {"pbrMetallicRoughness": {"baseColorTexture": texture}}
    return scene(writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": uv}, material))


def scene(writer: GlbWriter) -> Scene:
    return scene_of(writer.bytes())


def look(shown: Scene, seed: int = 0) -> TextureSaliency | None:
    return texture_saliency(shown, shown.surface, *sample(shown.surface, 20_000, np.random.default_rng(seed)))


def found(shown: Scene, seed: int = 0) -> TextureSaliency:
    result = look(shown, seed)
    assert result is not None
    return result


def under(texture: TextureSaliency, marks: Boxes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return texture.under(texture.pairs_in_boxes(marks))


def color_under(texture: TextureSaliency, marks: Boxes) -> np.ndarray:
    return texture.color_under(texture.pairs_in_boxes(marks))


def at(x: float, y: float, size: tuple[float, float, float] = (2, 1, 1)) -> Boxes:
    return box((x, y, 0), size)


def test_an_eye_stands_out_and_what_is_beside_it_does_not() -> None:
    mean, share, busy = under(found(plate(drawn(*eye(5, 4)))), boxes(at(5, 4), at(9, 4), at(-5, 4), at(5, -4)))
    assert share[0] > 0.95
    assert mean[0] > 0.8
    assert busy[0] > 0.7
    assert max(*share[1:], *mean[1:], *busy[1:]) < 0.01


def test_an_eye_stands_out_no_more_than_the_options_ask_for() -> None:
    shown = plate(drawn(*eye(5, 4)))
    samples = sample(shown.surface, 20_000, np.random.default_rng(0))
    strict = texture_saliency(shown, shown.surface, *samples, TextureOptions(contrast=1.0))
    assert strict is not None
    assert (strict.saliency == 0).all()


def test_small_print_stands_out() -> None:
    image = Image.fromarray(WHITE)
    for row in range(3):
        ImageDraw.Draw(image).text((100, 100 + 14 * row), "Made by hand 1234", fill=(40, 40, 40))
    scale = 30 / SIZE
    middle = at(150 * scale - 15, 15 - 120 * scale, (4, 1.5, 1))
    _, share, busy = under(found(plate(np.asarray(image))), boxes(middle, at(5, -5)))
    assert share[0] > 0.9
    assert busy[0] > 0.4
    assert share[1] == 0
    assert busy[1] < 1e-3


def test_a_single_colour_has_no_detail() -> None:
    assert look(plate(WHITE)) is None
    assert look(scene(GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 0, 0, 1))))) is None
    assert look(scene(GlbWriter().mesh(QUAD, QUAD_FACES))) is None


def test_a_picture_on_a_shape_without_uvs_is_not_seen() -> None:
    writer = GlbWriter()
    texture = {"index": writer.image_texture(png(drawn(*eye(0, 0))))}
    assert (
        look(scene(writer.mesh(QUAD, QUAD_FACES, material={"pbrMetallicRoughness": {"baseColorTexture": texture}})))
        is None
    )


def test_a_damaged_picture_is_not_seen() -> None:
    writer = GlbWriter()
    texture = {"index": writer.image_texture(png(drawn(*eye(0, 0)))[:300])}
    material = {"pbrMetallicRoughness": {"baseColorTexture": texture}}
    assert look(scene(writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material))) is None


def test_a_material_that_refers_to_no_texture_is_refused() -> None:
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 3}}}
    with pytest.raises(MeshmarkError) as caught:
        look(scene(GlbWriter().mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material)))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def noise(low: int, high: int, texels: int = 1) -> NDArray[np.uint8]:
    cells = np.random.default_rng(1).integers(low, high, (SIZE // texels, SIZE // texels, 1), dtype=np.uint8)
    return cells.repeat(texels, 0).repeat(texels, 1).repeat(3, 2)


GRADIENT = np.linspace(0, 255, SIZE).astype(np.uint8)[:, None, None].repeat(SIZE, 1).repeat(3, 2)
STRIPES = np.where(np.arange(SIZE)[:, None, None] % 8 < 4, 60, 140).astype(np.uint8).repeat(SIZE, 1).repeat(3, 2)


@pytest.mark.parametrize(
    "pixels",
    [GRADIENT, noise(118, 138), noise(0, 255), noise(0, 255, 4), STRIPES],
    ids=["gradient", "faint noise", "noise", "coarse noise", "stripes"],
)
def test_nothing_stands_out_of_what_is_the_same_everywhere(pixels: NDArray[np.uint8]) -> None:
    result = found(plate(pixels))
    assert result.threshold == 1
    assert (result.saliency == 0).all()


def test_noise_is_busy_and_a_gradient_is_not() -> None:
    assert found(plate(noise(0, 255))).color_variance.mean() > 0.5
    assert found(plate(noise(118, 138))).color_variance.mean() < 0.1
    assert found(plate(GRADIENT)).color_variance.mean() < 0.1


def test_an_eye_stands_out_of_grain() -> None:
    _, share, busy = under(found(plate(drawn(*eye(5, 4), ground=noise(150, 230)))), boxes(at(5, 4), at(-5, 4)))
    assert share[0] > 0.9
    assert share[1] < 0.02
    assert 0.1 < busy[1] < busy[0] / 2


def test_the_border_of_a_large_patch_stands_out_less_than_an_eye() -> None:
    mean, share, _ = under(
        found(plate(drawn(((-6, 0), 6, 80), *eye(6, 0)))), boxes(at(6, 0), at(0, 0), at(-6, 0, (5, 2, 1)))
    )
    assert mean[0] > mean[1] > 0
    assert share[2] == 0


def test_the_two_sides_of_a_thin_sheet_are_not_one_picture() -> None:
    back = np.diag([-1.0, 1, -1])
    writer = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 1, 1, 1)))
    writer.mesh(QUAD @ back - [0, 0, 0.003], QUAD_FACES, material=plain((0, 0, 0, 1)))
    assert found(scene(writer)).color_variance.max() < 1e-3


def test_what_lies_hidden_below_a_sheet_does_not_show() -> None:
    writer = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 1, 1, 1)))
    hidden = writer.mesh(QUAD - [0, 0, 0.025], QUAD_FACES, material=plain((0, 0, 0, 1)))
    assert found(scene(hidden)).color_variance.max() < 1e-3


def test_the_layout_of_the_uvs_does_not_matter() -> None:
    picture = drawn(*eye(5, 4))
    half = np.full((SIZE, 2 * SIZE, 3), 200, dtype=np.uint8)
    half[:, SIZE:] = picture
    one = found(plate(picture))
    other = found(plate(half, scale=[0.5, 1], offset=[0.5, 0]))
    assert np.abs(one.saliency - other.saliency).mean() < 0.01
    tiled = found(plate(picture, np.add(QUAD_UV, [7, -3], dtype=np.float32)))
    assert tiled.saliency == pytest.approx(one.saliency, abs=1e-3)


def test_vertex_colours_are_seen() -> None:
    step = np.linspace(-1, 1, 121, dtype=np.float32)
    x, y = np.meshgrid(step, step)
    corner = (np.arange(120)[:, None] * 121 + np.arange(120)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 122], corner[:, None] + [0, 122, 121]])
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    spot = np.hypot(positions[:, 0] - 0.3, positions[:, 1]) < 0.05
    colors = np.where(spot[:, None], [0, 0, 0], [0.9, 0.8, 0.7]).astype(np.float32)
    _, share, _ = under(
        found(scene(GlbWriter().mesh(positions, faces, {"COLOR_0": colors}))),
        boxes(at(4.5, 0, (1, 1, 1)), at(-4.5, 0, (1, 1, 1))),
    )
    assert share.tolist() == [1, 0]


def test_parts_of_different_materials_are_told_apart() -> None:
    """An eye that is a part of its own, just above the face."""
    writer = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 0.7, 0.6, 1)))
    writer.mesh(QUAD * 0.05 + [0.3, 0, 1e-4], QUAD_FACES, material=plain((0, 0, 0, 1)))
    _, share, _ = under(found(scene(writer)), boxes(at(4.5, 0.75, (1, 0.5, 1)), at(-4.5, 0, (1, 1, 1))))
    assert share[0] > 0.9
    assert share[1] == 0


def test_the_colour_under_a_box_is_the_mean_of_the_surface_in_it() -> None:
    result = found(plate(np.repeat([[[255, 0, 0]] * 8 + [[0, 255, 0]] * 8], 16, axis=0)))
    inside = color_under(result, boxes(at(-7, 0), at(7, 0), at(-7, 0, (1e-3, 1e-3, 1e-3))))
    assert inside == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [1, 0, 0]]))
    (across,) = color_under(result, at(0, 0, (12, 8, 1)))
    assert across == pytest.approx([0.5, 0.5, 0], abs=0.04)  # the luminance within 0.02


def test_boxes_on_the_two_sides_of_a_sheet_see_their_own_colour() -> None:
    back = np.diag([-1.0, 1, -1])
    writer = GlbWriter().mesh(QUAD, QUAD_FACES, material=plain((1, 1, 1, 1)))
    result = found(scene(writer.mesh(QUAD @ back - [0, 0, 0.003], QUAD_FACES, material=plain((0, 0, 0, 1)))))
    front, rear = color_under(result, boxes(at(0, 0), box((0, 0, 0), (2, 1, 1), axes=back)))
    assert front == pytest.approx([1, 1, 1])
    assert rear == pytest.approx([0, 0, 0])


def test_no_boxes_have_no_colour() -> None:
    none = Boxes.empty()
    assert len(color_under(found(plate(drawn(*eye(5, 4)))), none)) == 0


@settings(max_examples=10)
@given(x=st.floats(-12, 12), y=st.floats(-12, 12))
def test_an_eye_is_found_wherever_it_is(x: float, y: float) -> None:
    result = found(plate(drawn(*eye(x, y))))
    away = np.hypot(result.points[:, 0] - x, result.points[:, 1] - y)
    above = result.saliency > result.threshold
    assert above[away < 0.9].mean() > 0.9
    assert not above[away > 2.2].any()


def test_an_eye_is_found_however_the_asset_is_turned() -> None:
    shown, turn = plate(drawn(*eye(5, 4))), rotation((1, 2, 3), 40)
    points, face = sample(shown.surface, 20_000, np.random.default_rng(0))
    turned = replace(shown.surface, positions=shown.surface.positions @ turn.T)
    one, other = (
        texture_saliency(shown, shown.surface, points, face),
        texture_saliency(shown, turned, points @ turn.T, face),
    )
    assert one is not None
    assert other is not None
    assert np.abs(other.saliency - one.saliency).max() < 0.02


def test_the_samples_of_the_saliency_will_do_and_the_same_ones_give_the_same_detail() -> None:
    shown = plate(drawn(*eye(5, 4)))
    map_ = saliency(shown.surface, seed=3)
    one, other = (texture_saliency(shown, shown.surface, map_.points, map_.face) for _ in range(2))
    assert one is not None
    assert other is not None
    assert (one.points == map_.points).all()
    assert (one.normals == map_.normals).all()
    assert one.threshold == other.threshold
    for name in ("saliency", "color_variance", "color"):
        first, second = getattr(one, name), getattr(other, name)
        assert (first == second).all()
        assert first.min() >= 0
        assert first.max() <= 1


@pytest.mark.parametrize("count", [1, 2, 31])
def test_a_handful_of_samples_will_do(count: int) -> None:
    shown = plate(noise(0, 255))
    result = texture_saliency(shown, shown.surface, *sample(shown.surface, count, np.random.default_rng(0)))
    assert result is None if count == 1 else result is not None


def read(path: Path) -> Scene:
    data = path.read_bytes()
    return flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS))


def test_the_eyes_of_a_cow_stand_out_and_its_hide_does_not() -> None:
    result = found(read(DATA / "spot.glb"))
    above = result.saliency > result.threshold
    luminance = result.color @ LUMINANCE
    pupil, hide = luminance < 0.01, luminance > 0.85
    assert 20 < pupil.sum() < 400
    assert above[pupil].mean() > 0.95
    assert above[hide].mean() < 0.15


@pytest.mark.parametrize("path", [MESHES / "glass-hurricane-candle-holder.glb"] * MESHES.exists(), ids=lambda p: p.stem)
def test_the_logos_on_a_glass_stand_out_and_nothing_else_does(path: Path) -> None:
    result = found(read(path))
    above, dark = result.saliency > result.threshold, result.color @ LUMINANCE < 0.45
    assert above[dark].mean() > 0.95
    assert above.mean() < 0.08


@pytest.mark.parametrize("path", [MESHES / "egyptian-cat.glb"] * MESHES.exists(), ids=lambda p: p.stem)
def test_the_painted_face_of_a_cat_stands_out_of_its_weathered_body(path: Path) -> None:
    result = found(read(path))
    above = result.saliency > result.threshold
    height, front = result.points[:, 1], result.normals[:, 2] > 0.3
    assert above[front & (height > 8) & (height < 13)].mean() > 0.85
    assert above[height < 0].mean() < 0.05
