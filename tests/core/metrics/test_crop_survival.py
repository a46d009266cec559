import numpy as np
import pytest

from core.metrics.crop_survival import crop_survival
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, boxes, cuboid

ASSET = cuboid(10, 10, 10)


def test_a_mark_on_every_side_survives_every_crop_through_the_middle() -> None:
    assert crop_survival(ASSET, on_all_sides()) == 1


def test_a_single_small_mark_survives_half_of_the_crops() -> None:
    assert crop_survival(ASSET, box((0, 0, 5), size=(0.2, 0.05, 0.02))) == pytest.approx(0.5, abs=0.03)


def test_a_mark_across_the_middle_survives_fewer_crops_than_one_at_the_rim() -> None:
    assert crop_survival(ASSET, box((0, 0, 0))) == 0
    assert crop_survival(ASSET, box((0, 0, 5), size=(9, 1, 0.5))) < crop_survival(
        ASSET, box((0, 0, 5), size=(1, 1, 0.5))
    )


def test_marks_on_opposite_sides_stand_in_for_one_another() -> None:
    pair = boxes(box((0, 0, 5), size=(1, 0.2, 0.1)), box((0, 0, -5), size=(1, 0.2, 0.1)))
    assert crop_survival(ASSET, pair) > 0.9


def test_no_marks_survive_nothing() -> None:
    assert crop_survival(ASSET, box()[np.array([], dtype=np.int64)]) == 0
