import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.directions import (
    EYE_DISTANCE,
    cosines_to_cameras,
    fibonacci_directions,
    field_of_view,
    looks_at_cameras,
    to_cameras,
    view_directions,
)


def test_the_views_are_24_unit_directions_with_upright_cameras() -> None:
    direction, up = view_directions()
    assert direction.shape == up.shape == (24, 3)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    np.testing.assert_allclose(np.linalg.norm(up, axis=1), 1)
    np.testing.assert_allclose((direction * up).sum(axis=1), 0, atol=1e-12)


def test_both_turns_start_at_the_front_and_step_by_30_degrees() -> None:
    direction, up = view_directions()
    for first in (0, 12):
        np.testing.assert_allclose(direction[first], [0, 0, 1])
        np.testing.assert_allclose(up[first], [0, 1, 0])
        turn = direction[first : first + 12]
        np.testing.assert_allclose((turn * np.roll(turn, 1, axis=0)).sum(axis=1), np.cos(np.radians(30)))
    np.testing.assert_allclose(direction[:12, 0], 0, atol=1e-12)
    np.testing.assert_allclose(direction[12:, 1], 0, atol=1e-12)
    assert len(np.unique(direction.round(9) + 0.0, axis=0)) == 22


@given(st.integers(1, 500))
def test_fibonacci_directions_are_unit_vectors_without_repetition(count: int) -> None:
    directions = fibonacci_directions(count)
    assert directions.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    assert len(np.unique(directions.round(9), axis=0)) == count


@pytest.mark.parametrize("count", [200, 501])
def test_fibonacci_directions_cover_the_sphere_evenly(count: int) -> None:
    directions = fibonacci_directions(count)
    assert np.abs(directions.mean(axis=0)).max() < 0.01
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    spacing = np.degrees(np.arccos(nearest))
    assert spacing.max() < 1.5 * spacing.min() + 1


def test_a_camera_sees_the_whole_asset_with_some_margin() -> None:
    for radius in (1.0, 15.0, 15 * np.sqrt(3)):
        assert radius < EYE_DISTANCE * np.sin(field_of_view(radius) / 2) < 1.05 * radius


@given(st.integers(0, 2**32))
def test_cosines_are_those_of_the_ways_to_the_cameras(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, vectors = rng.uniform(-15, 15, (7, 3)), rng.normal(size=(7, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    directions = fibonacci_directions(7)
    found = cosines_to_cameras(points, vectors, directions)
    ways = to_cameras(points, directions)
    np.testing.assert_allclose(points + ways, EYE_DISTANCE * directions)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    np.testing.assert_allclose(np.diagonal(found), (ways * vectors).sum(axis=1), atol=1e-12)
    several = to_cameras(np.stack([points, points + 1], axis=1), directions)
    np.testing.assert_allclose(several[:, 1], EYE_DISTANCE * directions - points - 1)


def test_whether_cameras_are_looked_at_is_what_the_cosines_say() -> None:
    rng = np.random.default_rng(0)
    points, vectors, directions = rng.uniform(-15, 15, (1500, 3)), rng.normal(size=(1500, 3)), fibonacci_directions(40)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    for least in (0.1, np.cos(np.radians(45)), 0.999):
        expected = cosines_to_cameras(points, vectors, directions) >= least
        assert np.array_equal(looks_at_cameras(points, vectors, directions, least), expected)
    assert looks_at_cameras(points[:0], vectors[:0], directions, 0.5).shape == (0, 40)
