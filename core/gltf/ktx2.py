"""KTX2 images with Basis Universal texels (KHR_texture_basisu): ETC1S and UASTC, as pixels."""

import struct

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
MAX_LEVELS = 32

_HEADER = struct.Struct("<12s9I4I2Q")  # KTX file format specification 2.0, section 3
_LEVEL = struct.Struct("<3Q")
_BLOCK, _BLOCK_BYTES = 4, 16  # pixels a side; bytes of an uncompressed UASTC block, the larger of the two kinds


def decode_ktx2(data: bytes, limit: int, max_pixels: int) -> NDArray[np.uint8] | None:
    """(H, W, 4) pixels of the smallest mip level that is at least ``limit`` pixels wide or high, else of the largest.

    Returns:
        ``None`` for images that are damaged, of more than ``max_pixels`` in that level, of other texels than ETC1S and
        UASTC, or not two-dimensional: KHR_texture_basisu has no cubes, arrays and volumes. Nothing is decompressed
        before the declared sizes are checked against each other.
    """
    if len(data) < _HEADER.size:
        return None
    _, _, _, width, height, depth, layers, faces, levels, *_ = _HEADER.unpack_from(data)
    count = max(levels, 1)
    if depth or layers or faces != 1 or not width or not height or count > MAX_LEVELS:
        return None
    sizes = [(max(width >> level, 1), max(height >> level, 1)) for level in range(count)]
    level = max([number for number, size in enumerate(sizes) if max(size) >= limit], default=0)
    if sizes[level][0] * sizes[level][1] > max_pixels or not _is_consistent(data, sizes):
        return None
    import opengl_basisu  # here since it takes a twentieth of a second, which few assets are in need of

    try:
        image = opengl_basisu.open(data)
        return np.asarray(image.transcode(opengl_basisu.Target.RGBA8, level).data, dtype=np.uint8)
    except ValueError:  # raised by the transcoder for damaged files and unknown texels
        return None


def _is_consistent(data: bytes, sizes: list[tuple[int, int]]) -> bool:
    """True where the bytes of each mip level are in the file, and decompress to no more than its pixels take."""
    if len(data) < _HEADER.size + len(sizes) * _LEVEL.size:
        return False
    for number, (width, height) in enumerate(sizes):
        start, length, decompressed = _LEVEL.unpack_from(data, _HEADER.size + number * _LEVEL.size)
        blocks = -(-width // _BLOCK) * -(-height // _BLOCK)
        if start + length > len(data) or decompressed > blocks * _BLOCK_BYTES:
            return False
    return True
