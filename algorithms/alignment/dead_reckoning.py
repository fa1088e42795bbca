"""Dead reckoning as it is: no alignment at all."""

import numpy as np

from positioning.model import Aligned, Walks
from positioning.walks import check_walks


class DeadReckoning:
    """Every walk in its own frame, all frames laid upon each other.

    See Gu et al., eq. 2 and Figure 5: each walk begins at (0, 0), with a heading that nobody knows.
    """

    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks as they were dead reckoned.

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
            For walks that cannot be used, see `positioning.walks.check_walks`.
        """
        check_walks(walks)
        return Aligned(
            np.asarray(walks.position_m, dtype=np.float64), np.asarray(walks.heading_rad, dtype=np.float64)
        )
