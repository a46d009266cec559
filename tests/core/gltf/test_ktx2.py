import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.gltf.ktx2 import decode_ktx2
from tests.core.gltf.ktx2_samples import ETC1S, UASTC

QUARTERS = np.array([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 0)]])
WIDTH, DEPTH, LAYERS, FACES, LEVELS = 20, 28, 32, 36, 40  # where the header has them
FIRST_LEVEL = 80
MANY = 2**20


def changed(data: bytes, at: int, value: int, form: str = "<I") -> bytes:
    edited = bytearray(data)
    struct.pack_into(form, edited, at, value)
    return bytes(edited)


@pytest.mark.parametrize("data", [ETC1S, UASTC], ids=["ETC1S", "UASTC"])
def test_both_kinds_of_texels_are_decoded_top_row_first(data: bytes) -> None:
    pixels = decode_ktx2(data, 16, MANY)
    assert pixels is not None
    assert pixels.shape == (16, 16, 4)
    np.testing.assert_allclose(pixels[4::8, 4::8, :3].astype(int), QUARTERS, atol=4)
    assert (pixels[..., 3] == 255).all()


@pytest.mark.parametrize(("limit", "side"), [(1, 1), (2, 2), (3, 4), (8, 8), (9, 16), (1024, 16)])
def test_the_smallest_level_that_has_enough_pixels_is_decoded(limit: int, side: int) -> None:
    pixels = decode_ktx2(UASTC, limit, MANY)
    assert pixels is not None
    assert pixels.shape == (side, side, 4)


def test_a_level_of_too_many_pixels_is_not_decoded_a_smaller_one_is() -> None:
    assert decode_ktx2(UASTC, 16, 255) is None
    assert decode_ktx2(UASTC, 8, 255) is not None


@pytest.mark.parametrize(
    ("at", "value"),
    [(WIDTH, 0), (WIDTH, 2**31), (DEPTH, 2), (LAYERS, 4), (FACES, 6), (LEVELS, 33), (LEVELS, 2**32 - 1), (12, 37)],
)
def test_what_is_no_plain_picture_is_not_shown(at: int, value: int) -> None:
    """Sides of 0, volumes, arrays, cubes, more levels than there can be, texels of a GPU's own format."""
    assert decode_ktx2(changed(UASTC, at, value), 16, 2**40) is None


def test_a_level_that_would_grow_beyond_its_pixels_is_not_decompressed() -> None:
    bomb = changed(UASTC, FIRST_LEVEL + 16, 2**31, "<Q")
    tracemalloc.start()
    assert decode_ktx2(bomb, 16, MANY) is None
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


@pytest.mark.parametrize("data", [ETC1S, UASTC], ids=["ETC1S", "UASTC"])
def test_a_file_that_ends_early_is_not_shown(data: bytes) -> None:
    assert all(decode_ktx2(data[:length], 16, MANY) is None for length in range(0, len(data) - 1, 7))


@settings(max_examples=300)
@given(
    st.sampled_from([ETC1S, UASTC]),
    st.lists(st.tuples(st.integers(12, len(UASTC) - 1), st.integers(0, 255)), min_size=1, max_size=8),
)
def test_damaged_files_give_a_picture_or_none(data: bytes, changes: list[tuple[int, int]]) -> None:
    edited = bytearray(data)
    for at, value in changes:
        edited[at] = value
    pixels = decode_ktx2(bytes(edited), 16, MANY)
    assert pixels is None or (pixels.ndim, pixels.shape[2]) == (3, 4)
