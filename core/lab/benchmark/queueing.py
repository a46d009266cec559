"""A queue before several workers, simulated: Poisson arrivals, first come first served, any service times (M/G/c).

Many independent runs go at the same time, as rows of arrays; the steps of each run are its arrivals. Every number of
workers has the same arrivals and the same work, so more workers are never worse by chance.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, tuple[int, int]], Floats]  # service times [s] of this shape


@dataclass(frozen=True)
class Effort:
    """Extent of a simulation: independent runs, arrivals of each that count, and arrivals before them that do not.

    A queue forgets how it began after about 1 / (1 - share of busy workers)^2 arrivals: 400 where 95% are busy.
    """

    runs: int = 100
    arrivals: int = 10_000
    warm_up: int = 5000
    seed: int = 0  # of every random draw


def waits(rate: float, draw: Draw, workers: int, effort: Effort) -> tuple[Floats, Floats]:
    """Seconds that each job waits until a worker starts it, and its service time, (runs, arrivals) each.

    Args:
        rate: arrivals a second.
        draw: service times.
        workers: number of workers.
        effort: of the simulation.
    """
    random = np.random.default_rng(effort.seed)
    shape = (effort.runs, effort.warm_up + effort.arrivals)
    arrivals = np.cumsum(random.exponential(1 / rate, shape), axis=1)
    work = draw(random, shape)
    free = np.zeros((effort.runs, workers))  # when each worker will be
    row = np.arange(effort.runs)
    waited = np.empty(shape)
    for job in range(shape[1]):
        first = free.argmin(axis=1)
        start = np.maximum(free[row, first], arrivals[:, job])
        waited[:, job] = start - arrivals[:, job]
        free[row, first] = start + work[:, job]
    return waited[:, effort.warm_up :], work[:, effort.warm_up :]


def fewest_workers(rate: float, draw: Draw, mean: float, wait: float, effort: Effort, busy: float = 1.0) -> int:
    """The fewest workers with which 95% of the jobs wait no longer than so many seconds.

    Args:
        rate: arrivals a second.
        draw: service times.
        mean: of the service times [s].
        wait: seconds.
        effort: of the simulation.
        busy: the largest share of the workers that may be busy on average.
    """

    def enough(workers: int) -> bool:
        return float(np.quantile(waits(rate, draw, workers, effort)[0], 0.95)) <= wait

    load = rate * mean
    least = max(math.floor(load) + 1, math.ceil(load / busy))  # with no more than the load, the queue has no end
    most, step = least, 1
    while not enough(most):
        least, most, step = most + 1, most + step, 2 * step
    while least < most:
        middle = (least + most) // 2
        least, most = (least, middle) if enough(middle) else (middle + 1, most)
    return most
