"""One static target and six anchors outdoors, heard packet by packet in BLE and in Wi-Fi.

Measured by G. Pettorru, V. Pilloni and M. Martalo (2023), about a quarter of an hour for each anchor,
and for each of five distances along a line.
"""

from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Calibration, Recording, Site, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

TECHNOLOGIES = ("ble", "wifi")
LINE_M = (5, 10, 15, 20, 25)
"""Distances of scenario 0, each a file of its own."""

ANCHORS = (1, 2, 3, 4, 5, 6)

RSS_COLUMNS = ("Rx Power [dBm]", "POTENZA_dBm")
"""Headings of the received strength; one file of scenario 0 has the second."""

ANCHOR_COLUMN, TARGET_COLUMN = "Relative Coordinates [m]", "Target Coordinates [m]"

NOT_MEASURED_DBM = 17.0
"""A mark among the Wi-Fi strengths, 1 to 3 % of the packets; no other is above -42 dBm."""

BLE_TIME = "%a %b %d %H:%M:%S %Y"


def load(folder: str | Path, *, technology: str = "ble", window_s: float = 10.0) -> Worlds:
    """Load the line of scenario 0 to calibrate with, and the anchors of scenario A to locate with.

    Packets are averaged over windows, in the calibration as in the recording: so the scatter about the
    path-loss curve is that of the readings that it converts. Five means of a quarter of an hour each
    would hide it, and give nearly the same curve.

    The anchors were recorded one after the other, with pauses. Window k of the recording joins the
    windows k of all anchors, each counted from its own first packet. The target stood still, thus the
    epochs have no order: their times are all zero, which stands for a static place, and no tracker
    applies. It stood in the middle of the anchors' box: whatever answers the centre of the site is
    right here.

    The mark of 17 dBm in the Wi-Fi files is left out before any mean. Places of the anchors and of the
    target are those of the Wi-Fi files: the BLE files give anchors 2 and 6 the places of 1 and 5.

    Parameters
    ----------
    folder
        The folder of the files.
    technology
        ``ble`` or ``wifi``.
    window_s
        Length of a window, seconds. The BLE times are whole seconds.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the anchors, ``site.access_point_m``
        [1, 6, 2], ``calibration.distance_m`` and ``calibration.rss_dbm`` [1, m], ``recording.time_s``
        [1, n], all zero, ``recording.rss_dbm`` [1, n, 6], NaN where a window has no packet of an
        anchor, and as truth ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, 6]. Metres,
        origin at the target.

    Raises
    ------
    InputError
        For a technology that does not exist, a window that is no positive length, or a file that is
        missing or is not this data set's.
    """
    if technology not in TECHNOLOGIES:
        raise InputError(
            "rss_multilateration, option technology",
            f"{technology!r} is none of {', '.join(TECHNOLOGIES)}",
            "Correct the option",
        )
    if not (np.isfinite(window_s) and window_s > 0):
        raise InputError(
            "rss_multilateration, option window_s",
            f"{window_s} is no positive length of time",
            "Give seconds above zero",
        )
    line = [
        _windows(folder, f"scenario_0/{technology}/Distanza{m}.csv", technology, window_s) for m in LINE_M
    ]
    calibration = Calibration(
        distance_m=np.repeat(np.array(LINE_M, dtype=float), [len(means) for means in line])[None],
        rss_dbm=np.concatenate([means.to_numpy() for means in line])[None],
    )
    heard = [
        _windows(folder, f"scenario_A/{technology}/Anchor_{number}.csv", technology, window_s)
        for number in ANCHORS
    ]
    rss_dbm = pd.concat(heard, axis=1).sort_index().to_numpy(dtype=float)

    wifi = [f"scenario_A/wifi/Anchor_{number}.csv" for number in ANCHORS]
    anchor_m = np.array([_place(folder, file, ANCHOR_COLUMN) for file in wifi])
    target_m = np.array([_place(folder, file, TARGET_COLUMN) for file in wifi])
    if (target_m != target_m[0]).any():
        raise InputError(
            "rss_multilateration, files of scenario_A",
            "they name different places of the target",
            "Use the registered files of data/sources.csv",
        )
    position_m = np.repeat(target_m[:1], len(rss_dbm), axis=0)
    site = Site(
        corner_m=np.stack([anchor_m.min(axis=0), anchor_m.max(axis=0)])[None], access_point_m=anchor_m[None]
    )
    recording = Recording(time_s=np.zeros((1, len(rss_dbm))), rss_dbm=rss_dbm[None])
    truth = Truth(position_m=position_m[None], distance_m=pairwise_distance_m(position_m, anchor_m)[None])
    return Worlds(
        observed={**site.to_arrays(), **calibration.to_arrays(), **recording.to_arrays()},
        truth=truth.to_arrays(),
    )


def _windows(folder: str | Path, file: str, technology: str, window_s: float) -> "pd.Series[float]":
    """Return the mean strength of each window that has a packet, dBm, by the window's number."""
    table = _read(folder, file)
    try:
        (column,) = [name for name in RSS_COLUMNS if name in table]
        rss_dbm = table[column].astype(float)
        time_s = table["Timestamp"].map(_ble_time_s if technology == "ble" else float).astype(float)
        if not (np.isfinite(rss_dbm).all() and np.isfinite(time_s).all()):
            raise ValueError("a cell is empty or not finite")
    except (KeyError, ValueError) as error:
        what = f"the columns Timestamp, {RSS_COLUMNS[0]}"
        raise unreadable("rss_multilateration", file, what, error) from error
    number = ((time_s - time_s.min()) // window_s).astype(int)
    measured = rss_dbm != NOT_MEASURED_DBM
    return rss_dbm[measured].groupby(number[measured]).mean()


def _ble_time_s(text: str) -> float:
    """Return the seconds of a date without a time zone; only differences have a meaning."""
    return (datetime.strptime(text, BLE_TIME) - datetime(1970, 1, 1)).total_seconds()


def _place(folder: str | Path, file: str, column: str) -> Array:
    """Return the one place, [2] in metres, that a file names in a column of cells such as "5.55, 15"."""
    table = _read(folder, file)
    try:
        (cell,) = table[column].unique()
        x, y = str(cell).split(", ")
        return np.array([float(x), float(y)])
    except (KeyError, ValueError) as error:
        raise unreadable("rss_multilateration", file, f"the column {column}", error) from error


def _read(folder: str | Path, file: str) -> pd.DataFrame:
    path = find_file(folder, file)
    try:
        table = pd.read_csv(path, sep=";", encoding="utf-8-sig", dtype=str)
        if table.empty:
            raise ValueError("there is no row")
    except (ValueError, UnicodeError) as error:
        raise unreadable("rss_multilateration", file, "the column Timestamp", error) from error
    return table
