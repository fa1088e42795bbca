"""What the navigation of a foot refuses: arrays, times, units and readings that it cannot use."""

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.rest import spans
from positioning.inertial.strapdown import GRAVITY_M_PER_S2
from positioning.model import Array, Recording

MOST_GAP_S = 0.1
"""A longer gap between readings is refused: a swinging foot turns by half a radian in it; assumed."""
MOST_RATE_RAD_PER_S = 50.0
"""Above the range of any such gyroscope (2000 degrees a second): readings beyond are not radians."""
FORCE_AT_REST_M_PER_S2 = (8.0, 12.0)
"""Where the mean specific force of a foot at rest lies, with the bias of any working unit; assumed."""
USUAL_FORCE_M_PER_S2 = (5.0, 40.0)
"""Where the median of a walk, or a run, lies; assumed."""
SATURATED_SAMPLES = 5
"""So many equal readings in a row, at an extreme of an axis, are a sensor at its limit; assumed."""
LEAST_SATURATED = {"specific_force_m_per_s2": 15.0, "angular_rate_rad_per_s": 4.0}
"""No unit saturates below these, unless it does so again and again: see ``LEAST_OFF_REST``."""
LEAST_OFF_REST = {"specific_force_m_per_s2": 2.0, "angular_rate_rad_per_s": 0.5}
"""An extreme that is nearer to the axis' median is that of an axis at rest, which may well read the same."""
LEAST_FLAT_RUNS = 2
"""Below ``LEAST_SATURATED`` a sensor is at its limit if it stays there so many times."""
QUIET_SHARE = 0.25
"""The share of readings with the least angular rate, in which a foot stands and the accelerometer reads
gravity alone."""
LEAST_LEFT_AT_REST = 0.1
"""Gravity is a larger share of the greatest readings of a walk, or a run; assumed."""


def check_imu(recording: Recording) -> NDArray[np.intp]:
    """Return the number of readings of each recording of a stack, if they can be used.

    Parameters
    ----------
    recording
        With ``imu_time_s`` [r, i], ``specific_force_m_per_s2`` and ``angular_rate_rad_per_s`` [r, i, 3], and
        maybe ``magnetic_field_ut`` [r, i, 3].

    Returns
    -------
    NDArray
        [r].

    Raises
    ------
    InputError
        For arrays that are missing or do not fit each other; times that are infinite, missing in between,
        repeated or decreasing, or leave a gap; readings that are not finite, stuck at a limit, or in degrees.
    """
    if reason := imu_missing(recording):
        raise InputError("recording", reason, "Give all three")
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.shape[1] < 2:
        raise InputError(
            "recording.imu_time_s", f"its shape is {time_s.shape}, not [r, i]", "Give two readings or more"
        )
    there = ~np.isnan(time_s)
    length = np.count_nonzero(there, axis=1)
    refuse("imu_time_s", length[:, None] < 2, "the recording has fewer than two readings", "Leave it out")
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    refuse("imu_time_s", behind & there, "a time before is missing", "Use NaN after the end only")
    refuse("imu_time_s", np.isinf(time_s), "the time is infinite", "Give seconds")
    step_s = np.diff(time_s, axis=1)
    with np.errstate(invalid="ignore"):
        refuse("imu_time_s", step_s <= 0, "time does not increase after it", "Sort, and leave out repeats")
        refuse(
            "imu_time_s",
            step_s > MOST_GAP_S,
            f"no reading for more than {MOST_GAP_S} s after it",
            "Cut the recording there, or fill the gap; check that times are in seconds",
        )
    for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s", "magnetic_field_ut"):
        values = getattr(recording, name)
        if values is None:
            continue
        if np.shape(values) != (*time_s.shape, 3):
            raise InputError(
                f"recording.{name}",
                f"its shape is {np.shape(values)}, not {(*time_s.shape, 3)}",
                "Give three parts a reading",
            )
        # One recording at a time: the arrays of a stack are large.
        for row, count in enumerate(length):
            part = np.asarray(values[row, :count], dtype=np.float64)
            if name == "magnetic_field_ut":
                refuse(name, np.isinf(part), "the field is infinite", "Use NaN for none", row)
                continue
            refuse(
                name, ~np.isfinite(part), "the reading is not a finite number", "Leave it out or fill it", row
            )
            _refuse_limits(name, part, row)
    return np.asarray(length, dtype=np.intp)


def imu_missing(recording: Recording) -> str:
    """Say which inertial readings a recording lacks; empty where it has all."""
    names = ("imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s")
    missing = [name for name in names if getattr(recording, name) is None]
    return f"there are no inertial readings ({', '.join(missing)})" if missing else ""


def sample_rate_hz(recording: Recording) -> Array:
    """Return the readings a second of each recording of a stack, [r], by the median interval."""
    return np.asarray(
        1.0 / np.nanmedian(np.diff(np.asarray(recording.imu_time_s, np.float64), axis=1), axis=1)
    )


def check_clocks(recording: Recording, length: NDArray[np.intp]) -> None:
    """Refuse epochs that all lie before or behind the readings, by more than one of them may last.

    Parameters
    ----------
    recording
        Stack that `check_imu` does not refuse, with epochs [r, n].
    length
        Number of its readings, [r].

    Raises
    ------
    InputError
        Naming the first such recording.
    """
    assert recording.imu_time_s is not None
    for row, count in enumerate(length):
        own_s = recording.imu_time_s[row, :count]
        epoch_s = np.asarray(recording.time_s[row], dtype=np.float64)
        epoch_s = epoch_s[np.isfinite(epoch_s)]
        if not len(epoch_s):
            continue
        if epoch_s.min() > own_s[-1] + MOST_GAP_S or epoch_s.max() < own_s[0] - MOST_GAP_S:
            raise InputError(
                f"recording.time_s[{row}]",
                f"the epochs are from {epoch_s.min():.1f} to {epoch_s.max():.1f} s, the inertial readings"
                f" from {own_s[0]:.1f} to {own_s[-1]:.1f} s",
                "Give both on one clock",
            )


def check_force_units(recording: Recording, length: NDArray[np.intp]) -> None:
    """Refuse a specific force that is not in m/s^2, or that lacks gravity.

    Parameters
    ----------
    recording
        Stack that `check_imu` does not refuse.
    length
        Number of its readings, [r].

    Raises
    ------
    InputError
        Naming the first such recording.
    """
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    low, high = USUAL_FORCE_M_PER_S2
    for row, count in enumerate(length):
        force = np.asarray(recording.specific_force_m_per_s2[row, :count], dtype=np.float64)
        rate = np.asarray(recording.angular_rate_rad_per_s[row, :count], dtype=np.float64)
        magnitude, turning = np.linalg.norm(force, axis=-1), np.linalg.norm(rate, axis=-1)
        quiet = float(np.median(magnitude[turning <= np.quantile(turning, QUIET_SHARE)]))
        usual = float(np.median(magnitude))
        if low <= usual <= high and quiet >= low:
            continue
        limit, cure = "gravity is 9.8 m/s^2", "Check units and calibration"
        for unit, scale in (("g", GRAVITY_M_PER_S2), ("mg", GRAVITY_M_PER_S2 / 1000)):
            if FORCE_AT_REST_M_PER_S2[0] <= quiet * scale <= FORCE_AT_REST_M_PER_S2[1]:
                limit, cure = f"that is gravity in {unit}, not in m/s^2", f"Multiply by {scale}"
        # Without gravity a walk has any median, also that of a walk in g; but what is left where the foot
        # stands is next to nothing beside a swing, in any unit.
        if quiet < LEAST_LEFT_AT_REST * float(np.quantile(magnitude, 0.99)):
            limit = f"it is {quiet:.3g} where the foot stands: gravity has been taken off"
            cure = "Give what the accelerometer reads, with gravity in it"
        raise InputError(
            f"recording.specific_force_m_per_s2[{row}]", f"its median magnitude is {usual:.3g}; {limit}", cure
        )


def refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str, row: int | None = None) -> None:
    """Refuse readings of ``recording.<name>``, naming the first of them.

    Parameters
    ----------
    name
        Field of the recording.
    bad
        Which readings are refused, of any shape.
    limit, cure
        What is wrong, and what helps.
    row
        Number of the recording of the stack that ``bad`` is of, None for a whole stack.

    Raises
    ------
    InputError
        Where there is one.
    """
    if bad.any():
        where = [int(i) for i in np.argwhere(bad)[0]]
        place = ", ".join(str(i) for i in ([] if row is None else [row]) + where)
        raise InputError(f"recording.{name}[{place}]", limit, cure)


def _refuse_limits(name: str, values: Array, row: int) -> None:
    """Refuse readings [i, 3] of a recording that are in degrees, or stay at the limit of the sensor."""
    if name == "angular_rate_rad_per_s" and (np.abs(values) > MOST_RATE_RAD_PER_S).any():
        raise InputError(
            f"recording.{name}[{row}]",
            f"its greatest is {np.abs(values).max():.0f}, above {MOST_RATE_RAD_PER_S:.0f} rad/s",
            "These look like degrees a second: multiply by pi / 180",
        )
    for axis in range(3):
        part = values[:, axis]
        for extreme in (part.min(), part.max()):
            at_extreme = part == extreme
            # A look at the few readings there is cheaper than runs of all.
            if np.count_nonzero(at_extreme) < SATURATED_SAMPLES:
                continue
            stuck = spans(at_extreme[None])[0]
            flat = stuck[stuck[:, 1] - stuck[:, 0] >= SATURATED_SAMPLES]
            if not len(flat):
                continue
            off_rest = abs(extreme - np.median(part)) >= LEAST_OFF_REST[name]
            if abs(extreme) < LEAST_SATURATED[name] and not (off_rest and len(flat) >= LEAST_FLAT_RUNS):
                continue
            raise InputError(
                f"recording.{name}[{row}, {int(flat[0, 0])}, {axis}]",
                f"it stays at its extreme, {extreme:.4g}, for {int(flat[0, 1] - flat[0, 0])} readings: the"
                " sensor is at its limit",
                "Use a unit with a wider range, or cut the recording there",
            )
