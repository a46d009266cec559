import base64
import json
import struct
import zlib
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.textures import read_texture, undecoded_textures
from tests.core.gltf.ktx2_samples import ETC1S, UASTC
from tests.core.rendering.glb import GlbWriter, png

PIXELS = np.zeros((40, 60, 3), dtype=np.uint8)
PIXELS[:20] = (255, 0, 0)  # the upper half
PIXELS[20:] = (0, 0, 255)


def document(image: bytes, **sampler: int) -> Document:
    writer = GlbWriter()
    writer.image_texture(image, **sampler)
    return Document.from_glb(writer.bytes())


def encoded(name: str) -> bytes:
    stream = BytesIO()
    Image.fromarray(PIXELS).save(stream, format=name)
    return stream.getvalue()


@pytest.mark.parametrize("name", ["PNG", "JPEG", "WEBP"])
def test_the_three_image_formats_of_gltf_are_decoded_top_row_first(name: str) -> None:
    texture = read_texture(document(encoded(name)), 0, limit=64)
    assert texture is not None
    assert texture.pixels.shape == (40, 60, 4)
    np.testing.assert_allclose(texture.pixels[5, 30].astype(int), [255, 0, 0, 255], atol=4)
    np.testing.assert_allclose(texture.pixels[35, 30].astype(int), [0, 0, 255, 255], atol=4)


def test_large_images_are_reduced_to_the_limit() -> None:
    texture = read_texture(document(png(np.tile(PIXELS, (10, 10, 1)))), 0, limit=128)
    assert texture is not None
    assert max(texture.pixels.shape[:2]) <= 128
    assert texture.pixels.shape[1] / texture.pixels.shape[0] == pytest.approx(1.5, rel=0.05)


def test_colour_survives_where_alpha_is_zero() -> None:
    """Opaque materials show the colour of texels whatever their alpha."""
    texture = read_texture(document(png(np.full((512, 512, 4), (200, 100, 50, 0)))), 0, limit=64)
    assert texture is not None
    assert (texture.pixels == (200, 100, 50, 0)).all()


def test_an_image_that_declares_ten_gigapixels_is_not_decoded() -> None:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 100_000, 100_000, 8, 6, 0, 0, 0))
    bomb = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    assert read_texture(document(bomb), 0, limit=64) is None


@pytest.mark.parametrize(
    "data", [b"", b"text", b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(40), encoded("PNG")[:60], encoded("WEBP")[:30]]
)
def test_what_cannot_be_decoded_is_left_out(data: bytes) -> None:
    assert read_texture(document(data or b"\0"), 0, limit=64) is None


def test_a_data_uri_is_decoded_and_another_file_is_not_opened() -> None:
    for uri, found in (
        ("data:image/png;base64," + base64.b64encode(encoded("PNG")).decode(), True),
        ("data:image/png;base64,@@@", False),
        ("textures/color.png", False),
        ("file:///etc/passwd", False),
    ):
        text = {"asset": {"version": "2.0"}, "images": [{"uri": uri}], "textures": [{"source": 0}]}
        assert (read_texture(Document(json.loads(json.dumps(text)), b""), 0, limit=64) is not None) == found


def test_sampler_modes_are_read() -> None:
    texture = read_texture(document(encoded("PNG"), wrapS=33071, wrapT=33648, magFilter=9728), 0, limit=64)
    assert texture is not None
    assert texture.wrap == (33071, 33648)
    assert texture.nearest


def test_a_texture_that_does_not_exist_is_refused() -> None:
    with pytest.raises(MeshmarkError) as caught:
        read_texture(document(encoded("PNG")), 3, limit=64)
    assert caught.value.code == ErrorCode.MALFORMED_FILE


KTX2_UNKNOWN = UASTC[:12] + struct.pack("<I", 37) + UASTC[16:]  # texels of a GPU's own format
AVIF = b"\0\0\0\x1cftypavif" + bytes(40)


def textured(texture: dict[str, Any], *images: bytes | str) -> Document:
    """A document with one texture; images are bytes, or the names of files."""
    writer = GlbWriter()
    for image in images:
        writer.add("images", {"uri": image} if isinstance(image, str) else {"bufferView": writer.view(image)})
    writer.add("textures", texture)
    return Document.from_glb(writer.bytes())


@pytest.mark.parametrize("image", [ETC1S, UASTC], ids=["ETC1S", "UASTC"])
def test_a_ktx2_image_is_decoded_and_reduced(image: bytes) -> None:
    texture = read_texture(textured({"extensions": {"KHR_texture_basisu": {"source": 0}}}, image), 0, limit=5)
    assert texture is not None
    assert max(texture.pixels.shape[:2]) <= 5
    np.testing.assert_allclose(texture.pixels[0, 0].astype(int), [255, 0, 0, 255], atol=20)


@pytest.mark.parametrize("extension", ["EXT_texture_webp", "KHR_texture_basisu", "EXT_texture_avif"])
def test_where_the_image_of_an_extension_cannot_be_decoded_the_fallback_is_shown(extension: str) -> None:
    document = textured({"source": 0, "extensions": {extension: {"source": 1}}}, encoded("PNG"), AVIF)
    assert read_texture(document, 0, limit=64) is not None
    assert not undecoded_textures(document)


def test_where_the_fallback_cannot_be_decoded_the_image_of_an_extension_is_shown() -> None:
    document = textured({"source": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}}, b"damaged", UASTC)
    assert read_texture(document, 0, limit=64) is not None


@pytest.mark.parametrize("image", [KTX2_UNKNOWN, AVIF, encoded("PNG")[:60]], ids=["texels", "AVIF", "damaged"])
def test_a_texture_that_cannot_be_decoded_is_named_once_it_was_asked_for(image: bytes) -> None:
    document = textured({"name": "bark", "source": 0}, image)
    assert not undecoded_textures(document)
    assert read_texture(document, 0, limit=64) is None
    (warning,) = undecoded_textures(document)
    assert warning.code == ErrorCode.TEXTURE_NOT_DECODED
    assert "textures[0] ('bark')" in warning.message


def test_a_texture_in_another_file_has_a_warning_of_its_own() -> None:
    document = textured({"source": 0}, "wood.png")
    assert read_texture(document, 0, limit=64) is None
    assert not undecoded_textures(document)


def test_of_many_textures_that_cannot_be_decoded_the_first_are_named() -> None:
    document = textured({"source": 0}, b"damaged")
    document.json["textures"] *= 9
    for number in range(9):
        read_texture(document, number, limit=64)
    (warning,) = undecoded_textures(document)
    assert "textures[4] and 4 more" in warning.message
