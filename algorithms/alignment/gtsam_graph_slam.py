"""The paper's graph from aligned walks, thinned, and minimised by gtsam: a peer for the project's search."""

import math
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np

from algorithms.alignment.aligned_graph_slam import AlignedGraphSlam
from algorithms.alignment.graph_slam import Minimum
from positioning.errors import InputError, Reason, check_whole, refusal
from positioning.model import Aligned, Array, Walks
from positioning.posegraph.costs import NearCost
from positioning.posegraph.graph import PoseGraph
from positioning.walk_alignment import Placing, Poses


class GtsamGraphSlam(AlignedGraphSlam):
    """`AlignedGraphSlam` with the Levenberg-Marquardt search of the library gtsam.

    See Gu et al., eqs. 3 to 10; the paper itself uses g2o. Steps of dead reckoning are factors of gtsam. None
    of its factors is eq. 10, so each WiFi edge is a function in Python that the library calls at every step;
    this, and what gtsam needs to eliminate graphs with so many loops, is too slow for all of them. Therefore
    the graph is thinned: of all pairs in their order, ``most_edges`` at equal distances stay, and the weight
    of each grows in proportion, so that the sum is about that of all. The cost is the squared one, and the
    first pose is held as in the paper.

    Where gtsam is not installed (optional group ``peers``), the row says so.

    Parameters
    ----------
    most_edges
        WiFi edges that stay.
    alignment
        How the walks are aligned first, as of `AlignedGraphSlam`; None: `RansacAlignment` as it is.
    window, exclude_s, exclude_m, threshold, decides, wifi_weight, e_max, d_min_m, d_max_m
        As in `GraphSlam`.
    iterations
        Most steps of the search.
    """

    def __init__(
        self,
        *,
        most_edges: int = 1000,
        alignment: Placing | None = None,
        window: int = 10,
        exclude_s: float = 30.0,
        exclude_m: float = 2.0,
        threshold: Literal["median"] | float = "median",
        decides: Literal["later", "either", "both"] = "both",
        wifi_weight: float = 0.0001,
        e_max: float = 1.0,
        d_min_m: float = 2.0,
        d_max_m: float = 30.0,
        iterations: int = 50,
    ) -> None:
        super().__init__(
            alignment=alignment,
            window=window,
            exclude_s=exclude_s,
            exclude_m=exclude_m,
            threshold=threshold,
            decides=decides,
            wifi_weight=wifi_weight,
            e_max=e_max,
            d_min_m=d_min_m,
            d_max_m=d_max_m,
            iterations=iterations,
        )
        self.most_edges = most_edges

    def skip(self, walks: Walks) -> str:
        """Tell whether gtsam is missing, "" where it is not.

        Parameters
        ----------
        walks
            Not used.
        """
        if find_spec("gtsam") is not None:
            return ""
        return Reason("gtsam is not installed", "Install the optional group peers")

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks where they contradict motion and the WiFi edges that are left least.

        See Gu et al., Figures 5 and 6.

        Parameters
        ----------
        walks
            One world.
        rng
            Draws the hypotheses of the alignment.

        Returns
        -------
        Aligned
            As of `GraphSlam`; ``edges`` counts those that are left.

        Raises
        ------
        InputError
            Without gtsam, for walks that cannot be used, or settings outside their range.
        """
        if reason := self.skip(walks):
            raise refusal("gtsam_graph_slam", reason)
        check_whole("most_edges", self.most_edges, least=1)
        return super().align(walks, rng)

    def _graph(self, poses: Poses, start: Array) -> PoseGraph:
        """Return the thinned graph."""
        graph = super()._graph(poses, start)
        edges = len(graph.near_from)
        if edges <= self.most_edges:
            return graph
        kept = np.floor((np.arange(self.most_edges) + 0.5) * edges / self.most_edges).astype(np.intp)
        return replace(
            graph,
            near_from=graph.near_from[kept],
            near_to=graph.near_to[kept],
            near_weight=np.full(len(kept), edges / len(kept)),
        )

    def _minimum(self, graph: PoseGraph, near: NearCost) -> Minimum:
        """Return the poses of least cost, as gtsam finds them."""
        return gtsam_minimum(graph, near, self.iterations)


def gtsam_minimum(graph: PoseGraph, near: NearCost, iterations: int) -> Minimum:
    """Minimise the squared cost of a graph with gtsam.

    See Gu et al., eqs. 3 to 5 and 10. gtsam turns the residual of a motion into the frame of the measured
    pose, which changes no cost where the information is the same in both directions, as in eq. 8.

    Parameters
    ----------
    graph
        Poses, motion edges and proximity edges; fixed poses are held exactly.
    near
        Cost of the proximity edges, squared and without a loss.
    iterations
        Most steps of the search.

    Raises
    ------
    InputError
        For a cost or a loss that this comparison does not hold.
    """
    # Not a dependency: whoever calls this has asked `skip`.
    gtsam: Any = import_module("gtsam")
    if near.cost != "squared" or near.loss is not None:
        limit = "only the square without a loss is compared with gtsam"
        raise InputError(
            f"cost={near.cost!r}, loss={near.loss!r}", limit, "Use aligned_graph_slam for others"
        )
    factors, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, pose in enumerate(graph.pose.tolist()):
        start.insert(key, gtsam.Pose2(*pose))
        if graph.fixed[key]:
            factors.add(gtsam.NonlinearEqualityPose2(key, gtsam.Pose2(*pose)))
    # gtsam halves squares; so does nobody else here.
    for one, two, step, information in zip(
        graph.motion_from.tolist(),
        graph.motion_to.tolist(),
        graph.motion.tolist(),
        2.0 * np.asarray(graph.motion_information),
        strict=True,
    ):
        noise = gtsam.noiseModel.Gaussian.Information(information)
        factors.add(gtsam.BetweenFactorPose2(one, two, gtsam.Pose2(*step), noise))
    weight = np.full(len(graph.near_from), near.weight)
    if graph.near_weight is not None:
        weight = weight * graph.near_weight
    error = _near_error(near)
    for one, two, value in zip(
        graph.near_from.tolist(), graph.near_to.tolist(), weight.tolist(), strict=True
    ):
        if value > 0:
            noise = gtsam.noiseModel.Isotropic.Precision(1, 2.0 * value)
            factors.add(gtsam.CustomFactor(noise, [one, two], error))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(int(iterations))
    search = gtsam.LevenbergMarquardtOptimizer(factors, start, settings)
    first = float(factors.error(start))
    values = search.optimize()
    found = (values.atPose2(key) for key in range(len(graph.pose)))
    pose = np.array([[place.x(), place.y(), place.theta()] for place in found])
    # gtsam wraps headings; here they go on from those of the start.
    pose[:, 2] += 2 * np.pi * np.round((graph.pose[:, 2] - pose[:, 2]) / (2 * np.pi))
    taken = int(search.iterations())
    return Minimum(pose, first, float(factors.error(values)), taken, taken < iterations)


def _near_error(near: NearCost) -> Callable[[Any, Any, Any], Array]:
    """Return eq. 10 as gtsam calls it: with a factor, values, and a list for derivatives or nothing.

    Called for one pair at a time: plain numbers, where arrays would take ten times as long.
    """
    slope = near.e_max / (near.d_max_m - near.d_min_m)

    def error(factor: Any, values: Any, jacobians: Any) -> Array:
        start, end = (values.atPose2(key) for key in factor.keys())  # noqa: SIM118
        east, north = end.x() - start.x(), end.y() - start.y()
        distance_m = math.hypot(east, north)
        between = near.d_min_m < distance_m < near.d_max_m
        if jacobians is not None:
            # gtsam moves a pose in its own frame.
            pull = slope / distance_m if between else 0.0
            for index, (place, sign) in enumerate(((start, -pull), (end, pull))):
                cosine, sine = math.cos(place.theta()), math.sin(place.theta())
                forward, left = cosine * east + sine * north, cosine * north - sine * east
                jacobians[index] = np.array([[sign * forward, sign * left, 0.0]], order="F")
        if between:
            return np.array([slope * (distance_m - near.d_min_m)])
        return np.array([0.0 if distance_m <= near.d_min_m else near.e_max])

    return error
