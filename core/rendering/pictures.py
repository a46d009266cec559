"""The pictures that the visual metrics share: an asset as an ordinary viewer shows it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.geometry.directions import view_directions
from core.gltf.scene import Scene
from core.rendering.renderer import Frame, Renderer

PICTURE_SIZE = 1024  # pixels a side; OCR depends on it more than on anything else
DIRECTIONS, UPS = view_directions()


@dataclass(frozen=True, eq=False)
class Views:
    """Views of an asset, drawn as large as each use needs.

    Attributes:
        compared: (V, N, N, 3) sRGB, to be compared with those of another asset.
        large: (V, S, S, 3) the same views, in which text is looked for; None where nobody looks.
        frame: of both, where these are the paper's 24 views; None where they are others.
    """

    compared: NDArray[np.uint8]
    large: NDArray[np.uint8] | None
    frame: Frame | None


def views(scene: Scene, renderer: Renderer, frame: Frame | None = None, *, large: bool = True) -> Views:
    """The paper's 24 views of a scene, which stays loaded; ``frame`` is that of :func:`pictures`.

    Those to be compared are half as wide as the renderer's pictures: features take 128 or 224 pixels, but drawn no
    larger than that, edges and textures would change the score by up to 0.006; at 512 they change it by 0.0004.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    with renderer.at(renderer.size // 2):
        compared = _drawn(renderer, DIRECTIONS, UPS)
    return Views(compared, _drawn(renderer, DIRECTIONS, UPS) if large else None, renderer.frame)


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
    return _drawn(renderer, directions, ups)


def _drawn(renderer: Renderer, directions: Float, ups: Float) -> NDArray[np.uint8]:
    cameras, row = np.unique(np.hstack([directions, ups]), axis=0, return_inverse=True)
    drawn = np.empty((len(row), renderer.size, renderer.size, 3), dtype=np.uint8)
    for number, camera in enumerate(cameras):
        drawn[row == number] = renderer.render(camera[:3], camera[3:])
    return drawn
