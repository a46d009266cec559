"""Pictures of a GLB, and what is seen in them."""

import numpy as np
from numpy.typing import NDArray

from core.gltf.scene import scene_of
from core.rendering.renderer import BACKGROUND, Renderer

Picture = NDArray[np.uint8]

SIZE = 128
FRONT, UP = (0, 0, 1), (0, 1, 0)
GREY = round(BACKGROUND * 255)
RED, GREEN, BLUE, YELLOW = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
FOUR_COLORS = np.array([[RED, GREEN], [BLUE, YELLOW]], dtype=np.uint8).repeat(8, axis=0).repeat(8, axis=1)


def shoot(renderer: Renderer, glb: bytes, direction: tuple[float, ...] = FRONT) -> Picture:
    renderer.load(scene_of(glb))
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
