"""One distance from the log-distance law of path loss."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.model import Array
from positioning.ranging import calibration_pairs

# A decade of distance must cost more than rounding leaves of a constant strength, dB.
_LEAST_FALL_DB = 1e-6


class PathLoss:
    """The distance at which log-distance path loss, fitted by least squares, has the received strength.

    See Rappaport (2002), section 4.9.1, for the law; Raghavan et al., section II.B, name such mappings as
    the alternative to their curve. It is one-to-one, so that there is one candidate.

    Parameters
    ----------
    nearest_m
        Stronger readings than the law's at this distance give this distance, metres.
    farthest_m
        Weaker readings than the law's at this distance give this distance, metres; None for no limit.
    """

    def __init__(self, *, nearest_m: float = 0.1, farthest_m: float | None = 30.0) -> None:
        self.nearest_m = nearest_m
        self.farthest_m = farthest_m

    def fit(self, distance_m: ArrayLike, rss_dbm: ArrayLike) -> Self:
        """Fit level and exponent: rss = reference - 10 exponent log10(distance / 1 m).

        See Rappaport (2002), section 4.9.1.

        Parameters
        ----------
        distance_m
            Distances of the calibration run, [n], metres; NaN fills up.
        rss_dbm
            Received signal strength there, [n], dBm; NaN = not heard.

        Raises
        ------
        InputError
            For senseless limits, a calibration that cannot be used, fewer than two different distances, or
            strengths that do not fall with distance.
        """
        farthest_m = np.inf if self.farthest_m is None else self.farthest_m
        if not 0 < self.nearest_m < farthest_m:
            raise InputError(
                "path_loss, nearest_m and farthest_m",
                f"{self.nearest_m} and {self.farthest_m} are not positive and ascending",
                "Give the nearer limit first",
            )
        distance, rss = calibration_pairs(distance_m, rss_dbm)
        decades = np.log10(distance)
        offset = decades - decades.mean()
        slope_db = float(offset @ (rss - rss.mean()) / (offset @ offset))
        if not slope_db < -_LEAST_FALL_DB:
            raise InputError(
                "calibration",
                f"the strength changes by {slope_db:.3g} dB a decade of distance, it does not fall",
                "Calibrate over more distances, or use the ranging curve_crossings",
            )
        self.path_loss_exponent_ = -slope_db / 10.0
        self.reference_dbm_ = float(rss.mean() - slope_db * decades.mean())
        return self

    def distances(self, rss_dbm: ArrayLike) -> Array:
        """Return the one candidate distance of each strength.

        See Rappaport (2002), section 4.9.1.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [..., b], dBm; NaN = not heard.

        Returns
        -------
        Array
            Distances, [..., b, 1], metres, from ``nearest_m`` to ``farthest_m``; NaN where not heard.

        Raises
        ------
        InputError
            For an infinite strength.
        """
        rss = np.asarray(rss_dbm, dtype=np.float64)
        if np.isinf(rss).any():
            raise InputError("rss_dbm", "a level is infinite", "Use NaN for a beacon that was not heard")
        decades = (self.reference_dbm_ - rss) / (10.0 * self.path_loss_exponent_)
        # The limits act on the exponent: a very weak reading must not overflow before it meets its limit.
        limits = np.log10([self.nearest_m, np.inf if self.farthest_m is None else self.farthest_m])
        distance: Array = 10.0 ** np.clip(decades, *limits)
        return distance[..., None]
