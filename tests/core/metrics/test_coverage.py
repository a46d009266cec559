import numpy as np
import pytest

from core.metrics.coverage import coverage
from core.metrics.ray_origins import top_face
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, cuboid, index_of, join, moved

# Share of cameras at 75 units that see a mark at 5 within 45 degrees: sin(angle) = cos(angle) - 5/75.
CAP = (1 - np.cos(np.pi / 4 - np.arcsin(5 / 75 / np.sqrt(2)))) / 2


def test_one_mark_covers_a_cone_of_45_degrees() -> None:
    marks = box((0, 0, 5))
    assert coverage(marks, top_face(marks), index_of(cuboid(10, 10, 10))) == pytest.approx(CAP, abs=0.02)


def test_six_marks_cover_all_but_the_corners_of_a_cube() -> None:
    marks = on_all_sides()
    assert coverage(marks, top_face(marks), index_of(cuboid(10, 10, 10))) == pytest.approx(6 * CAP, abs=0.03)


def test_a_mark_behind_a_wall_covers_nothing() -> None:
    marks = box((0, 0, 5))
    asset = join(cuboid(10, 10, 10), moved(cuboid(60, 60, 1), shift=(0, 0, 8)))
    assert coverage(marks, top_face(marks), index_of(asset)) == 0
