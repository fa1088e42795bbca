"""Control: the paper's graph with true neighbours in place of WiFi edges."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from positioning.errors import InputError, check_number
from positioning.geometry import pairwise_distance_m, rigid_fit
from positioning.model import Aligned, Array, Truth, Walks
from positioning.posegraph.optimiser import optimise
from positioning.posegraph.residuals import MOTION_INFORMATION, relative_pose
from positioning.walk_alignment import Indices, Poses, in_reference_frame, motion_graph, moved, poses_of


class ControlTrueNeighbours:
    """Edges where walks truly come near each other, with the true motion between: how far a graph could get.

    See Gu et al., Fig. 2, whose WiFi edges are replaced. Each pose has an edge to the nearest pose of every
    walk, its own as well, if that is a neighbour; it weighs as much as a step of dead reckoning, eq. 8. The
    start are walks laid on their true paths, as in `ControlRigid`.

    Parameters
    ----------
    truth
        True paths and headings of the world.
    near_m
        Largest true distance of neighbours, metres.
    exclude_s
        Poses of one walk are neighbours only if they are at least this far apart in time, seconds.
    iterations
        Most steps of the search.
    """

    def __init__(
        self, *, truth: Truth, near_m: float = 2.0, exclude_s: float = 30.0, iterations: int = 50
    ) -> None:
        self.truth = truth
        self.near_m = near_m
        self.exclude_s = exclude_s
        self.iterations = iterations

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks where they contradict motion and true neighbours least.

        See Gu et al., Figure 6.

        Parameters
        ----------
        walks
            One world.
        rng
            Not used.

        Raises
        ------
        InputError
            For walks that cannot be used, a truth without headings, or settings outside their range.
        """
        for name, value in (("near_m", self.near_m), ("exclude_s", self.exclude_s)):
            check_number(name, value, least=0)
        poses = poses_of(walks)
        if self.truth.path_m is None or self.truth.heading_rad is None:
            raise InputError("truth", "path_m or heading_rad is missing", "Give the true pose at each time")
        path_m = np.asarray(self.truth.path_m, dtype=np.float64)
        heading_rad = np.asarray(self.truth.heading_rad, dtype=np.float64)
        true = np.concatenate([path_m, heading_rad[..., None]], axis=-1)[poses.there]
        turn_rad, shift_m = rigid_fit(np.asarray(walks.position_m), path_m, poses.there)
        graph = motion_graph(poses, moved(poses, turn_rad, shift_m))
        start, end = self._neighbours(poses, true)
        steps = len(graph.motion_from)
        graph = replace(
            graph,
            motion_from=np.concatenate([graph.motion_from, start]),
            motion_to=np.concatenate([graph.motion_to, end]),
            motion=np.concatenate([graph.motion, relative_pose(true[start], true[end])]),
            motion_information=np.broadcast_to(MOTION_INFORMATION, (steps + len(start), 3, 3)),
        )
        found = optimise(graph.tied(), iterations=self.iterations)
        edges = np.bincount(poses.walk[np.concatenate([start, end])], minlength=len(poses.there))
        return in_reference_frame(poses, found.pose, {"edges": edges})

    def _neighbours(self, poses: Poses, true: Array) -> tuple[Indices, Indices]:
        """Return both ends of the edges, each pair once."""
        distance_m = pairwise_distance_m(true[:, :2], true[:, :2])
        same = poses.walk[:, None] == poses.walk
        distance_m[same & (np.abs(poses.time_s[:, None] - poses.time_s) < self.exclude_s)] = np.inf
        np.fill_diagonal(distance_m, np.inf)
        first = np.searchsorted(poses.walk, np.arange(len(poses.there)))
        limits = [*first.tolist(), len(true)]
        here = np.arange(len(true))
        pairs = []
        for low, high in pairwise(limits):
            nearest = low + np.argmin(distance_m[:, low:high], axis=1)
            near = distance_m[here, nearest] <= self.near_m
            pairs.append(np.stack([here, nearest], axis=-1)[near])
        unique = np.unique(np.sort(np.concatenate(pairs), axis=-1), axis=0)
        return unique[:, 0], unique[:, 1]
