"""Rooms with three transmitters at known places: BLE, Wi-Fi and Zigbee, with a path-loss run each.

Measured by S. Sadowski, P. Spachos and K. N. Plataniotis (2020): mean strengths of three
transmitters at grid points and at test points of two rooms, and of one transmitter at 18 distances.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Calibration, Recording, Site, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

SCENARIOS = (1, 2)
TECHNOLOGIES = ("ble", "wifi", "zigbee")
POINTS = ("tests", "database")

TRANSMITTER_M = {
    1: ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0)),
    2: ((0.0, 0.0), (3.27, 0.0), (1.635, 4.4)),
}
"""Places of the transmitters A, B and C of each scenario, read from the published figures to about 0.1 m."""

SWAPPED = ((1, "database"),)
"""Tables whose columns of x and y are exchanged against the other tables and the transmitters."""

RSS_COLUMNS = ("rssi_a_abs_dBm", "rssi_b_abs_dBm", "rssi_c_abs_dBm")


def load(folder: str | Path, *, scenario: int = 1, technology: str = "ble", points: str = "tests") -> Worlds:
    """Load one room: the path-loss run to calibrate with, and static points to locate.

    The points have no order and were not taken in one go: their times are all zero, which stands for
    static places, and no tracker applies. The path-loss run was made with one transmitter: one curve
    serves all three.

    The tables give strengths as positive numbers; they become negative dBm here. In scenario 1 the
    database's x and y are exchanged: taken as printed, the strengths of B and C rise with the distance.

    Parameters
    ----------
    folder
        The folder of the files.
    scenario
        ``1`` (quiet room, 10 test points, 49 of the database) or ``2`` (interference, 6 and 16).
    technology
        ``ble``, ``wifi`` or ``zigbee``.
    points
        The points to locate: the ``tests``, or those of the ``database``, which are more.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the transmitters and the database,
        ``site.access_point_m`` [1, 3, 2], ``calibration.distance_m`` and ``calibration.rss_dbm``
        [1, 18], ``recording.time_s`` [1, n], all zero, ``recording.rss_dbm`` [1, n, 3], and as truth
        ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, 3]. Metres, origin at A.

    Raises
    ------
    InputError
        For an option that does not exist, or a file that is missing or is not this data set's.
    """
    options = (
        ("scenario", scenario, SCENARIOS),
        ("technology", technology, TECHNOLOGIES),
        ("points", points, POINTS),
    )
    for name, option, known in options:
        if option not in known:
            raise InputError(
                f"ble_three_beacon_rooms, option {name}",
                f"{option!r} is none of {', '.join(map(str, known))}",
                "Correct the option",
            )
    run = _read(folder, f"scenario{scenario}/pathloss_{technology}.csv", ["distance_m", "rssi_dBm"])
    table = {kind: _read_points(folder, scenario, technology, kind) for kind in POINTS}

    transmitter_m = np.array(TRANSMITTER_M[scenario])
    surveyed_m = np.concatenate([transmitter_m, table["database"][0]])
    position_m, rss_dbm = table[points]
    site = Site(
        corner_m=np.stack([surveyed_m.min(axis=0), surveyed_m.max(axis=0)])[None],
        access_point_m=transmitter_m[None],
    )
    calibration = Calibration(
        distance_m=run["distance_m"].to_numpy(dtype=float)[None],
        rss_dbm=run["rssi_dBm"].to_numpy(dtype=float)[None],
    )
    recording = Recording(time_s=np.zeros((1, len(position_m))), rss_dbm=rss_dbm[None])
    truth = Truth(
        position_m=position_m[None], distance_m=pairwise_distance_m(position_m, transmitter_m)[None]
    )
    return Worlds(
        observed={**site.to_arrays(), **calibration.to_arrays(), **recording.to_arrays()},
        truth=truth.to_arrays(),
    )


def _read_points(folder: str | Path, scenario: int, technology: str, kind: str) -> tuple[Array, Array]:
    """Return positions [n, 2] in metres and strengths [n, 3] in dBm of one table."""
    file = f"scenario{scenario}/{kind}_{technology}.csv"
    table = _read(folder, file, ["x_m", "y_m", *RSS_COLUMNS])
    magnitude_dbm = table[list(RSS_COLUMNS)].to_numpy(dtype=float)
    if (magnitude_dbm < 0).any():
        raise InputError(
            f"ble_three_beacon_rooms, file {file}",
            f"the columns {', '.join(RSS_COLUMNS)} hold {magnitude_dbm.min():g}, but strengths stand"
            " there without their minus",
            "Use the registered file of data/sources.csv",
        )
    position_m = table[["x_m", "y_m"]].to_numpy(dtype=float)
    if (scenario, kind) in SWAPPED:
        position_m = position_m[:, ::-1]
    return position_m, -magnitude_dbm


def _read(folder: str | Path, file: str, columns: list[str]) -> pd.DataFrame:
    path = find_file(folder, file)
    try:
        table = pd.read_csv(path, usecols=columns, dtype=float)[columns]
        if table.empty or not np.isfinite(table.to_numpy()).all():
            raise ValueError("there is no row, or a cell is empty or not finite")
    except (ValueError, UnicodeError) as error:
        what = f"the columns {', '.join(columns)}"
        raise unreadable("ble_three_beacon_rooms", file, what, error) from error
    return table
