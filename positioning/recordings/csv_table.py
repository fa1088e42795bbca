"""Tables of a user's own as CSV: reading them, and errors that name file, row and column.

The first row names the columns, cells are separated by commas, decimals have a point, the text is UTF-8. An
empty cell, or NaN, in a column of received strengths says that nothing was heard.
"""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array
from positioning.recordings.register import find_file

POSITION_COLUMNS = ("x_m", "y_m")
RSS_ENDING = "_dbm"
RSS_LIMIT_DBM = (-150.0, 30.0)
"""Anything beyond is no received strength but a mark, such as 100 or -200 for *not heard*."""

Mask = NDArray[np.bool_]


class Quantity(NamedTuple):
    """What the cells of a column may hold.

    Attributes
    ----------
    fault
        Marks the numbers that a column must not hold; an empty cell is NaN.
    limit
        What is needed instead.
    cure
        What the user can do about it.
    """

    fault: Callable[[Array], Mask]
    limit: str
    cure: str


def _rss_fault(rss_dbm: Array) -> Mask:
    low, high = RSS_LIMIT_DBM
    return (rss_dbm < low) | (rss_dbm > high)


def not_finite(number: Array) -> Mask:
    """Mark what is no finite number, empty cells too."""
    return ~np.isfinite(number)


POSITION = Quantity(not_finite, "a finite coordinate in metres is needed", "Fill the cell, or remove the row")
RSS = Quantity(
    _rss_fault,
    f"a received strength between {RSS_LIMIT_DBM[0]:g} and {RSS_LIMIT_DBM[1]:g} dBm is needed",
    "Leave the cell empty where nothing was heard",
)


class Table(NamedTuple):
    """A table as text.

    Attributes
    ----------
    file
        Its name, for errors.
    column
        Where each column stands.
    rows
        Row number in the file, as a spreadsheet counts, and the cells.
    """

    file: str
    column: dict[str, int]
    rows: list[tuple[int, list[str]]]

    def numbers(self, names: Sequence[str], quantity: Quantity) -> Array:
        """Return columns as numbers, [n, names]; an empty cell becomes NaN.

        Raises
        ------
        InputError
            For the first cell that is no number, or not what the quantity allows.
        """
        positions = [self.column[name] for name in names]
        text = np.array([[cells[position] or "nan" for position in positions] for _, cells in self.rows])
        try:
            number = text.astype(float)
        except ValueError:
            is_number = np.array([[_is_number(cell) for cell in line] for line in text])
            row, place = np.argwhere(~is_number)[0]
            raise InputError(
                self.cell(row, names[place]),
                f"{str(text[row, place])!r} is no number",
                "Write numbers with a decimal point, and leave the cell empty where nothing was heard",
            ) from None
        bad = quantity.fault(number)
        if bad.any():
            row, place = np.argwhere(bad)[0]
            cell = self.rows[row][1][positions[place]]
            raise InputError(
                self.cell(row, names[place]),
                f"the cell {'is empty' if not cell else f'holds {cell}'}, {quantity.limit}",
                quantity.cure,
            )
        return number

    def cell(self, row: int, name: str) -> str:
        """Name a cell for an error; rows count from 0 here."""
        return f"{self.file}, row {self.rows[row][0]}, column {name}"

    def require(self, names: Sequence[str], cure: str) -> None:
        """Refuse a table without one of these columns.

        Raises
        ------
        InputError
            Naming the first that is missing.
        """
        for name in names:
            if name not in self.column:
                raise InputError(
                    f"{self.file}, row 1, column {name}",
                    f"it is missing, the columns are {', '.join(self.column)}",
                    cure,
                )

    def rss_columns(self, others: Sequence[str], heard: str) -> list[str]:
        """Return the columns of received strengths, in their order.

        Parameters
        ----------
        others
            All other columns that the table may have.
        heard
            What is heard, for errors: access point or beacon.

        Raises
        ------
        InputError
            For a column that is neither, or a table without strengths.
        """
        found = [name for name in self.column if name not in others]
        for name in found:
            if not name.removesuffix(RSS_ENDING) or not name.endswith(RSS_ENDING):
                raise InputError(
                    f"{self.file}, row 1, column {name}",
                    f"it is neither {' nor '.join(others)}, nor a name that ends in {RSS_ENDING}",
                    f"Let the columns of {heard}s end in {RSS_ENDING}, and remove others",
                )
        if not found:
            raise InputError(
                f"{self.file}, row 1", f"no column ends in {RSS_ENDING}", f"Give each {heard} a column"
            )
        return found


def read_table(folder: str | Path, file: str, row: str) -> Table:
    """Read a table as text.

    Parameters
    ----------
    folder, file
        Where it stands.
    row
        What a row is, for the error about a table without any.

    Raises
    ------
    InputError
        For a file that is missing, no text, or without rows, a column that stands there twice, and a row
        that is longer or shorter than the header.
    """
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
            f"the file has {len(rows)} row(s), a header and at least one {row} are needed",
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
    return Table(file, {name: position for position, name in enumerate(header)}, body)


def read_places(folder: str | Path, file: str, heard_in: str, rss_columns: Sequence[str], cure: str) -> Array:
    """Return the places of access points in the order of the columns in which they are heard.

    Parameters
    ----------
    folder, file
        A table with the columns ``name``, ``x_m``, ``y_m``; others, and other access points, are ignored.
    heard_in
        The file of the columns, for errors.
    rss_columns
        These columns, ``<name>_dbm`` each.
    cure
        What to do about an access point that is missing.

    Returns
    -------
    Array
        [ap, 2], metres.

    Raises
    ------
    InputError
        For what `read_table` refuses, a column or an access point that is missing or stands there twice,
        and a place that is not a finite number.
    """
    table = read_table(folder, file, "access point")
    table.require(("name", *POSITION_COLUMNS), "Name the columns name, x_m and y_m")
    position_m = table.numbers(POSITION_COLUMNS, POSITION)
    index: dict[str, int] = {}
    for order, (_, cells) in enumerate(table.rows):
        name = cells[table.column["name"]]
        if name in index:
            raise InputError(table.cell(order, "name"), f"{name!r} stands there twice", "Remove one row")
        index[name] = order
    wanted = [name.removesuffix(RSS_ENDING) for name in rss_columns]
    for name in wanted:
        if name not in index:
            raise InputError(
                f"{file}, column name",
                f"{name!r} is missing, {heard_in} has a column {name}{RSS_ENDING}",
                cure,
            )
    return position_m[[index[name] for name in wanted]]


def _is_number(cell: str) -> bool:
    try:
        np.array([cell]).astype(float)
    except ValueError:
        return False
    return True
