"""A foot-mounted inertial unit alone: the step sensor, and dead reckoning with it."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.filters import kalman
from positioning.filters.plane import (
    LEAST_VARIANCE_M2,
    check_angle,
    check_settings,
    check_stack,
    headings_missing,
    track_one,
    with_leading_axis,
)
from positioning.inertial.foot import FootNavigation, Start, foot_navigation
from positioning.inertial.foot_alignment import late_alignment
from positioning.inertial.foot_checks import check_imu, imu_missing
from positioning.inertial.foot_plan import Fixes
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.foot_steps import Steps, aligned, misalignment_rad, steps, straight_steps
from positioning.model import Array, Calibration, Recording, Site, Survey, Track
from positioning.steps import of_recording, to_extra

# Readings of the first part in which straight steps are looked for: a minute of most units.
_BEGINNING = 6000


class FootInertial:
    """Dead reckoning with the steps of a foot-mounted inertial unit, from the noted place and heading.

    See Frank et al., section 3, and eqs. 9 and 10 without noise for the way that the steps make together.
    Between two steps the last place is held. The paper did not evaluate this; no other row may use the noted
    place. How the sensor is turned on the foot is found from the first straight steps, so that places before
    them use readings that come a few seconds later.

    The covariance is that of the inertial filter, with start and noted heading for sure. The variances are
    not printed: see `positioning.inertial.foot_settings.FootFilter` for where these come from.

    Parameters
    ----------
    states
        9, or 15 with the biases of accelerometer and gyroscope, section 3.1.
    detector
        What says that the foot rests, a name in `positioning.inertial.rest.DETECTORS`; that of the paper.
    detector_settings
        Its settings; None for its own.
    zero_velocity
        Use the rests; without, it is plain strapdown navigation.
    magnetometer
        Use the magnetometer, where there is one and magnetic north is known.
    force_noise_m_per_s2_per_rt_hz, rate_noise_rad_per_s_per_rt_hz
        Densities of the noise of the readings.
    heading_noise_rad_per_rt_s
        Density of a random walk of the heading, for biases that 9 states do not have.
    zero_velocity_noise_m_per_s
        Of each axis at rest.
    magnetic_heading_noise_rad
        Of the direction of the horizontal magnetic field indoors.
    magnetic_interval_s
        In a long rest the field counts as often.
    magnetic_gate
        The field does not count where its magnitude is off that of the first rest by this share.
    force_bias_m_per_s2, rate_bias_rad_per_s
        Of the biases after the alignment, for 15 states; that of the gyroscope without the error of the mean
        over the alignment, which is added.
    rate_turn_on_bias_rad_per_s
        Of the bias of the gyroscope where the alignment is too short to tell it, for 15 states.
    force_bias_walk_m_per_s2_per_rt_s, rate_bias_walk_rad_per_s_per_rt_s
        Growth of the biases, for 15 states.
    tilt_error_rad, heading_error_rad
        Of roll and pitch after levelling, and of the heading where no magnetometer gives it.
    alignment_s, bias_rest_s
        Least duration of the first rest for the alignment, and for the bias of the gyroscope.
    gravity_m_per_s2
        Magnitude of gravity; None for what the accelerometer reads in the alignment.
    heading_offset_rad
        Added to all headings of the sensor: an alignment that is off by so much.
    straight_steps, straight_least_m, straight_most_rad
        How the sensor is turned on the foot, Psi_eps of eq. 4, is the direction of the sum of the first so
        many steps that are at least so long and turn at most so much; not printed, assumed.
    misalignment_offset_rad
        Added to Psi_eps, to see what an error of it does.
    """

    def __init__(
        self,
        *,
        states: int = 9,
        detector: str = "acceleration_magnitude",
        detector_settings: Mapping[str, Any] | None = None,
        zero_velocity: bool = True,
        magnetometer: bool = True,
        force_noise_m_per_s2_per_rt_hz: float = 0.02,
        rate_noise_rad_per_s_per_rt_hz: float = 0.0017,
        heading_noise_rad_per_rt_s: float = 0.0,
        zero_velocity_noise_m_per_s: float = 0.01,
        magnetic_heading_noise_rad: float = 0.2,
        magnetic_interval_s: float = 1.0,
        magnetic_gate: float = 0.1,
        force_bias_m_per_s2: float = 0.02,
        rate_bias_rad_per_s: float = 0.00035,
        rate_turn_on_bias_rad_per_s: float = 0.009,
        force_bias_walk_m_per_s2_per_rt_s: float = 2e-4,
        rate_bias_walk_rad_per_s_per_rt_s: float = 3.5e-5,
        tilt_error_rad: float = 0.005,
        heading_error_rad: float = 0.001,
        alignment_s: float = 1.0,
        bias_rest_s: float = 1.0,
        gravity_m_per_s2: float | None = None,
        heading_offset_rad: float = 0.0,
        straight_steps: int = 5,
        straight_least_m: float = 0.5,
        straight_most_rad: float = 0.2,
        misalignment_offset_rad: float = 0.0,
    ) -> None:
        self.states = states
        self.detector = detector
        self.detector_settings = detector_settings
        self.zero_velocity = zero_velocity
        self.magnetometer = magnetometer
        self.force_noise_m_per_s2_per_rt_hz = force_noise_m_per_s2_per_rt_hz
        self.rate_noise_rad_per_s_per_rt_hz = rate_noise_rad_per_s_per_rt_hz
        self.heading_noise_rad_per_rt_s = heading_noise_rad_per_rt_s
        self.zero_velocity_noise_m_per_s = zero_velocity_noise_m_per_s
        self.magnetic_heading_noise_rad = magnetic_heading_noise_rad
        self.magnetic_interval_s = magnetic_interval_s
        self.magnetic_gate = magnetic_gate
        self.force_bias_m_per_s2 = force_bias_m_per_s2
        self.rate_bias_rad_per_s = rate_bias_rad_per_s
        self.rate_turn_on_bias_rad_per_s = rate_turn_on_bias_rad_per_s
        self.force_bias_walk_m_per_s2_per_rt_s = force_bias_walk_m_per_s2_per_rt_s
        self.rate_bias_walk_rad_per_s_per_rt_s = rate_bias_walk_rad_per_s_per_rt_s
        self.tilt_error_rad = tilt_error_rad
        self.heading_error_rad = heading_error_rad
        self.alignment_s = alignment_s
        self.bias_rest_s = bias_rest_s
        self.gravity_m_per_s2 = gravity_m_per_s2
        self.heading_offset_rad = heading_offset_rad
        self.straight_steps = straight_steps
        self.straight_least_m = straight_least_m
        self.straight_most_rad = straight_most_rad
        self.misalignment_offset_rad = misalignment_offset_rad

    def settings(self) -> FootFilter:
        """Return the settings of the inertial filter.

        See Frank et al., section 3.1.
        """
        values = {part.name: getattr(self, part.name) for part in fields(FootFilter)}
        return FootFilter(**values | {"detector_settings": self.detector_settings or {}})

    def navigation(
        self,
        recording: Recording,
        site: Site,
        *,
        rest: ArrayLike | None = None,
        fixes: Fixes | None = None,
        start: Start | None = None,
        heading_noise_rad_per_rt_s: float = 0.0,
        readings: int | None = None,
    ) -> FootNavigation:
        """Run the inertial filter on a stack; see `positioning.inertial.foot.foot_navigation`.

        It answers where steps and epochs ask, not at every reading.

        Parameters
        ----------
        recording, site, rest, fixes, start, readings
            As there.
        heading_noise_rad_per_rt_s
            Added to that of the settings, as variances are.
        """
        check_settings(
            straight_steps=(self.straight_steps, 1, 1e9),
            straight_least_m=(self.straight_least_m, 0, 1e3),
            straight_most_rad=(self.straight_most_rad, 0, 1e3),
            misalignment_offset_rad=(self.misalignment_offset_rad, -np.inf, np.inf),
        )
        check_angle("misalignment_offset_rad", self.misalignment_offset_rad)
        settings = self.settings()
        both = np.hypot(settings.heading_noise_rad_per_rt_s, heading_noise_rad_per_rt_s)
        settings = replace(settings, heading_noise_rad_per_rt_s=float(both))
        return foot_navigation(
            recording,
            site,
            settings,
            rest=rest,
            fixes=fixes,
            start=start,
            every_reading=False,
            readings=readings,
        )

    def misalignment_rad(self, navigation: FootNavigation) -> Array:
        """Return the direction of the walk in the frame of the sensor, [r], with the offset; Psi_eps."""
        found_rad = misalignment_rad(
            steps(navigation),
            count=self.straight_steps,
            least_step_m=self.straight_least_m,
            most_turn_rad=self.straight_most_rad,
        )
        return found_rad + self.misalignment_offset_rad

    def beginning_rad(self, recording: Recording, site: Site, rest: ArrayLike) -> Array:
        """Return `misalignment_rad` from as many readings as it takes: the first part of the navigation.

        See Frank et al., section 3.3: Psi_eps is fixed initially.

        Parameters
        ----------
        recording, site
            Stacks.
        rest
            When the feet rest, [r, i].
        """
        samples = np.shape(rest)[1]
        readings = min(_BEGINNING, samples)
        while True:
            navigation = self.navigation(recording, site, rest=rest, readings=readings)
            straight = straight_steps(
                steps(navigation), least_step_m=self.straight_least_m, most_turn_rad=self.straight_most_rad
            )
            if readings == samples or (np.count_nonzero(straight, axis=1) >= self.straight_steps).all():
                return self.misalignment_rad(navigation)
            readings = min(4 * readings, samples)

    def steps(self, navigation: FootNavigation) -> Steps:
        """Return what the step sensor measures, in the frame of the pedestrian.

        See Frank et al., eqs. 3 to 5.
        """
        return aligned(steps(navigation), self.misalignment_rad(navigation))

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Frank et al., section 3. That is also where the rest of the alignment ends after half of a
        recording.
        """
        return start_missing(recording) or late_start(recording, self)

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

        See Frank et al., eqs. 3 to 5, 9 and 10.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of the inertial unit [r, i, 3], start place and heading.
        survey
            Not used.
        site
            Corners [r, 2, 2]; direction to magnetic north [r], where it is known.
        rngs
            Not used.

        Returns
        -------
        Track
            With the covariance of the inertial filter, and extra ``heading_rad`` [r, n], not wrapped,
            ``steps`` [r, n], their number so far, ``alignment_end_s`` [r], until when nothing moves, and the
            steps themselves, ``step_time_s`` and so on [r, s], for rows that build on them.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        if reason := self.skip(recording, survey, site):
            raise InputError(
                "recording", reason, "Record an inertial unit, start_position_m and start_heading_rad"
            )
        check_stack(recording, site, beacons=False)
        return reckon(recording, self, self.navigation(recording, site))


def start_missing(recording: Recording) -> str:
    """Say what dead reckoning lacks: inertial readings, or a noted start; empty where it has all.

    See Frank et al., section 3.
    """
    if reason := imu_missing(recording):
        return reason
    if headings_missing(recording):
        return "the start heading was not recorded"
    if recording.start_position_m is None or np.isnan(recording.start_position_m).any():
        return "the start place was not recorded"
    return ""


def late_start(recording: Recording, inertial: Any) -> str:
    """Say why steps are found too late; empty where they are not, or where another row has found them.

    See Frank et al., section 3. The rest of the alignment must not end after half of a recording.

    Parameters
    ----------
    recording
        One, or a stack; with inertial readings.
    inertial
        The filter; None takes `FootInertial` with its own settings. Nothing is known of any other.
    """
    filtered = FootInertial() if inertial is None else inertial
    if recording.step_time_s is not None or not isinstance(filtered, FootInertial):
        return ""
    stacked = with_leading_axis(recording) if np.ndim(recording.time_s) == 1 else recording
    settings = filtered.settings()
    try:
        settings.check()
        check_imu(stacked)
        return late_alignment(stacked, settings)
    except InputError:
        # What cannot be used is no reason to skip: tracking refuses it.
        return ""


def check_start(recording: Recording, inertial: Any) -> None:
    """Refuse what `late_start` has a reason for.

    See Frank et al., section 3.

    Raises
    ------
    InputError
        With this reason.
    """
    if reason := late_start(recording, inertial):
        raise InputError("recording", reason, "Begin with a rest, or build on the steps of another row")


def reckon(recording: Recording, inertial: FootInertial, navigation: FootNavigation) -> Track:
    """Return dead reckoning by the steps of a navigation, from the noted place and heading.

    See Frank et al., eqs. 9 and 10.

    Parameters
    ----------
    recording
        Stack with start place and heading.
    inertial
        Has the step sensor.
    navigation
        Of the stack.
    """
    made = inertial.steps(navigation)
    start_rad = np.asarray(recording.start_heading_rad, dtype=np.float64)
    # Rows of zeros in front: the state before the first step.
    forward_m, left_m, turn_rad = (
        np.pad(np.nan_to_num(part), ((0, 0), (1, 0))) for part in (made.forward_m, made.left_m, made.turn_rad)
    )
    heading_rad = start_rad[:, None] + np.cumsum(turn_rad, axis=1)
    before_rad = heading_rad - turn_rad
    cosine, sine = np.cos(before_rad), np.sin(before_rad)
    advance_m = np.stack([cosine * forward_m - sine * left_m, sine * forward_m + cosine * left_m], axis=-1)
    place_m = np.asarray(recording.start_position_m, np.float64)[:, None] + np.cumsum(advance_m, axis=1)

    # The filter's frame is turned against that of the site, as the noted heading tells.
    angle = start_rad - inertial.misalignment_rad(navigation) - navigation.start.heading_rad
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1)
    turn = turn.reshape(-1, 1, 2, 2)
    own_m2 = np.concatenate(
        [
            navigation.start.position_covariance_m2[:, None],
            navigation.at(made.time_s).position_covariance_m2,
        ],
        axis=1,
    )
    covariance_m2 = kalman.symmetric(turn @ own_m2 @ np.swapaxes(turn, -1, -2))

    number = steps_so_far(made, recording.time_s)
    ended = np.isnan(number)
    place = np.arange(len(number))[:, None], np.nan_to_num(number).astype(np.intp)
    position_m, heading_rad = place_m[place], heading_rad[place]
    covariance_m2 = covariance_m2[place] + LEAST_VARIANCE_M2 * np.eye(2)
    for values in (position_m, heading_rad, covariance_m2):
        values[ended] = np.nan
    return Track(
        time_s=recording.time_s,
        position_m=position_m,
        covariance_m2=covariance_m2,
        extra={
            "heading_rad": heading_rad,
            "steps": number,
            "alignment_end_s": navigation.alignment_end_s,
            **to_extra(made),
        },
    )


def steps_of(
    recording: Recording, site: Site, inertial: FootInertial | None, navigation: FootNavigation | None = None
) -> Steps:
    """Return the steps that stand in a recording, found by another row, else those of an inertial filter.

    See Frank et al., Figure 3.

    Parameters
    ----------
    recording, site
        Stack.
    inertial
        The filter; None takes `FootInertial` with its own settings.
    navigation
        Of the filter, where it has been made already.

    Raises
    ------
    InputError
        Where the filter itself would start too late, or refuses the recording.
    """
    filtered = FootInertial() if inertial is None else inertial
    if navigation is not None:
        return filtered.steps(navigation)
    check_start(recording, filtered)
    return of_recording(recording) or filtered.steps(filtered.navigation(recording, site))


def steps_so_far(steps: Steps, time_s: Array) -> Array:
    """Return how many steps have ended until each epoch, [r, n]; NaN after the end of a recording.

    Parameters
    ----------
    steps
        Stack [r, s]; NaN fills up.
    time_s
        Epochs, [r, n], seconds; NaN after the end.
    """
    number = np.full(time_s.shape, np.nan)
    for row, (ended_s, epoch_s) in enumerate(zip(steps.time_s, time_s, strict=True)):
        there = np.isfinite(epoch_s)
        known_s = ended_s[np.isfinite(ended_s)]
        number[row, there] = np.searchsorted(known_s, epoch_s[there], side="right")
    return number
