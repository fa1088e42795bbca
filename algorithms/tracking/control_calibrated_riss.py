"""Control: dead reckoning after a perfect calibration of gyroscope and odometer."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from algorithms.tracking.riss import Riss
from positioning.errors import InputError, Reason, refusal
from positioning.filters.plane import check_settings, track_one, with_leading_axis
from positioning.inertial.riss_readings import downsample, first_rest, motion_missing
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth

_NEEDED = ("path_m", "heading_rad", "gyro_bias_rad_per_s", "odometer_scale")


class ControlCalibratedRiss:
    """The mechanisation for somebody who knows the start, the bias in motion and the odometer's scale.

    See Atia et al., Table 2, to which this row is added. What remains is the random walk of the gyroscope,
    the error that it leaves in the mean at rest, and the resolution of both sensors. The bias in motion is
    taken off from the end of the first rest on.

    Parameters
    ----------
    truth
        Start, bias and scale of the recordings that are tracked: with a leading axis for `track_stack`,
        without one for `track`.
    downsampling
        Readings of gyroscope and odometer that are averaged to one, section 6.3.
    """

    def __init__(self, *, truth: Truth | None = None, downsampling: int = 2) -> None:
        self.truth = truth
        self.downsampling = downsampling

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why there is no such track for these data; empty where there is one.

        See Atia et al., Table 2, to which this row is added.
        """
        if self.truth is None or any(getattr(self.truth, name) is None for name in _NEEDED):
            return Reason(
                "the true errors of gyroscope and odometer are known of synthetic worlds only",
                "Use it with synthetic worlds only",
            )
        return motion_missing(recording)

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        truth = None if self.truth is None else with_leading_axis(self.truth)
        tracker = ControlCalibratedRiss(truth=truth, downsampling=self.downsampling)
        return track_one(tracker, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings.

        See Atia et al., Table 2, to which this row is added.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of gyroscope and odometer [r, m].
        survey
            Not used.
        site
            Corners [r, 2, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            As that of `Riss`, whose covariance has no scale here.

        Raises
        ------
        InputError
            If the truth is not known, or for input that cannot be used.
        """
        check_settings(downsampling=(self.downsampling, 1, 1e6))
        reason = self.skip(recording, survey, site)
        if reason:
            raise refusal("control_calibrated_riss", reason)
        path_m, heading_rad, bias, scale = (
            np.asarray(getattr(self.truth, name), dtype=np.float64) for name in _NEEDED
        )
        shape = np.shape(recording.time_s)
        given = (path_m.shape, heading_rad.shape, bias.shape, scale.shape)
        if given != ((*shape, 2), shape, shape[:1], shape[:1]):
            raise InputError(
                "truth",
                f"the shapes of {', '.join(_NEEDED)} are {', '.join(map(str, given))} for epochs {shape}",
                "Give the control the truth of the recordings that it tracks",
            )
        slower = downsample(recording, factor=self.downsampling)
        time_s, gyro, odometer = (
            cast(Array, values)
            for values in (slower.motion_time_s, slower.gyro_rad_per_s, slower.odometer_m_per_s)
        )
        with np.errstate(invalid="ignore"):
            biased = time_s > first_rest(slower).end_s[:, None]
        calibrated = replace(
            slower,
            gyro_rad_per_s=gyro - np.where(biased, bias[:, None], 0.0),
            odometer_m_per_s=odometer / scale[:, None],
            start_position_m=path_m[:, 0],
            start_heading_rad=heading_rad[:, 0],
        )
        return Riss(downsampling=1, scale_sigma=0.0).track_stack(calibrated, survey, site, rngs)
