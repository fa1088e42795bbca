"""A small robot on a table, heard by four radio nodes at the corners.

Measured by E. Latif and R. Parasuraman (University of Georgia): strengths, odometry and tracked places, once
a second, in ten runs.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Calibration, Recording, Site, Survey, Truth, Worlds
from positioning.recordings.register import find_file, unreadable
from positioning.recordings.robot_range_odometry import motion_between

RUNS = ("exp1", "exp2", "exp2.1", "exp2.3", "exp3", "exp3.1", "exp3.3", "exp4", "exp4.1", "exp4.3")

NODE_M = ((0.0, 0.0), (0.0, 1.75), (2.34, 1.75), (2.34, 0.0))
"""Places of the nodes 1 to 4; they are those of the publisher's programs, nobody surveyed them."""

RSS_COLUMNS = ("rssi1", "rssi2", "rssi3", "rssi4")
STATUS_COLUMNS = ("status1", "status2", "status3", "status4")
MOTION_COLUMNS = ("temp_sec", "temp_nsec", "robot_odom_x", "robot_pos_x", "robot_pos_y", "vel_w")
"""Time, distance travelled by the wheels, tracked place, turn rate."""


CELL_M = 0.1
"""Side of the cells to which the other run is thinned for its survey."""


def load(folder: str | Path, *, name: str = "exp2", calibration: str = "exp3") -> Worlds:
    """Load one run to locate, and another one to calibrate with, and to take as survey.

    The survey has one fingerprint for each cell of 0.1 m that the other run met, means over its rows there.

    Every row is an epoch. A node is heard where its status is 1; else its strength stands as 0 and becomes
    NaN. The last row of ``exp3`` is cut off in the middle: what is missing there was not heard either. Node 4
    is dead in ``exp1``, a stub of 22 rows.

    The odometer's speed is the central difference of the distance that the wheels travelled, which does not
    start at zero in all runs and is 10 to 25 % shorter than the tracked path. The turn rate is as recorded,
    in steps of 0.05 rad/s like a command. Its sign agrees with the path; the course turns by 0.4 times as
    much in ``exp2``, by 0.7 times in ``exp2.1``, and by 0.9 to 1.2 times in the others. Between two epochs
    the robot is thought to drive along the mean of its headings at both, and to turn at the mean of
    the two rates. Of its heading only one part of a quaternion was kept, without the sign: it is not known.

    Parameters
    ----------
    folder
        The folder of the files.
    name, calibration
        Two different ones of ``exp1``, ``exp2``, ``exp2.1``, ``exp2.3``, ``exp3``, ``exp3.1``, ``exp3.3``,
        ``exp4``, ``exp4.1`` and ``exp4.3``.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the nodes, which the tracked path leaves by up
        to 0.26 m, ``site.access_point_m`` [1, 4, 2], ``calibration.distance_m`` and ``calibration.rss_dbm``
        [1, p], all readings of the other run, ``survey.rss_dbm`` [1, q, 4] and ``survey.position_m``
        [1, q, 2], ``recording.time_s`` and ``recording.motion_time_s`` [1, n],
        the same, from the first row, ``recording.rss_dbm`` [1, n, 4], ``recording.turn_before_rad``,
        ``advance_m``, ``turn_after_rad``, ``gyro_rad_per_s`` and ``odometer_m_per_s`` [1, n],
        ``recording.start_heading_rad`` [1], NaN, ``recording.start_position_m`` [1, 2], and as truth
        ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, 4].

    Raises
    ------
    InputError
        For a run that does not exist or is its own calibration, or a file that is missing or is not this
        data set's.
    """
    for option, value in (("name", name), ("calibration", calibration)):
        if value not in RUNS:
            raise InputError(
                f"robot_rssi_odometry, option {option}",
                f"{value!r} is none of {', '.join(RUNS)}",
                "Correct the option",
            )
    if name == calibration:
        raise InputError(
            "robot_rssi_odometry, option calibration",
            f"{calibration} is the run itself, which then would be located by its own strengths",
            "Calibrate with another run",
        )
    node_m = np.array(NODE_M)
    (run, rss_dbm), (other, other_dbm) = (_read(folder, each) for each in (name, calibration))
    other_distance_m = pairwise_distance_m(_place_m(other), node_m)
    heard = np.isfinite(other_dbm)

    time_s = _time_s(run)
    travelled_m = run["robot_odom_x"].to_numpy()
    gyro_rad_per_s = run["vel_w"].to_numpy()
    step_turn_rad = np.diff(time_s) * (gyro_rad_per_s[1:] + gyro_rad_per_s[:-1]) / 2
    turn_before_rad, advance_m, turn_after_rad = motion_between(
        time_s, time_s, step_turn_rad, np.diff(travelled_m)
    )
    position_m = _place_m(run)
    site = Site(
        corner_m=np.stack([node_m.min(axis=0), node_m.max(axis=0)])[None], access_point_m=node_m[None]
    )
    pairs = Calibration(distance_m=other_distance_m[heard][None], rss_dbm=other_dbm[heard][None])
    place = pd.DataFrame(np.hstack([_place_m(other), other_dbm]))
    fingerprint = place.groupby([np.floor(place[axis] / CELL_M) for axis in (0, 1)]).mean().to_numpy()
    survey = Survey(rss_dbm=fingerprint[None, :, 2:], position_m=fingerprint[None, :, :2])
    recording = Recording(
        time_s=time_s[None],
        rss_dbm=rss_dbm[None],
        turn_before_rad=turn_before_rad[None],
        advance_m=advance_m[None],
        turn_after_rad=turn_after_rad[None],
        start_heading_rad=np.array([np.nan]),
        start_position_m=position_m[:1],
        motion_time_s=time_s[None],
        gyro_rad_per_s=gyro_rad_per_s[None],
        odometer_m_per_s=np.gradient(travelled_m, time_s)[None],
    )
    truth = Truth(position_m=position_m[None], distance_m=pairwise_distance_m(position_m, node_m)[None])
    return Worlds(
        observed={
            **site.to_arrays(),
            **survey.to_arrays(),
            **pairs.to_arrays(),
            **recording.to_arrays(),
        },
        truth=truth.to_arrays(),
    )


def _read(folder: str | Path, run: str) -> tuple[pd.DataFrame, Array]:
    """Return the rows of a run, and the strengths of the four nodes, [n, 4], dBm, NaN where not heard."""
    file = f"combined_sync_data_{run}.csv"
    path = find_file(folder, file)
    columns = [*MOTION_COLUMNS, *RSS_COLUMNS, *STATUS_COLUMNS]
    try:
        table = pd.read_csv(path, skipinitialspace=True, usecols=columns, dtype=float)[columns]
        if len(table) < 2 or not np.isfinite(table[list(MOTION_COLUMNS)].to_numpy()).all():
            raise ValueError("there are fewer than two rows, or a cell is empty or not finite")
        if (np.diff(_time_s(table)) <= 0).any():
            raise ValueError("the time does not increase")
        rss_dbm = table[list(RSS_COLUMNS)].to_numpy()
        heard = (table[list(STATUS_COLUMNS)].to_numpy() == 1) & ~np.isnan(rss_dbm)
        if not (rss_dbm[heard] < 0).all() or np.isinf(rss_dbm).any():
            raise ValueError("a strength that was heard is not below 0 dBm")
    except (ValueError, TypeError) as error:
        raise unreadable("robot_rssi_odometry", file, f"the columns {', '.join(columns)}", error) from error
    return table, np.where(heard, rss_dbm, np.nan)


def _time_s(table: pd.DataFrame) -> Array:
    # Seconds since 1970 leave no room for nanoseconds in one number.
    second_s = table["temp_sec"].to_numpy() - table["temp_sec"].iloc[0]
    nanosecond = table["temp_nsec"].to_numpy() - table["temp_nsec"].iloc[0]
    return np.asarray(second_s + 1e-9 * nanosecond)


def _place_m(table: pd.DataFrame) -> Array:
    return table[["robot_pos_x", "robot_pos_y"]].to_numpy()
