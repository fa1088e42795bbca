"""Bayesian localisation by a propagation model: the posterior mean."""

import numpy as np

from positioning.model import Array
from positioning.propagation import PropagationRegressor


class BayesAverage(PropagationRegressor):
    """The average position under the posterior of a propagation model.

    See Mirzababaei & Akbari, eqs. 66 and 68 ("average"; the text has the two labels right, the
    formulas have them swapped). The prior is uniform over the site's area.

    Parameters
    ----------
    site
        Corners, access points and walls of the place.
    grid_step_m
        Step of the grid over which the posterior is taken, metres; not printed in the paper.
    floor_dbm
        None: an access point that is not heard says nothing. Else its likelihood is the probability
        of a reading below this, dBm. Not printed in the paper.
    """

    def _locate(self, likelihood: Array) -> Array:
        posterior = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))
        return np.asarray(posterior @ self.grid_m_ / posterior.sum(axis=1, keepdims=True))
