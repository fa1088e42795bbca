"""Dead reckoning with one gyroscope and an odometer: the RISS of the paper, without WiFi."""

from collections.abc import Sequence

import numpy as np

from positioning.errors import Reason, refusal
from positioning.filters import kalman
from positioning.filters.plane import (
    LEAST_VARIANCE_M2,
    check_settings,
    check_stack,
    headings_missing,
    track_one,
)
from positioning.inertial.earth import EARTH_RATE_RAD_PER_S
from positioning.inertial.riss import Increments, increments, mechanise, move
from positioning.inertial.riss_readings import Rest, downsample, first_rest, motion_missing, readings
from positioning.model import Array, Calibration, Recording, Site, Survey, Track


class Riss:
    """The mechanisation alone, from the noted start place and heading.

    See Atia et al., section 2 and Table 2. The gyroscope's mean at the first rest is taken off, which holds
    the earth rate; without a rest the earth rate alone is. No other row may use the noted place.

    The covariance is what the sensors' data sheets promise, by linear propagation: random walk of the
    gyroscope, its bias as uncertain as the calibration at rest leaves it, and the scale of the odometer.
    A bias that comes with the motion is not in it.

    Parameters
    ----------
    downsampling
        Readings of gyroscope and odometer that are averaged to one, section 6.3.
    latitude_deg
        Of the start; that of Kingston.
    turn_noise_rad_per_sqrt_s
        Random walk of the gyroscope, for the covariance: 1.9 degrees per root of an hour, Table 1.
    bias_sigma_rad_per_s
        Standard deviation of the gyroscope's bias before a rest, for the covariance: 3 degrees a second,
        Table 1.
    scale_sigma
        Standard deviation of the odometer's scale, for the covariance; assumed after the 118.8 m that it
        reads for 110.5 m.
    """

    def __init__(
        self,
        *,
        downsampling: int = 2,
        latitude_deg: float = 44.23,
        turn_noise_rad_per_sqrt_s: float = 0.00055,
        bias_sigma_rad_per_s: float = 0.052,
        scale_sigma: float = 0.1,
    ) -> None:
        self.downsampling = downsampling
        self.latitude_deg = latitude_deg
        self.turn_noise_rad_per_sqrt_s = turn_noise_rad_per_sqrt_s
        self.bias_sigma_rad_per_s = bias_sigma_rad_per_s
        self.scale_sigma = scale_sigma

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Atia et al., section 2.
        """
        if reason := motion_missing(recording):
            return reason
        if headings_missing(recording):
            return Reason("the start heading was not recorded", "Give start_heading_rad")
        if recording.start_position_m is None or np.isnan(recording.start_position_m).any():
            return Reason("the start place was not recorded", "Give start_position_m")
        return ""

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
        """Track a stack of recordings.

        See Atia et al., eqs. 1 to 5.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of gyroscope and odometer [r, m], start place and heading.
        survey
            Not used.
        site
            Corners [r, 2, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``heading_rad`` [r, n], not wrapped.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(
            downsampling=(self.downsampling, 1, 1e6),
            latitude_deg=(self.latitude_deg, -89, 89),
            turn_noise_rad_per_sqrt_s=(self.turn_noise_rad_per_sqrt_s, 1e-12, 1e3),
            bias_sigma_rad_per_s=(self.bias_sigma_rad_per_s, 1e-12, 1e3),
            scale_sigma=(self.scale_sigma, 0, 1e3),
        )
        if reason := self.skip(recording, survey, site):
            raise refusal("recording", reason)
        check_stack(recording, site, beacons=False)
        slower = downsample(recording, factor=self.downsampling)
        rest, read = first_rest(slower), readings(slower)
        way = mechanise(
            # Dead reckoning begins at the first epoch, whose place was noted.
            np.maximum(read.edge_s, recording.time_s[:, :1]),
            read.gyro_rad_per_s - rest.gyro_rad_per_s[:, None],
            read.speed_m_per_s,
            azimuth_rad=0.5 * np.pi - np.asarray(recording.start_heading_rad, dtype=np.float64),
            latitude_rad=np.deg2rad(self.latitude_deg),
            earth_rate_rad_per_s=np.where(rest.duration_s > 0, 0.0, EARTH_RATE_RAD_PER_S),
        )
        azimuth, east_m, north_m = (
            np.take_along_axis(values, read.epoch, axis=1)
            for values in (way.azimuth_rad, way.east_m, way.north_m)
        )
        ended = np.isnan(recording.time_s)
        start_m = np.asarray(recording.start_position_m, dtype=np.float64)
        position_m = start_m[:, None] + np.stack([east_m, north_m], axis=-1)
        covariance_m2 = self._covariance(slower, increments(slower), rest)
        position_m[ended], covariance_m2[ended] = np.nan, np.nan
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"heading_rad": np.where(ended, np.nan, 0.5 * np.pi - azimuth)},
        )

    def _covariance(self, recording: Recording, steps: Increments, rest: Rest) -> Array:
        """Propagate the covariance of x, y, heading, bias and scale; return that of x and y, [r, n, 2, 2]."""
        count, epochs = recording.time_s.shape
        state, covariance = np.zeros((count, 5)), np.zeros((count, 5, 5))
        state[:, 2], state[:, 4] = recording.start_heading_rad, 1.0
        # A Gaussian bias, seen through the random walk for as long as the rest lasts.
        variance = self.turn_noise_rad_per_sqrt_s**2
        covariance[:, 3, 3] = 1 / (self.bias_sigma_rad_per_s**-2 + rest.duration_s / variance)
        covariance[:, 4, 4] = self.scale_sigma**2
        moved = np.logical_or.accumulate(steps.moving, axis=1)
        elapsed_s = np.diff(recording.time_s, axis=1, prepend=recording.time_s[:, :1])
        # In the first rest errors of readings and of their mean cancel.
        driven_s = np.where(moved & ~np.isnan(elapsed_s), elapsed_s, 0.0)
        found = np.empty((count, epochs, 2, 2))
        for epoch in range(epochs):
            step = move(
                state,
                steps.turn_rad[:, epoch],
                steps.forward_m[:, epoch],
                steps.left_m[:, epoch],
                driven_s[:, epoch],
            )
            by_turn = step.by_noise[..., :1]
            noise = (variance * driven_s[:, epoch])[:, None, None] * by_turn @ np.swapaxes(by_turn, -1, -2)
            covariance = kalman.predict(state, covariance, step.by_state, noise).covariance
            state = step.state
            found[:, epoch] = covariance[:, :2, :2] + LEAST_VARIANCE_M2 * np.eye(2)
        return found
