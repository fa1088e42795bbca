"""Steps of a foot-mounted inertial unit and WLAN fixes in a particle filter."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation
from algorithms.tracking.foot_cascaded_filter import (
    Round,
    cannot_fuse,
    check_fusible,
    rounds_until,
    start_headings_rad,
    wlan_fixes,
)
from algorithms.tracking.foot_inertial import late_start, steps_of, steps_so_far
from positioning.filters import particle_filter
from positioning.filters.plane import LEAST_VARIANCE_M2, check_settings, check_stack, track_one
from positioning.filters.resampling import effective_sample_size, systematic
from positioning.model import Array, Calibration, Recording, Site, Survey, Track


class FootParticleFilter:
    """The paper's steps and fixes with samples in place of a Gaussian.

    See Frank et al., section 6, which names particle filters as further work, and eqs. 8 to 12 for the
    motion and the measurement; Arulampalam et al. (2002) for the filter. Steps, fixes, their noise and the
    start are those of `FootCascadedFilter`, so that only the linearisation and the Gaussian are missing.

    Parameters
    ----------
    inertial
        The inertial filter and its step sensor; None takes `FootInertial` with its own settings.
    fingerprinting
        From scans to fixes; None takes the expected deviation of eq. 1.
    best_of_three
        Take the place that at least two of the last three fixes have, else the latest; section 2.
    particles
        Number of samples; assumed.
    resample_below
        Resample where the effective sample size is below this share of the particles.
    sigma_step_m
        Standard deviation of a step in each coordinate; assumed, as in `FootCascadedFilter`.
    sigma_heading_rad
        Standard deviation of the turn of a step; assumed, as in `FootCascadedFilter`.
    sigma_wlan_m
        Standard deviation of a fix in each coordinate; assumed, as in `FootCascadedFilter`; None takes the
        errors with which each half of the survey locates the other.
    start_heading_sigma_rad
        Standard deviation of the noted heading; assumed, as in `FootCascadedFilter`.
    start_heading_error_rad
        Added to the noted heading, to see what a wrong one does.
    """

    takes_steps = True
    """A row of it may build on the steps of another row, with the key ``steps``."""

    def __init__(
        self,
        *,
        inertial: Any = None,
        fingerprinting: Any = None,
        best_of_three: bool = True,
        particles: int = 1000,
        resample_below: float = 0.5,
        sigma_step_m: float = 0.1,
        sigma_heading_rad: float = 0.02,
        sigma_wlan_m: float | None = 3.0,
        start_heading_sigma_rad: float = 0.5,
        start_heading_error_rad: float = 0.0,
    ) -> None:
        self.inertial = inertial
        self.fingerprinting = fingerprinting
        self.best_of_three = best_of_three
        self.particles = particles
        self.resample_below = resample_below
        self.sigma_step_m = sigma_step_m
        self.sigma_heading_rad = sigma_heading_rad
        self.sigma_wlan_m = sigma_wlan_m
        self.start_heading_sigma_rad = start_heading_sigma_rad
        self.start_heading_error_rad = start_heading_error_rad

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Frank et al., section 4.
        """
        reason = cannot_fuse(self._fingerprinting(), recording, survey, site)
        return reason or late_start(recording, self.inertial)

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

        See Frank et al., eqs. 8 to 12.

        Parameters
        ----------
        recording
            Stack: epochs [r, n] with scans [r, n, ap], and readings of the inertial unit [r, i, 3].
        survey
            Fingerprints [r, p, ap] at places [r, p, 2].
        site
            Corners [r, 2, 2].
        rngs
            One generator a recording.

        Returns
        -------
        Track
            Weighted mean and covariance before resampling, with extra ``heading_rad`` [r, n], not wrapped,
            ``steps`` [r, n], their number so far, and ``effective_sample_size`` [r, n].

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(
            particles=(self.particles, 1, 1e9),
            resample_below=(self.resample_below, 0, 1),
            sigma_step_m=(self.sigma_step_m, 0, 1e6),
            sigma_heading_rad=(self.sigma_heading_rad, 0, 1e3),
            start_heading_sigma_rad=(self.start_heading_sigma_rad, 0, 1e3),
            start_heading_error_rad=(self.start_heading_error_rad, -1e3, 1e3),
        )
        check_fusible(self._fingerprinting(), recording, survey, site)
        length = check_stack(recording, site, beacons=False)
        fixes = wlan_fixes(
            self._fingerprinting(), recording, survey, vote=self.best_of_three, sigma_m=self.sigma_wlan_m
        )
        steps = steps_of(recording, site, self.inertial)

        time_s = recording.time_s
        count, epochs = time_s.shape
        heard, started = np.isfinite(fixes.fix_m[..., 0]), np.zeros(count, dtype=bool)
        root_m: Array = np.asarray(np.linalg.cholesky(fixes.covariance_m2), dtype=np.float64)
        deviation = np.array([self.sigma_step_m, self.sigma_step_m, self.sigma_heading_rad])
        state = particle_filter.empty_states(count, self.particles, 3)
        draws = particle_filter.standard_normal(rngs, (3, self.particles))
        state[..., :2] = 0.0
        heading_rad = start_headings_rad(recording, self.start_heading_error_rad)
        state[..., 2] = heading_rad[:, None] + self.start_heading_sigma_rad * draws[:, 2]
        weight = np.full((count, self.particles), 1.0 / self.particles)
        means, covariance_m2 = np.empty((count, epochs, 3)), np.empty((count, epochs, 2, 2))
        effective = np.empty((count, epochs))
        for epoch, rounds in enumerate(rounds_until(steps, time_s)):
            for step in rounds:
                rows = step.recording
                normal = particle_filter.standard_normal([rngs[row] for row in rows], (3, self.particles))
                _move(state, started, step, deviation, normal)
            first = np.flatnonzero(heard[:, epoch] & ~started)
            for axis in range(2):
                offset_m = np.sum(root_m[first, axis, :, None] * draws[first, :2], axis=1)
                state[first, :, axis] = fixes.fix_m[first, epoch, axis, None] + offset_m
            rows = np.flatnonzero(heard[:, epoch] & started)
            started[first] = True
            if len(rows):
                away_m = state[rows, :, :2] - fixes.fix_m[rows, epoch, None]
                weight[rows] = particle_filter.reweight(weight[rows], _log_density(away_m, root_m[rows]))
            means[:, epoch] = particle_filter.weighted_mean(state, weight)
            spread_m2 = particle_filter.weighted_covariance(state[..., :2], weight)
            covariance_m2[:, epoch] = spread_m2 + LEAST_VARIANCE_M2 * np.eye(2)
            means[~started, epoch, :2] = fixes.centre_m[~started]
            covariance_m2[~started, epoch] = fixes.spread_m2[~started]
            effective[:, epoch] = effective_sample_size(weight)
            _resample(state, weight, self.resample_below, rngs)
        ended = np.arange(epochs) >= length[:, None]
        for values in (means, covariance_m2, effective):
            values[ended] = np.nan
        return Track(
            time_s=time_s,
            position_m=means[..., :2].copy(),
            covariance_m2=covariance_m2,
            extra={
                "heading_rad": means[..., 2].copy(),
                "steps": steps_so_far(steps, time_s),
                "effective_sample_size": effective,
            },
        )

    def _fingerprinting(self) -> Any:
        return ExpectedDeviation() if self.fingerprinting is None else self.fingerprinting


def _move(
    state: Array,
    started: NDArray[np.bool_],
    step: Round,
    deviation: Array,
    normal: Array,
) -> None:
    """Move the particles of some recordings by a step with noise, in place; eqs. 9 and 10."""
    rows = step.recording
    heading_rad = state[rows, :, 2]
    sine, cosine = np.sin(heading_rad), np.cos(heading_rad)
    forward_m, left_m = step.forward_m[:, None], step.left_m[:, None]
    # Where nothing is known of the place yet, a step leaves it so.
    known = started[rows, None]
    x_m = cosine * forward_m - sine * left_m + deviation[0] * normal[:, 0]
    y_m = sine * forward_m + cosine * left_m + deviation[1] * normal[:, 1]
    state[rows, :, 0] += np.where(known, x_m, 0.0)
    state[rows, :, 1] += np.where(known, y_m, 0.0)
    state[rows, :, 2] = heading_rad + (step.turn_rad[:, None] + deviation[2] * normal[:, 2])


def _log_density(away_m: Array, root_m: Array) -> Array:
    """Return the logarithm of a Gaussian density without its constant, [m, p].

    Parameters
    ----------
    away_m
        From the mean, [m, p, 2], metres.
    root_m
        Lower triangular root of the covariance, [m, 2, 2], metres.
    """
    first = away_m[..., 0] / root_m[:, 0, 0, None]
    second = (away_m[..., 1] - root_m[:, 1, 0, None] * first) / root_m[:, 1, 1, None]
    return np.asarray(-0.5 * (first * first + second * second))


def _resample(state: Array, weight: Array, share: float, rngs: Sequence[np.random.Generator]) -> None:
    """Resample, in place and systematically, the recordings whose effective sample size is too small."""
    particles = weight.shape[-1]
    rows = np.flatnonzero(effective_sample_size(weight) < share * particles)
    if len(rows):
        draws = particle_filter.uniform([rngs[int(row)] for row in rows], (1,))[:, 0]
        state[rows] = particle_filter.select(state[rows], systematic(weight[rows], draws))
        weight[rows] = 1.0 / particles
