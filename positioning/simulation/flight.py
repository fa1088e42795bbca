"""A flight around a city block, and what GPS and a sensor of landmarks would see of it without errors.

See Mirzababaei & Akbari, sections 1 to 5, for the robot that flies some 30 feet above ground between
buildings; the paper prints neither its course nor its speed. Places are in a local frame, x east, y north, z
up, whose origin is the middle of the block. Attitudes and geodetic positions are those of
`positioning.inertial.geodetic`.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from positioning.geometry import wall_crossings
from positioning.inertial.geodetic import (
    attitude_of,
    earth_rate_ned_rad_per_s,
    roll_pitch_yaw,
    surroundings,
    to_geodetic,
    transport_rate_rad_per_s,
)
from positioning.inertial.geodetic_strapdown import navigate, travelled
from positioning.inertial.gps import antenna
from positioning.inertial.landmarks import from_sensor_m, sighting_of
from positioning.inertial.strapdown import GRAVITY_M_PER_S2
from positioning.model import Array

# Sinusoids of which speed, height and attitude are the sum.
_WAVES = 4
# Knots between which time is a cubic of the distance.
_KNOT_M = 0.05
# Even: steps of Simpson's rule to the place where a flight begins.
_STEPS = 4000
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


def _turned(share: Array) -> Array:
    """Return how much of a corner's turn is done after a share of its length."""
    done: Array = share - np.sin(2 * np.pi * share) / (2 * np.pi)
    return done


_CORNER_REACH = float(np.pi * 0.5 * np.sum(_WEIGHTS * np.cos(0.5 * np.pi * _turned(0.5 * (_NODES + 1)))))


@dataclass(frozen=True, kw_only=True)
class Lap:
    """A rectangle with round corners, flown again and again, to the left.

    The curvature of a corner rises from zero and falls back as one period of a cosine, so that curvature and
    its derivative are continuous. Distances count from the middle of the lower side.

    Attributes
    ----------
    side_m
        Sides of the rectangle before its corners are rounded, along x and y, [..., 2], metres.
    corner_radius_m
        Smallest radius of a corner, in its middle.
    """

    side_m: Array
    corner_radius_m: float

    @property
    def corner_m(self) -> float:
        """Length of a corner, metres."""
        return float(np.pi * self.corner_radius_m)

    @property
    def straight_m(self) -> Array:
        """What is straight of the two sides, [..., 2], metres; negative where the corners do not fit."""
        straight: Array = self.side_m - 2 * _CORNER_REACH * self.corner_radius_m
        return straight

    @property
    def length_m(self) -> Array:
        """Length of a lap, [...], metres."""
        return np.asarray(2 * np.sum(self.straight_m, axis=-1) + 4 * self.corner_m)

    def heading_rad(self, along_m: ArrayLike) -> Array:
        """Return the direction at distances along the course, [..., n], radians from x to the left.

        It is not wrapped: a lap adds a whole turn. See Mirzababaei & Akbari, section 1, for the flight.
        """
        half, first, second = self._corners(along_m)
        return np.asarray(np.pi * half + 0.5 * np.pi * (_turned(first) + _turned(second)))

    def curvature_per_m(self, along_m: ArrayLike) -> Array:
        """Return the turn a metre at distances along the course, [..., n], rad/m, to the left.

        See Mirzababaei & Akbari, section 1, for the flight.
        """
        _, first, second = self._corners(along_m)
        bends = 2.0 - np.cos(2 * np.pi * first) - np.cos(2 * np.pi * second)
        return np.asarray(bends / (2 * self.corner_radius_m))

    def place_m(self, along_m: ArrayLike) -> Array:
        """Return one place of the course, [..., 2], metres from the middle of the rectangle.

        See Mirzababaei & Akbari, section 1, for the flight.

        Parameters
        ----------
        along_m
            Its distance along the course, [...], metres.
        """
        distance = np.asarray(along_m, dtype=np.float64)[..., None]
        heading = self.heading_rad(distance * np.linspace(0.0, 1.0, _STEPS + 1))
        weight = np.full(_STEPS + 1, 2.0)
        weight[1::2], weight[[0, -1]] = 4.0, 1.0
        weight /= 3 * _STEPS
        way = np.stack([np.cos(heading) @ weight, np.sin(heading) @ weight], axis=-1)
        start = np.stack([np.zeros_like(self.side_m[..., 1]), -0.5 * self.side_m[..., 1]], axis=-1)
        return np.asarray(start + distance * way)

    def _corners(self, along_m: ArrayLike) -> tuple[Array, Array, Array]:
        """Return half laps done, and what share of both corners of the present one."""
        lower, side = (self.straight_m[..., axis, None] for axis in (0, 1))
        corner = self.corner_m
        along = np.asarray(along_m, dtype=np.float64) + 0.5 * lower
        half_m = lower + side + 2 * corner
        half = np.floor(along / half_m)
        rest = along - half * half_m
        first = np.clip((rest - lower) / corner, 0.0, 1.0)
        second = np.clip((rest - lower - corner - side) / corner, 0.0, 1.0)
        return half, first, second


class FlightDraws(NamedTuple):
    """The random numbers of a flight, uniform from 0 to 1.

    Attributes
    ----------
    direction, start
        To the left below one half; where on the lap, each [...].
    speed_wave, speed_phase, height_wave, height_phase
        Of each sinusoid, [..., wave].
    wobble_wave, wobble_phase
        Of each sinusoid of roll, pitch and yaw, [..., 3, wave].
    """

    direction: Array
    start: Array
    speed_wave: Array
    speed_phase: Array
    height_wave: Array
    height_phase: Array
    wobble_wave: Array
    wobble_phase: Array


def draw_flight(rng: np.random.Generator) -> FlightDraws:
    """Draw what a flight needs; see Mirzababaei & Akbari, section 1, for the flight."""
    direction, start = rng.random(2)
    waves = rng.random((4, _WAVES))
    wobble = rng.random((2, 3, _WAVES))
    return FlightDraws(np.asarray(direction), np.asarray(start), *waves, *wobble)


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """How the course is flown.

    Attributes
    ----------
    speed_m_per_s
        Lowest speed, kept where a corner bends most, and highest.
    speed_change_m
        Shortest and longest wave of the speed along the course.
    height_m, height_change_m, height_period_s
        Mean height, most that it leaves it, and shortest and longest period of that.
    wobble_rad, wobble_hz
        Root mean square of what each angle deviates from a coordinated flight, lowest and highest frequency.
    """

    speed_m_per_s: tuple[float, float]
    speed_change_m: tuple[float, float]
    height_m: float
    height_change_m: float
    height_period_s: tuple[float, float]
    wobble_rad: float
    wobble_hz: tuple[float, float]


class Motion(NamedTuple):
    """Motion of the inertial measurement unit at the samples.

    Attributes
    ----------
    geodetic
        Latitude and longitude, radians, height, metres, [..., i, 3].
    velocity_m_per_s
        North, east and down, [..., i, 3].
    roll_pitch_yaw_rad
        [..., i, 3], radians.
    attitude
        From the body to north, east, down, [..., i, 3, 3].
    along_m
        Distance flown since the start, [..., i], metres.
    """

    geodetic: Array
    velocity_m_per_s: Array
    roll_pitch_yaw_rad: Array
    attitude: Array
    along_m: Array

    def at(self, sample: NDArray[np.integer]) -> Self:
        """Return the motion at some samples, of all flights alike, [i]."""
        return type(self)(
            self.geodetic[..., sample, :],
            self.velocity_m_per_s[..., sample, :],
            self.roll_pitch_yaw_rad[..., sample, :],
            self.attitude[..., sample, :, :],
            self.along_m[..., sample],
        )


def fly(time_s: Array, lap: Lap, pilot: Pilot, draws: FlightDraws, *, origin_geodetic: ArrayLike) -> Motion:
    """Fly around the block.

    See Mirzababaei & Akbari, section 1. The nose points along the course, the robot banks as a coordinated
    turn asks for, and all angles wobble. Speed is a function of the place: lowest in the middle of corners,
    and a sum of sinusoids along the straight parts. The places are those that the velocities lead to.

    Parameters
    ----------
    time_s
        From zero, at equal distances, [i], seconds.
    lap
        The course, leading axes [...].
    pilot
        How it is flown.
    draws
        Random numbers, leading axes [...].
    origin_geodetic
        Of the local frame, [..., 3].
    """
    start_m = draws.start * lap.length_m
    along_m = _distance_m(time_s, lap, pilot, draws, start_m)
    course_m = start_m[..., None] + along_m
    left = np.where(draws.direction < 0.5, 1.0, -1.0)[..., None]
    speed = _speed(course_m, lap, pilot, draws)
    # To the right, the course is its own mirror image in the y axis.
    heading = lap.heading_rad(course_m)
    east, north = left * speed * np.cos(heading), speed * np.sin(heading)
    wave = 2 * np.pi / _between(pilot.height_period_s, draws.height_wave)[..., None]
    phase = wave * time_s + 2 * np.pi * draws.height_phase[..., None]
    up = pilot.height_change_m * np.mean(np.sin(phase), axis=-2)
    climb = pilot.height_change_m * np.mean(wave * np.cos(phase), axis=-2)
    velocity = np.stack([north, east, -climb], axis=-1)

    place = lap.place_m(start_m)
    local = np.stack([left[..., 0] * place[..., 0], place[..., 1], pilot.height_m + up[..., 0]], axis=-1)
    step_s = time_s[1] - time_s[0]
    geodetic = travelled(to_geodetic(local, origin_geodetic), velocity, step_s)

    wave = 2 * np.pi * _between(pilot.wobble_hz, draws.wobble_wave)[..., None]
    phase = wave * time_s + 2 * np.pi * draws.wobble_phase[..., None]
    # The mean square of a sinusoid is a half.
    wobble = pilot.wobble_rad * np.sqrt(2.0 / _WAVES) * np.sum(np.sin(phase), axis=-2)
    angles = np.moveaxis(wobble, -2, -1)
    angles[..., 0] += np.arctan(-left * lap.curvature_per_m(course_m) * speed**2 / GRAVITY_M_PER_S2)
    angles[..., 2] += np.arctan2(east, north)
    attitude = attitude_of(angles)
    return Motion(geodetic, velocity, roll_pitch_yaw(attitude), attitude, along_m)


def antenna_at(
    motion: Motion,
    specific_force_m_per_s2: Array,
    angular_rate_rad_per_s: Array,
    time_s: Array,
    *,
    sample_rate_hz: float,
    lever_arm_m: ArrayLike,
) -> tuple[Array, Array]:
    """Return where an antenna is at times between samples, and how fast.

    See Mirzababaei & Akbari, eqs. 36 and 36.1. Within its interval a reading leads from the sample before to
    the time asked for.

    Parameters
    ----------
    motion
        At the samples, [..., i + 1, ...].
    specific_force_m_per_s2, angular_rate_rad_per_s
        Faultless readings, [..., i, 3].
    time_s
        From the first sample on and before the last, [g], seconds.
    sample_rate_hz
        Readings a second.
    lever_arm_m
        From the inertial measurement unit to the antenna in the body, [3].

    Returns
    -------
    geodetic
        Latitude and longitude, radians, height, metres, [..., g, 3].
    velocity_m_per_s
        North, east and down, [..., g, 3].
    """
    # A time that falls on a sample must not go to the interval before by rounding.
    sample = np.floor(time_s * sample_rate_hz + 1e-9).astype(np.int64)
    rest_s = np.maximum(time_s - sample / sample_rate_hz, 0.0)
    before = motion.at(sample)
    force, rate = specific_force_m_per_s2[..., sample, :], angular_rate_rad_per_s[..., sample, :]
    arrived = navigate(
        force[..., None, :],
        rate[..., None, :],
        rest_s[:, None],
        geodetic=before.geodetic,
        velocity_m_per_s=before.velocity_m_per_s,
        attitude=before.attitude,
    )
    place, velocity = arrived.geodetic[..., -1, :], arrived.velocity_m_per_s[..., -1, :]
    attitude = arrived.attitude[..., -1, :, :]
    around = surroundings(place[..., 0], place[..., 2])
    frame_rate = earth_rate_ned_rad_per_s(around) + transport_rate_rad_per_s(velocity, around)
    turning = rate - np.einsum("...ij,...i->...j", attitude, frame_rate)
    return antenna(place, velocity, attitude, turning, lever_arm_m)


class Eye(NamedTuple):
    """What a sensor of landmarks can see.

    Attributes
    ----------
    reach_m
        Largest range.
    bearing_rad, elevation_rad
        Largest to both sides.
    at_once
        Landmarks that are followed at a time, the nearest ones.
    lever_arm_m
        From the inertial measurement unit to the sensor in the body, three numbers, metres.
    """

    reach_m: float
    bearing_rad: float
    elevation_rad: float
    at_once: int
    lever_arm_m: tuple[float, ...]


def look(
    landmark_m: Array, place_m: Array, attitude: Array, wall_m: Array, eye: Eye
) -> tuple[Array, NDArray[np.bool_]]:
    """Return range, bearing and elevation of all landmarks at all times, and which of them are seen.

    See Mirzababaei & Akbari, eqs. 49 and 50. A wall of any height between the robot and a landmark hides it.

    Parameters
    ----------
    landmark_m
        East, north, up, [l, 3], metres.
    place_m
        Of the inertial measurement unit, [t, 3], metres.
    attitude
        From the body to north, east, down, [t, 3, 3].
    wall_m
        [wall, 2, 2], metres.
    eye
        The sensor.

    Returns
    -------
    sighting
        Metres and radians, [t, l, 3].
    seen
        [t, l].
    """
    landmark, place = (_ned_of_local(values) for values in (landmark_m, place_m))
    relative = from_sensor_m(landmark, place[:, None], attitude[:, None], eye.lever_arm_m)
    sighting = sighting_of(relative)
    range_m = sighting[..., 0]
    seen = (range_m <= eye.reach_m) & (np.abs(sighting[..., 1]) <= eye.bearing_rad)
    seen &= np.abs(sighting[..., 2]) <= eye.elevation_rad
    seen &= wall_crossings(place_m[:, :2], landmark_m[:, :2], wall_m) == 0
    nearness = np.argsort(np.argsort(np.where(seen, range_m, np.inf), axis=-1, kind="stable"), axis=-1)
    return sighting, seen & (nearness < eye.at_once)


def block_walls(half_m: ArrayLike, street_m: float) -> Array:
    """Return the walls along the streets around a block.

    See Mirzababaei & Akbari, section 1, for the flight among tall buildings.

    Parameters
    ----------
    half_m
        Half of the sides of the block, along x and y, [..., 2], metres.
    street_m
        Distance of the facades across the streets from those of the block.

    Returns
    -------
    Array
        Lower, right, upper and left side of the block, then the facades across from them, [..., 8, 2, 2],
        metres.
    """
    half = np.asarray(half_m, dtype=np.float64)
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[..., None, :]
    side = np.stack([corner, np.roll(corner, -1, axis=-2)], axis=-2)
    return np.concatenate([side, side + street_m * _OUTWARD[:, None]], axis=-3)


def on_facades(half_m: ArrayLike, street_m: float, share: ArrayLike, *, off_m: float) -> Array:
    """Return places on the facades of a block and, every second one, on those across the street.

    See Mirzababaei & Akbari, section 4, for landmarks.

    Parameters
    ----------
    half_m
        Half of the sides of the block, along x and y, [..., 2], metres.
    street_m
        Distance of the facades across the streets from those of the block.
    share
        Distance along the outline of the block from its lower left corner to the left around, as a share of
        the whole, [..., l], 0 to 1.
    off_m
        How far off the facade.

    Returns
    -------
    Array
        [..., l, 2], metres.
    """
    half = np.asarray(half_m, dtype=np.float64)
    side_m = 2 * np.stack([half[..., 0], half[..., 1], half[..., 0], half[..., 1]], axis=-1)
    end_m = np.cumsum(side_m, axis=-1)
    along = np.asarray(share, dtype=np.float64) * end_m[..., -1:]
    side = np.sum(along[..., None] >= end_m[..., None, :3], axis=-1)
    begin_m = np.take_along_axis(end_m - side_m, side, axis=-1)
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])[side] * half[..., None, :]
    across = np.arange(along.shape[-1]) % 2 == 1
    out = np.where(across, street_m - off_m, off_m)
    forward = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[side]
    return np.asarray(corner + (along - begin_m)[..., None] * forward + out[:, None] * _OUTWARD[side])


_OUTWARD = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])


def _distance_m(time_s: Array, lap: Lap, pilot: Pilot, draws: FlightDraws, start_m: Array) -> Array:
    """Return how far a flight is at times, [..., i], metres."""
    most = pilot.speed_m_per_s[1] * time_s[-1] + 2 * _KNOT_M
    knot_m = np.arange(0.0, most, _KNOT_M)
    slowness = 1.0 / _speed(start_m[..., None] + knot_m, lap, pilot, draws)
    knot_s = np.zeros_like(slowness)
    np.cumsum(0.5 * _KNOT_M * (slowness[..., 1:] + slowness[..., :-1]), axis=-1, out=knot_s[..., 1:])
    found = np.empty((*slowness.shape[:-1], len(time_s)))
    for index in np.ndindex(*slowness.shape[:-1]):
        found[index] = CubicHermiteSpline(knot_s[index], knot_m, 1.0 / slowness[index])(time_s)
    return found


def _speed(course_m: Array, lap: Lap, pilot: Pilot, draws: FlightDraws) -> Array:
    """Return the speed at distances along the course, [..., n]."""
    low, high = pilot.speed_m_per_s
    straight = 1.0 - lap.curvature_per_m(course_m) * lap.corner_radius_m
    pace = np.zeros_like(straight)
    lengths, phases = _between(pilot.speed_change_m, draws.speed_wave), draws.speed_phase
    for wave in range(_WAVES):
        angle = 2 * np.pi * (course_m / lengths[..., wave, None] + phases[..., wave, None])
        pace += np.sin(angle) / _WAVES
    return np.asarray(low + (high - low) * straight * 0.5 * (1.0 + pace))


def _between(limits: tuple[float, float], uniform: Array) -> Array:
    return np.asarray(limits[0] + (limits[1] - limits[0]) * uniform)


def _ned_of_local(place_m: Array) -> Array:
    """Return north, east, down of east, north, up."""
    return np.asarray(place_m[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0]))
