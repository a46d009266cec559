"""An asset of any accepted format as a plain GLB, for viewers that decode nothing."""

from dataclasses import replace
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from core.budgets import DEFAULT_BUDGETS, Budgets
from core.formats.admission import admit, document_of
from core.gltf.builder import ELEMENT_ARRAY_BUFFER, Builder
from core.gltf.compression import DRACO, meshopt_of
from core.gltf.document import ELEMENT_TYPES, Document
from core.gltf.images import mime_type
from core.gltf.ktx2 import decode_ktx2
from core.gltf.prune import all_view_references
from core.gltf.textures import BASISU

PLAIN_IMAGES, KTX2 = ("image/png", "image/jpeg", "image/webp"), "image/ktx2"
WIDEST = 2048  # pixels a side of a decoded KTX2 image, half as many as long as all together exceed MOST_PIXELS
MOST_PIXELS = 2**26


def plain_glb(data: bytes, budgets: Budgets = DEFAULT_BUDGETS) -> bytes:
    """The asset as a GLB without compressed geometry and KTX2 images, complete in itself.

    Nodes, meshes and materials keep their names; PNG, JPEG and WebP images keep their bytes. Images that lie in other
    files or cannot be decoded become a white pixel, so that their materials have their plain colour.

    Args:
        data: the content of a file.
        budgets: the most that it may declare before it is read.

    Raises:
        MeshmarkError: as :func:`core.formats.admission.admit` and :func:`core.formats.admission.document_of`.
    """
    return decoded(document_of(admit(data, budgets), budgets)).to_glb()


def decoded(document: Document) -> Document:
    """A document with nothing in it that is compressed or in another file, and without further chunks.

    Raises:
        MeshmarkError: ``malformed_file`` for streams that are damaged.
    """
    editor = Builder(document)
    _decode_draco(editor)
    _decode_meshopt(editor)
    _decode_images(editor)
    return replace(editor.to_document(), chunks=())


def _decode_draco(editor: Builder) -> None:
    indices = set()
    for mesh in editor.json.get("meshes", []):
        for primitive in mesh["primitives"]:
            if primitive.get("extensions", {}).pop(DRACO, None) is not None:
                indices.add(primitive["indices"])
    for number, values in editor.document.draco.items():
        accessor = editor.json["accessors"][number]
        accessor.pop("byteOffset", None)
        accessor["bufferView"] = (
            editor.add_view(values.tobytes(), {"target": ELEMENT_ARRAY_BUFFER})
            if number in indices
            else editor.add_vertex_view(values, *ELEMENT_TYPES[accessor["type"]])
        )


def _decode_meshopt(editor: Builder) -> None:
    moved: dict[int, int] = {}
    for container, key in list(all_view_references(editor.json)):
        number = container[key]
        view = editor.json["bufferViews"][number]
        if meshopt_of(view) is None:
            continue
        if number not in moved:
            data, start, length = editor.document.view(number)
            properties = {name: view[name] for name in ("byteStride", "target") if name in view}
            moved[number] = editor.add_view(data[start : start + length], properties)
        container[key] = moved[number]


def _decode_images(editor: Builder) -> None:
    """Make every image one that browsers decode, in the BIN chunk."""
    images = editor.json.get("images", [])
    contents = [editor.document.image(number) for number in range(len(images))]
    kinds = [None if content is None else mime_type(content) for content in contents]
    widest = WIDEST
    while kinds.count(KTX2) * widest**2 > MOST_PIXELS and widest > 1:
        widest //= 2
    white: int | None = None
    for image, content, kind in zip(images, contents, kinds, strict=True):
        if content is not None and kind in PLAIN_IMAGES:
            if image.pop("uri", None) is not None:
                image |= {"bufferView": editor.add_view(bytes(content), {}), "mimeType": kind}
            continue
        image.pop("uri", None)
        png = _png(bytes(content), widest) if content is not None and kind == KTX2 else None
        if png is None and white is None:
            white = editor.add_view(_png_of(np.full((1, 1, 4), 255, dtype=np.uint8)), {})
        image |= {"bufferView": white if png is None else editor.add_view(png, {}), "mimeType": "image/png"}
    for texture in editor.json.get("textures", []):
        source = texture.get("extensions", {}).pop(BASISU, {}).get("source")
        if source is not None:
            texture.setdefault("source", source)
    for key in ("extensionsUsed", "extensionsRequired"):
        if BASISU in editor.json.get(key, []):
            editor.json[key].remove(BASISU)


def _png(data: bytes, widest: int) -> bytes | None:
    """A KTX2 image as PNG with at most ``widest`` pixels a side; None where it cannot be decoded."""
    pixels = decode_ktx2(data, widest, MOST_PIXELS)
    if pixels is None:
        return None
    factor = -(-max(pixels.shape[:2]) // widest)
    bands = [np.asarray(Image.fromarray(band).reduce(factor)) for band in np.moveaxis(pixels, 2, 0)]
    return _png_of(np.dstack(bands))


def _png_of(pixels: NDArray[np.uint8]) -> bytes:
    file = BytesIO()
    Image.fromarray(pixels).save(file, "PNG", compress_level=1)  # fast, for one transfer
    return file.getvalue()
