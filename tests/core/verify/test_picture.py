"""Marks in pictures."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from core.errors import ErrorCode, MeshmarkError
from core.verify.header import picture_format
from core.verify.picture import decode
from core.verify.verify import verify
from tests.core.metrics.drawn import drawn

SHOWN = Path(__file__).parents[2] / "data" / "spot-watermarked.png"


def encoded(picture: Any, kind: str = "PNG", **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, kind, **options)
    return file.getvalue()


def edited(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("turn", [0, 2])
def test_a_text_is_read_in_a_picture_and_pointed_at(kind: str, turn: int) -> None:
    picture = np.rot90(np.pad(drawn("watermark"), [(100, 300), (200, 50), (0, 0)], mode="edge"), turn)
    found = verify(encoded(np.ascontiguousarray(picture), kind), ["watermark"])
    [mark] = found.report["marks"]
    assert (mark["known"], mark["likeness"], mark["center"]) == ("watermark", 1.0, None)
    assert found.report["found"] == ["watermark"]
    assert found.report["file"]["format"] == kind.lower()
    ink = np.argwhere(picture.min(axis=2) < 100)
    np.testing.assert_allclose(mark["pixel"], ink.mean(axis=0)[::-1], atol=8)
    assert found.pictures[0].startswith(b"\x89PNG")


def test_a_preview_of_ours_shows_its_marks() -> None:
    assert verify(SHOWN.read_bytes(), ["watermark"]).report["found"] == ["watermark"]


def test_letters_four_grey_levels_darker_than_a_shaded_surface_are_read() -> None:
    ink = (235.0 - drawn("watermark", height=24)[..., 0]) / 195
    rows, columns = np.mgrid[: len(ink), : len(ink)]
    shade = 120 + 60 * np.sin(rows / 90) * np.cos(columns / 120)
    grey = (shade - 4 * ink + np.random.default_rng(0).normal(size=ink.shape)).astype(np.uint8)
    picture = np.repeat(grey[..., None], 3, axis=2)
    [mark] = verify(encoded(picture, "JPEG", quality=70), ["watermark"]).report["marks"]
    assert mark["known"] == "watermark"
    assert mark["pixel"] == pytest.approx([256, 256], abs=8)


def test_a_picture_without_writing_has_none() -> None:
    assert verify(encoded(np.full((64, 64, 3), 128, np.uint8))).report["marks"] == []


def test_a_text_that_cannot_be_read_is_told_of() -> None:
    [notice] = verify(encoded(np.full((64, 64, 3), 128, np.uint8)), ["שלום"]).report["warnings"]
    assert notice["code"] == "unreadable_script"


def test_clear_parts_are_white() -> None:
    clear = np.zeros((8, 8, 4), np.uint8)
    assert (decode(encoded(clear)) == 255).all()


def test_a_picture_is_known_by_its_content() -> None:
    assert picture_format(SHOWN.read_bytes()) == "png"
    assert picture_format(b"glTF" + bytes(20)) is None


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (edited(SHOWN.read_bytes(), 16, (10_000).to_bytes(4) * 2), ErrorCode.BUDGET_EXCEEDED),
        (edited(SHOWN.read_bytes(), 16, (100).to_bytes(4) * 2), ErrorCode.MALFORMED_FILE),
        (edited(SHOWN.read_bytes(), 16, bytes(8)), ErrorCode.MALFORMED_FILE),
        (SHOWN.read_bytes()[:2000], ErrorCode.MALFORMED_FILE),
        (SHOWN.read_bytes()[:20], ErrorCode.MALFORMED_FILE),
        (b"\xff\xd8\xff\xe0" + bytes(64), ErrorCode.MALFORMED_FILE),
        (b"RIFF\x00\x00\x00\x00WEBPVP8 " + bytes(64), ErrorCode.MALFORMED_FILE),
    ],
    ids=["100 megapixels", "size that lies", "no pixels", "cut off", "cut in its header", "no JPEG", "no WebP"],
)
def test_a_picture_that_is_broken_or_a_bomb_is_refused(data: bytes, code: ErrorCode) -> None:
    with pytest.raises(MeshmarkError) as error:
        verify(data)
    assert error.value.code is code
