import numpy as np
import pytest

from core.geometry.spatial import SpatialIndex
from core.geometry.surfels import Surfels
from tests.core.shapes import grid, sphere

RNG = np.random.default_rng(1)


def test_distances_over_smooth_ground_are_those_to_the_surface() -> None:
    ball = sphere(10.0, 5)
    direction = RNG.standard_normal((500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = direction * RNG.uniform(9.0, 11.0, (500, 1))
    exact, _, foot = SpatialIndex(ball.positions, ball.faces).closest(points)
    distance, face, nearest = Surfels(ball, RNG).closest(points)
    assert distance == pytest.approx(exact, abs=0.05)
    assert np.linalg.norm(nearest - foot, axis=1).max() < 1.0
    assert face.max() < len(ball.faces)


def test_beyond_an_edge_the_distance_grows() -> None:
    sheet = Surfels(grid(10.0, 10.0, 2, 2), RNG)
    distance, _, _ = sheet.closest(np.array([[0.0, 0.0, 2.0], [8.0, 0.0, 0.0], [20.0, 0.0, 0.0]]))
    assert distance == pytest.approx([2.0, 3.0, 15.0], abs=1.0)
