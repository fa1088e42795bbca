"""Places and attitudes over the rotating ellipsoid: frames, conversions, and what the earth does there.

See Mirzababaei & Akbari, section 2, eqs. 1 and 2, and Groves (2013), "Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems", chapter 2. Navigation frame: north, east, down. Body frame: x
forward, y right, z down. An attitude is the matrix that leads from the body to the navigation frame. A
geodetic position is latitude and longitude, radians, and height above the ellipsoid, metres. The local frame
of an origin is east, north and up.

The navigation in these frames is in `geodetic_strapdown`, the dynamics of its errors in
`geodetic_error_state`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.inertial.earth import (
    EARTH_RATE_RAD_PER_S,
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS_M,
    gravity_m_per_s2,
    meridian_radius_m,
    normal_radius_m,
)
from positioning.inertial.vectors import vectors
from positioning.model import Array

MOST_LATITUDE_RAD = np.radians(89.9)
"""Nearer to a pole north and east lose their sense, and tan(latitude) its accuracy."""

# Each repetition leaves a share of distance over radius times the tangent of the latitude: nothing but
# rounding after so many, within 100 km.
_LOCAL_REPETITIONS = 20


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
    place = vectors("geodetic", geodetic)
    latitude, height = place[..., 0], place[..., 2]
    north = meridian_radius_m(latitude) + height
    east = (normal_radius_m(latitude) + height) * np.cos(latitude)
    return np.stack([north, east, np.full_like(north, -1.0)], axis=-1)


def metres_per_unit(around: Surroundings) -> Array:
    """Return what `position_scale_m` does, [..., 3], of known surroundings."""
    north = 1.0 / around.per_meridian_m
    return np.stack([north, around.cosine / around.per_normal_m, np.full_like(north, -1.0)], axis=-1)


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
    angles = vectors("roll_pitch_yaw_rad", roll_pitch_yaw_rad)
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
    place, origin = vectors("geodetic", geodetic), vectors("origin_geodetic", origin_geodetic)
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
        vectors("local_m", local_m), vectors("origin_geodetic", origin_geodetic)
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
