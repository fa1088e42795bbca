"""A BLE beacon that is carried through an office, heard by twelve fixed sensors.

Measured by F. S. Danis, A. T. Naskali, A. T. Cemgil and C. Ersoy (2022); a camera and markers tell
where the beacon is, to about 0.04 m.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Calibration, Recording, Site, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

TRACKS = ("straight_01", "straight_02", "straight_03", "rectangular_with_rotation")

COLUMNS = ("time_s", "sensor", "beacon", "rss_dbm", "x_m", "y_m")
"""The first six columns of a track; height and orientation of the beacon follow."""


def load(
    folder: str | Path, *, track: str = "straight_02", calibration: str = "straight_01", window_s: float = 1.0
) -> Worlds:
    """Load one track to locate, and another one to calibrate with.

    The calibration holds every packet of its track, about 1100 to 1900, none thinned out. The recording
    has an epoch for each window in which any sensor heard the beacon, counted from the first packet;
    strengths are means in dBm over the window, time and true position those over all its packets.
    Packets come in bursts, about two a second: windows much below half a second are mostly empty.

    Distances are planar, in the calibration and as truth: the beacon is carried at about 1.8 m, the
    sensors hang at 1.22 m or 2.30 m, and nobody comes nearer than 1 m. The camera places the beacon up
    to 0.4 m outside the area's limits; that is left as it is.

    Parameters
    ----------
    folder
        The folder of the files.
    track, calibration
        Two different ones of ``straight_01``, ``straight_02``, ``straight_03`` and
        ``rectangular_with_rotation``.
    window_s
        Length of a window, seconds.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the limits of the area, ``site.access_point_m``
        [1, 12, 2], ``calibration.distance_m`` and ``calibration.rss_dbm`` [1, m], ``recording.time_s``
        [1, n] from the first packet, ``recording.rss_dbm`` [1, n, 12], NaN where a sensor heard
        nothing in a window, and as truth ``truth.position_m`` [1, n, 2] and ``truth.distance_m``
        [1, n, 12]. Metres and seconds.

    Raises
    ------
    InputError
        For a track that does not exist or is its own calibration, a window that is no positive length,
        or a file that is missing or is not this data set's.
    """
    for name, option in (("track", track), ("calibration", calibration)):
        if option not in TRACKS:
            raise InputError(
                f"ble_ar_tracks, option {name}",
                f"{option!r} is none of {', '.join(TRACKS)}",
                "Correct the option",
            )
    if track == calibration:
        raise InputError(
            "ble_ar_tracks, option calibration",
            f"{calibration} is the track itself, which then would be located by its own strengths",
            "Calibrate with another track",
        )
    if not (np.isfinite(window_s) and window_s > 0):
        raise InputError(
            "ble_ar_tracks, option window_s",
            f"{window_s} is no positive length of time",
            "Give seconds above zero",
        )
    sensors, sensor_m = _sensors(folder)
    run, packet = (_packets(folder, name, sensors) for name in (calibration, track))
    to_sensor_m = pairwise_distance_m(run[["x_m", "y_m"]].to_numpy(), sensor_m)
    of_packet = run["sensor"].map(sensors.index).to_numpy(dtype=int)

    time_s = packet["time_s"] - packet["time_s"].min()
    window = (time_s // window_s).astype(int)
    rss_dbm = packet["rss_dbm"].groupby([window, packet["sensor"]]).mean().unstack()
    rss_dbm = rss_dbm.reindex(columns=sensors)
    position_m = packet[["x_m", "y_m"]].groupby(window).mean().to_numpy()

    site = Site(corner_m=_limits(folder)[None], access_point_m=sensor_m[None])
    pairs = Calibration(
        distance_m=to_sensor_m[np.arange(len(run)), of_packet][None],
        rss_dbm=run["rss_dbm"].to_numpy(dtype=float)[None],
    )
    recording = Recording(
        time_s=time_s.groupby(window).mean().to_numpy()[None], rss_dbm=rss_dbm.to_numpy(dtype=float)[None]
    )
    truth = Truth(position_m=position_m[None], distance_m=pairwise_distance_m(position_m, sensor_m)[None])
    return Worlds(
        observed={**site.to_arrays(), **pairs.to_arrays(), **recording.to_arrays()},
        truth=truth.to_arrays(),
    )


def _sensors(folder: str | Path) -> tuple[list[str], Array]:
    """Return the sensors' ids and their places, [sensor, 2], metres, in the order of the file."""
    file = "tetam.dev"
    path = find_file(folder, file)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        (line,) = [line for line in lines if line.startswith("Dongles:")]
        entries: dict[str, Any] = json.loads(line.removeprefix("Dongles:"))
        place_m = np.array([entry[0] for entry in entries.values()], dtype=float)
        return list(entries), place_m.reshape(len(entries), 3)[:, :2]
    except (ValueError, TypeError, AttributeError, LookupError) as error:
        raise unreadable("ble_ar_tracks", file, "the places of the sensors", error) from error


def _limits(folder: str | Path) -> Array:
    """Return the lower left and the upper right corner of the area, [2, 2], metres."""
    file = "tetam.par"
    path = find_file(folder, file)
    try:
        limits = json.loads(path.read_text(encoding="utf-8"))["limits"]
        return np.array(limits, dtype=float).reshape(2, 2)
    except (ValueError, TypeError, LookupError) as error:
        raise unreadable("ble_ar_tracks", file, "the limits of the area", error) from error


def _packets(folder: str | Path, track: str, sensors: list[str]) -> pd.DataFrame:
    """Return the packets of a track, with the columns of ``COLUMNS``."""
    file = f"{track}_all_sensors.mbd"
    path = find_file(folder, file)
    try:
        # The ids have leading zeros, and some would pass for a number.
        packet = pd.read_csv(
            path,
            header=None,
            names=list(COLUMNS),
            usecols=range(len(COLUMNS)),
            dtype=dict.fromkeys(COLUMNS, float) | {"sensor": str, "beacon": str},
        )
        numbers = packet.drop(columns=["sensor", "beacon"]).to_numpy(dtype=float)
        if packet.empty or not np.isfinite(numbers).all():
            raise ValueError("there is no row, or a cell is empty or not finite")
        unknown = sorted(set(packet["sensor"]) - set(sensors))
        if unknown:
            raise ValueError(f"tetam.dev has no sensor {unknown[0]}")
        if packet["beacon"].nunique() != 1:
            raise ValueError("there is more than one beacon")
    except (ValueError, TypeError) as error:
        raise unreadable("ble_ar_tracks", file, f"the columns {', '.join(COLUMNS)}", error) from error
    return packet
