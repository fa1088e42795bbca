"""Control: each walk moved, as it is, to where it was walked."""

import numpy as np

from positioning.geometry import rigid_fit, rotated
from positioning.model import Aligned, Truth, Walks
from positioning.walks import check_walks


class ControlRigid:
    """Every walk turned and shifted onto its true path: alignment without a fault, drift uncorrected.

    See Gu et al., Figure 5, to which this row is added. What is better than this row has corrected drift.

    Parameters
    ----------
    truth
        True paths of the world.
    """

    def __init__(self, *, truth: Truth) -> None:
        self.truth = truth

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks laid on their true paths by least squares over all poses.

        See Gu et al., Figure 5.

        Parameters
        ----------
        walks
            One world.
        rng
            Not used.

        Raises
        ------
        InputError
            For walks that cannot be used.
        """
        there = check_walks(walks)
        position_m = np.asarray(walks.position_m, dtype=np.float64)
        path_m = np.asarray(self.truth.path_m, dtype=np.float64)
        turn_rad, shift_m = rigid_fit(position_m, path_m, there)
        return Aligned(
            position_m=rotated(position_m, turn_rad[:, None]) + shift_m[:, None],
            heading_rad=np.asarray(walks.heading_rad, dtype=np.float64) + turn_rad[:, None],
        )
