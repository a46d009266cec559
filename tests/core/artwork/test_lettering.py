"""A QR code stands in no mark in which it could not be read."""

import re
from typing import Any

import pytest

from core.artwork.artwork import Artwork
from core.artwork.lettering import layouts_of
from core.artwork.qr_code import MIN_MODULE
from core.choices import Direction, LogoPosition
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters

ADDRESS = "https://a.example"  # 35 modules with its frame
LONG = "https://shop.example/order/4711?" + "x" * 70
SENTENCE = "Sample only - purchase the licensed model at example-market"


def set_as(text: str = "", address: str = ADDRESS, **asked: Any) -> tuple[Artwork, ...]:
    """The layouts of a QR code and a text."""
    return layouts_of(Parameters(text=text, qr=address, **asked).resolved()).artworks


def refused(**asked: Any) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        set_as(**asked)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    return caught.value


def least(error: MeshmarkError) -> float:
    found = re.search(r"`size` of ([\d.]+) or more", error.remedy)
    assert found is not None, error.remedy
    return float(found[1])


@pytest.mark.parametrize("position", LogoPosition)
@pytest.mark.parametrize("text", ["", "watermark", "Order\n4711"])
def test_a_size_in_which_the_code_cannot_be_read_is_refused_with_the_least_one_in_which_it_can(
    text: str, position: LogoPosition
) -> None:
    error = refused(text=text, size=2.05, logo_position=position)
    assert "`qr`" in error.message
    assert "`size` of 2.05" in error.message
    enough = least(error)
    assert enough >= 35 * MIN_MODULE
    set_as(text, size=enough, logo_position=position)
    assert least(refused(text=text, size=enough - 0.02, logo_position=position)) == enough


def test_the_size_of_the_preset_counts_as_one_that_is_asked_for() -> None:
    assert least(refused(address=LONG, preset="provenance")) > 3
    assert set_as(address=LONG, preset="provenance", size=3.1)


def test_of_the_ways_of_setting_a_text_those_are_left_in_which_the_code_beside_it_can_be_read() -> None:
    assert [len(mark.lines) for mark in set_as(SENTENCE)] == [1, 2, 3, 4]
    assert [len(mark.lines) for mark in set_as(SENTENCE, size=12.0)] == [3, 4]


def test_a_text_so_long_that_no_mark_has_room_for_the_code_is_refused_with_what_helps() -> None:
    error = refused(text=SENTENCE, wrap="none", address=LONG)
    assert "as wide as the asset" in error.message
    assert "shorter text" in error.remedy
    assert "above" in error.remedy
    set_as(SENTENCE, wrap="none", address=LONG, logo_position="above")
    assert "above" not in refused(text=SENTENCE, wrap="none", size=3.0, logo_position="above").remedy


@pytest.mark.parametrize("position", LogoPosition)
def test_a_mark_of_the_least_width_has_modules_of_the_least_size(position: LogoPosition) -> None:
    (mark,) = set_as("BRAND", logo_position=position)
    letters = sum(len(ring) < 100 for ring in mark.rings)
    frame = max(mark.rings, key=lambda ring: float(ring.max() - ring.min()) if len(ring) == 4 else 0.0)
    assert letters
    assert (frame[:, 0].max() - frame[:, 0].min()) * mark.least_width == pytest.approx(35 * MIN_MODULE)


def test_without_a_code_any_width_will_do() -> None:
    assert [mark.least_width for mark in layouts_of(Parameters(text="watermark")).artworks] == [0]


def test_texts_in_scripts_that_are_written_in_columns_may_stand_in_rows_and_columns() -> None:
    japanese, latin = (layouts_of(Parameters(text=text, direction=Direction.AUTO)) for text in ("見本透かし", "sample"))
    assert [(one.lines, one.aspect > 1) for one in japanese.artworks] == [
        (("見本透かし",), False),
        (("見本", "透かし"), False),
        (("見本透かし",), True),
        (("見本", "透かし"), True),
    ]
    assert [one.aspect > 1 for one in latin.artworks] == [False]
