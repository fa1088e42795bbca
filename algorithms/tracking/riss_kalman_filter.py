"""Extended Kalman filter over place, heading and sensor errors: a modern baseline for RISS with WiFi."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from algorithms.fingerprinting.reduced import Reduced
from positioning.errors import InputError, Reason, refusal
from positioning.filters import kalman
from positioning.filters.mixture import start_at_rest
from positioning.filters.plane import check_settings, check_stack, headings_missing, track_one
from positioning.fingerprint_fixes import cannot_fix, fingerprint_fixes
from positioning.inertial.riss import increments, move
from positioning.inertial.riss_readings import downsample, motion_missing
from positioning.model import Calibration, Recording, Site, Survey, Track


class RissKalmanFilter:
    """RISS and WiFi in an extended Kalman filter.

    See Bar-Shalom, Li & Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation",
    section 10.3; for sensor errors as states Groves (2013), "Principles of GNSS, Inertial, and Multisensor
    Integrated Navigation Systems", section 14.2. The motion is that of Atia et al., section 5.6. No fix is
    refused, however far it is off.

    Until the robot first moves, it stands at the mean of the fixes so far, as uncertain as one of them:
    fixes of one place share their error. These fixes are not taken a second time.

    Parameters
    ----------
    states
        3: x, y and heading; 5: also the bias of the gyroscope in motion and the scale of the odometer, which
        do not change during a recording.
    fingerprinting
        From scans to fixes; None takes the k nearest neighbours of equation 6 on the four access points of a
        fast orthogonal search.
    fix_sigma_m
        Standard deviation of a fix in each coordinate, metres; assumed.
    turn_noise_rad_per_sqrt_s
        Standard deviation of the heading after a second of motion; assumed, that of the particle filters.
    speed_noise
        Standard deviation of the distance between two epochs, as a share of it; assumed, that of the
        particle filters.
    bias_sigma_rad_per_s
        Standard deviation of the gyroscope's bias in motion, five states only; assumed, 0.1 degrees a second.
    scale_sigma
        Standard deviation of the odometer's scale, five states only; assumed.
    start_heading_sigma_rad
        Standard deviation of the noted start heading; assumed, that of the particle filters.
    downsampling
        Readings of gyroscope and odometer that are averaged to one, section 6.3.
    """

    def __init__(
        self,
        *,
        states: int = 5,
        fingerprinting: Any = None,
        fix_sigma_m: float = 3.0,
        turn_noise_rad_per_sqrt_s: float = 0.01,
        speed_noise: float = 0.1,
        bias_sigma_rad_per_s: float = 0.00175,
        scale_sigma: float = 0.1,
        start_heading_sigma_rad: float = 0.05,
        downsampling: int = 2,
    ) -> None:
        self.states = states
        self.fingerprinting = fingerprinting
        self.fix_sigma_m = fix_sigma_m
        self.turn_noise_rad_per_sqrt_s = turn_noise_rad_per_sqrt_s
        self.speed_noise = speed_noise
        self.bias_sigma_rad_per_s = bias_sigma_rad_per_s
        self.scale_sigma = scale_sigma
        self.start_heading_sigma_rad = start_heading_sigma_rad
        self.downsampling = downsampling

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Atia et al., section 5.6.
        """
        if reason := motion_missing(recording):
            return reason
        if headings_missing(recording):
            return Reason("the start heading was not recorded", "Give start_heading_rad")
        if not isinstance(survey, Survey) or np.ndim(survey.rss_dbm) == 3:
            return cannot_fix(self._fingerprinting(), survey, recording, site)
        return "" if recording.rss_dbm is not None else "the recording holds no received strengths"

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

        See Bar-Shalom et al. (2001), section 10.3.

        Parameters
        ----------
        recording
            Stack: epochs [r, n] with strengths [r, n, ap], readings of gyroscope and odometer [r, m], and
            start headings [r].
        survey
            Fingerprints, [r, p, ap].
        site
            Corners [r, 2, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``heading_rad`` [r, n], not wrapped, and with five states ``gyro_bias_rad_per_s`` and
            ``odometer_scale`` [r, n].

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        self._check()
        if reason := self.skip(recording, survey, site):
            raise refusal("recording and survey", reason)
        length = check_stack(recording, site, beacons=False)
        steps = increments(downsample(recording, factor=self.downsampling))
        fix_m = fingerprint_fixes(self._fingerprinting(), survey, recording)
        heading_rad = np.asarray(recording.start_heading_rad, dtype=np.float64)
        start = start_at_rest(
            recording.time_s,
            steps.moving,
            fix_m,
            np.asarray(cast(Survey, survey).position_m, dtype=np.float64),
            heading_rad=heading_rad,
            sigma_m=self.fix_sigma_m,
            heading_sigma_rad=self.start_heading_sigma_rad,
        )
        elapsed_s = np.nan_to_num(np.diff(recording.time_s, axis=1, prepend=recording.time_s[:, :1]))
        heard = np.isfinite(fix_m[..., 0])
        noise_m2 = self.fix_sigma_m**2 * np.eye(2)
        position_of_state = np.eye(2, self.states)
        count, epochs = recording.time_s.shape
        mean = np.zeros((count, self.states))
        mean[:, 2], mean[:, 4:] = heading_rad, 1.0
        deviation = np.array([0, 0, start.heading_sigma_rad, self.bias_sigma_rad_per_s, self.scale_sigma])
        covariance = np.tile(np.diag(deviation[: self.states] ** 2), (count, 1, 1))
        means = np.empty((count, epochs, self.states))
        covariance_m2 = np.empty((count, epochs, 2, 2))
        for epoch in range(epochs):
            step = move(
                mean,
                steps.turn_rad[:, epoch],
                steps.forward_m[:, epoch],
                steps.left_m[:, epoch],
                elapsed_s[:, epoch],
            )
            variance = np.full((count, 1, 2), self.speed_noise**2)
            variance[:, 0, 0] = self.turn_noise_rad_per_sqrt_s**2 * elapsed_s[:, epoch]
            noise = (step.by_noise * variance) @ np.swapaxes(step.by_noise, -1, -2)
            predicted = kalman.predict(mean, covariance, step.by_state, noise)
            told, rests = heard[:, epoch, None], start.resting[:, epoch]
            # No fix: the update changes no mean, and its covariance is not taken.
            innovation = np.where(told, fix_m[:, epoch] - step.state[:, :2], 0.0)
            update = kalman.update(step.state, predicted.covariance, innovation, position_of_state, noise_m2)
            corrected = np.where(told[..., None], update.covariance, predicted.covariance)
            mean = np.where(rests[:, None], mean, update.mean)
            covariance = np.where(rests[:, None, None], covariance, corrected)
            mean[rests, :2] = start.position_m[rests, epoch]
            covariance[rests, :2, :2] = start.sigma_m[rests, epoch, :, None] ** 2 * np.eye(2)
            means[:, epoch], covariance_m2[:, epoch] = mean, covariance[:, :2, :2]
        ended = np.arange(epochs) >= length[:, None]
        means[ended], covariance_m2[ended] = np.nan, np.nan
        names = ("heading_rad", "gyro_bias_rad_per_s", "odometer_scale")[: self.states - 2]
        return Track(
            time_s=recording.time_s,
            position_m=means[..., :2].copy(),
            covariance_m2=covariance_m2,
            extra={name: means[..., part].copy() for part, name in enumerate(names, start=2)},
        )

    def _fingerprinting(self) -> Any:
        return Reduced() if self.fingerprinting is None else self.fingerprinting

    def _check(self) -> None:
        if self.states not in (3, 5):
            raise InputError(f"states={self.states}", "it is neither 3 nor 5", "Correct the setting")
        check_settings(
            fix_sigma_m=(self.fix_sigma_m, 1e-6, 1e6),
            turn_noise_rad_per_sqrt_s=(self.turn_noise_rad_per_sqrt_s, 0, 1e3),
            speed_noise=(self.speed_noise, 0, 1e3),
            bias_sigma_rad_per_s=(self.bias_sigma_rad_per_s, 0, 1e3),
            # Beyond this, a scale of zero is not far away.
            scale_sigma=(self.scale_sigma, 0, 0.5),
            start_heading_sigma_rad=(self.start_heading_sigma_rad, 0, 1e3),
            downsampling=(self.downsampling, 1, 1e6),
        )
