"""A phone that is carried through a library and scans 22 Wi-Fi access points once a second.

Published by Z. Xu: eight walks to make a map of, and sixteen to locate.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.model import Array, Query, Recording, Site, Survey, Truth, Worlds
from positioning.recordings.register import find_file

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


def load(
    folder: str | Path,
    *,
    map: str | Sequence[str] = ("final1", "final2"),
    query: str | Sequence[str] = "t1",
    run: int | None = None,
) -> Worlds:
    """Load a map, and the scans of other walks to locate.

    Every scan of the walks of the map is a fingerprint of its own; none has a second scan at its place. The
    places of both were interpolated by the publisher at constant speed between known points: they are good
    to about 1 m, and so is every error below that.

    With ``run`` the scans are those of one walk, and stand there a second time as a recording: one epoch a
    scan, a second apart. The readings of the phone's inertial sensors are not read: it is held in the hand
    and has no stances. Nor are the start and its direction given, as nobody noted them.

    Parameters
    ----------
    folder
        The folder of the folders of the files.
    map, query
        One or several of ``final1``, ``final2``, ``t1``, ``t2`` and ``t3``; none may be in both.
    run
        Which walk of the query to locate, from 1; None for all of them, which then are no recording.

    Returns
    -------
    Worlds
        One world: ``survey.rss_dbm`` [1, p, 22], NaN where an access point was not heard,
        ``survey.position_m`` [1, p, 2], ``query.rss_dbm`` [1, m, 22], ``site.corner_m`` [1, 2, 2], the box
        around the survey, with ``run`` ``recording.time_s`` [1, m] and ``recording.rss_dbm`` [1, m, 22], the
        query's, and as truth ``truth.position_m`` [1, m, 2].

    Raises
    ------
    InputError
        For an option that does not exist, a query that is part of the map, a run that is none of one
        query's, or a file that is missing or is not this data set's.
    """
    maps, queries = ([part] if isinstance(part, str) else list(part) for part in (map, query))
    for option, parts in (("map", maps), ("query", queries)):
        unknown = [part for part in parts if part not in WALKS]
        if unknown or not parts or len(set(parts)) < len(parts):
            raise InputError(
                f"phone_wifi_imu_library, option {option}",
                f"{', '.join(str(part) for part in unknown or parts) or 'an empty list'} is not one or"
                f" several different ones of {', '.join(WALKS)}",
                "Correct the option",
            )
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
        raise InputError(
            f"phone_wifi_imu_library, file {file}",
            f"{ACCESS_POINTS} strengths, x and y in each row cannot be read ({str(error).rstrip('.')})",
            "Use the registered file of data/sources.csv",
        ) from error
    return np.asarray(values)
