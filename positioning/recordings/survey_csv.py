"""A survey of one's own, from a plain table: where each scan was taken, and what it heard.

The first row names the columns: ``x_m``, ``y_m``, and one column an access point that ends in ``_dbm``.
An empty cell, or NaN, says that the access point was not heard.
"""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array, Query, Site, Survey, Truth, Worlds
from positioning.recordings.register import find_file

POSITION_COLUMNS = ("x_m", "y_m")
RSS_ENDING = "_dbm"
RSS_LIMIT_DBM = (-150.0, 30.0)
"""Anything beyond is no received strength but a mark, such as 100 or -200 for *not heard*."""

Mask = NDArray[np.bool_]
Rows = list[tuple[int, list[str]]]
"""Row number in the file, as a spreadsheet counts, and the cells."""


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
    column, rows = _read(folder, file)
    rss_columns = _rss_columns(file, list(column))
    survey = Survey(
        rss_dbm=_numbers(file, column, rows, rss_columns, _rss_fault)[None],
        position_m=_numbers(file, column, rows, POSITION_COLUMNS, _position_fault)[None],
    ).check(file)
    observed, position_m = survey.to_arrays(), survey.position_m

    if queries is not None:
        column, rows = _read(folder, queries)
        _rss_columns(queries, list(column))
        different = sorted(set(column) ^ {*POSITION_COLUMNS, *rss_columns})
        if different:
            has = queries if different[0] in column else file
            raise InputError(
                f"{queries}, column {different[0]}",
                f"only {has} has it, both files need the same columns",
                "Add the column, with empty cells where it was not heard, or remove it",
            )
        query = Query(rss_dbm=_numbers(queries, column, rows, rss_columns, _rss_fault)[None])
        position_m = _numbers(queries, column, rows, POSITION_COLUMNS, _position_fault)[None]
        Survey(rss_dbm=query.rss_dbm, position_m=position_m).check(queries, least=1)
        observed |= query.to_arrays()

    place_m = None if access_points is None else _places(folder, access_points, file, rss_columns)[None]
    corner_m = np.stack([survey.position_m.min(axis=1), survey.position_m.max(axis=1)], axis=1)
    site = Site(corner_m=corner_m, access_point_m=place_m)
    return Worlds(observed=observed | site.to_arrays(), truth=Truth(position_m=position_m.copy()).to_arrays())


def _read(folder: str | Path, file: str) -> tuple[dict[str, int], Rows]:
    """Return where each column stands, and the rows."""
    with find_file(folder, file).open(newline="", encoding="utf-8-sig") as handle:
        reader = csv.reader(handle)
        try:
            rows = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if cells]
        except (UnicodeDecodeError, csv.Error) as error:
            limit = f"it is no text table ({error})"
            raise InputError(file, limit, "Save the table as CSV in UTF-8") from error
    if len(rows) < 2:
        raise InputError(
            file,
            f"the file has {len(rows)} row(s), a header and at least one scan are needed",
            "Export the table again",
        )
    (_, header), *body = rows
    for position, name in enumerate(header):
        if name in header[:position]:
            raise InputError(f"{file}, row 1, column {name}", "it stands there twice", "Rename or remove one")
    for number, cells in body:
        if len(cells) != len(header):
            first = header[len(cells)] if len(cells) < len(header) else f"after {header[-1]}"
            raise InputError(
                f"{file}, row {number}, column {first}",
                f"the row has {len(cells)} cells, the header {len(header)}",
                "Keep a comma for every column, also before an empty cell, and write decimals with a point",
            )
    return {name: position for position, name in enumerate(header)}, body


def _rss_columns(file: str, header: list[str]) -> list[str]:
    """Return the columns of the access points, after a check of all names."""
    for name in POSITION_COLUMNS:
        if name not in header:
            raise InputError(
                f"{file}, row 1, column {name}",
                f"it is missing, the columns are {', '.join(header)}",
                "Name the coordinates x_m and y_m, in metres, and separate the cells by commas",
            )
    rss_columns = [name for name in header if name not in POSITION_COLUMNS]
    for name in rss_columns:
        if not name.removesuffix(RSS_ENDING) or not name.endswith(RSS_ENDING):
            raise InputError(
                f"{file}, row 1, column {name}",
                f"it is neither {' nor '.join(POSITION_COLUMNS)}, nor a name that ends in {RSS_ENDING}",
                f"Let the columns of access points end in {RSS_ENDING}, and remove others",
            )
    if not rss_columns:
        raise InputError(
            f"{file}, row 1", f"no column ends in {RSS_ENDING}", "Give each access point a column"
        )
    return rss_columns


def _numbers(
    file: str,
    column: dict[str, int],
    rows: Rows,
    names: tuple[str, ...] | list[str],
    fault: Callable[[Array], Mask],
) -> Array:
    """Return columns as numbers [n, names]; an empty cell becomes NaN.

    ``fault`` marks the numbers that the columns must not hold.
    """
    positions = [column[name] for name in names]
    text = np.array([[cells[position] or "nan" for position in positions] for _, cells in rows])
    try:
        number = text.astype(float)
    except ValueError:
        is_number = np.array([[_is_number(cell) for cell in line] for line in text])
        row, place = np.argwhere(~is_number)[0]
        raise InputError(
            f"{file}, row {rows[row][0]}, column {names[place]}",
            f"{str(text[row, place])!r} is no number",
            "Write numbers with a decimal point, and leave the cell empty where nothing was heard",
        ) from None
    bad = fault(number)
    if bad.any():
        row, place = np.argwhere(bad)[0]
        cell = rows[row][1][positions[place]]
        limit, cure = (
            ("a finite coordinate in metres is needed", "Fill the cell, or remove the row")
            if names[place] in POSITION_COLUMNS
            else (
                f"a received strength between {RSS_LIMIT_DBM[0]:g} and {RSS_LIMIT_DBM[1]:g} dBm is needed",
                "Leave the cell empty where the access point was not heard",
            )
        )
        raise InputError(
            f"{file}, row {rows[row][0]}, column {names[place]}",
            f"the cell {'is empty' if not cell else f'holds {cell}'}, {limit}",
            cure,
        )
    return number


def _places(folder: str | Path, file: str, survey_file: str, rss_columns: list[str]) -> Array:
    """Return the places of the access points in the order of the survey's columns, [ap, 2]."""
    column, rows = _read(folder, file)
    for name in ("name", *POSITION_COLUMNS):
        if name not in column:
            raise InputError(
                f"{file}, row 1, column {name}",
                f"it is missing, the columns are {', '.join(column)}",
                "Name the columns name, x_m and y_m",
            )
    position_m = _numbers(file, column, rows, POSITION_COLUMNS, _position_fault)
    index: dict[str, int] = {}
    for order, (number, cells) in enumerate(rows):
        name = cells[column["name"]]
        if name in index:
            raise InputError(
                f"{file}, row {number}, column name", f"{name!r} stands there twice", "Remove one row"
            )
        index[name] = order
    wanted = [name.removesuffix(RSS_ENDING) for name in rss_columns]
    for name in wanted:
        if name not in index:
            raise InputError(
                f"{file}, column name",
                f"{name!r} is missing, {survey_file} has a column {name}{RSS_ENDING}",
                "Add its row, or leave the option access_points out",
            )
    return position_m[[index[name] for name in wanted]]


def _position_fault(position_m: Array) -> Mask:
    return ~np.isfinite(position_m)


def _rss_fault(rss_dbm: Array) -> Mask:
    low, high = RSS_LIMIT_DBM
    return (rss_dbm < low) | (rss_dbm > high)


def _is_number(cell: str) -> bool:
    try:
        np.array([cell]).astype(float)
    except ValueError:
        return False
    return True
