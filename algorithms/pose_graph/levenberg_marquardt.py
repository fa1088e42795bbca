"""The poses of least squares, by Levenberg-Marquardt on sparse normal equations."""

import numpy as np

from positioning.errors import check_number
from positioning.posegraph.costs import Loss, NearCost
from positioning.posegraph.graph import PoseGraph, Solved
from positioning.posegraph.optimiser import Search, Start, optimise


class LevenbergMarquardt:
    """Sum of squares of all edges, loop closures and pairs of near places as good as any other.

    See Gu et al., eqs. 3 to 8 and 10, and `positioning.posegraph.optimiser.optimise`. A pair of near places
    costs the square of its distance beyond ``d_min_m``, in standard deviations, times its weight. A pose that
    is the only fixed one moves like all others while the search goes on, and is put back in place at the end.

    Parameters
    ----------
    start
        "given", or "rotations_first": begin where headings and then places agree best, each found as a linear
        problem.
    iterations
        Most steps.
    tolerance
        Relative decrease of the cost below which to stop.
    near_sigma_m
        Standard deviation of the distance of a pair of weight one beyond ``d_min_m``, metres.
    d_min_m, d_max_m
        Ends of the straight line of eq. 10, metres: pairs farther apart than the second attract no more.
    """

    def __init__(
        self,
        *,
        start: Start = "given",
        iterations: int = 2000,
        tolerance: float = 1e-6,
        near_sigma_m: float = 1.0,
        d_min_m: float = 2.0,
        d_max_m: float = 30.0,
    ) -> None:
        self.start = start
        self.iterations = iterations
        self.tolerance = tolerance
        self.near_sigma_m = near_sigma_m
        self.d_min_m = d_min_m
        self.d_max_m = d_max_m

    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return the poses that contradict the edges least.

        Parameters
        ----------
        graph
            One graph.
        rng
            Not used.

        Returns
        -------
        Solved
            With ``iterations``, whether it ``converged``, and its ``own_cost``.

        Raises
        ------
        InputError
            For a graph that cannot be used, or settings outside their range.
        """
        return self._solved(graph, None, 1.0, 1.0, "levenberg_marquardt")

    def _solved(
        self, graph: PoseGraph, loss: Loss | None, loop_scale: float, near_scale_m: float, search: Search
    ) -> Solved:
        check_number("near_sigma_m", self.near_sigma_m, above=0)
        check_number("near_scale_m", near_scale_m, above=0)
        near = NearCost.of_distance(
            self.near_sigma_m, d_min_m=self.d_min_m, d_max_m=self.d_max_m, loss=loss, scale_m=near_scale_m
        )
        found = optimise(
            graph,
            near=near,
            loop_loss=loss,
            loop_scale=loop_scale,
            start=self.start,
            search=search,
            iterations=self.iterations,
            tolerance=self.tolerance,
        )
        extra = {
            "iterations": np.array(found.iterations),
            "converged": np.array(found.converged),
            "own_cost": np.array(found.cost),
        }
        return Solved(found.pose, extra)
