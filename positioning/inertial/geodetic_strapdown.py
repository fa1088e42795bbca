"""Strapdown inertial navigation over the rotating ellipsoid, and the readings that lead to a motion.

See Mirzababaei & Akbari, section 2, eqs. 1 and 2, and Groves (2013), "Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems", section 5.4. Frames are those of `geodetic`.

A reading of the inertial measurement unit is the constant specific force and angular rate in the body that
lead exactly from one state to the next, so that `navigate` and `readings` are inverses of each other. With
all that depends on the place and the velocity taken at the begin of the interval dt: the navigation frame
turns by b = w_in dt, the force gives ``u = (I - [b x] / 2) C J f dt + g dt``, where J is the mean rotation of
the body on the way, and ``v' = v + u - dt (2 w_ie + w_en) x (v + u / 2)``, ``C' = Exp(-b) C Exp(w dt)``;
position follows from the mean of both velocities.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.earth import meridian_radius_m, normal_radius_m
from positioning.inertial.error_state import Increments
from positioning.inertial.geodetic import (
    MOST_LATITUDE_RAD,
    earth_rate_ned_rad_per_s,
    surroundings,
    transport_rate_rad_per_s,
)
from positioning.inertial.strapdown import Readings, mean_rotation, rotation, rotation_vector
from positioning.inertial.vectors import force_and_rate, vectors
from positioning.model import Array

# Three axes, and the first two again: the cross product is then a difference of two products of slices.
_ROUND = np.array([0, 1, 2, 0, 1])
# Each repetition leaves a share of distance over radius: nothing but rounding after so many, within 100 km.
_REPETITIONS = 9


class Navigation(NamedTuple):
    """Motion at the samples: the start, and the end of each reading's interval.

    Attributes
    ----------
    geodetic
        Latitude and longitude, radians, and height, metres, [..., i + 1, 3].
    velocity_m_per_s
        North, east and down, [..., i + 1, 3].
    attitude
        [..., i + 1, 3, 3].
    """

    geodetic: Array
    velocity_m_per_s: Array
    attitude: Array


def travelled(geodetic: ArrayLike, velocity_m_per_s: ArrayLike, duration_s: ArrayLike) -> Array:
    """Return the places on the way of a given velocity, as `navigate` finds them.

    See Mirzababaei & Akbari, eqs. 1 and 2.

    Parameters
    ----------
    geodetic
        At the first sample, [..., 3].
    velocity_m_per_s
        North, east and down at the samples, [..., i + 1, 3].
    duration_s
        Between samples, one number or [..., i].

    Returns
    -------
    Array
        [..., i + 1, 3].
    """
    velocity = _samples("velocity_m_per_s", velocity_m_per_s)
    start = _start("geodetic", geodetic, (*velocity.shape[:-2], 3))
    _check_latitude(start[..., 0])
    duration = _durations(duration_s, (*velocity.shape[:-2], velocity.shape[-2] - 1))
    way = 0.5 * duration[..., None] * (velocity[..., 1:, :] + velocity[..., :-1, :])
    place = np.empty_like(velocity)
    place[..., 0, :] = start

    def added(part: int, change: Array) -> None:
        place[..., 1:, part] = start[..., None, part] + np.cumsum(change, axis=-1)

    added(2, -way[..., 2])
    place[..., 0] = start[..., None, 0]
    for _ in range(_REPETITIONS):
        radius = meridian_radius_m(place[..., :-1, 0]) + place[..., :-1, 2]
        added(0, way[..., 0] / radius)
    radius = (normal_radius_m(place[..., :-1, 0]) + place[..., :-1, 2]) * np.cos(place[..., :-1, 0])
    added(1, way[..., 1] / radius)
    return np.asarray(place)


def navigate(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    duration_s: ArrayLike,
    *,
    geodetic: ArrayLike,
    velocity_m_per_s: ArrayLike,
    attitude: ArrayLike,
) -> Navigation:
    """Integrate readings to position, velocity and attitude.

    See Mirzababaei & Akbari, eq. 1. One loop over time, all leading axes in lock-step.

    Parameters
    ----------
    specific_force_m_per_s2, angular_rate_rad_per_s
        [..., i, 3], in the body.
    duration_s
        Of each reading, one number or [..., i], seconds.
    geodetic, velocity_m_per_s
        At the start, [..., 3].
    attitude
        At the start, [..., 3, 3].

    Returns
    -------
    Navigation
        With one sample more than readings.

    Raises
    ------
    InputError
        For shapes that do not fit, or a start at a pole.
    """
    force, rate = force_and_rate(specific_force_m_per_s2, angular_rate_rad_per_s)
    leading, count = force.shape[:-2], force.shape[-2]
    duration = _durations(duration_s, (*leading, count))
    turn = rate * duration[..., None]
    both = np.empty((*leading, count, 3, 4))
    both[..., :3] = rotation(turn)
    both[..., 3] = (mean_rotation(turn) @ (force * duration[..., None])[..., None])[..., 0]
    both = np.ascontiguousarray(np.moveaxis(both.reshape(-1, count, 3, 4), 0, -1))
    lasting = np.ascontiguousarray(duration.reshape(-1, count).T)
    worlds = both.shape[-1]
    mover = Strapdown(
        _start("geodetic", geodetic, (*leading, 3)).reshape(worlds, 3),
        _start("velocity_m_per_s", velocity_m_per_s, (*leading, 3)).reshape(worlds, 3),
        _start("attitude", attitude, (*leading, 3, 3)).reshape(worlds, 3, 3),
    )
    places, speeds = np.empty((count + 1, 3, worlds)), np.empty((count + 1, 3, worlds))
    turned = np.empty((count + 1, 3, 3, worlds))
    places[0], speeds[0], turned[0] = mover.geodetic, mover.velocity_m_per_s, mover.attitude
    for sample in range(count):
        mover.look_around()
        mover.advance(both[sample], lasting[sample])
        places[sample + 1] = mover.geodetic
        speeds[sample + 1] = mover.velocity_m_per_s
        turned[sample + 1] = mover.attitude
    return Navigation(
        *(np.moveaxis(v, -1, 0).reshape(*leading, *v.shape[:-1]) for v in (places, speeds, turned))
    )


def readings(
    geodetic: ArrayLike, velocity_m_per_s: ArrayLike, attitude: ArrayLike, duration_s: ArrayLike
) -> Readings:
    """Return what a faultless unit reads on a motion: the exact inverse of `navigate`.

    See Mirzababaei & Akbari, eq. 1. Places should be `travelled` at the velocity; they count only by what
    depends on them (radii, gravity, rotation of the earth).

    Parameters
    ----------
    geodetic, velocity_m_per_s
        At the samples, [..., i + 1, 3].
    attitude
        At the samples, [..., i + 1, 3, 3].
    duration_s
        Between samples, one number or [..., i], seconds.

    Returns
    -------
    Readings
        One less than samples. Between two samples the body turns by at most half a turn.

    Raises
    ------
    InputError
        For shapes that do not fit, or a place at a pole.
    """
    velocity = _samples("velocity_m_per_s", velocity_m_per_s)
    place, matrix = np.asarray(geodetic, np.float64), np.asarray(attitude, np.float64)
    if place.shape != velocity.shape or matrix.shape != (*velocity.shape, 3):
        raise InputError(
            "geodetic, velocity_m_per_s and attitude",
            f"their shapes {place.shape}, {velocity.shape} and {matrix.shape} do not fit [..., i, 3] and"
            " [..., i, 3, 3]",
            "Give all at each of two samples or more",
        )
    _check_latitude(place[..., 0])
    duration = _durations(duration_s, (*velocity.shape[:-2], velocity.shape[-2] - 1))[..., None]
    before = velocity[..., :-1, :]
    around = surroundings(place[..., :-1, 0], place[..., :-1, 2])
    earth, transport = earth_rate_ned_rad_per_s(around), transport_rate_rad_per_s(before, around)
    frame_turn = (earth + transport) * duration
    coriolis = (2 * earth + transport) * duration
    change = np.diff(velocity, axis=-2) + np.cross(coriolis, before)
    change = _without_cross(-0.5 * coriolis, change)
    change[..., 2] -= around.gravity_m_per_s2 * duration[..., 0]
    change = _without_cross(-0.5 * frame_turn, change)
    back = np.swapaxes(matrix[..., :-1, :, :], -1, -2)
    turn = rotation_vector(back @ rotation(frame_turn) @ matrix[..., 1:, :, :])
    mean = np.linalg.solve(mean_rotation(turn), back @ change[..., None])[..., 0]
    return Readings(mean / duration, turn / duration)


class Together(NamedTuple):
    """Readings n that a navigation goes through at once, w worlds.

    Attributes
    ----------
    turned_and_pushed
        The rotation since the begin of the first reading, up to the end of each, and beside it the velocity
        increment of the specific force in the frame of the body at that begin, [3, n, 4, w].
    mean_rotation_s
        Mean rotation on the way of each reading in the same frame, times the duration, [3, n, 3, w]; None
        where there are no biases.
    duration_s, until_s
        Of each reading, and from the begin of the first to the end of each, [n, w].
    """

    turned_and_pushed: Array
    mean_rotation_s: Array | None
    duration_s: Array
    until_s: Array


class Way(NamedTuple):
    """States after each of n readings, w worlds, and what pushed them.

    Attributes
    ----------
    geodetic, velocity_m_per_s
        [n, 3, w].
    attitude
        [n, 3, 3, w].
    force_advance
        Velocity increment of the specific force of all readings, north, east and down, [3, w].
    """

    geodetic: Array
    velocity_m_per_s: Array
    attitude: Array
    force_advance: Array


class Strapdown:
    """State of w navigations in lock-step, worlds last: what `navigate` and the filter move alike.

    See Mirzababaei & Akbari, eq. 1.

    Parameters
    ----------
    geodetic, velocity_m_per_s
        At the start, [w, 3].
    attitude
        At the start, [w, 3, 3].

    Raises
    ------
    InputError
        For a start that is not finite, or at a pole.
    """

    def __init__(self, geodetic: Array, velocity_m_per_s: Array, attitude: Array) -> None:
        for name, values in (
            ("geodetic", geodetic),
            ("velocity_m_per_s", velocity_m_per_s),
            ("attitude", attitude),
        ):
            if not np.isfinite(values).all():
                raise InputError(f"{name} at the start", "it is not finite", "Give numbers")
        _check_latitude(geodetic[:, 0])
        self.geodetic, self.velocity_m_per_s, self.attitude = (
            np.moveaxis(np.asarray(values, np.float64), 0, -1).copy()
            for values in (geodetic, velocity_m_per_s, attitude)
        )
        worlds = len(geodetic)
        self._earth, self._spin = np.zeros((3, worlds)), np.empty((3, worlds))
        self._turned, self._other = np.empty((3, 4, worlds)), np.empty((3, 4, worlds))
        self.look_around()

    def look_around(self) -> None:
        """Take what depends on the place anew; it changes by 1e-7 of itself in half a metre."""
        around = surroundings(self.geodetic[0], self.geodetic[2])
        self.around = around
        self._earth[0], self._earth[2] = around.earth_rate_north, around.earth_rate_down
        self._per_length = np.stack(
            [
                around.per_meridian_m,
                around.per_normal_m / around.cosine,
                np.full_like(around.cosine, -1.0),
            ]
        )
        self._per_length *= 0.5
        self._per_radius = np.stack([around.per_normal_m, -around.per_meridian_m])
        self._minus_tangent = -around.tangent

    def frame_rate_rad_per_s(self, velocity_m_per_s: Array | None = None) -> Array:
        """Return the rotation of the navigation frame, w_in, [3, w], at the present velocity or another."""
        velocity = self.velocity_m_per_s if velocity_m_per_s is None else velocity_m_per_s
        spin = self._spin
        np.multiply(velocity[1::-1], self._per_radius, out=spin[:2])
        np.multiply(spin[0], self._minus_tangent, out=spin[2])
        spin += self._earth
        return spin

    def advance(self, turn_and_advance: Array, duration_s: Array) -> None:
        """Move over one reading.

        Parameters
        ----------
        turn_and_advance
            As in `error_state.Increments`, [3, 4, w].
        duration_s
            [w].
        """
        turned, other = self._turned, self._other
        attitude, velocity = self.attitude, self.velocity_m_per_s
        np.multiply(attitude[:, 0, None], turn_and_advance[0], out=turned)
        np.multiply(attitude[:, 1, None], turn_and_advance[1], out=other)
        turned += other
        np.multiply(attitude[:, 2, None], turn_and_advance[2], out=other)
        turned += other
        spin = self.frame_rate_rad_per_s()
        coriolis = spin + self._earth
        coriolis *= duration_s
        spin *= duration_s
        # The frame turns below the force, half of it on average, and below the attitude.
        once = _crossed(spin[:, None], turned)
        pushed = turned[:, 3] - 0.5 * once[:, 3]
        pushed[2] += self.around.gravity_m_per_s2 * duration_s
        middle = 0.5 * pushed
        middle += velocity
        pushed -= _crossed(coriolis, middle)
        np.subtract(turned[:, :3], once[:, :3], out=attitude)
        twice = _crossed(spin[:, None], once[:, :3])
        twice *= 0.5
        attitude += twice
        pushed += velocity
        velocity += pushed
        velocity *= duration_s
        velocity *= self._per_length
        self.geodetic += velocity
        velocity[...] = pushed

    def advance_together(self, readings: Together, bias: Array | None = None) -> Way:
        """Move over some readings at once, as `advance` over one after the other.

        What the navigation frame turns by is linear in time on the way, and taken at the mean velocity; with
        a bias, what it turns by is taken to second order. With ten readings in 0.1 s that makes some
        1e-6 m in 20 s of mild motion, 1e-5 m with a bias, and 4 mm on 1.5 km with strong coning and a bias
        that is large.

        Parameters
        ----------
        readings
            Of `together`, [n, ...].
        bias
            Of accelerometer and gyroscope, what they read too much, [6, w]; None for none.

        Returns
        -------
        Way
            The states after each reading.
        """
        moved, duration = readings.turned_and_pushed, readings.duration_s
        if bias is not None and readings.mean_rotation_s is not None:
            moved = _without_bias(moved, readings.mean_rotation_s, bias)
        attitude, velocity = self.attitude, self.velocity_m_per_s
        moved = (
            attitude[:, 0, None, None] * moved[0]
            + attitude[:, 1, None, None] * moved[1]
            + attitude[:, 2, None, None] * moved[2]
        )
        pushed, whole_s = moved[:, :, 3], readings.until_s[-1]
        gravity = self.around.gravity_m_per_s2
        # The mean of the velocities at which the readings begin.
        mean = 0.5 * (np.cumsum(pushed, axis=1)[:, -1] - pushed[:, -1])
        mean[2] += 0.5 * gravity * (whole_s - duration[-1])
        mean += velocity
        spin = self.frame_rate_rad_per_s(mean)
        coriolis = spin + self._earth
        spin = spin[:, None]
        # The frame turns below the force, by half of the reading's part on average, and below the attitude.
        change = pushed - _crossed(spin, pushed) * (readings.until_s - 0.5 * duration)
        steady = -_crossed(coriolis, velocity)
        steady[2] += gravity
        change += steady[:, None] * duration
        way = np.cumsum(change, axis=1)
        force_advance = way[:, -1] - steady * whole_s
        change -= _crossed(coriolis[:, None], way - 0.5 * change) * duration
        speed = np.cumsum(change, axis=1)
        speed += velocity[:, None]
        np.subtract(2 * speed, change, out=way)
        way *= duration
        way *= self._per_length[:, None]
        place = np.cumsum(way, axis=1)
        place += self.geodetic[:, None]
        turn = (spin * readings.until_s)[:, :, None]
        once = _crossed(turn, moved[:, :, :3])
        turned = moved[:, :, :3] - once
        once = _crossed(turn, once)
        once *= 0.5
        turned += once
        self.geodetic[...], velocity[...] = place[:, -1], speed[:, -1]
        attitude[...] = turned[:, -1]
        return Way(place.swapaxes(0, 1), speed.swapaxes(0, 1), turned.swapaxes(0, 1), force_advance)

    def tidy(self) -> None:
        """Take the rounding of many steps off the attitude."""
        excess = np.einsum("kiw,kjw->ijw", self.attitude, self.attitude)
        excess -= np.eye(3)[..., None]
        self.attitude -= 0.5 * np.einsum("ikw,kjw->ijw", self.attitude, excess)


def together(made: Increments, count: int) -> list[Together]:
    """Return readings made ready for `Strapdown.advance_together`, some at a time.

    See Groves (2013), section 5.4, of which this is the update in the frame of the body at the begin.

    Parameters
    ----------
    made
        Of `error_state.increments`, n readings.
    count
        How many go together: a divisor of n.
    """
    turn = made.turn_and_advance.reshape(-1, count, *made.turn_and_advance.shape[1:])
    steps, _, _, _, worlds = turn.shape
    moved = np.empty((steps, 3, count, 4, worlds))
    mean = means = None
    if made.mean_rotation_s is not None:
        mean = made.mean_rotation_s.reshape(steps, count, 3, 3, worlds)
        means = np.empty((steps, 3, count, 3, worlds))
        means[:, :, 0] = mean[:, 0]
    moved[:, :, 0] = turn[:, 0]
    for number in range(1, count):
        before = moved[:, :, number - 1]
        moved[:, :, number] = _product(before, turn[:, number])
        if mean is not None and means is not None:
            means[:, :, number] = _product(before, mean[:, number])
    duration = made.duration_s.reshape(steps, count, worlds)
    until = np.cumsum(duration, axis=1)
    return [
        Together(moved[step], None if means is None else means[step], duration[step], until[step])
        for step in range(steps)
    ]


def _product(left: Array, right: Array) -> Array:
    """Return the products of the first three columns of [c, 3, k, w] with [c, 3, l, w]."""
    product: Array = left[:, :, 0, None] * right[:, None, 0]
    product += left[:, :, 1, None] * right[:, None, 1]
    product += left[:, :, 2, None] * right[:, None, 2]
    return product


def _without_bias(moved: Array, mean_rotation_s: Array, bias: Array) -> Array:
    """Return `Together.turned_and_pushed` of the readings less a bias [6, w]."""
    too_fast, too_far = (
        mean_rotation_s[:, :, 0] * bias[sensor]
        + mean_rotation_s[:, :, 1] * bias[sensor + 1]
        + mean_rotation_s[:, :, 2] * bias[sensor + 2]
        for sensor in (0, 3)
    )
    turn = np.cumsum(too_far, axis=1)
    pushed = moved[:, :, 3] - too_fast
    pushed -= _crossed(turn - 0.5 * too_far, pushed)
    turn = turn[:, :, None]
    once = _crossed(turn, moved[:, :, :3])
    twice = _crossed(turn, once)
    twice *= 0.5
    twice -= once
    result = np.empty_like(moved)
    np.add(moved[:, :, :3], twice, out=result[:, :, :3])
    result[:, :, 3] = pushed
    return result


def _crossed(left: Array, right: Array) -> Array:
    """Return the cross products of vectors [3, ...], whose other axes broadcast."""
    around, twice = left.take(_ROUND, axis=0), right.take(_ROUND, axis=0)
    crossed = around[1:4] * twice[2:5]
    crossed -= around[2:5] * twice[1:4]
    return np.asarray(crossed)


def _without_cross(vector: Array, values: Array) -> Array:
    """Return x of x + vector x x = values."""
    along = np.sum(vector * values, axis=-1, keepdims=True)
    size = 1 + np.sum(vector * vector, axis=-1, keepdims=True)
    return np.asarray((values - np.cross(vector, values) + vector * along) / size)


def _check_latitude(latitude_rad: Array) -> None:
    # NaN is no latitude either.
    if not (np.abs(latitude_rad) <= MOST_LATITUDE_RAD).all():
        raise InputError(
            "latitude",
            f"it is not within {np.degrees(MOST_LATITUDE_RAD):.1f} degrees of the equator",
            "Give radians, away from the poles",
        )


def _samples(name: str, values: ArrayLike) -> Array:
    array = vectors(name, values)
    if array.ndim < 2 or array.shape[-2] < 2:
        raise InputError(name, f"its shape is {array.shape}, not [..., i, 3]", "Give two samples or more")
    return array


def _start(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    try:
        return np.broadcast_to(array, shape)
    except ValueError as error:
        raise InputError(name, f"its shape {array.shape} does not fit {shape}", "Correct it") from error


def _durations(duration_s: ArrayLike, shape: tuple[int, ...]) -> Array:
    return _start("duration_s", duration_s, shape)
