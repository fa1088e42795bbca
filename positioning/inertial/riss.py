"""Reduced inertial sensor system: where one gyroscope and an odometer say that a vehicle went.

See Atia et al., section 2. With constant rates while a reading holds (see `riss_readings`), a vehicle runs on
a circle, which is integrated exactly. The sum over readings is therefore of second order, and the angle is
the same at 100 Hz and after averaging to 50 Hz.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.earth import EARTH_RATE_RAD_PER_S, meridian_radius_m, normal_radius_m
from positioning.inertial.riss_readings import REST_SPEED_M_PER_S, first_rest, readings, refuse
from positioning.model import Array, Recording

# Each pass shrinks what the position feeds back to the azimuth by distance over radius of the earth.
_PASSES = 2


class Mechanised(NamedTuple):
    """Where the vehicle was at the edges of the readings, each [..., m + 1].

    Attributes
    ----------
    azimuth_rad
        Clockwise from north, not wrapped.
    latitude_rad, longitude_rad
        Geodetic.
    east_m, north_m
        From the start.
    """

    azimuth_rad: Array
    latitude_rad: Array
    longitude_rad: Array
    east_m: Array
    north_m: Array


class Increments(NamedTuple):
    """Motion since the epoch before, each [r, n]; zero at the first epoch and after the last.

    Attributes
    ----------
    turn_rad
        Change of the heading, positive to the left.
    forward_m, left_m
        Displacement in the frame of the heading at the epoch before.
    moving
        Whether the odometer read a motion at any time since the epoch before; at the first epoch, whether
        it reads one then.
    distance_m
        Length of the way.
    """

    turn_rad: Array
    forward_m: Array
    left_m: Array
    moving: NDArray[np.bool_]
    distance_m: Array


class Moved(NamedTuple):
    """A state after a step, and its derivatives.

    Attributes
    ----------
    state
        [..., s].
    by_state
        [..., s, s].
    by_noise
        By an error of the turn, radians, and of the distance, as a share of it: [..., s, 2].
    """

    state: Array
    by_state: Array
    by_noise: Array


def mechanise(
    edge_s: ArrayLike,
    gyro_rad_per_s: ArrayLike,
    speed_m_per_s: ArrayLike,
    *,
    azimuth_rad: ArrayLike,
    latitude_rad: ArrayLike,
    longitude_rad: ArrayLike = 0.0,
    altitude_m: float = 0.0,
    earth_rate_rad_per_s: ArrayLike = EARTH_RATE_RAD_PER_S,
) -> Mechanised:
    """Integrate turn rate and speed to azimuth, latitude and longitude, and those to metres.

    See Atia et al., eqs. 1 to 5. Eq. 1 lacks a minus sign: its gyroscope counts to the left, its azimuth
    to the right. The position feeds back to the azimuth by latitude and transport rate; this is solved
    by passes over the whole way, each of which is exact up to what the one before left open: within 30 m
    and minutes, some 1e-10 rad after the second.

    Parameters
    ----------
    edge_s
        Times between which the readings hold, [..., m + 1], seconds, not decreasing.
    gyro_rad_per_s
        Turn rate against the stars, [..., m], positive to the left.
    speed_m_per_s
        [..., m], negative in reverse.
    azimuth_rad, latitude_rad, longitude_rad
        At the first edge, [...].
    altitude_m
        Above the ellipsoid.
    earth_rate_rad_per_s
        Rotation of the earth, [...]; zero where a mean at rest, which holds it, was taken off the readings.

    Returns
    -------
    Mechanised
        Each [..., m + 1].

    Raises
    ------
    InputError
        For shapes that do not fit each other, or edges that decrease.
    """
    edges, gyro, speed = (np.asarray(v, np.float64) for v in (edge_s, gyro_rad_per_s, speed_m_per_s))
    if gyro.shape != speed.shape or edges.shape != (*gyro.shape[:-1], gyro.shape[-1] + 1):
        raise InputError(
            "edge_s, gyro_rad_per_s and speed_m_per_s",
            f"their shapes {edges.shape}, {gyro.shape} and {speed.shape} are not [m + 1], [m] and [m]",
            "Give one edge more than readings",
        )
    with np.errstate(invalid="ignore"):
        unordered = ~(np.diff(edges, axis=-1) >= 0)
    refuse("edge_s", unordered, "the time decreases or is missing after it", "Sort by time, without NaN")
    start_azimuth, start_latitude, start_longitude, earth_rate = (
        np.asarray(v, dtype=np.float64)[..., None]
        for v in (azimuth_rad, latitude_rad, longitude_rad, earth_rate_rad_per_s)
    )
    duration_s = np.diff(edges)
    latitude, east_m_per_s = start_latitude, np.zeros(1)
    for _ in range(_PASSES):
        transport_rate = east_m_per_s * np.tan(latitude) / (normal_radius_m(latitude) + altitude_m)
        turn = -(gyro - earth_rate * np.sin(latitude) - transport_rate) * duration_s
        azimuth = start_azimuth + _running(turn)
        middle = azimuth[..., :-1] + 0.5 * turn
        chord_m_per_s = speed * _chord(turn)
        east_m_per_s, north_m_per_s = chord_m_per_s * np.sin(middle), chord_m_per_s * np.cos(middle)
        rate = north_m_per_s / (meridian_radius_m(latitude) + altitude_m)
        latitude_edges = start_latitude + _running(rate * duration_s)
        latitude = 0.5 * (latitude_edges[..., :-1] + latitude_edges[..., 1:])
    across_m = (normal_radius_m(latitude) + altitude_m) * np.cos(latitude)
    longitude_edges = start_longitude + _running(east_m_per_s / across_m * duration_s)
    north_m = (latitude_edges - start_latitude) * (meridian_radius_m(latitude_edges) + altitude_m)
    across_m = (normal_radius_m(latitude_edges) + altitude_m) * np.cos(latitude_edges)
    east_m = (longitude_edges - start_longitude) * across_m
    return Mechanised(azimuth, latitude_edges, longitude_edges, east_m, north_m)


def increments(recording: Recording) -> Increments:
    """Mechanise the motion between consecutive epochs of a stack.

    See Atia et al., section 2 and section 5.6.2. The gyroscope's mean at the first rest is taken off, and
    the earth rate with it; without a rest nothing is taken off. The transport rate, at most 5e-6 rad over
    30 m, depends on the heading from north and is left out.

    A filter moves by ``position += R(heading) (forward, left)`` and then ``heading += turn``.

    Parameters
    ----------
    recording
        Stack with epochs [r, n] and readings of the motion [r, m]; of a single recording
        `positioning.filters.plane.with_leading_axis` makes one.

    Raises
    ------
    InputError
        For input that `readings` refuses.
    """
    read = readings(recording)
    duration_s = np.diff(read.edge_s)
    turn = (read.gyro_rad_per_s - first_rest(recording).gyro_rad_per_s[:, None]) * duration_s
    heading = _running(turn)
    middle = heading[:, :-1] + 0.5 * turn
    chord_m = read.speed_m_per_s * duration_s * _chord(turn)
    path = heading, _running(chord_m * np.cos(middle)), _running(chord_m * np.sin(middle))
    heading, x_m, y_m = (np.take_along_axis(values, read.epoch, axis=1) for values in path)
    moves = np.abs(read.speed_m_per_s) > REST_SPEED_M_PER_S
    speed = np.abs(read.speed_m_per_s)
    distance_m, moving_s = (
        np.take_along_axis(_running(values * duration_s), read.epoch, axis=1) for values in (speed, moves)
    )
    ended = np.isnan(np.asarray(recording.time_s, dtype=np.float64))

    def since(values: Array) -> Array:
        return np.where(ended, 0.0, np.diff(values, axis=1, prepend=values[:, :1]))

    before = np.concatenate([heading[:, :1], heading[:, :-1]], axis=1)
    east_m, north_m, ahead, aside = since(x_m), since(y_m), np.cos(before), np.sin(before)
    moving = since(moving_s) > 0
    # The reading of the first epoch is the one that holds after its edge.
    held = np.minimum(read.epoch[:, :1], moves.shape[1] - 1)
    moving[:, :1] = np.take_along_axis(moves, held, axis=1)
    return Increments(
        since(heading),
        ahead * east_m + aside * north_m,
        ahead * north_m - aside * east_m,
        moving,
        since(distance_m),
    )


def move(
    state: Array, turn_rad: ArrayLike, forward_m: ArrayLike, left_m: ArrayLike, biased_s: ArrayLike
) -> Moved:
    """Move states by increments, and differentiate.

    See Atia et al., section 5.6.2, for the first three states. A bias turns the heading evenly along the
    step, and so does the error of a turn: the step leads in the direction half way between.

    Parameters
    ----------
    state
        x, y, heading, and where there are five the gyroscope's bias, radians a second, and the odometer's
        scale, as a multiple of the true speed: [..., 3 or 5].
    turn_rad, forward_m, left_m
        As in `Increments`, [...].
    biased_s
        For how long the bias acted, [...].
    """
    turn, forward, left, seconds = (
        np.asarray(v, np.float64) for v in (turn_rad, forward_m, left_m, biased_s)
    )
    augmented = state.shape[-1] == 5
    bias, scale = (state[..., 3], state[..., 4]) if augmented else (0.0, 1.0)
    way_rad = state[..., 2] - 0.5 * seconds * bias
    east_m = (np.cos(way_rad) * forward - np.sin(way_rad) * left) / scale
    north_m = (np.sin(way_rad) * forward + np.cos(way_rad) * left) / scale
    moved = state.copy()
    moved[..., 0] += east_m
    moved[..., 1] += north_m
    moved[..., 2] += turn - seconds * bias
    by_state = np.broadcast_to(np.eye(state.shape[-1]), (*state.shape, state.shape[-1])).copy()
    by_state[..., 0, 2], by_state[..., 1, 2] = -north_m, east_m
    if augmented:
        by_state[..., 0, 3], by_state[..., 1, 3] = 0.5 * seconds * north_m, -0.5 * seconds * east_m
        by_state[..., 2, 3] = -seconds
        by_state[..., 0, 4], by_state[..., 1, 4] = -east_m / scale, -north_m / scale
    by_noise = np.zeros((*state.shape, 2))
    by_noise[..., 0, 0], by_noise[..., 1, 0], by_noise[..., 2, 0] = -0.5 * north_m, 0.5 * east_m, 1.0
    by_noise[..., 0, 1], by_noise[..., 1, 1] = east_m, north_m
    return Moved(moved, by_state, by_noise)


def _running(step: Array) -> Array:
    """Return sums of none, one, two, ... steps, [..., m + 1]."""
    total = np.zeros((*step.shape[:-1], step.shape[-1] + 1))
    np.cumsum(step, axis=-1, out=total[..., 1:])
    return total


def _chord(turn_rad: Array) -> Array:
    """Return the length of a chord as a share of its arc."""
    return np.asarray(np.sinc(turn_rad / (2 * np.pi)))
