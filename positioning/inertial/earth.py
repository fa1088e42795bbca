"""The earth as navigation needs it: radii of curvature, rotation and normal gravity of WGS-84.

See NIMA (2000), "Department of Defense World Geodetic System 1984", TR8350.2, third edition, chapters 3
and 4; for the radii also Groves (2013), "Principles of GNSS, Inertial, and Multisensor Integrated
Navigation Systems", section 2.4.
"""

import numpy as np
from numpy.typing import ArrayLike

from positioning.model import Array

SEMI_MAJOR_AXIS_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
EARTH_RATE_RAD_PER_S = 7.292115e-5
"""Rotation against the stars: 15.04 degrees an hour, where Atia et al. print the 15 of the sun."""

_EQUATOR_GRAVITY_M_PER_S2 = 9.7803253359
_SOMIGLIANA = 0.00193185265241
# Centrifugal acceleration over gravity, at the equator.
_CENTRIFUGAL_SHARE = 0.00344978650684


def meridian_radius_m(latitude_rad: ArrayLike) -> Array:
    """Return the radius of curvature of a line to the north, RM, [...], metres.

    See Groves, eq. 2.105; Atia et al., eqs. 3 and 4, take it.

    Parameters
    ----------
    latitude_rad
        Geodetic, [...], radians.
    """
    denominator = 1 - ECCENTRICITY_SQUARED * np.sin(latitude_rad) ** 2
    return np.asarray(SEMI_MAJOR_AXIS_M * (1 - ECCENTRICITY_SQUARED) / (denominator * np.sqrt(denominator)))


def normal_radius_m(latitude_rad: ArrayLike) -> Array:
    """Return the radius of curvature of a line to the east, RN, [...], metres.

    See Groves, eq. 2.106; Atia et al., eqs. 1, 3 and 5, take it.

    Parameters
    ----------
    latitude_rad
        Geodetic, [...], radians.
    """
    return np.asarray(SEMI_MAJOR_AXIS_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude_rad) ** 2))


def earth_rate_rad_per_s(latitude_rad: ArrayLike) -> Array:
    """Return the rotation of the earth along east, north and up, [..., 3], radians a second.

    See Groves, eq. 2.123. A gyroscope that rests with its axis up reads the last one.

    Parameters
    ----------
    latitude_rad
        Geodetic, [...], radians.
    """
    latitude = np.asarray(latitude_rad, dtype=np.float64)
    parts = (np.zeros_like(latitude), np.cos(latitude), np.sin(latitude))
    return EARTH_RATE_RAD_PER_S * np.stack(parts, axis=-1)


def gravity_m_per_s2(latitude_rad: ArrayLike, height_m: ArrayLike = 0.0) -> Array:
    """Return normal gravity, [...], metres a second squared: what a resting accelerometer reads upwards.

    See NIMA, eqs. 4-1 (Somigliana) and 4-3 (to second order in the height). The real one differs by up to
    some 0.001 with the rock below.

    Parameters
    ----------
    latitude_rad
        Geodetic, [...], radians.
    height_m
        Above the ellipsoid, [...], metres.
    """
    sine_squared = np.sin(latitude_rad) ** 2
    surface = _EQUATOR_GRAVITY_M_PER_S2 * (1 + _SOMIGLIANA * sine_squared)
    surface /= np.sqrt(1 - ECCENTRICITY_SQUARED * sine_squared)
    height = np.asarray(height_m, dtype=np.float64) / SEMI_MAJOR_AXIS_M
    slope = 1 + FLATTENING + _CENTRIFUGAL_SHARE - 2 * FLATTENING * sine_squared
    return np.asarray(surface * (1 - 2 * slope * height + 3 * height**2))
