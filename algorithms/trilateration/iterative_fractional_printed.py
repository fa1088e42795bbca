"""Iterative trilateration on the fractional error, with matrix B as printed."""

from numpy.typing import ArrayLike

from positioning.model import Array
from positioning.trilateration import iterate_from_pseudo_inverse


class IterativeFractionalPrinted:
    """The place where sum (r - d)^2 / d is least, with d measured distances and r those from the estimate.

    See Raghavan et al., section III.B. f = (d - r) / d, the fractional error, but B is printed as the unit
    vectors, the gradient of the absolute error d - r. The estimate moves by -step (B'B)^-1 B'f, from the
    pseudo-inverse solution, and rests where B'f = 0: that is no least sum of f^2, but of f^2 d. This reading
    gives every printed digit of the iterative point of Fig. 4. The printed plus sign leads away from it.

    Parameters
    ----------
    step
        Part of the correction that is made, as printed. It has the unit metre, since f has none: from
        about twice the shortest measured distance on, the iteration does not converge.
    tolerance_m
        Length of the undamped correction below which the iteration stops, metres.
    most_iterations
        Limit of the iterations; not printed in the paper.
    """

    def __init__(self, *, step: float = 0.05, tolerance_m: float = 1e-6, most_iterations: int = 5000) -> None:
        self.step = step
        self.tolerance_m = tolerance_m
        self.most_iterations = most_iterations

    def solve(self, beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
        """Return the positions, and keep the numbers of iterations as ``iterations_``.

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
            where the iteration did not converge (the position is the last one), 0 where nothing was solved.

        Raises
        ------
        InputError
            For beacons or distances that cannot be used, and for senseless settings.
        """
        position_m, self.iterations_ = iterate_from_pseudo_inverse(
            beacon_m,
            range_m,
            weighting="printed",
            step=self.step,
            tolerance_m=self.tolerance_m,
            most_iterations=self.most_iterations,
        )
        return position_m
