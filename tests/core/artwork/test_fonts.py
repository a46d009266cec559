import struct
from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.artwork.fonts import DEFAULT_FONT, MAX_FONT_BYTES, load_font
from core.artwork.outline import text_artwork
from core.errors import ErrorCode, MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, make_font

DEJAVU = DEFAULT_FONT.read_bytes()
SMALL = make_font({"a": [SQUARE]})


def refusal(data: bytes) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        load_font(data)
    assert caught.value.code == ErrorCode.INVALID_FONT
    return caught.value


def table_offset(data: bytes, tag: bytes) -> tuple[int, int]:
    """Where the directory entry and the data of a table start."""
    entry = data.index(tag, 12, 12 + 16 * struct.unpack_from(">H", data, 4)[0])
    return entry, struct.unpack_from(">I", data, entry + 8)[0]


def test_the_bundled_font_loads_and_its_licence_lies_beside_it() -> None:
    assert load_font(DEJAVU).face.upem == 2048
    licence = (DEFAULT_FONT.parent / "LICENSE-DejaVu.txt").read_text()
    assert "Bitstream" in licence
    assert "Tavmjong Bah" in licence


@pytest.mark.parametrize("cff", [False, True])
def test_truetype_and_cff_outlines_are_accepted(cff: bool) -> None:
    assert load_font(make_font({"a": [SQUARE]}, cff=cff)).face.upem == 1000


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (b"", "empty"),
        (b"\0\1", "not a TrueType"),
        (b"watermark" * 100, "not a TrueType"),
        (b"<?xml version='1.0'?><ttFont/>", "not a TrueType"),
        (b"wOFF" + bytes(100), "WOFF"),
        (b"wOF2" + bytes(100), "WOFF2"),
        (b"ttcf" + bytes(100), "collection"),
        (b"\0\1\0\0", "header"),
        (b"\0\1\0\0\xff\xff" + bytes(100), "directory"),
        (b"\0\1\0\0" + bytes(8), "lacks the tables"),
        (bytes(MAX_FONT_BYTES + 1), "limit is 20 MB"),
    ],
)
def test_what_is_no_plain_font_is_refused_in_words(data: bytes, word: str) -> None:
    assert word in refusal(data).message


def test_a_truncated_font_is_refused() -> None:
    for length in range(0, len(SMALL) - 1, 97):
        refusal(SMALL[:length])


def test_a_table_that_points_outside_the_file_is_named() -> None:
    entry, _ = table_offset(SMALL, b"glyf")
    data = bytearray(SMALL)
    struct.pack_into(">II", data, entry + 8, 0xFFFFFFF0, 0xFFFFFFF0)
    assert "glyf" in refusal(bytes(data)).message


def test_a_table_listed_twice_is_refused() -> None:
    entry, _ = table_offset(SMALL, b"post")
    data = bytearray(SMALL)
    data[entry : entry + 4] = b"name"
    assert "twice" in refusal(bytes(data)).message


@pytest.mark.parametrize("upem", [0, 1, 15, 16385, 65535])
def test_an_absurd_em_is_refused(upem: int) -> None:
    _, head = table_offset(SMALL, b"head")
    data = bytearray(SMALL)
    struct.pack_into(">H", data, head + 18, upem)
    assert str(upem) in refusal(bytes(data)).message


def test_a_font_without_outlines_is_refused() -> None:
    entry, _ = table_offset(SMALL, b"glyf")
    data = bytearray(SMALL)
    data[entry : entry + 4] = b"CBDT"
    assert "no outlines" in refusal(bytes(data)).message


def test_a_font_that_maps_no_characters_is_refused() -> None:
    _, cmap = table_offset(SMALL, b"cmap")
    data = bytearray(SMALL)
    struct.pack_into(">H", data, cmap + 2, 0)
    assert "maps no characters" in refusal(bytes(data)).message


@pytest.mark.parametrize("make", [lambda: SMALL, lambda: make_font({"a": [SQUARE]}, cff=True)])
@settings(max_examples=60)
@given(data=st.data())
def test_a_damaged_font_gives_letters_or_a_clear_error_but_never_a_crash(
    make: Callable[[], bytes], data: st.DataObject
) -> None:
    font = bytearray(make())
    for _ in range(data.draw(st.integers(1, 12))):
        font[data.draw(st.integers(0, len(font) - 1))] = data.draw(st.integers(0, 255))
    with suppress(MeshmarkError):
        assert text_artwork("aa", bytes(font)).ink > 0
