"""The kind and size of an image from its header; nothing is decoded."""

import struct

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG_SEGMENTS = 1000  # segments before the frame, at most; a colour profile or a thumbnail takes a few dozen
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"


def mime_type(data: bytes | memoryview) -> str | None:
    """The media type of an image that a glTF can hold, by its content; ``None`` for anything else."""
    head = bytes(data[:16])
    if head[:8] == _PNG:
        return "image/png"
    if head[:3] == b"\xff\xd8\xff":
        return "image/jpeg"
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "image/webp"
    return "image/ktx2" if head[:12] == _KTX2 else None


def image_size(data: memoryview) -> tuple[int, int] | None:
    """(width, height) of a PNG, JPEG, WebP or KTX2 image; ``None`` for anything else."""
    head = bytes(data[:16])
    try:
        if head[:8] == _PNG and head[12:] == b"IHDR":
            return _pair(struct.unpack_from(">II", data, 16))
        if head[:12] == _KTX2:
            return _pair(struct.unpack_from("<II", data, 20))
        if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
            return _webp_size(data)
        if head[:2] == b"\xff\xd8":
            return _jpeg_size(data)
    except struct.error:
        pass  # the header is cut off
    return None


def _pair(size: tuple[int, ...]) -> tuple[int, int]:
    return size[0], size[1]


def _webp_size(data: memoryview) -> tuple[int, int] | None:
    """RFC 9649, sections 2.5 to 2.7."""
    match bytes(data[12:16]):
        case b"VP8X":
            low_width, high_width, low_height, high_height = struct.unpack_from("<HBHB", data, 24)
            return 1 + low_width + (high_width << 16), 1 + low_height + (high_height << 16)
        case b"VP8L":
            bits = struct.unpack_from("<I", data, 21)[0]
            return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
        case b"VP8 ":
            width, height = struct.unpack_from("<HH", data, 26)
            return width & 0x3FFF, height & 0x3FFF
    return None


def _jpeg_size(data: memoryview) -> tuple[int, int] | None:
    """Walk the marker segments up to the start of frame (ITU-T T.81, annex B)."""
    offset = 2
    for _ in range(_JPEG_SEGMENTS):
        marker, code, length = struct.unpack_from(">BBH", data, offset)
        if marker != 0xFF:
            return None
        if code == 0xFF:  # fill byte
            offset += 1
            continue
        if 0xC0 <= code <= 0xCF and code not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, offset + 5)
            return width, height
        offset += 2 + max(length, 2)
    return None
