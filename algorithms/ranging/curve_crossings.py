"""All distances at which the calibration curve has the received strength."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.model import Array
from positioning.ranging import calibration_pairs, crossings


class CurveCrossings:
    """Every crossing of the curve that the calibration run drew, linearly interpolated.

    See Raghavan et al., section II.B: interpolation along with motion gives the mapping, which is not
    one-to-one, and all possible distances are kept.
    """

    def fit(self, distance_m: ArrayLike, rss_dbm: ArrayLike) -> Self:
        """Draw the curve: readings of equal distance averaged, distances sorted.

        See Raghavan et al., section II.B and Fig. 3.

        Parameters
        ----------
        distance_m
            Distances of the calibration run, [n], metres; NaN fills up.
        rss_dbm
            Received signal strength there, [n], dBm; NaN = not heard.

        Raises
        ------
        InputError
            For a calibration that cannot be used, or fewer than two different distances.
        """
        distance, rss = calibration_pairs(distance_m, rss_dbm)
        self.distance_m_, place = np.unique(distance, return_inverse=True)
        self.curve_dbm_ = np.bincount(place, weights=rss) / np.bincount(place)
        return self

    def distances(self, rss_dbm: ArrayLike) -> Array:
        """Return every candidate distance of each strength.

        See Raghavan et al., section II.B. Strengths off the curve have none: whether such a reading is
        near or far cannot be told where the curve is not monotonic.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [..., b], dBm; NaN = not heard.

        Returns
        -------
        Array
            Distances, [..., b, c], metres, ascending; NaN fills up.

        Raises
        ------
        InputError
            For an infinite strength.
        """
        return crossings(self.distance_m_, self.curve_dbm_, rss_dbm)
