"""The contact sheet: eight views of an asset in one picture."""

from io import BytesIO

import numpy as np
from PIL import Image

from core.rendering.cavity import cavity
from core.rendering.renderer import Renderer

COLUMNS = 4
GAP = 4  # pixels between views
SUPERSAMPLING = 2  # samples a pixel and axis: small letters need smooth edges
GAP_COLOR = (255, 255, 255)

# Azimuth from +Z (the front in glTF) towards +X, and elevation, in degrees, row by row.
VIEWS = ((0, 15), (90, 15), (180, 15), (270, 15), (45, 35), (225, 35), (0, 89.9), (0, -89.9))


def contact_sheet(renderer: Renderer) -> bytes:
    """PNG of eight views of the asset loaded in ``renderer``, in two rows of four, each half as wide as its pictures.

    Front, right, back and left from slightly above; two corners from higher up; top and bottom.
    Folds and ridges are accentuated, so that letters without a colour of their own can be read.
    """
    tile = renderer.size // SUPERSAMPLING
    rows = -(-len(VIEWS) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * (tile + GAP) - GAP, rows * (tile + GAP) - GAP), GAP_COLOR)
    for index, (azimuth, elevation) in enumerate(np.radians(VIEWS)):
        level = np.cos(elevation)
        direction = (level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth))
        row, column = divmod(index, COLUMNS)
        picture = cavity(*renderer.render_with_depth(direction, up=(0, 1, 0)))
        sheet.paste(Image.fromarray(picture).reduce(SUPERSAMPLING), (column * (tile + GAP), row * (tile + GAP)))
    stream = BytesIO()
    sheet.save(stream, format="PNG")
    return stream.getvalue()
