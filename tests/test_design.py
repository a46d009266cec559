"""The faults that `make design` counts are those of marks that are placed so."""

import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from tests.core.placement.shapes import box, boxes, index_of, join, moved, plane, rotation
from tests.design import FOLDED, Faults, faults

SIZE = (4.0, 0.5, 0.6)


def of(shape: Surface, where: Boxes) -> Faults:
    return faults(where, index_of(shape), shape.normals)


def test_a_level_mark_in_the_middle_of_a_plate_has_no_fault() -> None:
    found = of(plane(20, 20), box(size=SIZE))
    assert found.folded[0] == 0
    assert found.margin[0] == pytest.approx(2)
    assert not any(getattr(found, name)[0] for name in ("rim", "slanted", "idle", "stacked", "ragged"))


def test_a_mark_at_a_rim_could_have_moved_and_one_that_fills_a_bar_could_not() -> None:
    assert of(plane(20, 20), box((0, 9.65, 0), SIZE)).rim[0]
    assert not of(plane(20, 0.7), box(size=SIZE)).rim[0]


def test_half_a_mark_beyond_an_edge_is_folded() -> None:
    half = np.radians(20)
    sides = (
        moved(plane(20, 20), rotation((0, 1, 0), s * 20), (s * 10 * np.cos(half), 0, -10 * np.sin(half)))
        for s in (-1, 1)
    )
    shape = join(*sides)
    assert of(shape, box(size=(4, 0.5, 4))).folded[0] > FOLDED
    assert of(shape, box((4, 0, 0), (4, 0.5, 8))).folded[0] == 0


def test_slanted_text_is_idle_where_level_text_has_room() -> None:
    slanted = box(size=SIZE, axes=rotation((0, 0, 1), 30).T)
    wide, bar = plane(20, 20), moved(plane(20, 0.8), rotation((0, 0, 1), 30))
    assert [of(shape, slanted).slanted[0] for shape in (wide, bar)] == [True, True]
    assert [of(shape, slanted).idle[0] for shape in (wide, bar)] == [True, False]


def test_stacked_lines_and_lines_off_one_baseline_are_told_apart() -> None:
    stack = of(plane(20, 20), boxes(box(size=SIZE), box((0.5, 1, 0), SIZE)))
    ragged = of(plane(20, 20), boxes(box(size=SIZE), box((5, 0.2, 0), SIZE)))
    aligned = of(plane(20, 20), boxes(box(size=SIZE), box((5, 0, 0), SIZE)))
    assert [stack.stacked.tolist(), stack.ragged.tolist()] == [[True, True], [False, False]]
    assert [ragged.stacked.tolist(), ragged.ragged.tolist()] == [[False, False], [True, True]]
    assert not (aligned.stacked | aligned.ragged).any()


def test_a_mark_is_small_where_a_larger_one_has_room() -> None:
    small = of(plane(20, 20), box(size=(2, 0.25, 0.3))).room[0]
    assert small == pytest.approx(0.25 / 0.8, rel=0.1)
    assert of(plane(2.2, 0.3), box(size=(2, 0.25, 0.3))).room[0] > 0.85
