"""Bayesian localisation by a propagation model: the most likely place."""

import numpy as np

from positioning.model import Array
from positioning.propagation import PropagationRegressor


class BayesMaximumLikelihood(PropagationRegressor):
    """The position at which a propagation model makes the fingerprint most likely.

    See Mirzababaei & Akbari, eqs. 66 and 67 ("maximum likelihood"; the text has the two labels
    right, the formulas have them swapped). Of equally likely places the first of the grid is taken;
    where all are equally likely (nothing heard), the centre of the site.

    Parameters
    ----------
    site
        Corners, access points and walls of the place.
    grid_step_m
        Step of the grid over which the maximum is sought, metres; not printed in the paper.
    floor_dbm
        None: an access point that is not heard says nothing. Else its likelihood is the probability
        of a reading below this, dBm. Not printed in the paper.
    """

    def _locate(self, likelihood: Array) -> Array:
        flat = likelihood.max(axis=1) == likelihood.min(axis=1)
        likeliest = self.grid_m_[np.argmax(likelihood, axis=1)]
        return np.asarray(np.where(flat[:, None], self.grid_m_.mean(axis=0), likeliest))
