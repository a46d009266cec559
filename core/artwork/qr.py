"""QR codes as logos: dark modules stand out or in, and a frame keeps the quiet zone free; on dark ground the light
modules do, with the quiet zone as a plate round them."""

import numpy as np
from manifold3d import CrossSection, OpType

from core.artwork.artwork import Artwork
from core.artwork.qr_code import FRAME, MIN_MODULE, QUIET_ZONE, qr_modules, side_of
from core.artwork.rings import clear_rings, normalised

FINDER = 7  # modules; a finder pattern has to be as large as letters are to be made out


def qr_artwork(content: str) -> Artwork:
    """A QR code with a frame round its quiet zone, and in light the plate that its dark modules are cut out of;
    errors as of :func:`qr_modules`."""
    modules = np.array(qr_modules(content), dtype=bool)[::-1]
    margin, side = QUIET_ZONE + FRAME, side_of(modules.tolist())
    squares = [_square(column + margin, row + margin, 1) for row, column in np.argwhere(modules).tolist()]
    dark, plate = CrossSection.batch_boolean(squares, OpType.Add), _square(0, 0, side)
    frame = plate - _square(FRAME, FRAME, side - 2 * FRAME)
    framed, cut_out = (clear_rings(region.scale((1 / side, 1 / side))) for region in (dark + frame, plate - dark))
    rings, aspect, ink = normalised(framed)
    light = normalised(cut_out)[0]
    return Artwork("", rings, aspect, ink, FINDER / side, logo="qr", least_width=MIN_MODULE * side, light=light)


def _square(x: float, y: float, side: float) -> CrossSection:
    return CrossSection.square((side, side)).translate((x, y))
