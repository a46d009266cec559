"""From how high on text is read."""

import numpy as np
import pytest

from core.notices import NoticeCode
from core.placement.legibility import PIXELS, hard_to_read, legibility, legible_height


def test_text_is_read_from_four_pixels_on_and_no_better_from_sixteen_on() -> None:
    read = legibility(np.array([0.0, 4.0, 7.0, 10.0, 16.0, 100.0]) / PIXELS)
    assert read == pytest.approx([0, 0, 0.5, np.sqrt(0.5), 1, 1])


def test_text_of_a_colour_of_its_own_is_read_from_nine_pixels_on() -> None:
    assert legibility(np.array([4.0, 6.5, 9.0, 100.0]) / PIXELS, colored=True) == pytest.approx([0, 0.5, 1, 1])


def test_a_quarter_of_a_unit_is_legible_and_coloured_letters_need_less() -> None:
    assert legible_height() == pytest.approx(0.25, rel=1e-3)
    assert legible_height(colored=True) == pytest.approx(0.21, rel=1e-2)


def test_marks_that_their_ground_hides_are_noticed_where_they_are_a_third_or_more() -> None:
    high = np.full(6, 14.0 / PIXELS)
    (notice,) = hard_to_read(high, np.array([0.4, 0.6, 0.9, 0.9, 0.9, 0.9]))
    assert notice.code is NoticeCode.HARD_TO_READ
    assert notice.message.startswith("2 of 6 marks")
    assert '`color` "auto"' in notice.remedy
    assert not hard_to_read(high, np.array([0.4, 0.9, 0.9, 0.9, 0.9, 0.9]))


def test_marks_that_are_small_or_high_enough_for_their_ground_are_not_noticed() -> None:
    assert not hard_to_read(np.full(2, 9.0 / PIXELS), np.ones(2))
    assert not hard_to_read(np.full(2, 30.0 / PIXELS), np.full(2, 0.5))
    assert not hard_to_read(np.empty(0), np.empty(0))
