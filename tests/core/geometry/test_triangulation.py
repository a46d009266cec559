import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.triangulation import triangulate

# A dart: the corner in the middle is reflex.
DART = [[0.0, 0.0], [2.0, 2.0], [0.0, 1.0], [-2.0, 2.0]]
COMB = [[0, 0], [6, 0], [6, 3], [5, 3], [5, 1], [4, 1], [4, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]


def _signed_areas(flat: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (flat[triangles[:, corner]] for corner in range(3))
    return np.asarray((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def _outline_area(flat: np.ndarray) -> float:
    following = np.roll(flat, -1, axis=0)
    return float(np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0])) / 2


def _tilted(flat: np.ndarray) -> np.ndarray:
    """The plane outline in a plane of space that is no coordinate plane."""
    return np.asarray(flat @ np.array([[0.6, 0.0, 0.8], [0.48, 0.8, -0.36]]) + 10)


@pytest.mark.parametrize("outline", [DART, COMB, DART[1:] + DART[:1], [*COMB, [-1, 1.5]]])
@pytest.mark.parametrize("order", [1, -1])
def test_a_concave_polygon_is_covered_exactly_and_keeps_its_orientation(outline: list[list[float]], order: int) -> None:
    flat = np.array(outline, float)[::order]
    triangles, polygon = triangulate(_tilted(flat), np.arange(len(flat)), np.array([len(flat)]))
    areas = _signed_areas(flat, triangles)
    assert len(triangles) == len(flat) - 2
    assert np.all(polygon == 0)
    assert np.all(areas * order > 0)
    assert areas.sum() == pytest.approx(_outline_area(flat))


@given(st.lists(st.integers(0, 9), max_size=12), st.integers(0, 2**32 - 1))
def test_triangles_come_in_polygon_order_and_each_polygon_has_two_fewer_than_corners(
    sizes: list[int], seed: int
) -> None:
    corners = int(sum(sizes))
    positions = np.random.default_rng(seed).normal(size=(max(corners, 1), 3))
    triangles, polygon = triangulate(positions, np.arange(corners), np.array(sizes, np.int64))
    assert polygon.tolist() == [number for number, size in enumerate(sizes) for _ in range(size - 2)]
    first = np.cumsum(sizes) - sizes
    for number, triangle in zip(polygon, triangles, strict=True):
        assert set(triangle) <= set(range(first[number], first[number] + sizes[number]))
        assert len(set(triangle)) == 3


def test_a_convex_polygon_is_a_fan_about_its_first_corner() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    triangles, _ = triangulate(square, np.array([3, 0, 1, 2]), np.array([4]))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_a_polygon_without_area_still_falls_into_triangles() -> None:
    triangles, _ = triangulate(np.zeros((5, 3)), np.arange(5), np.array([5]))
    assert len(triangles) == 3
