"""The navigation of a flight by inertial sensors, GPS, fixes of a radio system, and landmarks.

See Mirzababaei & Akbari, sections 3 and 5. A strapdown navigation at the rate of its readings, and an
error-state Kalman filter beside it, whose state grows by three with every landmark (eqs. 37 to 59). What the
paper leaves open (start, variances, rates) is a setting of `FlightFilter`.

Inside the filter the error of the position is in metres north, east, down, and so are the landmarks in the
local frame of the site. Readings with a clock of their own are compared with the navigation of their time,
and count at the end of the covariance's step that they fall into: an error ``x`` of that end was ``(I - F t)
x`` at the time t before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Integral
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.error_state import increments
from positioning.inertial.geodetic import (
    ATTITUDE,
    FORCE_BIAS,
    MOST_LATITUDE_RAD,
    POSITION,
    RATE_BIAS,
    VELOCITY,
    Strapdown,
    Together,
    attitude_of,
    fill_metric_error_dynamics,
    metres_per_unit,
    position_scale_m,
    roll_pitch_yaw,
    to_local,
    together,
)
from positioning.inertial.gps import (
    UNITS,
    is_number,
    lagrange_weights,
    metric_observation_matrix,
    usable_gps,
)
from positioning.inertial.landmarks import (
    first_sight,
    from_sensor_m,
    has_direction,
    observation_matrices,
    relative_m,
    sighting_of,
)
from positioning.inertial.strapdown import cross_matrix, rotation
from positioning.model import Array, Recording, Site

MODELS = ("geodetic", "flat")
INTERPOLATIONS = ("linear", "lagrange")
SENSORS = ("gps", "fix", "sighting")
MOST_GAP_S = 0.1
"""A longer gap between readings of the inertial measurement unit is refused; assumed."""
LEAST_COVARIANCE_HZ = 1.0
"""Fewer steps of the covariance are refused: in one the attitude would turn too far; assumed."""
MOST_AWAY_M = 100_000.0
"""Starts and GPS readings farther from the origin are refused; the local frame holds to here."""
FORCE_M_PER_S2 = (5.0, 20.0)
"""Where the median specific force of a flight lies, about gravity; other units lie elsewhere; assumed."""

# Steps of the covariance between two looks at the rounding.
_TIDY = 64
# The condition of the innovation's covariance is looked at so often: in every tenth reading of GPS.
_CONDITION_EVERY = 10
# Readings that are prepared at a time.
_BLOCK = 500
_LANDMARKS_A_BLOCK = 8
# Sightings of a flight that are taken in at a time.
_TOGETHER = 6
# So often what hangs on place and velocity by way of the earth is taken anew: 1e-7 of gravity in that time.
_EARTH_S = 0.2
# Most inertial readings that the strapdown goes through at once.
_AT_ONCE = 10
_NED_OF_ENU = np.array([1, 0, 2])
_DOWN = np.array([1.0, 1.0, -1.0])

Whole = NDArray[np.intp]
Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class FlightFilter:
    """Settings of the filter.

    Attributes
    ----------
    gps, fixes, slam
        Which readings count beside the inertial ones: GPS, ``recording.fix_m``, and sightings of landmarks.
    states
        9, or 15 with the biases of accelerometer and gyroscope.
    model
        Of the error: ``geodetic`` (eqs. 8 to 11) or ``flat`` (eqs. 41 and 42).
    closed_loop
        Whether the estimated error corrects the navigation at once, or stays beside it.
    interpolation, interpolation_order
        Of the navigation at the time of a reading: ``linear`` (eqs. 32 and 33), or ``lagrange`` (eqs. 34 and
        35) with m samples more on either side.
    units
        Of the position in the update by GPS: ``metres`` (eq. 30) or ``radians`` (eq. 28).
    outage_s
        Length of the outage of GPS in place of the recorded one.
    covariance_hz
        Rate of the covariance's steps, and of the updates; assumed.
    force_noise_m_per_s2_per_rt_hz, rate_noise_rad_per_s_per_rt_hz
        Densities of the noise of the readings: a MEMS unit's data sheet (0.1 m/s and 1 degree per root hour,
        rounded); assumed.
    noise_factor
        Multiplies these densities squared: Q of eq. 13 is the data sheet's times this factor.
    force_bias_m_per_s2, rate_bias_rad_per_s, bias_time_s
        Deviation and correlation time of the biases, for 15 states; assumed.
    gps_sigma_m, gps_velocity_sigma_m_per_s
        North, east and down; assumed.
    fix_sigma_m
        Of a fix, along each axis: a mean error of 2.6 m, as in Table 1, if it is a Rayleigh one.
    range_sigma_m, bearing_sigma_rad, elevation_sigma_rad
        Of a sighting; assumed.
    start_sigma_m, start_velocity_sigma_m_per_s, start_attitude_sigma_rad
        North, east and down: of the noted start; assumed.
    """

    gps: bool = True
    fixes: bool = False
    slam: bool = False
    states: int = 9
    model: str = "geodetic"
    closed_loop: bool = True
    interpolation: str = "linear"
    interpolation_order: int = 1
    units: str = "metres"
    outage_s: float | None = None
    covariance_hz: float = 20.0
    force_noise_m_per_s2_per_rt_hz: float = 0.002
    rate_noise_rad_per_s_per_rt_hz: float = 0.0003
    noise_factor: float = 1.0
    force_bias_m_per_s2: float = 0.02
    rate_bias_rad_per_s: float = 0.001
    bias_time_s: float = 300.0
    gps_sigma_m: Triple = (1.5, 1.5, 3.0)
    gps_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.15)
    fix_sigma_m: float = 2.074
    range_sigma_m: float = 0.2
    bearing_sigma_rad: float = 0.01
    elevation_sigma_rad: float = 0.01
    start_sigma_m: Triple = (1.5, 1.5, 3.0)
    start_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.1)
    start_attitude_sigma_rad: Triple = (0.01, 0.01, 0.03)

    def check(self) -> None:
        """Refuse settings without sense.

        Raises
        ------
        InputError
            For an unknown name, a value of another type or length, or a number that is not above zero where
            only such make sense.
        """
        for name in ("gps", "fixes", "slam", "closed_loop"):
            if not isinstance(getattr(self, name), bool):
                raise _setting(self, name, "it is neither true nor false", "Take one of them")
        for name in ("states", "interpolation_order"):
            if not isinstance(getattr(self, name), Integral) or isinstance(getattr(self, name), bool):
                raise _setting(self, name, "it is not a whole number", "Give one, without quotes")
        if self.states not in (9, 15):
            raise _setting(self, "states", "the filter has 9 or 15", "Take one of them")
        for name, known in (("model", MODELS), ("interpolation", INTERPOLATIONS), ("units", UNITS)):
            if not isinstance(getattr(self, name), str) or getattr(self, name) not in known:
                raise _setting(self, name, "it is not known", f"Take one of {list(known)}")
        if not 0 <= self.interpolation_order <= 10:
            raise _setting(self, "interpolation_order", "it is not from 0 to 10", "Correct it")
        if self.outage_s is not None and not is_number(self.outage_s):
            raise _setting(
                self, "outage_s", "it is not a number", "Give seconds, or null for the recorded one"
            )
        for name in (*_ABOVE_ZERO, *_NOT_NEGATIVE):
            value = getattr(self, name)
            if name not in _TRIPLES and not is_number(value):
                raise _setting(self, name, "it is not a number", "Give one, without quotes")
            if name in _TRIPLES and not (
                isinstance(value, list | tuple | np.ndarray)
                and np.shape(value) == (3,)
                and all(is_number(part) for part in value)
            ):
                raise _setting(self, name, "it is not three numbers", "Give those north, east and down")
        for name in _ABOVE_ZERO:
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not ((values > 0) & np.isfinite(values)).all():
                raise _setting(self, name, "it is not above zero", "Correct it")
        for name in _NOT_NEGATIVE:
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not ((values >= 0) & np.isfinite(values)).all():
                raise _setting(self, name, "it is below zero", "Correct it")
        if self.covariance_hz < LEAST_COVARIANCE_HZ:
            raise _setting(
                self,
                "covariance_hz",
                f"it is below {LEAST_COVARIANCE_HZ} Hz, too long a step for the dynamics of the error",
                "Raise it",
            )


def _setting(settings: FlightFilter, name: str, limit: str, cure: str) -> InputError:
    return InputError(f"{name}={getattr(settings, name)!r}", limit, cure)


_TRIPLES: tuple[str, ...] = ("gps_sigma_m", "gps_velocity_sigma_m_per_s")
_TRIPLES += ("start_sigma_m", "start_velocity_sigma_m_per_s", "start_attitude_sigma_rad")
_ABOVE_ZERO: tuple[str, ...] = (
    "covariance_hz",
    "bias_time_s",
    "gps_sigma_m",
    "gps_velocity_sigma_m_per_s",
    "fix_sigma_m",
)
_ABOVE_ZERO += ("range_sigma_m", "bearing_sigma_rad", "elevation_sigma_rad")
_NOT_NEGATIVE: tuple[str, ...] = (
    "force_noise_m_per_s2_per_rt_hz",
    "rate_noise_rad_per_s_per_rt_hz",
    "noise_factor",
)
_NOT_NEGATIVE += ("force_bias_m_per_s2", "rate_bias_rad_per_s", "start_sigma_m")
_NOT_NEGATIVE += ("start_velocity_sigma_m_per_s", "start_attitude_sigma_rad")


@dataclass(frozen=True, kw_only=True)
class FlightNavigation:
    """Where flights were, at the epochs of their recordings, each after the updates of the same interval.

    After the end of a recording all is NaN.

    Attributes
    ----------
    time_s
        [r, n].
    geodetic
        Latitude, longitude, radians, height, metres, [r, n, 3].
    position_m
        East and north in the local frame of the site, [r, n, 2].
    height_m
        Above its origin, [r, n].
    velocity_m_per_s
        North, east and down, [r, n, 3].
    attitude_rad
        Roll, pitch and yaw, [r, n, 3].
    covariance
        Of the errors of position, metres north, east, down, velocity and attitude, [r, n, 9, 9].
    bias
        Of accelerometer and gyroscope at the end, [r, 6], m/s^2 and rad/s; zeros with 9 states.
    landmark_m
        Landmarks at the end, east, north and up, [r, l, 3], up to the greatest number that the stack sees;
        NaN for those never seen.
    landmark_covariance_m2
        [r, l, 3, 3], in the same axes.
    normalised_innovation_squared, degrees_of_freedom
        By the name of the sensor, each [r]: the mean per degree of freedom, NaN without one, and the number.
    innovation_condition
        Greatest condition number of the covariance of GPS innovations, [r], among the first and every tenth
        reading of GPS in the recording; NaN if none of these counts.
    skipped_sightings
        Sightings that told no direction, or were to, [r]: the landmark at, right above or below the sensor.
    """

    time_s: Array
    geodetic: Array
    position_m: Array
    height_m: Array
    velocity_m_per_s: Array
    attitude_rad: Array
    covariance: Array
    bias: Array
    landmark_m: Array
    landmark_covariance_m2: Array
    normalised_innovation_squared: Mapping[str, Array]
    degrees_of_freedom: Mapping[str, Array]
    innovation_condition: Array
    skipped_sightings: Whole


class _Readings(NamedTuple):
    """Inertial readings made ready, worlds last: [i, ...]; those after the end last 0 s.

    There are as many as whole steps of the covariance need.
    """

    force_m_per_s2: Array
    rate_rad_per_s: Array
    duration_s: Array
    # Of the states, [i + 1, w]: the start, and the end of each reading.
    state_time_s: Array
    # Number of readings, [w].
    length: Whole


class _Event(NamedTuple):
    """What happens at the same step in some worlds: one reading each of a sensor, or one epoch each."""

    kind: str
    world: Whole
    item: Whole
    # Numbers of the states about the time, [m, k], with their weights, and the time itself.
    state: Whole
    weight: Array
    time_s: Array


def check_flight(recording: Recording, site: Site, settings: FlightFilter) -> None:
    """Refuse recordings that `navigate_flight` cannot use.

    Parameters
    ----------
    recording
        Stack, one leading axis.
    site
        Stack, with ``origin_geodetic``.
    settings
        What is to count.

    Raises
    ------
    InputError
        For settings without sense; arrays that are missing or do not fit; inertial times that do not increase
        or leave a gap; flights of one stack with so different rates of inertial readings that their
        covariances would not step alike, or with fewer readings than an interpolation needs; readings that
        are not finite; GPS, fixes or sightings before the first inertial reading, or none of them within the
        flight; an outage longer than the flight; an origin, a start or GPS at a pole, or more than 100 km
        from the origin; fixes or sightings that are infinite; what other units would make of a start, a
        specific force or a sighting: a median force outside 5 to 20 m/s^2, an angle of the start or a bearing
        above two pi, an elevation above half of pi, a range below zero.
    """
    settings.check()
    needed = ["imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s", "start_geodetic"]
    needed += ["start_velocity_m_per_s", "start_attitude_rad"]
    if settings.gps:
        needed += ["gps_time_s", "gps_geodetic"]
    if settings.fixes:
        needed += ["fix_m"]
    if settings.slam:
        needed += ["sighting_time_s", "sighting_landmark", "sighting"]
    missing = [name for name in needed if getattr(recording, name) is None]
    if missing:
        raise InputError("recording", f"it has no {', '.join(missing)}", "Give them, or switch their use off")
    if site.origin_geodetic is None:
        raise InputError("site", "it has no origin_geodetic", "Give the origin of its local frame")
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.shape[1] < 2:
        raise InputError(
            "recording.imu_time_s", f"its shape is {time_s.shape}, not [r, i]", "Give two readings or more"
        )
    worlds = len(time_s)
    _check_shapes(recording, site, time_s.shape)
    there = np.isfinite(time_s)
    length = np.count_nonzero(there, axis=1)
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    _refuse("imu_time_s", (behind & there) | np.isinf(time_s), "a time is missing or infinite", "Fill it")
    _refuse("imu_time_s", length[:, None] < 2, "there are fewer than two readings", "Leave the flight out")
    with np.errstate(invalid="ignore"):
        step_s = np.diff(time_s, axis=1)
        _refuse("imu_time_s", step_s <= 0, "time does not increase after it", "Sort, and leave out repeats")
        _refuse(
            "imu_time_s",
            step_s > MOST_GAP_S,
            f"no reading for more than {MOST_GAP_S} s after it",
            "Cut the recording there, or fill the gap; check that times are in seconds",
        )
    least = _window(settings) - 1
    _refuse(
        "imu_time_s",
        length[:, None] < least,
        f"there are fewer readings than the {least} that the interpolation needs",
        "Lower interpolation_order, or leave the flight out",
    )
    strides = _strides(time_s, settings.covariance_hz)
    if (strides != strides[0]).any():
        raise InputError(
            "recording.imu_time_s",
            f"a step of the covariance has {strides.min()} readings in one flight and {strides.max()} in"
            " another",
            "Navigate flights of different rates one by one",
        )
    for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s"):
        bad = ~np.isfinite(getattr(recording, name)).all(axis=-1) & there
        _refuse(name, bad, "the reading is not a finite number", "Leave it out or fill it")
    for name in ("start_geodetic", "start_velocity_m_per_s", "start_attitude_rad"):
        bad = ~np.isfinite(getattr(recording, name))
        _refuse(name, bad, "it is not a finite number", "Give the whole start")
    _check_units(recording)
    origin = np.asarray(site.origin_geodetic, dtype=np.float64)
    _check_places("site.origin_geodetic", origin, np.ones(worlds, dtype=np.bool_))
    starts = np.asarray(recording.start_geodetic, dtype=np.float64)
    _check_places("recording.start_geodetic", starts, np.ones(worlds, dtype=np.bool_), origin)
    begin = time_s[:, 0]
    end = time_s[np.arange(worlds), length - 1]
    start = begin - (time_s[:, 1] - begin)
    flight = np.stack([start, end], axis=1)
    if settings.gps:
        usable = usable_gps(recording, settings.outage_s)
        places = np.asarray(recording.gps_geodetic, dtype=np.float64)
        _check_places("recording.gps_geodetic", places, usable, origin[:, None])
        gps_s = np.asarray(recording.gps_time_s, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            _refuse(
                "gps_time_s",
                gps_s < start[:, None] - 1e-9,
                "it is before the first inertial reading",
                "Leave such readings out, or check that both clocks are the same",
            )
            _refuse("gps_time_s", np.diff(gps_s, axis=1) <= 0, "time does not increase after it", "Sort it")
        _check_span("gps_time_s", gps_s, usable_gps(_without_outage(recording)), flight)
        if recording.gps_outage_s is not None:
            outage = np.asarray(recording.gps_outage_s, dtype=np.float64)
            lasts = outage[:, 1] - outage[:, 0]
            if settings.outage_s is not None:
                lasts = np.where(np.isnan(lasts), np.nan, settings.outage_s)
            with np.errstate(invalid="ignore"):
                _refuse("gps_outage_s", lasts[:, None] < 0, "it ends before it begins", "Correct it")
                _refuse(
                    "gps_outage_s",
                    (lasts > end - start)[:, None],
                    "the outage is longer than the flight",
                    "Shorten it, or switch gps off",
                )
    early, cure = "it is before the first inertial reading", "Leave it out, or check that clocks are the same"
    if settings.fixes:
        fix = np.asarray(recording.fix_m)
        _refuse("fix_m", np.isinf(fix), "the fix is infinite", "Use NaN for none")
        with np.errstate(invalid="ignore"):
            before = np.asarray(recording.time_s, dtype=np.float64) < start[:, None] - 1e-9
        given = np.isfinite(fix[:, :, 0]).all(axis=-1)
        _refuse("fix_m", before & given, early, cure)
        _check_span("time_s of fix_m", np.asarray(recording.time_s, dtype=np.float64), given, flight)
    if settings.slam:
        bad = np.isinf(np.asarray(recording.sighting))
        _refuse("sighting", bad, "the sighting is infinite", "Use NaN for none")
        with np.errstate(invalid="ignore"):
            before = np.asarray(recording.sighting_time_s, dtype=np.float64) < start[:, None] - 1e-9
        given = np.asarray(recording.sighting_landmark) >= 0
        _refuse("sighting_time_s", before & given, early, cure)
        given &= np.isfinite(np.asarray(recording.sighting)).all(axis=-1)
        _check_span("sighting_time_s", np.asarray(recording.sighting_time_s, np.float64), given, flight)
        range_m, bearing, elevation = np.moveaxis(np.asarray(recording.sighting, dtype=np.float64), -1, 0)
        for bad, what in (
            (range_m < 0, "its range is below zero"),
            # The filter wraps bearings, so that both usual circles of them are right.
            (np.abs(bearing) > 2 * np.pi, "its bearing is above 2 pi"),
            (np.abs(elevation) > np.pi / 2, "its elevation is above pi / 2"),
        ):
            _refuse("sighting", bad & given, what, "Check units and order: metres, radians, radians")


def navigate_flight(recording: Recording, site: Site, settings: FlightFilter) -> FlightNavigation:
    """Navigate the flights of a stack of recordings.

    See Mirzababaei & Akbari, sections 3 and 5. The flight starts one interval before the first inertial time,
    which is the end of a reading's interval. Readings after the last inertial one do not count.

    Parameters
    ----------
    recording
        Stack, one leading axis r.
    site
        Stack, with ``origin_geodetic`` [r, 3].
    settings
        Of the filter.

    Raises
    ------
    InputError
        For what `check_flight` refuses.
    """
    check_flight(recording, site, settings)
    return _Run(recording, site, settings).run()


class _Run:
    """One stack on its way; worlds are last in the navigation, first in covariances and readings."""

    def __init__(self, recording: Recording, site: Site, settings: FlightFilter) -> None:
        self.recording, self.settings = recording, settings
        self.origin = np.asarray(site.origin_geodetic, dtype=np.float64)
        self.states = settings.states
        # `check_flight` has seen that all flights have the same.
        self.stride = int(_strides(np.asarray(recording.imu_time_s, np.float64), settings.covariance_hz)[0])
        self.readings = _ready(recording, self.stride)
        self.worlds = self.readings.duration_s.shape[1]
        self.window = _window(settings)
        self.marks, self.landmarks = _landmark_counts(recording) if settings.slam else (0, 0)
        self.mover = Strapdown(
            np.asarray(recording.start_geodetic, np.float64),
            np.asarray(recording.start_velocity_m_per_s, np.float64),
            attitude_of(np.asarray(recording.start_attitude_rad, np.float64)),
        )
        size, worlds = self.states + 3 * self.landmarks, self.worlds
        self.covariance = np.zeros((worlds, size, size))
        self.scratch = np.empty_like(self.covariance)
        # Transition of the vehicle's errors since what it shares with the landmarks was moved.
        self.pending = np.tile(np.eye(self.states), (worlds, 1, 1))
        self._start_covariance()
        # Estimate of the error of the navigation as it stands, zero after a correction.
        self.error = np.zeros((worlds, size))
        self.bias = np.zeros((6, worlds))
        self.step_s = np.cumsum(self.readings.duration_s.reshape(-1, self.stride, worlds), axis=1)[:, -1]
        self.per_s = 1.0 / np.where(self.step_s > 0, self.step_s, 1.0)
        # Velocity increment of the specific force over a step.
        self.force_advance = np.zeros((3, worlds))
        self.map = np.zeros((worlds, self.landmarks, 3))
        self.known = np.zeros((worlds, self.landmarks), dtype=np.bool_)
        self.dynamics = np.zeros((worlds, self.states, self.states))
        self.spread = {name: np.zeros(worlds) for name in SENSORS}
        self.degrees = {name: np.zeros(worlds) for name in SENSORS}
        self.condition = np.full(worlds, np.nan)
        self.skipped = np.zeros(worlds, dtype=np.intp)
        # States of this step and, before them, as many as an interpolation may need.
        self.kept = self.window
        length = self.kept + self.stride
        self.place = np.tile(self.mover.geodetic, (length, 1, 1))
        self.speed = np.tile(self.mover.velocity_m_per_s, (length, 1, 1))
        self.turned = np.tile(self.mover.attitude, (length, 1, 1, 1))
        epochs = np.asarray(recording.time_s).shape
        self.found = FlightNavigation(
            time_s=np.asarray(recording.time_s, np.float64),
            geodetic=np.full((*epochs, 3), np.nan),
            position_m=np.full((*epochs, 2), np.nan),
            height_m=np.full(epochs, np.nan),
            velocity_m_per_s=np.full((*epochs, 3), np.nan),
            attitude_rad=np.full((*epochs, 3), np.nan),
            covariance=np.full((*epochs, 9, 9), np.nan),
            bias=np.zeros((worlds, 6)),
            landmark_m=np.full((worlds, self.marks, 3), np.nan),
            landmark_covariance_m2=np.full((worlds, self.marks, 3, 3), np.nan),
            normalised_innovation_squared={},
            degrees_of_freedom={},
            innovation_condition=self.condition,
            skipped_sightings=self.skipped,
        )

    def run(self) -> FlightNavigation:
        """Go through the whole flight, and return what was found."""
        plan = self._plan()
        count = len(self.readings.duration_s)
        biases = self.states == 15
        block = max(1, _BLOCK // self.stride) * self.stride
        every = max(1, int(_EARTH_S * self.settings.covariance_hz))
        # The strapdown goes through as many readings at once as divide a step of the covariance.
        at_once = max(size for size in range(1, _AT_ONCE + 1) if self.stride % size == 0)
        ready: list[Together] = []
        # The epochs at the start, before any reading: all slots hold the start.
        for event in plan.get(-1, ()):
            self._write(event, 0)
        for step, first in enumerate(range(0, count, self.stride)):
            last = first + self.stride
            if first % block == 0:
                part = slice(first, first + block)
                made = increments(
                    np.moveaxis(self.readings.force_m_per_s2[part], 1, 2),
                    np.moveaxis(self.readings.rate_rad_per_s[part], 1, 2),
                    self.readings.duration_s[part],
                    biases=biases,
                )
                ready = together(made, at_once)
            mover, anew = self.mover, step % every == 0
            if anew:
                mover.look_around()
            self.force_advance[...] = 0.0
            for slots in (self.place, self.speed, self.turned):
                slots[: self.kept] = slots[-self.kept :]
            for slot in range(self.kept, len(self.place), at_once):
                own = (first % block + slot - self.kept) // at_once
                way = mover.advance_together(ready[own], self.bias if biases else None)
                self.place[slot : slot + at_once] = way.geodetic
                self.speed[slot : slot + at_once] = way.velocity_m_per_s
                self.turned[slot : slot + at_once] = way.attitude
                self.force_advance += way.force_advance
            self._propagate(first, last, anew)
            # Number of the state in the first slot.
            offset = first + 1 - self.kept
            events = plan.get(step, ())
            if events:
                self._update(events, offset, last)
            if step % _TIDY == _TIDY - 1:
                mover.tidy()
                self.covariance += self.covariance.swapaxes(1, 2).copy()
                self.covariance *= 0.5
        return self._finish()

    def _start_covariance(self) -> None:
        settings = self.settings
        sigmas = np.concatenate(
            [
                settings.start_sigma_m,
                settings.start_velocity_sigma_m_per_s,
                settings.start_attitude_sigma_rad,
                np.repeat([settings.force_bias_m_per_s2, settings.rate_bias_rad_per_s], 3),
            ]
        )[: self.states]
        self.covariance[:, range(self.states), range(self.states)] = sigmas**2
        density = np.zeros(self.states)
        density[VELOCITY] = settings.noise_factor * settings.force_noise_m_per_s2_per_rt_hz**2
        density[ATTITUDE] = settings.noise_factor * settings.rate_noise_rad_per_s_per_rt_hz**2
        if self.states == 15:
            density[9:] = 2.0 / settings.bias_time_s * sigmas[9:] ** 2
        self.density = density

    def _plan(self) -> dict[int, list[_Event]]:
        """Return what happens at the end of each step, sensors before epochs."""
        recording, settings = self.recording, self.settings
        plan: dict[int, list[_Event]] = {}
        if settings.gps:
            use = usable_gps(recording, settings.outage_s)
            self._add(plan, "gps", np.asarray(recording.gps_time_s, np.float64), use, self.window)
        time_s = np.asarray(recording.time_s, dtype=np.float64)
        if settings.fixes:
            fix = np.asarray(recording.fix_m, dtype=np.float64)[:, :, 0]
            self._add(plan, "fix", time_s, np.isfinite(time_s) & np.isfinite(fix).all(axis=-1), 2)
        if settings.slam and self.landmarks:
            seen_s = np.asarray(recording.sighting_time_s, dtype=np.float64)
            use = np.isfinite(seen_s) & (np.asarray(recording.sighting_landmark) >= 0)
            use &= np.isfinite(np.asarray(recording.sighting)).all(axis=-1)
            self._add(plan, "sighting", seen_s, use, 2)
        self._add(plan, "epoch", time_s, np.isfinite(time_s), 2)
        return plan

    def _add(
        self, plan: dict[int, list[_Event]], kind: str, time_s: Array, use: NDArray[np.bool_], width: int
    ) -> None:
        world, index = np.nonzero(use)
        if not len(world):
            return
        times = time_s[world, index]
        bracket = np.empty(len(world), dtype=np.intp)
        states_s = self.readings.state_time_s
        lengths = self.readings.length
        for one in range(self.worlds):
            own = world == one
            ordered = states_s[: lengths[one] + 1, one]
            # Times equal to that of a state up to rounding belong to its step.
            bracket[own] = np.searchsorted(ordered, times[own] - 1e-9, side="left")
        ends = lengths[world]
        late = times > states_s[ends, world] + 1e-9
        if kind == "epoch":
            times = np.minimum(times, states_s[ends, world])
        elif late.any():
            world, index, times = world[~late], index[~late], times[~late]
            bracket, ends = bracket[~late], ends[~late]
            if not len(world):
                return
        before = (kind == "epoch") & (bracket == 0)
        bracket = np.clip(bracket, 1, ends)
        # At the ends of the recording the window moves inwards.
        begin = np.clip(bracket - width // 2, 0, ends + 1 - width)
        state = begin[:, None] + np.arange(width)
        weight = lagrange_weights(states_s[state, world[:, None]], times)
        if kind == "epoch":
            weight[before] = np.eye(width)[0]
        step = (begin + width - 2) // self.stride
        step[before] = -1
        turn = self._turns(kind, step, world, index)
        order = np.lexsort((index, world, turn, step))
        step, turn = step[order], turn[order]
        cuts = np.flatnonzero((np.diff(step) != 0) | (np.diff(turn) != 0)) + 1
        parts = (np.split(part[order], cuts) for part in (world, index, state, weight, times))
        for number, *group in zip(step[np.append(0, cuts)], *parts, strict=True):
            plan.setdefault(int(number), []).append(_Event(kind, *group))

    def _turns(self, kind: str, step: Whole, world: Whole, index: Whole) -> Whole:
        """Return which readings of a step are taken in together, by increasing numbers.

        One each a world, but of sightings as many as `_TOGETHER`, each of another landmark: the first of a
        landmark may make it part of the state.
        """
        if kind != "sighting":
            return _rank(index, step, world)
        assert self.recording.sighting_landmark is not None
        number = np.asarray(self.recording.sighting_landmark, dtype=np.intp)[world, index]
        again = _rank(index, step, world, number)
        part = _rank(index, step, world, again) // _TOGETHER
        return np.asarray(again * (part.max() + 1) + part, dtype=np.intp)

    def _propagate(self, first: int, last: int, anew: bool) -> None:
        """Move the covariance over a step, and keep its dynamics.

        See Mirzababaei & Akbari, eqs. 14, 17 and 18 (to second order in time), and 54. What vehicle and
        landmarks have in common waits for the next reading: `_settle`.
        """
        mover, states, dynamics = self.mover, self.states, self.dynamics
        duration, per_s = self.step_s[first // self.stride], self.per_s[first // self.stride]
        if self.settings.model == "flat":
            dynamics[:, range(3), range(3, 6)] = 1.0
        elif anew:
            fill_metric_error_dynamics(dynamics, mover.around, mover.velocity_m_per_s)
        dynamics[:, VELOCITY, ATTITUDE] = cross_matrix((self.force_advance * per_s).T)
        if states == 15:
            matrix = 0.5 * (self.turned[self.kept - 1] + self.turned[self.kept + last - first - 1])
            matrix = matrix.transpose(2, 0, 1)
            dynamics[:, VELOCITY, FORCE_BIAS] = matrix
            dynamics[:, ATTITUDE, RATE_BIAS] = -matrix
            np.einsum("rii->ri", dynamics)[:, 9:] = -1.0 / self.settings.bias_time_s
        change = dynamics * duration[:, None, None]
        change += 0.5 * (change @ change)
        np.einsum("rii->ri", change)[...] += 1.0
        covariance = self.covariance
        vehicle = covariance[:, :states, :states]
        np.einsum("rii->ri", vehicle)[...] += self.density * duration[:, None]
        vehicle[...] = change @ vehicle @ change.swapaxes(1, 2)
        if self.landmarks:
            self.pending = change @ self.pending
        if not self.settings.closed_loop:
            self.error[:, :states] = (change @ self.error[:, :states, None])[..., 0]

    def _settle(self, world: Whole) -> None:
        """Move what vehicle and landmarks have in common over the steps since the last reading of worlds."""
        states, covariance = self.states, self.covariance
        if len(world) == self.worlds:
            cross = self.pending @ covariance[:, :states, states:]
            covariance[:, :states, states:] = cross
            covariance[:, states:, :states] = cross.swapaxes(1, 2)
        else:
            cross = self.pending[world] @ covariance[world, :states, states:]
            covariance[world, :states, states:] = cross
            covariance[world, states:, :states] = cross.swapaxes(1, 2)
        self.pending[world] = np.eye(states)

    def _update(self, events: list[_Event], offset: int, last: int) -> None:
        """Take in the readings of a step, correct, and write the epochs down."""
        end_s = self.readings.state_time_s[last]
        readings = [event for event in events if event.kind != "epoch"]
        if readings and self.landmarks:
            self._settle(np.unique(np.concatenate([event.world for event in readings])))
        for event in readings:
            take = {"gps": self._gps, "fix": self._fix, "sighting": self._sighting}[event.kind]
            take(event, offset, end_s[event.world] - event.time_s)
        if readings and self.settings.closed_loop:
            self._correct()
        for event in events:
            if event.kind == "epoch":
                self._write(event, offset)

    def _at_end(self, observed: Array, world: Whole, ago_s: Array) -> Array:
        """Return derivatives by the errors now of what hangs on those some time ago, [m, p, s]."""
        parts = observed.shape[-1]
        now = observed @ self.dynamics[world, :parts]
        now *= -ago_s[:, None, None]
        now[..., :parts] += observed
        return np.asarray(now)

    def _at(self, event: _Event, offset: int) -> tuple[Array, Array, Array]:
        """Return geodetic position, velocity and attitude of the navigation at the times of an event.

        See Mirzababaei & Akbari, eqs. 32 to 35. Attitudes are averaged likewise: 1e-5 rad at 1 rad/s.
        """
        slot, world = event.state - offset, event.world[:, None]
        weight = event.weight[..., None]
        place = np.sum(weight * self.place[slot, :, world], axis=1)
        speed = np.sum(weight * self.speed[slot, :, world], axis=1)
        turned = np.sum(weight[..., None] * self.turned[slot, :, :, world], axis=1)
        return place, speed, turned

    def _gps(self, event: _Event, offset: int, ago_s: Array) -> None:
        """Take in GPS; see Mirzababaei & Akbari, eqs. 27 to 36.1 and 52."""
        recording, settings, world, index = self.recording, self.settings, event.world, event.item
        place, speed, turned = self._at(event, offset)
        levers = recording.gps_lever_arm_m
        lever = np.zeros((len(world), 3)) if levers is None else np.asarray(levers, np.float64)[world]
        reading = np.clip(event.state[:, event.state.shape[1] // 2] - 1, 0, None)
        rate = self.readings.rate_rad_per_s[reading, :, world] - self.bias[3:, world].T
        rate -= (self.mover.frame_rate_rad_per_s()[:, world].T[:, None] @ turned)[:, 0]
        observed = metric_observation_matrix(turned, rate, lever, states=self.states)
        scale = position_scale_m(place)
        assert recording.gps_geodetic is not None
        away = (turned @ lever[..., None])[..., 0]
        innovation = (place - recording.gps_geodetic[world, index]) * scale + away
        sigma = np.broadcast_to(settings.gps_sigma_m, innovation.shape)
        if recording.gps_velocity_m_per_s is None:
            observed = observed[:, :3]
        else:
            moving = (turned @ np.cross(rate, lever)[..., None])[..., 0]
            faster = speed + moving - recording.gps_velocity_m_per_s[world, index]
            innovation = np.concatenate([innovation, faster], axis=1)
            velocity_sigma = np.broadcast_to(settings.gps_velocity_sigma_m_per_s, speed.shape)
            sigma = np.concatenate([sigma, velocity_sigma], axis=1)
        if settings.units == "radians":
            per_row = np.ones_like(innovation)
            per_row[:, :3] = 1.0 / np.abs(scale)
            observed, innovation, sigma = observed * per_row[..., None], innovation * per_row, sigma * per_row
        variance = self._take("gps", world, self._at_end(observed, world, ago_s), innovation, sigma**2)
        some = np.flatnonzero(index % _CONDITION_EVERY == 0)
        if len(some):
            number = np.linalg.cond(variance[some])
            self.condition[world[some]] = np.fmax(self.condition[world[some]], number)

    def _fix(self, event: _Event, offset: int, ago_s: Array) -> None:
        """Take in a position in the plane."""
        place, _, _ = self._at(event, offset)
        world = event.world
        assert self.recording.fix_m is not None
        fix = np.asarray(self.recording.fix_m[world, event.item, 0], dtype=np.float64)
        local = to_local(place, self.origin[world])
        observed = np.broadcast_to(np.eye(2, self.states), (len(world), 2, self.states))
        innovation = local[:, 1::-1] - fix[:, ::-1]
        variance = np.full(innovation.shape, self.settings.fix_sigma_m**2)
        self._take("fix", world, self._at_end(observed, world, ago_s), innovation, variance)

    def _sighting(self, event: _Event, offset: int, ago_s: Array) -> None:
        """Take in the sighting of a landmark, or make it part of the state.

        See Mirzababaei & Akbari, eqs. 44 to 51, and section 4 for a landmark that is new.
        """
        recording, settings, world, index = self.recording, self.settings, event.world, event.item
        assert recording.sighting is not None
        assert recording.sighting_landmark is not None
        place, _, turned = self._at(event, offset)
        local = to_local(place, self.origin[world])[:, _NED_OF_ENU] * _DOWN
        seen = np.asarray(recording.sighting[world, index], dtype=np.float64)
        number = np.asarray(recording.sighting_landmark[world, index], dtype=np.intp)
        levers = recording.sighting_lever_arm_m
        lever = np.zeros((len(world), 3)) if levers is None else np.asarray(levers, np.float64)[world]
        sigma = np.array([settings.range_sigma_m, settings.bearing_sigma_rad, settings.elevation_sigma_rad])
        known = self.known[world, number]
        again = np.flatnonzero(known)
        if len(again):
            relative = from_sensor_m(
                self.map[world[again], number[again]], local[again], turned[again], lever[again]
            )
            sure = has_direction(relative) & has_direction(relative_m(seen[again]))
            np.add.at(self.skipped, world[again[~sure]], 1)
            again, relative = again[sure], relative[sure]
        if len(again):
            one, mark = world[again], number[again]
            by_vehicle, by_landmark = observation_matrices(
                self.map[one, mark], local[again], turned[again], lever[again]
            )
            innovation = sighting_of(relative) - seen[again]
            innovation[:, 1] = (innovation[:, 1] + np.pi) % (2 * np.pi) - np.pi
            observed = self._at_end(by_vehicle, one, ago_s[again])
            self._take_sightings(one, mark, observed, by_landmark, innovation, sigma**2)
        fresh = np.flatnonzero(~known)
        if len(fresh):
            sure = has_direction(relative_m(seen[fresh]))
            np.add.at(self.skipped, world[fresh[~sure]], 1)
            fresh = fresh[sure]
        # One after the other: what two have in common is part of the second one's covariance.
        rank = _rank(fresh, world[fresh])
        for turn in range(int(rank.max(initial=-1)) + 1):
            new = fresh[rank == turn]
            landmark, by_vehicle, by_sighting = first_sight(local[new], turned[new], lever[new], seen[new])
            by_state = self._at_end(by_vehicle, world[new], ago_s[new])
            self._augment(world[new], number[new], landmark, by_state, by_sighting * sigma)

    def _take_sightings(
        self,
        world: Whole,
        mark: Whole,
        observed: Array,
        by_landmark: Array,
        innovation: Array,
        variance: Array,
    ) -> None:
        """Take in sightings of known landmarks, at most `_TOGETHER` a world, in one step.

        See Mirzababaei & Akbari, eqs. 55 to 59. Filled up with sightings that tell nothing, so that the
        rounding of a flight does not hang on what others of its stack see.
        """
        states, number = self.states, np.unique(world)
        # Nothing changes where nothing is seen; most of a stack is cheaper to move in place than to pick.
        if 2 * len(number) > self.worlds:
            number = np.arange(self.worlds)
        count, every = len(number), np.searchsorted(number, world)
        slot = np.arange(len(world)) - np.searchsorted(world, world)
        vehicle = np.zeros((count, _TOGETHER, 3, states))
        landmark = np.zeros((count, _TOGETHER, 3, 3))
        rows = np.zeros((count, _TOGETHER, 3), dtype=np.intp)
        left, spreads = np.zeros((count, _TOGETHER, 3)), np.ones((count, _TOGETHER, 3))
        vehicle[every, slot], landmark[every, slot] = observed, by_landmark
        rows[every, slot] = states + 3 * mark[:, None] + np.arange(3)
        left[every, slot], spreads[every, slot] = innovation, variance
        parts = 3 * _TOGETHER
        flat = vehicle.reshape(count, parts, states)
        whole = count == self.worlds
        covariance = self.covariance if whole else self.covariance[number]
        error = self.error if whole else self.error[number]
        each = np.arange(count)[:, None, None]
        row_gain = flat @ covariance[:, :states]
        # Symmetric: the rows lie together in memory.
        row_gain.reshape(count, _TOGETHER, 3, -1)[...] += landmark @ covariance[each, rows]
        spread = flat @ row_gain[:, :, :states].swapaxes(1, 2)
        spread += (landmark @ row_gain.swapaxes(1, 2)[each, rows]).reshape(count, parts, parts)
        left -= (vehicle @ error[:, None, :states, None])[..., 0]
        left -= (landmark @ error[each, rows][..., None])[..., 0]
        self._lower(
            "sighting",
            number,
            row_gain,
            spread,
            left.reshape(count, parts),
            spreads.reshape(count, parts),
            3 * np.bincount(every, minlength=count),
        )

    def _augment(self, world: Whole, number: Whole, landmark: Array, by_state: Array, noisy: Array) -> None:
        """Make landmarks part of the state, one a world, with their covariance with everything else."""
        states = self.states
        rows = states + 3 * number[:, None] + np.arange(3)
        crossed = by_state @ self.covariance[world, :states]
        own = crossed[:, :, :states] @ by_state.swapaxes(1, 2) + noisy @ noisy.swapaxes(1, 2)
        self.covariance[world[:, None], rows] = crossed
        self.covariance[world[:, None], :, rows] = crossed
        self.covariance[world[:, None, None], rows[:, :, None], rows[:, None]] = own
        self.map[world, number] = landmark
        self.error[world[:, None], rows] = (by_state @ self.error[world, :states, None])[..., 0]
        self.known[world, number] = True

    def _take(self, kind: str, world: Whole, observed: Array, innovation: Array, variance: Array) -> Array:
        """Take in one reading in some worlds; return the covariance of the innovation.

        See Mirzababaei & Akbari, eqs. 55 to 59.
        """
        states = self.states
        row_gain = observed @ self.covariance[world, :states]
        spread = observed @ row_gain[:, :, :states].swapaxes(1, 2)
        left = innovation - (observed @ self.error[world, :states, None])[..., 0]
        degrees = np.full(len(world), innovation.shape[1])
        return self._lower(kind, world, row_gain, spread, left, variance, degrees)

    def _lower(
        self,
        kind: str,
        world: Whole,
        row_gain: Array,
        spread: Array,
        left: Array,
        variance: Array,
        degrees: Whole,
    ) -> Array:
        """Move errors and covariances of some worlds by an innovation; return its covariance."""
        spread = 0.5 * (spread + spread.swapaxes(1, 2))
        parts = left.shape[1]
        spread[:, range(parts), range(parts)] += variance
        inverse = np.linalg.inv(spread)
        gain = inverse @ row_gain
        moved = (left[:, None] @ gain)[:, 0]
        if len(world) == self.worlds:
            self.error += moved
            self.covariance -= np.matmul(row_gain.swapaxes(1, 2), gain, out=self.scratch)
        else:
            self.error[world] += moved
            self.covariance[world] -= row_gain.swapaxes(1, 2) @ gain
        self.spread[kind][world] += (left[:, None] @ inverse @ left[..., None])[:, 0, 0]
        self.degrees[kind][world] += degrees
        return np.asarray(spread)

    def _correct(self) -> None:
        """Move the estimated error into navigation, biases and map, and forget it.

        Towards the truth, with the error of `geodetic`: C <- (I + E) C, here by the exact rotation. The
        states kept for interpolation move alike.
        """
        mover, error = self.mover, self.error
        shift = (error[:, POSITION] / metres_per_unit(mover.around)).T
        turn = rotation(error[:, ATTITUDE])
        mover.geodetic -= shift
        mover.velocity_m_per_s -= error[:, VELOCITY].T
        mover.attitude[...] = (turn @ mover.attitude.transpose(2, 0, 1)).transpose(1, 2, 0)
        self.place -= shift
        self.speed -= error[:, VELOCITY].T
        self.turned[...] = (turn @ self.turned.transpose(0, 3, 1, 2)).transpose(0, 2, 3, 1)
        if self.states == 15:
            self.bias += error[:, 9:15].T
        if self.landmarks:
            self.map -= error[:, self.states :].reshape(self.map.shape)
        error[...] = 0.0

    def _write(self, event: _Event, offset: int) -> None:
        """Write down the state at epochs."""
        place, speed, turned = self._at(event, offset)
        world, index, found = event.world, event.item, self.found
        if not self.settings.closed_loop:
            error = self.error[world]
            place = place - error[:, POSITION] / position_scale_m(place)
            speed = speed - error[:, VELOCITY]
            turned = rotation(error[:, ATTITUDE]) @ turned
        local = to_local(place, self.origin[world])
        found.geodetic[world, index] = place
        found.position_m[world, index] = local[:, :2]
        found.height_m[world, index] = local[:, 2]
        found.velocity_m_per_s[world, index] = speed
        found.attitude_rad[world, index] = roll_pitch_yaw(turned)
        found.covariance[world, index] = self.covariance[world, :9, :9]

    def _finish(self) -> FlightNavigation:
        found, states = self.found, self.states
        estimated = self.map
        if states == 15:
            found.bias[...] = self.bias.T + self.error[:, 9:15]
        if self.landmarks:
            estimated = self.map - self.error[:, states:].reshape(self.map.shape)
        seen = self.known[:, : self.marks]
        found.landmark_m[seen] = estimated[self.known][:, _NED_OF_ENU] * _DOWN
        blocks = self.covariance[:, states:, states:].reshape(
            self.worlds, self.landmarks, 3, self.landmarks, 3
        )
        each = np.arange(self.landmarks)
        own = np.moveaxis(blocks[:, each, :, each, :], 0, 1)
        own = own[..., _NED_OF_ENU, :][..., _NED_OF_ENU] * _DOWN[:, None] * _DOWN
        found.landmark_covariance_m2[seen] = own[self.known]
        normalised: dict[str, Array] = {}
        for name in SENSORS:
            count = self.degrees[name]
            mean = self.spread[name] / np.where(count > 0, count, 1.0)
            normalised[name] = np.where(count > 0, mean, np.nan)
        return replace(found, normalised_innovation_squared=normalised, degrees_of_freedom=self.degrees)


def _ready(recording: Recording, stride: int) -> _Readings:
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    there = np.isfinite(time_s)
    length = np.count_nonzero(there, axis=1)
    start = 2 * time_s[:, 0] - time_s[:, 1]
    ends = time_s[np.arange(len(time_s)), length - 1]
    more = -time_s.shape[1] % stride
    there = np.pad(there, ((0, 0), (0, more)))
    times_s = np.where(there, np.pad(time_s, ((0, 0), (0, more))), ends[:, None])
    states_s = np.concatenate([start[:, None], times_s], axis=1).T

    def parts(values: Array | None) -> Array:
        whole = np.pad(np.asarray(values, dtype=np.float64), ((0, 0), (0, more), (0, 0)))
        return np.ascontiguousarray(np.moveaxis(np.where(there[..., None], whole, 0.0), 0, -1))

    return _Readings(
        parts(recording.specific_force_m_per_s2),
        parts(recording.angular_rate_rad_per_s),
        np.ascontiguousarray(np.diff(states_s, axis=0)),
        np.ascontiguousarray(states_s),
        np.asarray(length, dtype=np.intp),
    )


def _strides(imu_time_s: Array, covariance_hz: float) -> Whole:
    """Return how many readings a step of the covariance comprises, [w], by the median interval of each."""
    step_s = np.nanmedian(np.diff(imu_time_s, axis=1), axis=1)
    return np.asarray(np.maximum(1, np.rint(1.0 / (covariance_hz * step_s))), dtype=np.intp)


def _rank(index: Whole, *keys: Whole) -> Whole:
    """Return how many with the same keys have a smaller index, [m]."""
    order = np.lexsort((index, *keys[::-1]))
    position = np.arange(len(order))
    fresh = np.zeros(len(order), dtype=np.bool_)
    fresh[:1] = True
    for key in keys:
        fresh[1:] |= np.diff(key[order]) != 0
    rank = np.empty_like(position)
    rank[order] = position - np.maximum.accumulate(np.where(fresh, position, 0))
    return rank


def _window(settings: FlightFilter) -> int:
    """Return the number of states that an interpolation at the time of GPS takes."""
    return 2 + (2 * settings.interpolation_order if settings.interpolation == "lagrange" else 0)


def _landmark_counts(recording: Recording) -> tuple[int, int]:
    """Return the number of landmarks, and of those that the state has room for.

    Always some more than there are, in whole blocks of the products of matrices: the rounding of a flight
    then does not hang on the landmarks that others of its stack see.
    """
    most = int(np.max(np.asarray(recording.sighting_landmark), initial=-1)) + 1
    return most, 0 if most == 0 else _LANDMARKS_A_BLOCK * (most // _LANDMARKS_A_BLOCK + 1)


def _check_shapes(recording: Recording, site: Site, shape: tuple[int, ...]) -> None:
    """Refuse arrays that do not fit the times of a stack."""
    worlds = shape[0]
    epochs = np.shape(recording.time_s)
    wanted: dict[str, tuple[int | None, ...]] = {
        "time_s": (worlds, None),
        "specific_force_m_per_s2": (*shape, 3),
        "angular_rate_rad_per_s": (*shape, 3),
        "start_geodetic": (worlds, 3),
        "start_velocity_m_per_s": (worlds, 3),
        "start_attitude_rad": (worlds, 3),
        "gps_time_s": (worlds, None),
        "gps_lever_arm_m": (worlds, 3),
        "gps_outage_s": (worlds, 2),
        "fix_m": (worlds, epochs[1] if len(epochs) == 2 else None, 1, 2),
        "sighting_time_s": (worlds, None),
        "sighting_lever_arm_m": (worlds, 3),
    }
    if recording.gps_time_s is not None:
        own = (worlds, recording.gps_time_s.shape[-1], 3)
        wanted |= {"gps_geodetic": own, "gps_velocity_m_per_s": own}
    if recording.sighting_time_s is not None:
        own = (worlds, recording.sighting_time_s.shape[-1], 3)
        wanted |= {"sighting": own, "sighting_landmark": own[:2]}
    for name, fitting in wanted.items():
        values = getattr(recording, name)
        if values is None:
            continue
        got = np.shape(values)
        if len(got) != len(fitting) or any(b not in (None, a) for a, b in zip(got, fitting, strict=True)):
            raise InputError(
                f"recording.{name}",
                f"its shape is {got}, not {tuple('any' if size is None else size for size in fitting)}",
                "Give stacks with the same flights, one leading axis",
            )
    origin = np.asarray(site.origin_geodetic)
    if origin.shape != (worlds, 3):
        raise InputError(
            "site.origin_geodetic",
            f"its shape is {origin.shape}, not {(worlds, 3)}",
            "Give one a flight",
        )


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    if bad.any():
        where = tuple(int(number) for number in np.argwhere(bad)[0])
        raise InputError(f"recording.{name}{list(where)}", limit, cure)


def _check_units(recording: Recording) -> None:
    """Refuse angles of the start, and specific forces, that other units would make."""
    turned = np.abs(np.asarray(recording.start_attitude_rad, dtype=np.float64)) > 2 * np.pi
    _refuse("start_attitude_rad", turned, "it is above 2 pi", "Check units: radians")
    force = np.asarray(recording.specific_force_m_per_s2, dtype=np.float64)
    middle = np.nanmedian(np.linalg.norm(force, axis=-1), axis=1)
    low, high = FORCE_M_PER_S2
    for world in np.flatnonzero(~((middle >= low) & (middle <= high)))[:1]:
        raise InputError(
            f"recording.specific_force_m_per_s2[{world}]",
            f"its median is {middle[world]:.3g} m/s^2, not {low:g} to {high:g}",
            "Check units: m/s^2, with gravity in them",
        )


def _check_places(
    name: str, geodetic: Array, counts: NDArray[np.bool_], origin_geodetic: Array | None = None
) -> None:
    """Refuse places that are not finite, at a pole, or far from the origin, where they count."""
    cure = "Check radians and the order latitude, longitude, height"

    def refuse(bad: NDArray[np.bool_], limit: str) -> None:
        for where in np.argwhere(bad & counts)[:1]:
            number, value = tuple(int(part) for part in where), geodetic[tuple(where)]
            told = ", ".join(f"{part:g}" for part in value)
            raise InputError(f"{name}{list(number)} = [{told}]", limit, cure)

    refuse(np.asarray(~np.isfinite(geodetic).all(axis=-1)), "it is not a finite number")
    with np.errstate(invalid="ignore"):
        degrees = np.degrees(MOST_LATITUDE_RAD)
        polar = ~(np.abs(geodetic[..., 0]) <= MOST_LATITUDE_RAD)
        refuse(np.asarray(polar), f"its latitude is not within {degrees:.1f} degrees of the equator")
        if origin_geodetic is not None:
            away_m = np.linalg.norm(to_local(geodetic, origin_geodetic), axis=-1)
            refuse(away_m > MOST_AWAY_M, f"it is more than {MOST_AWAY_M / 1000:g} km from the origin")


def _check_span(name: str, time_s: Array, given: NDArray[np.bool_], flight_s: Array) -> None:
    """Refuse flights that have readings of a sensor, but none between their begin and end."""
    for world, (begin, end) in enumerate(flight_s):
        own = time_s[world][given[world] & np.isfinite(time_s[world])]
        if len(own) and not ((own >= begin - 1e-9) & (own <= end + 1e-9)).any():
            raise InputError(
                f"recording.{name}[{world}]",
                f"its readings are from {own.min():g} to {own.max():g} s, the flight from {begin:g} to"
                f" {end:g} s, so that none is within it",
                "Check that times are in seconds and of the same clock",
            )


def _without_outage(recording: Recording) -> Recording:
    return replace(recording, gps_outage_s=None)
