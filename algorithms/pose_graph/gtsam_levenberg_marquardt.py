"""The poses of least squares, as the library gtsam finds them: a peer for the project's own search."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from algorithms.alignment.gtsam_graph_slam import gtsam_minimum
from positioning.errors import Reason, check_number, check_whole, refusal
from positioning.posegraph.costs import NearCost
from positioning.posegraph.graph import PoseGraph, Solved, checked


class GtsamLevenbergMarquardt:
    """The graph of `LevenbergMarquardt`, minimised by gtsam's Levenberg-Marquardt with its own stop rules.

    See Dellaert (2012), "Factor graphs and GTSAM: a hands-on introduction". gtsam takes the logarithm of what
    contradicts a motion, in the frame of the measured second pose: information is turned into that frame, and
    costs agree where residuals are small. Pairs of near places call a function in Python at every step, which
    takes minutes where there are thousands of them.

    Where gtsam is not installed (optional group ``peers``), or there are too many pairs, the row says so.

    Parameters
    ----------
    iterations
        Most steps.
    most_near
        Most pairs of near places with which it runs.
    near_sigma_m, d_min_m, d_max_m
        As of `LevenbergMarquardt`.
    """

    def __init__(
        self,
        *,
        iterations: int = 100,
        most_near: int = 5000,
        near_sigma_m: float = 1.0,
        d_min_m: float = 2.0,
        d_max_m: float = 30.0,
    ) -> None:
        self.iterations = iterations
        self.most_near = most_near
        self.near_sigma_m = near_sigma_m
        self.d_min_m = d_min_m
        self.d_max_m = d_max_m

    def skip(self, graph: PoseGraph) -> str:
        """Tell whether gtsam is missing, or the graph has too many pairs for it; "" where it can run.

        Parameters
        ----------
        graph
            One graph.
        """
        if find_spec("gtsam") is None:
            return Reason(
                "gtsam is not installed; install the group peers", "Install the optional group peers"
            )
        if len(graph.near_from) > self.most_near:
            limit = f"{len(graph.near_from)} pairs of near places are too many for gtsam ({self.most_near})"
            return Reason(limit, "Raise most_near, or leave pairs out")
        return ""

    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return the poses that gtsam finds.

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
            Without gtsam, with too many pairs, for a graph that cannot be used, or settings outside their
            range.
        """
        checked(graph)
        check_whole("most_near", self.most_near, least=0)
        if reason := self.skip(graph):
            raise refusal("gtsam_levenberg_marquardt", reason)
        check_whole("iterations", self.iterations, least=1)
        check_number("near_sigma_m", self.near_sigma_m, above=0)
        near = NearCost.of_distance(self.near_sigma_m, d_min_m=self.d_min_m, d_max_m=self.d_max_m)
        turn_rad = np.asarray(graph.motion)[:, 2]
        into_second = np.zeros((len(turn_rad), 3, 3))
        into_second[:, 0, 0] = into_second[:, 1, 1] = np.cos(turn_rad)
        into_second[:, 0, 1] = np.sin(turn_rad)
        into_second[:, 1, 0] = -into_second[:, 0, 1]
        into_second[:, 2, 2] = 1.0
        information = into_second @ graph.motion_information @ np.swapaxes(into_second, -1, -2)
        found = gtsam_minimum(replace(graph, motion_information=information), near, self.iterations)
        extra = {
            "iterations": np.array(found.iterations),
            "converged": np.array(found.converged),
            "own_cost": np.array(found.cost),
        }
        return Solved(found.pose, extra)
