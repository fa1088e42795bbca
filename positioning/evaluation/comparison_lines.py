"""Lines of one study for the comparison of all algorithms: one a row and data set, with role and rank.

Ranks and shares are made inside a data set, between the rows that compete there, at the samples that both
rows of a pair have: one that refuses hard samples gains nothing by it, and one that ran in fewer worlds
is compared in these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.entries import new_rows, task_of
from positioning.evaluation.ranks import LEAST_COVERAGE, LEAST_SAMPLES, difference_ranks, worlds_won
from positioning.evaluation.statistics import CONFIDENCE, Interval, mean_interval, student_t

COLUMNS = [
    "study",
    "family",
    "kind",
    "algorithm",
    "use",
    "role",
    "new",
    "competes",
    "worlds",
    "of_worlds",
    "n",
    "coverage",
]
COLUMNS += [
    "mean_m",
    "interval_low_m",
    "interval_high_m",
    "interval_over",
    "p50_m",
    "p75_m",
    "p90_m",
    "p95_m",
]
COLUMNS += ["rank", "beaten_share", "worlds_won_share", "over_best", "seconds", "note"]
"""Columns of the table of a task: ``of_worlds`` is how many the data set has, as a row may ask for fewer."""

MAIN, VARIANT, CONTROL = "main", "variant", "control"
"""What a row is to a comparison: a competitor, one with other settings, or a limit."""


@dataclass(frozen=True)
class StudyTables:
    """What the workflow made of a study, as far as a comparison needs it.

    Attributes
    ----------
    study, title, kind
        Its name and title; ``synthetic`` or ``recorded``.
    reference
        The row that the study compares all others with.
    entries
        Settings by row, as the plan describes them: ``use``, ``task``, ``parameters``, ``options``.
    table, paired, times
        As the rule ``compare`` writes them; ``times`` outside sweeps.
    worlds
        One mean error a world: ``family, algorithm, world, mean_m``.
    sources
        The collection that a recording is from, by family. What is not told is from one source a study.
    """

    study: str
    title: str
    kind: str
    reference: str
    entries: Mapping[str, Mapping[str, Any]]
    table: pd.DataFrame
    paired: pd.DataFrame
    times: pd.DataFrame
    worlds: pd.DataFrame
    sources: Mapping[str, str] = field(default_factory=dict)


def study_lines(study: StudyTables, accepted: set[tuple[str, str]]) -> dict[str, pd.DataFrame]:
    """Return the lines of one study by task, with the columns ``COLUMNS``.

    Parameters
    ----------
    study
        Its tables.
    accepted
        Task and name of rows that are not new.
    """
    what = roles(study.entries, study.reference, accepted)
    spent = study.times.groupby(["family", "algorithm"])
    seconds, ran_in = spent["seconds"].median().to_dict(), spent["world"].nunique().to_dict()
    order = study.worlds.sort_values("world", kind="stable")
    per_world = {
        (str(family), str(row)): (own["world"].to_numpy(), own["mean_m"].to_numpy(dtype=float))
        for (family, row), own in order.groupby(["family", "algorithm"], sort=False)
    }
    differences_m = {
        (str(family), str(row), str(against)): float(value)
        for family, row, against, value in zip(
            *(study.paired[name] for name in ("family", "algorithm", "against", "difference_m")), strict=True
        )
    }
    tasks: dict[str, list[dict[str, Any]]] = {}
    for line in study.table.to_dict("records"):
        row, family = str(line["algorithm"]), str(line["family"])
        entry, (role, new) = study.entries[row], what[row]
        measured = not line["note"]
        interval, over = _interval(line, per_world.get((family, row))) if measured else (_NO_INTERVAL, "")
        tasks.setdefault(task_of(entry), []).append(
            {str(name): line.get(name, np.nan) for name in COLUMNS}
            | {
                "study": study.study,
                "family": family,
                "kind": study.kind,
                "use": entry.get("use", row),
                "role": role,
                "new": new,
                "competes": False,
                "worlds": int(line["worlds"]) if measured else 0,
                # Not a column: a world without an answer has no error, yet the row has spent its time there.
                "ran_in": max(int(line["worlds"]), ran_in.get((family, row), 0)) if measured else 0,
                "n": int(line["n"]) if measured else 0,
                "interval_low_m": interval.low,
                "interval_high_m": interval.high,
                "interval_over": over,
                "seconds": seconds.get((family, row), np.nan),
            }
        )
    for lines in tasks.values():
        for family in dict.fromkeys(line["family"] for line in lines):
            answering = [line for line in lines if line["family"] == family and line["worlds"]]
            # What nobody answers is unknown here: the row that answers most stands for all of a world.
            samples = max((_samples(line) for line in answering), default=0.0)
            of_worlds = max((line["ran_in"] for line in answering), default=0)
            for own in answering:
                own["of_worlds"] = of_worlds
                own["coverage"] = _samples(own) / samples if samples else np.nan
                own["competes"] = own["role"] == MAIN or _is_new_rival(own)
            rivals = [line for line in answering if line["competes"]]
            if rivals and samples * of_worlds >= LEAST_SAMPLES:
                names = [line["algorithm"] for line in rivals]
                _place(
                    rivals,
                    np.array([[differences_m.get((family, a, b), np.nan) for b in names] for a in names]),
                    [per_world[(family, name)] for name in names],
                )
    return {task: pd.DataFrame(lines, columns=COLUMNS) for task, lines in tasks.items()}


def _is_new_rival(line: Mapping[str, Any]) -> bool:
    return bool(line["new"]) and line["role"] == VARIANT


def _samples(line: Mapping[str, Any]) -> float:
    """Return how many samples a row answers in a world in which it ran."""
    return float(int(line["n"]) * int(line["worlds"]) / int(line["ran_in"]))


def _place(
    rivals: Sequence[dict[str, Any]],
    difference_m: NDArray[np.float64],
    per_world: Sequence[tuple[NDArray[Any], NDArray[np.float64]]],
) -> None:
    """Write the ranks and shares of those that compete on one data set into their lines.

    Parameters
    ----------
    rivals
        Their lines.
    difference_m
        Mean error of each minus that of each at common samples, [rival, rival]; NaN where there are none.
    per_world
        World and mean error of each.
    """
    rank = difference_ranks(difference_m, np.array([line["mean_m"] for line in rivals]))
    for line, own in zip(rivals, rank, strict=True):
        line["rank"] = float(own)
        if len(rivals) > 1:
            line["beaten_share"] = (len(rivals) - line["rank"]) / (len(rivals) - 1)
    # A mean over a row's own samples says nothing beside one over others, and worlds have no paired ones;
    # a row that did not run in a world cannot win it.
    whole = [number for number, line in enumerate(rivals) if _is_whole(line)]
    if len(whole) > 1:
        worlds = np.unique(np.concatenate([per_world[number][0] for number in whole]))
        errors_m = np.full((len(worlds), len(whole)), np.nan)
        for column, number in enumerate(whole):
            own_worlds, values = per_world[number]
            errors_m[np.searchsorted(worlds, own_worlds), column] = values
        for number, share in zip(whole, worlds_won(errors_m), strict=True):
            rivals[number]["worlds_won_share"] = float(share)
    # Of whole rows these are their mean errors; others are brought to all samples by their difference.
    order = [(-line["ran_in"], -line["coverage"], line["mean_m"]) for line in rivals]
    most = order.index(min(order))
    difference_m = np.where(np.eye(len(rivals), dtype=bool), 0.0, difference_m)
    likened_m = _positive(rivals[most]["mean_m"] + difference_m[:, most])
    if not np.isnan(likened_m).all():
        for line, own in zip(rivals, likened_m / np.nanmin(likened_m), strict=True):
            line["over_best"] = float(own)


def _is_whole(line: Mapping[str, Any]) -> bool:
    return bool(line["coverage"] >= LEAST_COVERAGE and line["ran_in"] == line["of_worlds"])


def roles(
    entries: Mapping[str, Mapping[str, Any]], reference: str, accepted: set[tuple[str, str]]
) -> dict[str, tuple[str, bool]]:
    """Return for each row whether it competes, is a variant or a control, and whether it is new.

    Of rows that are built of the same algorithms, one competes: the one that is named like its
    algorithm, else the first; the others are variants of settings. The reference of the study
    competes always, and a row that is not accepted yet takes nobody's place.

    Parameters
    ----------
    entries
        Settings by row: ``use``, ``task``, ``parameters``, ``options``.
    reference
        The study's own choice.
    accepted
        Task and name of rows that are not new.
    """
    new = new_rows(entries, accepted)
    alike: dict[object, list[str]] = {}
    for row, entry in entries.items():
        alike.setdefault(_built_of(row, entry), []).append(row)
    first = {
        min(rows, key=lambda row: (row in new, entries[row].get("use", row) != row, rows.index(row)))
        for rows in alike.values()
    }
    found = {}
    for row, entry in entries.items():
        if str(entry.get("use", row)).startswith("control_"):
            role = CONTROL
        else:
            role = MAIN if row in first or row == reference else VARIANT
        found[row] = (role, row in new)
    return found


_NO_INTERVAL = Interval(float("nan"), float("nan"), 0.0)


def _interval(
    line: Mapping[Any, Any], per_world: tuple[NDArray[Any], NDArray[np.float64]] | None
) -> tuple[Interval, str]:
    """Return Student's 95 % interval of the mean: over worlds; of one world or recording over its samples."""
    if per_world is not None and len(per_world[1]) > 1:
        return mean_interval(per_world[1]), "worlds"
    samples = int(line["n"])
    if samples < 2:
        return _NO_INTERVAL, ""
    half = student_t(samples - 1) * float(line["se_m"])
    return Interval(float(line["mean_m"]) - half, float(line["mean_m"]) + half, CONFIDENCE), "samples"


def _built_of(row: str, entry: Mapping[str, Any]) -> object:
    """Return the algorithms that a row is built of, without their settings."""
    inner = {**entry.get("parameters", {}), **entry.get("options", {})}
    parts = [
        (name, _built_of(name, part))
        for name, part in sorted(inner.items())
        if isinstance(part, Mapping) and "use" in part
    ]
    # The parts of a part stand beside its settings, those of a row under two keys of their own.
    parts += [
        (name, _built_of(name, part))
        for name, part in sorted(entry.items())
        if name not in ("parameters", "options") and isinstance(part, Mapping) and "use" in part
    ]
    return (entry.get("use", row), entry.get("task"), tuple(parts))


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values for a quotient: an error of zero has none."""
    return np.where(values > 0, values, np.nan)
