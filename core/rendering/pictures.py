"""The pictures that the visual metrics share: an asset as an ordinary viewer shows it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.arrays import Bool, Float
from core.geometry.directions import view_directions
from core.gltf.scene import Scene
from core.rendering.renderer import Frame, Renderer

PICTURE_SIZE = 1024  # pixels a side; OCR depends on it more than on anything else
DIRECTIONS, UPS = view_directions()

Pictures = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Views:
    """Views of an asset, as large as each use needs.

    Attributes:
        compared: (V, N, N, 3) sRGB, to be compared with those of another asset.
        large: (V, S, S, 3) the same views, in which text is looked for; None where nobody looks.
        frame: of both, where these are the paper's 24 views; None where they are others.
    """

    compared: Pictures
    large: Pictures | None
    frame: Frame | None


def views(scene: Scene, renderer: Renderer, frame: Frame | None = None, *, large: bool = True) -> Views:
    """The paper's 24 views of a scene, which stays loaded; ``frame`` is that of :func:`pictures`.

    Those to be compared are half as wide as the renderer's pictures, means of four pixels. They are drawn as large:
    features take 128 or 224 pixels, but from pictures that are drawn as small as that the score differs by up to 0.006,
    and to draw the marked asset in both sizes takes longer than to draw the original in the larger one.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    half = renderer.size // 2
    compared = np.empty((len(DIRECTIONS), half, half, 3), dtype=np.uint8)
    drawn = np.empty((len(DIRECTIONS), renderer.size, renderer.size, 3), dtype=np.uint8) if large else None
    for picture, rows in _each(renderer, DIRECTIONS, UPS):
        compared[rows] = np.asarray(Image.fromarray(picture).reduce(2))
        if drawn is not None:
            drawn[rows] = picture
    return Views(compared, drawn, renderer.frame)


def pictures(
    scene: Scene, renderer: Renderer, directions: Float = DIRECTIONS, ups: Float = UPS, frame: Frame | None = None
) -> NDArray[np.uint8]:
    """(V, S, S, 3) sRGB pictures of a scene, one for each camera; by default the paper's 24 views.

    A camera that occurs twice, as the front does in the 24 views, is drawn once.

    Args:
        scene: it stays loaded.
        renderer: S is its size.
        directions: (V, 3) from the object to each camera.
        ups: (V, 3) directions that point upwards in each picture.
        frame: the view; None: of the asset.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    drawn = np.empty((len(directions), renderer.size, renderer.size, 3), dtype=np.uint8)
    for picture, rows in _each(renderer, directions, ups):
        drawn[rows] = picture
    return drawn


def _each(renderer: Renderer, directions: Float, ups: Float) -> Iterator[tuple[Pictures, Bool]]:
    """The picture of each different camera, and which of the views show it."""
    cameras, row = np.unique(np.hstack([directions, ups]), axis=0, return_inverse=True)
    for number, camera in enumerate(cameras):
        yield renderer.render(camera[:3], camera[3:]), row == number
