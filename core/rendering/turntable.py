"""The turntable: an asset that turns once about its vertical axis, as an animated picture, and its first frame."""

from io import BytesIO

import numpy as np
from PIL import Image

from core.rendering.cavity import cavity
from core.rendering.renderer import Renderer

FRAMES, DURATION = 48, 80  # milliseconds a frame: a turn takes four seconds
FIRST, ELEVATION = 30, 15  # degrees from +Z (the front in glTF) towards +X, and upwards
SUPERSAMPLING = 2  # samples a pixel and axis
QUALITY = 80  # of WebP


def turntable(renderer: Renderer) -> tuple[bytes, bytes]:
    """Animated WebP and poster of the asset loaded in ``renderer``, both WebP and half as wide as its pictures.

    The asset turns to the left, seen from slightly above, and the animation is repeated without end.
    """
    frames = [_frame(renderer, angle) for angle in FIRST + 360 / FRAMES * np.arange(FRAMES)]
    animation, poster = BytesIO(), BytesIO()
    frames[0].save(
        animation,
        format="WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=DURATION,
        loop=0,
        quality=QUALITY,
        minimize_size=False,
    )
    frames[0].save(poster, format="WEBP", quality=QUALITY)
    return animation.getvalue(), poster.getvalue()


def _frame(renderer: Renderer, azimuth: float) -> Image.Image:
    turn, rise = np.radians((azimuth, ELEVATION))
    direction = (np.cos(rise) * np.sin(turn), np.sin(rise), np.cos(rise) * np.cos(turn))
    return Image.fromarray(cavity(*renderer.render_with_depth(direction, up=(0, 1, 0)))).reduce(SUPERSAMPLING)
