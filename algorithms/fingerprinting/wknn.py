"""Weighted k nearest neighbours in signal space."""

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


class Wknn(FingerprintRegressor):
    """The mean position of the k nearest fingerprints, weighted by the inverse of their signal distance.

    See Mirzababaei & Akbari, eq. 65.

    Parameters
    ----------
    k
        Number of neighbours; not printed in the paper. 6 is one for each access point, and errors
        vary little between 6 and 10.
    distance_offset_db
        d0 of eq. 65, dB, which avoids a division by zero.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self, *, k: int = 6, distance_offset_db: float = 0.01, not_heard_dbm: float = -100.0
    ) -> None:
        self.k = k
        self.distance_offset_db = distance_offset_db
        self.not_heard_dbm = not_heard_dbm

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Tell why these data are too few, None where they are not.

        See Mirzababaei & Akbari, section 6.
        """
        return too_few(survey, self.k, f"k = {self.k}")

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Keep the survey.

        See Mirzababaei & Akbari, section 6.A.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used or the offset is not positive; `predict` raises it for a k above n.
        """
        if not self.distance_offset_db > 0:
            raise InputError(
                f"distance_offset_db={self.distance_offset_db}",
                "it must be positive, or equal fingerprints would be divided by zero",
                "Choose a small number such as 0.01",
            )
        rss, self.position_m_ = self._training(rss_dbm, position_m)
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, eq. 65.
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
        weight = 1.0 / (np.take_along_axis(distance_db, nearest, axis=1) + self.distance_offset_db)
        weight /= weight.sum(axis=1, keepdims=True)
        return np.asarray(np.sum(weight[..., None] * self.position_m_[nearest], axis=1))
