from core.metrics.label_height import label_height
from core.metrics.ray_origins import top_face
from core.placement.label_height import picture_side
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, cuboid, index_of

BLOCK = cuboid(10, 10, 10)
RADIUS = BLOCK.radius


def test_a_mark_that_one_view_in_four_shows_counts_in_these() -> None:
    marks = box((0, 0, 5), size=(4, 2, 0.5))
    share = label_height(marks, marks.size[:, 1], top_face(marks), index_of(BLOCK), RADIUS)
    assert 0.8 * 2 / picture_side(RADIUS) < share * 4 < 1.1 * 2 / picture_side(RADIUS)


def test_marks_on_all_sides_count_in_every_view() -> None:
    marks = on_all_sides()
    share = label_height(marks, marks.size[:, 1], top_face(marks), index_of(BLOCK), RADIUS)
    assert 0.8 / picture_side(RADIUS) < share < 1.2 / picture_side(RADIUS)


def test_letters_that_something_hides_are_not_seen() -> None:
    marks = box((0, 0, 5), size=(4, 2, 0.5))
    assert label_height(marks, marks.size[:, 1], top_face(marks), index_of(cuboid(20, 20, 20)), 18.0) == 0
