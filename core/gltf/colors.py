"""Colours as files write them (sRGB), as glTF calculates with them (linear), and as eyes compare them (CIELAB)."""

import numpy as np

from core.arrays import Float
from core.geometry.products import product

_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)

# Its inverse, as Lindbloom gives both: the same numbers with every linear algebra library.
_RGB = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)


def linear(colors: Float) -> Float:
    """Colours (..., 3 or 4) in 0-1 from sRGB, as files store them, to linear, as glTF does; alpha stays."""
    rgb = colors[..., :3]
    result = colors.copy()
    result[..., :3] = np.where(rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0) + 0.055) / 1.055) ** 2.4)
    return result


def srgb(colors: Float) -> Float:
    """Colours (..., 3 or 4) in 0-1 from linear to sRGB; alpha stays: the inverse of :func:`linear`."""
    rgb = colors[..., :3]
    result = colors.copy()
    result[..., :3] = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * np.maximum(rgb, 0.0031308) ** (1 / 2.4) - 0.055)
    return result


def hex_linear(color: str) -> Float:
    """(3,) linear RGB, 0-1, of ``"#rrggbb"``."""
    return linear(np.array([int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]))


def hex_srgb(color: Float) -> str:
    """The nearest ``"#rrggbb"`` to linear RGB (3,) in 0-1: the inverse of :func:`hex_linear`."""
    return "#" + "".join(f"{level:02x}" for level in np.rint(srgb(color) * 255).astype(int).tolist())


def cielab(linear: Float) -> Float:
    """(N, 3) CIELAB (D65) of linear sRGB colours."""
    xyz = product(linear, _XYZ.T) / _XYZ.sum(axis=1)
    x, y, z = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29).T
    return np.column_stack([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def from_cielab(lab: Float) -> Float:
    """(N, 3) linear sRGB of CIELAB (D65) colours; outside 0 to 1 where sRGB does not have them."""
    y = (lab[:, 0] + 16) / 116
    steps = np.column_stack([y + lab[:, 1] / 500, y, y - lab[:, 2] / 200])
    xyz = np.where(steps > 6 / 29, steps**3, 3 * (6 / 29) ** 2 * (steps - 4 / 29)) * _XYZ.sum(axis=1)
    return product(xyz, _RGB.T)
