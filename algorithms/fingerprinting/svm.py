"""Support vector regression, one machine a coordinate."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn import config_context
from sklearn.svm import SVR

from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    checked_survey,
    fill_not_heard,
    signal_distance_db,
    standardisation,
    training_members,
)
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
        return self._train(fill_not_heard(rss, self.not_heard_dbm), position)

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, section 6.A.
        """
        return self._locate(fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Parameters as in `fit`, whose machines stay as they are.
        """
        rss, position = checked_survey(rss_dbm, position_m, least=2)
        reading = fill_not_heard(rss, self.not_heard_dbm)
        located = np.empty_like(position)
        machines = clone(self)
        # Fingerprints taken at one place leave out the same ones, and share their machines.
        _, place, of_place = np.unique(position, axis=0, return_index=True, return_inverse=True)
        for fold, member in enumerate(training_members(position)[place]):
            # Settings that passed scikit-learn's checks once need not pass them every time.
            with config_context(assume_finite=fold > 0, skip_parameter_validation=fold > 0):
                tested = of_place == fold
                machines._train(reading[member], position[member])
                located[tested] = machines._locate(reading[tested])
        return located

    def _train(self, reading_dbm: Array, position_m: Array) -> Self:
        everyone = np.ones((1, len(reading_dbm)), dtype=bool)
        width = self.kernel_width or reading_dbm.shape[1] ** 0.5
        (centre,), (scale,) = standardisation(reading_dbm, everyone)
        # The kernel's width goes into the scale: distances then come out in widths.
        self.reading_scale_ = centre, scale * width
        (centre_m,), (scale_m,) = standardisation(position_m, everyone)
        self.position_scale_ = centre_m, scale_m
        self.reading_ = (reading_dbm - centre) / (scale * width)
        coordinate = (position_m - centre_m) / scale_m
        # One kernel for both coordinates; LIBSVM would form it for each.
        kernel = np.exp(-(signal_distance_db(self.reading_, self.reading_) ** 2))
        self.machines_ = []
        for axis in range(2):
            machine = SVR(kernel="precomputed", C=self.penalty, epsilon=self.tube_m / scale_m[axis])
            # Regression draws nothing at random, yet scikit-learn takes a seed from the global
            # state unless it finds one here.
            machine.random_state = 0
            self.machines_.append(machine.fit(kernel, coordinate[:, axis]))
        return self

    def _locate(self, reading_dbm: Array) -> Array:
        centre, scale = self.reading_scale_
        reading = (reading_dbm - centre) / scale
        coordinate = np.empty((len(reading), 2))
        for axis, machine in enumerate(self.machines_):
            # Without support vectors there is the constant alone.
            kernel = np.exp(-(signal_distance_db(reading, self.reading_[machine.support_]) ** 2))
            coordinate[:, axis] = np.sum(kernel * machine.dual_coef_[0], axis=1) + machine.intercept_[0]
        centre_m, scale_m = self.position_scale_
        return np.asarray(coordinate * scale_m + centre_m)
