"""Any fingerprinting algorithm on a survey of fewer places, or fewer scans at each."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation, points_of
from positioning.errors import InputError, check_whole
from positioning.estimator import clone
from positioning.fingerprints import FingerprintRegressor
from positioning.model import Array, Site, Survey


class Thinned(FingerprintRegressor):
    """A survey with less effort, and a regressor on what is left.

    See Frank et al., section 1, where a measurement about every five metres that lasts a few seconds is said
    to do, and section 5.1, where there is one every 2.5 m with 60 scans.

    Parameters
    ----------
    every
        Of the places in the order of the survey, the first of each so many stay.
    scans
        Of the fingerprints at a place, the first so many stay; None keeps all.
    regressor
        The fingerprinting algorithm; None: the expected deviation of eq. 1.
    """

    def __init__(self, *, every: int = 2, scans: int | None = None, regressor: Any = None) -> None:
        self.every = every
        self.scans = scans
        self.regressor = regressor

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Tell why the regressor cannot learn from what is left, None where it can.

        See Frank et al., section 5.1.
        """
        skip = getattr(self._regressor(), "skip", None)
        if skip is None:
            return None
        kept = self._kept(np.asarray(survey.position_m))
        left = Survey(
            rss_dbm=np.asarray(survey.rss_dbm)[kept], position_m=np.asarray(survey.position_m)[kept]
        )
        return skip(left, site) or None

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Learn from the part of the survey that is left.

        See Frank et al., section 5.1.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used, or a setting is no whole number above zero.
        """
        rss, position = self._training(rss_dbm, position_m)
        kept = self._kept(position)
        self.regressor_ = clone(self._regressor()).fit(rss[kept], position[kept])
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Frank et al., section 5.1.
        """
        return np.asarray(self.regressor_.predict(self._readings(rss_dbm)), dtype=np.float64)

    def _kept(self, position_m: Array) -> NDArray[np.bool_]:
        """Return which fingerprints stay, [n]."""
        for name, value in (("every", self.every), ("scans", 1 if self.scans is None else self.scans)):
            check_whole(name, value)
            if value < 1:
                raise InputError(f"{name}={value}", "it is not above zero", "Give a whole number from 1 on")
        place, _ = points_of(position_m)
        # The number of each fingerprint among those of its place.
        order = np.argsort(place, kind="stable")
        count = np.bincount(place)
        number = np.empty(len(place), dtype=np.intp)
        number[order] = np.arange(len(place)) - np.repeat(np.cumsum(count) - count, count)
        few = np.ones(len(place), dtype=bool) if self.scans is None else number < self.scans
        return np.asarray((place % self.every == 0) & few)

    def _regressor(self) -> Any:
        return ExpectedDeviation() if self.regressor is None else self.regressor
