"""Who is ahead: ranks inside data sets, mean ranks over them, and the share of worlds that each wins.

A data set is a family of worlds or a recording of one study. See Demsar (2006), "Statistical comparisons of
classifiers over multiple data sets", for mean ranks.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.statistics import CONFIDENCE

LEAST_ALGORITHMS, LEAST_DATA_SETS = 3, 5
"""Smaller comparisons have no critical difference worth drawing."""

LEAST_COVERAGE, LEAST_SAMPLES = 0.98, 2
"""Rows that answer a smaller share of a data set's samples, and data sets of fewer, are in no mean rank."""

TIE = 1e-4
"""Mean errors that are closer than this share of the larger one are equal, here and in all counts."""

DataSet = tuple[str, str]
"""Study, and family of worlds or recording."""


@dataclass(frozen=True)
class Ranks:
    """Mean ranks over data sets in which the same algorithms ran, with Nemenyi's critical difference.

    Attributes
    ----------
    rank
        One line a data set, one column an algorithm, the best mean rank first; 1 is the smallest error.
        Made of paired differences, as `difference_ranks` says.
    critical_difference
        Mean ranks that are farther apart differ at the 5 % level.
    friedman_p
        Probability of ranks so unlike if all algorithms were alike (Friedman's test).
    """

    rank: pd.DataFrame
    critical_difference: float
    friedman_p: float

    @property
    def mean(self) -> "pd.Series[float]":
        """The mean rank of each algorithm, ascending."""
        mean: pd.Series[float] = self.rank.mean()
        return mean

    def best(self) -> list[str]:
        """Return the algorithm of the lowest mean rank, or all that share it."""
        mean = self.mean
        return [str(name) for name in mean.index if np.isclose(mean[name], mean.iloc[0])]

    def unlike_best(self) -> list[str]:
        """Return the algorithms whose mean rank differs from the best one."""
        mean = self.mean
        return [str(name) for name in mean.index if mean[name] - mean.iloc[0] > self.critical_difference]


def difference_ranks(difference_m: NDArray[np.float64], mean_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rank of each algorithm on a data set from paired differences; 1 is the smallest error.

    A rank is one more than the number of algorithms with a smaller error at the samples that both have;
    equal ones count half, and so do those that have no sample in common. Where all answer at the same
    samples, these are the ranks of the mean errors. Ranks of a data set sum up alike in any case.

    Parameters
    ----------
    difference_m
        Mean error of the former minus that of the latter, [..., former, latter]; NaN where nothing is
        common. The diagonal does not count.
    mean_m
        Mean errors, [..., algorithm], which say what difference is none.
    """
    same = np.eye(difference_m.shape[-1], dtype=bool)
    tie_m = TIE * np.maximum(mean_m[..., :, None], mean_m[..., None, :])
    larger = (difference_m > tie_m) & ~same
    equal = ~(np.abs(difference_m) > tie_m) & ~same
    rank: NDArray[np.float64] = 1 + larger.sum(axis=-1) + equal.sum(axis=-1) / 2
    return rank


def worlds_won(mean_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of worlds in which each algorithm has the smallest value; equal ones share a world.

    Two algorithms may find one answer on two ways, so that values within ``TIE`` are equal.

    Parameters
    ----------
    mean_m
        One value a world and algorithm, [world, algorithm]; NaN where it has no answer.
    """
    values = mean_m[~np.isnan(mean_m).all(axis=1)]
    smallest = values <= np.nanmin(values, axis=1, keepdims=True) * (1 + TIE)
    share: NDArray[np.float64] = (smallest / smallest.sum(axis=1, keepdims=True)).mean(axis=0)
    return share


class Block(NamedTuple):
    """Data sets, and algorithms that ran in all of them."""

    data_sets: list[DataSet]
    algorithms: list[str]


def complete_block(present: Mapping[DataSet, Iterable[str]]) -> Block | None:
    """Return the data sets and algorithms for a comparison of ranks, None where there are too few.

    Ranks need the same algorithms in every data set. Of all such blocks the one of most pairs is
    taken, of equal ones that of more data sets; errors play no part in the choice.

    Parameters
    ----------
    present
        Algorithms that ran, by data set.
    """
    sets = {data_set: frozenset(rows) for data_set, rows in present.items()}
    closed = set(sets.values())
    fresh = closed
    while fresh:
        fresh = {a & b for a in fresh for b in sets.values()} - closed
        closed |= fresh
    best, size = None, (0, 0)
    for rows in sorted(closed, key=sorted):
        inside = [data_set for data_set, own in sets.items() if rows <= own]
        if len(rows) >= LEAST_ALGORITHMS and len(inside) >= LEAST_DATA_SETS:
            own_size = (len(rows) * len(inside), len(inside))
            if own_size > size:
                best, size = Block(inside, sorted(rows)), own_size
    return best


def mean_ranks(rank: pd.DataFrame) -> Ranks:
    """Return mean ranks with Nemenyi's critical difference, as Demsar (2006) compares classifiers.

    Parameters
    ----------
    rank
        Ranks inside each data set: one line a data set, one column an algorithm, complete.
    """
    # These two take longer to import than all the rest of a comparison to run.
    from scipy.stats import friedmanchisquare, studentized_range

    data_sets, algorithms = rank.shape
    values = rank.to_numpy(dtype=float)
    quantile = studentized_range.ppf(CONFIDENCE, algorithms, np.inf) / np.sqrt(2)
    # Friedman's statistic divides by zero where all are equal everywhere: nothing speaks for a difference.
    tied = bool((values == values[:, :1]).all())
    return Ranks(
        rank[rank.mean().sort_values(kind="stable").index],
        float(quantile * np.sqrt(algorithms * (algorithms + 1) / (6 * data_sets))),
        1.0 if tied else float(friedmanchisquare(*values.T).pvalue),
    )
