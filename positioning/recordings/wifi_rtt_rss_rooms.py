"""Wi-Fi surveys of a lecture theatre and a corridor: about 115 points each, four or five access points.

Measured by X. Feng, K. A. Nguyen and Z. Luo (2024): 60 scans at every point of a 0.6 m grid, and the
places of the access points. Only received signal strength is used, not the round-trip times.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.model import Site, Survey, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

AREAS = ("lecture_theatre", "corridor")
SCANS = ("mean", "first")
GRID_M = 0.6
"""Side of the survey grid; the files give grid units."""

NOT_HEARD_DBM = -200.0
"""The files' mark for an access point that was not heard."""


def load(folder: str | Path, *, area: str = "lecture_theatre", scans: str = "mean") -> Worlds:
    """Load the survey of one area, one fingerprint a reference point.

    The authors' training and test points are pooled, training first: 120 points in the lecture
    theatre, 114 in the corridor, to be located by leaving one out. The columns are the access
    points whose place is known. In the corridor that leaves out AP1, which is heard nowhere: its
    four places belong to AP2 to AP5.

    Parameters
    ----------
    folder
        The folder of the files.
    area
        ``lecture_theatre`` (line of sight) or ``corridor`` (mixed).
    scans
        ``mean``: the mean in dBm of those of a point's 60 scans that heard the access point;
        ``first``: a point's first scan, as a walking user would have it.

    Returns
    -------
    Worlds
        One world: ``survey.rss_dbm`` [1, n, ap], ``survey.position_m`` [1, n, 2],
        ``site.corner_m`` [1, 2, 2], ``site.access_point_m`` [1, ap, 2], and the same positions
        as ``truth.position_m``. Metres, origin at the grid's origin.

    Raises
    ------
    InputError
        For an option that does not exist, or a file that is missing or is not this data set's.
    """
    for name, option, known in (("area", area, AREAS), ("scans", scans, SCANS)):
        if option not in known:
            raise InputError(
                f"wifi_rtt_rss_rooms, option {name}",
                f"{option!r} is none of {', '.join(known)}",
                "Correct the option",
            )
    place = _read(folder, f"ap_position_{area}.csv", ["ap", "x", "y"])
    rss_columns = [f"AP{number:.0f} RSS(dBm)" for number in place["ap"]]
    columns = ["X", "Y", *rss_columns]
    scan = pd.concat([_read(folder, f"database_{area}_{part}.csv", columns) for part in ("train", "test")])
    scan[rss_columns] = scan[rss_columns].mask(scan[rss_columns] == NOT_HEARD_DBM)
    if scans == "mean":
        point = scan.groupby(["X", "Y"], sort=False, as_index=False).mean()
    else:
        point = scan.drop_duplicates(["X", "Y"])

    position_m = GRID_M * point[["X", "Y"]].to_numpy(dtype=float)[None]
    survey = Survey(rss_dbm=point[rss_columns].to_numpy(dtype=float)[None], position_m=position_m).check(area)
    site = Site(
        corner_m=np.stack([position_m.min(axis=1), position_m.max(axis=1)], axis=1),
        access_point_m=GRID_M * place[["x", "y"]].to_numpy(dtype=float)[None],
    )
    truth = Truth(position_m=position_m.copy())
    return Worlds(observed={**survey.to_arrays(), **site.to_arrays()}, truth=truth.to_arrays())


def _read(folder: str | Path, file: str, columns: list[str]) -> pd.DataFrame:
    try:
        return pd.read_csv(find_file(folder, file), usecols=columns, dtype=float)[columns]
    except (ValueError, UnicodeError) as error:
        if isinstance(error, InputError):
            raise
        raise unreadable("wifi_rtt_rss_rooms", file, f"the columns {', '.join(columns)}", error) from error
