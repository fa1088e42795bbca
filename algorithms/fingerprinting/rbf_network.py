"""Radial basis function network on all training samples."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.fingerprints import (
    FingerprintRegressor,
    Index,
    checked_survey,
    fill_not_heard,
    signal_distance_db,
    too_few,
    training_members,
)
from positioning.model import Array, Site, Survey
from positioning.radial_basis import estimate, fit_network, gaussian_kernel

_LARGEST_KERNEL_BYTES = 2**29


class RbfNetwork(FingerprintRegressor):
    """One radial basis function network for the whole site.

    See Mirzababaei & Akbari, eqs. 60-64 and section 6.B. Centres are chosen from the training
    fingerprints by orthogonal least squares. The choice depends on the origin of the coordinates,
    because the bias enters the final solution only.

    Parameters
    ----------
    neurons
        Largest number of centres; the paper's optimum is 30.
    spread_db
        Width of the Gaussian, dB; the paper's optimum is 45.
    kernel
        ``paper``: exp(-d^2/s^2) of eq. 63. ``newrb``: exp(-ln2 d^2/s^2) of MATLAB's newrb.
    training_samples
        Train on that many fingerprints, drawn once from the survey (Figure 2a); None: on all.
    random_state
        Seed of the draw of ``training_samples``.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self,
        *,
        neurons: int = 30,
        spread_db: float = 45.0,
        kernel: str = "paper",
        training_samples: int | None = None,
        random_state: int = 0,
        not_heard_dbm: float = -100.0,
    ) -> None:
        self.neurons = neurons
        self.spread_db = spread_db
        self.kernel = kernel
        self.training_samples = training_samples
        self.random_state = random_state
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Choose the centres and solve for the weights.

        See Mirzababaei & Akbari, eqs. 60-64.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey or a parameter cannot be used.
        """
        rss, position = self._training(rss_dbm, position_m)
        drawn = self._draw(len(rss))
        self.rss_dbm_ = fill_not_heard(rss, self.not_heard_dbm)[drawn]
        kernel = self._kernel(self.rss_dbm_, self.rss_dbm_)
        self.network_ = fit_network(
            kernel, position[drawn], np.ones((1, len(drawn)), dtype=bool), self.neurons
        )
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, eq. 62.
        """
        rss = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        return estimate(self.network_, self._kernel(rss, self.rss_dbm_))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Each fold chooses its own centres from its own training
        fingerprints. Parameters as in `fit`, whose network stays as it is.
        """
        rss, position = checked_survey(rss_dbm, position_m, least=2)
        reading = fill_not_heard(rss, self.not_heard_dbm)
        member = training_members(position)
        if self.training_samples is not None:
            size = member.sum(axis=1)
            # A fold's training fingerprints in their order, as an explicit refit gets them.
            order = np.argsort(~member, axis=1, kind="stable")
            member = np.zeros_like(member)
            for count in np.unique(size):
                fold = np.flatnonzero(size == count)[:, None]
                member[fold, order[fold, self._draw(int(count))]] = True
        kernel = self._kernel(reading, reading)
        return estimate(fit_network(kernel, position, member, self.neurons), kernel)

    def _kernel(self, tested_dbm: Array, trained_dbm: Array) -> Array:
        return gaussian_kernel(signal_distance_db(tested_dbm, trained_dbm), self.spread_db, self.kernel)

    def _draw(self, samples: int) -> Index:
        """Return the sorted indices of the fingerprints that train."""
        if self.training_samples is None:
            return np.arange(samples)
        if not 1 <= self.training_samples <= samples:
            raise InputError(
                f"training_samples={self.training_samples}",
                f"it must lie between 1 and the number of training fingerprints, {samples}",
                "Choose fewer, or leave it out to train on all",
            )
        order = np.random.default_rng(self.random_state).permutation(samples)
        return np.sort(order[: self.training_samples])

    def skip(self, survey: Survey, site: Site | None) -> str | None:
        """Say why the network cannot be trained on these data, None where it can.

        See Mirzababaei & Akbari, section 6.
        """
        samples = len(survey.rss_dbm)
        if 8 * samples**2 > _LARGEST_KERNEL_BYTES:
            return f"the kernel of {samples} fingerprints would take {8e-9 * samples**2:.1f} GB"
        return too_few(survey, self.neurons + 1, f"neurons = {self.neurons}")
