"""What the entries of a study's rows tell: task and protocol, and which rows the project does not ship."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd


def protocol_of(entry: Mapping[str, Any]) -> str:
    """Return how a row is tested where the configuration says so, else nothing."""
    return str(entry.get("options", entry).get("protocol", ""))


def task_of(entry: Mapping[str, Any]) -> str:
    """Return the task of a row; a plan that does not say it has fingerprinting alone."""
    return str(entry.get("task", "fingerprinting"))


def read_shipped(path: str | Path) -> set[tuple[str, str]]:
    """Return task and name of the rows that are not new.

    Parameters
    ----------
    path
        A CSV with the columns ``task`` and ``algorithm``.
    """
    known = pd.read_csv(path, dtype=str)
    return set(zip(known["task"], known["algorithm"], strict=True))


def new_rows(entries: Mapping[str, Mapping[str, Any]], shipped: set[tuple[str, str]]) -> set[str]:
    """Return the rows of a study that are not among those the project ships.

    Parameters
    ----------
    entries
        Settings by row; of them ``task`` is read, fingerprinting where none is told.
    shipped
        Task and name of rows that are not new.
    """
    return {row for row, entry in entries.items() if (task_of(entry), row) not in shipped}
