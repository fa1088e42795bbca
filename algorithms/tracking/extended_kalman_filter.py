"""A bank of extended Kalman filters, one for each start heading: a modern baseline without particles."""

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from algorithms.ranging.curve_crossings import CurveCrossings
from algorithms.trilateration.iterative_fractional_printed import IterativeFractionalPrinted
from positioning.filters import kalman
from positioning.filters.particle_filter import normalise
from positioning.filters.plane import (
    cannot_locate,
    centre_and_variance,
    check_locatable,
    check_settings,
    check_stack,
    headings_missing,
    start_heading_rad,
    track_one,
)
from positioning.fixes import locate
from positioning.model import Array, Calibration, Recording, Site, Survey, Track

_POSITION = np.eye(2, 3)


class Bank(NamedTuple):
    """Filters over x, y, heading: mean [r, h, 3], covariance [r, h, 3, 3], logarithm of weight [r, h]."""

    mean: Array
    covariance: Array
    log_weight: Array


class ExtendedKalmanFilter:
    """Extended Kalman filters over place and heading, weighted by how well they predicted the fixes.

    See Raghavan et al., section IV, whose motion model it shares; for probabilistic data association see
    Bar-Shalom, Daum & Huang (2009), "The probabilistic data association filter". Of the fixes of an epoch,
    one is taken for the robot's and the others for clutter, uniform over the site, each with its probability.
    An epoch without a fix is a prediction only. The start is Gaussian, with the mean and the variance of a
    uniform place.

    Parameters
    ----------
    headings
        Number of filters, with start headings at equal steps around the circle.
    sigma_m
        Standard deviation of a fix in each coordinate, metres.
    turn_noise_rad, advance_noise_m
        Standard deviation of each turn and of each translation.
    drift_noise_rad_per_m
        Standard deviation of the drift of the heading, per metre of a translation.
    walk_m_per_s
        Where no motion was recorded: standard deviation of each coordinate after a second of random walk.
    heading_known
        Whether it starts with the recorded heading, as one filter.
    true_fix_share
        Probability that one of the fixes of an epoch is the robot's, below 1; assumed.
    ranging
        From strengths to distances; None takes every crossing of the calibration curve.
    trilateration
        From distances to fixes; None takes the printed fractional iteration.
    """

    def __init__(
        self,
        *,
        headings: int = 8,
        sigma_m: float = 1.0,
        turn_noise_rad: float = 0.05,
        advance_noise_m: float = 0.05,
        drift_noise_rad_per_m: float = 0.05,
        walk_m_per_s: float = 1.0,
        heading_known: bool = False,
        true_fix_share: float = 0.9,
        ranging: Any = None,
        trilateration: Any = None,
    ) -> None:
        self.headings = headings
        self.sigma_m = sigma_m
        self.turn_noise_rad = turn_noise_rad
        self.advance_noise_m = advance_noise_m
        self.drift_noise_rad_per_m = drift_noise_rad_per_m
        self.walk_m_per_s = walk_m_per_s
        self.heading_known = heading_known
        self.true_fix_share = true_fix_share
        self.ranging = ranging
        self.trilateration = trilateration

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Raghavan et al., section IV.A.
        """
        if self.heading_known and headings_missing(recording):
            return "the start heading was not recorded"
        return cannot_locate(recording, survey, site)

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        return track_one(self, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings in lock-step.

        See Raghavan et al., section IV, and Bar-Shalom et al. (2009).

        Parameters
        ----------
        recording
            Stack [r, n]; NaN in the times after the end of a recording.
        survey
            Calibration runs [r, m]; not used where the recording holds distances.
        site
            Corners [r, 2, 2] and beacons [r, ap, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            Mean and covariance of the mixture, with extra ``fixes`` [r, n], the number of fixes of each
            epoch.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(
            headings=(self.headings, 1, 10_000),
            sigma_m=(self.sigma_m, 1e-6, 1e6),
            turn_noise_rad=(self.turn_noise_rad, 0, 1e3),
            advance_noise_m=(self.advance_noise_m, 0, 1e6),
            drift_noise_rad_per_m=(self.drift_noise_rad_per_m, 0, 1e3),
            walk_m_per_s=(self.walk_m_per_s, 0, 1e6),
            true_fix_share=(self.true_fix_share, 0, 1 - 1e-9),
        )
        length = check_stack(recording, site)
        check_locatable(recording, survey, site)
        found = locate(
            self.ranging or CurveCrossings(),
            self.trilateration or IterativeFractionalPrinted(),
            cast(Calibration | None, survey),
            recording,
            site,
        )
        corner_m = np.asarray(site.corner_m, dtype=np.float64)
        area_m2 = np.prod(corner_m[:, 1] - corner_m[:, 0], axis=-1)
        shape = recording.time_s.shape
        position_m, covariance_m2 = np.full((*shape, 2), np.nan), np.full((*shape, 2, 2), np.nan)
        bank = self._start(recording, site)
        for epoch in range(int(length.max())):
            rows = np.flatnonzero(length > epoch)
            running = Bank(*(part[rows] for part in bank))
            if epoch:
                running = self._predict(running, recording, rows, epoch)
            running = self._update(running, found.position_m[rows, epoch], area_m2[rows])
            for part, changed in zip(bank, running, strict=True):
                part[rows] = changed
            position_m[rows, epoch], covariance_m2[rows, epoch] = kalman.mixture_moments(
                normalise(running.log_weight), running.mean[..., :2], running.covariance[..., :2, :2]
            )
        ended = np.arange(shape[1]) >= length[:, None]
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"fixes": np.where(ended, np.nan, found.count)},
        )

    def _start(self, recording: Recording, site: Site) -> Bank:
        centre_m, uniform_m2 = centre_and_variance(site)
        count = len(centre_m)
        # Filters that differ in nothing but a heading that never matters are one filter.
        headings = 1 if self.heading_known or recording.turn_before_rad is None else self.headings
        mean, covariance = np.zeros((count, headings, 3)), np.zeros((count, headings, 3, 3))
        mean[..., :2], covariance[..., :2, :2] = centre_m[:, None], uniform_m2[:, None]
        if self.heading_known:
            mean[..., 2] = start_heading_rad(recording)[:, None]
        else:
            spacing_rad = 2 * np.pi / headings
            mean[..., 2] = spacing_rad * np.arange(headings)
            # That of a heading uniform over the filter's share of the circle.
            covariance[..., 2, 2] = spacing_rad**2 / 12
        return Bank(mean, covariance, np.zeros((count, headings)))

    def _predict(self, bank: Bank, recording: Recording, rows: NDArray[np.intp], epoch: int) -> Bank:
        mean, shape = bank.mean.copy(), bank.log_weight.shape
        transition = np.broadcast_to(np.eye(3), (*shape, 3, 3)).copy()
        if (
            recording.turn_before_rad is None
            or recording.advance_m is None
            or recording.turn_after_rad is None
        ):
            elapsed_s = recording.time_s[rows, epoch] - recording.time_s[rows, epoch - 1]
            noise = (self.walk_m_per_s**2 * elapsed_s)[:, None, None, None] * np.diag([1.0, 1.0, 0.0])
        else:
            advance_m = np.broadcast_to(recording.advance_m[rows, epoch, None], shape)
            way_rad = mean[..., 2] + recording.turn_before_rad[rows, epoch, None]
            ahead, aside = np.cos(way_rad), np.sin(way_rad)
            mean[..., 0] += advance_m * ahead
            mean[..., 1] += advance_m * aside
            mean[..., 2] = way_rad + recording.turn_after_rad[rows, epoch, None]
            transition[..., 0, 2], transition[..., 1, 2] = -advance_m * aside, advance_m * ahead
            # Derivatives by turn before, advance, drift and turn after. The drift turns the heading evenly
            # along the line, which leads in the direction half way between.
            by_noise = np.zeros((*shape, 3, 4))
            by_noise[..., :2, 0] = transition[..., :2, 2]
            by_noise[..., 0, 1], by_noise[..., 1, 1] = ahead, aside
            by_noise[..., :2, 2] = 0.5 * transition[..., :2, 2]
            by_noise[..., 2, [0, 2, 3]] = 1.0
            variance = np.empty((*shape, 4))
            variance[..., [0, 3]] = self.turn_noise_rad**2
            variance[..., 1] = self.advance_noise_m**2
            variance[..., 2] = (self.drift_noise_rad_per_m * advance_m) ** 2
            noise = (by_noise * variance[..., None, :]) @ np.swapaxes(by_noise, -1, -2)
        covariance = kalman.predict(mean, bank.covariance, transition, noise).covariance
        return Bank(mean, covariance, bank.log_weight)

    def _update(self, bank: Bank, fix_m: Array, area_m2: Array) -> Bank:
        """Correct all filters by the fixes [r, k, 2] of an epoch, by probabilistic data association."""
        # The longest epoch of all sets how many places there are; most epochs fill few of them.
        filled = np.flatnonzero(np.isfinite(fix_m[..., 0]).any(axis=0))
        fix_m = fix_m[:, : int(filled.max(initial=0)) + 1]
        there = np.isfinite(fix_m[:, None, :, 0])
        count = np.count_nonzero(there, axis=-1)
        innovation = np.where(there[..., None], fix_m[:, None] - bank.mean[..., None, :2], 0.0)
        noise = self.sigma_m**2 * np.eye(2)
        spread = bank.covariance[..., :2, :2] + noise
        log_density, _ = kalman.log_density(innovation, spread[..., None, :, :])
        # Relative to all fixes being clutter: the density of one, times the area, over the number of them.
        share = self.true_fix_share
        ratio = np.where(there, np.exp(log_density) * area_m2[:, None, None], 0.0)
        ratio *= share / np.maximum(count, 1)[..., None]
        evidence = 1.0 - share + _sum(ratio)
        belief = ratio / evidence[..., None]
        x, y = innovation[..., 0], innovation[..., 1]
        combined = np.stack([_sum(belief * x), _sum(belief * y)], axis=-1)
        update = kalman.update(bank.mean, bank.covariance, combined, _POSITION, noise)
        across = _sum(belief * (x * y))
        scatter = np.stack([_sum(belief * (x * x)), across, across, _sum(belief * (y * y))], axis=-1)
        scatter = scatter.reshape(*across.shape, 2, 2)
        scatter -= combined[..., :, None] * combined[..., None, :]
        none = ((1.0 - share) / evidence)[..., None, None]
        covariance = none * bank.covariance + (1.0 - none) * update.covariance
        covariance += update.gain @ scatter @ np.swapaxes(update.gain, -1, -2)
        heard = count > 0
        return Bank(
            np.where(heard[..., None], update.mean, bank.mean),
            np.where(heard[..., None, None], kalman.symmetric(covariance), bank.covariance),
            bank.log_weight + np.where(heard, np.log(evidence), 0.0),
        )


def _sum(values: Array) -> Array:
    """Add up the last axis one after the other, so that what fills it up leaves no trace."""
    total = values[..., 0].copy()
    for number in range(1, values.shape[-1]):
        total += values[..., number]
    return total
