"""The paper's graph, from walks that are aligned first."""

from typing import Literal

import numpy as np

from algorithms.alignment.graph_slam import Extra, GraphSlam
from algorithms.alignment.ransac_alignment import RansacAlignment
from positioning.model import Array
from positioning.posegraph.costs import Cost, Loss
from positioning.posegraph.optimiser import Frame
from positioning.walk_alignment import Placing, Poses, moved, placed_by


class AlignedGraphSlam(GraphSlam):
    """Pose graph of all walks, from where matched scans lay them.

    See Gu et al., eqs. 3 to 10, and `RansacAlignment` for the start; eq. 10 attracts only poses within
    ``d_max_m``. A walk that cannot be aligned starts where its dead reckoning is. With a ``loss``, this is
    the robust baseline.

    Unlike `GraphSlam`, the first pose moves with all others while the search goes on (``frame="free"``), and
    is put back in place at the end. The paper holds it, which has the same minima: in worlds of the study
    `graph_slam` both searches end at the same cost, this one in fewer steps. Where only some walks are
    aligned first, the two may end in different minima.

    Parameters
    ----------
    alignment
        How the walks are aligned first: an algorithm with a method ``placed``, see
        `positioning.walk_alignment.Placing`; None: `RansacAlignment` as it is.
    window, exclude_s, exclude_m, threshold, decides, wifi_weight, e_max, d_min_m, d_max_m, cost, loss
        As in `GraphSlam`.
    loss_scale, iterations, frame, wifi_edges, access_points
        As in `GraphSlam`.
    """

    def __init__(
        self,
        *,
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
        cost: Cost = "squared",
        loss: Loss | None = None,
        loss_scale: float = 0.1,
        iterations: int = 50,
        frame: Frame = "free",
        wifi_edges: bool = True,
        access_points: int | None = None,
    ) -> None:
        super().__init__(
            window=window,
            exclude_s=exclude_s,
            exclude_m=exclude_m,
            threshold=threshold,
            decides=decides,
            wifi_weight=wifi_weight,
            e_max=e_max,
            d_min_m=d_min_m,
            d_max_m=d_max_m,
            cost=cost,
            loss=loss,
            loss_scale=loss_scale,
            iterations=iterations,
            frame=frame,
            wifi_edges=wifi_edges,
            access_points=access_points,
        )
        self.alignment = alignment

    def _start(self, poses: Poses, rng: np.random.Generator) -> tuple[Array, Extra]:
        """Return the walks as aligned, [m, 3], which of them are, by how many matches, or why not."""
        placed = placed_by(RansacAlignment() if self.alignment is None else self.alignment, poses, rng)
        start = moved(poses, placed.turn_rad, placed.shift_m)
        aligned = placed.part == poses.walk[poses.reference]
        extra: Extra = {"aligned": aligned, "matches": placed.matches}
        return start, extra if placed.reason is None else {**extra, "reason": placed.reason}
