"""A fingerprinting algorithm to copy: an average of all positions, weighted by likeness.

Copy this file to ``algorithms/fingerprinting/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and add ``<name>: {}`` to the algorithms of a study in
``config/config.yaml``.
"""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    fill_not_heard,
    signal_distance_db,
    training_members,
)
from positioning.model import Array, Site, Survey


# A scikit-learn regressor with checks of its input; any other scikit-learn regressor will do as well.
class Template(FingerprintRegressor):
    """The mean of the surveyed positions, weighted by a Gaussian of the signal distance.

    See Nadaraya (1964) and Watson (1964); say here where your algorithm is described.

    Parameters
    ----------
    width_db
        Width of the Gaussian, dB.
    not_heard_dbm
        What stands for an access point that was not heard, dBm.
    """

    # The constructor takes keywords only and stores them as they are: scikit-learn copies an
    # algorithm by them. A parameter named `site` would be given the plan of the place, one named
    # `random_state` a seed.
    def __init__(self, *, width_db: float = 8.0, not_heard_dbm: float = -100.0) -> None:
        self.width_db = width_db
        self.not_heard_dbm = not_heard_dbm

    # What is learned gets a name that ends in an underscore.
    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Learn from fingerprints [n, ap], dBm (NaN = not heard), taken at positions [n, 2], metres.

        See Nadaraya (1964) and Watson (1964).
        """
        rss, self.position_m_ = self._training(rss_dbm, position_m)
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Nadaraya (1964) and Watson (1964).
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        return self._average(signal_distance_db(rss, self.rss_dbm_))

    # Optional. Without it, the algorithm is fitted anew for every point that is left out. Where one
    # computation can serve all points, write it here; the tests hold it equal to the refits.
    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6.
        """
        # A copy learns: what this one has learned stays as it is.
        fitted = clone(self).fit(rss_dbm, position_m)
        distance_db = signal_distance_db(fitted.rss_dbm_, fitted.rss_dbm_)
        # Infinitely far: the weight is an exact zero. Subtracting a point from a sum over all would
        # leave its rounding behind.
        return fitted._average(np.where(training_members(fitted.position_m_), distance_db, np.inf))

    def _average(self, distance_db: Array) -> Array:
        exponent = -0.5 * (distance_db / self.width_db) ** 2
        # Relative to the nearest one, so that a fingerprint unlike all others does not divide zero by zero.
        weight = np.exp(exponent - exponent.max(axis=1, keepdims=True))
        return np.asarray(weight @ self.position_m_ / weight.sum(axis=1, keepdims=True))

    # Optional: a reason why the algorithm cannot run on these data; the table shows it.
    @staticmethod
    def skip(survey: Survey, site: Site | None) -> str | None:
        """Say why the algorithm cannot run on these data, None where it can.

        See Mirzababaei & Akbari, section 6.
        """
        samples = len(survey.rss_dbm)
        return f"distances between {samples} fingerprints take too much memory" if samples > 8000 else None
