"""A document with smaller images, and with none but those that its materials show."""

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.gltf.builder import Builder
from core.gltf.document import Document
from core.gltf.images import image_size, mime_type
from core.gltf.shown import forget
from core.gltf.texture_infos import texture_infos
from core.gltf.textures import BASISU, WEBP, read_texture, sources

Json = dict[str, Any]

QUALITY = 85  # of JPEGs
_PLAIN = ("image/png", "image/jpeg")
_LOSSY = ("image/jpeg", "image/webp", "image/ktx2")
_OTHERS = ("EXT_texture_avif", "MSFT_texture_dds")


def smaller_textures(document: Document, limit: int) -> tuple[Document, list[tuple[int, int]], list[int]]:
    """The document with images of at most ``limit`` pixels a side, as PNG or JPEG.

    Images that are small enough keep their bytes. Of those that nothing shows, the last are left out; others become one
    white pixel, so that those behind them keep their numbers. A texture that cannot be decoded, or lies in another
    file, is taken off its materials: it could not be made smaller.

    Returns:
        The document, the (width, height) of each image that is left, and the numbers of the textures that were taken
        off.

    Raises:
        MeshmarkError: ``malformed_file`` for references to objects that do not exist.
    """
    if "textures" not in document.json and "images" not in document.json:
        return document, [], []
    editor = Builder(document)
    materials = editor.json.get("materials", [])
    infos = [info for material in materials for info in texture_infos(material)]
    shown = sorted({owner[key]["index"] for owner, key in infos})
    made: dict[int, tuple[bytes, tuple[int, int]]] = {}
    lost = []
    textures = editor.json.get("textures", [])
    for number, texture in enumerate(textures):
        found = sources(texture) if number in shown else []
        for key in ("source", "extensions"):
            texture.pop(key, None)
        if number in shown and (not found or (found[0] not in made and not _make(document, number, limit, made))):
            lost.append(number)
        elif found:
            texture["source"] = found[0]
    for owner, key in infos:
        if owner[key]["index"] in lost:
            del owner[key]
            if key == "emissiveTexture":
                owner["emissiveFactor"] = [0.0, 0.0, 0.0]
    images = editor.json.get("images", [])
    del images[max(made, default=-1) + 1 :]
    for number, image in enumerate(images):
        data, _ = made.get(number, (_PIXEL, (1, 1)))
        named = {"name": image["name"]} if "name" in image else {}
        images[number] = named | {"mimeType": mime_type(data), "bufferView": editor.add_view(data, {})}
    if not images:
        editor.json.pop("images", None)
    forget(editor.json, WEBP, BASISU, *_OTHERS)
    return editor.to_document(), [size for _, size in made.values()], lost


def _make(document: Document, number: int, limit: int, made: dict[int, tuple[bytes, tuple[int, int]]]) -> bool:
    """Put the image of a texture into ``made``, by its number; False where it cannot be decoded."""
    source = sources(document.entry("textures", number))[0]
    data = document.image(source)
    kind = None if data is None else mime_type(data)
    texture = read_texture(document, number, 2 * limit)
    if texture is None:
        return False
    size = None if data is None else image_size(data)
    if data is not None and size is not None and kind in _PLAIN and max(size) <= limit:
        made[source] = bytes(data), size
        return True
    pixels = _reduced(texture.pixels, limit)
    made[source] = _encoded(pixels, kind in _LOSSY), (pixels.shape[1], pixels.shape[0])
    return True


def _reduced(pixels: NDArray[np.uint8], limit: int) -> NDArray[np.uint8]:
    """(h, w, 4) pixels of at most ``limit`` a side. Band by band: the colour of clear texels counts too."""
    height, width = pixels.shape[:2]
    if max(height, width) <= limit:
        return pixels
    share = limit / max(height, width)
    size = max(round(width * share), 1), max(round(height * share), 1)
    bands = [Image.fromarray(pixels[:, :, band]).resize(size, Image.Resampling.BOX) for band in range(4)]
    return np.dstack([np.asarray(band) for band in bands])


def _encoded(pixels: NDArray[np.uint8], lossy: bool) -> bytes:
    """A JPEG where ``lossy`` and no pixel (h, w, 4) is see-through, else a PNG."""
    opaque = bool((pixels[:, :, 3] == 255).all())
    image = Image.fromarray(pixels[:, :, :3] if opaque else pixels)
    data = BytesIO()
    if lossy and opaque:
        image.save(data, "JPEG", quality=QUALITY)
    else:
        image.save(data, "PNG", optimize=True)
    return data.getvalue()


_PIXEL = _encoded(np.full((1, 1, 4), 255, dtype=np.uint8), lossy=False)
