"""Relief pictures: the shape of a surface without its colours and lights, in which letters are read that its texture
hides."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.gltf.scene import Scene
from core.rendering.cavity import folds
from core.rendering.renderer import Frame, Renderer

STEP = 0.03  # size-30 units; a fold this deep between neighbouring pixels is black, a ridge white
GROUND, BACKGROUND, RANGE = 150, 235, 140  # 8-bit grey levels: of flat surface, of nothing, and of the deepest fold


def relief_pictures(
    scene: Scene, renderer: Renderer, directions: Float, ups: Float, frame: Frame | None = None
) -> NDArray[np.uint8]:
    """(V, S, S, 3) relief pictures of a scene, one for each camera; the arguments are those of
    :func:`core.rendering.pictures.pictures`.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    return np.stack([relief(renderer.render_with_depth(*camera)[1]) for camera in zip(directions, ups, strict=True)])


def relief(depth: NDArray[np.float32], nearer: float = 1.0) -> NDArray[np.uint8]:
    """(H, W, 3) grey picture of the second difference of a ``depth`` (H, W), size-30 units, 0 where there is nothing.

    It is zero on planes of any orientation: what is left are folds, dark, and ridges, bright. ``nearer`` is the width
    of a pixel over that in a picture of a whole asset: folds between nearer pixels are shallower.
    """
    level = np.where(depth > 0, GROUND - RANGE * folds(depth, 0.0, STEP * nearer), BACKGROUND)
    return np.repeat(np.clip(level, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
