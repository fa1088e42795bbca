"""Strapdown inertial navigation over the rotating ellipsoid, and the dynamics of its errors.

See Mirzababaei & Akbari, section 2, eqs. 1 to 11, and Groves (2013), "Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems", section 5.4. Navigation frame: north, east, down. Body frame: x
forward, y right, z down. An attitude is the matrix that leads from the body to the navigation frame. A
geodetic position is latitude and longitude, radians, and height above the ellipsoid, metres.

A reading of the inertial measurement unit is the constant specific force and angular rate in the body that
lead exactly from one state to the next, so that `navigate` and `readings` are inverses of each other. With
all that depends on the place and the velocity taken at the begin of the interval dt: the navigation frame
turns by b = w_in dt, the force gives ``u = (I - [b x] / 2) C J f dt + g dt``, where J is the mean rotation of
the body on the way, and ``v' = v + u - dt (2 w_ie + w_en) x (v + u / 2)``, ``C' = Exp(-b) C Exp(w dt)``;
position follows from the mean of both velocities.

Errors follow one convention: error = navigation less truth, and for the attitude ``C_navigation = (I - E)
C_truth``, where E is the cross product with the attitude error.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.earth import (
    EARTH_RATE_RAD_PER_S,
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS_M,
    gravity_m_per_s2,
    meridian_radius_m,
    normal_radius_m,
)
from positioning.inertial.error_state import Increments
from positioning.inertial.strapdown import Readings, cross_matrix, mean_rotation, rotation, rotation_vector
from positioning.model import Array

MOST_LATITUDE_RAD = np.radians(89.9)
"""Nearer to a pole north and east lose their sense, and tan(latitude) its accuracy."""

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
FORCE_BIAS, RATE_BIAS = slice(9, 12), slice(12, 15)

# Three axes, and the first two again: the cross product is then a difference of two products of slices.
_ROUND = np.array([0, 1, 2, 0, 1])
# Each repetition leaves a share of distance over radius: nothing but rounding after so many, within 100 km.
_REPETITIONS = 9
# Or that share times the tangent of the latitude, where longitudes are looked for.
_LOCAL_REPETITIONS = 20


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


class Surroundings(NamedTuple):
    """What navigation needs of the earth at a place, each [...].

    Attributes
    ----------
    per_meridian_m, per_normal_m
        One over the radii of curvature, to the north and to the east, with the height.
    cosine, tangent
        Of the latitude.
    earth_rate_north, earth_rate_down
        Rotation of the earth along north and down, radians a second.
    gravity_m_per_s2
        Normal gravity.
    """

    per_meridian_m: Array
    per_normal_m: Array
    cosine: Array
    tangent: Array
    earth_rate_north: Array
    earth_rate_down: Array
    gravity_m_per_s2: Array


def surroundings(latitude_rad: Array, height_m: Array) -> Surroundings:
    """Return what navigation needs of the earth at places.

    See Mirzababaei & Akbari, eqs. 1 and 2.

    Parameters
    ----------
    latitude_rad, height_m
        Each [...].
    """
    cosine, sine = np.cos(latitude_rad), np.sin(latitude_rad)
    return Surroundings(
        1.0 / (meridian_radius_m(latitude_rad) + height_m),
        1.0 / (normal_radius_m(latitude_rad) + height_m),
        cosine,
        sine / cosine,
        EARTH_RATE_RAD_PER_S * cosine,
        -EARTH_RATE_RAD_PER_S * sine,
        gravity_m_per_s2(latitude_rad, height_m),
    )


def position_scale_m(geodetic: ArrayLike) -> Array:
    """Return how many metres north, east and down one unit of latitude, longitude and height is, [..., 3].

    See Mirzababaei & Akbari, eq. 2, whose inverse of the matrix D has these on its diagonal, each over one.

    Parameters
    ----------
    geodetic
        [..., 3].
    """
    place = _vectors("geodetic", geodetic)
    latitude, height = place[..., 0], place[..., 2]
    north = meridian_radius_m(latitude) + height
    east = (normal_radius_m(latitude) + height) * np.cos(latitude)
    return np.stack([north, east, np.full_like(north, -1.0)], axis=-1)


def attitude_of(roll_pitch_yaw_rad: ArrayLike) -> Array:
    """Return the attitude of a body turned by yaw about down, pitch about the right, and roll, in this order.

    See Groves (2013), eq. 2.22.

    Parameters
    ----------
    roll_pitch_yaw_rad
        [..., 3], radians: the right side down, the nose up, and clockwise from north.

    Returns
    -------
    Array
        From body to north, east, down, [..., 3, 3].
    """
    angles = _vectors("roll_pitch_yaw_rad", roll_pitch_yaw_rad)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def roll_pitch_yaw(attitude: ArrayLike) -> Array:
    """Return the angles of `attitude_of`, pitch within a quarter turn, the others from -pi to pi.

    See Groves (2013), eq. 2.23.

    Parameters
    ----------
    attitude
        [..., 3, 3].

    Returns
    -------
    Array
        [..., 3], radians.
    """
    matrix = np.asarray(attitude, dtype=np.float64)
    roll = np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2])
    pitch = np.arctan2(-matrix[..., 2, 0], np.hypot(matrix[..., 0, 0], matrix[..., 1, 0]))
    return np.stack([roll, pitch, np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0])], axis=-1)


def to_local(geodetic: ArrayLike, origin_geodetic: ArrayLike) -> Array:
    """Return places in the local frame of an origin: a plane that touches the ellipsoid's parallel there.

    See Groves (2013), eqs. 2.112 and 2.150: by way of earth-centred coordinates, exact at any distance.

    Parameters
    ----------
    geodetic
        [..., 3].
    origin_geodetic
        Broadcast against it, [..., 3].

    Returns
    -------
    Array
        East, north and up, [..., 3], metres.
    """
    place, origin = _vectors("geodetic", geodetic), _vectors("origin_geodetic", origin_geodetic)
    # Differences of the two, not of earth-centred coordinates: 1e-9 m is lost on 6e6 m otherwise.
    latitude, longitude, height = (origin[..., axis] for axis in range(3))
    turn, other, up = place[..., 1] - longitude, place[..., 0], place[..., 2]
    sine, cosine = np.sin(latitude), np.cos(latitude)
    sine_other, cosine_other = np.sin(other), np.cos(other)
    lag = 2 * np.sin(0.5 * turn) ** 2
    step = 2 * np.sin(0.5 * (other - latitude))
    middle = 0.5 * (other + latitude)
    sine_less, cosine_less = step * np.cos(middle), -step * np.sin(middle)
    radius, radius_origin = normal_radius_m(other), normal_radius_m(latitude)
    flat = 1 - ECCENTRICITY_SQUARED
    # N' - N from the difference of the squared sines.
    root, root_origin = SEMI_MAJOR_AXIS_M / radius, SEMI_MAJOR_AXIS_M / radius_origin
    squares = sine_less * (sine_other + sine)
    growth = SEMI_MAJOR_AXIS_M * ECCENTRICITY_SQUARED * squares / (root * root_origin * (root + root_origin))
    across = (growth + up - height) * cosine_other + (radius_origin + height) * cosine_less
    axial = (flat * growth + up - height) * sine_other + (flat * radius_origin + height) * sine_less
    whole = (radius + up) * cosine_other
    inward = across - whole * lag
    return np.stack(
        [
            whole * np.sin(turn),
            cosine * axial - sine * inward,
            sine * axial + cosine * inward,
        ],
        axis=-1,
    )


def to_geodetic(local_m: ArrayLike, origin_geodetic: ArrayLike) -> Array:
    """Return geodetic positions of places in the local frame of an origin: the inverse of `to_local`.

    By repetition on the plane that touches the ellipsoid; within 100 km to the rounding of a longitude, 3e-9
    m.

    Parameters
    ----------
    local_m
        East, north and up, [..., 3], metres.
    origin_geodetic
        Broadcast against it, [..., 3].

    Returns
    -------
    Array
        [..., 3].
    """
    target, origin = np.broadcast_arrays(
        _vectors("local_m", local_m), _vectors("origin_geodetic", origin_geodetic)
    )
    ned_m = target[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    place = origin + ned_m / position_scale_m(origin)
    for _ in range(_LOCAL_REPETITIONS):
        off = target - to_local(place, origin)
        ned_m = off[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
        place = place + ned_m / position_scale_m(place)
    return np.asarray(place)


def transport_rate_rad_per_s(velocity_m_per_s: ArrayLike, around: Surroundings) -> Array:
    """Return the rotation of the navigation frame against the earth, w_en.

    See Mirzababaei & Akbari, eq. 1, and Groves (2013), eq. 5.44.

    Parameters
    ----------
    velocity_m_per_s
        North, east and down, [..., 3].
    around
        At the place, each [...].

    Returns
    -------
    Array
        Along north, east and down, [..., 3], radians a second.
    """
    velocity = np.asarray(velocity_m_per_s, dtype=np.float64)
    north = velocity[..., 1] * around.per_normal_m
    return np.stack([north, -velocity[..., 0] * around.per_meridian_m, -north * around.tangent], axis=-1)


def earth_rate_ned_rad_per_s(around: Surroundings) -> Array:
    """Return the rotation of the earth along north, east and down, w_ie, [..., 3], radians a second."""
    return np.stack(
        [around.earth_rate_north, np.zeros_like(around.earth_rate_north), around.earth_rate_down], axis=-1
    )


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
    force = _vectors("specific_force_m_per_s2", specific_force_m_per_s2)
    rate = _vectors("angular_rate_rad_per_s", angular_rate_rad_per_s)
    if force.shape != rate.shape or force.ndim < 2:
        raise InputError(
            "specific_force_m_per_s2 and angular_rate_rad_per_s",
            f"their shapes {force.shape} and {rate.shape} are not both [..., i, 3]",
            "Give one of each a sample",
        )
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


def error_dynamics(
    geodetic: ArrayLike,
    velocity_m_per_s: ArrayLike,
    attitude: ArrayLike,
    specific_force_m_per_s2: ArrayLike,
    *,
    states: int = 9,
    bias_time_s: float = np.inf,
) -> Array:
    """Return the dynamics matrix F of the error of a navigation.

    See Mirzababaei & Akbari, eqs. 8 to 11.1, with their misprints mended: row 2 of eq. 8.1 has v_E sin(lat)
    / ((N + h) cos^2(lat)); eq. 9.1 has v_E squared in row 1 and (N + h)^2 in row 2. As there, the radii are
    taken as constant, and gravity falls with the square of the distance from the centre. With 15 states the
    biases of the accelerometer and the gyroscope, what the sensors read too much, are Gauss-Markov processes.

    Parameters
    ----------
    geodetic, velocity_m_per_s
        [..., 3].
    attitude
        [..., 3, 3].
    specific_force_m_per_s2
        In the body, [..., 3].
    states
        9: latitude, longitude, radians, height, metres, velocity north, east, down, attitude error; or 15.
    bias_time_s
        Correlation time of the biases.

    Returns
    -------
    Array
        [..., states, states], with time in seconds.

    Raises
    ------
    InputError
        For another number of states.
    """
    check_states(states)
    place, velocity = _vectors("geodetic", geodetic), _vectors("velocity_m_per_s", velocity_m_per_s)
    matrix = np.asarray(attitude, dtype=np.float64)
    force = (matrix @ _vectors("specific_force_m_per_s2", specific_force_m_per_s2)[..., None])[..., 0]
    leading = np.broadcast_shapes(place.shape[:-1], velocity.shape[:-1], force.shape[:-1])
    dynamics = np.zeros((*leading, states, states))
    latitude, height = place[..., 0], place[..., 2]
    around = surroundings(latitude, height)
    fill_error_dynamics(dynamics, around, np.moveaxis(velocity, -1, 0))
    dynamics[..., VELOCITY, ATTITUDE] = cross_matrix(force)
    if states == 15:
        dynamics[..., VELOCITY, FORCE_BIAS] = matrix
        dynamics[..., ATTITUDE, RATE_BIAS] = -matrix
        dynamics[..., range(9, 15), range(9, 15)] = -1.0 / bias_time_s
    return dynamics


def fill_error_dynamics(dynamics: Array, around: Surroundings, velocity: Array) -> None:
    """Write the entries of F that depend on place and velocity into its first nine rows and columns.

    See Mirzababaei & Akbari, eqs. 8.1 to 10.2. The terms with the force and the biases stay as they are.

    Parameters
    ----------
    dynamics
        [..., s, s].
    around
        At the place, each [...].
    velocity
        North, east and down FIRST, [3, ...], metres a second.
    """
    north, east, down = velocity
    per_m, per_n, tangent, cosine = around.per_meridian_m, around.per_normal_m, around.tangent, around.cosine
    earth_north, earth_down = around.earth_rate_north, around.earth_rate_down
    north_rate, east_rate = north * per_m, east * per_n
    east_per_cosine = east_rate / cosine
    dynamics[..., 0, 2] = -north_rate * per_m
    dynamics[..., 0, 3] = per_m
    dynamics[..., 1, 0] = east_per_cosine * tangent
    dynamics[..., 1, 2] = -east_per_cosine * per_n
    dynamics[..., 1, 4] = per_n / cosine
    dynamics[..., 2, 5] = -1.0
    # earth_down is minus the rate times the sine of the latitude.
    twice_north, twice_down = 2 * earth_north, 2 * earth_down
    turning = east_per_cosine / cosine
    dynamics[..., 3, 0] = -east * (twice_north + turning)
    dynamics[..., 3, 2] = east_rate * east_rate * tangent - north_rate * per_m * down
    dynamics[..., 4, 0] = twice_north * north + twice_down * down + turning * north
    dynamics[..., 4, 2] = -east_rate * per_n * (down + north * tangent)
    dynamics[..., 5, 0] = -twice_down * east
    dynamics[..., 5, 2] = (
        east_rate * east_rate + north_rate * north_rate - 2 * around.gravity_m_per_s2 * np.sqrt(per_m * per_n)
    )
    steep = east_rate * tangent
    dynamics[..., 3, 3] = down * per_m
    dynamics[..., 3, 4] = twice_down - 2 * steep
    dynamics[..., 3, 5] = north_rate
    dynamics[..., 4, 3] = steep - twice_down
    dynamics[..., 4, 4] = (down + north * tangent) * per_n
    dynamics[..., 4, 5] = twice_north + east_rate
    dynamics[..., 5, 3] = -2 * north_rate
    dynamics[..., 5, 4] = -twice_north - 2 * east_rate
    dynamics[..., 6, 0] = earth_down
    dynamics[..., 6, 2] = -east_rate * per_n
    dynamics[..., 7, 2] = north_rate * per_m
    dynamics[..., 8, 0] = -earth_north - turning
    dynamics[..., 8, 2] = steep * per_n
    dynamics[..., 6, 4] = per_n
    dynamics[..., 7, 3] = -per_m
    dynamics[..., 8, 4] = -tangent * per_n
    spin_north, spin_east, spin_down = earth_north + east_rate, -north_rate, earth_down - steep
    dynamics[..., 6, 7], dynamics[..., 7, 6] = spin_down, -spin_down
    dynamics[..., 6, 8], dynamics[..., 8, 6] = -spin_east, spin_east
    dynamics[..., 7, 8], dynamics[..., 8, 7] = spin_north, -spin_north


def fill_metric_error_dynamics(dynamics: Array, around: Surroundings, velocity: Array) -> None:
    """Write the entries of `fill_error_dynamics` for a position in metres north, east and down.

    See Mirzababaei & Akbari, eqs. 8.1 to 10.2, with the position of eq. 30. Two entries come with the units:
    an error of latitude or longitude that stays is another number of metres after a climb or, of longitude,
    after a move to the north.

    Parameters
    ----------
    dynamics
        [..., s, s].
    around
        At the place, each [...].
    velocity
        North, east and down FIRST, [3, ...], metres a second.
    """
    north, _, down = velocity
    fill_error_dynamics(dynamics, around, velocity)
    scale = metres_per_unit(around)
    dynamics[..., :3, :] *= scale[..., :, None]
    dynamics[..., :, :3] /= scale[..., None, :]
    dynamics[..., 0, 0] = -down * around.per_meridian_m
    dynamics[..., 1, 1] = -down * around.per_normal_m - north * around.tangent * around.per_meridian_m


def metres_per_unit(around: Surroundings) -> Array:
    """Return what `position_scale_m` does, [..., 3], of known surroundings."""
    north = 1.0 / around.per_meridian_m
    return np.stack([north, around.cosine / around.per_normal_m, np.full_like(north, -1.0)], axis=-1)


def noise_input(attitude: ArrayLike, *, states: int = 9) -> Array:
    """Return the design matrix G, which leads the noise of the readings to the rate of the error.

    See Mirzababaei & Akbari, eq. 11.3. With 15 states the noise that drives the biases follows.

    Parameters
    ----------
    attitude
        [..., 3, 3].
    states
        9 or 15.

    Returns
    -------
    Array
        [..., 9, 6] or [..., 15, 12].
    """
    check_states(states)
    matrix = np.asarray(attitude, dtype=np.float64)
    design = np.zeros((*matrix.shape[:-2], states, 6 if states == 9 else 12))
    design[..., VELOCITY, 0:3] = matrix
    design[..., ATTITUDE, 3:6] = -matrix
    if states == 15:
        design[..., range(9, 15), range(6, 12)] = 1.0
    return design


def flat_transition(force_ned_m_per_s2: ArrayLike, duration_s: ArrayLike) -> Array:
    """Return the transition of the error over a flat, resting earth.

    See Mirzababaei & Akbari, eq. 42, whose first row has dt I and [f x] dt^2 / 2, and its second [f x] dt.

    Parameters
    ----------
    force_ned_m_per_s2
        Specific force along north, east and down, [..., 3].
    duration_s
        [...].

    Returns
    -------
    Array
        [..., 9, 9], position in METRES north, east and down.
    """
    force = _vectors("force_ned_m_per_s2", force_ned_m_per_s2)
    duration = np.asarray(duration_s, dtype=np.float64)[..., None, None]
    leading = np.broadcast_shapes(force.shape[:-1], duration.shape[:-2])
    change = np.broadcast_to(np.eye(9), (*leading, 9, 9)).copy()
    crossing = cross_matrix(force) * duration
    change[..., POSITION, VELOCITY] = duration * np.eye(3)
    change[..., VELOCITY, ATTITUDE] = crossing
    change[..., POSITION, ATTITUDE] = 0.5 * duration * crossing
    return change


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


def check_states(states: int) -> None:
    """Refuse a number of states other than 9 or 15."""
    if states not in (9, 15):
        raise InputError(f"states={states}", "the error has 9 or 15", "Take one of them")


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


def _vectors(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise InputError(name, f"its shape is {array.shape}, not [..., 3]", "Put the three parts last")
    return array


def _samples(name: str, values: ArrayLike) -> Array:
    array = _vectors(name, values)
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
