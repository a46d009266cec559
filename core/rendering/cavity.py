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
        depth: (H, W) distance along the view axis in size-30 units, 0 where there is nothing.
        shaded: (H, W) 0 to 1, the share of each pixel's colour that is made by light.
    """
    picture, there = picture.copy(), _bounds(depth > 0)
    fold = folds(depth[there], QUIET, STEP) * shaded[there]
    folded = np.nonzero(fold)
    dark, bright = np.maximum(fold[folded], 0)[:, None], np.maximum(-fold[folded], 0)[:, None]
    shade = picture[there][folded] * (1 - DARKEN * dark) + BRIGHTEN * bright
    picture[there][folded] = np.rint(np.clip(shade, 0, 255))
    return picture


def folds(depth: NDArray[np.float32], quiet: float, step: float) -> NDArray[np.float32]:
    """(H, W) the second difference of a ``depth`` (H, W), the mean over four directions: 1 in folds deeper than a
    ``step`` between neighbouring pixels, -1 on such ridges; 0 within ``quiet``, beside nothing, and at the rim of the
    picture. Size-30 units."""
    distance = np.where(depth > 0, depth, np.nan)
    fold = np.zeros_like(distance)
    twice, inner = 2 * distance[1:-1, 1:-1], fold[1:-1, 1:-1]
    height, width = distance.shape
    for down, right in _NEIGHBOURS:
        before, after = (
            distance[1 + sign * down : height - 1 + sign * down, 1 + sign * right : width - 1 + sign * right]
            for sign in (1, -1)
        )
        deep = twice - before - after
        deep -= np.clip(deep, -quiet, quiet)
        deep /= step
        np.clip(deep, -1, 1, out=deep)
        np.add(inner, deep, out=inner, where=deep == deep)  # beside nothing there is no fold
    return np.asarray(fold / len(_NEIGHBOURS))


def _bounds(there: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of all that is in a picture (H, W), and one more on each side."""
    rows, columns = (np.flatnonzero(there.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0), slice(0)
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)
