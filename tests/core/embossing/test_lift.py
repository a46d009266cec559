import numpy as np
import pytest

from core.embossing.lift import folded, inverted, lift, obstructed
from core.geometry.spatial import SpatialIndex
from tests.core.shapes import box, grid, join, moved, sphere, surface

UP = np.array([[0.0, 0.0, 1.0]])


def test_tops_keep_their_distance_where_the_given_normal_is_wrong() -> None:
    ball = sphere(10.0)
    base = ball.positions[ball.positions[:, 2] > 9.5]
    tops = lift(base, np.broadcast_to(UP, base.shape), 0.3, SpatialIndex(ball.positions, ball.faces))
    distance, _, _ = SpatialIndex(ball.positions, ball.faces).closest(tops)
    assert np.allclose(distance, 0.3, atol=1e-9)


def test_tops_in_a_groove_keep_their_distance_from_both_sides() -> None:
    groove = surface(
        np.array([[-5.0, -5, 2], [-5, 5, 2], [0, -5, 0], [0, 5, 0], [5, -5, 2], [5, 5, 2]]),
        np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]]),
    )
    index = SpatialIndex(groove.positions, groove.faces)
    tops = lift(np.array([[0.0, 0.0, 0.0]]), UP, 0.2, index)
    assert index.closest(tops)[0][0] == pytest.approx(0.2, abs=1e-3)
    assert abs(tops[0, 0]) < 0.02 * 0.2 + 1e-3  # and hardly slide to a side


def test_letters_that_turn_over_are_noticed() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    assert not folded(square, triangles, UP[0])
    crossed = square[[0, 2, 1, 3]]
    assert folded(crossed, triangles, UP[0])


def test_each_triangle_that_turns_over_is_named() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]])
    triangles = np.array([[0, 1, 2], [0, 3, 2], [1, 4, 2]])
    assert inverted(points, triangles, UP[0]).tolist() == [False, True, False]


def test_a_lid_above_is_an_obstruction_only_within_reach() -> None:
    ground = grid(4.0, 4.0, 4, 4)
    base = np.array([[0.1, 0.2, 0.0]])
    for height, expected in ((0.25, True), (0.4, False)):
        both = join(ground, moved(ground, 0.0, 0.0, height))
        index = SpatialIndex(both.positions, both.faces)
        assert obstructed(base, base + 0.2 * UP, 0.2, index).tolist() == [expected]


def test_the_back_of_a_plate_is_an_obstruction_for_sunken_letters() -> None:
    base = np.array([[0.1, 0.2, 0.5]])
    for relief, expected in ((-0.9, True), (-0.5, False)):
        plate = box(4.0, 4.0, 1.0)
        index = SpatialIndex(plate.positions, plate.faces)
        assert obstructed(base, base + relief * UP, relief, index).tolist() == [expected]


def test_surface_that_faces_elsewhere_does_not_bend_letters() -> None:
    """A wedge over the ground that is wound inside out: eyes look through its backs, and letters stand under it."""
    ground = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    wedge = np.array([[0.2, -9.0, 0.1], [0.2, 9, 0.1], [3, 9, 3], [3, -9, 3]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    index = SpatialIndex(np.concatenate([ground, wedge]), faces)
    assert (index.normals(np.arange(4))[:, 2] > 0).tolist() == [True, True, False, False]
    base = np.array([[0.0, 0, 0], [0.15, 0, 0], [0.3, 1, 0]])
    tops = lift(base, np.tile([0.0, 0, 1], (3, 1)), 0.12, index)
    np.testing.assert_allclose(tops, base + np.array([0, 0, 0.12]), atol=1e-9)
