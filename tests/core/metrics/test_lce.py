import numpy as np
import pytest
from numpy.typing import NDArray

from core.geometry.boxes import Boxes
from core.geometry.spatial import Hides, SpatialIndex
from core.geometry.surface import Surface
from core.metrics import lce as module
from tests.core.placement.shapes import box, boxes, index_of, inside_out, join, moved, plane, rotation, surface


def lce(original: SpatialIndex, watermarked: Surface, marks: Boxes, relief: NDArray[np.float64]) -> float | None:
    found = module.lce(original, watermarked, marks, relief)
    return None if found is None else found[0]


def letters(height: float, slope: float = 0.0, x: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    patch = plane(2, 0.5, cells=4)
    positions = patch.positions + np.array([x, 0, height])
    positions[:, 2] += slope * patch.positions[:, 0]
    return positions, patch.faces


def test_letters_at_a_constant_height_have_no_error() -> None:
    marked = join(plane(20, 20), surface(*letters(0.2)))
    assert lce(index_of(plane(20, 20)), marked, box(), np.array([0.2])) == pytest.approx(0, abs=1e-20)


def test_the_error_is_the_variance_of_the_height() -> None:
    positions, faces = letters(0.2, slope=0.02)
    marked = join(plane(20, 20), surface(positions, faces))
    assert lce(index_of(plane(20, 20)), marked, box(), np.array([0.2])) == pytest.approx(positions[:, 2].var())


def test_a_sheet_close_above_the_letters_that_looks_away_from_them_is_not_what_they_stand_on() -> None:
    floor, sheet = plane(20, 20), moved(inside_out(plane(4, 2)), rotation((0, 1, 0), 3), (0, 0, 0.35))
    original = join(floor, sheet)
    hides = np.full(len(original.faces), Hides.FROM_FRONT, dtype=np.uint8)
    index = SpatialIndex(original.positions, original.faces, hides=hides)
    marked = join(floor, sheet, surface(*letters(0.2)))
    assert lce(index, marked, box(), np.array([0.2])) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("twin_first", [True, False])
def test_ground_with_a_second_layer_that_looks_away_is_no_letter_however_deep_it_is_below(twin_first: bool) -> None:
    floor, deep = plane(20, 20, cells=10), moved(plane(20, 20), shift=(0, 0, -5))
    layers = (inside_out(floor), floor) if twin_first else (floor, inside_out(floor))
    original = join(*layers, deep)
    hides = np.full(len(original.faces), Hides.FROM_FRONT, dtype=np.uint8)
    index = SpatialIndex(original.positions, original.faces, hides=hides)
    marked = join(original, surface(*letters(0.2)))
    assert lce(index, marked, box(), np.array([0.2])) == pytest.approx(0, abs=1e-12)


def test_sunken_letters_are_measured_by_their_depth() -> None:
    positions, faces = letters(-0.2, slope=0.02)
    marked = join(plane(20, 20), surface(positions, faces))
    assert lce(index_of(plane(20, 20)), marked, box(), np.array([-0.2])) == pytest.approx(positions[:, 2].var())


def test_the_result_is_the_mean_over_marks_each_with_its_own_height() -> None:
    flat, sloped = letters(0.18, x=-4), letters(0.25, slope=0.03, x=4)
    marked = join(plane(20, 20), surface(*flat), surface(*sloped))
    found = lce(index_of(plane(20, 20)), marked, boxes(box((-4, 0, 0)), box((4, 0, 0))), np.array([0.2, 0.2]))
    assert found == pytest.approx(sloped[0][:, 2].var() / 2)


def test_of_all_marks_together_the_heights_of_the_marks_differ_too() -> None:
    low, high = letters(0.2, x=-4), letters(0.3, x=4)
    marked = join(plane(20, 20), surface(*low), surface(*high))
    marks = boxes(box((-4, 0, 0)), box((4, 0, 0)))
    assert module.lce(index_of(plane(20, 20)), marked, marks, np.array([0.2, 0.3])) == pytest.approx((0, 0.05**2))


def test_marks_of_one_height_have_the_same_error_together() -> None:
    marked = join(plane(20, 20), surface(*letters(0.2, 0.02, x=-4)), surface(*letters(0.2, 0.02, x=4)))
    marks = boxes(box((-4, 0, 0)), box((4, 0, 0)))
    alone, together = module.lce(index_of(plane(20, 20)), marked, marks, np.array([0.2, 0.2])) or (0, 1)
    assert together == pytest.approx(alone)


def test_letters_higher_than_a_thin_box_are_still_found() -> None:
    marked = join(plane(20, 20), surface(*letters(0.5, slope=0.02)))
    assert lce(index_of(plane(20, 20)), marked, box(size=(4, 1, 0.2)), np.array([0.5])) is not None


def test_without_any_letter_there_is_no_number() -> None:
    assert lce(index_of(plane(20, 20)), moved(plane(20, 20)), box(), np.array([0.2])) is None
