"""The error of a navigation over the rotating ellipsoid: its dynamics, and the noise that drives it.

See Mirzababaei & Akbari, section 2, eqs. 8 to 11, and eq. 42 for the flat model. Frames are those of
`geodetic`.

Errors follow one convention: error = navigation less truth, and for the attitude ``C_navigation = (I - E)
C_truth``, where E is the cross product with the attitude error.
"""

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.geodetic import Surroundings, metres_per_unit, surroundings
from positioning.inertial.strapdown import cross_matrix
from positioning.inertial.vectors import vectors
from positioning.model import Array

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
FORCE_BIAS, RATE_BIAS = slice(9, 12), slice(12, 15)


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
    place, velocity = vectors("geodetic", geodetic), vectors("velocity_m_per_s", velocity_m_per_s)
    matrix = np.asarray(attitude, dtype=np.float64)
    force = (matrix @ vectors("specific_force_m_per_s2", specific_force_m_per_s2)[..., None])[..., 0]
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
    force = vectors("force_ned_m_per_s2", force_ned_m_per_s2)
    duration = np.asarray(duration_s, dtype=np.float64)[..., None, None]
    leading = np.broadcast_shapes(force.shape[:-1], duration.shape[:-2])
    change = np.broadcast_to(np.eye(9), (*leading, 9, 9)).copy()
    crossing = cross_matrix(force) * duration
    change[..., POSITION, VELOCITY] = duration * np.eye(3)
    change[..., VELOCITY, ATTITUDE] = crossing
    change[..., POSITION, ATTITUDE] = 0.5 * duration * crossing
    return change


def check_states(states: int) -> None:
    """Refuse a number of states other than 9 or 15."""
    if states not in (9, 15):
        raise InputError(f"states={states}", "the error has 9 or 15", "Take one of them")
