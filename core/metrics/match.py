"""Match of each mark's relief with the artwork that was embossed (ours): for every script, and for logos."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from core.arrays import Bool, Float
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.artwork.raster import raster
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.geometry.spatial import Eye, RayCaster


@dataclass(frozen=True)
class MatchOptions:
    """Values of :func:`match`: all ours. With them marks on four assets match with 0.90 to 0.97 in the mean, the same
    places before they were marked with 0.05 at most, mirrored artwork with 0.16, other text in the same font with 0.29.
    The paper has no such metric.

    Attributes:
        rays: a mark, about.
        finer: texels of the artwork for each ray, along and across.
        ground: mean stroke widths; deviation of the Gaussian weights that the ground around a point is averaged with.
        smooth: mean stroke widths; that of the weights both pictures are smoothed with.
        wall: mean stroke widths; that of the weights which stand for inclined walls in the picture of the artwork.
        shift: rays that the relief may be off the artwork, each way.
        room: share of the box's thickness above and below it in which the surface is still looked for.
        faint: share of a faithful relief's amplitude, below which a relief matches the less, the weaker it is.
    """

    rays: int = 16_384
    finer: int = 4
    ground: float = 0.7
    smooth: float = 0.3
    wall: float = 0.18
    shift: int = 2
    room: float = 0.5
    faint: float = 0.1


MATCH = MatchOptions()


def match(
    boxes: Boxes,
    relief: Float,
    layouts: Layouts,
    index: RayCaster,
    options: MatchOptions = MATCH,
    ground: RayCaster | None = None,
) -> Float:
    """(B,) likeness of what each mark shows from the front to its artwork, 0 to 1.

    Rays along the mark's normal find the height of the surface over its box and a margin around it. From the heights,
    and from the picture of the artwork, the local mean is taken away, so that the ground's own shape does not count;
    the likeness is the magnitude of their normalised cross-correlation, the largest over small shifts. It is near 1 for
    a faithful mark, raised or sunken, and near 0 where there is none.

    Args:
        boxes: the marks' bounds, size-30 units.
        relief: (B,) height of their letters, size-30 units.
        layouts: that the marks are set in.
        index: over the watermarked surface.
        options: tuned values.
        ground: over the surface without marks, where it is known: heights are then those over it.
    """
    likeness = np.zeros(len(boxes))
    layout = layouts.of(boxes.size)
    for number in np.unique(layout).tolist():
        pattern = _pattern(layouts.artworks[number], options)
        for mark in np.flatnonzero(layout == number).tolist():
            height, met = _heights(boxes[np.array([mark])], pattern, index, options)
            if ground is not None:
                below, known = _heights(boxes[np.array([mark])], pattern, ground, options)
                height, met = height - below, met & known
            seen = _relief(height / max(abs(relief[mark]), np.finfo(float).tiny), met, options.ground * pattern.stroke)
            smooth = gaussian_filter(np.clip(seen, -1, 1), options.smooth * pattern.stroke)
            likeness[mark] = _correlation(pattern.relief, smooth, options)
    return likeness


@dataclass(frozen=True, eq=False)
class _Pattern:
    """An artwork as its marks should look, one value a ray."""

    relief: Float  # (H, W) of a relief of height 1, the first row at the bottom
    columns: int  # across the artwork, without the margin
    margin: int  # on each side of its box
    stroke: float  # mean width of its strokes, in rays


def _pattern(artwork: Artwork, options: MatchOptions) -> _Pattern:
    columns = max(round(np.sqrt(options.rays / artwork.aspect)), 1)
    outline = sum(float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum()) for ring in artwork.rings)
    stroke = 2 * artwork.ink * artwork.aspect / outline * columns
    margin = int(np.ceil(2 * options.ground * stroke))
    fine = raster(artwork, columns * options.finer)
    fine = np.pad(fine, ((0, -len(fine) % options.finer), (0, 0)))
    cells = np.pad(fine.reshape(-1, options.finer, columns, options.finer).mean(axis=(1, 3)), margin)
    walled = gaussian_filter(cells, options.wall * stroke)
    relief = _relief(walled, np.ones(cells.shape, dtype=bool), options.ground * stroke)
    return _Pattern(gaussian_filter(relief, options.smooth * stroke), columns, margin, stroke)


def _heights(box: Boxes, pattern: _Pattern, index: RayCaster, options: MatchOptions) -> tuple[Float, Bool]:
    """(H, W) height of the surface at each ray over the one ``box``, size-30 units; and where there is any."""
    shape, size = pattern.relief.shape, box.size[0]
    u, v = (
        (np.arange(count) - pattern.margin + 0.5) * size[0] / pattern.columns - side / 2
        for count, side in zip(shape[::-1], size[:2], strict=True)
    )
    across, up = np.meshgrid(u, v)
    top = size[2] * (0.5 + options.room)
    local = np.column_stack([across.ravel(), up.ravel(), np.full(across.size, top)])
    origins = box.center[0] + product(local, box.axes[0])
    distance, _ = index.first_hit(origins, np.broadcast_to(-box.axes[0, 2], origins.shape), Eye.ORIGIN)
    met = distance <= 2 * top
    return (top - np.where(met, distance, top)).reshape(shape), met.reshape(shape)


def _relief(height: Float, met: Bool, deviation: float) -> Float:
    """(H, W) height above the mean around it, 0 where there is no surface; the ``deviation`` of its weights in rays."""
    weight = gaussian_filter(met.astype(np.float64), deviation, mode="constant")
    mean = gaussian_filter(np.where(met, height, 0.0), deviation, mode="constant")
    return np.where(met, height - mean / np.maximum(weight, np.finfo(float).tiny), 0.0)


def _correlation(wanted: Float, seen: Float, options: MatchOptions) -> float:
    """The largest magnitude of the normalised cross-correlation of two (H, W) pictures, one shifted a little."""
    shift = options.shift
    one = wanted[shift:-shift, shift:-shift]
    one = one - one.mean()
    energy = float((one**2).sum())
    best = 0.0
    for down in range(2 * shift + 1):
        for right in range(2 * shift + 1):
            other = seen[down : down + one.shape[0], right : right + one.shape[1]]
            other = other - other.mean()
            least = max(float((other**2).sum()), options.faint**2 * energy)
            best = max(best, abs(float((one * other).sum())) / np.sqrt(energy * least))
    return min(best, 1.0)
