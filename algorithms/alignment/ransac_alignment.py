"""Alignment without a graph: matched scans, random sample consensus, and a rigid fit of each walk."""

import numpy as np

from positioning.model import Aligned, Walks
from positioning.walk_alignment import Placed, Poses, in_reference_frame, moved, place_walks, poses_of


class RansacAlignment:
    """Each walk turned and shifted, as it is, so that scans that are alike lie together.

    Not in the paper: it is what the method of Gu et al. needs before eq. 10 has a gradient. See
    `positioning.walk_alignment.place_walks`.

    Parameters
    ----------
    window
        L, scans, of the adaptive threshold of section III-B that matches must be below.
    inlier_m
        Matched scans agree if they are this near, metres.
    segment_s
        Longest time between the two matches of a hypothesis, seconds: drift within it must be small.
    hypotheses
        Number drawn for each pair of walks.
    least_matches, least_share
        Number and share of the matches that must agree for walks to be joined.
    """

    def __init__(
        self,
        *,
        window: int = 10,
        inlier_m: float = 5.0,
        segment_s: float = 300.0,
        hypotheses: int = 2000,
        least_matches: int = 8,
        least_share: float = 0.2,
    ) -> None:
        self.window = window
        self.inlier_m = inlier_m
        self.segment_s = segment_s
        self.hypotheses = hypotheses
        self.least_matches = least_matches
        self.least_share = least_share

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks laid upon each other.

        See Gu et al., Figure 5. The first pose of the first walk with a scan is the reference.

        Parameters
        ----------
        walks
            One world.
        rng
            Draws the hypotheses.

        Returns
        -------
        Aligned
            With, for each walk, ``aligned``: whether it is joined to the reference (a walk that is not keeps
            its dead-reckoned frame, or that of the first walk it is joined to), ``matches``: how many
            matched scans agreed when it was joined, 0 for a walk whose frame stays, and ``reason``: why it is
            not joined, in words, empty for a walk that is.

        Raises
        ------
        InputError
            For walks that cannot be used, or settings outside their range.
        """
        poses = poses_of(walks)
        placed = self.placed(poses, rng)
        pose = moved(poses, placed.turn_rad, placed.shift_m)
        aligned = placed.part == poses.walk[poses.reference]
        extra = {"aligned": aligned, "matches": placed.matches, "reason": placed.reason}
        return in_reference_frame(poses, pose, {name: v for name, v in extra.items() if v is not None})

    def placed(self, poses: Poses, rng: np.random.Generator) -> Placed:
        """Return where the walks lie, for algorithms that go on from there.

        See `positioning.walk_alignment.place_walks`.

        Parameters
        ----------
        poses
            All walks.
        rng
            Draws the hypotheses.

        Raises
        ------
        InputError
            For settings outside their range.
        """
        return place_walks(
            poses,
            rng,
            window=self.window,
            inlier_m=self.inlier_m,
            segment_s=self.segment_s,
            hypotheses=self.hypotheses,
            least_matches=self.least_matches,
            least_share=self.least_share,
        )
