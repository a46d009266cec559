import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.analysis.orientation import Orientation, OrientationOptions, orient
from core.arrays import Bool, Int
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from tests.core.shapes import box, grid, join, moved, sphere, surface

BALL = sphere(5.0, 2)


def _reversed(shape: Surface) -> list[bool]:
    return list(_oriented(shape).flipped.tolist())


def _oriented(shape: Surface, counts: Bool | None = None, one_sided: Bool | None = None) -> Orientation:
    """Everything counts, and is drawn from both sides, if nothing else is said."""
    none = np.zeros(len(shape.faces), dtype=bool)
    counts, one_sided = ~none if counts is None else counts, none if one_sided is None else one_sided
    index = SpatialIndex(shape.positions, shape.faces)
    return orient(shape, counts, one_sided, none, index, index)


def _turned(shape: Surface, which: Int) -> Surface:
    faces = shape.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return surface(shape.positions, faces)


def test_what_looks_out_stays() -> None:
    assert not any(_reversed(BALL))


@settings(max_examples=25)
@given(st.lists(st.integers(0, len(BALL.faces) - 1), unique=True))
def test_whichever_faces_are_flipped_are_the_ones_that_are_turned(which: list[int]) -> None:
    flipped = np.array(which, dtype=np.int64)
    assert np.flatnonzero(_reversed(_turned(BALL, flipped))).tolist() == sorted(which)


def test_parts_are_told_apart_and_faces_that_do_not_count_belong_to_none() -> None:
    both = join(box(3.0, 3.0, 3.0), moved(box(3.0, 3.0, 3.0), 8.0, 0.0, 0.0))
    counts = np.arange(24) != 5
    part = _oriented(both, counts).component
    assert part[5] == -1
    assert len(set(part[:12][counts[:12]].tolist())) == 1
    assert len(set(part[12:].tolist())) == 1
    assert part[0] != part[12]


def test_each_part_is_judged_by_itself() -> None:
    inside_out = _turned(box(3.0, 3.0, 3.0), np.arange(12))
    both = join(box(3.0, 3.0, 3.0), moved(inside_out, 8.0, 0.0, 0.0))
    assert _reversed(both) == [False] * 12 + [True] * 12


def test_only_as_many_parts_are_judged_as_the_options_say_the_largest_first() -> None:
    small, large = (_turned(box(side, side, side), np.arange(12)) for side in (3.0, 4.0))
    both = join(small, moved(large, 8.0, 0.0, 0.0))
    none, index = np.zeros(24, dtype=bool), SpatialIndex(both.positions, both.faces)
    found = orient(both, ~none, none, none, index, index, OrientationOptions(components=1))
    assert found.flipped.tolist() == [False] * 12 + [True] * 12


def test_an_open_sheet_keeps_the_winding_of_its_file() -> None:
    sheet = grid(10.0, 6.0, 5, 3)
    assert not any(_reversed(sheet))
    assert not any(_reversed(_turned(sheet, np.arange(len(sheet.faces)))))


def test_a_bottle_that_is_inside_out_is_turned_though_it_is_open() -> None:
    bottle = surface(BALL.positions, BALL.faces[4:, ::-1])
    assert all(_reversed(bottle))


def test_a_part_that_cannot_be_seen_stays() -> None:
    core = _turned(sphere(1.0, 1), np.arange(80))
    assert not any(_reversed(join(BALL, core)))


@pytest.mark.parametrize("turns", [1, 3])
def test_a_moebius_band_stays_as_it_is(turns: int) -> None:
    around = np.linspace(0, 2 * np.pi, 41)[:-1]
    out = np.column_stack([np.cos(around), np.sin(around), 0 * around])
    tilt = turns * around / 2
    across = np.cos(tilt)[:, None] * out + np.sin(tilt)[:, None] * [0, 0, 1]
    positions = np.concatenate([5 * out - across, 5 * out + across])
    here, beside = np.arange(40), (np.arange(40) + 1) % 40
    low, high = beside.copy(), beside + 40
    low[-1], high[-1] = 40, 0  # closed with a half turn
    faces = np.concatenate([np.column_stack([here, low, high]), np.column_stack([here, high, here + 40])])
    assert not any(_reversed(surface(positions, faces)))


def test_a_part_that_is_drawn_from_its_front_only_keeps_the_winding_of_its_file() -> None:
    room = _turned(box(3.0, 3.0, 3.0), np.arange(12))
    assert not _oriented(room, one_sided=np.ones(12, dtype=bool)).flipped.any()


def test_the_rest_of_a_part_follows_what_is_drawn_from_its_front_only() -> None:
    room = _turned(box(3.0, 3.0, 3.0), np.arange(6))
    inwards = np.arange(12) < 6
    assert _oriented(room, one_sided=inwards).flipped.tolist() == [False] * 6 + [True] * 6


def test_two_faces_that_are_drawn_from_opposite_sides_belong_to_no_part_together() -> None:
    sheet = _turned(grid(10.0, 6.0, 2, 1), np.arange(2))
    found = _oriented(sheet, one_sided=np.ones(len(sheet.faces), dtype=bool))
    assert not found.flipped.any()
    assert set(found.component[:2]).isdisjoint(found.component[2:])


def test_only_a_body_without_holes_that_shows_its_fronts_is_closed() -> None:
    assert _oriented(BALL).closed.all()
    assert not _oriented(surface(BALL.positions, BALL.faces[1:])).closed.any()
    assert not _oriented(_turned(BALL, np.arange(320)), one_sided=np.ones(320, dtype=bool)).closed.any()
