import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.geometry.triangles import barycentric, doubled_area, flat_normals, ring_area, unit

POINTS = arrays(np.float64, (3, 2), elements=st.floats(-10, 10, width=32))


def test_a_degenerate_triangle_has_no_normal() -> None:
    corners = np.array([[[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 0, 0], [2, 0, 0], [0, 2, 0]]], dtype=float)
    np.testing.assert_array_equal(flat_normals(corners), [[0, 0, 0], [0, 0, 1]])


def test_barycentric_coordinates_stay_inside_the_triangle() -> None:
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    outside = np.array([[[-1e-12, 0.5, 0.0], [2.0, 0.0, 0.0], [0.25, 0.25, 0.3]]])
    result = barycentric(outside, triangle)[0]
    assert np.allclose(result, np.array([[0.5, 0, 0.5], [0, 1, 0], [0.5, 0.25, 0.25]]))


@given(POINTS)
def test_the_area_of_a_triangle_is_that_of_its_ring_and_turns_its_sign_with_it(corners: np.ndarray) -> None:
    a, b, c = corners
    assert doubled_area(a, b, c) == pytest.approx(2 * ring_area(corners), abs=1e-9)
    assert doubled_area(c, b, a) == pytest.approx(-doubled_area(a, b, c), abs=1e-9)


def test_a_ring_far_from_the_origin_keeps_its_area() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert ring_area(square + 1e9) == 1.0


def test_a_vector_of_no_length_has_no_direction() -> None:
    assert unit(np.array([[0.0, 0, 0], [0, 3, 4]])).tolist() == [[0, 0, 0], [0, 0.6, 0.8]]
