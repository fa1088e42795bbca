"""An alignment algorithm to copy: every walk is turned so that its longest leg points the same way.

Copy this file to ``algorithms/alignment/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and add ``<name>: {}`` to the algorithms of a study in
``config/config.yaml``.
"""

import numpy as np

from positioning.errors import InputError
from positioning.geometry import rotated
from positioning.model import Aligned, Walks
from positioning.walks import check_walks


class Template:
    """Walks turned about their starts until the way from start to farthest place points along x.

    Say here where your algorithm is described.

    Parameters
    ----------
    quantile
        Which of the distances from the start counts as the farthest, from 0 to 1.
    """

    # The constructor takes keywords only and stores them as they are; values are checked at use.
    def __init__(self, *, quantile: float = 1.0) -> None:
        self.quantile = quantile

    # One world, without leading axes: arrays are [walk, pose, ...], and NaN fills up a walk behind its end.
    # An algorithm that cannot run on some data also has ``skip(walks) -> str``: the reason, or "".
    def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
        """Return the walks in one frame.

        Parameters
        ----------
        walks
            One world.
        rng
            The only source of randomness; not used here.

        Raises
        ------
        InputError
            For walks that cannot be used, or a quantile outside of 0 to 1.
        """
        if not 0 <= self.quantile <= 1:
            raise InputError(f"quantile={self.quantile}", "it must lie between 0 and 1", "Choose 1")
        # Refuses what nobody can align, with errors that name the cure.
        there = check_walks(walks)
        position_m, heading_rad = np.asarray(walks.position_m), np.asarray(walks.heading_rad)
        relative_m = position_m - position_m[:, :1]
        distance_m = np.where(there, np.linalg.norm(relative_m, axis=-1), np.nan)
        rank = np.nanquantile(distance_m, self.quantile, axis=1, keepdims=True)
        far = np.nanargmin(np.abs(distance_m - rank), axis=1)
        x_m, y_m = relative_m[np.arange(len(far)), far].T
        turn_rad = -np.arctan2(y_m, x_m)
        # Frames need not be those of the building: the scoring ties them, the same way for all rows.
        return Aligned(
            position_m=rotated(relative_m, turn_rad[:, None]),
            heading_rad=heading_rad + turn_rad[:, None],
            extra={"turn_rad": turn_rad},
        )
