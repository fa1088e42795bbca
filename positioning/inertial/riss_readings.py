"""What one gyroscope and an odometer of a vehicle read: checked, averaged, calibrated at rest, cut at epochs.

See Atia et al., section 2. A reading holds from half way to the one before until half way to the one after.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError, Reason, refusal
from positioning.model import Array, Recording

REST_SPEED_M_PER_S = 0.01
"""An odometer that reads more than this moves; assumed."""
LEAST_REST_S = 1.0
"""The gyroscope is calibrated at a first rest of at least this; assumed."""
MOST_OUTSIDE_S = 1.0
"""The first and the last reading are held for at most this, before and after; assumed."""
MOST_DROPPED_S = 2.0
"""A drop-out of the odometer is bridged for at most this; assumed."""


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
    refuse(
        "recording.gyro_rad_per_s",
        there & ~np.isfinite(gyro),
        "the turn rate is not a finite number",
        "Leave the reading out",
    )
    refuse(
        "recording.odometer_m_per_s",
        there & np.isinf(odometer),
        "the speed is infinite",
        "Use NaN for a drop-out",
    )
    return time_s, gyro, np.where(there, odometer, np.nan), length


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
    refuse(
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


def refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    """Refuse an array, naming the first value that is bad.

    Parameters
    ----------
    name
        Of the array.
    bad
        Which values are refused, of any shape.
    limit, cure
        What is wrong, and what helps.

    Raises
    ------
    InputError
        Where there is one.
    """
    if bad.any():
        where = ", ".join(str(i) for i in np.argwhere(bad)[0])
        raise InputError(f"{name}[{where}]", limit, cure)


def _check_times(name: str, time_s: Array, recordings: int, least: int) -> NDArray[np.intp]:
    """Return the number of times of each recording, [r], if they can be used."""
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
    refuse(name, behind & there | ~behind & ~there, "a time before is missing", "Use NaN after the end only")
    refuse(name, np.isinf(time_s), "the time is infinite", "Give seconds")
    with np.errstate(invalid="ignore"):
        stuck = np.diff(time_s, axis=1, prepend=-np.inf) <= 0
    refuse(name, stuck, "time does not increase", "Sort by time and leave out repeated times")
    return np.asarray(length, dtype=np.intp)


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
    """Return speeds [r, m] with the last one in place of each drop-out, and zero before the first."""
    there = ~np.isnan(odometer_m_per_s)
    last = np.maximum.accumulate(np.where(there, np.arange(there.shape[1]), -1), axis=1)
    return np.where(last < 0, 0.0, np.take_along_axis(odometer_m_per_s, np.maximum(last, 0), axis=1))
