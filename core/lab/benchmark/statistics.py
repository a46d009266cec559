"""Means with their intervals, and power laws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Mean:
    """A sample's mean.

    Attributes:
        value: the mean.
        half: half the width of its 95% interval; None for a single value, which has none.
        count: of the values.
    """

    value: float
    half: float | None
    count: int


@dataclass(frozen=True)
class PowerLaw:
    """``y = factor * x ** exponent``.

    Attributes:
        factor: y at x = 1.
        exponent: the slope in log-log.
        half: half the width of the exponent's 95% interval.
        count: of the points.
    """

    factor: float
    exponent: float
    half: float
    count: int


def mean(values: Sequence[float]) -> Mean | None:
    """The mean of ``values`` with its Student t interval, which assumes independent draws; None if empty."""
    sample = np.asarray(values, dtype=np.float64)
    if len(sample) == 0:
        return None
    if len(sample) == 1:
        return Mean(float(sample[0]), None, 1)
    error = sample.std(ddof=1) / np.sqrt(len(sample))
    half = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(sample) - 1) * error)
    return Mean(float(sample.mean()), half, len(sample))


def power_law(x: Sequence[float], y: Sequence[float]) -> PowerLaw | None:
    """Least squares in log-log, the exponent's interval by Student t with n - 2 degrees of freedom.

    Args:
        x: positive.
        y: positive, as many.

    Returns:
        None where fewer than three points or a single x leave nothing to fit.
    """
    across, up = np.log(np.asarray(x, dtype=np.float64)), np.log(np.asarray(y, dtype=np.float64))
    count = len(across)
    if count < 3 or np.ptp(across) == 0:
        return None
    spread = ((across - across.mean()) ** 2).sum()
    exponent = float(((across - across.mean()) * (up - up.mean())).sum() / spread)
    start = float(up.mean() - exponent * across.mean())
    rest = up - start - exponent * across
    error = np.sqrt((rest**2).sum() / (count - 2) / spread)
    half = float(stats.t.ppf((1 + CONFIDENCE) / 2, count - 2) * error)
    return PowerLaw(float(np.exp(start)), exponent, half, count)
