"""Relief of a suspect surface over its original's, in the boxes of marks."""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.geometry.spatial import RayCaster
from core.verify.look import Picture

COLUMNS = 320  # cells across a box
ROWS = 16, 640  # cells up a box, at least and at most
STANDS_OUT = 0.25  # of a mark's height, from which on a cell stands out
HIGH = 98  # percentile of the magnitudes that is a mark's height
BELOW, LEVEL, ABOVE, NOTHING = (33, 102, 172), (247, 247, 247), (178, 24, 43), (120, 120, 120)


def height_field(box: Boxes, suspect: RayCaster, original: RayCaster) -> tuple[Float, Bool]:
    """(H, W) height of the suspect over the original along the normal of the one ``box``, size-30 units, their median
    taken off, the first row at the top; and where both have a surface near it.

    Args:
        box: in the original's size-30 frame, as are both surfaces.
        suspect, original: what rays are cast on.
    """
    across, up, thick = box.size[0]
    rows = int(np.clip(round(COLUMNS * up / across), *ROWS))
    u, v = (np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5, 0.5 - (np.arange(rows) + 0.5) / rows
    x, y = np.meshgrid(u * across, v * up)
    # From as far above the box as it is thick: a suspect that was moved a little must not rise over the rays' origins.
    local = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.5 * thick)])
    origins = box.center[0] + product(local, box.axes[0])
    down = np.broadcast_to(-box.axes[0, 2], origins.shape)
    mine, ground = suspect.first_hit(origins, down)[0], original.first_hit(origins, down)[0]
    met = (mine <= 3 * thick) & (ground <= 3 * thick)
    height = np.subtract(ground, mine, out=np.zeros_like(mine), where=met)
    level = float(np.median(height[met])) if met.any() else 0.0
    return np.where(met, height - level, 0.0).reshape(rows, COLUMNS), met.reshape(rows, COLUMNS)


def tallest(height: Float, met: Bool) -> float:
    """Height of what stands out most of a (H, W) field, negative where it lies in the surface; its unit."""
    if not met.any():
        return 0.0
    most = float(np.percentile(np.abs(height[met]), HIGH))
    out = height[met & (np.abs(height) >= most)]
    return most if np.median(out) >= 0 else -most


def standing_out(height: Float, met: Bool, relief: float) -> float:
    """Share of the cells of a (H, W) field that stand out by a quarter of ``relief``, its unit, or more."""
    return float((np.abs(height) >= STANDS_OUT * relief).mean(where=met)) if met.any() else 0.0


def height_picture(height: Float, met: Bool) -> Picture:
    """(H, W, 3) picture of a field (H, W): red stands out, blue lies in the surface, grey has none."""
    full = max(abs(tallest(height, met)), np.finfo(float).tiny)
    share = np.clip(height / full, -1, 1)[..., None]
    level, above, below = (np.array(color, dtype=np.float64) for color in (LEVEL, ABOVE, BELOW))
    color = level + np.where(share > 0, share * (above - level), -share * (below - level))
    color[~met] = NOTHING
    return np.round(color).astype(np.uint8)
