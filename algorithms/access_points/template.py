"""A choice of access points to copy: those whose readings vary the most over the site.

Copy this file to ``algorithms/access_points/<name>.py``, call the class like the file in CamelCase
(``my_choice.py`` holds ``MyChoice``), and name it in a row of ``config/config.yaml``:
``my_row: {use: reduced, access_points: {use: my_choice, columns: 4}, regressor: {use: wknn}}``.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import Transformer
from positioning.fingerprints import fill_not_heard
from positioning.model import Array
from positioning.orthogonal_search import check_columns, check_readings


# A scikit-learn transformer; any other one that allows NaN will do as well.
class Template(Transformer):
    """Keep the columns with the largest variance over the survey.

    See Atia et al., section 5.7; say here where your choice is described.

    Parameters
    ----------
    columns
        How many access points to keep.
    not_heard_dbm
        What stands for an access point that was not heard, dBm.
    """

    # The constructor takes keywords only and stores them as they are: scikit-learn copies a transformer by
    # them. All choices have these two.
    def __init__(self, *, columns: int = 4, not_heard_dbm: float = -100.0) -> None:
        self.columns = columns
        self.not_heard_dbm = not_heard_dbm

    # What is learned gets a name that ends in an underscore; `selected_` holds the column numbers, the
    # first choice first.
    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Choose from fingerprints [n, ap], dBm (NaN = not heard), taken at positions [n, 2], metres.

        See Atia et al., section 5.7.
        """
        rss = check_readings(rss_dbm)
        check_columns(self.columns, rss.shape[1])
        self.n_features_in_ = rss.shape[1]
        variance_db2 = fill_not_heard(rss, self.not_heard_dbm).var(axis=0)
        # A stable order: of equal columns the first ones, on every machine.
        self.selected_ = np.argsort(-variance_db2, kind="stable")[: self.columns]
        return self

    # A choice leaves NaN as it is, so that the regressor behind it can treat it in its own way.
    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the readings of the chosen access points, [m, columns], dBm.

        See Atia et al., section 6.4.
        """
        self._check_fitted()
        return np.asarray(check_readings(rss_dbm, self.n_features_in_)[:, self.selected_])
