"""Access points chosen at random: what a choice must beat."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import Transformer
from positioning.model import Array
from positioning.orthogonal_search import check_columns, check_readings


class RandomChoice(Transformer):
    """Keep random columns, all equally likely, without looking at the readings.

    See Atia et al., section 5.7, to whose choices this one is added.

    Parameters
    ----------
    columns
        How many access points to keep; 4 in the paper.
    random_state
        Seed of the draw; maps with as many access points draw the same columns.
    not_heard_dbm
        Not used: every choice of access points has it.

    Attributes
    ----------
    selected_
        Numbers of the columns, [columns], in the order in which they were drawn.
    """

    def __init__(self, *, columns: int = 4, random_state: int = 0, not_heard_dbm: float = -100.0) -> None:
        self.columns = columns
        self.random_state = random_state
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Draw the access points.

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
        self.selected_ = np.random.default_rng(self.random_state).permutation(rss.shape[1])[: self.columns]
        return self

    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the readings of the chosen access points, [m, columns], dBm; NaN stays NaN.

        See Atia et al., section 6.4.
        """
        self._check_fitted()
        return np.asarray(check_readings(rss_dbm, self.n_features_in_)[:, self.selected_])
