"""Particle filter over place and heading, fed with all fixes of an epoch."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from algorithms.ranging.curve_crossings import CurveCrossings
from algorithms.trilateration.iterative_fractional_printed import IterativeFractionalPrinted
from positioning.errors import InputError
from positioning.filters.particle_filter import gaussian_mixture_log_likelihood
from positioning.filters.plane import (
    MotionNoise,
    cannot_locate,
    check_locatable,
    check_settings,
    check_stack,
    filter_particles,
    headings_missing,
    track_one,
)
from positioning.fixes import locate
from positioning.model import Array, Calibration, Recording, Site, Survey, Track

FUSIONS = ("sum", "product", "least_residual")


class ParticleFilter:
    """Monte Carlo localization with the fixes of trilateration as measurements.

    See Raghavan et al., sections IV.C to IV.E. An epoch without a fix (fewer than three beacons heard, or
    strengths off the curve) is a prediction only.

    Parameters
    ----------
    particles
        Number of particles; not printed in the paper.
    fusion
        How the fixes of an epoch come together, which is not printed: "sum" of their Gaussians, "product",
        or the "least_residual" one alone.
    sigma_m
        Standard deviation of a fix in each coordinate, metres; not printed.
    resample_below
        Resample where the effective sample size is below this share of the particles; not printed.
    heading_known
        Whether the filter starts with the recorded heading; else with any heading.
    turn_noise_rad, advance_noise_m
        Standard deviation of each turn and of each translation; not printed.
    drift_noise_rad_per_m
        Standard deviation of the drift of the heading, per metre of a translation; not printed.
    walk_m_per_s
        Where no motion was recorded: standard deviation of each coordinate after a second of random walk.
    ranging
        From strengths to distances; None takes every crossing of the calibration curve.
    trilateration
        From distances to fixes; None takes the printed fractional iteration.
    """

    def __init__(
        self,
        *,
        particles: int = 500,
        fusion: str = "sum",
        sigma_m: float = 1.0,
        resample_below: float = 0.5,
        heading_known: bool = False,
        turn_noise_rad: float = 0.05,
        advance_noise_m: float = 0.05,
        drift_noise_rad_per_m: float = 0.05,
        walk_m_per_s: float = 1.0,
        ranging: Any = None,
        trilateration: Any = None,
    ) -> None:
        self.particles = particles
        self.fusion = fusion
        self.sigma_m = sigma_m
        self.resample_below = resample_below
        self.heading_known = heading_known
        self.turn_noise_rad = turn_noise_rad
        self.advance_noise_m = advance_noise_m
        self.drift_noise_rad_per_m = drift_noise_rad_per_m
        self.walk_m_per_s = walk_m_per_s
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

        See Raghavan et al., sections IV.C to IV.E.

        Parameters
        ----------
        recording
            Stack [r, n]; NaN in the times after the end of a recording.
        survey
            Calibration runs [r, m]; not used where the recording holds distances.
        site
            Corners [r, 2, 2] and beacons [r, ap, 2].
        rngs
            One generator a recording.

        Returns
        -------
        Track
            Weighted mean and covariance of the particles, with extra ``effective_sample_size`` [r, n] before
            resampling, and ``fixes`` [r, n], the number of fixes of each epoch.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        if self.fusion not in FUSIONS:
            raise InputError(
                f"fusion={self.fusion!r}", f"it must be one of {', '.join(FUSIONS)}", "Choose one of them"
            )
        check_settings(sigma_m=(self.sigma_m, 1e-6, 1e6))
        length = check_stack(recording, site)
        check_locatable(recording, survey, site)
        found = locate(
            self.ranging or CurveCrossings(),
            self.trilateration or IterativeFractionalPrinted(),
            cast(Calibration | None, survey),
            recording,
            site,
        )
        alone = self.fusion == "least_residual"
        fix_m = found.least_residual()[:, :, None, :] if alone else found.position_m
        fusion: Literal["sum", "product"] = "product" if self.fusion == "product" else "sum"

        def log_likelihood(rows: NDArray[np.intp], epoch: int, position_m: Array) -> Array:
            return gaussian_mixture_log_likelihood(position_m, fix_m[rows, epoch], self.sigma_m, fusion)

        track = filter_particles(
            recording,
            site,
            rngs,
            log_likelihood,
            particles=self.particles,
            noise=MotionNoise(
                self.turn_noise_rad, self.advance_noise_m, self.drift_noise_rad_per_m, self.walk_m_per_s
            ),
            heading_known=self.heading_known,
            resample_below=self.resample_below,
        )
        ended = np.arange(recording.time_s.shape[1]) >= length[:, None]
        fixes = np.where(ended, np.nan, found.count)
        return replace(track, extra={**track.extra, "fixes": fixes})
