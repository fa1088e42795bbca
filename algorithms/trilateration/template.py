"""A trilateration algorithm to copy: the mean of the beacons, near ones weighted more.

Copy this file to ``algorithms/trilateration/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and add ``<name>: {}`` to the algorithms of a study in
``config/config.yaml``.
"""

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.model import Array
from positioning.trilateration import check_beacons, check_ranges, enough_ranges


class Template:
    """The centroid of the beacons, weighted by a power of the inverse distance.

    See Blumenthal et al. (2007), "Weighted Centroid Localization in Zigbee-based Sensor Networks"; say here
    where your algorithm is described.

    Parameters
    ----------
    exponent
        Power of the inverse distance; the larger, the closer the position to the nearest beacon.
    """

    # The constructor takes keywords only and stores them as they are; values are checked at use.
    def __init__(self, *, exponent: float = 1.0) -> None:
        self.exponent = exponent

    # Both arguments may have leading axes: all triplets of all epochs come in one call, so write
    # sums over the last axis and no loop over triplets.
    def solve(self, beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
        """Return the positions, [..., 2], metres.

        See Blumenthal et al. (2007).

        Parameters
        ----------
        beacon_m
            Places of the beacons, [..., b, 2], metres.
        range_m
            Measured distances, [..., b], metres; NaN = not ranged. Leading axes of both broadcast.

        Raises
        ------
        InputError
            For beacons or distances that cannot be used, or a negative exponent.
        """
        if not (np.isfinite(self.exponent) and self.exponent >= 0):
            raise InputError(
                f"exponent={self.exponent}", "it must be finite and not negative", "Choose a number such as 1"
            )
        # These two refuse what nobody can solve, with errors that name the cure.
        beacon = check_beacons(beacon_m)
        ranges = check_ranges(range_m, beacon)
        # Relative to the nearest beacon, so that no power of a distance overflows. A beacon that was
        # not ranged has no weight.
        nearest = np.min(ranges, axis=-1, keepdims=True, initial=np.inf, where=~np.isnan(ranges))
        weight = np.where(np.isnan(ranges), 0.0, (nearest / ranges) ** self.exponent)
        enough = enough_ranges(ranges)
        total = np.where(enough, np.sum(weight, axis=-1), 1.0)
        position = np.sum(weight[..., None] * beacon, axis=-2) / total[..., None]
        # Fewer than three distances do not decide between mirror images: the answer is NaN. An algorithm
        # that iterates also sets ``iterations_`` [...]: -1 where it did not converge, 0 where nothing was
        # solved.
        return np.where(enough[..., None], position, np.nan)
