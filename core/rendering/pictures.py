"""The pictures that the visual metrics share: an asset as an ordinary viewer shows it."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.geometry.directions import view_directions
from core.gltf.scene import Scene
from core.rendering.renderer import Frame, Renderer

PICTURE_SIZE = 1024  # pixels a side; OCR depends on it more than on anything else
DIRECTIONS, UPS = view_directions()


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
    cameras, row = np.unique(np.hstack([directions, ups]), axis=0, return_inverse=True)
    return np.stack([renderer.render(camera[:3], camera[3:]) for camera in cameras])[row]
