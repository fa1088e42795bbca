"""Reduced inertial sensor system: where one gyroscope and an odometer say that a vehicle went.

See Atia et al., section 2. A reading holds from half way to the one before until half way to the one after;
with constant rates in between, a vehicle runs on a circle, which is integrated exactly. The sum over
readings is therefore of second order, and the angle is the same at 100 Hz and after averaging to 50 Hz.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError, Reason, refusal
from positioning.inertial.earth import EARTH_RATE_RAD_PER_S, meridian_radius_m, normal_radius_m
from positioning.model import Array, Recording

REST_SPEED_M_PER_S = 0.01
"""An odometer that reads more than this moves; assumed."""
LEAST_REST_S = 1.0
"""The gyroscope is calibrated at a first rest of at least this; assumed."""
MOST_OUTSIDE_S = 1.0
"""The first and the last reading are held for at most this, before and after; assumed."""
MOST_DROPPED_S = 2.0
"""A drop-out of the odometer is bridged for at most this; assumed."""

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


class Rest(NamedTuple):
    """The rest before a vehicle first moves, each [r].

    Attributes
    ----------
    gyro_rad_per_s
        Mean reading: bias and vertical earth rate together; zero where there is no rest.
    duration_s
        Zero where there is no rest.
    end_s
        When it ends, on the clock of the readings; minus infinity where there is no rest.
    """

    gyro_rad_per_s: Array
    duration_s: Array
    end_s: Array


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


class Readings(NamedTuple):
    """Readings with the times between which each holds, cut at the epochs as well.

    Attributes
    ----------
    edge_s
        [r, c + 1], not decreasing; the last one repeated after the end.
    gyro_rad_per_s, speed_m_per_s
        [r, c]; drop-outs of the odometer are bridged.
    epoch
        Number of the edge of each epoch, [r, n]; of no meaning after the end of a recording.
    """

    edge_s: Array
    gyro_rad_per_s: Array
    speed_m_per_s: Array
    epoch: NDArray[np.intp]


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
    _refuse("edge_s", unordered, "the time decreases or is missing after it", "Sort by time, without NaN")
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


def downsample(recording: Recording, *, factor: int = 2) -> Recording:
    """Replace neighbouring readings of the motion by their mean.

    See Atia et al., section 6.3. Drop-outs of the odometer do not count; a group that is not full at the
    end is left out.

    Parameters
    ----------
    recording
        Stack with ``motion_time_s``, ``gyro_rad_per_s`` and ``odometer_m_per_s``, each [r, m]; of a single
        recording `positioning.filters.plane.with_leading_axis` makes one.
    factor
        Size of the groups.

    Raises
    ------
    InputError
        For a factor that is not a whole number from 1, fewer than two groups, or readings that
        `check_motion` refuses.
    """
    time_s, gyro, odometer, length = check_motion(recording)
    if factor != int(factor) or factor < 1:
        raise InputError(f"factor={factor}", "it is not a whole number from 1", "Correct it")
    if factor == 1:
        return recording
    if (length < 2 * factor).any():
        raise InputError(
            f"recording.motion_time_s[{int(np.argmin(length))}]",
            f"{int(length.min())} readings make fewer than two groups of {factor}",
            "Lower the factor, or leave the recording out",
        )
    step, count = int(factor), time_s.shape[1] // int(factor)

    def total(values: Array) -> Array:
        parts = [values[:, first : count * step : step] for first in range(step)]
        return np.asarray(sum(parts[1:], start=parts[0]))

    heard = total(np.where(np.isnan(odometer), 0.0, 1.0))
    with np.errstate(invalid="ignore"):
        speed = total(np.nan_to_num(odometer)) / heard
    ended = np.isnan(total(time_s))
    return replace(
        recording,
        motion_time_s=total(time_s) / step,
        gyro_rad_per_s=np.where(ended, np.nan, total(gyro) / step),
        odometer_m_per_s=np.where(ended, np.nan, speed),
    )


def first_rest(recording: Recording) -> Rest:
    """Find the rest before each vehicle of a stack first moves, and what the gyroscope reads in it.

    See Atia et al., section 2, eq. 1; the calibration at rest is not in the paper. A drop-out of the
    odometer neither ends a rest nor counts in the mean. A rest of less than ``LEAST_REST_S`` is none.

    Parameters
    ----------
    recording
        Stack with readings of the motion [r, m]; of a single recording
        `positioning.filters.plane.with_leading_axis` makes one.

    Raises
    ------
    InputError
        For readings that `check_motion` refuses.
    """
    time_s, gyro, odometer, length = check_motion(recording)
    rows, edge_s = np.arange(len(time_s)), _edges(time_s, length)
    with np.errstate(invalid="ignore"):
        moves = np.abs(odometer) > REST_SPEED_M_PER_S
    end = np.where(moves.any(axis=1), np.argmax(moves, axis=1), length)
    before = np.arange(time_s.shape[1]) < end[:, None]
    counts = before & ~np.isnan(odometer)
    # Running sums add one after the other: a stack gives what each recording gives.
    number = np.count_nonzero(counts, axis=1)
    mean = np.cumsum(np.where(counts, gyro, 0.0), axis=1)[:, -1] / np.maximum(number, 1)
    duration_s = edge_s[rows, end] - edge_s[rows, 0]
    rests = (duration_s >= LEAST_REST_S) & (number > 0)
    return Rest(
        np.where(rests, mean, 0.0),
        np.where(rests, duration_s, 0.0),
        np.where(rests, edge_s[rows, end], -np.inf),
    )


def readings(recording: Recording) -> Readings:
    """Return what the sensors read between the epochs of a stack, as they read it.

    See Atia et al., section 2. Drop-outs of the odometer are bridged by the last speed, and by zero before
    the first, for at most ``MOST_DROPPED_S``.

    Parameters
    ----------
    recording
        Stack with epochs [r, n] and readings of the motion [r, m].

    Raises
    ------
    InputError
        For readings that `check_motion` refuses, epochs that are missing in between or do not increase,
        or epochs more than ``MOST_OUTSIDE_S`` outside the readings.
    """
    time_s, gyro, odometer, length = check_motion(recording)
    epoch_s = np.asarray(recording.time_s, dtype=np.float64)
    _check_times("recording.time_s", epoch_s, len(time_s), least=1)
    edge_s = _edges(time_s, length)
    rows = np.arange(len(time_s))
    first_s, last_s = edge_s[:, :1], edge_s[rows, length][:, None]
    with np.errstate(invalid="ignore"):
        outside = (epoch_s < first_s - MOST_OUTSIDE_S) | (epoch_s > last_s + MOST_OUTSIDE_S)
    _refuse(
        "recording.time_s",
        outside,
        f"it is more than {MOST_OUTSIDE_S:g} s outside the readings of gyroscope and odometer",
        "Give epochs and readings one clock, and leave out epochs without readings",
    )
    cut_s = np.concatenate([edge_s, epoch_s], axis=1)
    # Two increasing rows are merged; NaN goes to the end, and an edge before the epoch of its time.
    order = np.argsort(cut_s, axis=1, kind="stable")
    cut_s = np.take_along_axis(cut_s, order, axis=1)
    is_edge = order < edge_s.shape[1]
    reading = np.clip(np.cumsum(is_edge, axis=1)[:, :-1] - 1, 0, length[:, None] - 1)
    return Readings(
        np.fmax.accumulate(cut_s, axis=1),
        np.take_along_axis(gyro, reading, axis=1),
        np.take_along_axis(_bridged(odometer), reading, axis=1),
        np.nonzero(~is_edge)[1].reshape(epoch_s.shape),
    )


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


def motion_missing(recording: Recording) -> str:
    """Say which readings of the motion a recording lacks; empty where it has all.

    See Atia et al., section 2.

    Parameters
    ----------
    recording
        With readings of the motion [..., m]. An odometer without any reading lacks, and one that has
        dropped out for more than ``MOST_DROPPED_S``.
    """
    names = ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    missing = [name for name in names if getattr(recording, name) is None]
    if missing:
        return Reason(
            f"there are no readings of the motion ({', '.join(missing)})", f"Give {', '.join(names)}"
        )
    time_s, odometer = (np.asarray(getattr(recording, name), dtype=np.float64) for name in names[::2])
    if odometer.shape != time_s.shape or not odometer.size:
        return ""
    asked = ~np.isnan(time_s)
    if (asked.any(axis=-1) & ~(asked & ~np.isnan(odometer)).any(axis=-1)).any():
        return Reason("the odometer has no reading", "Give odometer_m_per_s, NaN for drop-outs only")
    dropped_s = _longest_drop_out_s(time_s, odometer)
    if dropped_s <= MOST_DROPPED_S * (1 + 1e-9):
        return ""
    return Reason(
        f"the odometer has dropped out for {dropped_s:.3g} s, more than {MOST_DROPPED_S:g} s",
        "Fill odometer_m_per_s from another source, or cut the recording there",
    )


def check_motion(recording: Recording) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Return times, turn rates and speeds [r, m] of a stack, and the number of readings of each [r].

    Raises
    ------
    InputError
        For readings that are missing (see `motion_missing`) or do not fit each other, fewer than two of them,
        times that are infinite, missing in between, repeated or decreasing, or readings that are not finite
        (but for drop-outs of the odometer, NaN).
    """
    if reason := motion_missing(recording):
        raise refusal("recording", reason)
    time_s, gyro, odometer = (
        np.asarray(getattr(recording, name), dtype=np.float64)
        for name in ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    )
    for name, values in (("gyro_rad_per_s", gyro), ("odometer_m_per_s", odometer)):
        if values.shape != time_s.shape:
            raise InputError(
                f"recording.{name}",
                f"its shape is {values.shape}, not {time_s.shape}",
                "Give one reading a time",
            )
    length = _check_times("recording.motion_time_s", time_s, np.shape(recording.time_s)[0], least=2)
    there = ~np.isnan(time_s)
    _refuse(
        "recording.gyro_rad_per_s",
        there & ~np.isfinite(gyro),
        "the turn rate is not a finite number",
        "Leave the reading out",
    )
    _refuse(
        "recording.odometer_m_per_s",
        there & np.isinf(odometer),
        "the speed is infinite",
        "Use NaN for a drop-out",
    )
    return time_s, gyro, np.where(there, odometer, np.nan), length


def _check_times(name: str, time_s: Array, recordings: int, least: int) -> NDArray[np.intp]:
    if time_s.ndim != 2 or len(time_s) != recordings:
        raise InputError(
            name,
            f"its shape is {time_s.shape}, not ({recordings if time_s.ndim == 2 else 'recordings'}, any)",
            "Give one row a recording; positioning.filters.plane.with_leading_axis makes a stack of one",
        )
    there = ~np.isnan(time_s)
    length = np.count_nonzero(there, axis=1)
    if (length < least).any():
        raise InputError(
            f"{name}[{int(np.argmin(length))}]",
            f"{int(length.min())} of them, at least {least} are needed",
            "Leave the recording out",
        )
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    _refuse(name, behind & there | ~behind & ~there, "a time before is missing", "Use NaN after the end only")
    _refuse(name, np.isinf(time_s), "the time is infinite", "Give seconds")
    with np.errstate(invalid="ignore"):
        stuck = np.diff(time_s, axis=1, prepend=-np.inf) <= 0
    _refuse(name, stuck, "time does not increase", "Sort by time and leave out repeated times")
    return np.asarray(length, dtype=np.intp)


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    if bad.any():
        where = ", ".join(str(i) for i in np.argwhere(bad)[0])
        raise InputError(f"{name}[{where}]", limit, cure)


def _edges(time_s: Array, length: NDArray[np.intp]) -> Array:
    """Return the times half way between readings, [r, m + 1], with one more at both ends; NaN behind."""
    rows = np.arange(len(time_s))
    half_s = 0.5 * np.diff(time_s, axis=1)
    edge_s = np.concatenate([time_s[:, :1] - half_s[:, :1], time_s[:, :-1] + half_s, time_s[:, :1]], axis=1)
    edge_s[rows, length] = time_s[rows, length - 1] + half_s[rows, length - 2]
    edge_s[np.arange(edge_s.shape[1]) > length[:, None]] = np.nan
    return edge_s


def _longest_drop_out_s(time_s: Array, odometer_m_per_s: Array) -> float:
    """Return how long the odometer of any recording [..., m] was away at a stretch, seconds."""
    times_s, speed = time_s.reshape(-1, time_s.shape[-1]), odometer_m_per_s.reshape(-1, time_s.shape[-1])
    behind = np.isnan(times_s)
    length = np.count_nonzero(~behind, axis=1)
    dropped = np.isnan(speed) & ~behind
    # Times that are wrong are told by `check_motion`.
    if not dropped.any() or (length < 2).any() or behind[np.arange(behind.shape[1]) < length[:, None]].any():
        return 0.0
    edge_s = _edges(times_s, length)
    last = np.maximum.accumulate(np.where(dropped, -1, np.arange(dropped.shape[1])), axis=1)
    away_s = edge_s[:, 1:] - np.take_along_axis(edge_s, last + 1, axis=1)
    return float(away_s[dropped].max())


def _bridged(odometer_m_per_s: Array) -> Array:
    there = ~np.isnan(odometer_m_per_s)
    last = np.maximum.accumulate(np.where(there, np.arange(there.shape[1]), -1), axis=1)
    return np.where(last < 0, 0.0, np.take_along_axis(odometer_m_per_s, np.maximum(last, 0), axis=1))


def _running(step: Array) -> Array:
    """Return sums of none, one, two, ... steps, [..., m + 1]."""
    total = np.zeros((*step.shape[:-1], step.shape[-1] + 1))
    np.cumsum(step, axis=-1, out=total[..., 1:])
    return total


def _chord(turn_rad: Array) -> Array:
    """Return the length of a chord as a share of its arc."""
    return np.asarray(np.sinc(turn_rad / (2 * np.pi)))
