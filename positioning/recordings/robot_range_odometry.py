"""Robots with odometry and radio ranges to fixed beacons: a mower outdoors, a small robot in a labyrinth.

``plaza1`` was measured by J. Djugash and S. Singh (Carnegie Mellon University), ``labyrinth`` by
T. Pfeifer (TU Chemnitz).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Recording, Site, Truth, Worlds
from positioning.recordings.mat_file import read_mat
from positioning.recordings.register import find_file, unreadable

NAMES = ("plaza1", "labyrinth")

PLAZA = "Plaza1.mat"
PLAZA_COLUMNS = {"GT": 4, "DR": 3, "TL": 3, "TD": 4}
"""Arrays of the Plaza file and their columns: true poses, odometry, beacons, ranges."""

LABYRINTH = "labyrinth_Indoor_UWB_Input.txt"
LABYRINTH_TRUTH = "labyrinth_Indoor_UWB_GT.txt"
LABYRINTH_NUMBERS = {"range2": 7, "odom2diff": 8, "point2": 7}
"""Kinds of lines of the labyrinth's files, and how many numbers follow the kind."""


class _Run(NamedTuple):
    """What either file holds, on one clock.

    ``step_*`` are increments of the odometry between its times ``odometry_time_s``, one fewer than those.
    """

    beacon_m: Array
    range_time_s: Array
    beacon: NDArray[np.intp]
    range_m: Array
    odometry_time_s: Array
    step_turn_rad: Array
    step_forward_m: Array
    motion_time_s: Array
    gyro_rad_per_s: Array
    odometer_m_per_s: Array
    truth_time_s: Array
    truth_m: Array
    heading_rad: Array | None


def load(
    folder: str | Path, *, name: str = "plaza1", window_s: float = 1.0, offset_from_first_s: float = 0.0
) -> Worlds:
    """Load one run of a robot: ranges, odometry, and where it truly was.

    An epoch is a window in which any beacon answered. A beacon's ranges in a window are averaged, and the
    epoch's time is the mean of the times of all of them; the beacons answer one after the other, so the
    robot drives on between the ranges of an epoch (mean speeds 1 and 0.3 m/s). True places are those of the
    recorded poses, linearly interpolated to the epochs' times (poses every 0.2 and 0.13 s). Ranges outside
    the time of the poses are left out.

    The motion between epochs is the odometry, summed up: each increment is driven straight on along the
    mean of the headings at its ends, and the sum is interpolated linearly to the epochs' times. The turn
    before points to the next epoch's place, and the turn after to its heading; where the robot drives
    backwards the advance is negative. The readings of gyroscope and odometer are the same increments
    divided by their duration, at its middle (``plaza1``), or the rates as the file has them
    (``labyrinth``).

    Plaza ranges are too long: by 2.8 m on the mean, which is 7 % of the distance. ``offset_from_first_s``
    finds the mean error of the ranges of a first part from its true places, takes it off all others, and
    leaves the first part out of the epochs; the motion stays whole. What rises with the distance stays:
    about 1.1 m of scatter. Two stretches of the file's ranges stand behind later ones; they come to the
    epochs of their own times. The turns of the odometry are the differences of the true headings, to the
    last digit: a drift of the heading cannot be studied here, and ``truth.heading_rad`` is not given.

    The labyrinth's wheel speeds are left and right in this order, and the length in the file is half the
    distance between the wheels, as in the publisher's own motion model: only so do turns agree with the
    path. The robot's heading was not noted.

    Parameters
    ----------
    folder
        The folder of the files.
    name
        ``plaza1`` or ``labyrinth``.
    window_s
        Length of a window, seconds. Ranges come every 0.25 s (``plaza1``) and 0.13 s (``labyrinth``), so
        below 0.1 s nearly each is an epoch of its own.
    offset_from_first_s
        Length of the first part, seconds from the first pose; 0 leaves the ranges as they are.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the beacons, which the path of ``plaza1``
        leaves by 1.6 m, ``site.access_point_m`` [1, 4, 2] in the order of the beacons' numbers,
        ``recording.time_s`` [1, n] from the first pose, ``recording.range_m`` [1, n, 4], NaN where a beacon
        did not answer, ``recording.turn_before_rad``, ``advance_m`` and ``turn_after_rad`` [1, n],
        ``recording.motion_time_s``, ``gyro_rad_per_s`` and ``odometer_m_per_s`` [1, m],
        ``recording.start_heading_rad`` [1] (NaN for ``labyrinth``) and ``start_position_m`` [1, 2] at the
        first epoch, and as truth ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, 4].

    Raises
    ------
    InputError
        For an option out of its limits, a first part without ranges or with all of them, or a file that is
        missing or is not this data set's.
    """
    _check_options(name, window_s, offset_from_first_s)
    run = _plaza(folder) if name == "plaza1" else _labyrinth(folder)
    within = (run.range_time_s >= run.truth_time_s[0]) & (run.range_time_s <= run.truth_time_s[-1])
    time_s, beacon, range_m = run.range_time_s[within], run.beacon[within], run.range_m[within]

    first = time_s < offset_from_first_s
    if first.all() or (offset_from_first_s > 0 and not first.any()):
        raise InputError(
            "robot_range_odometry, option offset_from_first_s",
            f"the first {offset_from_first_s} s hold {np.count_nonzero(first)} of {len(time_s)} ranges",
            "Choose a first part with some of the ranges, or 0",
        )
    if first.any():
        place_m = interpolate(time_s[first], run.truth_time_s, run.truth_m)
        true_m = np.linalg.norm(place_m - run.beacon_m[beacon[first]], axis=-1)
        range_m = range_m - np.mean(range_m[first] - true_m)
        time_s, beacon, range_m = time_s[~first], beacon[~first], range_m[~first]

    window = np.unique((time_s - offset_from_first_s) // window_s, return_inverse=True)[1]
    epoch_s = np.bincount(window, time_s) / np.bincount(window)
    epoch_range_m = _mean_of_cells(window, beacon, range_m, (len(epoch_s), len(run.beacon_m)))
    turn_before_rad, advance_m, turn_after_rad = motion_between(
        epoch_s, run.odometry_time_s, run.step_turn_rad, run.step_forward_m
    )
    position_m = interpolate(epoch_s, run.truth_time_s, run.truth_m)
    heading_rad = np.nan
    if run.heading_rad is not None:
        heading_rad = float(np.interp(epoch_s[0], run.truth_time_s, np.unwrap(run.heading_rad)))

    site = Site(
        corner_m=np.stack([run.beacon_m.min(axis=0), run.beacon_m.max(axis=0)])[None],
        access_point_m=run.beacon_m[None],
    )
    recording = Recording(
        time_s=epoch_s[None],
        range_m=epoch_range_m[None],
        turn_before_rad=turn_before_rad[None],
        advance_m=advance_m[None],
        turn_after_rad=turn_after_rad[None],
        start_heading_rad=np.array([heading_rad]),
        start_position_m=position_m[:1],
        motion_time_s=run.motion_time_s[None],
        gyro_rad_per_s=run.gyro_rad_per_s[None],
        odometer_m_per_s=run.odometer_m_per_s[None],
    )
    truth = Truth(position_m=position_m[None], distance_m=pairwise_distance_m(position_m, run.beacon_m)[None])
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())


def motion_between(
    epoch_s: Array, odometry_time_s: Array, step_turn_rad: Array, step_forward_m: Array
) -> tuple[Array, Array, Array]:
    """Return the motion between epochs as a turn, a straight line and a second turn.

    Parameters
    ----------
    epoch_s
        Times of the epochs, [n], seconds.
    odometry_time_s
        Times of the odometry, [k], seconds, increasing.
    step_turn_rad, step_forward_m
        What it turned and drove from each of these times to the next, [k - 1], radians and metres. The step
        leads along the mean of the headings at its ends. Before and after these times the robot stands.

    Returns
    -------
    tuple of Array
        Turn before, radians from -pi/2 to pi/2, advance, metres, negative where it went backwards, and turn
        after, radians, not wrapped, each [n]; zero at the first epoch.
    """
    heading_rad = np.concatenate([[0.0], np.cumsum(step_turn_rad)])
    course_rad = (heading_rad[1:] + heading_rad[:-1]) / 2
    step_m = step_forward_m[:, None] * np.stack([np.cos(course_rad), np.sin(course_rad)], axis=-1)
    place_m = interpolate(
        epoch_s, odometry_time_s, np.concatenate([np.zeros((1, 2)), np.cumsum(step_m, axis=0)])
    )
    epoch_heading_rad = np.interp(epoch_s, odometry_time_s, heading_rad)

    way_m, before = np.diff(place_m, axis=0), epoch_heading_rad[:-1]
    forward_m = way_m[:, 0] * np.cos(before) + way_m[:, 1] * np.sin(before)
    left_m = way_m[:, 1] * np.cos(before) - way_m[:, 0] * np.sin(before)
    # A robot that drives backwards does not turn round for it.
    sign = np.where(forward_m < 0, -1.0, 1.0)
    turn_before_rad = np.arctan2(sign * left_m, np.abs(forward_m))
    turn_after_rad = np.diff(epoch_heading_rad) - turn_before_rad
    advance_m = sign * np.hypot(forward_m, left_m)
    motion = (np.concatenate([[0.0], part]) for part in (turn_before_rad, advance_m, turn_after_rad))
    return next(motion), next(motion), next(motion)


def interpolate(time_s: Array, known_s: Array, known_m: Array) -> Array:
    """Return places at times, [n, 2], linearly between those known, [k] and [k, 2]; seconds and metres."""
    return np.stack([np.interp(time_s, known_s, known_m[:, axis]) for axis in range(2)], axis=-1)


def _mean_of_cells(
    row: NDArray[np.intp], column: NDArray[np.intp], values: Array, shape: tuple[int, int]
) -> Array:
    """Return the means of values that share a cell of a table, NaN where a cell has none."""
    cell = row * shape[1] + column
    count = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    total = np.bincount(cell, values, minlength=shape[0] * shape[1]).reshape(shape)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _plaza(folder: str | Path) -> _Run:
    path = find_file(folder, PLAZA)
    try:
        content = read_mat(path)
        arrays = {key: np.asarray(content[key], dtype=float) for key in PLAZA_COLUMNS}
        for key, columns in PLAZA_COLUMNS.items():
            values = arrays[key]
            if values.ndim != 2 or values.shape[1] != columns or not len(values):
                raise ValueError(f"{key} has the shape {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"a value of {key} is not finite")
        pose, odometry, beacon, measured = (arrays[key] for key in PLAZA_COLUMNS)
        if len(odometry) != len(pose) - 1 or (odometry[:, 0] != pose[1:, 0]).any():
            raise ValueError("DR has not the times of GT but the first")
        if (np.diff(pose[:, 0]) <= 0).any():
            raise ValueError("the time of GT does not increase")
        beacon = beacon[np.argsort(beacon[:, 0])]
        place = {number: index for index, number in enumerate(beacon[:, 0])}
        if len(place) != len(beacon):
            raise ValueError("TL has a beacon twice")
        index = np.array([place.get(number, -1) for number in measured[:, 2]])
        if (index < 0).any():
            raise ValueError("TD has a beacon that TL has not")
    except (ValueError, TypeError, LookupError) as error:
        what = f"the arrays {', '.join(PLAZA_COLUMNS)}"
        raise unreadable("robot_range_odometry", PLAZA, what, error) from error
    time_s = pose[:, 0] - pose[0, 0]
    duration_s = np.diff(time_s)
    return _Run(
        beacon_m=beacon[:, 1:],
        range_time_s=measured[:, 0] - pose[0, 0],
        beacon=index,
        range_m=measured[:, 3],
        odometry_time_s=time_s,
        step_turn_rad=odometry[:, 2],
        step_forward_m=odometry[:, 1],
        motion_time_s=(time_s[1:] + time_s[:-1]) / 2,
        gyro_rad_per_s=odometry[:, 2] / duration_s,
        odometer_m_per_s=odometry[:, 1] / duration_s,
        truth_time_s=time_s,
        truth_m=pose[:, 1:3],
        heading_rad=pose[:, 3],
    )


def _labyrinth(folder: str | Path) -> _Run:
    measured, wheels = _lines(folder, LABYRINTH, ("range2", "odom2diff"))
    (pose,) = _lines(folder, LABYRINTH_TRUTH, ("point2",))
    for file, times_s in ((LABYRINTH, wheels[:, 0]), (LABYRINTH_TRUTH, pose[:, 0])):
        if len(times_s) < 2 or (np.diff(times_s) <= 0).any():
            raise unreadable(
                "robot_range_odometry", file, "the times", "they are fewer than two, or do not increase"
            )
    _, first_row, index = np.unique(measured[:, 5], return_index=True, return_inverse=True)
    beacon_m = measured[first_row, 3:5]
    if (measured[:, 3:5] != beacon_m[index]).any():
        raise unreadable(
            "robot_range_odometry", LABYRINTH, "the places of the modules", "a module has two of them"
        )
    if (wheels[:, 4] <= 0).any():
        raise unreadable(
            "robot_range_odometry", LABYRINTH, "the distance between the wheels", "it is not positive"
        )
    time_s, start_s = wheels[:, 0] - pose[0, 0], pose[0, 0]
    # Left, right, half the distance between the wheels, whatever the file's own description says: see load.
    gyro_rad_per_s = (wheels[:, 2] - wheels[:, 1]) / (2 * wheels[:, 4])
    odometer_m_per_s = (wheels[:, 1] + wheels[:, 2]) / 2
    duration_s = np.diff(time_s)
    return _Run(
        beacon_m=beacon_m,
        range_time_s=measured[:, 0] - start_s,
        beacon=index.reshape(len(measured)),
        range_m=measured[:, 1],
        odometry_time_s=time_s,
        step_turn_rad=duration_s * (gyro_rad_per_s[1:] + gyro_rad_per_s[:-1]) / 2,
        step_forward_m=duration_s * (odometer_m_per_s[1:] + odometer_m_per_s[:-1]) / 2,
        motion_time_s=time_s,
        gyro_rad_per_s=gyro_rad_per_s,
        odometer_m_per_s=odometer_m_per_s,
        truth_time_s=pose[:, 0] - start_s,
        truth_m=pose[:, 1:3],
        heading_rad=None,
    )


def _lines(folder: str | Path, file: str, kinds: tuple[str, ...]) -> list[Array]:
    """Return the numbers of the lines of each kind, [line, number]."""
    path = find_file(folder, file)
    try:
        rows: dict[str, list[list[float]]] = {kind: [] for kind in kinds}
        for line in path.read_text(encoding="utf-8").splitlines():
            if words := line.split():
                if words[0] not in rows or len(words) != 1 + LABYRINTH_NUMBERS[words[0]]:
                    raise ValueError(f"the line {line.strip()!r} is none of them")
                rows[words[0]].append([float(word) for word in words[1:]])
        found = [np.array(rows[kind]) for kind in kinds]
        if not all(values.size and np.isfinite(values).all() for values in found):
            raise ValueError("a kind has no line, or a number is not finite")
    except ValueError as error:
        raise unreadable("robot_range_odometry", file, f"lines of {' and '.join(kinds)}", error) from error
    return found


def _check_options(name: str, window_s: float, offset_from_first_s: float) -> None:
    if name not in NAMES:
        raise InputError(
            "robot_range_odometry, option name",
            f"{name!r} is none of {', '.join(NAMES)}",
            "Correct the option",
        )
    if not (np.isfinite(window_s) and window_s > 0):
        raise InputError(
            "robot_range_odometry, option window_s",
            f"{window_s} is no positive length of time",
            "Give seconds above zero",
        )
    if not (np.isfinite(offset_from_first_s) and offset_from_first_s >= 0):
        raise InputError(
            "robot_range_odometry, option offset_from_first_s",
            f"{offset_from_first_s} is no length of time",
            "Give seconds, or 0 for ranges as they are",
        )
