"""Intervals over worlds. The rules stand here, once, and were written before any verdict was seen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95


def student_t(degrees: int) -> float:
    """Return how many standard errors a mean's 95 % confidence interval reaches to either side.

    Parameters
    ----------
    degrees
        Degrees of freedom, the number of values less one.
    """
    # Late: pages and scores need no quantile, and each of their jobs would wait 0.15 s for the import.
    from scipy.special import stdtrit

    return float(stdtrit(degrees, (1 + CONFIDENCE) / 2))


class Interval(NamedTuple):
    """Lower and upper end, and the share of cases that the interval covers."""

    low: float
    high: float
    coverage: float


def single_experiment_interval(values: NDArray[np.float64]) -> Interval:
    """Return the central 95 % of what one more experiment of the same kind would give.

    The ends are order statistics at the plotting positions i / (n + 1): a new world drawn like the
    n given ones falls inside with a probability of 95 %, whatever the distribution. Fewer than 39
    worlds cannot promise that; then the ends are the smallest and the largest value, and
    ``coverage`` tells what they do promise, (n - 1) / (n + 1).

    Parameters
    ----------
    values
        One value a world, [n].
    """
    n = len(values)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(values, [tail, 1 - tail], method="weibull")
    return Interval(float(low), float(high), min(CONFIDENCE, (n - 1) / (n + 1)))


def prediction_interval(values: NDArray[np.float64]) -> Interval:
    """Return where one more experiment of the same kind falls with 95 %, if such values are normal.

    It reaches beyond the values themselves, so that few worlds can tell that a number does not come out.

    Parameters
    ----------
    values
        One value a world, [n].
    """
    n = len(values)
    if n < 2:
        return Interval(float("-inf"), float("inf"), CONFIDENCE)
    half = student_t(n - 1) * np.std(values, ddof=1) * np.sqrt(1 + 1 / n)
    return Interval(float(np.mean(values) - half), float(np.mean(values) + half), CONFIDENCE)


def share_interval(successes: int, n: int) -> Interval:
    """Return the exact (Clopper-Pearson) 95 % confidence interval of a share."""
    from scipy.special import betaincinv  # late, as in `student_t`

    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(successes, n - successes + 1, tail) if successes else 0.0
    high = betaincinv(successes + 1, n - successes, 1 - tail) if successes < n else 1.0
    return Interval(float(low), float(high), CONFIDENCE)


def mean_interval(values: NDArray[np.float64]) -> Interval:
    """Return the 95 % confidence interval of the mean of independent values (Student's t)."""
    n = len(values)
    if n < 2:
        return Interval(float("nan"), float("nan"), 0.0)
    half = student_t(n - 1) * np.std(values, ddof=1) / np.sqrt(n)
    return Interval(float(np.mean(values) - half), float(np.mean(values) + half), CONFIDENCE)


class Paired(NamedTuple):
    """A paired comparison: mean difference with its interval, and how often the first was smaller."""

    difference: float
    low: float
    high: float
    share_smaller: float
    n: int


def paired_difference(first: NDArray[np.float64], second: NDArray[np.float64]) -> Paired:
    """Compare two algorithms on the same worlds, [n] each: ``first - second``; ties count half."""
    delta = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    interval = mean_interval(delta)
    share = np.mean(delta < 0) + 0.5 * np.mean(delta == 0)
    return Paired(float(np.mean(delta)), interval.low, interval.high, float(share), len(delta))


def mean_where(
    values: NDArray[np.generic], chosen: NDArray[np.bool_], axis: int | tuple[int, ...] = 1
) -> NDArray[np.float64]:
    """Return the mean over the chosen entries along an axis, NaN where none is; others may be NaN."""
    count = chosen.sum(axis=axis)
    total = np.where(chosen, values, 0).sum(axis=axis, dtype=float)
    mean: NDArray[np.float64] = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    return mean
