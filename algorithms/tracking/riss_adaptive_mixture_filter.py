"""Adaptive fast mixture particle filter: trust moves from the motion to the fix while driving."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.tracking.riss_particle_filter import RissParticleFilter
from positioning.filters.mixture import Mixture, motion_weights
from positioning.model import Array


class RissAdaptiveMixtureFilter(RissParticleFilter):
    """A fast mixture particle filter whose factors A and B depend on the time since the last stop.

    See Atia et al., section 5.5: A above B at the start and for some seconds of motion after each stop, then
    a linear ramp to B above A. This is the filter of Table 2.

    Parameters
    ----------
    near, far
        A and B before and after the ramp; the paper prints no value, these are assumed.
    hold_s, ramp_s
        Seconds of motion until the ramp begins, and its length; assumed: the paper says a few seconds.
    clusters
        Clusters of predicted samples, as in `RissFastMixtureFilter`; None weighs every sample.
    from_wifi
        Samples about the fix, as a share of the predicted ones; as in `RissMixtureFilter`.
    fix_sigma_m
        Their standard deviation in each coordinate, metres; as in `RissMixtureFilter`.
    particles, scale_m, turn_noise_rad_per_sqrt_s, distance_noise
        As in `RissParticleFilter`.
    start_sigma_m, start_heading_sigma_rad, scan_every, downsampling, fingerprinting
        As in `RissParticleFilter`.
    """

    def __init__(
        self,
        *,
        near: tuple[float, float] = (0.8, 0.2),
        far: tuple[float, float] = (0.3, 0.7),
        hold_s: float = 3.0,
        ramp_s: float = 7.0,
        clusters: int | None = 200,
        from_wifi: float = 0.2,
        fix_sigma_m: float = 2.0,
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
        super().__init__(
            particles=particles,
            scale_m=scale_m,
            turn_noise_rad_per_sqrt_s=turn_noise_rad_per_sqrt_s,
            distance_noise=distance_noise,
            start_sigma_m=start_sigma_m,
            start_heading_sigma_rad=start_heading_sigma_rad,
            scan_every=scan_every,
            downsampling=downsampling,
            fingerprinting=fingerprinting,
        )
        self.near = near
        self.far = far
        self.hold_s = hold_s
        self.ramp_s = ramp_s
        self.clusters = clusters
        self.from_wifi = from_wifi
        self.fix_sigma_m = fix_sigma_m

    def mixture(self, time_s: Array, moving: NDArray[np.bool_]) -> Mixture:
        """Return how samples are mixed: factors depend on the time since the last stop.

        See Atia et al., section 5.5. Parameters as in `RissParticleFilter.mixture`.
        """
        prediction, wifi = motion_weights(
            time_s,
            moving,
            near=self.near,
            far=self.far,
            hold_s=self.hold_s,
            ramp_s=self.ramp_s,
        )
        return Mixture(
            from_wifi=self.from_wifi,
            fix_sigma_m=self.fix_sigma_m,
            weight_prediction=prediction,
            weight_wifi=wifi,
            clusters=self.clusters,
        )
