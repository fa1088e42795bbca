"""A recording of one's own with beacons at known places, from three plain tables.

The walk holds what was heard at each epoch and where that really was, the beacons their places, and the
calibration how received strength goes with distance.
"""

from pathlib import Path
from typing import Any

import numpy as np

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Calibration, Recording, Site, Truth, Worlds
from positioning.ranging import calibration_pairs
from positioning.recordings.csv_table import (
    POSITION,
    POSITION_COLUMNS,
    RSS,
    RSS_ENDING,
    Quantity,
    Table,
    not_finite,
    read_places,
    read_table,
)
from positioning.trilateration import check_beacons

TIME_COLUMN = "time_s"
MOTION_COLUMNS = ("turn_before_rad", "advance_m", "turn_after_rad")
CALIBRATION_COLUMNS = ("distance_m", "rss_dbm")

TIME = Quantity(not_finite, "a finite time in seconds is needed", "Fill the cell, or remove the row")
MOTION = Quantity(
    not_finite,
    "a finite motion since the row before is needed",
    f"Fill the cell, with 0 where nothing moved, or remove the columns {', '.join(MOTION_COLUMNS)}",
)
DISTANCE = Quantity(
    lambda distance_m: not_finite(distance_m) | (distance_m <= 0),
    "a distance above zero in metres is needed",
    "Correct the cell, or remove the row",
)


def load(
    folder: str | Path,
    *,
    walk: str = "walk.csv",
    beacons: str = "beacons.csv",
    calibration: str = "calibration.csv",
) -> Worlds:
    """Load a walk, the beacons that it heard, and the calibration run.

    Equal times in all rows, best zeros, stand for static places without an order: no tracker that needs one
    applies. In the truth, distances are planar.

    Parameters
    ----------
    folder
        The folder of the files.
    walk
        A row an epoch: ``time_s``, the true place ``x_m`` and ``y_m``, and for each beacon a column
        ``<name>_dbm``, empty where it was not heard. Where it is known, also the motion since the row before,
        as turn, straight line and second turn: ``turn_before_rad``, ``advance_m``, ``turn_after_rad``, all
        zero in the first row.
    beacons
        The columns ``name``, ``x_m``, ``y_m``: the place of every beacon of the walk, in any order. Others
        in it are ignored.
    calibration
        The columns ``distance_m`` and ``rss_dbm``: a reading a row, of all beacons alike. Other columns are
        ignored.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the beacons, ``site.access_point_m``
        [1, b, 2] in the order of the walk's columns, ``calibration.distance_m`` and ``calibration.rss_dbm``
        [1, m], ``recording.time_s`` [1, n], ``recording.rss_dbm`` [1, n, b], where it is known
        ``recording.turn_before_rad``, ``advance_m`` and ``turn_after_rad`` [1, n], and as truth
        ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, b].

    Raises
    ------
    InputError
        For a file that is missing or empty, wrong column names, and cells that are no number, not finite or
        no received strength; for times that do not increase, unless all are equal, a motion before the
        first row, fewer than three beacons, beacons on one line, and strengths that were heard at fewer than
        two distances. It names file, row (the header is row 1) and column.
    """
    table = read_table(folder, walk, "epoch")
    table.require(
        (TIME_COLUMN, *POSITION_COLUMNS),
        "Name the time time_s, in seconds, and the true place x_m and y_m, in metres, and separate the cells"
        " by commas",
    )
    rss_columns = table.rss_columns((TIME_COLUMN, *POSITION_COLUMNS, *MOTION_COLUMNS), "beacon")
    time_s = table.numbers([TIME_COLUMN], TIME)[:, 0]
    position_m = table.numbers(POSITION_COLUMNS, POSITION)
    rss_dbm = table.numbers(rss_columns, RSS)
    _check_order(table, time_s)
    motion = _motion(table, time_s)

    beacon_m = read_places(
        folder, beacons, walk, rss_columns, "Add its row, or remove its column from the walk"
    )
    places: dict[tuple[float, ...], str] = {}
    for name, place_m in zip(rss_columns, map(tuple, beacon_m.tolist()), strict=True):
        other = places.setdefault(place_m, name)
        if other != name:
            pair = " and ".join(column.removesuffix(RSS_ENDING) for column in (other, name))
            raise InputError(f"{beacons}, {pair}", "both stand at the same place", "Leave one of them out")
    try:
        check_beacons(beacon_m)
    except InputError as error:
        raise InputError(f"{beacons}, those heard in {walk}", error.limit, error.cure) from error
    site = Site(
        corner_m=np.stack([beacon_m.min(axis=0), beacon_m.max(axis=0)])[None], access_point_m=beacon_m[None]
    )
    recording = Recording(
        time_s=time_s[None],
        rss_dbm=rss_dbm[None],
        **{name: values[None] for name, values in motion.items()},
    )
    truth = Truth(position_m=position_m[None], distance_m=pairwise_distance_m(position_m, beacon_m)[None])
    return Worlds(
        observed={
            **site.to_arrays(),
            **_calibration(folder, calibration).to_arrays(),
            **recording.to_arrays(),
        },
        truth=truth.to_arrays(),
    )


def _check_order(table: Table, time_s: Array) -> None:
    """Refuse times that do not increase, unless all are equal."""
    stands = np.diff(time_s) <= 0
    if stands.any() and np.ptp(time_s) > 0:
        row = int(np.argmax(stands)) + 1
        raise InputError(
            table.cell(row, TIME_COLUMN),
            f"the time {time_s[row]:.12g} is not after {time_s[row - 1]:.12g} of the row before",
            "Sort the rows by time and join those of one time, or write 0 in all for places without an order",
        )


def _motion(table: Table, time_s: Array) -> dict[str, Any]:
    """Return the columns of the motion, [n] each; none where the table has none."""
    if not any(name in table.column for name in MOTION_COLUMNS):
        return {}
    table.require(MOTION_COLUMNS, f"Give all of {', '.join(MOTION_COLUMNS)}, or none")
    values = table.numbers(MOTION_COLUMNS, MOTION)
    if values[0].any():
        first = int(np.argmax(values[0] != 0))
        raise InputError(
            table.cell(0, MOTION_COLUMNS[first]),
            f"the cell holds {values[0, first]:g}, but no row is before the first from which to move",
            "Write 0; a motion stands in the row in which it ends",
        )
    if len(time_s) > 1 and np.ptp(time_s) == 0:
        raise InputError(
            f"{table.file}, column {TIME_COLUMN}",
            "all times are equal, which stands for places without an order, but there is a motion",
            f"Give the times, or remove the columns {', '.join(MOTION_COLUMNS)}",
        )
    return dict(zip(MOTION_COLUMNS, values.T, strict=True))


def _calibration(folder: str | Path, file: str) -> Calibration:
    table = read_table(folder, file, "reading")
    table.require(CALIBRATION_COLUMNS, f"Name the columns {' and '.join(CALIBRATION_COLUMNS)}")
    distance_m = table.numbers(CALIBRATION_COLUMNS[:1], DISTANCE)[:, 0]
    rss_dbm = table.numbers(CALIBRATION_COLUMNS[1:], RSS)[:, 0]
    try:
        calibration_pairs(distance_m, rss_dbm)
    except InputError as error:
        raise InputError(file, error.limit, error.cure) from error
    return Calibration(distance_m=distance_m[None], rss_dbm=rss_dbm[None])
