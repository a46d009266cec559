import io
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from core.gltf.images import image_size


def _encoded(file_format: str, size: tuple[int, int], **options: object) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", size, "teal").save(stream, file_format, **options)
    return stream.getvalue()


@pytest.mark.parametrize("size", [(1, 1), (640, 3), (3, 640)])
@pytest.mark.parametrize(
    ("file_format", "options"),
    [
        ("PNG", {}),
        ("JPEG", {}),
        ("JPEG", {"progressive": True}),
        ("JPEG", {"icc_profile": bytes(200_000), "exif": b"Exif\0\0" + bytes(1000)}),
        ("WEBP", {}),
        ("WEBP", {"lossless": True}),
        ("WEBP", {"exif": b"Exif\0\0II*\0\x08\0\0\0\0\0"}),
    ],
)
def test_the_size_is_the_one_a_decoder_sees(
    file_format: str, options: dict[str, object], size: tuple[int, int]
) -> None:
    assert image_size(memoryview(_encoded(file_format, size, **options))) == size


def test_a_ktx2_header_is_read() -> None:
    header = b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<4I", 0, 1, 2048, 1024)
    assert image_size(memoryview(header)) == (2048, 1024)


@given(
    data=st.one_of(st.binary(max_size=64), st.binary(max_size=64).map(lambda tail: b"\xff\xd8\xff" + tail)),
)
def test_other_bytes_have_no_size_or_some(data: bytes) -> None:
    size = image_size(memoryview(data))
    assert size is None or min(size) >= 0


@pytest.mark.parametrize("file_format", ["PNG", "JPEG", "WEBP"])
def test_a_header_that_is_cut_off_has_no_size(file_format: str) -> None:
    assert image_size(memoryview(_encoded(file_format, (9, 9))[:20])) is None
