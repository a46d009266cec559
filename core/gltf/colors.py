"""Colours as files write them (sRGB) and as glTF calculates with them (linear)."""

import numpy as np

from core.arrays import Float


def linear(colors: Float) -> Float:
    """Colours (..., 3 or 4) in 0-1 from sRGB, as files store them, to linear, as glTF does; alpha stays."""
    rgb = colors[..., :3]
    result = colors.copy()
    result[..., :3] = np.where(rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0) + 0.055) / 1.055) ** 2.4)
    return result


def hex_linear(color: str) -> Float:
    """(3,) linear RGB, 0-1, of ``"#rrggbb"``."""
    return linear(np.array([int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]))


def hex_srgb(color: Float) -> str:
    """The nearest ``"#rrggbb"`` to linear RGB (3,) in 0-1: the inverse of :func:`hex_linear`."""
    encoded = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{level:02x}" for level in np.rint(encoded * 255).astype(int).tolist())
