"""GPS beside an inertial navigation: which readings count, time alignment, lever arm, and what they observe.

See Mirzababaei & Akbari, section 3, eqs. 27 to 36.1. Frames are those of `geodetic`, errors those
of `geodetic_error_state`.
"""

from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.geodetic import position_scale_m
from positioning.inertial.geodetic_error_state import ATTITUDE, RATE_BIAS, check_states
from positioning.inertial.strapdown import cross_matrix
from positioning.model import Array, Recording

UNITS = ("metres", "radians")

Flags = NDArray[np.bool_]


def is_number(value: object) -> bool:
    """Return whether a setting is one real number: no truth value, and no text that looks like one."""
    return isinstance(value, Real) and not isinstance(value, bool)


def usable_gps(recording: Recording, outage_s: float | None = None) -> Flags:
    """Return which GPS readings a navigator may use.

    See Mirzababaei & Akbari, section 4: buildings block the GPS. The readings of the outage stand in the
    recording all the same, so that its length can be chosen.

    Parameters
    ----------
    recording
        With ``gps_time_s`` [..., g] and ``gps_geodetic``; without ``gps_outage_s`` there is no outage.
    outage_s
        Length of the outage in place of the recorded one, from the same begin; 0 for none.

    Returns
    -------
    NDArray
        [..., g]; False also where the time or the position is missing.

    Raises
    ------
    InputError
        Without GPS, for a length that is no number or below zero, or one without a recorded begin.
    """
    if recording.gps_time_s is None or recording.gps_geodetic is None:
        raise InputError(
            "recording", "there is no GPS", "Give gps_time_s and gps_geodetic, or switch gps off"
        )
    if outage_s is not None and not (is_number(outage_s) and 0 <= outage_s < np.inf):
        raise InputError(f"outage_s={outage_s!r}", "it is no number, below zero or infinite", "Give seconds")
    time_s = np.asarray(recording.gps_time_s, dtype=np.float64)
    there = np.isfinite(time_s) & np.isfinite(recording.gps_geodetic).all(axis=-1)
    if recording.gps_velocity_m_per_s is not None:
        there &= np.isfinite(recording.gps_velocity_m_per_s).all(axis=-1)
    if recording.gps_outage_s is None:
        if outage_s:
            raise InputError(
                f"outage_s={outage_s}", "the recording does not say where it begins", "Give gps_outage_s"
            )
        return there
    outage = np.asarray(recording.gps_outage_s, dtype=np.float64)
    begin = outage[..., :1]
    end = outage[..., 1:] if outage_s is None else begin + outage_s
    with np.errstate(invalid="ignore"):
        return np.asarray(there & ~((time_s >= begin) & (time_s < end)))


def linear_weights(sample_time_s: ArrayLike, time_s: ArrayLike) -> Array:
    """Return the weights of two samples at a time between them.

    See Mirzababaei & Akbari, eqs. 32 and 33.

    Parameters
    ----------
    sample_time_s
        [..., 2], not equal.
    time_s
        [...].

    Returns
    -------
    Array
        [..., 2].
    """
    samples, time = np.asarray(sample_time_s, np.float64), np.asarray(time_s, np.float64)
    share = (time - samples[..., 0]) / (samples[..., 1] - samples[..., 0])
    return np.stack([1.0 - share, share], axis=-1)


def lagrange_weights(sample_time_s: ArrayLike, time_s: ArrayLike) -> Array:
    """Return the weights of 2 m + 2 samples about a time, m of them before and after the next two.

    See Mirzababaei & Akbari, eqs. 34 and 35, where the product leaves out j = i. With m = 0 these are those
    of `linear_weights`; polynomials up to the order 2 m + 1 are met.

    Parameters
    ----------
    sample_time_s
        [..., k], all different.
    time_s
        [...].

    Returns
    -------
    Array
        [..., k].
    """
    samples, time = np.asarray(sample_time_s, np.float64), np.asarray(time_s, np.float64)
    count = samples.shape[-1]
    shape = np.broadcast_shapes(samples.shape[:-1], time.shape)
    weights = np.ones((*shape, count))
    for one in range(count):
        for other in range(count):
            if other != one:
                weights[..., one] *= (time - samples[..., other]) / (samples[..., one] - samples[..., other])
    return weights


def antenna(
    geodetic: ArrayLike,
    velocity_m_per_s: ArrayLike,
    attitude: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    lever_arm_m: ArrayLike,
) -> tuple[Array, Array]:
    """Return place and velocity of the antenna of a body.

    See Mirzababaei & Akbari, eqs. 36 and 36.1, solved for the GPS.

    Parameters
    ----------
    geodetic, velocity_m_per_s
        Of the inertial measurement unit, [..., 3].
    attitude
        [..., 3, 3].
    angular_rate_rad_per_s
        Of the body against the NAVIGATION frame, in the body, [..., 3].
    lever_arm_m
        From the inertial measurement unit to the antenna in the body, [..., 3].

    Returns
    -------
    geodetic, velocity_m_per_s
        Each [..., 3].
    """
    away, moving = _arms(attitude, angular_rate_rad_per_s, lever_arm_m)
    place = np.asarray(geodetic, np.float64)
    return place + away / position_scale_m(place), np.asarray(velocity_m_per_s, np.float64) + moving


def without_lever_arm(
    geodetic: ArrayLike,
    velocity_m_per_s: ArrayLike,
    attitude: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    lever_arm_m: ArrayLike,
) -> tuple[Array, Array]:
    """Return place and velocity of the inertial measurement unit from those of the antenna.

    See Mirzababaei & Akbari, eqs. 36 and 36.1. The radii are taken at the antenna: 1e-6 of the lever arm.

    Parameters
    ----------
    geodetic, velocity_m_per_s, attitude, angular_rate_rad_per_s, lever_arm_m
        As of `antenna`, the first two of the antenna.

    Returns
    -------
    geodetic, velocity_m_per_s
        Each [..., 3].
    """
    away, moving = _arms(attitude, angular_rate_rad_per_s, lever_arm_m)
    place = np.asarray(geodetic, np.float64)
    return place - away / position_scale_m(place), np.asarray(velocity_m_per_s, np.float64) - moving


def observation_matrix(
    geodetic: ArrayLike,
    attitude: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    lever_arm_m: ArrayLike,
    *,
    units: str = "metres",
    states: int = 9,
) -> Array:
    """Return the derivative of position and velocity of the antenna by the error of a navigation.

    See Mirzababaei & Akbari, eq. 28 (radians) or 30 (metres, a matrix of 6 x 9), here for errors of latitude
    and longitude in radians. The columns of the attitude, which a lever arm brings, are not printed there.

    Parameters
    ----------
    geodetic, attitude, angular_rate_rad_per_s, lever_arm_m
        As of `antenna`.
    units
        ``metres`` for rows in metres north, east and UP, as eq. 29; ``radians`` for those of the state.
    states
        9 or 15.

    Returns
    -------
    Array
        [..., 6, states].

    Raises
    ------
    InputError
        For other units or another number of states.
    """
    check_states(states)
    if units not in UNITS:
        raise InputError(f"units={units!r}", "there are no such units", f"Take one of {UNITS}")
    scale = np.abs(position_scale_m(geodetic))
    matrix = metric_observation_matrix(attitude, angular_rate_rad_per_s, lever_arm_m, states=states)
    matrix = np.broadcast_to(matrix, (*np.broadcast_shapes(scale.shape[:-1], matrix.shape[:-2]), 6, states))
    # Down becomes height, in the rows and in the columns.
    signed = scale * np.array([1.0, 1.0, -1.0])
    matrix = matrix.copy()
    matrix[..., :3] *= signed[..., None, :]
    matrix[..., 2, :] *= -1.0
    if units == "radians":
        matrix[..., :3, :] /= scale[..., :, None]
    return matrix


def metric_observation_matrix(
    attitude: ArrayLike, angular_rate_rad_per_s: ArrayLike, lever_arm_m: ArrayLike, *, states: int = 9
) -> Array:
    """Return the derivative as `observation_matrix`, of metres north, east and down by errors in the same.

    See Mirzababaei & Akbari, eqs. 30 and 52.

    Parameters
    ----------
    attitude, angular_rate_rad_per_s, lever_arm_m
        As of `antenna`.
    states
        9 or 15: a bias of the gyroscope counts in the velocity of the antenna.

    Returns
    -------
    Array
        [..., 6, states].
    """
    away, moving = _arms(attitude, angular_rate_rad_per_s, lever_arm_m)
    matrix = np.zeros((*away.shape[:-1], 6, states))
    matrix[..., range(6), range(6)] = 1.0
    matrix[..., :3, ATTITUDE] = cross_matrix(away)
    matrix[..., 3:, ATTITUDE] = cross_matrix(moving)
    if states == 15:
        lever = np.asarray(lever_arm_m, dtype=np.float64)
        matrix[..., 3:, RATE_BIAS] = -np.asarray(attitude, np.float64) @ cross_matrix(lever)
    return matrix


def _arms(attitude: ArrayLike, rate: ArrayLike, lever_arm_m: ArrayLike) -> tuple[Array, Array]:
    """Return lever arm and its velocity in the navigation frame."""
    matrix, lever = np.asarray(attitude, np.float64), np.asarray(lever_arm_m, np.float64)
    moving = np.cross(np.asarray(rate, np.float64), lever)
    return (matrix @ lever[..., None])[..., 0], (matrix @ moving[..., None])[..., 0]
