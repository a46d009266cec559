"""Referee of logos: another renderer, resvg, draws the same file, and what we read of it must look the same."""

import io

import cv2
import numpy as np
import resvg_py
from manifold3d import CrossSection
from numpy.typing import NDArray
from PIL import Image

from core.errors import ErrorCode, MeshmarkError

Pixels = NDArray[np.float32]

PIXELS = 800, 2400  # on the longer side; finer where the coarser drawing differs, which its own curves may cause
TOLERANCE = 0.005  # share of the area
_PATH = '<svg xmlns="http://www.w3.org/2000/svg" width="{}" height="{}" viewBox="0 0 {} {}"><path d="{}"/></svg>'


def check_drawing(original: bytes, in_tones: bytes, region: CrossSection, size: tuple[float, float]) -> None:
    """Compare the ink that was read of a logo with what resvg draws.

    Args:
        original: the file as it was sent: what it paints must be where ``in_tones`` paints.
        in_tones: the same document with its styles as attributes, in black ink on white ground, opaque.
        region: ink that was read, y down, in shares of the longer side of the drawing.
        size: of the drawing.

    Raises:
        MeshmarkError: ``invalid_logo`` where areas or places differ by more than half a per cent of the area.
    """
    for pixels in PIXELS:
        off = _difference((original, in_tones, _path(region, size)), region.area(), pixels)
        if off <= TOLERANCE:
            return
    raise MeshmarkError(
        ErrorCode.INVALID_LOGO,
        f"Another renderer draws the logo otherwise than it was read here: {min(off, 1):.1%} of its area differ.",
        "Turn strokes, copies and clips into plain filled paths in the drawing program and export again.",
    )


def _difference(drawings: tuple[bytes, bytes, bytes], area: float, pixels: int) -> float:
    """The largest difference in area or place, as a share of the area of ink."""
    original, toned, ours = (_drawn(svg, pixels) for svg in drawings)
    ink, painted = toned[..., 3] * (1 - toned[..., 0]), original[..., 3]
    covered = area * pixels**2
    return max(
        abs(float(ink.sum(dtype=np.float64)) - covered) / covered,
        _apart(ours[..., 3], ink, 0.5) / covered,
        _apart(painted, toned[..., 3], 0.0) / max(float(np.count_nonzero(painted)), 1.0),
    )


def _drawn(svg: bytes, pixels: int) -> Pixels:
    """(H, W, 4) pixels of a drawing, 0 to 1."""
    try:
        png = resvg_py.svg_to_bytes(svg.decode("utf-8-sig"), skip_system_fonts=True, width=pixels, height=pixels)
    except ValueError as error:
        raise MeshmarkError(
            ErrorCode.INVALID_LOGO,
            f"The logo cannot be drawn: {str(error)[:120]}.",
            "Export it again from the drawing program.",
        ) from None
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGBA"), dtype=np.float32) / np.float32(255)


def _apart(one: Pixels, other: Pixels, least: float) -> float:
    """Number of pixels that one drawing covers by more than ``least``, and the other neither there nor beside it."""
    beside = [cv2.dilate((drawing > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0 for drawing in (one, other)]
    return float(np.count_nonzero(((one > least) & ~beside[1]) | ((other > least) & ~beside[0])))


def _path(region: CrossSection, size: tuple[float, float]) -> bytes:
    unit = max(size)
    data = "".join("M" + " ".join(f"{x:.9f},{y:.9f}" for x, y in ring.tolist()) + "z" for ring in region.to_polygons())
    box = size[0] / unit, size[1] / unit
    return _PATH.format(*size, *box, data).encode()
