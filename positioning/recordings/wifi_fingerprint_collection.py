"""Five public sets of Wi-Fi fingerprints from buildings with one to five floors, split by their authors.

Re-issued together by D. Quezada-Gaibor, J. Torres-Sospedra and others; ``data/sources.csv`` names the
groups that measured them. Floors are not told apart: positions and errors are horizontal.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.model import Array, Query, Site, Survey, Truth, Worlds
from positioning.recordings.mat_file import read_mat
from positioning.recordings.register import find_file

NAMES = ("DSI1", "LIB1", "TUT1", "TUT3", "UJI1")
SCANS = ("all", "mean")
NOT_HEARD_DBM = 100.0
"""The files' mark for an access point that was not heard."""

GROUND_METRES_PER_UNIT = {"UJI1": 0.766}
"""Sets whose coordinates are no ground metres. UJI1's are Web Mercator metres at a latitude of 40.0
degrees, which are too long by 1 / cos(latitude); the literature quotes its errors in those."""

_FIELDS = ("trainingMacs", "trainingLabels", "testMacs", "testLabels")


def load(folder: str | Path, *, name: str, scans: str = "all") -> Worlds:
    """Load one set: the authors' training rows are the survey, their test rows the query.

    An access point that was never heard in training keeps its column, all NaN. A position of the
    survey may have many rows (directions, devices, repeated scans).

    Parameters
    ----------
    folder
        The folder of the files.
    name
        ``DSI1``, ``LIB1``, ``TUT1``, ``TUT3`` or ``UJI1``. The last one is brought to ground metres
        with its origin at the lower left corner of the survey; the others keep their own frame.
    scans
        ``all``: the survey as it is; ``mean``: one row for every position of every floor, the mean
        in dBm over its scans, in which an access point that was not heard counts as 1 dB below the
        set's weakest reading. A mean of heard readings alone would make one that a single scan
        heard as strong as one that all heard. The query always stays as it is: a user has one scan.

    Returns
    -------
    Worlds
        One world: ``survey.rss_dbm`` [1, n, ap], ``survey.position_m`` [1, n, 2], ``query.rss_dbm``
        [1, m, ap], ``site.corner_m`` [1, 2, 2], and ``truth.position_m`` [1, m, 2] of the query.

    Raises
    ------
    InputError
        For an option that does not exist, or a file that is missing or is not this data set's.
    """
    for option, value, known in (("name", name, NAMES), ("scans", scans, SCANS)):
        if value not in known:
            raise InputError(
                f"wifi_fingerprint_collection, option {option}",
                f"{value!r} is none of {', '.join(known)}",
                "Correct the option",
            )
    survey_rss_dbm, survey_label, query_rss_dbm, query_label = _read(folder, f"{name}.mat")
    if scans == "mean":
        # The label is x, y, height, floor, building: places above each other stay apart.
        label_columns = list(range(survey_label.shape[1]))
        heard = ~np.isnan(survey_rss_dbm)
        filled_dbm = np.where(heard, survey_rss_dbm, np.nanmin(survey_rss_dbm) - 1.0)
        row = pd.DataFrame(np.hstack([survey_label, filled_dbm, heard]))
        mean = row.groupby(label_columns, sort=False, as_index=False).mean().to_numpy(dtype=float)
        columns = len(label_columns)
        survey_label, filled_dbm, share = np.split(mean, [columns, columns + heard.shape[1]], axis=1)
        survey_rss_dbm = np.where(share > 0, filled_dbm, np.nan)

    survey_position_m, query_position_m = survey_label[:, :2], query_label[:, :2]
    if name in GROUND_METRES_PER_UNIT:
        origin = survey_position_m.min(axis=0)
        survey_position_m, query_position_m = (
            GROUND_METRES_PER_UNIT[name] * (position - origin)
            for position in (survey_position_m, query_position_m)
        )
    corner_m = np.stack([survey_position_m.min(axis=0), survey_position_m.max(axis=0)])
    survey = Survey(rss_dbm=survey_rss_dbm[None], position_m=survey_position_m[None]).check(name)
    # The same rules hold for the query: it is checked as a survey of its own.
    asked = Survey(rss_dbm=query_rss_dbm[None], position_m=query_position_m[None]).check(
        f"{name}, query", least=1
    )
    query, truth = Query(rss_dbm=asked.rss_dbm), Truth(position_m=asked.position_m)
    site = Site(corner_m=corner_m[None])
    return Worlds(
        observed={**survey.to_arrays(), **site.to_arrays(), **query.to_arrays()}, truth=truth.to_arrays()
    )


def _read(folder: str | Path, file: str) -> list[Array]:
    """Return survey strengths and labels, then those of the query; NaN for what was not heard."""
    path = find_file(folder, file)
    try:
        database = read_mat(path, squeeze=True)["database"]
        # Some fields are 16-bit integers, whose squared differences overflow.
        arrays = [np.asarray(getattr(database, field), dtype=float) for field in _FIELDS]
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise InputError(
            f"wifi_fingerprint_collection, file {file}",
            f"it holds no struct 'database' with {', '.join(_FIELDS)} ({type(error).__name__})",
            "Use the registered file of data/sources.csv",
        ) from error
    return [
        np.where(values == NOT_HEARD_DBM, np.nan, values) if index % 2 == 0 else values
        for index, values in enumerate(arrays)
    ]
