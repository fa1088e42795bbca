"""K nearest neighbours in signal space."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    fill_not_heard,
    nearest_members,
    signal_distance_db,
    too_few,
    training_members,
)
from positioning.model import Array, Site, Survey


class Knn(FingerprintRegressor):
    """The mean position of the k fingerprints that are nearest in signal space.

    See Mirzababaei & Akbari, section 6.A; with k = 1 it is the nearest neighbour of eq. 69.

    Parameters
    ----------
    k
        Number of neighbours; the paper found 4 the best on its data.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(self, *, k: int = 4, not_heard_dbm: float = -100.0) -> None:
        self.k = k
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
            If the survey cannot be used; `predict` raises it for a k above n.
        """
        rss, self.position_m_ = self._training(rss_dbm, position_m)
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, eq. 69.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        nearest = nearest_members(signal_distance_db(rss, self.rss_dbm_), self.k)
        return np.asarray(self.position_m_[nearest].mean(axis=1))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Parameters as in `fit`, whose survey stays as it is.
        """
        fitted = clone(self).fit(rss_dbm, position_m)
        distance_db = signal_distance_db(fitted.rss_dbm_, fitted.rss_dbm_)
        nearest = nearest_members(distance_db, self.k, training_members(fitted.position_m_))
        return np.asarray(fitted.position_m_[nearest].mean(axis=1))
