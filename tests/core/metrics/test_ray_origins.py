import numpy as np
import pytest

from core.metrics.ray_origins import above_letters, top_face
from tests.core.placement.shapes import box, index_of, moved, plane, rotation


def test_rays_start_one_and_a_half_reliefs_above_the_surface_wherever_the_box_is() -> None:
    shape = plane(10, 10)
    for height in (-0.1, 0.0, 0.04):
        points = above_letters(shape, index_of(shape), box((0, 0, height)), relief=np.array([0.2]))
        assert points.shape == (1, 64, 3)
        assert points[0, :, 2] == pytest.approx(0.3, abs=1e-5)


def test_sunken_letters_are_looked_at_from_above_too() -> None:
    shape = plane(10, 10)
    points = above_letters(shape, index_of(shape), box(), relief=np.array([-0.2]))
    assert points[0, :, 2] == pytest.approx(0.3, abs=1e-5)


def test_letters_that_stand_off_the_surface_are_looked_at_from_above_their_box() -> None:
    shape = plane(10, 10)
    points = above_letters(shape, index_of(shape), box((0, 0, 0.2)), relief=np.array([0.2]))
    assert points[0, :, 2] == pytest.approx(0.2 + 0.25, abs=2e-3)


def test_rays_follow_the_slope_under_a_level_box() -> None:
    shape = moved(plane(20, 20), rotation((0, 1, 0), -1))
    points = above_letters(shape, index_of(shape), box(), relief=np.array([0.2]))[0]
    assert points[:, 2] - points[:, 0] * np.tan(np.radians(1)) == pytest.approx(0.3, abs=1e-5)


def test_the_top_face_is_the_front_of_the_box_with_its_corners() -> None:
    points = top_face(box((1, 2, 3), (4, 1, 0.5)))[0]
    assert points.shape == (64, 3)
    assert points.min(axis=0).tolist() == pytest.approx([-1, 1.5, 3.25], abs=2e-3)
    assert (points[:, 2] > 3.25).all()  # clear of flat letters, which end on the face
    assert points.max(axis=0).tolist() == pytest.approx([3, 2.5, 3.25], abs=2e-3)
