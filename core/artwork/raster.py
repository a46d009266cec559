"""Pictures of an artwork's shapes."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from core.arrays import Bool, Float
from core.artwork.artwork import Artwork
from core.geometry.triangles import ring_area


def raster(artwork: Artwork, texels: int) -> Bool:
    """(H, W) texels of the artwork's bounding box whose centres its shapes cover, W = ``texels`` and the first row at
    the bottom."""
    size = texels, max(round(texels * artwork.aspect), 1)
    return filled(artwork.rings, np.array([-0.5, -artwork.aspect / 2]), texels, size)


def filled(rings: Sequence[Float], corner: Float, resolution: float, size: tuple[int, int]) -> Bool:
    """(H, W) texels whose centres ``rings`` cover, the first row at the bottom. Rings are disjoint, so an island in a
    hole is drawn after the hole.

    Args:
        rings: (N, 2) each, holes clockwise.
        corner: (2,) the lower left corner of the picture.
        resolution: texels a unit.
        size: width and height in texels.
    """
    picture = Image.new("1", size)
    draw = ImageDraw.Draw(picture)
    for ring in sorted(rings, key=lambda ring: -abs(ring_area(ring))):
        corners = (ring - corner) * resolution - 0.5
        draw.polygon([tuple(one) for one in corners.tolist()], fill=int(ring_area(ring) > 0))
    return np.asarray(np.asarray(picture).view(np.uint8) > 0)  # Pillow's true is 255
