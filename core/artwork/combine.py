"""A logo and a text in one mark."""

from dataclasses import replace

import numpy as np

from core.artwork.artwork import Artwork
from core.artwork.rings import normalised
from core.choices import LogoPosition

GAP = 0.4  # between logo and text, in heights of a line
# Height of a logo, in heights of a line of the text beside it or below it: at least so many, or all of the text.
LINES_BESIDE = 1.6
# Of a QR code, whose modules are smaller than strokes of letters. At 1.6 lines a mark with "watermark" must be 13 wide
# for them to be read, and has 0, 3 and 1 places on suzanne, koala and fox; at 4 it is 6.5 wide, and has 9, 9 and 2.
LINES_BESIDE_CODE = 4.0
# Height of a logo above a text, in the text's widths and at most, and in heights of a line and at least.
WIDTHS_ABOVE, LINES_ABOVE = 0.6, 2.0


def beside(logo: Artwork, text: Artwork, position: LogoPosition) -> Artwork:
    """The logo to the left of the text, or above it, in proportion to it, both centred on a common line.

    To the left it is as high as the text, and at least 1.6 lines, a QR code 4. Above it is as wide as the text at
    most, and 0.6 of its width or two lines high, whichever is more. Legibility and relief go by the lower of a line and
    the finder pattern of a code.
    """
    line = text.line_height
    if position is LogoPosition.LEFT:
        height = max(text.aspect, (LINES_BESIDE_CODE if logo.logo == "qr" else LINES_BESIDE) * line)
        width = height / logo.aspect
        shift = np.array([-(1 + width) / 2 - GAP * line, 0.0])
    else:
        height = min(max(WIDTHS_ABOVE, LINES_ABOVE * line), logo.aspect)
        width = height / logo.aspect
        shift = np.array([0.0, (text.aspect + height) / 2 + GAP * line])
    placed, light = (
        [*text.rings, *(ring * width + shift for ring in rings)] for rings in (logo.rings, logo.light or ())
    )
    rings, aspect, ink = normalised(placed)
    whole = float(np.ptp(np.concatenate(placed)[:, 0]))
    return replace(
        text,
        rings=rings,
        aspect=aspect,
        ink=ink,
        line_height=(min(line, logo.line_height * width) if logo.logo == "qr" else line) / whole,
        logo=logo.logo,
        least_width=logo.least_width * whole / width,
        light=normalised(light)[0] if logo.light else None,
    )
