import numpy as np
import pytest

from core.lab.attacks.noise import noise
from tests.core.lab.attacks.settings import mesh_of, target_of
from tests.core.placement.shapes import sphere


def test_vertices_move_by_a_gaussian_of_the_strength_in_diagonals_in_every_direction() -> None:
    ball = mesh_of(sphere(3, rings=60))
    shift = noise(ball, target_of(ball), 0.002).mesh.positions - ball.positions
    sigma = 0.002 * 6 * np.sqrt(3)
    assert np.sqrt((shift**2).sum(axis=1).mean()) == pytest.approx(sigma, rel=0.03)
    assert shift.std(axis=0) == pytest.approx(np.full(3, sigma / np.sqrt(3)), rel=0.05)
    assert np.abs(shift.mean(axis=0)).max() < sigma / 20


def test_the_same_seed_makes_the_same_noise_and_another_seed_another() -> None:
    ball = mesh_of(sphere(3, rings=6))
    first, again, other = (noise(ball, target_of(ball, seed)).mesh.positions for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_neighbours_stay_joined() -> None:
    ball = mesh_of(sphere(3, rings=6))
    assert np.array_equal(noise(ball, target_of(ball)).mesh.faces, ball.faces)
