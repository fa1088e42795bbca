"""Control: the inertial filter for somebody who knows when the foot stands."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.tracking.foot_cascaded_filter import FootCascadedFilter
from algorithms.tracking.foot_inertial import FootInertial, reckon, start_missing
from positioning.errors import InputError
from positioning.filters.plane import check_stack, track_one, with_leading_axis
from positioning.inertial.foot_checks import check_imu
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth


class ControlKnownStances:
    """The inertial filter with the true stances in place of a detector.

    See Frank et al., section 3.2, whose detection of rest this leaves no error of. Where there is a survey,
    its steps are joined with WLAN as `FootCascadedFilter` does; where there is none, they make their way from
    the noted place and heading as those of `FootInertial` do.

    Parameters
    ----------
    truth
        Stances of the recordings that are tracked: with a leading axis for `track_stack`, without one for
        `track`.
    inertial
        The inertial filter, whose detector is not used; None takes `FootInertial` with 9 states.
    fingerprinting
        From scans to fixes; None takes the expected deviation of eq. 1.
    best_of_three
        Take the place that at least two of the last three fixes have, else the latest; section 2.
    sigma_step_m, sigma_heading_rad, sigma_wlan_m, start_heading_sigma_rad
        Standard deviations, as in `FootCascadedFilter`.
    """

    def __init__(
        self,
        *,
        truth: Truth | None = None,
        inertial: Any = None,
        fingerprinting: Any = None,
        best_of_three: bool = True,
        sigma_step_m: float = 0.1,
        sigma_heading_rad: float = 0.02,
        sigma_wlan_m: float | None = 3.0,
        start_heading_sigma_rad: float = 0.5,
    ) -> None:
        self.truth = truth
        self.inertial = inertial
        self.fingerprinting = fingerprinting
        self.best_of_three = best_of_three
        self.sigma_step_m = sigma_step_m
        self.sigma_heading_rad = sigma_heading_rad
        self.sigma_wlan_m = sigma_wlan_m
        self.start_heading_sigma_rad = start_heading_sigma_rad

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why there is no such track for these data; empty where there is one.

        See Frank et al., section 3.2.
        """
        if self.truth is None or self.truth.stance_time_s is None:
            return "the true stances are known of synthetic worlds only"
        # Reasons of the inertial filter include its detector, which is not used here.
        if isinstance(survey, Survey):
            return self._fusion().cannot_fuse(recording, survey, site)
        return start_missing(recording)

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        tracker = ControlKnownStances(
            **vars(self) | {"truth": None if self.truth is None else with_leading_axis(self.truth)}
        )
        return track_one(tracker, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings.

        See Frank et al., sections 3.2 and 4.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of the inertial unit [r, i, 3].
        survey
            Fingerprints [r, p, ap] at places [r, p, 2], or None.
        site
            Corners [r, 2, 2]; direction to magnetic north [r], where it is known.
        rngs
            Not used.

        Returns
        -------
        Track
            As that of `FootCascadedFilter` or `FootInertial`.

        Raises
        ------
        InputError
            If the stances are not known, or for input that cannot be used.
        """
        reason = self.skip(recording, survey, site)
        if reason or self.truth is None or self.truth.stance_time_s is None:
            raise InputError("control_known_stances", reason, "Use it with synthetic worlds only")
        check_stack(recording, site, beacons=False)
        check_imu(recording)
        imu_time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
        rest = standing(np.asarray(self.truth.stance_time_s, dtype=np.float64), imu_time_s)
        inertial = self._inertial()
        navigation = inertial.navigation(recording, site, rest=rest)
        if isinstance(survey, Survey):
            return self._fusion().fuse(recording, survey, site, navigation)
        return reckon(recording, inertial, navigation)

    def _inertial(self) -> Any:
        return FootInertial() if self.inertial is None else self.inertial

    def _fusion(self) -> FootCascadedFilter:
        own = {name: value for name, value in vars(self).items() if name not in ("truth", "inertial")}
        return FootCascadedFilter(inertial=self._inertial(), **own)


def standing(stance_time_s: Array, imu_time_s: Array) -> NDArray[np.bool_]:
    """Return at which readings a foot stands, [r, i].

    See Frank et al., section 3.2.

    Parameters
    ----------
    stance_time_s
        Begin and end of each stance in their order, [r, s, 2], seconds; NaN fills up.
    imu_time_s
        Ends of the readings' intervals, [r, i], seconds; NaN fills up.

    Raises
    ------
    InputError
        For shapes that do not fit, or stances that are not in order.
    """
    count = len(imu_time_s)
    if stance_time_s.ndim != 3 or stance_time_s.shape[::2] != (count, 2):
        raise InputError(
            "truth.stance_time_s",
            f"its shape is {stance_time_s.shape} for {count} recordings",
            "Give the control the truth of the recordings that it tracks",
        )
    stands = np.zeros(imu_time_s.shape, dtype=np.bool_)
    for row, (span_s, time_s) in enumerate(zip(stance_time_s, imu_time_s, strict=True)):
        known_s = span_s[np.isfinite(span_s).all(axis=-1)]
        if not len(known_s):
            continue
        if (np.diff(known_s.ravel()) < 0).any():
            raise InputError(f"truth.stance_time_s[{row}]", "stances are not in order", "Sort them by time")
        index = np.searchsorted(known_s[:, 0], time_s, side="right") - 1
        stands[row] = (index >= 0) & (time_s <= known_s[np.maximum(index, 0), 1])
    return stands
