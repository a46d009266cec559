import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.metrics.ray import ray
from core.metrics.ray_origins import top_face
from core.placement.candidates import upright
from core.placement.selection import visibility
from tests.core.placement.shapes import box, boxes, cuboid, index_of, inside_out, join, moved, plane


def on_all_sides() -> Boxes:
    normals = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    return Boxes(normals * 5, upright(normals), np.tile([4.0, 1.0, 0.5], (6, 1)))


def test_marks_on_all_six_sides_of_a_block_are_seen_from_every_view() -> None:
    marks = on_all_sides()
    assert ray(marks, top_face(marks), index_of(cuboid(10, 10, 10))) == 1


def test_views_that_no_mark_faces_score_nothing() -> None:
    marks = box((0, 0, 5))
    facing = (view_directions()[0][:, 2] > np.cos(np.radians(45.001))).sum()
    assert facing == 6  # the front twice, and 30 degrees to four sides
    assert ray(marks, top_face(marks), index_of(cuboid(10, 10, 10))) == pytest.approx(6 / 24)


def test_one_blocked_ray_hides_a_mark() -> None:
    pole = moved(cuboid(0.5, 0.5, 0.5), shift=(1.55, 0, 20))  # on the way from an end of the mark to a camera in front
    marks = box((0, 0, 5))
    asset = join(cuboid(10, 10, 10), pole)
    assert ray(marks, top_face(marks), index_of(asset)) == pytest.approx(4 / 24)  # both front views are lost


def test_a_wall_beside_a_mark_hides_it_from_a_camera_in_the_middle_as_from_a_viewer() -> None:
    """Far away it would be seen past the wall."""
    marks, wall = box((4, 0, 5), (1, 0.5, 0.5)), moved(cuboid(0.2, 10, 20), shift=(3, 0, 15))
    front = view_directions()[0][:1]
    assert not visibility(marks, top_face(marks), index_of(join(cuboid(10, 10, 10), wall)), front).any()
    assert visibility(marks, top_face(marks), index_of(cuboid(10, 10, 10)), front).all()


def test_a_view_scores_the_share_of_the_marks_that_face_it() -> None:
    wall = moved(inside_out(plane(3, 3)), shift=(3, 0, 20))
    marks = boxes(box((3, 0, 5), (2, 0.5, 0.5)), box((-3, 0, 5), (2, 0.5, 0.5)))
    asset = join(cuboid(10, 10, 10), wall)
    assert ray(marks, top_face(marks), index_of(asset)) == pytest.approx((4 + 2 * 0.5) / 24)
