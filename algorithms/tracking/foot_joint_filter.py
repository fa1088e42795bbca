"""WLAN fixes in the inertial filter of the foot itself: the filter that is not cascaded."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation
from algorithms.tracking.foot_cascaded_filter import (
    cannot_fuse,
    check_fusible,
    start_headings_rad,
    wlan_fixes,
)
from algorithms.tracking.foot_inertial import FootInertial, check_start, late_start, steps_so_far
from positioning.filters.plane import LEAST_VARIANCE_M2, check_settings, check_stack, track_one
from positioning.inertial.foot import Start
from positioning.inertial.foot_alignment import rests
from positioning.inertial.foot_checks import check_imu
from positioning.inertial.foot_plan import Fixes
from positioning.model import Array, Calibration, Recording, Site, Survey, Track

# Of each coordinate before the first fix: so wide that this fix is the start.
_UNKNOWN_M2 = 1e6


class FootJointFilter:
    """One filter for all: WLAN fixes correct the inertial navigation of the foot directly.

    See Frank et al., section 1, which says that the cascade loses little against it, without a figure. The
    navigation is that of `FootInertial`, in the frame of the site, and a fix is a measurement of the place of
    the foot. Its answer is the foot's place also within a step.

    It starts with the first fix, as uncertain as a fix is; until then its answer is the centre of the survey.
    The sensor's heading at the start is the noted one less the misalignment, which the first straight steps
    tell as for `FootCascadedFilter`. A magnetometer, where it is used, tells the heading later on. There is
    no noise of steps: the noise is that of the inertial readings, and a random walk of the heading in place
    of the bias of the gyroscope, which 9 states do not have. Without it the filter would trust its heading
    more and more and no longer listen to fixes: the cascade has such noise in that of a turn, and a
    comparison would be unfair. With 15 states the bias is one of them, and the walk is left out.

    Parameters
    ----------
    inertial
        The inertial filter; None takes `FootInertial` with its own settings.
    fingerprinting
        From scans to fixes; None takes the expected deviation of eq. 1.
    best_of_three
        Take the place that at least two of the last three fixes have, else the latest; section 2.
    sigma_wlan_m
        Standard deviation of a fix in each coordinate; assumed, as in `FootCascadedFilter`; None takes the
        errors with which each half of the survey locates the other.
    start_heading_sigma_rad
        Standard deviation of the noted heading; assumed, as in `FootCascadedFilter`.
    start_heading_error_rad
        Added to the noted heading, to see what a wrong one does.
    heading_noise_rad_per_rt_s
        Density of that random walk. After the 400 s of a walk it is as wide, 0.2 rad, as what a bias of
        0.0005 rad/s makes by then: that is the standard error of the bias after a rest of some 12 s, with a
        noise of 0.1 degrees a second. From the data sheet of the class of unit, assumed.
    """

    def __init__(
        self,
        *,
        inertial: Any = None,
        fingerprinting: Any = None,
        best_of_three: bool = True,
        sigma_wlan_m: float | None = 3.0,
        start_heading_sigma_rad: float = 0.5,
        start_heading_error_rad: float = 0.0,
        heading_noise_rad_per_rt_s: float = 0.01,
    ) -> None:
        self.inertial = inertial
        self.fingerprinting = fingerprinting
        self.best_of_three = best_of_three
        self.sigma_wlan_m = sigma_wlan_m
        self.start_heading_sigma_rad = start_heading_sigma_rad
        self.start_heading_error_rad = start_heading_error_rad
        self.heading_noise_rad_per_rt_s = heading_noise_rad_per_rt_s

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

        See Frank et al., sections 3.1 and 4.2.

        Parameters
        ----------
        recording
            Stack: epochs [r, n] with scans [r, n, ap], and readings of the inertial unit [r, i, 3].
        survey
            Fingerprints [r, p, ap] at places [r, p, 2].
        site
            Corners [r, 2, 2]; direction to magnetic north [r], where it is known.
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``heading_rad`` [r, n], of the pedestrian and not wrapped, and ``steps`` [r, n], their
            number so far.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(
            start_heading_sigma_rad=(self.start_heading_sigma_rad, 0, 1e3),
            start_heading_error_rad=(self.start_heading_error_rad, -1e3, 1e3),
            heading_noise_rad_per_rt_s=(self.heading_noise_rad_per_rt_s, 0, 1e3),
        )
        check_fusible(self._fingerprinting(), recording, survey, site)
        check_start(recording, self.inertial)
        length = check_stack(recording, site, beacons=False)
        fixes = wlan_fixes(
            self._fingerprinting(), recording, survey, vote=self.best_of_three, sigma_m=self.sigma_wlan_m
        )
        inertial = FootInertial() if self.inertial is None else self.inertial
        check_imu(recording)
        rest = rests(recording, inertial.settings())
        misalignment_rad = inertial.beginning_rad(recording, site, rest)
        count, epochs = np.shape(recording.time_s)
        start = Start(
            position_m=fixes.centre_m,
            covariance_m2=np.tile(_UNKNOWN_M2 * np.eye(2), (count, 1, 1)),
            heading_rad=start_headings_rad(recording, self.start_heading_error_rad) - misalignment_rad,
            heading_error_rad=np.full(count, self.start_heading_sigma_rad),
        )
        each_m2 = np.broadcast_to(fixes.covariance_m2[:, None], (count, epochs, 2, 2))
        joined = inertial.navigation(
            recording,
            site,
            rest=rest,
            fixes=Fixes(fixes.fix_m, each_m2),
            start=start,
            heading_noise_rad_per_rt_s=0.0 if inertial.states == 15 else self.heading_noise_rad_per_rt_s,
        )
        # A fix before the first reading counts with it, and so does the answer there.
        state = joined.at(np.maximum(recording.time_s, joined.time_s[:, :1]))
        started = np.logical_or.accumulate(np.isfinite(fixes.fix_m[..., 0]), axis=1)
        position_m = np.where(started[..., None], state.position_m[..., :2], fixes.centre_m[:, None])
        own_m2 = state.position_covariance_m2 + LEAST_VARIANCE_M2 * np.eye(2)
        covariance_m2 = np.where(started[..., None, None], own_m2, fixes.spread_m2[:, None])
        heading_rad = _unwrapped(state.heading_rad + misalignment_rad[:, None])
        ended = np.arange(epochs) >= length[:, None]
        position_m[ended], covariance_m2[ended], heading_rad[ended] = np.nan, np.nan, np.nan
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={
                "heading_rad": heading_rad,
                "steps": steps_so_far(inertial.steps(joined), recording.time_s),
            },
        )

    def _fingerprinting(self) -> Any:
        return ExpectedDeviation() if self.fingerprinting is None else self.fingerprinting


def _unwrapped(heading_rad: Array) -> Array:
    """Return headings [r, n] without jumps of a whole turn; NaN stays at the end."""
    return np.asarray(np.unwrap(heading_rad, axis=1))
