import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.arrays import Float
from core.geometry.triangles import (
    barycentric,
    bisected,
    doubled_area,
    flat_normals,
    plane_barycentric,
    ring_area,
    unit,
)

POINTS = arrays(np.float64, (3, 2), elements=st.floats(-10, 10, width=32))


def test_a_degenerate_triangle_has_no_normal() -> None:
    corners = np.array([[[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 0, 0], [2, 0, 0], [0, 2, 0]]], dtype=float)
    np.testing.assert_array_equal(flat_normals(corners), [[0, 0, 0], [0, 0, 1]])


def test_barycentric_coordinates_stay_inside_the_triangle() -> None:
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    outside = np.array([[[-1e-12, 0.5, 0.0], [2.0, 0.0, 0.0], [0.25, 0.25, 0.3]]])
    result = barycentric(outside, triangle)[0]
    assert np.allclose(result, np.array([[0.5, 0, 0.5], [0, 1, 0], [0.5, 0.25, 0.25]]))


def test_in_the_plane_barycentric_coordinates_are_the_same_to_the_last_bit() -> None:
    rng = np.random.default_rng(2)
    triangles, points = rng.normal(size=(400, 3, 2)), rng.normal(size=(400, 2))
    solid = barycentric(np.pad(points, ((0, 0), (0, 1)))[:, None], np.pad(triangles, ((0, 0), (0, 0), (0, 1))))
    np.testing.assert_array_equal(plane_barycentric(points, triangles), solid[:, 0])


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


@given(
    corners=arrays(np.float64, st.tuples(st.integers(0, 5), st.just(3), st.just(3)), elements=st.floats(-10, 10)),
    longest=st.floats(1, 20),
)
def test_bisected_triangles_have_short_edges_and_cover_what_they_are_cut_from(corners: Float, longest: float) -> None:
    pieces, source = bisected(corners, longest)
    assert np.all(np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2) <= longest)
    assert np.all(np.bincount(source, minlength=len(corners)) >= 1) or not len(corners)
    areas = np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1)
    whole = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert np.allclose(np.bincount(source, weights=areas, minlength=len(corners)), whole, atol=1e-9)


def test_a_piece_winds_as_the_triangle_it_is_cut_from() -> None:
    corners = np.array([[[0, 0, 0], [4, 0, 0], [0, 3, 0]]], dtype=float)
    pieces, source = bisected(corners, 1.0)
    assert len(pieces) == len(source) > 16
    assert np.all(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])[:, 2] > 0)
