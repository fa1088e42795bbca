"""Trilateration by the pseudo-inverse of a linear system."""

from numpy.typing import ArrayLike

from positioning.model import Array
from positioning.trilateration import pseudo_inverse


class PseudoInverse:
    """The least squares solution of the circle equations, made linear by s = x^2 + y^2 as a third unknown.

    See Raghavan et al., section III.A. For Fig. 4 it gives (-0.5435, 1.2408); the point that section V prints
    does not follow from the printed system and distances.
    """

    def solve(self, beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
        """Return the positions.

        See Raghavan et al., section III.A.

        Parameters
        ----------
        beacon_m
            Places of the beacons, [..., b, 2], metres.
        range_m
            Measured distances, [..., b], metres; NaN = not ranged. Leading axes of both broadcast.

        Returns
        -------
        Array
            [..., 2], metres; NaN where fewer than three beacons were ranged.

        Raises
        ------
        InputError
            For beacons or distances that cannot be used.
        """
        return pseudo_inverse(beacon_m, range_m)
