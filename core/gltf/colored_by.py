"""Ways in which letters have a colour."""

from enum import StrEnum


class ColoredBy(StrEnum):
    """Ways in which letters have their colour, from the least conspicuous one on."""

    VERTEX_COLORS = "vertex_colors"
    TEXEL = "texel"
    MATERIAL = "material"
