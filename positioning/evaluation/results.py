"""Reads what the workflow made of a study, for comparisons, claims, figures and pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.files import Tree, read_errors, read_tree


def read_row_errors(paths: Sequence[str]) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the raw errors of one algorithm over all batches, and the families that it skipped."""
    frames: list[pd.DataFrame] = []
    skipped: dict[str, str] = {}
    for path in sorted(paths):
        columns, reasons = read_errors(path)
        frames.append(pd.DataFrame(columns))
        skipped |= reasons
    return pd.concat(frames, ignore_index=True), skipped


def read_row_times(paths: Sequence[str], row: str) -> pd.DataFrame:
    """Return the seconds that one algorithm spent: ``family, algorithm, value, world, seconds``."""
    parts = []
    for path in sorted(paths):
        for branch, step in read_tree(path, only=("world", "value", "seconds")).items():
            if len(step["seconds"]):
                parts.append(
                    pd.DataFrame(
                        {
                            "family": branch.rpartition("/")[0],
                            "algorithm": row,
                            "value": float(step["value"]),
                            "world": step["world"],
                            "seconds": step["seconds"],
                        }
                    )
                )
    columns = ["family", "algorithm", "value", "world", "seconds"]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def read_stacks(paths: Sequence[str]) -> dict[str, Tree]:
    """Return archives by path, for a study's own measures."""
    return {path: read_tree(path) for path in sorted(paths)}


@dataclass(frozen=True)
class StudyResults:
    """All that figures and pages of a study may draw on.

    Attributes
    ----------
    study
        Its name.
    rows
        Algorithms of the table, in order.
    sweeps
        Name to the setting swept and its values.
    measures
        One value a world: ``family, algorithm, value, world, metric, x``.
    error_files
        Raw errors of all rows and sweeps.
    observed, truth
        The first batch of worlds, for drawing one of them.
    paper
        What the paper reports: settings, claims, readings.
    estimate_files
        Estimates of the rows of the table for the first batch of worlds.
    settings
        Parameters of the rows of the table, those left out with their defaults.
    """

    study: str
    rows: tuple[str, ...]
    sweeps: dict[str, tuple[str, tuple[float, ...]]]
    measures: pd.DataFrame
    error_files: tuple[str, ...]
    observed: Tree
    truth: Tree
    paper: dict[str, Any] = field(default_factory=dict)
    estimate_files: tuple[str, ...] = ()
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    _errors: dict[str, tuple[pd.DataFrame, dict[str, pd.DataFrame]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """What was read, by row: figures ask once a family, and recordings are many."""

    def errors(self, row: str, family: str | None = None) -> pd.DataFrame:
        """Return raw errors of a row: ``family, value, world, sample, error_m`` and components."""
        if row not in self._errors:
            frame, _ = read_row_errors([p for p in self.error_files if Path(p).parent.name == row])
            self._errors[row] = frame, {str(name): own for name, own in frame.groupby("family", sort=False)}
        frame, families = self._errors[row]
        return (frame if family is None else families.get(family, frame.iloc[:0])).copy(deep=False)

    def per_world(self, row: str, family: str, metric: str) -> NDArray[np.float64]:
        """Return a metric of a row of the table, one value a world, in the order of worlds."""
        return self._per_world.get((family, row, metric), np.empty(0))

    @cached_property
    def _per_world(self) -> dict[tuple[str, str, str], NDArray[np.float64]]:
        own = self.measures[self.measures["value"].isna()].sort_values("world")
        groups = own.groupby(["family", "algorithm", "metric"], sort=False)["x"]
        return {
            (str(family), str(row), str(metric)): x.to_numpy(dtype=float)
            for (family, row, metric), x in groups
        }

    def estimate(self, row: str, family: str) -> dict[str, NDArray[np.generic]]:
        """Return the estimates of a row in the first batch of worlds, one line a world.

        Parameters
        ----------
        row
            A row of the table.
        family
            A family of worlds.

        Returns
        -------
        dict
            What the row estimated, for example ``position_m`` and ``covariance_m2``; empty where it was
            skipped or has no file.
        """
        path = min((p for p in self.estimate_files if Path(p).parent.name == row), default=None)
        step = {} if path is None else read_tree(path).get(f"{family}/0", {})
        if not step or str(step["skipped"]):
            return {}
        prefix = "estimate."
        return {name.removeprefix(prefix): v for name, v in step.items() if name.startswith(prefix)}

    def families(self) -> list[str]:
        """Return the families of worlds, or the recordings, in their order."""
        return list(self.observed)

    def curve(self, sweep: str, metric: str = "mean_m") -> pd.DataFrame:
        """Return a sweep's metric: index = value of the setting, one column a world."""
        own = self.measures[(self.measures["algorithm"] == sweep) & (self.measures["metric"] == metric)]
        return own.pivot_table(index="value", columns="world", values="x")

    def printed(self, claim: str) -> str:
        """Return the printed digits of a claim."""
        return next(str(c["printed"]) for c in self.paper["claims"] if c["id"] == claim)
