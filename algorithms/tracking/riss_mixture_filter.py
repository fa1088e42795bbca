"""Mixture particle filter: part of the samples come from the fix."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.tracking.riss_particle_filter import RissParticleFilter
from positioning.filters.mixture import Mixture
from positioning.model import Array


class RissMixtureFilter(RissParticleFilter):
    """A particle filter that adds samples about each WiFi fix to the predicted ones.

    See Atia et al., section 5.3. A sample about the fix is weighted by its distance to the mean of the
    predicted samples, where the printed formula would give all of them the same weight, and has the heading
    of a predicted one. All weights are normalised together, and as many samples are kept as were predicted.

    Parameters
    ----------
    from_wifi
        Samples about the fix, as a share of the predicted ones; not printed.
    fix_sigma_m
        Their standard deviation in each coordinate, metres; not printed.
    weight_prediction, weight_wifi
        Factors A and B; not printed for this section.
    particles, scale_m, turn_noise_rad_per_sqrt_s, distance_noise
        As in `RissParticleFilter`.
    start_sigma_m, start_heading_sigma_rad, scan_every, downsampling, fingerprinting
        As in `RissParticleFilter`.
    """

    def __init__(
        self,
        *,
        from_wifi: float = 0.2,
        fix_sigma_m: float = 2.0,
        weight_prediction: float = 0.5,
        weight_wifi: float = 0.5,
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
        self.from_wifi = from_wifi
        self.fix_sigma_m = fix_sigma_m
        self.weight_prediction = weight_prediction
        self.weight_wifi = weight_wifi

    def mixture(self, time_s: Array, moving: NDArray[np.bool_]) -> Mixture:
        """Return how samples are mixed: part of them come from the fix.

        See Atia et al., section 5.3. Parameters as in `RissParticleFilter.mixture`.
        """
        return Mixture(
            from_wifi=self.from_wifi,
            fix_sigma_m=self.fix_sigma_m,
            weight_prediction=self.weight_prediction,
            weight_wifi=self.weight_wifi,
        )
