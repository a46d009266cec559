"""Pictures of an artwork's shapes."""

import numpy as np
from PIL import Image, ImageDraw

from core.arrays import Bool
from core.artwork.artwork import Artwork
from core.geometry.triangles import ring_area


def raster(artwork: Artwork, texels: int) -> Bool:
    """(H, W) texels of the artwork's bounding box whose centres its shapes cover, W = ``texels`` and the first row at
    the bottom. Rings are disjoint, so an island in a hole is drawn after the hole."""
    size = texels, max(round(texels * artwork.aspect), 1)
    picture = Image.new("1", size)
    draw = ImageDraw.Draw(picture)
    for ring in sorted(artwork.rings, key=lambda ring: -abs(ring_area(ring))):
        corners = (ring + np.array([0.5, artwork.aspect / 2])) * texels - 0.5
        draw.polygon([tuple(corner) for corner in corners.tolist()], fill=int(ring_area(ring) > 0))
    return np.asarray(picture)
