"""The poses of least squares, by steps of Gauss and Newton without damping."""

import numpy as np

from algorithms.pose_graph.levenberg_marquardt import LevenbergMarquardt
from positioning.posegraph.graph import PoseGraph, Solved


class GaussNewton(LevenbergMarquardt):
    """`LevenbergMarquardt` without damping, and without asking whether a step lowers the cost.

    Where stiff and soft directions differ by a factor of thousands, the minimum lies at the end of a curved
    valley; a search that lowers the cost with every step must follow it, this one leaves it and comes back.
    Nothing keeps it from losing its way: the best poses that it met are the answer.

    Parameters
    ----------
    start, iterations, tolerance, near_sigma_m, d_min_m, d_max_m
        As of `LevenbergMarquardt`.
    """

    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return the best poses that were met.

        Parameters
        ----------
        graph
            One graph.
        rng
            Not used.

        Returns
        -------
        Solved
            As of `LevenbergMarquardt`.

        Raises
        ------
        InputError
            For a graph that cannot be used, or settings outside their range.
        """
        return self._solved(graph, None, 1.0, 1.0, "gauss_newton")
