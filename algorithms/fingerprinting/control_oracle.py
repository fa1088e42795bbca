"""Control: the best that any algorithm could do in a synthetic world."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr

from positioning.errors import InputError
from positioning.estimator import clone
from positioning.fingerprints import FingerprintRegressor
from positioning.model import Array, Site, Survey, Truth

# Without any fading the probabilities below would be of a step.
_LEAST_NOISE_DB = 1e-3


class ControlOracle(FingerprintRegressor):
    """The posterior mean for somebody who knows the radio field, the noise and the possible places.

    See Mirzababaei & Akbari, Table 1, to which this row is added: the smallest mean squared error
    that is possible when a fingerprint is taken at one of the true survey positions, all equally
    likely. Readings are Gaussian about the true field, rounded to 1 dB, and lost below the floor.

    Parameters
    ----------
    truth
        The world's true positions, field, noise and detection floor.
    """

    def __init__(self, *, truth: Truth | None = None) -> None:
        self.truth = truth

    @staticmethod
    def skip(survey: Survey, site: Site | None, truth: Truth | None = None) -> str | None:
        """Tell why there is no such estimate for these data; None where there is one."""
        known = truth is not None and truth.field_dbm is not None
        return None if known else "the true radio field is known of synthetic worlds only"

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Check that the truth is known; the survey teaches the oracle nothing.

        See Mirzababaei & Akbari, Table 1.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Not used but for its shape.

        Raises
        ------
        InputError
            If the truth is not given, or holds no field (real recordings).
        """
        rss, _ = self._training(rss_dbm, position_m)
        truth = self.truth
        if truth is None or truth.field_dbm is None or truth.noise_db is None or truth.floor_dbm is None:
            raise InputError(
                "control_oracle",
                "the true field, noise and floor of this world are not known",
                "Use it with synthetic worlds only",
            )
        self.position_m_ = np.asarray(truth.position_m, dtype=np.float64)
        self.field_dbm_ = np.asarray(truth.field_dbm, dtype=np.float64)
        self.noise_db_ = max(float(truth.noise_db), _LEAST_NOISE_DB)
        self.floor_dbm_ = float(truth.floor_dbm)
        if self.field_dbm_.shape != (len(self.position_m_), rss.shape[1]):
            raise InputError(
                "truth.field_dbm",
                f"its shape is {self.field_dbm_.shape}, not {(len(self.position_m_), rss.shape[1])}",
                "Give the oracle the access points of the true world, in their order",
            )
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the posterior mean, [m, 2], metres, for fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, Table 1.
        """
        rss = self._readings(rss_dbm)
        likelihood = np.zeros((len(rss), len(self.position_m_)))
        for access_point in range(rss.shape[1]):
            reading, field = rss[:, access_point, None], self.field_dbm_[None, :, access_point]
            heard = ~np.isnan(reading)
            # Not heard is all that rounds to less than the floor: from minus infinity to half a dB under
            # the first whole number that is heard.
            upper = (np.where(heard, reading + 0.5, np.ceil(self.floor_dbm_) - 0.5) - field) / self.noise_db_
            lower = (np.where(heard, reading - 0.5, 0.0) - field) / self.noise_db_
            cell = log_probability_between(lower, upper)
            likelihood += np.where(heard, cell, log_ndtr(upper))
        posterior = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))
        return np.asarray(posterior @ self.position_m_ / posterior.sum(axis=1, keepdims=True))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint, [n, 2], metres.

        See Mirzababaei & Akbari, Table 1. Nothing is left out: the tested place is one of those
        that the oracle knows of. Parameters as in `fit`, whose places stay as they are.
        """
        return clone(self).fit(rss_dbm, position_m).predict(rss_dbm)


def log_probability_between(lower: Array, upper: Array) -> Array:
    """Return the logarithm of the probability of cells of a standard normal variable.

    See Mirzababaei & Akbari, Table 1, for the row that needs it. Accurate in both tails, and finite
    where both ends are the same to the last digit.

    Parameters
    ----------
    lower, upper
        Ends of the cells, [...], in standard deviations.
    """
    # In the upper tail both values are near one: mirror the cell into the lower tail.
    mirrored = lower + upper > 0
    low, high = np.where(mirrored, -upper, lower), np.where(mirrored, -lower, upper)
    log_high = log_ndtr(high)
    ratio = np.minimum(log_ndtr(low) - log_high, -np.finfo(np.float64).tiny)
    return np.asarray(log_high + np.log(-np.expm1(ratio)))
