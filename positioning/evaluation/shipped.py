"""Rows that the project ships, ``data/algorithms.csv``; every other row is somebody's own, and new."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd


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
    tasks = {row: str(entry.get("task", "fingerprinting")) for row, entry in entries.items()}
    return {row for row, task in tasks.items() if (task, row) not in shipped}
