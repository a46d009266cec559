"""Base colour images of a GLB, decoded for drawing."""

import warnings
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.asset.gltf import Document, typed

MAX_PIXELS = 2**26  # what is larger is not decoded; the primitive is drawn in its plain base colour

_FORMATS = ("PNG", "JPEG", "WEBP")
_REPEAT = 10497
_NEAREST = 9728


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and how it is sampled.

    Attributes:
        pixels: (H, W, 4) uint8 sRGB with straight alpha, first row on top.
        wrap: GL wrap modes along u and v.
        nearest: magnified texels keep hard edges.
    """

    pixels: NDArray[np.uint8]
    wrap: tuple[int, int]
    nearest: bool


def read_texture(document: Document, index: int, limit: int) -> Texture | None:
    """``textures[index]``, reduced to at most ``limit`` pixels a side.

    Returns:
        ``None`` for an image that cannot be shown here: KTX2, damaged, in another file, or beyond ``MAX_PIXELS``.

    Raises:
        MeshmarkError: ``malformed_file`` for references to objects that do not exist.
    """
    texture = document.entry("textures", index)
    webp = typed(typed(texture, "extensions", dict), "EXT_texture_webp", dict)
    source = webp.get("source", texture.get("source"))
    if source is None:
        return None
    pixels = _decode(document.image(source), limit)
    if pixels is None:
        return None
    sampler: dict[str, Any] = document.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    return Texture(
        pixels=pixels,
        wrap=(sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)),
        nearest=sampler.get("magFilter") == _NEAREST,
    )


def _decode(data: memoryview | None, limit: int) -> NDArray[np.uint8] | None:
    if data is None:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked just below
            image: Image.Image = Image.open(BytesIO(data), formats=_FORMATS)
        if image.width * image.height > MAX_PIXELS:
            return None
        image.draft("RGB", (limit, limit))  # lets a JPEG be decoded at a fraction of its size
        image = image.convert("RGBA")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):  # what Pillow raises on damaged files
        return None
    factor = -(-max(image.size) // limit)
    # Band by band: Pillow would blacken texels of alpha 0, whose colour opaque materials show. One at a time: those of
    # the largest image take 64 MiB each.
    return np.dstack([np.asarray(image.getchannel(band).reduce(factor)) for band in range(4)])
