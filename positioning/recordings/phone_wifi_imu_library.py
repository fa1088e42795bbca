"""A phone that is carried through a library and scans 22 Wi-Fi access points once a second.

Published by Z. Xu: eight walks to make a map of, and sixteen to locate. Its inertial readings are those of a
hand: there are no stances, and dead reckoning counts steps.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from positioning.errors import InputError
from positioning.model import Array, Query, Recording, Site, Survey, Truth, Walks, Worlds
from positioning.recordings.register import find_file, unreadable

WALKS = {
    "final1": ("train_final1", 4),
    "final2": ("train_final2", 4),
    "t1": ("test_t1", 3),
    "t2": ("test_t2", 5),
    "t3": ("test_t3", 8),
}
"""Parts of the data set: their folders, and how many walks each has."""

ACCESS_POINTS = 22
NOT_HEARD_DBM = -100.0
"""The files' mark for an access point that was not heard."""

SCAN_S = 1.0
"""Time from one scan to the next; the files have no times."""
SENSOR_HZ = 100
"""Rows of inertial readings a second: a scan is taken at every hundredth."""
INERTIAL = 9
"""Columns: accelerometer, gyroscope and magnetometer, three axes each."""

# The vertical is the mean direction of what the accelerometer feels over several steps.
_VERTICAL_S = 3.0
# A step is a peak of its norm, smoothed over less than a step, that stands out from the mean by more than the
# rounding of a quiet hand; nobody takes more than three steps a second.
_SMOOTH_S, _LEAST_PEAK_M_PER_S2, _LEAST_STEP_S = 0.05, 0.3, 0.3


def load(
    folder: str | Path,
    *,
    map: str | Sequence[str] = ("final1", "final2"),
    query: str | Sequence[str] = "t1",
    run: int | None = None,
    walks: str | Sequence[str] | None = None,
    step_m: float = 0.7,
) -> Worlds:
    """Load a map, and the scans of other walks to locate, or walks that are to be aligned.

    Every scan of the walks of the map is a fingerprint of its own; none has a second scan at its place. The
    places of both were interpolated by the publisher at constant speed between known points: they are good
    to about 1 m, and so is every error below that.

    With ``run`` the scans are those of one walk, and stand there a second time as a recording: one epoch a
    scan, a second apart. The readings of the phone's inertial sensors are not read: it is held in the hand
    and has no stances. Nor are the start and its direction given, as nobody noted them.

    With ``walks`` there is neither map nor query, but walks with a pose at each scan, dead reckoned by steps
    of one length: see `dead_reckoned`.

    Parameters
    ----------
    folder
        The folder of the folders of the files.
    map, query
        One or several of ``final1``, ``final2``, ``t1``, ``t2`` and ``t3``; none may be in both.
    run
        Which walk of the query to locate, from 1; None for all of them, which then are no recording.
    walks
        One or several of these parts, whose walks are to be aligned; None for a map and a query.
    step_m
        Length of a step of ``walks``, metres; the publisher tells none, and an ordinary one is assumed.

    Returns
    -------
    Worlds
        One world: ``survey.rss_dbm`` [1, p, 22], NaN where an access point was not heard,
        ``survey.position_m`` [1, p, 2], ``query.rss_dbm`` [1, m, 22], ``site.corner_m`` [1, 2, 2], the box
        around the survey, with ``run`` ``recording.time_s`` [1, m] and ``recording.rss_dbm`` [1, m, 22], the
        query's, and as truth ``truth.position_m`` [1, m, 2].

        With ``walks`` instead: ``walks.time_s`` and ``walks.heading_rad`` [1, k, n], ``walks.position_m``
        [1, k, n, 2], ``walks.rss_dbm`` [1, k, n, 22], and ``truth.position_m`` and ``truth.path_m``
        [1, k, n, 2], both at every scan, and ``truth.heading_rad`` [1, k, n], the direction from place to
        place, which is as rough as the places; NaN after the end of a walk.

    Raises
    ------
    InputError
        For an option that does not exist, a query that is part of the map, a run that is none of one
        query's, or a file that is missing or is not this data set's.
    """
    if walks is not None:
        if run is not None:
            raise InputError(
                "phone_wifi_imu_library, option run", "walks are aligned together", "Leave it out"
            )
        return _walks_to_align(folder, [walks] if isinstance(walks, str) else list(walks), step_m)
    maps, queries = ([part] if isinstance(part, str) else list(part) for part in (map, query))
    for option, parts in (("map", maps), ("query", queries)):
        _check_parts(option, parts)
    both = [part for part in queries if part in maps]
    if both:
        raise InputError(
            "phone_wifi_imu_library, option query",
            f"{both[0]} is part of the map, in which its scans would find themselves",
            "Locate another part",
        )
    if run is not None and not (len(queries) == 1 and run in range(1, WALKS[queries[0]][1] + 1)):
        raise InputError(
            "phone_wifi_imu_library, option run",
            f"{run!r} is no walk of {' and '.join(queries)}",
            "Name one part and one of its walks, from 1 on",
        )
    survey_dbm, survey_m = _scans(folder, [(part, number) for part in maps for number in _walks(part)])
    wanted = [(part, number) for part in queries for number in _walks(part) if run in (None, number)]
    query_dbm, query_m = _scans(folder, wanted)

    survey = Survey(rss_dbm=survey_dbm[None], position_m=survey_m[None]).check("phone_wifi_imu_library, map")
    site = Site(corner_m=np.stack([survey_m.min(axis=0), survey_m.max(axis=0)])[None])
    observed = {**survey.to_arrays(), **site.to_arrays(), **Query(rss_dbm=query_dbm[None]).to_arrays()}
    if run is not None:
        time_s = SCAN_S * np.arange(len(query_dbm), dtype=float)
        observed |= Recording(time_s=time_s[None], rss_dbm=query_dbm[None]).to_arrays()
    return Worlds(observed=observed, truth=Truth(position_m=query_m[None]).to_arrays())


def dead_reckoned(inertial: Array, step_m: float) -> tuple[Array, Array]:
    """Return place and heading at every reading of a phone that is carried about.

    The heading is the sum of what the gyroscope turns about the vertical; the walk goes ahead by one step at
    each peak of what the accelerometer feels, evenly from one to the next, in the direction of the heading
    there. The phone must keep its place in the hand: where it turns in the hand, so does the walk.

    Parameters
    ----------
    inertial
        Accelerometer, m/s2, and gyroscope, rad/s, [n, 6 or more].
    step_m
        Length of a step, metres.

    Returns
    -------
    position_m, heading_rad
        [n, 2] and [n], metres and radians to the left, not wrapped; both begin at zero.
    """
    force, turn_rate = inertial[:, :3], inertial[:, 3:6]
    up = uniform_filter1d(force, int(_VERTICAL_S * SENSOR_HZ), axis=0, mode="nearest")
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    heading_rad = np.cumsum(np.sum(turn_rate * up, axis=-1)) / SENSOR_HZ
    heading_rad -= heading_rad[0]
    felt = gaussian_filter1d(np.linalg.norm(force, axis=-1), _SMOOTH_S * SENSOR_HZ, mode="nearest")
    from scipy.signal import find_peaks  # half a second, for which the planning of options need not wait

    steps, _ = find_peaks(
        felt - felt.mean(), height=_LEAST_PEAK_M_PER_S2, distance=int(_LEAST_STEP_S * SENSOR_HZ)
    )
    direction = np.stack([np.cos(heading_rad[steps]), np.sin(heading_rad[steps])], axis=-1)
    place_m = np.concatenate([np.zeros((1, 2)), step_m * np.cumsum(direction, axis=0)])
    at = np.concatenate([[0], steps])
    here = np.arange(len(inertial))
    return np.stack([np.interp(here, at, column) for column in place_m.T], axis=-1), heading_rad


def _walks_to_align(folder: str | Path, parts: Sequence[str], step_m: float) -> Worlds:
    _check_parts("walks", parts)
    if not (np.isfinite(step_m) and step_m > 0):
        raise InputError(
            "phone_wifi_imu_library, option step_m",
            f"{step_m!r} is not a length above zero",
            "Give that of a step",
        )
    found = []
    for part in parts:
        for number in _walks(part):
            rss_dbm, true_m = _scans(folder, [(part, number)])
            inertial = _inertial(folder, f"{WALKS[part][0]}/sens{number}.txt", len(rss_dbm))
            position_m, heading_rad = dead_reckoned(inertial, step_m)
            # The last scan is at the end of the last reading.
            at = np.minimum(SENSOR_HZ * np.arange(len(rss_dbm)), len(inertial) - 1)
            time_s = SCAN_S * np.arange(len(rss_dbm), dtype=float)
            found.append((time_s, position_m[at], heading_rad[at], rss_dbm, true_m, _direction_rad(true_m)))
    longest = max(len(time_s) for time_s, *_ in found)
    stacked = []
    for values in zip(*found, strict=True):
        filled = np.full((1, len(found), longest, *values[0].shape[1:]), np.nan)
        for number, own in enumerate(values):
            filled[0, number, : len(own)] = own
        stacked.append(filled)
    time_s, position_m, heading_rad, rss_dbm, true_m, direction_rad = stacked
    observed = Walks(time_s=time_s, position_m=position_m, heading_rad=heading_rad, rss_dbm=rss_dbm)
    truth = Truth(position_m=true_m, path_m=true_m.copy(), heading_rad=direction_rad)
    return Worlds(observed=observed.to_arrays(), truth=truth.to_arrays())


def _direction_rad(place_m: Array) -> Array:
    """Return where a walk leads at each of its places, [n], radians; where it stands, where it led before."""
    way = np.gradient(place_m, axis=0)
    goes = np.hypot(way[:, 0], way[:, 1]) > 0
    if not goes.any():
        return np.zeros(len(place_m))
    last = np.maximum.accumulate(np.where(goes, np.arange(len(goes)), -1))
    last = np.where(last < 0, np.argmax(goes), last)
    return np.asarray(np.unwrap(np.arctan2(way[last, 1], way[last, 0])))


def _check_parts(option: str, parts: Sequence[str]) -> None:
    unknown = [part for part in parts if part not in WALKS]
    if unknown or not parts or len(set(parts)) < len(parts):
        raise InputError(
            f"phone_wifi_imu_library, option {option}",
            f"{', '.join(str(part) for part in unknown or parts) or 'an empty list'} is not one or"
            f" several different ones of {', '.join(WALKS)}",
            "Correct the option",
        )


def _walks(part: str) -> range:
    return range(1, WALKS[part][1] + 1)


def _scans(folder: str | Path, walks: Sequence[tuple[str, int]]) -> tuple[Array, Array]:
    """Return strengths, [m, 22], dBm, and places, [m, 2], metres, of walks one behind the other."""
    values = np.concatenate([_read(folder, f"{WALKS[part][0]}/rss{number}.txt") for part, number in walks])
    rss_dbm = values[:, :ACCESS_POINTS]
    return np.where(rss_dbm == NOT_HEARD_DBM, np.nan, rss_dbm), values[:, ACCESS_POINTS:]


def _read(folder: str | Path, file: str) -> Array:
    path = find_file(folder, file)
    try:
        values = pd.read_csv(path, header=None, dtype=float).to_numpy()
        if values.shape[1] != ACCESS_POINTS + 2:
            raise ValueError(f"there are {values.shape[1]} columns")
        if not np.isfinite(values).all():
            raise ValueError("a cell is empty or not finite")
        if not (values[:, :ACCESS_POINTS] < 0).all():
            raise ValueError("a strength is not below 0 dBm")
    except (ValueError, TypeError) as error:
        what = f"{ACCESS_POINTS} strengths, x and y in each row"
        raise unreadable("phone_wifi_imu_library", file, what, error) from error
    return np.asarray(values)


def _inertial(folder: str | Path, file: str, scans: int) -> Array:
    path = find_file(folder, file)
    try:
        # Some files have tabs between the columns, others commas.
        with path.open(encoding="utf-8") as lines:
            separator = "\t" if "\t" in lines.readline() else ","
        values = pd.read_csv(path, header=None, dtype=float, sep=separator).to_numpy()
        if values.shape != (SENSOR_HZ * (scans - 1), INERTIAL):
            raise ValueError(f"the shape is {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError("a cell is empty or not finite")
    except (ValueError, TypeError) as error:
        what = f"{INERTIAL} readings in each of {SENSOR_HZ} rows between two scans"
        raise unreadable("phone_wifi_imu_library", file, what, error) from error
    return np.asarray(values)
