"""Strapdown inertial navigation over a flat, resting earth.

See Frank et al., section 3.1, and Groves (2013), "Principles of GNSS, Inertial, and Multisensor Integrated
Navigation Systems", section 5.3. Navigation frame: x east, y north, z up. Sensor frame: x forward, y left,
z up. An attitude is the matrix that leads from the sensor to the navigation frame.

A reading of the inertial measurement unit is the constant specific force ``f`` and angular rate ``w`` that
lead exactly from one sample to the next, ``dt`` later: ``C' = C Exp(w dt)``, ``v' = v + C J(w dt) f dt +
g dt``, where J is the mean rotation on the way, and ``p' = p + (v + v') dt / 2``. So `navigate` and
`readings` are exact inverses of each other, whatever the sampling rate.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.vectors import force_and_rate, vectors
from positioning.model import Array

GRAVITY_M_PER_S2 = 9.80665
"""Standard gravity."""

# Below this angle series take the place of closed forms that cancel; both are exact to 1e-13 there.
_SMALL_RAD = 0.1
# Matrices that were written with six digits, or multiplied a million times, are rotations still.
_MOST_OFF_ROTATION = 1e-5


class Navigation(NamedTuple):
    """Motion at the samples: the start, and the end of each reading's interval.

    Attributes
    ----------
    position_m
        [..., i + 1, 3].
    velocity_m_per_s
        [..., i + 1, 3].
    attitude
        [..., i + 1, 3, 3].
    """

    position_m: Array
    velocity_m_per_s: Array
    attitude: Array


class Readings(NamedTuple):
    """What an inertial measurement unit reads, each [..., i, 3], in the frame of the sensor."""

    specific_force_m_per_s2: Array
    angular_rate_rad_per_s: Array


def rotation(vector_rad: ArrayLike) -> Array:
    """Return the matrix of a rotation vector: the matrix exponential of its cross product.

    See Groves (2013), eq. 5.73 (the formula of Rodrigues).

    Parameters
    ----------
    vector_rad
        Axis times angle, [..., 3], radians.

    Returns
    -------
    Array
        [..., 3, 3].
    """
    vector = vectors("vector_rad", vector_rad)
    angle = np.linalg.norm(vector, axis=-1)
    return _polynomial(vector, np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2)


def mean_rotation(vector_rad: ArrayLike) -> Array:
    """Return the mean of the matrices on the way from none to the whole of a rotation vector.

    See Groves (2013), eq. 5.84: it leads a constant specific force from the rotating frame of the sensor to
    that of the sample before.

    Parameters
    ----------
    vector_rad
        Axis times angle, [..., 3], radians.

    Returns
    -------
    Array
        [..., 3, 3].
    """
    vector = vectors("vector_rad", vector_rad)
    angle = np.linalg.norm(vector, axis=-1)
    return _polynomial(vector, 0.5 * np.sinc(angle / (2 * np.pi)) ** 2, _cubic(angle))


def rotation_vector(matrix: ArrayLike) -> Array:
    """Return the rotation vector of matrices, with an angle from 0 to pi.

    By way of the unit quaternion, from its greatest part (Shepperd's method), which is exact near 0 and pi.

    Parameters
    ----------
    matrix
        [..., 3, 3].

    Returns
    -------
    Array
        [..., 3], radians.
    """
    rotations = np.asarray(matrix, dtype=np.float64)
    xx, yy, zz = (rotations[..., axis, axis] for axis in range(3))
    right = rotations[..., 2, 1], rotations[..., 0, 2], rotations[..., 1, 0]
    left = rotations[..., 1, 2], rotations[..., 2, 0], rotations[..., 0, 1]
    (wx, wy, wz), (yz, zx, xy) = (
        [a - b for a, b in zip(right, left, strict=True)],
        [a + b for a, b in zip(right, left, strict=True)],
    )
    # Row k: four times the quaternion (w, x, y, z) times its part k.
    rows = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], axis=-1),
            np.stack([wx, 1 + xx - yy - zz, xy, zx], axis=-1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], axis=-1),
            np.stack([wz, zx, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    quaternion *= np.where(quaternion[..., :1] < 0, -1.0, 1.0)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1)
    angle = 2 * np.arctan2(sine, quaternion[..., 0])
    length = np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 2.0)
    return np.asarray(length[..., None] * quaternion[..., 1:])


def attitude_of(roll_rad: ArrayLike, pitch_rad: ArrayLike, heading_rad: ArrayLike) -> Array:
    """Return the attitude of a sensor turned by roll, then pitch, then heading.

    See Groves (2013), section 2.2.1, here with z up: each angle turns counter-clockwise about its axis.

    Parameters
    ----------
    roll_rad
        About the forward axis, [...]: the left side goes up.
    pitch_rad
        About the left axis, [...]: the front goes down.
    heading_rad
        About the vertical, [...], from the x axis to the left.

    Returns
    -------
    Array
        [..., 3, 3].
    """
    roll, pitch, heading = np.broadcast_arrays(
        *(np.asarray(value, dtype=np.float64) for value in (roll_rad, pitch_rad, heading_rad))
    )
    (sr, sp, sh), (cr, cp, ch) = (
        [np.sin(v) for v in (roll, pitch, heading)],
        [np.cos(v) for v in (roll, pitch, heading)],
    )
    rows = (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def roll_pitch_heading(attitude: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the angles of `attitude_of`, pitch within a quarter turn.

    See Groves (2013), eq. 2.23.

    Parameters
    ----------
    attitude
        [..., 3, 3].

    Returns
    -------
    roll_rad, pitch_rad, heading_rad
        Each [...].
    """
    matrix = np.asarray(attitude, dtype=np.float64)
    roll = np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2])
    pitch = np.arctan2(-matrix[..., 2, 0], np.hypot(matrix[..., 0, 0], matrix[..., 1, 0]))
    return np.asarray(roll), np.asarray(pitch), np.asarray(np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0]))


def levelled(specific_force_m_per_s2: ArrayLike) -> tuple[Array, Array]:
    """Return roll and pitch of a sensor at rest, from the direction of its specific force.

    See Groves (2013), section 5.6.2.

    Parameters
    ----------
    specific_force_m_per_s2
        Mean reading at rest, [..., 3]; only its direction counts.

    Returns
    -------
    roll_rad, pitch_rad
        Each [...].
    """
    force = vectors("specific_force_m_per_s2", specific_force_m_per_s2)
    x, y, z = (force[..., axis] for axis in range(3))
    return np.asarray(np.arctan2(y, z)), np.asarray(np.arctan2(-x, np.hypot(y, z)))


def navigate(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    duration_s: ArrayLike,
    *,
    position_m: ArrayLike = 0.0,
    velocity_m_per_s: ArrayLike = 0.0,
    attitude: ArrayLike | None = None,
    gravity_m_per_s2: ArrayLike = GRAVITY_M_PER_S2,
) -> Navigation:
    """Integrate readings to position, velocity and attitude.

    See Frank et al., section 3.1. One loop over time for the attitude, all leading axes in lock-step.

    Parameters
    ----------
    specific_force_m_per_s2, angular_rate_rad_per_s
        [..., i, 3], in the frame of the sensor.
    duration_s
        Of each reading, one number or [..., i], seconds.
    position_m, velocity_m_per_s
        At the start, [..., 3].
    attitude
        At the start, [..., 3, 3]; None for none.
    gravity_m_per_s2
        One number, which points down, or a vector [..., 3].

    Returns
    -------
    Navigation
        With one sample more than readings.

    Raises
    ------
    InputError
        For shapes that do not fit, durations that are not above zero, an attitude that is no rotation, or a
        gravity that is not above zero.
    """
    force, rate = force_and_rate(specific_force_m_per_s2, angular_rate_rad_per_s)
    leading, count = force.shape[:-2], force.shape[-2]
    duration = _durations(duration_s, (*leading, count))
    turn = rate * duration[..., None]
    advance = (mean_rotation(turn) @ (force * duration[..., None])[..., None])[..., 0]
    increment = rotation(turn)
    attitudes = np.empty((*leading, count + 1, 3, 3))
    attitudes[..., 0, :, :] = np.eye(3) if attitude is None else _attitude(attitude, leading)
    for sample in range(count):
        np.matmul(
            attitudes[..., sample, :, :], increment[..., sample, :, :], out=attitudes[..., sample + 1, :, :]
        )
    gravity = _gravity(gravity_m_per_s2)[..., None, :]
    velocity = np.empty((*leading, count + 1, 3))
    velocity[..., 0, :] = velocity_m_per_s
    velocity[..., 1:, :] = (attitudes[..., :-1, :, :] @ advance[..., None])[..., 0]
    velocity[..., 1:, :] += gravity * duration[..., None]
    np.cumsum(velocity, axis=-2, out=velocity)
    position = np.empty_like(velocity)
    position[..., 0, :] = position_m
    position[..., 1:, :] = 0.5 * duration[..., None] * (velocity[..., 1:, :] + velocity[..., :-1, :])
    np.cumsum(position, axis=-2, out=position)
    return Navigation(position, velocity, attitudes)


def readings(
    velocity_m_per_s: ArrayLike,
    attitude: ArrayLike,
    duration_s: ArrayLike,
    gravity_m_per_s2: ArrayLike = GRAVITY_M_PER_S2,
) -> Readings:
    """Return what a faultless unit reads on a motion: the exact inverse of `navigate`.

    Parameters
    ----------
    velocity_m_per_s
        At the samples, [..., i + 1, 3].
    attitude
        At the samples, [..., i + 1, 3, 3].
    duration_s
        Between samples, one number or [..., i], seconds.
    gravity_m_per_s2
        One number, which points down, or a vector [..., 3].

    Returns
    -------
    Readings
        One less than samples. Between two samples the sensor turns by at most half a turn.

    Raises
    ------
    InputError
        For shapes that do not fit, durations that are not above zero, or a gravity that is not above zero.
    """
    velocity = vectors("velocity_m_per_s", velocity_m_per_s)
    matrix = np.asarray(attitude, dtype=np.float64)
    if velocity.ndim < 2 or velocity.shape[-2] < 2 or matrix.shape != (*velocity.shape, 3):
        raise InputError(
            "velocity_m_per_s and attitude",
            f"their shapes {velocity.shape} and {matrix.shape} are not [..., i, 3] and [..., i, 3, 3]",
            "Give both at each of two samples or more",
        )
    duration = _durations(duration_s, (*velocity.shape[:-2], velocity.shape[-2] - 1))[..., None]
    back = np.swapaxes(matrix[..., :-1, :, :], -1, -2)
    turn = rotation_vector(back @ matrix[..., 1:, :, :])
    change = np.diff(velocity, axis=-2) - _gravity(gravity_m_per_s2)[..., None, :] * duration
    advance = (back @ change[..., None])[..., 0]
    return Readings(_without_mean_rotation(turn, advance) / duration, turn / duration)


def cross_matrix(vector: Array) -> Array:
    """Return the matrices [..., 3, 3] whose product with another vector is the cross product."""
    x, y, z = (vector[..., axis] for axis in range(3))
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def _polynomial(vector: Array, linear: Array, square: Array) -> Array:
    """Return I + linear K + square K K, where K is the cross product with the vector."""
    x, y, z = (vector[..., axis] for axis in range(3))
    matrix = np.empty((*vector.shape, 3))
    xx, yy, zz = square * x * x, square * y * y, square * z * z
    for axis, others in enumerate((yy + zz, xx + zz, xx + yy)):
        matrix[..., axis, axis] = 1.0 - others
    for row, column, product, part in ((0, 1, x * y, z), (2, 0, z * x, y), (1, 2, y * z, x)):
        matrix[..., row, column] = square * product - linear * part
        matrix[..., column, row] = square * product + linear * part
    return matrix


def _without_mean_rotation(vector: Array, turned: Array) -> Array:
    """Return the vectors that the mean rotation leads to the given ones."""
    angle = np.linalg.norm(vector, axis=-1)
    squared = angle * angle
    small = angle < _SMALL_RAD
    safe = np.where(small, 1.0, angle)
    exact = (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / (safe * safe)
    series = 1 / 12 + squared * (1 / 720 + squared * (1 / 30240 + squared / 1209600))
    cross = np.cross(vector, turned)
    return np.asarray(
        turned - 0.5 * cross + np.where(small, series, exact)[..., None] * np.cross(vector, cross)
    )


def _cubic(angle: Array) -> Array:
    """Return (a - sin a) / a^3."""
    squared = angle * angle
    small = angle < _SMALL_RAD
    safe = np.where(small, 1.0, angle)
    series = 1 / 6 - squared * (1 / 120 - squared * (1 / 5040 - squared / 362880))
    return np.where(small, series, (safe - np.sin(safe)) / (safe * safe * safe))


def _durations(duration_s: ArrayLike, shape: tuple[int, ...]) -> Array:
    duration = np.asarray(duration_s, dtype=np.float64)
    if not (np.isfinite(duration) & (duration > 0)).all():
        raise InputError("duration_s", "it is not everywhere finite and above zero", "Give seconds")
    try:
        return np.broadcast_to(duration, shape)
    except ValueError as error:
        raise InputError(
            "duration_s",
            f"its shape {duration.shape} does not fit {shape}",
            "Give one a reading or one number",
        ) from error


def _gravity(gravity_m_per_s2: ArrayLike) -> Array:
    gravity = np.asarray(gravity_m_per_s2, dtype=np.float64)
    if gravity.ndim:
        gravity = vectors("gravity_m_per_s2", gravity)
    if not np.isfinite(gravity).all() or (gravity.ndim == 0 and gravity <= 0):
        raise InputError(
            f"gravity_m_per_s2={gravity}",
            "it is not finite and above zero",
            "Give its magnitude, or a vector that points down",
        )
    return np.array([0.0, 0.0, -float(gravity)]) if gravity.ndim == 0 else gravity


def _attitude(attitude: ArrayLike, leading: tuple[int, ...]) -> Array:
    matrix = np.asarray(attitude, dtype=np.float64)
    try:
        if matrix.ndim < 2:
            raise ValueError
        fitted = np.broadcast_to(matrix, (*leading, 3, 3))
    except ValueError as error:
        raise InputError(
            "attitude", f"its shape {matrix.shape} does not fit {(*leading, 3, 3)}", "Give one matrix each"
        ) from error
    off = np.abs(matrix @ np.swapaxes(matrix, -1, -2) - np.eye(3))
    # Not a number is no rotation either.
    if not (off <= _MOST_OFF_ROTATION).all() or not (np.linalg.det(matrix) > 0).all():
        raise InputError(
            "attitude", "it is no rotation: its columns are not orthonormal", "Use attitude_of or rotation"
        )
    return fitted
