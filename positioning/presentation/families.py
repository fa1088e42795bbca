"""A study in several families of worlds, as figures draw it: measures by family and row, a look a family."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.style import Stroke

Array = np.ndarray[Any, np.dtype[np.float64]]

FAMILY_LOOKS = (
    Stroke("#14507d", "-", "o"),
    Stroke("#c8641a", "--", "s"),
    Stroke("#4d7f58", "-.", "^"),
    Stroke("#8a4b86", ":", "v"),
)
"""One dark and one lighter colour, and more for those who add families."""


@dataclass(frozen=True)
class Study:
    """The study's results, with the values of each row at hand.

    Attributes
    ----------
    results
        What the workflow made of the study.
    families
        Families of worlds in which something was measured.
    values
        One value a world by family, row and metric, outside sweeps.
    printed
        Printed digits by (family, row) and metric.
    """

    results: StudyResults
    families: list[str]
    values: Mapping[tuple[str, str, str], Array]
    printed: Mapping[tuple[str, str], Mapping[str, str]]

    @classmethod
    def of(cls, results: StudyResults) -> "Study":
        """Sort the measures by family, row and metric."""
        own = results.measures[results.measures["value"].isna()].sort_values("world")
        groups = own.groupby(["family", "algorithm", "metric"], sort=False)["x"]
        values = {
            (str(family), str(row), str(metric)): x.to_numpy(dtype=float)
            for (family, row, metric), x in groups
        }
        return cls(results, figures.measured_families(results), values, figures.published(results))

    def get(self, family: str, row: str, metric: str) -> Array:
        """Return one value a world; none where it was not measured."""
        return self.values.get((family, row, metric), np.empty(0))

    def rows(self, metric: str, family: str | None = None) -> list[str]:
        """Return the rows of the table for which a metric was measured: only one task has it."""
        families = self.families if family is None else [family]
        return [
            row for row in self.results.rows if any(len(self.get(name, row, metric)) for name in families)
        ]

    def look(self, family: str) -> Stroke:
        """Return how a family is drawn."""
        return FAMILY_LOOKS[self.families.index(family) % len(FAMILY_LOOKS)]

    def worlds(self, row: str, metric: str) -> int:
        """Return the number of worlds behind a row."""
        return max((len(self.get(family, row, metric)) for family in self.families), default=0)

    def first_world(self, side: str, family: str) -> dict[str, Array]:
        """Return the arrays of the first world of a family."""
        tree = self.results.observed if side == "observed" else self.results.truth
        arrays = tree.get(family, {})
        return {
            name: np.asarray(values[0], dtype=float)
            for name, values in arrays.items()
            if len(values) and name not in ("world", "seed")
        }
