import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.metrics.prominence import prominence
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, boxes, cuboid, index_of, join, moved

CUBE = cuboid(10, 10, 10)
FRONT = box((0, 0, 5), size=(4, 4, 0.4))


def measured(marked: Surface, where: Boxes) -> tuple[float, float]:
    return prominence(index_of(CUBE), marked, index_of(marked), where, np.full(len(where), 0.2))


def test_an_asset_without_letters_shows_none() -> None:
    assert measured(CUBE, FRONT) == (0, 0)


def test_what_stands_out_in_a_marks_box_is_its_share_of_what_is_seen() -> None:
    block = join(CUBE, moved(cuboid(4, 4, 0.2), shift=(0, 0, 5.1)))
    mean, least = measured(block, FRONT)
    assert least == 0
    # Of the 24 views the front counts twice; those that see it at 30 and 60 degrees see one side more.
    shares = [0.16, 0.16, *4 * [0.16 * np.cos(np.pi / 6) / (np.cos(np.pi / 6) + 0.5)]]
    shares += 4 * [0.16 * 0.5 / (np.cos(np.pi / 6) + 0.5)]
    assert mean == pytest.approx(sum(shares) / 24, rel=0.15)


def test_what_stands_out_elsewhere_or_lies_under_a_mark_is_not_letters() -> None:
    block = join(CUBE, moved(cuboid(4, 4, 0.2), shift=(0, 0, 5.1)))
    assert measured(block, box((0, 0, -5), size=(4, 4, 0.4))) == (0, 0)
    assert measured(block, box((4.5, 4.5, 5), size=(0.5, 0.5, 0.4))) == (0, 0)


def test_larger_letters_are_more_prominent() -> None:
    small, large = (join(CUBE, moved(cuboid(side, side, 0.2), shift=(0, 0, 5.1))) for side in (1, 3))
    assert measured(small, FRONT)[0] < measured(large, FRONT)[0] / 4


def test_marks_on_every_side_leave_no_view_without() -> None:
    sides = on_all_sides()
    blocks = [moved(cuboid(3, 3, 3), shift=tuple(3.7 * one)) for one in sides.axes[:, 2]]
    where = boxes(*(box(tuple(center), size=(3, 3, 0.8)) for center in sides.center))
    where = Boxes(sides.center, sides.axes, where.size)
    assert measured(join(CUBE, *blocks), where)[1] > 0.03
