"""Multi-layer perceptron."""

from typing import Self
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import ArrayLike
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import StandardScaler

from positioning.fingerprints import FingerprintRegressor, fill_not_heard
from positioning.model import Array


class Mlp(FingerprintRegressor):
    """A perceptron with one hidden layer: readings in, eight neurons, two coordinates out.

    See Mirzababaei & Akbari, section 6.A ("three-layer model"). Readings and coordinates are
    standardised with the training fingerprints.

    Parameters
    ----------
    hidden
        Neurons of the hidden layer; 8 in the paper.
    weight_decay
        Penalty on squared weights; not printed in the paper. 1e-4 is scikit-learn's default.
    iterations
        Largest number of steps of the quasi-Newton training (L-BFGS); not printed in the paper.
        100 is the limit that is customary for networks of this size; training mostly stops there.
    random_state
        Seed of the initial weights.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self,
        *,
        hidden: int = 8,
        weight_decay: float = 1e-4,
        iterations: int = 100,
        random_state: int = 0,
        not_heard_dbm: float = -100.0,
    ) -> None:
        self.hidden = hidden
        self.weight_decay = weight_decay
        self.iterations = iterations
        self.random_state = random_state
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Train the network.

        See Mirzababaei & Akbari, section 6.A.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used.
        """
        rss, position = self._training(rss_dbm, position_m)
        self.reading_scaler_ = StandardScaler().fit(fill_not_heard(rss, self.not_heard_dbm))
        self.position_scaler_ = StandardScaler().fit(position)
        self.network_ = MLPRegressor(
            hidden_layer_sizes=(self.hidden,),
            activation="tanh",
            solver="lbfgs",
            alpha=self.weight_decay,
            max_iter=self.iterations,
            random_state=self.random_state,
        )
        with catch_warnings():
            # The number of iterations is a setting, and stopping there is meant.
            simplefilter("ignore", ConvergenceWarning)
            self.network_.fit(
                self.reading_scaler_.transform(fill_not_heard(rss, self.not_heard_dbm)),
                self.position_scaler_.transform(position),
            )
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, section 6.A.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        coordinate = self.network_.predict(self.reading_scaler_.transform(rss))
        return np.asarray(self.position_scaler_.inverse_transform(coordinate))
