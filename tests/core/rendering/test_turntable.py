"""The turntable shows all sides of an asset, one after the other."""

from functools import cache
from io import BytesIO

import numpy as np
from PIL import Image, ImageSequence

from core.gltf.scene import scene_of
from core.rendering.renderer import Renderer
from core.rendering.turntable import FIRST, FRAMES, turntable
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain

SIDES = ["front", "right", "back", "left"]


@cache
def turned() -> tuple[bytes, bytes]:
    """The turntable and the poster of a cube whose front is red, right side green, back blue and left yellow."""
    colors = {5: (1, 0, 0), 1: (0, 1, 0), 4: (0, 0, 1), 0: (1, 1, 0)}
    writer = GlbWriter()
    for side, color in colors.items():
        writer.mesh(CORNERS, CUBE_FACES[2 * side : 2 * side + 2], material=plain((*color, 1.0)))
    with Renderer(128) as renderer:
        renderer.load(scene_of(writer.bytes()))
        return turntable(renderer)


def side_in(frame: Image.Image) -> str:
    middle = np.asarray(frame.convert("RGB"))[32, 32]
    seen = tuple(int(channel > 60) for channel in middle)
    colors: list[tuple[int, ...]] = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)]
    return SIDES[colors.index(seen)]


def test_it_is_an_animation_without_end_that_turns_once() -> None:
    animation = Image.open(BytesIO(turned()[0]))
    assert (animation.format, animation.size) == ("WEBP", (64, 64))
    assert sum(1 for _ in ImageSequence.Iterator(animation)) == FRAMES
    assert animation.info["loop"] == 0
    shown = []
    for side in range(4):
        animation.seek(round((90 * side - FIRST) % 360 / 360 * FRAMES))
        shown.append(side_in(animation))
    assert shown == SIDES


def test_the_poster_is_its_first_frame() -> None:
    animation, poster = (np.asarray(Image.open(BytesIO(each)).convert("RGB"), dtype=int) for each in turned())
    assert animation.shape == poster.shape
    assert np.abs(animation - poster).mean() < 2


def test_the_same_asset_gives_the_same_bytes() -> None:
    first = turned()
    turned.cache_clear()
    assert turned() == first
