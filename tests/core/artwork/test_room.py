"""Room for several texts in the same places."""

import numpy as np
import pytest

from core.artwork.lettering import layouts_of
from core.artwork.room import roomiest, set_in, suiting
from core.choices import Wrap
from core.parameters import Parameters


def test_the_longest_text_needs_most_room_of_equal_ones_the_first() -> None:
    assert roomiest(["ORDER-1", "ORDER-22", "ORDER-33"], Wrap.AUTO) == "ORDER-22"
    assert roomiest(["one two three four", "internationally"], Wrap.AUTO) == "one two three four"
    assert roomiest(["a\nb\nc", "ab"], Wrap.NONE) == "a\nb\nc"
    assert roomiest(["Mia", "Eva", "a\nb\nc"], Wrap.NONE) == "Mia", "the others have no room where lines are three"
    assert roomiest(["illi", "山水画図"], Wrap.AUTO) == "山水画図"


def test_of_a_thousand_texts_the_widest_and_those_of_the_widest_words_tell() -> None:
    texts = [f"Anna Lena {number}" for number in range(998)] + ["Maximilian", "Anna Maria Lena Eva Mia"]
    longest = roomiest(texts, Wrap.AUTO)
    assert longest == "Anna Maria Lena Eva Mia"
    kept = suiting(layouts_of(Parameters(text=longest)), texts, Wrap.AUTO)
    assert [len(artwork.lines) for artwork in kept.artworks] == [1, 2, 3], "four are too narrow for Maximilian"


def test_places_for_several_lines_are_left_out_where_another_text_has_no_room_in_them() -> None:
    longest = layouts_of(Parameters(text="Anna Maria Lena Eva"))
    assert len(longest.artworks) > 1
    assert len(suiting(longest, ["Hubertus-Maximilianowicz"], Wrap.NONE).artworks) == 1
    assert len(suiting(longest, ["Mia"], Wrap.AUTO).artworks) == len(longest.artworks)


def test_a_shorter_text_has_lines_as_high_and_a_longer_one_lower_ones() -> None:
    planned = layouts_of(Parameters(text="ORDER-4711", wrap=Wrap.NONE)).artworks[0]
    place, height = np.array([[4.0, 4.0 * planned.aspect]]), np.array([4.0 * planned.line_height])
    for text in ("AB", "ORDER-4711", "ORDER-4711-4711"):
        layouts = layouts_of(Parameters(text=text, wrap=Wrap.NONE))
        sizes, used = set_in(layouts, place, height)
        assert (sizes <= place * (1 + 1e-9)).all()
        lines = used.line_height(sizes)[0] / height[0]
        assert lines == pytest.approx(1.0, abs=0.02) if len(text) <= 10 else 0.5 < lines < 0.8


def test_a_text_breaks_into_the_lines_that_its_place_has() -> None:
    layouts = layouts_of(Parameters(text="Bartholomew Smith"))
    sizes, used = set_in(layouts, np.array([[4.0, 0.5], [4.0, 1.6]]), np.array([0.5, 0.7]))
    assert [len(used.artworks[number].lines) for number in used.of(sizes)] == [1, 2]


def test_a_place_that_is_too_small_for_a_code_has_no_room() -> None:
    layouts = layouts_of(Parameters(text="AB", qr="https://example.com/4711"))
    sizes, used = set_in(layouts, np.array([[0.3, 0.3]]), np.array([0.2]))
    assert not sizes.any()
    assert not used.artworks
