"""Trilateration by SciPy's least squares, the reference for the iterations."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from positioning.errors import InputError
from positioning.model import Array
from positioning.trilateration import (
    check_beacons,
    check_ranges,
    enough_ranges,
    objective_weight,
    starting_point,
    weighted_error,
    weighted_error_jacobian,
)


class LeastSquares:
    """The nearest least sum of weighted squared errors, by the method of Levenberg and Marquardt.

    See Raghavan et al., section III.B, for the sums: with d measured distances and r those from the
    estimate, (r - d)^2 for ``absolute``, (r - d)^2 / d for ``printed``, ((r - d) / d)^2 for ``fractional``.
    The search starts like the iterations from the pseudo-inverse solution. Positions are solved one by one.

    Parameters
    ----------
    weighting
        ``absolute``, ``printed`` or ``fractional``.
    tolerance
        Relative change of sum and position, and cosine of the angle between errors and gradient, below which
        the search stops.
    most_evaluations
        Limit of the evaluations of the sum for one position.
    """

    def __init__(
        self, *, weighting: str = "absolute", tolerance: float = 1e-12, most_evaluations: int = 1000
    ) -> None:
        self.weighting = weighting
        self.tolerance = tolerance
        self.most_evaluations = most_evaluations

    def solve(self, beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
        """Return the positions, and keep the numbers of evaluations as ``iterations_``.

        See Raghavan et al., section III.B.

        Parameters
        ----------
        beacon_m
            Places of the beacons, [..., b, 2], metres.
        range_m
            Measured distances, [..., b], metres; NaN = not ranged. Leading axes of both broadcast.

        Returns
        -------
        Array
            [..., 2], metres; NaN where fewer than three beacons were ranged. ``iterations_`` [...] is -1
            where the search did not converge (the position is the last one), 0 where nothing was solved.

        Raises
        ------
        InputError
            For beacons or distances that cannot be used, and for senseless settings.
        """
        if not 0 < self.tolerance < 1:
            raise InputError(
                f"tolerance={self.tolerance}", "it must lie between 0 and 1", "Choose a number such as 1e-12"
            )
        if self.most_evaluations < 1:
            raise InputError(
                f"most_evaluations={self.most_evaluations}", "it must be at least 1", "Choose 1000 or so"
            )
        beacon = check_beacons(beacon_m)
        ranges = check_ranges(range_m, beacon)
        weight = objective_weight(ranges, self.weighting)
        solvable = enough_ranges(ranges)
        start = starting_point(beacon, ranges)
        beacon = np.broadcast_to(beacon, (*ranges.shape, 2))
        position_m = np.full(start.shape, np.nan)
        self.iterations_ = np.zeros(solvable.shape, dtype=np.int64)
        for index in zip(*np.nonzero(np.atleast_1d(solvable)), strict=True):
            # A single position has no leading axes to be indexed.
            place = index if solvable.ndim else ()
            ranged = ~np.isnan(ranges[place])
            # A beacon that was not ranged is left out, so that the search has the size of its problem.
            given = (beacon[place][ranged], ranges[place][ranged], weight[place][ranged])
            found = optimize.least_squares(
                weighted_error,
                start[place],
                jac=_jacobian,
                method="lm",
                args=given,
                xtol=self.tolerance,
                ftol=self.tolerance,
                gtol=self.tolerance,
                max_nfev=self.most_evaluations,
            )
            position_m[place] = found.x
            self.iterations_[place] = found.nfev if found.success else -1
        return position_m


def _jacobian(position_m: Array, beacon_m: Array, _range_m: Array, weight: Array) -> Array:
    return weighted_error_jacobian(position_m, beacon_m, weight)
