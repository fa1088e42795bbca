"""Landmarks seen by range, bearing and elevation, and what they tell a navigation and a map.

See Mirzababaei & Akbari, section 5, eqs. 47 to 51. Places are in a local frame north, east, down, metres; the
axes of the sensor are those of the body, x forward, y right, z down, so that the elevation of eq. 48 is
positive BELOW the horizontal plane of the body. Errors are those of `geodetic_error_state`: navigation less
truth.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.inertial.geodetic_error_state import ATTITUDE, POSITION
from positioning.inertial.strapdown import cross_matrix
from positioning.model import Array

LEAST_RANGE_M = 0.05
"""Nearer to the sensor a landmark has no direction; assumed."""
LEAST_ACROSS = 1e-3
"""A landmark has no bearing where its distance across, over that along the vertical axis, is smaller."""


def relative_m(sighting: ArrayLike) -> Array:
    """Return the place of a landmark against the sensor, in its axes.

    See Mirzababaei & Akbari, eq. 48.

    Parameters
    ----------
    sighting
        Range, metres, bearing and elevation, radians, [..., 3].

    Returns
    -------
    Array
        [..., 3], metres.
    """
    range_m, bearing, elevation = np.moveaxis(np.asarray(sighting, dtype=np.float64), -1, 0)
    across = range_m * np.cos(elevation)
    return np.stack(
        [across * np.cos(bearing), across * np.sin(bearing), range_m * np.sin(elevation)], axis=-1
    )


def sighting_of(relative: ArrayLike) -> Array:
    """Return range, bearing and elevation of a landmark: the inverse of `relative_m`.

    See Mirzababaei & Akbari, eq. 49, with arcs of all four quadrants.

    Parameters
    ----------
    relative
        In the axes of the sensor, [..., 3], metres.

    Returns
    -------
    Array
        Range, metres, bearing from -pi to pi, elevation, radians, [..., 3].
    """
    x, y, z = np.moveaxis(np.asarray(relative, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    return np.stack([np.hypot(across, z), np.arctan2(y, x), np.arctan2(z, across)], axis=-1)


def from_sensor_m(
    landmark_m: ArrayLike, position_m: ArrayLike, attitude: ArrayLike, lever_arm_m: ArrayLike
) -> Array:
    """Return the place of a landmark against the sensor, in its axes.

    See Mirzababaei & Akbari, eq. 50.

    Parameters
    ----------
    landmark_m, position_m
        Of landmark and inertial measurement unit, north, east, down, [..., 3].
    attitude
        From body to north, east, down, [..., 3, 3].
    lever_arm_m
        From the inertial measurement unit to the sensor in the body, [..., 3].

    Returns
    -------
    Array
        [..., 3], metres.
    """
    away = np.asarray(landmark_m, np.float64) - np.asarray(position_m, np.float64)
    back = np.swapaxes(np.asarray(attitude, np.float64), -1, -2)
    return (back @ away[..., None])[..., 0] - np.asarray(lever_arm_m, np.float64)


def has_direction(relative: ArrayLike) -> NDArray[np.bool_]:
    """Return whether range, bearing and elevation of a landmark are smooth where it stands.

    They are not at the sensor itself, nor right above or below it. Behind it they are.

    Parameters
    ----------
    relative
        In the axes of the sensor, [..., 3], metres; False where it is not finite.

    Returns
    -------
    NDArray
        [...].
    """
    x, y, z = np.moveaxis(np.asarray(relative, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    far = np.hypot(across, z) >= LEAST_RANGE_M
    return np.asarray(far & (across >= LEAST_ACROSS * np.abs(z)) & np.isfinite(across + z))


def polar_derivative(relative: ArrayLike) -> Array:
    """Return the derivative of range, bearing and elevation by the place against the sensor.

    See Mirzababaei & Akbari, eq. 49.

    Parameters
    ----------
    relative
        [..., 3], metres, where `has_direction`.

    Returns
    -------
    Array
        [..., 3, 3].
    """
    x, y, z = np.moveaxis(np.asarray(relative, dtype=np.float64), -1, 0)
    squared = x * x + y * y
    across, range_squared = np.sqrt(squared), squared + z * z
    range_m = np.sqrt(range_squared)
    steep = z / (range_squared * across)
    rows = (
        (x / range_m, y / range_m, z / range_m),
        (-y / squared, x / squared, np.zeros_like(x)),
        (-x * steep, -y * steep, across / range_squared),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def observation_matrices(
    landmark_m: ArrayLike, position_m: ArrayLike, attitude: ArrayLike, lever_arm_m: ArrayLike
) -> tuple[Array, Array]:
    """Return the derivatives of a sighting by the errors of navigation and landmark.

    See Mirzababaei & Akbari, eq. 51, which leaves out the columns of the landmark: those of the position
    with the other sign.

    Parameters
    ----------
    landmark_m, position_m, attitude, lever_arm_m
        As of `from_sensor_m`.

    Returns
    -------
    by_vehicle
        Position, metres north, east, down, velocity and attitude, [..., 3, 9].
    by_landmark
        [..., 3, 3].
    """
    relative = from_sensor_m(landmark_m, position_m, attitude, lever_arm_m)
    away = np.asarray(landmark_m, np.float64) - np.asarray(position_m, np.float64)
    by_landmark = polar_derivative(relative) @ np.swapaxes(np.asarray(attitude, np.float64), -1, -2)
    by_vehicle = np.zeros((*by_landmark.shape[:-1], 9))
    by_vehicle[..., POSITION] = -by_landmark
    by_vehicle[..., ATTITUDE] = -by_landmark @ cross_matrix(away)
    return by_vehicle, by_landmark


def first_sight(
    position_m: ArrayLike, attitude: ArrayLike, lever_arm_m: ArrayLike, sighting: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return where a landmark seen for the first time stands, and how its error hangs on others.

    See Mirzababaei & Akbari, eq. 47. The error of the landmark is that of the vehicle through the first
    derivative, so that both are correlated, and that of the sighting through the second.

    Parameters
    ----------
    position_m, attitude, lever_arm_m
        As of `from_sensor_m`.
    sighting
        Range, metres, bearing and elevation, radians, [..., 3].

    Returns
    -------
    landmark_m
        North, east, down, [..., 3].
    by_vehicle
        [..., 3, 9].
    by_sighting
        [..., 3, 3].
    """
    seen, matrix = np.asarray(sighting, np.float64), np.asarray(attitude, np.float64)
    relative = relative_m(seen)
    away = (matrix @ (relative + np.asarray(lever_arm_m, np.float64))[..., None])[..., 0]
    by_vehicle = np.zeros((*away.shape[:-1], 3, 9))
    by_vehicle[..., range(3), range(3)] = 1.0
    by_vehicle[..., ATTITUDE] = cross_matrix(away)
    (sb, se), (cb, ce) = ([f(seen[..., 1]), f(seen[..., 2])] for f in (np.sin, np.cos))
    range_m = seen[..., 0]
    rows = (
        (cb * ce, -range_m * sb * ce, -range_m * cb * se),
        (sb * ce, range_m * cb * ce, -range_m * sb * se),
        (se, np.zeros_like(se), range_m * ce),
    )
    polar = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(position_m, np.float64) + away, by_vehicle, matrix @ polar
