"""Images of a GLB, decoded for drawing."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.errors import ErrorCode
from core.gltf.document import Document, typed
from core.gltf.ktx2 import MAGIC, decode_ktx2
from core.gltf.validate import is_beside
from core.notices import Notice

MAX_PIXELS = 2**26  # pixels; larger images are not decoded

# Pixels a side of textures whose colours are analysed: a pixel of one that spans the asset is 0.03 size-30 units, a
# tenth of a letter; and the number of these that are kept decoded, 4 MiB each.
ANALYSED, KEPT = 1024, 8
LISTED = 5  # textures that a warning names
WEBP, BASISU = "EXT_texture_webp", "KHR_texture_basisu"

_FORMATS = ("PNG", "JPEG", "WEBP")
_REPEAT = 10497
_NEAREST = 9728


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and its sampler.

    Attributes:
        pixels: (H, W, 4) uint8 sRGB with straight alpha, first row on top.
        wrap: GL wrap modes along u and v.
        nearest: magnified texels keep hard edges.
    """

    pixels: NDArray[np.uint8]
    wrap: tuple[int, int]
    nearest: bool


ReadTexture = Callable[[int], Texture | None]


def read_texture(document: Document, index: int, limit: int) -> Texture | None:
    """``textures[index]``, reduced to at most ``limit`` pixels a side.

    A texture may name its image in several formats: the first that can be decoded is taken, KTX2 last.

    Returns:
        ``None`` where none can: damaged, of another kind than PNG, JPEG, WebP and KTX2 with ETC1S or UASTC, in another
        file, or of more than ``MAX_PIXELS``. The document then lists the texture as undecoded.

    Raises:
        MeshmarkError: ``malformed_file`` for references to objects that do not exist.
    """
    texture = document.entry("textures", index)
    images = (document.image(source) for source in sources(texture))
    pixels = next((pixels for image in images if (pixels := _decode(image, limit)) is not None), None)
    if pixels is None:
        document.undecoded.add(index)
        return None
    sampler: dict[str, Any] = document.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    return Texture(
        pixels=pixels,
        wrap=(sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)),
        nearest=sampler.get("magFilter") == _NEAREST,
    )


def texture_reader(document: Document, limit: int = ANALYSED, kept: int | None = KEPT) -> ReadTexture:
    """:func:`read_texture` of a document, which keeps the last ``kept`` textures, or all of them."""
    return lru_cache(kept)(partial(read_texture, document, limit=limit))


def undecoded_textures(document: Document) -> list[Notice]:
    """A warning where textures of a document could not be shown so far; those in other files have one of their own."""
    textures, images = typed(document.json, "textures", list), typed(document.json, "images", list)
    lost = []
    for number in sorted(document.undecoded):
        named = [images[source] for source in sources(textures[number])]
        if not any(is_beside(image) for image in named):
            names = [
                name for entry in (textures[number], *named) if isinstance(name := entry.get("name"), str) and name
            ]
            lost.append(f"textures[{number}]" + (f" ({names[0][:60]!r})" if names else ""))
    if not lost:
        return []
    listed = ", ".join(lost[:LISTED]) + (f" and {len(lost) - LISTED:,} more" if len(lost) > LISTED else "")
    return [
        Notice(
            ErrorCode.TEXTURE_NOT_DECODED,
            f"The images of {listed} could not be decoded. They are carried as they are, but where marks stand, and "
            "what pictures and figures show, is reckoned as if surfaces with them were of their plain base colour and "
            "did not glow.",
            "Embed these textures as PNG, JPEG or WebP, or as KTX2 with ETC1S or UASTC, if the figures matter.",
        )
    ]


def sources(texture: dict[str, Any]) -> list[Any]:
    """The images that a texture names, in the order in which they are tried."""
    extensions = typed(texture, "extensions", dict)
    owners = (typed(extensions, WEBP, dict), texture, typed(extensions, BASISU, dict))
    return [owner["source"] for owner in owners if "source" in owner]


def _decode(data: memoryview | None, limit: int) -> NDArray[np.uint8] | None:
    if data is None:
        return None
    if data[: len(MAGIC)] == MAGIC:
        pixels = decode_ktx2(bytes(data), limit, MAX_PIXELS)
        return (
            None if pixels is None else _reduced([Image.fromarray(band) for band in np.moveaxis(pixels, 2, 0)], limit)
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked just below
            image: Image.Image = Image.open(BytesIO(data), formats=_FORMATS)
        if image.width * image.height > MAX_PIXELS:
            return None
        image.draft("RGB", (limit, limit))  # lets a JPEG be decoded at a fraction of its size
        image = image.convert("RGBA")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):  # raised by Pillow for damaged files
        return None
    # Band by band: Pillow would blacken texels of alpha 0, whose colour opaque materials show. One at a time: those of
    # the largest image take 64 MiB each.
    return _reduced((image.getchannel(band) for band in range(4)), limit)


def _reduced(bands: Iterable[Image.Image], limit: int) -> NDArray[np.uint8]:
    """(H, W, 4) pixels of four bands, at most ``limit`` pixels a side."""
    return np.dstack([np.asarray(band.reduce(-(-max(band.size) // limit))) for band in bands])
