"""Support vector regression, one machine a coordinate."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

from positioning.fingerprints import FingerprintRegressor, fill_not_heard
from positioning.model import Array


class Svm(FingerprintRegressor):
    """Support vector regression of both coordinates with a Gaussian kernel.

    See Mirzababaei & Akbari, section 6.A. Readings and coordinates are standardised with the
    training fingerprints. The paper prints no setting; these are LIBSVM's defaults for standardised
    data (penalty 1, tube 0.1, kernel exp(-d^2/number of inputs)).

    Parameters
    ----------
    penalty
        C, for standardised coordinates; not printed in the paper.
    tube_m
        Half width of the tube without loss, metres; not printed in the paper. 0.75 m is 0.1
        standard deviations on a floor of about 30 m x 25 m.
    kernel_width
        w of the kernel exp(-d^2/w^2), in standard deviations of a reading; not printed in the
        paper. None: the square root of the number of access points.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self,
        *,
        penalty: float = 1.0,
        tube_m: float = 0.75,
        kernel_width: float | None = None,
        not_heard_dbm: float = -100.0,
    ) -> None:
        self.penalty = penalty
        self.tube_m = tube_m
        self.kernel_width = kernel_width
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Train one machine a coordinate.

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
        width = self.kernel_width or rss.shape[1] ** 0.5
        self.reading_scaler_ = StandardScaler().fit(fill_not_heard(rss, self.not_heard_dbm))
        self.position_scaler_ = StandardScaler().fit(position)
        reading = self.reading_scaler_.transform(fill_not_heard(rss, self.not_heard_dbm))
        coordinate = self.position_scaler_.transform(position)
        self.machines_ = []
        for axis, scale_m in enumerate(self.position_scaler_.scale_):
            machine = SVR(C=self.penalty, epsilon=self.tube_m / scale_m, gamma=width**-2)
            # Regression draws nothing at random, yet scikit-learn takes a seed from the global
            # state unless it finds one here.
            machine.random_state = 0
            self.machines_.append(machine.fit(reading, coordinate[:, axis]))
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, section 6.A.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        reading = self.reading_scaler_.transform(rss)
        coordinate = np.stack([machine.predict(reading) for machine in self.machines_], axis=1)
        return np.asarray(self.position_scaler_.inverse_transform(coordinate))
