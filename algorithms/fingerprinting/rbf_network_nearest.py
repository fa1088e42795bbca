"""Radial basis function network on the training samples nearest to the tested one."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    Mask,
    fill_not_heard,
    nearest_members,
    signal_distance_db,
    too_few,
    training_members,
)
from positioning.model import Array, Site, Survey
from positioning.radial_basis import estimate, fit_network, gaussian_kernel

_LARGEST_KERNEL_BYTES = 2**29
_NETWORKS_AT_ONCE = 512


class RbfNetworkNearest(FingerprintRegressor):
    """A radial basis function network of its own for each tested fingerprint.

    See Mirzababaei & Akbari, section 6.B ("RBFN with K Nearest Data Set"): the network is trained
    on the fingerprints nearest to the tested one in signal space.

    Parameters
    ----------
    nearest
        Number of nearest fingerprints that train; the paper's optimum is 70.
    neurons
        Largest number of centres; the paper's optimum is 10.
    spread_db
        Width of the Gaussian, dB; the paper's optimum is 12.
    kernel
        ``paper``: exp(-d^2/s^2) of eq. 63. ``newrb``: exp(-ln2 d^2/s^2) of MATLAB's newrb.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self,
        *,
        nearest: int = 70,
        neurons: int = 10,
        spread_db: float = 12.0,
        kernel: str = "paper",
        not_heard_dbm: float = -100.0,
    ) -> None:
        self.nearest = nearest
        self.neurons = neurons
        self.spread_db = spread_db
        self.kernel = kernel
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Keep the survey; networks are trained when there is something to locate.

        See Mirzababaei & Akbari, section 6.B.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey or a parameter cannot be used; `predict` raises it for ``nearest`` above n.
        """
        rss, self.position_m_ = self._training(rss_dbm, position_m)
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)
        self.distance_db_ = signal_distance_db(self.rss_dbm_, self.rss_dbm_)
        self.kernel_ = gaussian_kernel(self.distance_db_, self.spread_db, self.kernel)
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, eq. 62.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        return self._locate(signal_distance_db(rss, self.rss_dbm_), None)

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Parameters as in `fit`, whose survey stays as it is.
        """
        fitted = clone(self).fit(rss_dbm, position_m)
        return fitted._locate(fitted.distance_db_, training_members(fitted.position_m_))

    def _locate(self, distance_db: Array, member: Mask | None) -> Array:
        nearest = nearest_members(distance_db, self.nearest, member, "nearest")
        chosen = np.zeros(distance_db.shape, dtype=bool)
        np.put_along_axis(chosen, nearest, True, axis=1)
        kernel = gaussian_kernel(distance_db, self.spread_db, self.kernel)
        # Thousands of networks at once would take gigabytes.
        slices = [slice(i, i + _NETWORKS_AT_ONCE) for i in range(0, len(chosen), _NETWORKS_AT_ONCE)]
        return np.concatenate(
            [
                estimate(
                    fit_network(self.kernel_, self.position_m_, chosen[part], self.neurons), kernel[part]
                )
                for part in slices
            ]
        )

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Say why the networks cannot be trained on these data, None where they can.

        See Mirzababaei & Akbari, section 6.B.
        """
        samples = len(survey.rss_dbm)
        if 8 * samples**2 > _LARGEST_KERNEL_BYTES:
            return f"the kernel of {samples} fingerprints would take {8e-9 * samples**2:.1f} GB"
        return too_few(survey, self.nearest, f"nearest = {self.nearest}")
