import pytest

from core.metrics.label_height import label_height
from core.metrics.ray_origins import top_face
from core.placement.label_height import picture_side
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, cuboid, index_of

BLOCK = cuboid(10, 10, 10)
RADIUS = BLOCK.radius


def test_a_mark_that_one_view_in_four_shows_counts_in_these() -> None:
    marks = box((0, 0, 5), size=(4, 2, 0.5))
    share, reached = label_height(marks, marks.size[:, 1], top_face(marks), index_of(BLOCK), RADIUS, 0.01)
    assert reached == 6 / 24
    assert 0.8 * 2 / picture_side(RADIUS) < share * 4 < 1.1 * 2 / picture_side(RADIUS)


@pytest.mark.parametrize(("rule", "reached"), [(None, None), (0.001, 1.0), (0.9, 0.0)])
def test_a_rule_is_reached_or_not(rule: float | None, reached: float | None) -> None:
    marks = on_all_sides()
    assert label_height(marks, marks.size[:, 1], top_face(marks), index_of(BLOCK), RADIUS, rule)[1] == reached


def test_letters_that_something_hides_are_not_seen() -> None:
    marks = box((0, 0, 5), size=(4, 2, 0.5))
    assert label_height(marks, marks.size[:, 1], top_face(marks), index_of(cuboid(20, 20, 20)), 18.0, 0.01) == (0, 0)
