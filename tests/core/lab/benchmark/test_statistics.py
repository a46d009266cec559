"""Means, intervals and exponents against numbers worked out by hand."""

import numpy as np
import pytest

from core.lab.benchmark.statistics import Mean, mean, power_law


def test_the_interval_of_three_values_is_students() -> None:
    found = mean([1.0, 2.0, 3.0])
    assert found is not None
    # s = 1, n = 3: t(0.975, 2) = 4.302653, times 1 / sqrt(3).
    assert (found.value, found.count) == (2.0, 3)
    assert found.half == pytest.approx(4.302653 / np.sqrt(3), rel=1e-6)


def test_one_value_has_no_interval_and_none_no_mean() -> None:
    assert mean([0.25]) == Mean(0.25, None, 1)
    assert mean([]) is None


def test_an_exact_power_law_is_found_with_no_doubt_about_it() -> None:
    x = np.array([1e3, 1e4, 1e5, 1e6])
    law = power_law(list(x), list(0.02 * x**0.7))
    assert law is not None
    assert law.exponent == pytest.approx(0.7)
    assert law.factor == pytest.approx(0.02)
    assert law.half == pytest.approx(0.0, abs=1e-9)


def test_the_interval_of_the_exponent_covers_the_true_one_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    x = np.geomspace(1e3, 1e6, 12)
    covered = 0
    for _ in range(400):
        law = power_law(list(x), list(x**1.2 * np.exp(rng.normal(0, 0.3, len(x)))))
        assert law is not None
        covered += abs(law.exponent - 1.2) <= law.half
    assert 0.92 <= covered / 400 <= 0.98


def test_nothing_is_fitted_to_two_points_or_one_size() -> None:
    assert power_law([1.0, 2.0], [1.0, 2.0]) is None
    assert power_law([5.0, 5.0, 5.0], [1.0, 2.0, 3.0]) is None
