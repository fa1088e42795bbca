"""What is observed, and what is true: the few types that all rooms of the project share.

Arrays may carry leading axes, written ``...``: a file of many worlds has a world axis in front, one
world has none. Units stand in the names; ``NaN`` in a received signal strength means *not heard*.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError

Array = NDArray[np.float64]
Arrays = Mapping[str, NDArray[np.generic]]
"""Named arrays as they stand in a file: ``<type>.<field>``, for example ``survey.rss_dbm``."""


class Worlds(NamedTuple):
    """A stack of worlds: what an algorithm may see, and what only the scoring may see.

    Both are flat mappings of names to arrays whose first axis is the world.
    """

    observed: dict[str, NDArray[np.generic]]
    truth: dict[str, NDArray[np.generic]]


class _Part:
    """Conversion of a dataclass to and from the named arrays of a file."""

    @classmethod
    def prefix(cls) -> str:
        return cls.__name__.lower()

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> Self | None:
        """Take this part out of named arrays; None where the file does not hold it."""
        found = {
            field.name: arrays[f"{cls.prefix()}.{field.name}"]
            for field in fields(cls)  # type: ignore[arg-type]
            if f"{cls.prefix()}.{field.name}" in arrays
        }
        return cls(**found) if found else None

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the fields that are set, named as in a file."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return {f"{self.prefix()}.{name}": v for name, v in values.items() if v is not None}

    def at(self, index: int) -> Self:
        """Take one out of a stack: the leading axis of every array goes."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return type(self)(**{name: None if v is None else v[index] for name, v in values.items()})


@dataclass(frozen=True, kw_only=True)
class Site(_Part):
    """The place: what is known of it before any radio measurement.

    Attributes
    ----------
    corner_m
        Lower left and upper right corner of the area, [..., 2, 2], metres.
    access_point_m
        Positions of the access points, [..., ap, 2], metres; None where nobody surveyed them.
    wall_m
        End points of the walls, [..., wall, 2, 2], metres, filled up with NaN where worlds have
        different numbers of walls; None where there is no plan.
    magnetic_north_rad
        Direction to magnetic north, [...], radians from the x axis to the left; None where nobody knows it.
    origin_geodetic
        Where the origin of the local frame, x east and y north, lies on the earth, [..., 3]: latitude and
        longitude, radians, and height above the ellipsoid, metres; None where no satellite is used.
    """

    corner_m: Array
    access_point_m: Array | None = None
    wall_m: Array | None = None
    magnetic_north_rad: Array | None = None
    origin_geodetic: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Survey(_Part):
    """Fingerprints taken at known places.

    Attributes
    ----------
    rss_dbm
        Received signal strength, [..., n, ap], dBm; NaN = not heard.
    position_m
        Where each fingerprint was taken, [..., n, 2], metres.
    """

    rss_dbm: Array
    position_m: Array

    def check(self, name: str = "survey", least: int = 2) -> Survey:
        """Return this survey if it can be used.

        An access point that is never heard and a fingerprint that hears nothing are allowed: they
        carry no information, and every algorithm of the project gives a finite answer with them.

        Parameters
        ----------
        name
            The name under which the user knows this survey, for the error.
        least
            The smallest number of different positions that the caller can work with.

        Raises
        ------
        InputError
            For arrays that do not fit each other, infinite values, positions that are not
            numbers, or fewer than ``least`` different positions.
        """
        rss, position = np.asarray(self.rss_dbm), np.asarray(self.position_m)
        if rss.ndim < 2 or position.shape != (*rss.shape[:-1], 2):
            raise InputError(
                name,
                f"rss_dbm {rss.shape} and position_m {position.shape} do not fit [n, ap] and [n, 2]",
                "Give one row of two coordinates for every fingerprint",
            )
        for what, values, bad in (
            ("rss_dbm", rss, np.isinf(rss)),
            ("position_m", position, ~np.isfinite(position)),
        ):
            if bad.any():
                where = tuple(int(i) for i in np.argwhere(bad)[0])
                raise InputError(
                    f"{name}, {what}{list(where)}",
                    f"the value {values[where]} is not a finite number",
                    "Use NaN in rss_dbm for an access point that was not heard, and leave out"
                    " fingerprints without a position",
                )
        for world in position.reshape(-1, *position.shape[-2:]):
            different = len(np.unique(world, axis=0))
            if different < least:
                raise InputError(
                    name,
                    f"{different} different position(s), at least {least} are needed",
                    "Survey more places",
                )
        return self


@dataclass(frozen=True, kw_only=True)
class Query(_Part):
    """Fingerprints whose place is asked for, where they are not those of the survey itself.

    Attributes
    ----------
    rss_dbm
        Received signal strength, [..., m, ap], dBm; NaN = not heard.
    """

    rss_dbm: Array


@dataclass(frozen=True, kw_only=True)
class Truth(_Part):
    """What only the scoring, and the controls, may see.

    Attributes
    ----------
    position_m
        True position of each fingerprint that is located, [..., n, 2], metres.
    field_dbm
        True mean received signal strength at those positions, [..., n, ap], dBm, before
        fading, rounding and the detection floor; None for real recordings.
    noise_db
        Standard deviation of the fading of a scan about ``field_dbm``, [...], dB.
    floor_dbm
        Detection floor, [...], dBm: a rounded reading below it is not heard.
    heading_rad
        True heading at each epoch of a recording, [..., n], radians, not wrapped.
    distance_m
        True distance to each beacon at each epoch, [..., n, b], metres.
    law_distance_m, law_dbm
        Mean received signal strength by distance, of all beacons alike: knots of a piecewise linear
        curve, [..., g], metres and dBm.
    offset_dbm
        What a place adds to the law for each beacon, [..., gx, gy, b], dB: nodes of a grid from corner to
        corner of the site, bilinear between them.
    grid_m
        Distance of these nodes, [...], metres.
    deviation_db
        Standard deviation of the reading of an epoch about its mean, [...], dB.
    turn_noise_rad, advance_noise_m, drift_noise_rad_per_m
        Standard deviations of the true motion about the recorded one, [...]: of each turn, of each
        translation, and of the drift of the heading per metre of it.
    furniture_m
        Lower left and upper right corners of pieces of furniture, [..., f, 2, 2], metres; NaN fills up.
    path_m
        True place at every epoch of a recording, [..., n, 2], metres, where ``position_m`` holds only the
        epochs at which the error is asked for.
    gyro_bias_rad_per_s
        What the gyroscope of a moving receiver reads too much, beyond its mean at rest, [...], rad/s.
    odometer_scale
        Speed that the odometer reads, as a multiple of the true one, [...].
    stance_time_s
        Begin and end of each stance of the foot that carries the sensors, [..., s, 2], seconds; NaN fills up.
    stance_m
        Place of the sensor in each of them, [..., s, 3], metres.
    landmark
        Number of the surveyed landmark where a walk stands, [..., k, n]; -1 = none.
    query_m
        Where the fingerprints of `Query` were taken, [..., m, 2], metres, where ``position_m`` holds others.
    on_point_m
        True position at the epochs at which a calibration point is passed, [..., n, 2], metres, else NaN.
    height_m
        Height above the origin of the local frame at each epoch, [..., n], metres.
    velocity_m_per_s
        North, east and down at each epoch, [..., n, 3].
    attitude_rad
        Roll, pitch and yaw of the body, x forward, y right, z down, against north, east, down at each epoch,
        [..., n, 3].
    landmark_m
        True landmarks, [..., l, 3], metres: east, north, up in the local frame.
    """

    position_m: Array
    field_dbm: Array | None = None
    noise_db: Array | None = None
    floor_dbm: Array | None = None
    heading_rad: Array | None = None
    distance_m: Array | None = None
    law_distance_m: Array | None = None
    law_dbm: Array | None = None
    offset_dbm: Array | None = None
    grid_m: Array | None = None
    deviation_db: Array | None = None
    turn_noise_rad: Array | None = None
    advance_noise_m: Array | None = None
    drift_noise_rad_per_m: Array | None = None
    furniture_m: Array | None = None
    path_m: Array | None = None
    gyro_bias_rad_per_s: Array | None = None
    odometer_scale: Array | None = None
    stance_time_s: Array | None = None
    stance_m: Array | None = None
    landmark: NDArray[np.integer[Any]] | None = None
    query_m: Array | None = None
    on_point_m: Array | None = None
    height_m: Array | None = None
    velocity_m_per_s: Array | None = None
    attitude_rad: Array | None = None
    landmark_m: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Calibration(_Part):
    """A run that tells how received strength goes with distance, made before anything is located.

    Attributes
    ----------
    distance_m
        True distance between transmitter and receiver, [..., n], metres; NaN fills up.
    rss_dbm
        Received signal strength there, [..., n], dBm; NaN = not heard.
    """

    distance_m: Array
    rss_dbm: Array


@dataclass(frozen=True, kw_only=True)
class Recording(_Part):
    """What a moving receiver (or transmitter) recorded, epoch after epoch.

    Runs of different length share one array: after its end a run is filled up with NaN.

    Attributes
    ----------
    time_s
        Time of each epoch, [..., n], seconds; NaN after the end.
    rss_dbm
        Received signal strength, [..., n, ap], dBm; NaN = not heard.
    range_m
        Measured distance to each access point, [..., n, ap], metres, where the device gives distances
        itself; NaN = none.
    turn_before_rad, advance_m, turn_after_rad
        Commanded or measured motion since the epoch before: a turn, a straight line, a second turn,
        [..., n], radians and metres; None where nothing is known of the motion. At the first epoch
        they are zero.
    fix_m
        Position fixes of each epoch, [..., n, k, 2], metres, where something else has found them; NaN
        fills up.
    fix_residual_m
        How far each fix is from what it was found from, [..., n, k], metres; smaller fits better.
    start_heading_rad
        Heading at the first epoch, [...], radians from the x axis to the left; NaN or None where
        nobody noted it.
    start_position_m
        Place at the first epoch, [..., 2], metres, where somebody noted it. For dead reckoning alone.
    motion_time_s
        Times of the readings of gyroscope and odometer, [..., m], seconds, on the clock of ``time_s``: the
        middle of the interval that a reading stands for; NaN after the end.
    gyro_rad_per_s
        Turn rate about the vertical, [..., m], radians a second, positive to the left.
    odometer_m_per_s
        Speed, [..., m], metres a second; NaN = dropped out. Dead reckoning bridges at most two seconds by
        the last speed, and refuses an odometer that never reads.
    imu_time_s
        Times of the readings of an inertial measurement unit, [..., i], seconds, on the clock of ``time_s``:
        the end of the interval that a reading stands for; NaN after the end.
    specific_force_m_per_s2
        Mean over that interval in the frame of the sensor, [..., i, 3], metres a second squared; upwards, at
        rest.
    angular_rate_rad_per_s
        Mean over that interval in the frame of the sensor, [..., i, 3], radians a second.
    magnetic_field_ut
        In the frame of the sensor, [..., i, 3], microtesla; NaN = none.
    step_time_s, step_forward_m, step_left_m, step_turn_rad
        Steps that an inertial filter has found, [..., s]: when each ends, and its motion in the frame of the
        walker's heading before it, seconds, metres and radians; NaN fills up.
    gps_time_s
        Times of GPS, [..., g], seconds, on the clock of ``time_s``; NaN fills up.
    gps_geodetic
        Of the antenna, [..., g, 3]: latitude and longitude, radians, height above the ellipsoid, metres.
    gps_velocity_m_per_s
        North, east and down, of the antenna, [..., g, 3]; None where the receiver gives none.
    gps_lever_arm_m
        From the inertial measurement unit to the antenna in the frame of the body, [..., 3], metres.
    gps_outage_s
        Begin and end of a time in which GPS stands in the recording and must not be used, [..., 2], seconds;
        NaN = none.
    start_geodetic, start_velocity_m_per_s, start_attitude_rad
        State at the first reading of the inertial measurement unit as somebody noted it, [..., 3] each:
        latitude, longitude, height; north, east, down; roll, pitch, yaw.
    sighting_time_s, sighting_landmark
        When a landmark was seen, [..., o], seconds, NaN fills up, and which one, -1 fills up.
    sighting
        Range, bearing and elevation in the frame of the sensor, [..., o, 3], metres and radians.
    sighting_lever_arm_m
        From the inertial measurement unit to that sensor, [..., 3], metres; its axes are those of the body.
    """

    time_s: Array
    rss_dbm: Array | None = None
    range_m: Array | None = None
    turn_before_rad: Array | None = None
    advance_m: Array | None = None
    turn_after_rad: Array | None = None
    fix_m: Array | None = None
    fix_residual_m: Array | None = None
    start_heading_rad: Array | None = None
    start_position_m: Array | None = None
    motion_time_s: Array | None = None
    gyro_rad_per_s: Array | None = None
    odometer_m_per_s: Array | None = None
    imu_time_s: Array | None = None
    specific_force_m_per_s2: Array | None = None
    angular_rate_rad_per_s: Array | None = None
    magnetic_field_ut: Array | None = None
    step_time_s: Array | None = None
    step_forward_m: Array | None = None
    step_left_m: Array | None = None
    step_turn_rad: Array | None = None
    gps_time_s: Array | None = None
    gps_geodetic: Array | None = None
    gps_velocity_m_per_s: Array | None = None
    gps_lever_arm_m: Array | None = None
    gps_outage_s: Array | None = None
    start_geodetic: Array | None = None
    start_velocity_m_per_s: Array | None = None
    start_attitude_rad: Array | None = None
    sighting_time_s: Array | None = None
    sighting_landmark: NDArray[np.integer[Any]] | None = None
    sighting: Array | None = None
    sighting_lever_arm_m: Array | None = None

    def until(self, count: int) -> Recording:
        """Return the first ``count`` epochs; readings of the motion have their own times and stay."""
        axis = self.time_s.ndim - 1
        parts = {name: getattr(self, name) for name in _EPOCHS}
        cut = {name: v[(slice(None),) * axis + (slice(count),)] for name, v in parts.items() if v is not None}
        return replace(self, **cut)


_EPOCHS: tuple[str, ...] = ("time_s", "rss_dbm", "range_m", "turn_before_rad", "advance_m", "turn_after_rad")
_EPOCHS += ("fix_m", "fix_residual_m")


@dataclass(frozen=True, kw_only=True)
class Walks(_Part):
    """Several walks through one building, each dead reckoned in a frame of its own.

    Walks of different length share one array: after its end a walk is filled up with NaN.

    Attributes
    ----------
    time_s
        Time of each pose, [..., k, n], seconds, from the start of its walk; NaN after the end.
    position_m
        Dead-reckoned position, [..., k, n, 2], metres, in the frame of its walk, which begins at (0, 0).
    heading_rad
        Dead-reckoned heading, [..., k, n], radians from the x axis of that frame to the left, not wrapped.
    rss_dbm
        Received signal strength at each pose, [..., k, n, ap], dBm; NaN = not heard. A pose without a scan
        hears nothing.
    """

    time_s: Array
    position_m: Array
    heading_rad: Array
    rss_dbm: Array


class Aligned(NamedTuple):
    """Walks in one frame.

    Attributes
    ----------
    position_m
        [k, n, 2], metres; NaN after the end of a walk.
    heading_rad
        [k, n], radians.
    extra
        Whatever else the algorithm wants to keep, each [k], [k, n] or [k, n, part].
    """

    position_m: Array
    heading_rad: Array
    extra: Mapping[str, NDArray[np.generic]] = {}


@dataclass(frozen=True, kw_only=True)
class Track:
    """Where a receiver was, and how sure that is.

    Attributes
    ----------
    time_s
        [..., n], seconds, as in the recording.
    position_m
        [..., n, 2], metres; NaN after the end of the recording.
    covariance_m2
        Covariance of the position, [..., n, 2, 2], square metres; NaN after the end.
    extra
        Whatever else the algorithm wants to keep, each [..., n] or [..., n, part].
    """

    time_s: Array
    position_m: Array
    covariance_m2: Array
    extra: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)


def world(arrays: Arrays, index: int) -> dict[str, NDArray[np.generic]]:
    """Return one world out of stacked named arrays."""
    return {name: values[index] for name, values in arrays.items()}
