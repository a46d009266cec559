"""A watermark may be set in several ways; the proportions of its box say in which it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.artwork.artwork import SOFT_REACH, Artwork
from core.artwork.layouts import ALIKE, distinct_layouts
from core.artwork.outline import text_artwork
from tests.core.placement.shapes import text


@given(st.lists(st.floats(0.01, 3.0), min_size=1, max_size=6), st.floats(0.01, 30.0))
def test_every_layout_is_found_again_at_any_width(aspects: list[float], width: float) -> None:
    layouts = distinct_layouts([text(aspect) for aspect in aspects])
    size = np.array([[width, width * artwork.aspect, 1.0] for artwork in layouts.artworks])
    assert layouts.of(size).tolist() == list(range(len(layouts.artworks)))
    assert np.allclose(layouts.line_height(size), size[:, 1])


def test_of_two_layouts_that_would_serve_the_same_places_the_first_is_kept() -> None:
    first, like, other = text(0.1), text(0.1 * (1 + ALIKE / 2)), text(0.2)
    assert distinct_layouts([first, like, other]).artworks == (first, other)


def test_a_line_is_as_high_as_its_share_of_the_block() -> None:
    layouts = distinct_layouts([text(0.03), text(0.12, lines=4)])
    assert np.allclose(
        layouts.line_height(np.array([[10.0, 0.3, 1.0], [10.0, layouts.artworks[1].aspect * 10, 1]])), [0.3, 1.2]
    )


def test_marks_say_in_which_ways_they_break_the_text() -> None:
    row, block = replace(text(0.1), lines=("a b",)), replace(text(0.5), lines=("a", "b"))
    layouts = distinct_layouts([row, block])
    assert layouts.settings(np.array([[10.0, 1.0, 1.0]])) == ("a b",)
    assert layouts.settings(np.array([[10.0, 5.0, 1.0], [10.0, 1.0, 1.0], [5.0, 2.5, 1.0]])) == ("a b", "a\nb")
    assert layouts.settings(np.empty((0, 3))) == ()


def test_a_soft_profile_reaches_round_letters_by_the_width_of_their_strokes() -> None:
    ring = np.array([[-0.5, -0.01], [0.5, -0.01], [0.5, 0.01], [-0.5, 0.01]])
    bar = Artwork(label="-", rings=(ring,), aspect=0.02, ink=1.0, line_height=0.02)
    assert bar.stroke == pytest.approx(0.02, rel=0.03)
    reach = distinct_layouts([bar]).soft_reach(np.array([[1.0, 0.02, 0.1], [5.0, 0.1, 0.1]]))
    assert reach == pytest.approx([SOFT_REACH * 0.02, SOFT_REACH * 0.1], rel=0.03)
    assert 0.01 < text_artwork("watermark").stroke < 0.04
