"""Fast mixture particle filter: one weight for a cluster of predicted samples."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.tracking.riss_particle_filter import RissParticleFilter
from positioning.filters.mixture import Mixture
from positioning.model import Array


class RissFastMixtureFilter(RissParticleFilter):
    """A mixture particle filter that weighs clusters of predicted samples.

    See Atia et al., section 5.4. Boxes are cut at the median of their longer side; the mean of a cluster
    stands for its samples, each of which is given its weight. Samples about the fix are weighted one by one.

    Parameters
    ----------
    clusters
        Clusters of predicted samples, not printed; a fifth of ``particles`` saves 80 % of their weights, as
        the paper says.
    from_wifi
        Samples about the fix, as a share of the predicted ones; as in `RissMixtureFilter`.
    fix_sigma_m
        Their standard deviation in each coordinate, metres; as in `RissMixtureFilter`.
    weight_prediction, weight_wifi
        Factors A and B; as in `RissMixtureFilter`.
    particles, scale_m, turn_noise_rad_per_sqrt_s, distance_noise
        As in `RissParticleFilter`.
    start_sigma_m, start_heading_sigma_rad, scan_every, downsampling, fingerprinting
        As in `RissParticleFilter`.
    """

    def __init__(
        self,
        *,
        clusters: int = 200,
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
        self.clusters = clusters
        self.from_wifi = from_wifi
        self.fix_sigma_m = fix_sigma_m
        self.weight_prediction = weight_prediction
        self.weight_wifi = weight_wifi

    def mixture(self, time_s: Array, moving: NDArray[np.bool_]) -> Mixture:
        """Return how samples are mixed: predicted ones are weighted by clusters.

        See Atia et al., section 5.4. Parameters as in `RissParticleFilter.mixture`.
        """
        return Mixture(
            from_wifi=self.from_wifi,
            fix_sigma_m=self.fix_sigma_m,
            weight_prediction=self.weight_prediction,
            weight_wifi=self.weight_wifi,
            clusters=self.clusters,
        )
