"""A ranging algorithm to copy: the distance of the calibration reading that is most alike.

Copy this file to ``algorithms/ranging/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and name it as the ``ranging`` of a tracking algorithm in
``config/config.yaml``.
"""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.model import Array
from positioning.ranging import calibration_pairs


class Template:
    """The distance of the calibration reading with the most similar strength.

    Say here where your algorithm is described.

    Parameters
    ----------
    tolerance_db
        A strength that differs more from all of the calibration has no distance, dB.
    """

    # The constructor takes keywords only and stores them as they are.
    def __init__(self, *, tolerance_db: float = 3.0) -> None:
        self.tolerance_db = tolerance_db

    # What is learned gets a name that ends in an underscore.
    def fit(self, distance_m: ArrayLike, rss_dbm: ArrayLike) -> Self:
        """Learn from a calibration run: distances [n], metres, and strengths [n], dBm (NaN = not heard).

        See Raghavan et al., section II.B, for the run; raises InputError if it cannot be used.
        """
        self.distance_m_, self.rss_dbm_ = calibration_pairs(distance_m, rss_dbm)
        return self

    # The last axis holds the candidates: one here. More candidates stand ascending, NaN fills up.
    def distances(self, rss_dbm: ArrayLike) -> Array:
        """Return the candidate distances, [..., b, 1], metres, of strengths [..., b], dBm; NaN = none.

        See Raghavan et al., section II.B, for what candidates are.
        """
        rss = np.asarray(rss_dbm, dtype=np.float64)
        difference_db = np.abs(rss[..., None] - self.rss_dbm_)
        distance_m = self.distance_m_[np.argmin(difference_db, axis=-1)]
        fits = difference_db.min(axis=-1) <= self.tolerance_db
        return np.where(fits, distance_m, np.nan)[..., None]
