import pytest

from core.metrics.wps import wps
from tests.core.placement.shapes import box, boxes, cuboid, inside_out, join, moved, plane

WIDE = (4.02, 2.02, 0.5)  # just more than 4 x 2 squares of side 1
AREA = 4.02 * 2.02


def test_faces_wholly_inside_a_box_count_by_their_projected_area() -> None:
    shape = plane(10, 10, cells=10)
    assert wps(shape, box(size=WIDE))[0] == pytest.approx(8 / AREA)
    # Half a square further right three columns are whole, and the triangles cut by the box count nothing.
    assert wps(shape, box((0.5, 0, 0), WIDE))[0] == pytest.approx(6 / AREA)


def test_coarse_faces_that_leave_the_box_do_not_count() -> None:
    assert wps(plane(10, 10), box())[0] == 0


def test_the_score_is_at_most_one_even_over_two_layers() -> None:
    layer = plane(10, 10, cells=10)
    assert wps(join(layer, moved(layer, shift=(0, 0, 0.1))), box(size=WIDE))[0] == 1


def test_faces_that_look_away_count_nothing() -> None:
    assert wps(inside_out(plane(10, 10, cells=10)), box(size=WIDE))[0] == 0


def test_each_box_gets_its_own_score() -> None:
    shape = plane(10, 10, cells=10)
    found = wps(shape, boxes(box(size=WIDE), box((0, 0, 5), WIDE), box((4, 0, 0), WIDE)))
    assert found.tolist() == pytest.approx([8 / AREA, 0, 6 / AREA])


def test_a_block_within_the_box_shows_its_front() -> None:
    assert wps(cuboid(1, 1, 0.2), box(size=WIDE))[0] == pytest.approx(1 / AREA)
