"""A BLE tag on a robot that drives through a furnished flat, heard by six fixed anchors.

Measured by M. Kolakowski (2021) in four runs; a LiDAR tells where the robot is.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Calibration, Recording, Site, Survey, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

RUNS = (1, 2, 3, 4)

READINGS, ANCHORS, LAYOUT = "calibration_df.csv", "anchors.csv", "layout.csv"

PAUSE_S = 60.0
"""The file holds the runs one behind the other; between them are pauses longer than this."""

RSS_COLUMNS = ("rssi_1", "rssi_2", "rssi_3", "rssi_4", "rssi_5", "rssi_6")
PLACE_COLUMNS = ("ts", "x", "y")


def load(folder: str | Path, *, run: int = 1, window_s: float = 1.0, cell_m: float = 0.25) -> Worlds:
    """Load one run to locate, and the other three as survey and calibration.

    The file has a row every third of a second. The epochs of the recording are windows, counted from the
    run's start; strengths are means in dBm over the rows of a window in which the anchor was heard, time
    and place those over all its rows.

    The robot stands still between its moves, and the LiDAR's noise makes of one stop many places, millimetres
    apart: the survey therefore is thinned to one fingerprint for each square cell of the flat that has rows
    of the other runs. Its strengths and its place are means over these rows.

    The calibration holds every reading of the other runs with its planar distance, of all anchors alike,
    though their laws differ: exponents are 1.3 to 2.7, at 5 to 8 dB of scatter about each anchor's own curve.
    A single curve fits badly, and worse near an anchor: those hang 0.5 to 1.3 m above the tag, and over
    distances in space their exponents are 1.5 to 3.1.

    Of the motion only commands are recorded. They are not read, and the recording holds no motion. Nor is
    the heading of the file read: it points backwards, against the way that the robot goes forward.

    Parameters
    ----------
    folder
        The folder of the files.
    run
        The run to locate, ``1`` to ``4``. Run 1 is the only one in the right half of the flat.
    window_s
        Length of a window, seconds.
    cell_m
        Side of a cell of the survey, metres; next to zero, each place is one.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the box around the walls, ``site.access_point_m`` [1, 6, 2],
        ``site.wall_m`` [1, 37, 2, 2], ``survey.rss_dbm`` [1, p, 6], NaN where a cell never heard an
        anchor, ``survey.position_m`` [1, p, 2], ``calibration.distance_m`` and ``calibration.rss_dbm``
        [1, m], ``recording.time_s`` [1, n] from the run's start, ``recording.rss_dbm`` [1, n, 6], and as
        truth ``truth.position_m`` [1, n, 2] and ``truth.distance_m`` [1, n, 6].

    Raises
    ------
    InputError
        For a run that does not exist, a length that is not positive, or a file that is missing or is not
        this data set's.
    """
    if run not in RUNS:
        raise InputError(
            "ble_flat_robot, option run",
            f"{run!r} is none of {', '.join(map(str, RUNS))}",
            "Correct the option",
        )
    for option, value in (("window_s", window_s), ("cell_m", cell_m)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(
                f"ble_flat_robot, option {option}",
                f"{value} is no positive length",
                "Give a number above zero",
            )
    anchor_m = _numbers(folder, ANCHORS, ["id", "x", "y"]).sort_values("id")[["x", "y"]].to_numpy()
    if len(anchor_m) != len(RSS_COLUMNS):
        raise unreadable("ble_flat_robot", ANCHORS, "six anchors", f"there are {len(anchor_m)}")
    corner_m = _numbers(folder, LAYOUT, ["x", "y"]).to_numpy()
    rows = _readings(folder)
    own, other = rows[rows["run"] == run], rows[rows["run"] != run]

    strengths = list(RSS_COLUMNS)
    cells = [np.floor(other[axis] / cell_m) for axis in ("x", "y")]
    fingerprint = other.groupby(cells)[["x", "y", *strengths]].mean()
    other_dbm = other[strengths].to_numpy()
    heard = np.isfinite(other_dbm)
    other_distance_m = pairwise_distance_m(other[["x", "y"]].to_numpy(), anchor_m)
    epoch = own.groupby(own["time_s"] // window_s)[["time_s", "x", "y", *strengths]].mean()
    position_m = epoch[["x", "y"]].to_numpy()

    site = Site(
        corner_m=np.stack([corner_m.min(axis=0), corner_m.max(axis=0)])[None],
        access_point_m=anchor_m[None],
        wall_m=np.stack([corner_m[:-1], corner_m[1:]], axis=1)[None],
    )
    survey = Survey(
        rss_dbm=fingerprint[strengths].to_numpy()[None], position_m=fingerprint[["x", "y"]].to_numpy()[None]
    )
    pairs = Calibration(distance_m=other_distance_m[heard][None], rss_dbm=other_dbm[heard][None])
    recording = Recording(time_s=epoch["time_s"].to_numpy()[None], rss_dbm=epoch[strengths].to_numpy()[None])
    truth = Truth(
        position_m=position_m[None],
        distance_m=pairwise_distance_m(position_m, anchor_m)[None],
    )
    return Worlds(
        observed={
            **site.to_arrays(),
            **survey.to_arrays(),
            **pairs.to_arrays(),
            **recording.to_arrays(),
        },
        truth=truth.to_arrays(),
    )


def _readings(folder: str | Path) -> pd.DataFrame:
    """Return all rows with their run, and their time from its start, seconds."""
    rows = _numbers(folder, READINGS, list(PLACE_COLUMNS), RSS_COLUMNS)
    clock_s = (rows["ts"].to_numpy() - rows["ts"].iloc[0]) * 1e-9
    if (np.diff(clock_s) <= 0).any():
        raise unreadable("ble_flat_robot", READINGS, "the times", "they do not increase")
    run = np.cumsum(np.diff(clock_s, prepend=0.0) > PAUSE_S)
    if run[-1] != len(RUNS) - 1:
        raise unreadable("ble_flat_robot", READINGS, f"{len(RUNS)} runs", f"there are {run[-1] + 1}")
    start_s = clock_s[np.searchsorted(run, run)]
    # The cells hold some hundred nanoseconds less than they print; rows on a window's edge must not miss it.
    return rows.assign(run=run + 1, time_s=np.round(clock_s - start_s, 3))


def _numbers(folder: str | Path, file: str, complete: list[str], gappy: Sequence[str] = ()) -> pd.DataFrame:
    """Read columns of numbers; only in the ``gappy`` ones, which hold strengths, cells may be empty."""
    path = find_file(folder, file)
    columns = [*complete, *gappy]
    try:
        table = pd.read_csv(path, usecols=columns, dtype=float)[columns]
        if table.empty or not np.isfinite(table[complete].to_numpy()).all():
            raise ValueError("there is no row, or a cell is empty or not finite")
        strength_dbm = table[list(gappy)].to_numpy()
        if np.isinf(strength_dbm).any() or (strength_dbm >= 0).any():
            raise ValueError("a strength is infinite, or not below 0 dBm")
    except (ValueError, TypeError) as error:
        raise unreadable("ble_flat_robot", file, f"the columns {', '.join(columns)}", error) from error
    return table
