import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.products import applied, cross, dot, length, product, solved


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((5, 3), (3, 7)),
        ((5, 3), (3, 3)),
        ((5, 3), (3, 0)),
        ((4, 1), (1, 2)),
        ((6, 4, 3), (6, 3, 5)),
        ((4, 4), (9, 4, 4)),
    ],
)
def test_it_is_the_product_of_matrices(one: tuple[int, ...], other: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=one), rng.normal(size=other)
    assert np.allclose(product(a, b), a @ b, atol=1e-14)


def test_terms_are_added_one_after_the_other() -> None:
    a = np.array([[1e16, 1.0, -1e16]])
    assert product(a, np.ones((3, 1))) == 0.0
    assert product(a[:, ::-1], np.ones((3, 1))) == 0.0
    assert product(a[:, [0, 2, 1]], np.ones((3, 1))) == 1.0


def test_one_matrix_or_one_for_each_is_applied_to_vectors() -> None:
    rng = np.random.default_rng(3)
    matrices, vectors = rng.normal(size=(20, 2, 3)), rng.normal(size=(20, 3))
    assert np.allclose(applied(matrices, vectors), np.einsum("nij,nj->ni", matrices, vectors))
    np.testing.assert_array_equal(applied(matrices[0], vectors), product(vectors, matrices[0].T))


def test_lengths_are_those_of_numpy_bit_for_bit() -> None:
    vectors = np.random.default_rng(4).normal(size=(500, 3))
    np.testing.assert_array_equal(length(vectors), np.linalg.norm(vectors, axis=1))
    np.testing.assert_array_equal(dot(vectors, vectors), (vectors * vectors).sum(axis=1))


def test_what_was_multiplied_is_solved_again() -> None:
    rng = np.random.default_rng(1)
    matrices, x = rng.normal(size=(50, 3, 3)) + 2 * np.eye(3), rng.normal(size=(50, 3))
    assert np.allclose(solved(matrices, (matrices @ x[..., None])[..., 0]), x, rtol=1e-9)
    assert np.allclose(solved(matrices[0], x @ matrices[0].T), x, rtol=1e-9)


def test_a_singular_matrix_has_no_solution() -> None:
    assert not np.isfinite(solved(np.zeros((3, 3)), np.ones(3))).any()


@given(st.integers(0, 2**31))
def test_cross_products_are_those_of_numpy_bit_for_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(5, 1, 3)) * 10 ** rng.uniform(-9, 9), rng.normal(size=(4, 3))
    np.testing.assert_array_equal(cross(one, other), np.cross(one, other))
