"""The simulation against the formulas that hold where service times are exponential, or all the same."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.lab.benchmark.queueing import Draw, Effort, Floats, fewest_workers, waits

MUCH = Effort(runs=300, arrivals=10_000, warm_up=5000)


def exponential(mean: float) -> Draw:
    def draw(random: np.random.Generator, shape: tuple[int, int]) -> Floats:
        return random.exponential(mean, shape)

    return draw


def constant(seconds: float) -> Draw:
    return lambda _random, shape: np.full(shape, seconds)


def erlang_c(load: float, workers: int) -> float:
    """The share of jobs that wait at all (Erlang 1917)."""
    blocked = 1.0
    for number in range(1, workers + 1):  # Erlang B, by its recursion
        blocked = load * blocked / (number + load * blocked)
    return blocked / (1 - load / workers * (1 - blocked))


@pytest.mark.parametrize(("load", "workers"), [(0.7, 1), (3.2, 4), (17.0, 20), (90.0, 96)])
def test_exponential_work_waits_as_erlang_c_says(load: float, workers: int) -> None:
    mean = 2.0
    waited, _ = waits(load / mean, exponential(mean), workers, replace(MUCH, seed=1))
    share, drained = erlang_c(load, workers), (workers - load) / mean
    assert (waited > 1e-9).mean() == pytest.approx(share, rel=0.03)
    assert waited.mean() == pytest.approx(share / drained, rel=0.05)
    assert np.quantile(waited, 0.95) == pytest.approx(math.log(share / 0.05) / drained, rel=0.05)


def test_constant_work_waits_half_as_long_before_one_worker() -> None:
    """Pollaczek and Khinchine: rate * E[work^2] / (2 (1 - load))."""
    waited, _ = waits(0.8, constant(1.0), 1, replace(MUCH, seed=2))
    assert waited.mean() == pytest.approx(0.8 / (2 * 0.2), rel=0.04)


def test_more_workers_never_let_a_job_wait_longer() -> None:
    few, work = waits(5.0, exponential(1.0), 6, Effort(seed=3))
    many, same = waits(5.0, exponential(1.0), 9, Effort(seed=3))
    assert np.array_equal(work, same)
    assert (many <= few + 1e-9).all()


@pytest.mark.parametrize(("load", "wait"), [(0.4, 5.0), (3.2, 1.0), (17.0, 0.1), (17.0, 30.0)])
def test_the_fewest_workers_are_those_of_erlang_c(load: float, wait: float) -> None:
    def slow(workers: int) -> bool:
        share, drained = erlang_c(load, workers), workers - load
        return share > 0.05 and math.log(share / 0.05) / drained > wait

    least = math.floor(load) + 1
    while slow(least):
        least += 1
    assert fewest_workers(load, exponential(1.0), 1.0, wait, Effort(seed=4)) == least


def test_the_same_seed_gives_the_same_waits() -> None:
    first, second, other = (waits(2.0, exponential(1.0), 3, Effort(seed=seed))[0] for seed in (5, 5, 6))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)
