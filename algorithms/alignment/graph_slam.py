"""The paper's method: one graph of all walks, WiFi edges between poses that hear the same."""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError, check_number, check_whole
from positioning.model import Aligned, Array, Walks
from positioning.posegraph.costs import Cost, Loss, NearCost
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.optimiser import FRAMES, Frame, optimise
from positioning.walk_alignment import Poses, in_reference_frame, motion_graph, poses_of, wifi_pairs

Extra = dict[str, NDArray[np.generic]]


class Minimum(NamedTuple):
    """Poses of least cost, and how they were found.

    Attributes
    ----------
    pose
        [m, 3], metres and radians.
    cost_start, cost
        Before and after.
    iterations
        Steps that were taken.
    converged
        Whether the search ended by itself.
    """

    pose: Array
    cost_start: float
    cost: float
    iterations: int
    converged: bool


class GraphSlam:
    """Pose graph of all walks, from the start that the paper prints.

    See Gu et al., eqs. 3 to 10. All walks begin at (0, 0) with a heading that nobody knows, laid upon each
    other, and least squares alone are to bring them into one frame. Eq. 10 is flat from ``d_max_m``: walks
    that lie elsewhere are not attracted. `AlignedGraphSlam` begins from walks that are aligned.

    Eq. 5 sums over all ordered pairs, so each pair counts twice. A pair has an edge where the distance of
    eq. 9 is below the thresholds of both scans, which does not depend on the order of the walks; the paper
    may mean that of the later scan alone. It prints no value of ``window``, ``exclude_s``, ``exclude_m``,
    ``wifi_weight`` and ``e_max``.

    Parameters
    ----------
    window
        L, scans, of the adaptive threshold.
    exclude_s, exclude_m
        Poses of one walk less than this apart, in time or in dead-reckoned place, have no WiFi edge, seconds
        and metres.
    threshold
        "median" for the adaptive threshold of section III-B, or a number of decibels for all scans.
    decides
        Whose threshold counts: that of both scans, of either, or of the later one in the order of the walks.
    wifi_weight
        Omega of eq. 5, without unit.
    e_max
        Largest error of eq. 10, without unit.
    d_min_m, d_max_m
        Ends of the straight line of eq. 10, metres.
    cost
        "squared", as the library of the paper minimises, or "linear", as eq. 5 is printed.
    loss
        Robust loss of WiFi edges in place of the square: "cauchy", "huber" or "dcs"; None = the square.
    loss_scale
        Error of eq. 10 from which the loss grows less than the square, in the unit of ``e_max``.
    iterations
        Most steps of the search.
    frame
        "held": the first pose stays where it is while the search goes on, as in section III-A and, for the
        lines, IV-A-1. "free": it moves like all others and is put back in place at the end; see
        `positioning.posegraph.optimiser.optimise`. Both have the same minima.
    wifi_edges
        False leaves the WiFi edges out: motion alone.
    access_points
        Only the first so many access points are heard, to see what fewer do; None = all.
    """

    def __init__(
        self,
        *,
        window: int = 10,
        exclude_s: float = 30.0,
        exclude_m: float = 2.0,
        threshold: Literal["median"] | float = "median",
        decides: Literal["later", "either", "both"] = "both",
        wifi_weight: float = 0.0001,
        e_max: float = 1.0,
        d_min_m: float = 2.0,
        d_max_m: float = 30.0,
        cost: Cost = "squared",
        loss: Loss | None = None,
        loss_scale: float = 0.1,
        iterations: int = 50,
        frame: Frame = "held",
        wifi_edges: bool = True,
        access_points: int | None = None,
    ) -> None:
        self.window = window
        self.exclude_s = exclude_s
        self.exclude_m = exclude_m
        self.threshold = threshold
        self.decides = decides
        self.wifi_weight = wifi_weight
        self.e_max = e_max
        self.d_min_m = d_min_m
        self.d_max_m = d_max_m
        self.cost = cost
        self.loss = loss
        self.loss_scale = loss_scale
        self.iterations = iterations
        self.frame = frame
        self.wifi_edges = wifi_edges
        self.access_points = access_points

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks where they contradict motion and fingerprints least.

        See Gu et al., Figures 5 and 6. The first pose of the first walk with a scan is the reference.

        Parameters
        ----------
        walks
            One world.
        rng
            Only for a start that is drawn.

        Returns
        -------
        Aligned
            With, for each walk, ``connected``: whether edges lead to the reference (a walk without scans
            keeps its start); ``edges``: its number of WiFi edges; ``cost_start``, ``cost``, ``iterations``
            and ``converged`` of the one search, which does not tell whether walks are aligned.

        Raises
        ------
        InputError
            For walks that cannot be used, or settings outside their range.
        """
        check_number("wifi_weight", self.wifi_weight, least=0)
        near = self._near().check()
        check_whole("iterations", self.iterations, least=1)
        if not isinstance(self.wifi_edges, bool | np.bool_):
            raise InputError(f"wifi_edges={self.wifi_edges!r}", "it is no truth value", "Give True or False")
        if self.frame not in FRAMES:
            raise InputError(f"frame={self.frame!r}", f"it is none of {', '.join(FRAMES)}", "Correct it")
        if self.access_points is not None:
            check_whole("access_points", self.access_points)
            known = np.shape(walks.rss_dbm)[-1]
            if not 1 <= self.access_points <= known:
                raise InputError(
                    f"access_points={self.access_points}", f"the scans know {known}", "Give 1 to all of them"
                )
            walks = replace(walks, rss_dbm=np.asarray(walks.rss_dbm)[..., : self.access_points])
        poses = poses_of(walks)
        start, extra = self._start(poses, rng)
        graph = self._graph(poses, start)
        _, part = graph.component()
        found = self._minimum(graph.tied(), near)
        count = len(poses.there)
        ends = np.concatenate([graph.near_from, graph.near_to])
        of_walk = np.searchsorted(poses.walk, np.arange(count))
        return in_reference_frame(
            poses,
            found.pose,
            {
                **extra,
                "connected": part[of_walk] == part[poses.reference],
                "edges": np.bincount(poses.walk[ends], minlength=count),
                "cost_start": np.full(count, found.cost_start),
                "cost": np.full(count, found.cost),
                "iterations": np.full(count, found.iterations),
                "converged": np.full(count, found.converged),
            },
        )

    def _start(self, poses: Poses, rng: np.random.Generator) -> tuple[Array, Extra]:
        """Return poses to start from, [m, 3], and what to keep of how they were found."""
        return poses.pose, {}

    def _graph(self, poses: Poses, start: Array) -> PoseGraph:
        """Return the graph."""
        graph = motion_graph(poses, start)
        if not self.wifi_edges:
            return graph
        near_from, near_to = wifi_pairs(
            poses,
            window=self.window,
            exclude_s=self.exclude_s,
            exclude_m=self.exclude_m,
            threshold=self.threshold,
            decides=self.decides,
        )
        return replace(graph, near_from=near_from, near_to=near_to)

    def _near(self) -> NearCost:
        """Return what WiFi edges cost; eq. 5 counts each pair in both orders."""
        return NearCost(
            weight=2 * self.wifi_weight,
            d_min_m=self.d_min_m,
            d_max_m=self.d_max_m,
            e_max=self.e_max,
            cost=self.cost,
            loss=self.loss,
            loss_scale=self.loss_scale,
        )

    def _minimum(self, graph: PoseGraph, near: NearCost) -> Minimum:
        """Return the poses of least cost."""
        found = optimise(graph, near=near, frame=self.frame, iterations=self.iterations)
        return Minimum(found.pose, found.cost_start, found.cost, found.iterations, found.converged)
