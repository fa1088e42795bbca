"""A survey of one's own, from a plain table: where each scan was taken, and what it heard.

The first row names the columns: ``x_m``, ``y_m``, and one column an access point that ends in ``_dbm``.
An empty cell, or NaN, says that the access point was not heard.
"""

from pathlib import Path

import numpy as np

from positioning.errors import InputError
from positioning.model import Query, Site, Survey, Truth, Worlds
from positioning.recordings.csv_table import POSITION, POSITION_COLUMNS, RSS, Table, read_places, read_table


def load(
    folder: str | Path,
    *,
    file: str = "survey.csv",
    queries: str | None = None,
    access_points: str | None = None,
) -> Worlds:
    """Load a survey, and where they exist the queries to locate with it.

    Without queries the survey's own rows are located, each by those taken at other places; several
    scans of one place are known by exactly equal coordinates.

    Parameters
    ----------
    folder
        The folder of the files.
    file
        The survey: ``x_m``, ``y_m`` in metres, and for each access point a column ``<name>_dbm``.
    queries
        A second file with the same columns, in any order, whose rows are to be located; their
        ``x_m`` and ``y_m`` are the truth.
    access_points
        A file with the columns ``name``, ``x_m``, ``y_m``: the place of every access point of the
        survey, in any order. Others in it are ignored.

    Returns
    -------
    Worlds
        One world: ``survey.rss_dbm`` [1, n, ap] in the order of the columns, ``survey.position_m``
        [1, n, 2], ``site.corner_m`` [1, 2, 2] and ``truth.position_m`` [1, n, 2]. With queries also
        ``query.rss_dbm`` [1, m, ap], and the truth is theirs; with access points also
        ``site.access_point_m`` [1, ap, 2].

    Raises
    ------
    InputError
        For a file that is missing or empty, wrong column names, and cells that are no number, not
        finite or no received strength; it names file, row (the header is row 1) and column.
    """
    table, rss_columns = _read(folder, file)
    survey = Survey(
        rss_dbm=table.numbers(rss_columns, RSS)[None],
        position_m=table.numbers(POSITION_COLUMNS, POSITION)[None],
    ).check(file)
    observed, position_m = survey.to_arrays(), survey.position_m

    if queries is not None:
        asked, _ = _read(folder, queries)
        different = sorted(set(asked.column) ^ set(table.column))
        if different:
            has = queries if different[0] in asked.column else file
            raise InputError(
                f"{queries}, column {different[0]}",
                f"only {has} has it, both files need the same columns",
                "Add the column, with empty cells where it was not heard, or remove it",
            )
        query = Query(rss_dbm=asked.numbers(rss_columns, RSS)[None])
        position_m = asked.numbers(POSITION_COLUMNS, POSITION)[None]
        Survey(rss_dbm=query.rss_dbm, position_m=position_m).check(queries, least=1)
        observed |= query.to_arrays()

    place_m = None
    if access_points is not None:
        cure = "Add its row, or leave the option access_points out"
        place_m = read_places(folder, access_points, file, rss_columns, cure)[None]
    corner_m = np.stack([survey.position_m.min(axis=1), survey.position_m.max(axis=1)], axis=1)
    site = Site(corner_m=corner_m, access_point_m=place_m)
    return Worlds(observed=observed | site.to_arrays(), truth=Truth(position_m=position_m.copy()).to_arrays())


def _read(folder: str | Path, file: str) -> tuple[Table, list[str]]:
    """Return a table of scans, and the columns of its access points."""
    table = read_table(folder, file, "scan")
    table.require(
        POSITION_COLUMNS, "Name the coordinates x_m and y_m, in metres, and separate the cells by commas"
    )
    return table, table.rss_columns(POSITION_COLUMNS, "access point")
