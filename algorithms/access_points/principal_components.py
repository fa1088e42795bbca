"""Principal components of the map, the costlier reduction that fast orthogonal search is held against."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import Transformer
from positioning.fingerprints import fill_not_heard
from positioning.model import Array
from positioning.orthogonal_search import check_columns, check_readings


class PrincipalComponents(Transformer):
    """Replace the columns by their principal components with the largest variance.

    See Atia et al., section 5.7, which names it as the usual way; a component mixes all access points.

    Parameters
    ----------
    columns
        How many components to keep; 4 is the number of access points in the paper.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.

    Attributes
    ----------
    components_
        Directions of the components, [columns, ap].
    """

    def __init__(self, *, columns: int = 4, not_heard_dbm: float = -100.0) -> None:
        self.columns = columns
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Find the components.

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
            For a survey that cannot be used, or more columns than it has access points or fingerprints.
        """
        rss = check_readings(rss_dbm)
        check_columns(self.columns, min(rss.shape))
        self.n_features_in_ = rss.shape[1]
        reading = fill_not_heard(rss, self.not_heard_dbm)
        self.mean_dbm_ = reading.mean(axis=0)
        _, _, direction = np.linalg.svd(reading - self.mean_dbm_, full_matrices=False)
        # A component has no sign of its own: its largest part is made positive, as scikit-learn's PCA does.
        largest = np.argmax(np.abs(direction), axis=1)
        signs = np.sign(direction[np.arange(len(direction)), largest])
        self.components_ = (direction * signs[:, None])[: self.columns]
        return self

    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the components of readings, [m, columns], dB.

        See Atia et al., section 5.7.
        """
        self._check_fitted()
        rss = fill_not_heard(check_readings(rss_dbm, self.n_features_in_), self.not_heard_dbm)
        # A sum for each fingerprint by itself: the answer does not depend on the others beside it.
        return np.asarray(np.einsum("ma,ca->mc", rss - self.mean_dbm_, self.components_))
