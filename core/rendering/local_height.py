"""Pictures of how far a surface stands out of its surroundings, in which letters are read that noise on their edges
hides from relief pictures."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from core.rendering.relief import BACKGROUND, GROUND

RANGE = 100  # 8-bit grey levels for a height of a step
AROUND = 10  # width of the surroundings over the grain; both measured on six assets shaken by 0.001 of their diagonal


def local_height(depth: NDArray[np.float32], grain: float, step: float) -> NDArray[np.uint8]:
    """(H, W, 3) grey picture of a ``depth`` (H, W), size-30 units, 0 where there is nothing: a surface that lies a
    ``step`` before its surroundings is dark, one that lies behind them bright.

    The mean over some ``grain``, pixels, is compared with that over ten times as much (a difference of Gaussians): a
    vertex that was moved alone vanishes in the one, the asset's own curvature in the other.
    """
    there = (depth > 0).astype(np.float32)
    fine = _mean(depth, there, lambda values: cv2.GaussianBlur(values, (0, 0), grain))
    wide = round(AROUND * grain * 0.85) * 2 + 1  # two boxes of this width spread as a Gaussian of the surroundings
    coarse = _mean(depth, there, lambda values: cv2.blur(cv2.blur(values, (wide, wide)), (wide, wide)))
    level = np.where(there > 0, GROUND - RANGE * np.clip((coarse - fine) / step, -1, 1), BACKGROUND)
    return np.repeat(level.astype(np.uint8)[..., None], 3, axis=2)


def _mean(
    depth: NDArray[np.float32], there: NDArray[np.float32], blur: Callable[[NDArray[np.float32]], object]
) -> NDArray[np.float32]:
    """The mean of the depth around each pixel, of the pixels that show something."""
    share = np.asarray(blur(there), dtype=np.float32)
    mean = np.asarray(blur(depth), dtype=np.float32) / np.maximum(share, np.float32(1e-6))
    return np.asarray(mean, dtype=np.float32)
