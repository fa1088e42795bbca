"""Any fingerprinting algorithm on a map of few columns."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from algorithms.fingerprinting.knn_softmax import KnnSoftmax
from positioning.errors import Reason, check_whole
from positioning.estimator import clone
from positioning.fingerprints import FingerprintRegressor
from positioning.model import Array, Site, Survey


class Reduced(FingerprintRegressor):
    """A choice or mixture of access points, learned from the survey, and a regressor on what is left.

    See Atia et al., sections 5.7 and 6.4, where four of 132 columns are kept. The choice belongs to the
    training: in a leave-one-out it is made anew without the point that is left out.

    Parameters
    ----------
    access_points
        The choice, a transformer; None: fast orthogonal search for four columns.
    regressor
        The fingerprinting algorithm; None: the k nearest neighbours of eq. 6.
    """

    def __init__(self, *, access_points: Any = None, regressor: Any = None) -> None:
        self.access_points = access_points
        self.regressor = regressor

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Tell why the map is too small, None where it is not.

        See Atia et al., section 5.7.2.
        """
        columns = getattr(self._parts()[0], "columns", 0)
        check_whole("columns", columns)
        found = np.shape(survey.rss_dbm)[-1]
        if columns > found:
            return Reason(
                f"columns = {columns} are asked of a map of {found}",
                "Choose fewer columns, or survey more access points",
            )
        skip = getattr(self._parts()[1], "skip", None)
        return None if skip is None else skip(survey, site) or None

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Choose the access points, then learn from them.

        See Atia et al., section 6.4.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used, or has fewer columns than are asked for.
        """
        rss, position = self._training(rss_dbm, position_m)
        self.access_points_, self.regressor_ = (clone(part) for part in self._parts())
        self.regressor_.fit(self.access_points_.fit(rss, position).transform(rss), position)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Atia et al., section 6.4.
        """
        # The readings are checked first: that fails with a clear message where `fit` was forgotten.
        rss = self._readings(rss_dbm)
        return np.asarray(self.regressor_.predict(self.access_points_.transform(rss)), dtype=np.float64)

    def _parts(self) -> tuple[Any, Any]:
        """Return choice and regressor, the defaults where none was given."""
        chosen = FastOrthogonalSearch(columns=4) if self.access_points is None else self.access_points
        return chosen, KnnSoftmax() if self.regressor is None else self.regressor
