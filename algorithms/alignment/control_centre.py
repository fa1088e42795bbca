"""Control: an alignment that does not look at the walks."""

import numpy as np

from positioning.model import Aligned, Walks
from positioning.walks import check_walks


class ControlCentre:
    """Every pose at one place: a row that is worse is no help.

    See Gu et al., Figure 7, to which this row is added. After the tie of the frame this place is the mean of
    all true ones.
    """

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return zero for every pose.

        See Gu et al., Figure 7.

        Parameters
        ----------
        walks
            One world; only its shape is used.
        rng
            Not used.

        Raises
        ------
        InputError
            For walks that cannot be used.
        """
        there = check_walks(walks)
        return Aligned(
            position_m=np.where(there[..., None], np.zeros(2), np.nan),
            heading_rad=np.where(there, 0.0, np.nan),
        )
