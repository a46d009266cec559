import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.placement.arrange import moved as move
from core.placement.arrange import wider
from core.placement.fit import refit
from tests.core.placement.shapes import box, boxes, carrier, cuboid, rotation
from tests.core.placement.test_fit import opened


def proposed(shape: Surface, where: Boxes) -> Boxes:
    carried = carrier(shape)
    return move(where, where.size[:, 1], carried.index, carried.surface.normals, carried.component)


def centers(found: Boxes) -> set[tuple[float, ...]]:
    return {tuple((center.round(2) + 0.0).tolist()) for center in found.center}


def test_a_mark_near_a_rim_is_tried_in_the_middle_of_its_face() -> None:
    plate = cuboid(5.2, 2, 1)
    found = centers(proposed(plate, box((0.3, 0.3, 0.5), size=(4, 0.5, 0.3))))
    for x, y in ((0.3, 0.0), (0.0, 0.3), (0.0, 0.0)):
        assert any(np.hypot(a - x, b - y) < 0.1 for a, b, _ in found), (x, y)


def test_a_mark_with_enough_room_on_all_sides_stays_where_it_is() -> None:
    assert len(proposed(cuboid(30, 30, 30), box((3, 2, 15), size=(4, 0.5, 0.3)))) == 0


def test_a_slanted_mark_is_tried_level() -> None:
    slanted = box((3, 2, 15), size=(4, 0.5, 0.3), axes=rotation((0, 0, 1), 12))
    found = proposed(cuboid(30, 30, 30), slanted)
    assert len(found) == 1
    assert np.allclose(found.axes[0], np.eye(3))


def test_of_two_words_off_one_baseline_each_is_tried_on_the_others() -> None:
    pair = boxes(box((-3, 0, 15), size=(4, 0.5, 0.3)), box((3, 0.3, 15), size=(4, 0.5, 0.3)))
    assert centers(proposed(cuboid(30, 30, 30), pair)) == {(-3, 0.3, 15), (3, 0, 15)}


def test_there_may_be_nothing_to_move_or_to_widen() -> None:
    assert len(proposed(cuboid(30, 30, 30), Boxes.empty())) == 0
    assert len(wider(Boxes.empty(), np.empty(0), thinnest=0.25)) == 0


def grown(shape: Surface, where: Boxes, most: float) -> list[float]:
    found = refit(opened(shape), wider(where, np.full(len(where), most), thinnest=0.25))
    assert np.allclose(found.boxes.size[:, 1] / found.boxes.size[:, 0], where.size[0, 1] / where.size[0, 0])
    return sorted(found.boxes.size[:, 0].tolist())


def test_text_grows_as_wide_as_its_place_has_room_for() -> None:
    rim = box((0, 0.02, 15), size=(1.2, 0.15, 0.25))
    assert grown(cuboid(30, 0.3, 30), rim, most=2.0) == pytest.approx([1.2 * 1.1**step for step in (1, 2, 3, 4, 5)])
    assert max(grown(cuboid(30, 0.22, 30), rim, most=2.0)) == pytest.approx(1.2 * 1.1**2)


def test_text_grows_to_less_than_the_width_that_was_tried_before() -> None:
    front = box((0, 0, 15), size=(2.0, 0.25, 0.3))
    assert grown(cuboid(30, 30, 30), front, most=2.8) == pytest.approx([2.2, 2.42, 2.662])
    assert grown(cuboid(30, 30, 30), front, most=2.0) == []
