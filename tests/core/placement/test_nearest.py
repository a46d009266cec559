import numpy as np
import pytest

from core.placement.nearest import of_surface
from tests.core.placement.shapes import box, cuboid, index_of, join, moved, plane, planes_of, sphere

LIFT = np.array([[0.0, 0.0, 0.5]])  # of a box one thick that looks along Z


def test_over_a_plane_both_find_the_foot_of_the_perpendicular() -> None:
    points = np.array([[[1.0, 2.0, 0.3], [-3.0, 0.5, -0.2]]])
    for nearest in (planes_of(plane(30, 30)), of_surface(index_of(plane(30, 30)))):
        assert nearest(points, LIFT) == pytest.approx(points * [1, 1, 0], abs=1e-12)


def test_over_a_ball_they_agree_as_far_as_it_is_flat() -> None:
    shape, turn = sphere(10, rings=200), np.radians(5)
    points = 10.1 * np.array([[[0.0, np.sin(turn), np.cos(turn)], [np.sin(turn), 0.0, np.cos(turn)]]])
    exact = of_surface(index_of(shape))(points, LIFT)
    assert planes_of(shape)(points, LIFT) == pytest.approx(exact, abs=0.005)


def test_beyond_an_edge_and_over_other_ground_the_nearest_point_anywhere_is_taken() -> None:
    step = join(cuboid(10, 10, 10), moved(cuboid(10, 10, 10), shift=(10.5, 0, -3)))
    points = np.array([[[5.2, 0.0, 5.0], [12.0, 0.0, 5.0]]])
    assert planes_of(step)(points, LIFT) == pytest.approx(of_surface(index_of(step))(points, LIFT))


def test_ground_that_looks_away_is_none() -> None:
    sheet = plane(30, 30)
    below = np.array([[0.0, 0.0, -0.5]])
    points = np.array([[[40.0, 0.0, 0.0], [1.0, 1.0, 0.1]]])
    assert planes_of(sheet)(points, below) == pytest.approx(of_surface(index_of(sheet))(points, below))


def test_each_box_looks_along_its_own_normal() -> None:
    both = np.concatenate([box((0, 0, 5)).center, box((5, 0, 0)).center])
    points, lift = both[:, None] * 1.02, both / 10
    assert planes_of(cuboid(10, 10, 10))(points, lift) == pytest.approx(both[:, None])
