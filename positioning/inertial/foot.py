"""Inertial navigation of a foot, and the steps that it makes.

See Frank et al., section 3. A strapdown navigation and an error-state filter beside it, which learns at each
rest of the foot that the velocity is zero. What the paper leaves open (start, variances, the extent of the
magnetometer's use) is a setting of `FootFilter`.

With 9 states a bias is nowhere in the error. What the alignment leaves of that of the gyroscope, and how it
wanders later, turns the heading by degrees in minutes, of which the variance of the heading knows nothing: it
is too small by far after a long walk, unless ``heading_noise_rad_per_rt_s`` stands for it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.error_state import STATES, ErrorStateFilter, Increments, ProcessNoise, increments
from positioning.inertial.merged import Merged, merge
from positioning.inertial.rest import DETECTORS, Flags, detect, spans
from positioning.inertial.strapdown import GRAVITY_M_PER_S2, attitude_of, levelled
from positioning.model import Array, Recording, Site

MOST_GAP_S = 0.1
"""A longer gap between readings is refused: a swinging foot turns by half a radian in it; assumed."""
MOST_RATE_RAD_PER_S = 50.0
"""Above the range of any such gyroscope (2000 degrees a second): readings beyond are not radians."""
FORCE_AT_REST_M_PER_S2 = (8.0, 12.0)
"""Where the mean specific force of a foot at rest lies, with the bias of any working unit; assumed."""
USUAL_FORCE_M_PER_S2 = (5.0, 40.0)
"""Where the median of a walk, or a run, lies; assumed."""
SATURATED_SAMPLES = 5
"""So many equal readings in a row, at an extreme of an axis, are a sensor at its limit; assumed."""
LEAST_SATURATED = {"specific_force_m_per_s2": 15.0, "angular_rate_rad_per_s": 4.0}
"""No unit saturates below these, unless it does so again and again: see ``LEAST_OFF_REST``."""
LEAST_OFF_REST = {"specific_force_m_per_s2": 2.0, "angular_rate_rad_per_s": 0.5}
"""An extreme that is nearer to the axis' median is that of an axis at rest, which may well read the same."""
LEAST_FLAT_RUNS = 2
"""Below ``LEAST_SATURATED`` a sensor is at its limit if it stays there so many times."""
QUIET_SHARE = 0.25
"""The share of readings with the least angular rate, in which a foot stands and the accelerometer reads
gravity alone."""
LEAST_LEFT_AT_REST = 0.1
"""Gravity is a larger share of the greatest readings of a walk, or a run; assumed."""

# Stops of the filter of which readings are prepared at a time, and between two looks at the rounding.
_BLOCK = 512
_TIDY = 256
# So many samples are taken as one at most: what is prepared at a time stays small.
_MOST_MERGED = 256
# The end of a rest, where the heel may already lift, does not count for the bias of the gyroscope.
_COUNTED_SHARE_OF_REST = 0.8


@dataclass(frozen=True, kw_only=True)
class FootFilter:
    """Settings of the inertial filter.

    Attributes
    ----------
    states
        9, or 15 with the biases of accelerometer and gyroscope. See Frank et al., section 3.1.
    detector
        A name in `rest.DETECTORS`; the paper's is ``acceleration_magnitude``.
    detector_settings
        Its settings.
    zero_velocity
        Whether the filter uses the rests; without, it is plain strapdown navigation.
    magnetometer
        Whether it uses the magnetometer, where there is one and magnetic north is known.
    force_noise_m_per_s2_per_rt_hz
        Density of the noise of the force; 0.02 is what OpenShoe uses (0.5 m/s^2 at 820 Hz; Nilsson et al.
        2012): ten times that of the data sheets, as it stands for scale errors in the swing too.
    rate_noise_rad_per_s_per_rt_hz
        Density of the noise of the rate: 0.1 degrees a second, the figure of the data sheet of the class,
        which the simulated units have too.
    heading_noise_rad_per_rt_s
        Density of a random walk of the heading beside that of the rate's noise, for biases that 9 states do
        not have. None, as in the paper, where nothing tells the place but the filter itself.
    zero_velocity_noise_m_per_s
        Of each axis at rest; as OpenShoe.
    magnetic_heading_noise_rad
        Of the direction of the horizontal field indoors; assumed, some eleven degrees:
        steel bends a horizontal field of 20 microtesla by some 4.
    magnetic_interval_s
        The field counts in the first sample of a rest, and as often in a long one; assumed. Its errors come
        from the place: a foot at rest learns nothing new from more.
    magnetic_gate
        The field does not count where its magnitude is off that of the first rest by this share; assumed.
    force_bias_m_per_s2, rate_bias_rad_per_s
        Of the biases, for 15 states: 0.02 m/s^2, that of the data sheet, as levelling cannot tell it from a
        tilt; 0.02 degrees a second, by which that of a gyroscope wanders in a run. To the latter comes the
        standard error of the mean over the alignment, which follows from the noise and the duration.
    rate_turn_on_bias_rad_per_s
        The same where the alignment is too short to tell that of the gyroscope: half a degree a second, what
        it has when it is turned on.
    force_bias_walk_m_per_s2_per_rt_s, rate_bias_walk_rad_per_s_per_rt_s
        Growth of the biases, for 15 states: by 0.002 m/s^2 and 0.02 degrees a second, the in-run figures, in
        a hundred seconds, their correlation time.
    tilt_error_rad
        Of roll and pitch after levelling: 0.05 m/s^2 of bias over gravity.
    heading_error_rad
        Of the heading at the start where no magnetometer gives it: nearly none, as this heading is then
        what the frame of the navigation hangs on.
    alignment_s
        The first rest that lasts at least as long is that of the alignment; assumed.
    bias_rest_s
        The bias of the gyroscope is taken from the alignment where it lasts at least as long; assumed. In a
        second the noise leaves a tenth of a degree a second of the mean; in less, a foot that only pauses
        would tell as bias what is a movement.
    gravity_m_per_s2
        Magnitude of gravity; None for what the accelerometer reads in the alignment, so that its error along
        the vertical does no harm.
    heading_offset_rad
        Added to all headings: an alignment that is off by so much.
    """

    states: int = 9
    detector: str = "acceleration_magnitude"
    detector_settings: Mapping[str, Any] = field(default_factory=dict)
    zero_velocity: bool = True
    magnetometer: bool = True
    force_noise_m_per_s2_per_rt_hz: float = 0.02
    rate_noise_rad_per_s_per_rt_hz: float = 0.0017
    heading_noise_rad_per_rt_s: float = 0.0
    zero_velocity_noise_m_per_s: float = 0.01
    magnetic_heading_noise_rad: float = 0.2
    magnetic_interval_s: float = 1.0
    magnetic_gate: float = 0.1
    force_bias_m_per_s2: float = 0.02
    rate_bias_rad_per_s: float = 0.00035
    rate_turn_on_bias_rad_per_s: float = 0.009
    force_bias_walk_m_per_s2_per_rt_s: float = 2e-4
    rate_bias_walk_rad_per_s_per_rt_s: float = 3.5e-5
    tilt_error_rad: float = 0.005
    heading_error_rad: float = 0.001
    alignment_s: float = 1.0
    bias_rest_s: float = 1.0
    gravity_m_per_s2: float | None = None
    heading_offset_rad: float = 0.0

    def check(self) -> None:
        """Refuse settings without sense.

        Raises
        ------
        InputError
            For a number of states other than 9 or 15, an unknown detector, or a negative number where only
            others make sense.
        """
        if self.states not in STATES:
            raise InputError(f"states={self.states}", "the filter has 9 or 15", "Take one of them")
        if self.detector not in DETECTORS:
            raise InputError(
                f"detector {self.detector!r}", "there is no such detector", f"Take one of {list(DETECTORS)}"
            )
        for name in _ABOVE_ZERO:
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}", "it is not above zero", "Correct it")
        for name in _NOT_NEGATIVE:
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}", "it is below zero", "Correct it")
        if self.gravity_m_per_s2 is not None and not 9.7 < self.gravity_m_per_s2 < 9.9:
            raise InputError(
                f"gravity_m_per_s2={self.gravity_m_per_s2}",
                "on earth it is between 9.7 and 9.9",
                "Correct it, or leave it out",
            )
        if not abs(self.heading_offset_rad) <= 2 * np.pi:
            raise InputError(
                f"heading_offset_rad={self.heading_offset_rad}",
                "it is not a finite number, or more than a whole turn: it looks like degrees",
                "Give radians",
            )


_ABOVE_ZERO = (
    "zero_velocity_noise_m_per_s",
    "magnetic_heading_noise_rad",
    "magnetic_interval_s",
    "magnetic_gate",
    "alignment_s",
    "bias_rest_s",
)
_NOT_NEGATIVE = (
    "force_noise_m_per_s2_per_rt_hz",
    "rate_noise_rad_per_s_per_rt_hz",
    "heading_noise_rad_per_rt_s",
    "force_bias_m_per_s2",
    "rate_bias_rad_per_s",
    "rate_turn_on_bias_rad_per_s",
    "force_bias_walk_m_per_s2_per_rt_s",
    "rate_bias_walk_rad_per_s_per_rt_s",
    "tilt_error_rad",
    "heading_error_rad",
)


class Fixes(NamedTuple):
    """Positions in the plane from elsewhere, at the epochs of a recording.

    Attributes
    ----------
    position_m
        [r, n, 2]; NaN where there is none.
    covariance_m2
        [r, n, 2, 2].
    """

    position_m: Array
    covariance_m2: Array


class Start(NamedTuple):
    """What is known of the start; all of it may be left out.

    Attributes
    ----------
    position_m, covariance_m2
        [r, 2] and [r, 2, 2]; None for (0, 0), known to a millimetre.
    heading_rad, heading_error_rad
        Of the SENSOR, [r] each; None for that of the magnetometer, or zero without one.
    """

    position_m: ArrayLike | None = None
    covariance_m2: ArrayLike | None = None
    heading_rad: ArrayLike | None = None
    heading_error_rad: ArrayLike | None = None


class FootState(NamedTuple):
    """The navigation at some times, each [r, n, ...], as in `FootNavigation`; NaN where there is no time."""

    position_m: Array
    heading_rad: Array
    position_covariance_m2: Array
    heading_variance_rad2: Array


@dataclass(frozen=True, kw_only=True)
class FootNavigation:
    """Where a foot was, at the end of intervals of n readings and after their updates.

    They are all i readings, unless `foot_navigation` leaves some out. Before the alignment ends everything
    stays as at the start; after the end of a recording all is NaN.

    Attributes
    ----------
    time_s
        [r, n].
    position_m
        [r, n, 3].
    heading_rad
        Of the forward axis of the sensor, [r, n], from -pi to pi.
    rest
        Whether the foot rests, [r, n].
    position_covariance_m2
        In the plane, [r, n, 2, 2].
    heading_variance_rad2
        [r, n].
    start
        What the navigation starts from, each [r, ...].
    alignment_end_s
        When the alignment ended, [r]: the last reading of its rest, until which nothing moves.
    """

    time_s: Array
    position_m: Array
    heading_rad: Array
    rest: Flags
    position_covariance_m2: Array
    heading_variance_rad2: Array
    start: FootState
    alignment_end_s: Array

    def at(self, time_s: ArrayLike) -> FootState:
        """Return the state at given times: that of the last reading here until then, or of the start.

        Parameters
        ----------
        time_s
            [r, n], seconds; NaN for none.
        """
        times = np.asarray(time_s, dtype=np.float64)
        index = np.full(times.shape, -1, dtype=np.intp)
        for row, (own, asked) in enumerate(zip(self.time_s, times, strict=True)):
            there = own[~np.isnan(own)]
            # NaN sorts behind all numbers.
            index[row] = np.minimum(np.searchsorted(there, asked, side="right"), len(there)) - 1

        def take(values: Array, start: Array) -> Array:
            extra = (1,) * (values.ndim - 2)
            picked = values[np.arange(len(values))[:, None], np.maximum(index, 0)]
            shape = (*index.shape, *extra)
            state = np.where((index < 0).reshape(shape), start[:, None], picked)
            return np.where(np.isnan(times).reshape(shape), np.nan, state)

        return FootState(
            take(self.position_m, self.start.position_m),
            take(self.heading_rad, self.start.heading_rad),
            take(self.position_covariance_m2, self.start.position_covariance_m2),
            take(self.heading_variance_rad2, self.start.heading_variance_rad2),
        )


class Steps(NamedTuple):
    """Steps of the instrumented foot, each [r, s]; NaN fills up.

    Attributes
    ----------
    time_s
        When each step was complete: the first sample of the rest behind it.
    forward_m, left_m
        Displacement, in the frame of the heading before the step.
    turn_rad
        Change of the heading, from -pi to pi, positive to the left.
    """

    time_s: Array
    forward_m: Array
    left_m: Array
    turn_rad: Array


class _Alignment(NamedTuple):
    """What the first rest of each recording tells, each [r, ...]."""

    end: NDArray[np.intp]
    roll_rad: Array
    pitch_rad: Array
    heading_rad: Array
    heading_error_rad: Array
    rate_bias_rad_per_s: Array
    rate_bias_error_rad_per_s: Array
    gravity_m_per_s2: Array
    magnetic_field_ut: Array


def check_imu(recording: Recording) -> NDArray[np.intp]:
    """Return the number of readings of each recording of a stack, if they can be used.

    Parameters
    ----------
    recording
        With ``imu_time_s`` [r, i], ``specific_force_m_per_s2`` and ``angular_rate_rad_per_s`` [r, i, 3], and
        maybe ``magnetic_field_ut`` [r, i, 3].

    Returns
    -------
    NDArray
        [r].

    Raises
    ------
    InputError
        For arrays that are missing or do not fit each other; times that are infinite, missing in between,
        repeated or decreasing, or leave a gap; readings that are not finite, stuck at a limit, or in degrees.
    """
    if reason := imu_missing(recording):
        raise InputError("recording", reason, "Give all three")
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.shape[1] < 2:
        raise InputError(
            "recording.imu_time_s", f"its shape is {time_s.shape}, not [r, i]", "Give two readings or more"
        )
    there = ~np.isnan(time_s)
    length = np.count_nonzero(there, axis=1)
    _refuse("imu_time_s", length[:, None] < 2, "the recording has fewer than two readings", "Leave it out")
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    _refuse("imu_time_s", behind & there, "a time before is missing", "Use NaN after the end only")
    _refuse("imu_time_s", np.isinf(time_s), "the time is infinite", "Give seconds")
    step_s = np.diff(time_s, axis=1)
    with np.errstate(invalid="ignore"):
        _refuse("imu_time_s", step_s <= 0, "time does not increase after it", "Sort, and leave out repeats")
        _refuse(
            "imu_time_s",
            step_s > MOST_GAP_S,
            f"no reading for more than {MOST_GAP_S} s after it",
            "Cut the recording there, or fill the gap; check that times are in seconds",
        )
    for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s", "magnetic_field_ut"):
        values = getattr(recording, name)
        if values is None:
            continue
        if np.shape(values) != (*time_s.shape, 3):
            raise InputError(
                f"recording.{name}",
                f"its shape is {np.shape(values)}, not {(*time_s.shape, 3)}",
                "Give three parts a reading",
            )
        # One recording at a time: the arrays of a stack are large.
        for row, count in enumerate(length):
            part = np.asarray(values[row, :count], dtype=np.float64)
            if name == "magnetic_field_ut":
                _refuse(name, np.isinf(part), "the field is infinite", "Use NaN for none", row)
                continue
            _refuse(
                name, ~np.isfinite(part), "the reading is not a finite number", "Leave it out or fill it", row
            )
            _refuse_limits(name, part, row)
    return np.asarray(length, dtype=np.intp)


def imu_missing(recording: Recording) -> str:
    """Say which inertial readings a recording lacks; empty where it has all."""
    names = ("imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s")
    missing = [name for name in names if getattr(recording, name) is None]
    return f"there are no inertial readings ({', '.join(missing)})" if missing else ""


def sample_rate_hz(recording: Recording) -> Array:
    """Return the readings a second of each recording of a stack, [r], by the median interval."""
    return np.asarray(
        1.0 / np.nanmedian(np.diff(np.asarray(recording.imu_time_s, np.float64), axis=1), axis=1)
    )


def rests(recording: Recording, settings: FootFilter) -> Flags:
    """Return when each foot of a stack rests, [r, i], as the detector of the settings has it.

    See Frank et al., section 3.2.

    Parameters
    ----------
    recording
        Stack that `check_imu` does not refuse.
    settings
        Names the detector.

    Raises
    ------
    InputError
        For what the detector refuses.
    """
    time_s, rate_hz = np.asarray(recording.imu_time_s), sample_rate_hz(recording)
    force, rate = recording.specific_force_m_per_s2, recording.angular_rate_rad_per_s
    assert force is not None
    assert rate is not None
    flags = np.zeros(time_s.shape, dtype=np.bool_)
    for row, count in enumerate(np.count_nonzero(~np.isnan(time_s), axis=1)):
        flags[row, :count] = detect(
            settings.detector,
            settings.detector_settings,
            force[row, :count],
            rate[row, :count],
            float(rate_hz[row]),
        )
    return flags


def foot_navigation(
    recording: Recording,
    site: Site,
    settings: FootFilter,
    *,
    rest: ArrayLike | None = None,
    fixes: Fixes | None = None,
    start: Start | None = None,
    every_reading: bool = True,
    readings: int | None = None,
) -> FootNavigation:
    """Navigate the feet of a stack of recordings.

    See Frank et al., sections 3.1 and 3.2. Until the end of the first rest that is long enough, nothing
    moves: it gives roll and pitch, the bias of the gyroscope, gravity, and the heading from the magnetometer.
    A fix counts after the last reading until its epoch.

    Parameters
    ----------
    recording
        Stack with inertial readings [r, i].
    site
        Stack; its magnetic north is needed for the magnetometer.
    settings
        Of the filter.
    rest
        When the feet rest, [r, i], in place of the detector.
    fixes
        At the epochs ``recording.time_s`` [r, n], if any.
    start
        Where the feet stand at the start, as far as known.
    every_reading
        Whether the answer is wanted at every reading. Without, it is left out where neither the filter has
        something to take in nor a rest begins or ends nor an epoch asks. With 9 states the readings in
        between are then taken together, in a fraction of the time, for the same answer.
    readings
        Navigate the first so many readings only, at least 1; the answer ends there. None for all.

    Raises
    ------
    InputError
        For settings or readings that cannot be used, epochs at other times than the readings, no rest that is
        long enough, readings in units of gravity, or fixes that do not fit.
    """
    settings.check()
    length = check_imu(recording)
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    _check_clocks(recording, length)
    _check_force_units(recording, length)
    flags = rests(recording, settings) if rest is None else np.asarray(rest, dtype=np.bool_)
    if flags.shape != time_s.shape:
        raise InputError("rest", f"its shape is {flags.shape}, not {time_s.shape}", "Give one a reading")
    flags = flags & ~np.isnan(time_s)
    north_rad = _north(recording, site, settings)
    aligned = _align(recording, flags, settings, north_rad)
    engine, first = _engine(aligned, settings, start or Start(), len(time_s))
    used, field_ut = _magnetic_updates(recording, flags, settings, north_rad, aligned)
    at_rest = flags & (np.arange(time_s.shape[1]) >= aligned.end[:, None]) & settings.zero_velocity
    found = _planned_fixes(recording, fixes, time_s)
    stops = flags.copy()
    stops[:, 1:] &= at_rest[:, 1:] | ~flags[:, :-1]
    # The reading behind a rest says that it has ended.
    stops[:, 1:] |= flags[:, :-1] & ~flags[:, 1:]
    stops |= used
    if every_reading or settings.states != 9:
        stops[...] = True
    for row, epoch_s in enumerate(np.asarray(recording.time_s, dtype=np.float64)):
        until = np.searchsorted(time_s[row, : length[row]], epoch_s[~np.isnan(epoch_s)], side="right") - 1
        stops[row, until[until >= 0]] = True
    stops[found.world, found.sample] = True
    end = length if readings is None else np.minimum(length, readings)
    stops &= np.arange(time_s.shape[1]) < end[:, None]
    stops[:, 0], stops[np.arange(len(end)), end - 1] = True, True
    return _run(
        recording, engine, first, aligned, settings, flags, at_rest, used, field_ut, north_rad, found, stops
    )


def steps(navigation: FootNavigation) -> Steps:
    """Return what a step sensor on the foot measures.

    See Frank et al., section 3.3, eqs. 3 to 5, without the misalignment of the sensor, for which there are
    `misalignment_rad` and `aligned`. The state is stored at the first sample of each rest, after its update.

    Parameters
    ----------
    navigation
        Of a stack.
    """
    begins = [span[:, 0] for span in spans(navigation.rest)]
    most = max((len(begin) for begin in begins), default=0) - 1
    found = np.full((4, len(begins), max(most, 0)), np.nan)
    for row, begin in enumerate(begins):
        if len(begin) < 2:
            continue
        place, heading = navigation.position_m[row, begin, :2], navigation.heading_rad[row, begin]
        east, north = np.diff(place, axis=0).T
        ahead, aside = np.cos(heading[:-1]), np.sin(heading[:-1])
        turn = np.diff(heading)
        found[:, row, : len(begin) - 1] = (
            navigation.time_s[row, begin[1:]],
            ahead * east + aside * north,
            ahead * north - aside * east,
            np.arctan2(np.sin(turn), np.cos(turn)),
        )
    return Steps(*found)


def misalignment_rad(
    made: Steps, *, count: int = 5, least_step_m: float = 0.5, most_turn_rad: float = 0.2
) -> Array:
    """Return the direction of the walk in the frame of the sensor, [r], from the first straight steps.

    See Frank et al., section 3.3: Psi_eps, which has to be fixed initially; how is not said. Assumed: the
    direction of the sum of the first ``count`` steps that are neither short nor part of a turn.

    Parameters
    ----------
    made
        Steps of a stack.
    count
        How many steps are added up.
    least_step_m
        Shorter ones do not count: the first and the last one of a walk.
    most_turn_rad
        Steps with more of a turn do not count.

    Returns
    -------
    Array
        [r]; zero where there is no such step.
    """
    straight = straight_steps(made, least_step_m=least_step_m, most_turn_rad=most_turn_rad)
    straight &= np.cumsum(straight, axis=-1) <= count
    left, forward = (
        np.cumsum(np.where(straight, part, 0.0), axis=-1)[..., -1]
        if part.shape[-1]
        else np.zeros(part.shape[:-1])
        for part in (made.left_m, made.forward_m)
    )
    return np.asarray(np.arctan2(left, forward))


def straight_steps(made: Steps, *, least_step_m: float, most_turn_rad: float) -> NDArray[np.bool_]:
    """Return which steps are neither short nor part of a turn, [r, s], as in `misalignment_rad`.

    See Frank et al., section 3.3.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(
            (np.hypot(made.forward_m, made.left_m) >= least_step_m) & (np.abs(made.turn_rad) <= most_turn_rad)
        )


def aligned(made: Steps, misalignment: ArrayLike) -> Steps:
    """Return steps in the frame of the pedestrian.

    See Frank et al., eq. 4.

    Parameters
    ----------
    made
        Steps of a stack.
    misalignment
        Direction of the walk in the frame of the sensor, [r], radians.
    """
    angle = np.asarray(misalignment, dtype=np.float64)[..., None]
    ahead, aside = np.cos(angle), np.sin(angle)
    return made._replace(
        forward_m=ahead * made.forward_m + aside * made.left_m,
        left_m=ahead * made.left_m - aside * made.forward_m,
    )


def _north(recording: Recording, site: Site, settings: FootFilter) -> Array | None:
    """Return the direction to magnetic north [r], or None where it is not used."""
    if not settings.magnetometer or recording.magnetic_field_ut is None or site.magnetic_north_rad is None:
        return None
    north = np.asarray(site.magnetic_north_rad, dtype=np.float64)
    assert recording.imu_time_s is not None
    if north.shape != (len(recording.imu_time_s),):
        raise InputError(
            "site.magnetic_north_rad",
            f"its shape is {north.shape}, not {(len(recording.imu_time_s),)}",
            "Give one a recording",
        )
    # NaN stands for a direction that is not known.
    if np.isinf(north).any() or (np.abs(north) > 2 * np.pi).any():
        raise InputError(
            "site.magnetic_north_rad",
            f"{np.nanmax(np.abs(north)):g} is more than a whole turn: it looks like degrees",
            "Give radians",
        )
    return north + settings.heading_offset_rad


def late_alignment(recording: Recording, settings: FootFilter) -> str:
    """Say which recording of a stack stands still for most of it; empty where none does.

    Until the end of the alignment nothing moves. Where this comes after half of a recording, what is left
    of a walk is no track of it, although the covariance of the filter knows nothing of that.

    Parameters
    ----------
    recording
        Stack that `check_imu` does not refuse.
    settings
        Name the detector, and the duration of the alignment.

    Raises
    ------
    InputError
        For what the detector refuses.
    """
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    rate_hz = sample_rate_hz(recording)
    for row, span in enumerate(spans(rests(recording, settings))):
        long = _long_enough(span, rate_hz[row], settings)
        if not long.any():
            continue
        begin, end = span[np.argmax(long)]
        own_s = time_s[row, ~np.isnan(time_s[row])] - time_s[row, 0]
        if own_s[end - 1] > 0.5 * own_s[-1]:
            return (
                f"recording[{row}]: the first rest of {settings.alignment_s:g} s begins at"
                f" {own_s[begin]:.1f} s of {own_s[-1]:.1f} s and ends at {own_s[end - 1]:.1f} s, until when"
                " nothing moves; cut the recording, lower alignment_s, or take another detector"
            )
    return ""


def _long_enough(span: NDArray[np.intp], rate_hz: float, settings: FootFilter) -> NDArray[np.bool_]:
    """Return which rests may be that of the alignment."""
    # Whole samples: half of one of tolerance for times that are not quite even.
    return np.asarray((span[:, 1] - span[:, 0] + 0.5) / rate_hz >= settings.alignment_s)


def _align(recording: Recording, flags: Flags, settings: FootFilter, north_rad: Array | None) -> _Alignment:
    count = len(flags)
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    rate_hz = sample_rate_hz(recording)
    end = np.zeros(count, dtype=np.intp)
    force, bias = np.empty((count, 3)), np.zeros((count, 3))
    bias_error = np.full(count, settings.rate_turn_on_bias_rad_per_s)
    field_ut = np.full((count, 3), np.nan)
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    for row, span in enumerate(spans(flags)):
        long = _long_enough(span, rate_hz[row], settings)
        if not long.any():
            most = np.max(span[:, 1] - span[:, 0], initial=0) / rate_hz[row]
            raise InputError(
                f"recording[{row}]",
                f"no rest of {settings.alignment_s} s for the alignment; the longest is {most:.2f} s",
                "Stand still at the start, lower alignment_s, or try another detector",
            )
        begin, end[row] = span[np.argmax(long)]
        counted = slice(begin, begin + max(1, round(_COUNTED_SHARE_OF_REST * (end[row] - begin))))
        force[row] = np.mean(recording.specific_force_m_per_s2[row, counted], axis=0, dtype=np.float64)
        if time_s[row, end[row] - 1] - time_s[row, begin] + 1 / rate_hz[row] >= settings.bias_rest_s:
            rates = np.asarray(recording.angular_rate_rad_per_s[row, counted], dtype=np.float64)
            bias[row] = rates.mean(axis=0)
            of_mean = settings.rate_noise_rad_per_s_per_rt_hz / np.sqrt(len(rates) / rate_hz[row])
            bias_error[row] = np.hypot(of_mean, settings.rate_bias_rad_per_s)
        if north_rad is not None and recording.magnetic_field_ut is not None:
            seen = np.asarray(recording.magnetic_field_ut[row, counted], dtype=np.float64)
            seen = seen[np.isfinite(seen).all(axis=-1)]
            field_ut[row] = seen.mean(axis=0) if len(seen) else np.nan
    low, high = FORCE_AT_REST_M_PER_S2
    magnitude = np.linalg.norm(force, axis=-1)
    _refuse(
        "specific_force_m_per_s2",
        (magnitude < low) | (magnitude > high),
        f"its mean at rest is not between {low} and {high} m/s^2",
        "Calibrate the accelerometer, or try another detector",
    )
    roll, pitch = levelled(force)
    heading = np.full(count, settings.heading_offset_rad)
    error = np.full(count, settings.heading_error_rad)
    if north_rad is not None:
        level = (attitude_of(roll, pitch, np.zeros(count)) @ field_ut[..., None])[..., 0]
        found = north_rad - np.arctan2(level[:, 1], level[:, 0])
        heading = np.where(np.isfinite(found), found, heading)
        error = np.where(np.isfinite(found), settings.magnetic_heading_noise_rad, error)
    gravity = magnitude if settings.gravity_m_per_s2 is None else np.full(count, settings.gravity_m_per_s2)
    field = np.linalg.norm(field_ut, axis=-1)
    return _Alignment(end, roll, pitch, heading, error, bias, bias_error, gravity, field)


def _engine(
    aligned_: _Alignment, settings: FootFilter, start: Start, count: int
) -> tuple[ErrorStateFilter, FootState]:
    """Return the filter at the start, and what is asked of it there."""

    def given(value: ArrayLike | None, other: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
        array = np.asarray(other if value is None else value, dtype=np.float64)
        if array.shape != shape or not np.isfinite(array).all():
            raise InputError(
                f"start.{name}", f"it is not finite of shape {shape}: {array.shape}", "Give one a recording"
            )
        return array

    place = given(start.position_m, np.zeros((count, 2)), (count, 2), "position_m")
    spread = given(
        start.covariance_m2, np.tile(1e-6 * np.eye(2), (count, 1, 1)), (count, 2, 2), "covariance_m2"
    )
    heading = given(start.heading_rad, aligned_.heading_rad, (count,), "heading_rad")
    error = given(start.heading_error_rad, aligned_.heading_error_rad, (count,), "heading_error_rad")
    covariance = np.zeros((count, settings.states, settings.states))
    covariance[:, :2, :2] = spread
    covariance[:, 2, 2] = 1e-6
    for part, sigma in (
        (slice(3, 6), settings.zero_velocity_noise_m_per_s),
        (slice(6, 8), settings.tilt_error_rad),
        (slice(9, 12), settings.force_bias_m_per_s2),
        (slice(12, 15), aligned_.rate_bias_error_rad_per_s),
    ):
        for state in range(settings.states)[part]:
            covariance[:, state, state] = sigma**2
    covariance[:, 8, 8] = error**2
    walks = (settings.force_bias_walk_m_per_s2_per_rt_s, settings.rate_bias_walk_rad_per_s_per_rt_s)
    engine = ErrorStateFilter(
        position_m=np.concatenate([place, np.zeros((count, 1))], axis=-1),
        velocity_m_per_s=np.zeros((count, 3)),
        attitude=attitude_of(aligned_.roll_rad, aligned_.pitch_rad, heading),
        covariance=covariance,
        noise=ProcessNoise(
            settings.force_noise_m_per_s2_per_rt_hz,
            settings.rate_noise_rad_per_s_per_rt_hz,
            *walks,
            settings.heading_noise_rad_per_rt_s,
        ),
        gravity_m_per_s2=aligned_.gravity_m_per_s2,
    )
    wrapped = np.arctan2(np.sin(heading), np.cos(heading))
    position = engine.position_m.T.copy()
    return engine, FootState(position, wrapped, spread.copy(), error**2)


def _magnetic_updates(
    recording: Recording,
    flags: Flags,
    settings: FootFilter,
    north_rad: Array | None,
    aligned_: _Alignment,
) -> tuple[Flags, Array | None]:
    """Return in which samples the magnetic field counts, [r, i], and the field."""
    if north_rad is None or recording.magnetic_field_ut is None:
        return np.zeros(flags.shape, dtype=np.bool_), None
    field_ut = np.asarray(recording.magnetic_field_ut)
    magnitude = np.sqrt(np.einsum("rik,rik->ri", field_ut, field_ut, dtype=np.float64))
    expected = aligned_.magnetic_field_ut[:, None]
    index = np.arange(flags.shape[1])
    since = index - np.maximum.accumulate(np.where(flags, -1, index), axis=1) - 1
    every = np.maximum(1, np.rint(settings.magnetic_interval_s * sample_rate_hz(recording))).astype(np.intp)
    with np.errstate(invalid="ignore"):
        fits = np.abs(magnitude - expected) <= settings.magnetic_gate * expected
    due = flags & (since % every[:, None] == 0) & (index >= aligned_.end[:, None])
    return due & fits & np.isfinite(north_rad)[:, None], field_ut


class _PlannedFixes(NamedTuple):
    """Fixes in the order of worlds, then time: each [k, ...], with the roots of their precisions."""

    world: NDArray[np.intp]
    sample: NDArray[np.intp]
    place_m: Array
    root: Array


def _planned_fixes(recording: Recording, fixes: Fixes | None, time_s: Array) -> _PlannedFixes:
    """Return the fixes, with the sample after which each counts."""
    if fixes is None:
        none = np.zeros(0, dtype=np.intp)
        return _PlannedFixes(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)))
    epoch_s = np.asarray(recording.time_s, dtype=np.float64)
    place, spread = np.asarray(fixes.position_m, np.float64), np.asarray(fixes.covariance_m2, np.float64)
    if place.shape != (*epoch_s.shape, 2) or spread.shape != (*epoch_s.shape, 2, 2):
        raise InputError(
            "fixes",
            f"their shapes {place.shape} and {spread.shape} do not fit epochs {epoch_s.shape}",
            "Give one an epoch, NaN for none",
        )
    there = np.isfinite(place).all(axis=-1) & ~np.isnan(epoch_s)
    try:
        root = np.linalg.inv(np.linalg.cholesky(spread[there]))
    except np.linalg.LinAlgError as error:
        raise InputError(
            "fixes.covariance_m2", "one is not positive definite", "Give every fix a covariance"
        ) from error
    if not np.isfinite(root).all():
        raise InputError("fixes.covariance_m2", "one is not finite", "Give every fix a covariance")
    rows, epochs = np.nonzero(there)
    samples = np.empty(len(rows), dtype=np.intp)
    for row in np.unique(rows):
        own, mine = time_s[row, ~np.isnan(time_s[row])], rows == row
        samples[mine] = np.searchsorted(own, epoch_s[row, epochs[mine]], side="right") - 1
    return _PlannedFixes(rows, np.maximum(samples, 0), place[there], root)


def _by_stop(found: _PlannedFixes, stops: Flags) -> dict[int, list[tuple[NDArray[np.intp], Array, Array]]]:
    """Return by number of the stop which worlds have a fix there, their fixes, and the roots.

    A world has one fix a pass; where two fall into one sample, there is a second pass.
    """
    taken: dict[int, list[list[int]]] = {}
    number = np.where(stops, np.cumsum(stops, axis=1) - 1, -1)[found.world, found.sample]
    for fix, (row, stop) in enumerate(zip(found.world.tolist(), number.tolist(), strict=True)):
        if stop < 0:
            continue
        passes = taken.setdefault(stop, [])
        free = next((one for one in passes if row not in found.world[one]), None)
        if free is None:
            passes.append([fix])
        else:
            free.append(fix)
    return {
        stop: [(found.world[one], found.place_m[one], found.root[one]) for one in passes]
        for stop, passes in taken.items()
    }


def _run(
    recording: Recording,
    engine: ErrorStateFilter,
    first: FootState,
    aligned_: _Alignment,
    settings: FootFilter,
    flags: Flags,
    at_rest: Flags,
    magnetic: Flags,
    field_ut: Array | None,
    north_rad: Array | None,
    found: _PlannedFixes,
    stops: Flags,
) -> FootNavigation:
    """Run the filter from stop to stop, worlds in lock-step: the n-th stop of each at once.

    Between two stops nothing is measured, and their number differs less between worlds than their times.
    """
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    worlds, samples = time_s.shape
    duration_s = np.diff(time_s, axis=1, prepend=time_s[:, :1])
    # Nothing moves before the end of the alignment.
    duration_s = np.where(np.arange(samples) < aligned_.end[:, None], 0.0, duration_s)
    north = np.zeros(worlds) if north_rad is None else np.where(np.isfinite(north_rad), north_rad, 0.0)
    force = np.asarray(recording.specific_force_m_per_s2)
    rate = np.asarray(recording.angular_rate_rad_per_s)
    stop, before = _stops(stops)
    planned = _by_stop(found, stops)
    told = len(stop)
    position_m, heading = np.empty((worlds, told, 3)), np.empty((worlds, told))
    covariance, variance = np.empty((worlds, told, 2, 2)), np.empty((worlds, told))
    kept = np.empty((_BLOCK, 9, worlds))
    forward = engine.attitude[:2, 0]
    corner = engine.covariance.transpose(1, 2, 0)[:2, :2]
    everyone = np.arange(worlds)
    for begin in range(0, len(stop), _BLOCK):
        end = min(begin + _BLOCK, len(stop))
        here = stop[begin:end]
        # A world that has no stop left stays as it is.
        count = stop[begin:end] - before[begin:end]
        lasts_s = np.where(count > 0, duration_s[everyone, here], 0.0)
        made = increments(
            force[everyone, here],
            rate[everyone, here] - aligned_.rate_bias_rad_per_s,
            lasts_s,
            biases=settings.states == 15,
        )
        merged = _merged(made, count, before[begin:end], force, rate, duration_s, aligned_)
        rests_here = at_rest[everyone, here] & (count > 0)
        uses_here = magnetic[everyone, here] & (count > 0)
        someone, someone_uses = (
            np.logical_or.reduce(flag, axis=1).tolist() for flag in (rests_here, uses_here)
        )
        resting, using = rests_here.astype(np.float64), uses_here.astype(np.float64)
        if field_ut is not None:
            field = np.where(uses_here[..., None], field_ut[everyone, here], 0.0).astype(np.float64)
            seen = np.ascontiguousarray(field.swapaxes(1, 2))
        for step in range(end - begin):
            if step % _TIDY == 0:
                engine.tidy()
            mean = None if made.mean_rotation_s is None else made.mean_rotation_s[step]
            engine.predict(made.turn_and_advance[step], made.duration_s[step], mean, merged.get(step))
            corrected = False
            if someone[step]:
                engine.zero_velocity(resting[step], settings.zero_velocity_noise_m_per_s**2)
                corrected = True
            if someone_uses[step]:
                engine.magnetic_heading(
                    seen[step], north, settings.magnetic_heading_noise_rad**2, using[step]
                )
                corrected = True
            for rows, fix_m, root in planned.get(begin + step, ()):
                _fix(engine, rows, fix_m, root)
                corrected = True
            if corrected:
                engine.correct()
            row = kept[step]
            row[:3] = engine.position_m
            row[3:5] = forward
            row[5:7] = corner[0]
            row[7] = corner[1, 1]
            row[8] = engine.covariance[:, 8, 8]
        done, block = np.moveaxis(kept[: end - begin], -1, 0), slice(begin, end)
        position_m[:, block] = done[..., :3]
        heading[:, block] = np.arctan2(done[..., 4], done[..., 3])
        covariance[:, block, 0, 0], covariance[:, block, 1, 1] = done[..., 5], done[..., 7]
        covariance[:, block, 0, 1] = covariance[:, block, 1, 0] = done[..., 6]
        variance[:, block] = done[..., 8]
    ended = (stop == before).T
    for values in (position_m, heading, covariance, variance):
        values[ended] = np.nan
    return FootNavigation(
        time_s=np.where(ended, np.nan, time_s[everyone[:, None], stop.T]),
        position_m=position_m,
        heading_rad=heading,
        rest=flags[everyone[:, None], stop.T] & ~ended,
        position_covariance_m2=covariance,
        heading_variance_rad2=variance,
        start=first,
        alignment_end_s=time_s[everyone, aligned_.end - 1],
    )


def _stops(stops: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the samples at which each world stops, and those of the stops before, each [n, w].

    Where a world has no stop left, both are the same; before the first stop there is sample -1. Adds stops
    that have no other use than that no more than the most samples are merged.
    """
    each = []
    for row in stops:
        own = np.flatnonzero(row)
        for gap in np.flatnonzero(np.diff(own) > _MOST_MERGED):
            row[own[gap] : own[gap + 1] : _MOST_MERGED] = True
        each.append(np.flatnonzero(row))
    longest = max(len(own) for own in each)
    stop = np.stack([np.pad(own, (0, longest - len(own)), mode="edge") for own in each], axis=1)
    return stop, np.concatenate([np.full((1, len(each)), -1), stop[:-1]])


def _merged(
    made: Increments,
    count: NDArray[np.intp],
    before: NDArray[np.intp],
    force: Array,
    rate: Array,
    duration_s: Array,
    aligned_: _Alignment,
) -> dict[int, Merged]:
    """Put the sums of runs of several samples into increments; return by step what more there is to know.

    Parameters
    ----------
    made
        Of the last sample until each stop, [n, w].
    count, before
        Samples until each stop, and the last one before them, [n, w].
    force, rate, duration_s
        Of all samples, [w, i, ...].
    aligned_
        Has the bias of the rates.
    """
    place, world = np.nonzero(count > 1)
    if not len(place):
        return {}
    order = np.argsort(-count[place, world], kind="stable")
    place, world = place[order], world[order]
    length = count[place, world]
    # The first sample of each run, then the second of each that has one, and so on.
    inside, run = np.nonzero(np.arange(length[0])[:, None] < length)
    own_world = world[run]
    sample = (before[place, world] + 1)[run] + inside
    sums = merge(
        force[own_world, sample],
        rate[own_world, sample] - aligned_.rate_bias_rad_per_s[own_world],
        duration_s[own_world, sample],
        length,
    )
    made.turn_and_advance[place, :, :3, world] = sums.rotation
    made.turn_and_advance[place, :, 3, world] = sums.advance_m_per_s
    made.duration_s[place, world] = sums.duration_s
    by_step = np.argsort(place, kind="stable")
    steps, starts = np.unique(place[by_step], return_index=True)
    return {
        int(step): Merged(world[own], sums.way_m[own].T, sums.moments[own])
        for step, own in zip(steps, np.split(by_step, starts[1:]), strict=True)
    }


def _fix(engine: ErrorStateFilter, rows: NDArray[np.intp], fix_m: Array, root: Array) -> None:
    worlds = engine.position_m.shape[1]
    place, precision, used = np.zeros((2, worlds)), np.zeros((2, 2, worlds)), np.zeros(worlds)
    place[:, rows], precision[:, :, rows], used[rows] = fix_m.T, np.moveaxis(root, 0, -1), 1.0
    engine.position_fix(place, precision, used)


def _check_clocks(recording: Recording, length: NDArray[np.intp]) -> None:
    """Refuse epochs that all lie before or behind the readings, by more than one of them may last."""
    assert recording.imu_time_s is not None
    for row, count in enumerate(length):
        own_s = recording.imu_time_s[row, :count]
        epoch_s = np.asarray(recording.time_s[row], dtype=np.float64)
        epoch_s = epoch_s[np.isfinite(epoch_s)]
        if not len(epoch_s):
            continue
        if epoch_s.min() > own_s[-1] + MOST_GAP_S or epoch_s.max() < own_s[0] - MOST_GAP_S:
            raise InputError(
                f"recording.time_s[{row}]",
                f"the epochs are from {epoch_s.min():.1f} to {epoch_s.max():.1f} s, the inertial readings"
                f" from {own_s[0]:.1f} to {own_s[-1]:.1f} s",
                "Give both on one clock",
            )


def _check_force_units(recording: Recording, length: NDArray[np.intp]) -> None:
    """Refuse a specific force that is not in m/s^2, or that lacks gravity."""
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    low, high = USUAL_FORCE_M_PER_S2
    for row, count in enumerate(length):
        force = np.asarray(recording.specific_force_m_per_s2[row, :count], dtype=np.float64)
        rate = np.asarray(recording.angular_rate_rad_per_s[row, :count], dtype=np.float64)
        magnitude, turning = np.linalg.norm(force, axis=-1), np.linalg.norm(rate, axis=-1)
        quiet = float(np.median(magnitude[turning <= np.quantile(turning, QUIET_SHARE)]))
        usual = float(np.median(magnitude))
        if low <= usual <= high and quiet >= low:
            continue
        limit, cure = "gravity is 9.8 m/s^2", "Check units and calibration"
        for unit, scale in (("g", GRAVITY_M_PER_S2), ("mg", GRAVITY_M_PER_S2 / 1000)):
            if FORCE_AT_REST_M_PER_S2[0] <= quiet * scale <= FORCE_AT_REST_M_PER_S2[1]:
                limit, cure = f"that is gravity in {unit}, not in m/s^2", f"Multiply by {scale}"
        # Without gravity a walk has any median, also that of a walk in g; but what is left where the foot
        # stands is next to nothing beside a swing, in any unit.
        if quiet < LEAST_LEFT_AT_REST * float(np.quantile(magnitude, 0.99)):
            limit = f"it is {quiet:.3g} where the foot stands: gravity has been taken off"
            cure = "Give what the accelerometer reads, with gravity in it"
        raise InputError(
            f"recording.specific_force_m_per_s2[{row}]", f"its median magnitude is {usual:.3g}; {limit}", cure
        )


def _refuse_limits(name: str, values: Array, row: int) -> None:
    if name == "angular_rate_rad_per_s" and (np.abs(values) > MOST_RATE_RAD_PER_S).any():
        raise InputError(
            f"recording.{name}[{row}]",
            f"its greatest is {np.abs(values).max():.0f}, above {MOST_RATE_RAD_PER_S:.0f} rad/s",
            "These look like degrees a second: multiply by pi / 180",
        )
    for axis in range(3):
        part = values[:, axis]
        for extreme in (part.min(), part.max()):
            at_extreme = part == extreme
            # A look at the few readings there is cheaper than runs of all.
            if np.count_nonzero(at_extreme) < SATURATED_SAMPLES:
                continue
            stuck = spans(at_extreme[None])[0]
            flat = stuck[stuck[:, 1] - stuck[:, 0] >= SATURATED_SAMPLES]
            if not len(flat):
                continue
            off_rest = abs(extreme - np.median(part)) >= LEAST_OFF_REST[name]
            if abs(extreme) < LEAST_SATURATED[name] and not (off_rest and len(flat) >= LEAST_FLAT_RUNS):
                continue
            raise InputError(
                f"recording.{name}[{row}, {int(flat[0, 0])}, {axis}]",
                f"it stays at its extreme, {extreme:.4g}, for {int(flat[0, 1] - flat[0, 0])} readings: the"
                " sensor is at its limit",
                "Use a unit with a wider range, or cut the recording there",
            )


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str, row: int | None = None) -> None:
    if bad.any():
        where = [int(i) for i in np.argwhere(bad)[0]]
        place = ", ".join(str(i) for i in ([] if row is None else [row]) + where)
        raise InputError(f"recording.{name}[{place}]", limit, cure)
