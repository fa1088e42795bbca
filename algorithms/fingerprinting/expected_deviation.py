"""The calibration point whose recorded strengths deviate least from a scan on average."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.estimator import clone
from positioning.fingerprints import FingerprintRegressor, fill_not_heard
from positioning.model import Array

# Values of the deviations that are worked on at a time, so that they stay in the cache.
_BLOCK = 1 << 17


class ExpectedDeviation(FingerprintRegressor):
    """The calibration point with the least expected absolute deviation from the scan.

    See Frank et al., eq. 1. Scans of the survey that were taken at one place are one calibration point. j is
    read as the bins of the histogram of an access point there, of which figure 5 shows examples: with the
    relative frequencies p_ij, the sum over j is the mean over the recorded scans of how far each is from
    the one observed. Of equally good places the first of the survey is taken.

    Parameters
    ----------
    not_heard_dbm
        What stands for an access point that was not heard, in scans and survey alike, dBm; not printed in
        the paper. Leaving such access points out would favour places where little is heard.
    literal
        Read j as the recorded scans and multiply each by the frequency of its value all the same, so that
        the frequency counts twice. For comparison.
    """

    def __init__(self, *, not_heard_dbm: float = -100.0, literal: bool = False) -> None:
        self.not_heard_dbm = not_heard_dbm
        self.literal = literal

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Keep the histograms of all calibration points.

        See Frank et al., section 2.

        Parameters
        ----------
        rss_dbm
            Received signal strength of single scans, [n, ap], dBm; NaN = not heard.
        position_m
            Where each scan was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used, or for a filling that is not a finite number.
        """
        if not np.isfinite(self.not_heard_dbm):
            raise InputError(
                f"not_heard_dbm={self.not_heard_dbm}",
                "it must be a finite number",
                "Choose a value below all readings, such as -100",
            )
        rss, position = self._training(rss_dbm, position_m)
        filled_dbm = fill_not_heard(rss, self.not_heard_dbm)
        self.point_, first = points_of(position)
        self.position_m_ = position[first]
        count = np.bincount(self.point_)
        order = np.argsort(self.point_, kind="stable")
        # The number of each scan among those of its point.
        place = np.arange(len(rss)) - np.repeat(np.cumsum(count) - count, count)
        member = self.point_[order]
        access_points = filled_dbm.shape[1]
        self.reading_dbm_ = np.zeros((access_points, len(count), count.max(initial=1)))
        self.weight_ = np.zeros_like(self.reading_dbm_)
        for number in range(access_points):
            reading_dbm = filled_dbm[order, number]
            self.reading_dbm_[number, member, place] = reading_dbm
            weight = _frequency(member, reading_dbm) if self.literal else 1.0 / count[member]
            self.weight_[number, member, place] = weight
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the places, [m, 2], metres, of scans [m, ap], dBm.

        See Frank et al., eq. 1.
        """
        nearest = np.argmin(self.deviation_db(rss_dbm), axis=1)
        return np.asarray(self.position_m_[nearest])

    def deviation_db(self, rss_dbm: ArrayLike) -> Array:
        """Return how far scans [m, ap], dBm, are from every calibration point, D_p, [m, p], dB.

        See Frank et al., eq. 1. Points are in the order in which the survey first names them.
        """
        scan_dbm = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        total_db = np.zeros((len(scan_dbm), len(self.position_m_)))
        for number in range(scan_dbm.shape[1]):
            # Readings are mostly whole numbers, so that few different ones are looked up by all scans.
            value_dbm, which = np.unique(scan_dbm[:, number], return_inverse=True)
            total_db += self._mean_deviation_db(number, value_dbm)[which.reshape(-1)]
        return total_db

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the place of each scan with its calibration point left out, [n, 2], metres.

        Parameters and errors as in `fit`, whose points stay as they are; with one place only there is no
        other to answer.
        """
        fitted = clone(self).fit(rss_dbm, position_m)
        if len(fitted.position_m_) < 2:
            raise InputError(
                "training survey", "it has a single place, which cannot be left out", "Survey more places"
            )
        deviation_db = fitted.deviation_db(rss_dbm)
        deviation_db[np.arange(len(deviation_db)), fitted.point_] = np.inf
        return np.asarray(fitted.position_m_[np.argmin(deviation_db, axis=1)])

    def _mean_deviation_db(self, number: int, value_dbm: Array) -> Array:
        """Return the part of one access point for different readings [v], [v, p], dB."""
        reading_dbm, weight = self.reading_dbm_[number], self.weight_[number]
        part_db = np.empty((len(value_dbm), len(reading_dbm)))
        step = max(1, _BLOCK // reading_dbm.size)
        for begin in range(0, len(value_dbm), step):
            block = slice(begin, begin + step)
            apart_db = np.abs(value_dbm[block, None, None] - reading_dbm)
            apart_db *= weight
            # Along memory, whatever the number of readings: a scan has one answer, alone or among others.
            part_db[block] = apart_db.sum(axis=-1)
        return part_db


def points_of(position_m: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the point of each scan [n], and the first scan of each point; points as the survey names them.

    See Frank et al., section 2: scans that were taken at one place are one calibration point.

    Parameters
    ----------
    position_m
        Where each scan was taken, [n, 2].
    """
    # As `numpy.unique` of rows, which compares them slowly; a stable order, so the first scan comes first.
    order = np.lexsort(position_m.T[::-1])
    changes = np.any(position_m[order[1:]] != position_m[order[:-1]], axis=1)
    group = np.concatenate([[0], np.cumsum(changes)])
    first = order[np.concatenate([[True], changes])]
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    point = np.empty(len(order), dtype=np.intp)
    point[order] = rank[group]
    return point, np.sort(first)


def _frequency(point: NDArray[np.intp], reading_dbm: Array) -> Array:
    """Return how often the value of each scan [n] occurs among those of its point, as a share, [n]."""
    _, level = np.unique(reading_dbm, return_inverse=True)
    key = point * (int(level.max(initial=0)) + 1) + level.reshape(-1)
    _, same, count = np.unique(key, return_inverse=True, return_counts=True)
    return np.asarray(count[same.reshape(-1)] / np.bincount(point)[point])
