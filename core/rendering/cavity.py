"""Cavity shading, which makes low relief legible in a small picture."""

import numpy as np
from numpy.typing import NDArray

STEP = 0.3  # size-30 units; a fold this deep between neighbouring pixels gets the full effect
QUIET = 0.04  # size-30 units; shallower folds are the facets of a smoothly shaded mesh, and not accentuated
DARKEN = 0.55  # share of the colour that the deepest fold loses
BRIGHTEN = 70  # 8-bit levels added to the colour of the sharpest ridge, so that letters show on dark surfaces too

_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # each with its opposite


def cavity(picture: NDArray[np.uint8], depth: NDArray[np.float32], shaded: NDArray[np.float32]) -> NDArray[np.uint8]:
    """``picture`` with folds darkened and ridges brightened, in proportion to the shading of its surfaces.

    A letter 0.2 units high that faces the camera has walls thinner than a pixel: shading alone hardly shows it.
    The second difference of the depth does, and it is zero on planes of any orientation. Modelling tools offer the
    same for sculpting.

    Args:
        picture: (H, W, 3) sRGB.
        depth: (H, W) distance along the view axis in size-30 units, 0 where there is nothing. The outermost pixels
            must be empty.
        shaded: (H, W) 0 to 1, the share of each pixel's colour that is made by light.
    """
    fold = folds(depth, QUIET, STEP) * shaded
    dark, bright = np.maximum(fold, 0)[..., None], np.maximum(-fold, 0)[..., None]
    return np.asarray(np.rint(np.clip(picture * (1 - DARKEN * dark) + BRIGHTEN * bright, 0, 255)), dtype=np.uint8)


def folds(depth: NDArray[np.float32], quiet: float, step: float) -> NDArray[np.float32]:
    """(H, W) the second difference of a ``depth`` (H, W), the mean over four directions: 1 in folds deeper than a
    ``step`` between neighbouring pixels, -1 on such ridges; what is within ``quiet`` is 0. Size-30 units."""
    distance = np.where(depth > 0, depth, np.nan)
    fold = np.zeros_like(distance)
    for shift in _NEIGHBOURS:
        before, after = (np.roll(distance, sign * np.array(shift), axis=(0, 1)) for sign in (1, -1))
        depth_of_fold = np.nan_to_num(2 * distance - before - after)
        loud = np.sign(depth_of_fold) * np.maximum(np.abs(depth_of_fold) - quiet, 0)
        fold += np.clip(loud / step, -1, 1)
    return np.asarray(fold / len(_NEIGHBOURS))
