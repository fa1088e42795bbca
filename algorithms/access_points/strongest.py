"""The strongest access points: a simple choice to hold others against."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import Transformer
from positioning.fingerprints import fill_not_heard
from positioning.model import Array
from positioning.orthogonal_search import check_columns, check_readings


class Strongest(Transformer):
    """Keep the columns with the highest mean level; of equal ones those with the lowest number.

    See Atia et al., section 5.7, to whose choices this one is added. What was not heard counts as weak, so
    that an access point heard once from close by does not win.

    Parameters
    ----------
    columns
        How many access points to keep; 4 in the paper.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.

    Attributes
    ----------
    selected_
        Numbers of the columns, [columns], the strongest first.
    """

    def __init__(self, *, columns: int = 4, not_heard_dbm: float = -100.0) -> None:
        self.columns = columns
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Choose the access points.

        See Atia et al., section 5.7.

        Parameters
        ----------
        rss_dbm
            Received signal strength of the survey, [n, ap], dBm; NaN = not heard.
        position_m
            Not used.

        Raises
        ------
        InputError
            For a survey that cannot be used, or more columns than access points.
        """
        rss = check_readings(rss_dbm)
        check_columns(self.columns, rss.shape[1])
        self.n_features_in_ = rss.shape[1]
        level_dbm = fill_not_heard(rss, self.not_heard_dbm).mean(axis=0)
        self.selected_ = np.argsort(-level_dbm, kind="stable")[: self.columns]
        return self

    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the readings of the chosen access points, [m, columns], dBm; NaN stays NaN.

        See Atia et al., section 6.4.
        """
        self._check_fitted()
        return np.asarray(check_readings(rss_dbm, self.n_features_in_)[:, self.selected_])
