"""Control: an algorithm that does not look at the fingerprint."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.fingerprints import FingerprintRegressor
from positioning.model import Array, Site


class ControlCentre(FingerprintRegressor):
    """The centre of the site, whatever was heard: a row that is worse is no help.

    See Mirzababaei & Akbari, Table 1, to which this row is added.

    Parameters
    ----------
    site
        Its corners give the centre; without a site it is the centre of the rectangle around the
        training positions.
    """

    def __init__(self, *, site: Site | None = None) -> None:
        self.site = site

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Find the centre.

        See Mirzababaei & Akbari, Table 1.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used.
        """
        _, position = self._training(rss_dbm, position_m)
        corner = [position.min(axis=0), position.max(axis=0)] if self.site is None else self.site.corner_m
        self.centre_m_ = np.mean(corner, axis=0)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the centre, [m, 2], metres, for fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, Table 1.
        """
        return np.tile(self.centre_m_, (len(self._readings(rss_dbm)), 1))
