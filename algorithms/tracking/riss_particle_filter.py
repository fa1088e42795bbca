"""Particle filter over place and heading: samples of the motion, weighted by their distance to the fix."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.fingerprinting.reduced import Reduced
from positioning.errors import refusal
from positioning.filters.mixture import Drive, Mixture, SystemNoise, filter_drive, start_at_rest
from positioning.filters.plane import check_settings, check_stack, track_one, with_leading_axis
from positioning.fingerprint_fixes import cannot_fix, fingerprint_fixes
from positioning.inertial.riss import increments
from positioning.inertial.riss_readings import downsample, motion_missing
from positioning.model import Array, Calibration, Recording, Site, Survey, Track


class RissParticleFilter:
    """RISS and WiFi in a particle filter.

    See Atia et al., sections 5.2 and 5.6. Until the robot first moves, the samples lie about the mean of the
    WiFi fixes so far.

    Parameters
    ----------
    particles
        Number of samples; not printed in the paper.
    scale_m
        Metres in which a weight falls to 1/e; 1 is the printed formula.
    turn_noise_rad_per_sqrt_s
        Standard deviation of the heading after a second of motion; not printed. The value assumed makes in a
        minute what an unmodelled bias of 0.1 degrees a second makes.
    distance_noise
        Standard deviation of a distance, as a share of it; not printed. Assumed after the paper's odometer,
        which reads 118.8 for 110.5 metres.
    start_sigma_m, start_heading_sigma_rad
        Standard deviations of the start in each coordinate and in heading; not printed. A heading that
        nobody noted may be any.
    scan_every
        Use every k-th fix only.
    downsampling
        Samples of gyroscope and odometer that are averaged to one, as in section 6.3.
    fingerprinting
        From strengths to fixes; None takes the k nearest neighbours of equation 6 on four access points
        that a fast orthogonal search selects.
    """

    def __init__(
        self,
        *,
        particles: int = 1000,
        scale_m: float = 1.0,
        turn_noise_rad_per_sqrt_s: float = 0.01,
        distance_noise: float = 0.1,
        start_sigma_m: float = 2.0,
        start_heading_sigma_rad: float = 0.05,
        scan_every: int = 1,
        downsampling: int = 2,
        fingerprinting: Any = None,
    ) -> None:
        self.particles = particles
        self.scale_m = scale_m
        self.turn_noise_rad_per_sqrt_s = turn_noise_rad_per_sqrt_s
        self.distance_noise = distance_noise
        self.start_sigma_m = start_sigma_m
        self.start_heading_sigma_rad = start_heading_sigma_rad
        self.scan_every = scan_every
        self.downsampling = downsampling
        self.fingerprinting = fingerprinting

    def mixture(self, time_s: Array, moving: NDArray[np.bool_]) -> Mixture:
        """Return how samples are mixed and weighted: here all are predicted.

        See Atia et al., section 5.2; sections 5.3 to 5.5 change this alone.

        Parameters
        ----------
        time_s, moving
            Epochs, seconds, and whether there was motion since the one before, [r, n].
        """
        return Mixture()

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Atia et al., section 5.6.
        """
        if np.ndim(recording.time_s) == 1 and survey is not None:
            survey, site = with_leading_axis(survey), with_leading_axis(site)
        return motion_missing(recording) or cannot_fix(self._algorithm(), survey, recording, site)

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

        See Atia et al., section 5.6.

        Parameters
        ----------
        recording
            Stack: epochs [r, n] with strengths [r, n, ap], and readings of gyroscope and odometer [r, m].
        survey
            Fingerprints, [r, p, ap].
        site
            Corners, [r, 2, 2].
        rngs
            One generator a recording.

        Returns
        -------
        Track
            Weighted mean and covariance of the samples, with extra ``effective_sample_size`` [r, n] before
            resampling, ``weight_evaluations`` [r, n], and the factors ``weight_prediction`` and
            ``weight_wifi`` [r, n].

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(
            particles=(self.particles, 1, 1e9),
            start_sigma_m=(self.start_sigma_m, 0, 1e6),
            start_heading_sigma_rad=(self.start_heading_sigma_rad, 0, 1e6),
            scan_every=(self.scan_every, 1, 1e9),
            downsampling=(self.downsampling, 1, 1e6),
        )
        reason = self.skip(recording, survey, site)
        if reason or not isinstance(survey, Survey):
            raise refusal("recording and survey", reason)
        length = check_stack(recording, site, beacons=False)
        steps = increments(downsample(recording, factor=self.downsampling))
        mixture = self.mixture(recording.time_s, steps.moving)
        fix_m = _thinned(fingerprint_fixes(self._algorithm(), survey, recording), self.scan_every)
        heading_rad = recording.start_heading_rad
        start = start_at_rest(
            recording.time_s,
            steps.moving,
            fix_m,
            survey.position_m,
            heading_rad=np.full(len(length), np.nan) if heading_rad is None else heading_rad,
            sigma_m=self.start_sigma_m,
            heading_sigma_rad=self.start_heading_sigma_rad,
        )
        return filter_drive(
            Drive(recording.time_s, steps.turn_rad, steps.forward_m, steps.left_m, fix_m, start),
            rngs,
            particles=self.particles,
            scale_m=self.scale_m,
            noise=SystemNoise(self.turn_noise_rad_per_sqrt_s, self.distance_noise),
            mixture=mixture,
        )

    def _algorithm(self) -> Any:
        return Reduced() if self.fingerprinting is None else self.fingerprinting


def _thinned(fix_m: Array, every: int) -> Array:
    number = np.cumsum(np.isfinite(fix_m).all(axis=-1), axis=1)
    return np.where((number % every == 1 % every)[..., None], fix_m, np.nan)
