"""The access points whose columns best explain the whole map: fast orthogonal search."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import Transformer
from positioning.fingerprints import fill_not_heard
from positioning.model import Array
from positioning.orthogonal_search import check_readings, orthogonal_search


class FastOrthogonalSearch(Transformer):
    """Keep the columns with which a linear model of all columns has the least mean square error.

    See Atia et al., section 5.7, eqs. 9 to 13; details in `positioning.orthogonal_search`.

    Parameters
    ----------
    columns
        How many access points to keep; 4 in the paper.
    method
        "total" takes the column with the largest reduction at each step, as in section 5.7.2; "threshold"
        passes over the columns once, in their order, as in section 6.4.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.

    Attributes
    ----------
    selected_
        Numbers of the columns, [columns], in the order in which they were chosen.
    reduction_
        By how much each lowered the mean square error, summed over all columns, [columns], dB^2.
    """

    def __init__(self, *, columns: int = 4, method: str = "total", not_heard_dbm: float = -100.0) -> None:
        self.columns = columns
        self.method = method
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Choose the access points.

        See Atia et al., section 5.7.2.

        Parameters
        ----------
        rss_dbm
            Received signal strength of the survey, [n, ap], dBm; NaN = not heard.
        position_m
            Not used.

        Raises
        ------
        InputError
            For a survey that cannot be used, an unknown method, or more columns than access points.
        """
        rss = check_readings(rss_dbm)
        self.n_features_in_ = rss.shape[1]
        found = orthogonal_search(fill_not_heard(rss, self.not_heard_dbm), self.columns, method=self.method)
        self.selected_, self.reduction_ = found
        return self

    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the readings of the chosen access points, [m, columns], dBm; NaN stays NaN.

        See Atia et al., section 6.4.
        """
        self._check_fitted()
        return np.asarray(check_readings(rss_dbm, self.n_features_in_)[:, self.selected_])
