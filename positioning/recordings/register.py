"""The register of data sets: which files of other people's measurements are used, and that they are those.

The measurements themselves stay outside the project, one folder a source; ``data/sources.csv`` holds
what is needed to get them, to cite them, and to notice a file that is not the registered one.
"""

import csv
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from positioning.errors import InputError

REGISTER = Path(__file__).resolve().parents[2] / "data" / "sources.csv"
"""The project's own register."""

KINDS = ("real", "synthetic")


@dataclass(frozen=True, kw_only=True)
class Record:
    """One file of one source, as the register has it.

    Attributes
    ----------
    source
        The data set: the name of its folder.
    file
        The file, relative to that folder.
    kind
        ``real`` or ``synthetic``.
    licence
        The terms under which the file may be used.
    version
        The release or commit.
    sha256
        The digest, 64 hexadecimal digits in small letters.
    bytes
        The length.
    where_from
        Where a reader gets the file: a repository (owner/name and folder) or a DOI.
    cite
        Whom to cite, in a few words.
    """

    source: str
    file: str
    kind: str
    licence: str
    version: str
    sha256: str
    bytes: int
    where_from: str
    cite: str


COLUMNS = tuple(field.name for field in fields(Record))


def read_register(path: str | Path = REGISTER) -> list[Record]:
    """Read the register of data sets.

    Parameters
    ----------
    path
        A CSV file with the columns of `Record`, in that order.

    Returns
    -------
    list of Record
        One a file, in the order of the register.

    Raises
    ------
    InputError
        For other columns, an empty cell, a kind, digest or length that is none, or a file that
        stands there twice; it names row (the header is row 1) and column.
    """
    path = Path(path)
    with find_file(path.parent, path.name).open(newline="", encoding="utf-8") as handle:
        reader = csv.reader(handle)
        header = next(reader, [])
        if tuple(header) != COLUMNS:
            raise InputError(
                f"{path.name}, row 1",
                f"the columns are {', '.join(header) or 'missing'}; {', '.join(COLUMNS)} are needed",
                "Correct the header",
            )
        rows = [(reader.line_num, cells) for cells in reader if cells]
    records: dict[tuple[str, str], Record] = {}
    for number, cells in rows:
        row = f"{path.name}, row {number}"
        if len(cells) != len(COLUMNS):
            raise InputError(
                row,
                f"it has {len(cells)} cells, {len(COLUMNS)} are needed",
                "Put cells that hold a comma in quotation marks",
            )
        value = dict(zip(COLUMNS, (cell.strip() for cell in cells), strict=True))
        for column, cell in value.items():
            limit, cure = _fault(column, cell)
            if limit:
                raise InputError(f"{row}, column {column}", f"{cell!r} {limit}", cure)
        record = Record(**{**value, "bytes": int(value["bytes"])})  # type: ignore[arg-type]
        key = (record.source, record.file)
        if key in records:
            raise InputError(
                row, f"{record.file} of {record.source} stands there twice", "Remove one of the rows"
            )
        records[key] = record
    return list(records.values())


def check_files(
    folder: str | Path, source: str, files: Sequence[str] | None = None, *, register: str | Path = REGISTER
) -> list[Record]:
    """Check that the files of a source are there, and are those of the register.

    A source without a row in the register, such as a user's own survey, is only checked for
    being there: the answer is then empty.

    Parameters
    ----------
    folder
        The folder of the source.
    source
        The name of the source in the register.
    files
        The files to check, relative to the folder; None for all that are registered.
    register
        The register.

    Returns
    -------
    list of Record
        The registered records of the files that were checked.

    Raises
    ------
    InputError
        For a file that is missing, that differs from the registered one, or that is not
        registered though its source is.
    """
    registered = {record.file: record for record in read_register(register) if record.source == source}
    checked = []
    for file in registered if files is None else files:
        path = find_file(folder, file)
        if not registered:
            continue
        if file not in registered:
            raise InputError(
                f"{source}, file {file}",
                f"it is not in {Path(register).name}, which registers {', '.join(registered)}",
                "Add a row for it, or correct the file name",
            )
        record = registered[file]
        with path.open("rb") as handle:
            found = hashlib.file_digest(handle, "sha256").hexdigest()
        if found != record.sha256:
            raise InputError(
                f"{source}, file {file}",
                f"its sha256 is {found}, the register has {record.sha256}",
                f"Get version {record.version} from {record.where_from}, or register this file under"
                " its own version",
            )
        checked.append(record)
    return checked


def find_file(folder: str | Path, file: str) -> Path:
    """Return the path of a file of a source.

    Parameters
    ----------
    folder
        The folder of the source.
    file
        The file, relative to that folder.

    Returns
    -------
    Path
        Of a file that exists.

    Raises
    ------
    InputError
        For a folder or a file that does not exist.
    """
    path = Path(folder) / file
    if not path.parent.is_dir():
        raise InputError(
            str(path.parent), "there is no such folder", "Put the data there, or correct the folder"
        )
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Put the file there, or correct its name")
    return path


def unreadable(source: str, file: str, what: str, error: Exception | str) -> InputError:
    """Return the error of an adapter whose registered file is damaged, or is another one.

    Parameters
    ----------
    source
        The data set.
    file
        The file, relative to the folder of the source.
    what
        What was to be read from it: ``the columns x_m, y_m``.
    error
        What is wrong with it.
    """
    return InputError(
        f"{source}, file {file}",
        f"{what} cannot be read ({str(error).rstrip('.')})",
        "Use the registered file of data/sources.csv",
    )


def _fault(column: str, cell: str) -> tuple[str, str]:
    """Say what is wrong with a cell and what helps; empty where nothing is."""
    if not cell:
        return "is empty", "Fill the cell"
    if column == "kind" and cell not in KINDS:
        return f"is none of {', '.join(KINDS)}", "Correct the cell"
    if column == "sha256" and not re.fullmatch("[0-9a-f]{64}", cell):
        return "is no sha256: 64 hexadecimal digits in small letters", "Paste what sha256sum prints"
    if column == "bytes" and not re.fullmatch("[1-9][0-9]*", cell):
        return "is no length in bytes", "Write a whole number above zero"
    return "", ""
