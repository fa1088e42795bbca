"""The poses of least squares in spite of wrong loop closures: a loss that forgives large residuals."""

import numpy as np

from algorithms.pose_graph.levenberg_marquardt import LevenbergMarquardt
from positioning.posegraph.costs import Loss
from positioning.posegraph.graph import PoseGraph, Solved
from positioning.posegraph.optimiser import Start


class LevenbergMarquardtRobust(LevenbergMarquardt):
    """`LevenbergMarquardt` with a robust loss on loop closures and on pairs of near places.

    See Agarwal et al. (2013), "Robust map optimization using dynamic covariance scaling", for "dcs". The flat
    end of eq. 10 of Gu et al. is a robust loss as well, but one that pulls nothing at all from 30 m on; here
    the loss does its work, and the flat end is put beyond every building.

    This reach was chosen after the flat end at 30 m had been seen to fail on the corridor, whose dead
    reckoning is off by up to 149 m. Seven costs were tried there with errors in view, each with least scores
    of 0, 0.1 and 0.5 or some of them: the square, Cauchy's loss and "dcs" with the flat end, and these and
    Huber's loss without it. The scale of one metre was never changed.

    "dcs" needs a good start. Far from zero its cost is flat, and what it pulls with falls with the cube of
    the residual, so that loops and pairs that the dead reckoning misses by far count as wrong ones: on the
    corridor the search ends by itself after few steps, or none, nearly where it began. "cauchy" pulls with
    the inverse of the residual, which is little, and still brings them in.

    Parameters
    ----------
    loss
        "cauchy", "huber" or "dcs".
    loop_scale
        Residual of a loop closure from which the loss grows less than the square, standard deviations.
    near_scale_m
        The same for a pair of near places: its distance beyond ``d_min_m``, metres.
    start, iterations, tolerance, near_sigma_m, d_min_m, d_max_m
        As of `LevenbergMarquardt`.
    """

    def __init__(
        self,
        *,
        loss: Loss = "cauchy",
        loop_scale: float = 1.0,
        near_scale_m: float = 1.0,
        start: Start = "given",
        iterations: int = 2000,
        tolerance: float = 1e-6,
        near_sigma_m: float = 1.0,
        d_min_m: float = 2.0,
        d_max_m: float = 10_000.0,
    ) -> None:
        super().__init__(
            start=start,
            iterations=iterations,
            tolerance=tolerance,
            near_sigma_m=near_sigma_m,
            d_min_m=d_min_m,
            d_max_m=d_max_m,
        )
        self.loss = loss
        self.loop_scale = loop_scale
        self.near_scale_m = near_scale_m

    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return the poses of least robust cost.

        Parameters
        ----------
        graph
            One graph.
        rng
            Not used.

        Returns
        -------
        Solved
            As of `LevenbergMarquardt`; ``own_cost`` has the loss in it.

        Raises
        ------
        InputError
            For a graph that cannot be used, or settings outside their range.
        """
        return self._solved(graph, self.loss, self.loop_scale, self.near_scale_m, "levenberg_marquardt")
