"""A foot that carries an inertial measurement unit through corridors, every stride measured on the floor.

Measured by M. T. Koroglu and students in four walks of 40 to 76 m.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array, Recording, Site, Truth, Worlds
from positioning.recordings.foot_imu_mocap import check_strides, runs_of, start_of
from positioning.recordings.mat_file import read_mat
from positioning.recordings.register import find_file, unreadable

WALKS = (31, 33, 34, 36)

STANDARD_GRAVITY_M_PER_S2 = 9.80665
MICROTESLA_PER_GAUSS = 100.0

SENSOR_AXES = np.array([-1.0, 1.0, -1.0])
"""Sensor to the frame of the project, axis by axis: the unit's x axis points to the heel, its z axis down."""

READINGS = ("scaledAccel", "scaledGyro", "scaledMag")
"""Specific force, g, angular rate, rad/s, and magnetic field, gauss; each has three columns."""

STILL_RAD_PER_S = 1.0
"""The foot stands where the root mean square of its angular rate is below this."""

STILL_WINDOW_READINGS = 15
"""Readings over which that is taken, 0.075 s, centred."""

LEAST_SWING_S = 0.4
"""No foot swings faster. Of two stances nearer to each other the shorter one is the middle of a swing, where
the foot's pitch turns round."""


class _Walk(NamedTuple):
    time_s: Array
    force_m_per_s2: Array
    rate_rad_per_s: Array
    field_ut: Array


def load(folder: str | Path, *, walk: int = 31, align_strides: int = 3) -> Worlds:
    """Load one walk: readings of the foot's sensors, and the place of each footprint.

    The control points have no times: the k-th one is where the foot stands after its k-th stride. They are
    paired with the stances in order, so an epoch is the last reading of a stance: in its middle a detector,
    which tells of a stance some time after it began, may not have the step to it. Stances are found from the
    gyroscope alone: its root mean square over 0.075 s is below 1 rad/s, and no swing is shorter than 0.4 s.
    The plain gate also finds the middle of some swings, once or twice a walk, and a rule on the
    accelerometer finds too few stances of the fast walk 34; this one finds one more than strides in all four
    walks, as it should, and a walk where it did not would be refused. It knows nothing of the places; window
    and threshold were chosen by these counts, which 17 of 35 pairs that were tried meet.

    Accelerations are in g and the field in gauss in the files. The unit's x axis points to the heel and its
    z axis down: both change their sign, and x is then forward along the foot to about 20 degrees. The sensor
    sits on the instep, pitched by some 35 degrees.

    The walks lie in the frame of the floor's tiles. Nobody noted how the unit stood in it: place and
    direction of the start are those of the first ``align_strides`` strides, as measured, whose control points
    are therefore not scored. In walk 33 the foot is not quite still in the first half second; in walk 34
    stances are down to 0.02 s long.

    Parameters
    ----------
    folder
        The folder of the files.
    walk
        ``31``, ``33``, ``34`` or ``36``.
    align_strides
        How many first strides serve for the alignment, at least 1.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the control points, ``recording.time_s``
        [1, n], ``recording.imu_time_s`` [1, i] from the first reading,
        ``recording.specific_force_m_per_s2``, ``recording.angular_rate_rad_per_s`` and
        ``recording.magnetic_field_ut`` [1, i, 3], ``recording.start_heading_rad`` [1] and
        ``recording.start_position_m`` [1, 2], and as truth ``truth.position_m`` [1, n, 2], NaN in the
        alignment, ``truth.path_m`` [1, n, 2], all control points, and ``truth.stance_time_s`` [1, n, 2],
        times of the first and the last reading of each stance.

    Raises
    ------
    InputError
        For an option that does not exist, more strides than there are, stances that are not one more than
        strides, or a file that is missing or is not this data set's.
    """
    if walk not in WALKS:
        raise InputError(
            "foot_imu_corridor, option walk",
            f"{walk!r} is none of {', '.join(map(str, WALKS))}",
            "Correct the option",
        )
    check_strides("foot_imu_corridor", align_strides)
    readings = _readings(folder, f"SensorConnectData_{walk}.csv")
    control_m = _control_points(folder, f"SensorConnectData_{walk}.mat")
    begin, end = stances(readings.time_s, readings.rate_rad_per_s)
    if len(begin) != len(control_m):
        raise InputError(
            f"foot_imu_corridor, file SensorConnectData_{walk}.csv",
            f"{len(begin)} stances are found, {len(control_m)} control points are to be paired with them",
            "Use the registered files of data/sources.csv",
        )
    start = start_of("foot_imu_corridor", control_m, align_strides)
    scored = np.arange(len(control_m)) > align_strides

    site = Site(corner_m=np.stack([control_m.min(axis=0), control_m.max(axis=0)])[None])
    recording = Recording(
        time_s=readings.time_s[end - 1][None],
        imu_time_s=readings.time_s[None],
        specific_force_m_per_s2=readings.force_m_per_s2[None],
        angular_rate_rad_per_s=readings.rate_rad_per_s[None],
        magnetic_field_ut=readings.field_ut[None],
        start_heading_rad=np.array([start.heading_rad]),
        start_position_m=start.position_m[None],
    )
    truth = Truth(
        position_m=np.where(scored[:, None], control_m, np.nan)[None],
        path_m=control_m[None],
        stance_time_s=np.stack([readings.time_s[begin], readings.time_s[end - 1]], axis=-1)[None],
    )
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())


def stances(time_s: Array, rate_rad_per_s: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find where the foot stands, from the gyroscope.

    Parameters
    ----------
    time_s
        Times of the readings, [i], seconds.
    rate_rad_per_s
        Angular rate, [i, 3], radians a second.

    Returns
    -------
    tuple of NDArray
        Index of the first reading of each stance, and the one behind its last, each [s].
    """
    square = np.concatenate([[0.0], np.cumsum((rate_rad_per_s**2).sum(axis=1))])
    index, half = np.arange(len(time_s)), STILL_WINDOW_READINGS // 2
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(time_s))
    mean_square = (square[high] - square[low]) / (high - low)
    found = list(zip(*runs_of(mean_square < STILL_RAD_PER_S**2), strict=True))
    position = 0
    while position + 1 < len(found):
        (begin, end), (next_begin, next_end) = found[position : position + 2]
        if time_s[next_begin] - time_s[end - 1] >= LEAST_SWING_S:
            position += 1
            continue
        del found[position if end - begin < next_end - next_begin else position + 1]
        # The one before may now be too near to what follows.
        position = max(position - 1, 0)
    pairs = np.reshape(np.array(found, dtype=np.intp), (-1, 2))
    return pairs[:, 0], pairs[:, 1]


def _readings(folder: str | Path, file: str) -> _Walk:
    path = find_file(folder, file)
    try:
        table = pd.read_csv(path, dtype=float)
        # Names carry the number of the unit in front.
        table.columns = [column.rpartition(":")[2].strip() for column in table.columns]
        columns = [f"{quantity}{axis}" for quantity in READINGS for axis in "XYZ"]
        time_s = table["Time"].to_numpy()
        values = table[columns].to_numpy()
        if len(time_s) < 2 or not (np.isfinite(time_s).all() and np.isfinite(values).all()):
            raise ValueError("there are fewer than two rows, or a cell is empty or not finite")
        if (np.diff(time_s) <= 0).any():
            raise ValueError("the time does not increase")
    except (ValueError, TypeError, LookupError) as error:
        what = f"the columns Time, {', '.join(READINGS)}"
        raise unreadable("foot_imu_corridor", file, what, error) from error
    force, rate, magnetic = (part * SENSOR_AXES for part in np.split(values, 3, axis=1))
    return _Walk(
        time_s=time_s - time_s[0],
        force_m_per_s2=force * STANDARD_GRAVITY_M_PER_S2,
        rate_rad_per_s=rate,
        field_ut=magnetic * MICROTESLA_PER_GAUSS,
    )


def _control_points(folder: str | Path, file: str) -> Array:
    """Return where the foot stands after each stride, [strides + 1, 2], metres; the first is the start."""
    path = find_file(folder, file)
    try:
        content = read_mat(path)
        place_m = np.asarray(content["GCP_meters"], dtype=float)
        number = np.ravel(content["GCP_stride_numbers"])
        count = int(np.ravel(content["numberOfStrides"])[0]) + 1
        if place_m.shape != (count, 2) or not np.array_equal(number, np.arange(count)):
            raise ValueError(f"GCP_meters has the shape {place_m.shape} for {count - 1} strides")
        if not np.isfinite(place_m).all():
            raise ValueError("a place is not finite")
    except (ValueError, TypeError, LookupError) as error:
        what = "the arrays GCP_meters, GCP_stride_numbers and numberOfStrides"
        raise unreadable("foot_imu_corridor", file, what, error) from error
    return place_m
