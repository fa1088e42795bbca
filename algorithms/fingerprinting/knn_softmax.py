"""K nearest neighbours in signal space, weighted by a softmax of the squared signal distance."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    Index,
    fill_not_heard,
    nearest_members,
    signal_distance_db,
    too_few,
    training_members,
)
from positioning.model import Array, Site, Survey


def softmax_weights(distance_db: ArrayLike, scale_db: float = 1.0) -> Array:
    """Return weights exp(-distance^2 / scale^2) that sum to one over the last axis.

    See Atia et al., eq. 6. All exponents are taken relative to the nearest: as printed, fingerprints more
    than some 27 dB away all have the weight zero, and the mean is 0/0.

    Parameters
    ----------
    distance_db
        Signal distances, [..., k], dB.
    scale_db
        Signal distance at which a weight falls to 1/e, dB.

    Returns
    -------
    Array
        [..., k].
    """
    square_db2 = np.square(np.asarray(distance_db, dtype=np.float64))
    weight = np.exp((square_db2.min(axis=-1, keepdims=True) - square_db2) / scale_db**2)
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))


class KnnSoftmax(FingerprintRegressor):
    """The mean position of the k nearest fingerprints, weighted by a Gaussian of the signal distance.

    See Atia et al., eq. 6, where squares of distances stand in the exponent without a scale: it is 1 dB.
    Fingerprints differ by far more, so that the nearest one takes nearly all the weight.

    Parameters
    ----------
    k
        Number of neighbours; not printed in the paper. With a scale of 1 dB it hardly matters.
    scale_db
        Signal distance at which a weight falls to 1/e, dB; 1 as printed. A larger one shares the weight
        among the neighbours.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(self, *, k: int = 4, scale_db: float = 1.0, not_heard_dbm: float = -100.0) -> None:
        self.k = k
        self.scale_db = scale_db
        self.not_heard_dbm = not_heard_dbm

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Tell why these data are too few, None where they are not.

        See Atia et al., section 3.
        """
        return too_few(survey, self.k, f"k = {self.k}")

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Keep the survey.

        See Atia et al., section 3.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used or the scale is not a number from 1e-6; `predict` raises it for a k
            above n.
        """
        if not 1e-6 <= self.scale_db < np.inf:
            raise InputError(
                f"scale_db={self.scale_db}",
                "it must be a finite number from 1e-6",
                "Choose 1 as in the paper, or a larger number of decibels",
            )
        rss, self.position_m_ = self._training(rss_dbm, position_m)
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Atia et al., eq. 6.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        distance_db = signal_distance_db(rss, self.rss_dbm_)
        return self._average(distance_db, nearest_members(distance_db, self.k))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Parameters as in `fit`, whose survey stays as it is.
        """
        fitted = clone(self).fit(rss_dbm, position_m)
        distance_db = signal_distance_db(fitted.rss_dbm_, fitted.rss_dbm_)
        nearest = nearest_members(distance_db, self.k, training_members(fitted.position_m_))
        return fitted._average(distance_db, nearest)

    def _average(self, distance_db: Array, nearest: Index) -> Array:
        weight = softmax_weights(np.take_along_axis(distance_db, nearest, axis=1), self.scale_db)
        return np.asarray(np.sum(weight[..., None] * self.position_m_[nearest], axis=1))
