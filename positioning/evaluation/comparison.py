"""All algorithms of a task beside each other, over the data sets of all studies.

A data set is a family of worlds or a recording of one study. Ranks, shares and paired outcomes are made
inside a data set and only then joined, because errors of different places do not compare.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from positioning.evaluation.statistics import CONFIDENCE, Interval, mean_interval

COLUMNS = ["study", "family", "kind", "algorithm", "use", "role", "new", "worlds", "n"]
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
COLUMNS += ["rank", "beaten_share", "worlds_won_share", "seconds", "note"]
"""Columns of the table of a task."""

MAIN, VARIANT, CONTROL = "main", "variant", "control"
"""What a row is to a comparison: a competitor, one with other settings, or a limit."""

LEAST_ALGORITHMS, LEAST_DATA_SETS = 3, 5
"""Smaller comparisons have no critical difference worth drawing."""

TIE = 1e-6
"""Mean errors that are closer than this share of them are equal."""

DataSet = tuple[str, str]


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


@dataclass(frozen=True)
class Ranks:
    """Mean ranks over data sets in which the same algorithms ran, with Nemenyi's critical difference.

    Attributes
    ----------
    rank
        One line a data set, one column an algorithm, the best mean rank first; 1 is the smallest error.
    critical_difference
        Mean ranks that are farther apart differ at the 5 % level.
    friedman_p
        Probability of ranks so unlike if all algorithms were alike (Friedman's test).
    """

    rank: pd.DataFrame
    critical_difference: float
    friedman_p: float

    @property
    def mean(self) -> "pd.Series[float]":
        """The mean rank of each algorithm, ascending."""
        mean: pd.Series[float] = self.rank.mean()
        return mean

    def unlike_best(self) -> list[str]:
        """Return the algorithms whose mean rank differs from the best one."""
        mean = self.mean
        return [str(name) for name in mean.index if mean[name] - mean.iloc[0] > self.critical_difference]


@dataclass(frozen=True)
class Group:
    """Studies whose algorithms meet: two of them, or all of a study, run in another study of the group, too.

    Attributes
    ----------
    name
        The name of its first study.
    titles
        Titles by study.
    lines
        Lines of the task's table, with a column ``label``: the row's name, unique in the group.
    pairs
        Paired differences of competitors and new rows, by label.
    summary
        One line a competitor or new row, those with a mean rank first: ``label, use, new, synthetic,
        recorded, rank, beaten_share, won_share, over_best, seconds, unlike_settings``. Data sets count
        alike in shares and in ``over_best``, the geometric mean of mean errors over the smallest one.
    outcomes
        One line an ordered pair of them: in how many data sets the interval of the paired difference is
        below zero, ``better``, or above, ``worse``, of how many, ``n``.
    ranks
        Over the largest complete block of data sets and algorithms; None where it is too small.
    """

    name: str
    titles: dict[str, str]
    lines: pd.DataFrame
    pairs: pd.DataFrame
    summary: pd.DataFrame
    outcomes: pd.DataFrame
    ranks: Ranks | None


@dataclass(frozen=True)
class Comparison:
    """Everything about one task: its table with the columns ``COLUMNS``, and its groups of studies."""

    task: str
    lines: pd.DataFrame
    groups: list[Group] = field(default_factory=list)


def compare(studies: Sequence[StudyTables], accepted: Iterable[tuple[str, str]]) -> list[Comparison]:
    """Return one comparison a task, in the order in which the studies bring them.

    Parameters
    ----------
    studies
        In the order of the configuration.
    accepted
        Task and name of rows that are not new.
    """
    known = set(accepted)
    found: dict[str, list[tuple[StudyTables, pd.DataFrame]]] = {}
    for study in studies:
        for task, lines in study_lines(study, known).items():
            found.setdefault(task, []).append((study, lines))
    return [
        Comparison(
            task,
            pd.concat([lines for _, lines in parts], ignore_index=True)[COLUMNS],
            [_group(members) for members in _meeting([p for p in parts if p[1]["rank"].notna().any()])],
        )
        for task, parts in found.items()
    ]


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
    seconds = study.times.groupby(["family", "algorithm"])["seconds"].median().to_dict()
    order = study.worlds.sort_values("world", kind="stable")
    per_world = {
        (str(family), str(row)): (own["world"].to_numpy(), own["mean_m"].to_numpy(dtype=float))
        for (family, row), own in order.groupby(["family", "algorithm"], sort=False)
    }
    tasks: dict[str, list[dict[str, Any]]] = {}
    for line in study.table.to_dict("records"):
        row, family = str(line["algorithm"]), str(line["family"])
        entry, (role, new) = study.entries[row], what[row]
        measured = not line["note"]
        interval, over = _interval(line, per_world.get((family, row))) if measured else (_NO_INTERVAL, "")
        tasks.setdefault(str(entry.get("task", "fingerprinting")), []).append(
            {str(name): line.get(name, np.nan) for name in COLUMNS}
            | {
                "study": study.study,
                "family": family,
                "kind": study.kind,
                "use": entry.get("use", row),
                "role": role,
                "new": new,
                "worlds": int(line["worlds"]) if measured else 0,
                "n": int(line["n"]) if measured else 0,
                "interval_low_m": interval.low,
                "interval_high_m": interval.high,
                "interval_over": over,
                "seconds": seconds.get((family, row), np.nan),
            }
        )
    for lines in tasks.values():
        for family in dict.fromkeys(line["family"] for line in lines):
            rivals = [
                line
                for line in lines
                if line["family"] == family
                and line["worlds"]
                and (line["role"] == MAIN or _is_new_rival(line))
            ]
            _place(rivals, {line["algorithm"]: per_world[(family, line["algorithm"])] for line in rivals})
    return {task: pd.DataFrame(lines, columns=COLUMNS) for task, lines in tasks.items()}


def _is_new_rival(line: Mapping[str, Any]) -> bool:
    return bool(line["new"]) and line["role"] == VARIANT


def _place(
    rivals: Sequence[dict[str, Any]],
    per_world: Mapping[str, tuple[NDArray[Any], NDArray[np.float64]]],
) -> None:
    """Write the ranks and shares of those that compete on one data set into their lines."""
    if not rivals:
        return
    mean_m = np.array([line["mean_m"] for line in rivals])
    smaller = (mean_m < mean_m[:, None]).sum(axis=1)
    equal = (mean_m == mean_m[:, None]).sum(axis=1)
    worlds = np.unique(np.concatenate([own for own, _ in per_world.values()]))
    errors_m = np.full((len(worlds), len(rivals)), np.nan)
    for column, (own, values) in enumerate(per_world.values()):
        errors_m[np.searchsorted(worlds, own), column] = values
    won = worlds_won(errors_m)
    for number, line in enumerate(rivals):
        line["rank"] = float(smaller[number] + (equal[number] + 1) / 2)
        if len(rivals) > 1:
            line["beaten_share"] = (len(rivals) - line["rank"]) / (len(rivals) - 1)
            line["worlds_won_share"] = float(won[number])


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
    new = {
        row: (str(entry.get("task", "fingerprinting")), row) not in accepted for row, entry in entries.items()
    }
    alike: dict[object, list[str]] = {}
    for row, entry in entries.items():
        alike.setdefault(_built_of(row, entry), []).append(row)
    first = {
        min(rows, key=lambda row: (new[row], entries[row].get("use", row) != row, rows.index(row)))
        for rows in alike.values()
    }
    found = {}
    for row, entry in entries.items():
        if str(entry.get("use", row)).startswith("control_"):
            role = CONTROL
        else:
            role = MAIN if row in first or row == reference else VARIANT
        found[row] = (role, new[row])
    return found


def worlds_won(mean_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of worlds in which each algorithm has the smallest value; equal ones share a world.

    Values are equal to the six digits that tables have: two algorithms may find one answer on two ways.

    Parameters
    ----------
    mean_m
        One value a world and algorithm, [world, algorithm]; NaN where it has no answer.
    """
    values = mean_m[~np.isnan(mean_m).all(axis=1)]
    smallest = values <= np.nanmin(values, axis=1, keepdims=True) * (1 + TIE)
    share: NDArray[np.float64] = (smallest / smallest.sum(axis=1, keepdims=True)).mean(axis=0)
    return share


class Block(NamedTuple):
    """Data sets, and algorithms that ran in all of them."""

    data_sets: list[DataSet]
    algorithms: list[str]


def complete_block(present: Mapping[DataSet, Iterable[str]]) -> Block | None:
    """Return the data sets and algorithms for a comparison of ranks, None where there are too few.

    Ranks need the same algorithms in every data set. Of all such blocks the one of most pairs is
    taken, of equal ones that of more data sets; errors play no part in the choice.

    Parameters
    ----------
    present
        Algorithms that ran, by data set.
    """
    sets = {data_set: frozenset(rows) for data_set, rows in present.items()}
    closed = set(sets.values())
    fresh = closed
    while fresh:
        fresh = {a & b for a in fresh for b in sets.values()} - closed
        closed |= fresh
    best, size = None, (0, 0)
    for rows in sorted(closed, key=sorted):
        inside = [data_set for data_set, own in sets.items() if rows <= own]
        if len(rows) >= LEAST_ALGORITHMS and len(inside) >= LEAST_DATA_SETS:
            own_size = (len(rows) * len(inside), len(inside))
            if own_size > size:
                best, size = Block(inside, sorted(rows)), own_size
    return best


def ranks(mean_m: pd.DataFrame) -> Ranks:
    """Return mean ranks with Nemenyi's critical difference, as Demsar (2006) compares classifiers.

    Parameters
    ----------
    mean_m
        One line a data set, one column an algorithm, complete.
    """
    # These two take longer to import than all the rest of a comparison to run.
    from scipy.stats import friedmanchisquare, studentized_range

    data_sets, algorithms = mean_m.shape
    rank = mean_m.rank(axis=1)
    quantile = studentized_range.ppf(CONFIDENCE, algorithms, np.inf) / np.sqrt(2)
    return Ranks(
        rank[rank.mean().sort_values(kind="stable").index],
        float(quantile * np.sqrt(algorithms * (algorithms + 1) / (6 * data_sets))),
        float(friedmanchisquare(*mean_m.to_numpy(dtype=float).T).pvalue),
    )


def paired_outcomes(pairs: pd.DataFrame) -> pd.DataFrame:
    """Return in how many data sets a row's paired difference is clear of zero, by ordered pair.

    Parameters
    ----------
    pairs
        Paired differences with the columns ``label``, ``against``, ``low_m``, ``high_m`` and ``n``; those
        of a single sample say nothing and count nowhere.
    """
    own = pairs[pairs["n"] > 1]
    marked = own.assign(better=own["high_m"] < 0, worse=own["low_m"] > 0, data_sets=1)
    counted = marked.groupby(["label", "against"], sort=False)[["better", "worse", "data_sets"]].sum()
    return counted.astype(int).rename(columns={"data_sets": "n"}).reset_index()


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
    half = float(stdtrit(samples - 1, (1 + CONFIDENCE) / 2) * line["se_m"])
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


Part = tuple[StudyTables, pd.DataFrame]


def _meeting(parts: Sequence[Part]) -> list[list[Part]]:
    """Return studies in groups: two belong together that share two algorithms, or all that one has."""
    names = [
        {(row, use) for row, use in zip(own["algorithm"], own["use"], strict=True)}
        for own in (lines[(lines["role"] != CONTROL) & (lines["worlds"] > 0)] for _, lines in parts)
    ]
    groups: list[list[int]] = []
    for i, own in enumerate(names):
        near = [
            group
            for group in groups
            if any(len(own & names[j]) >= min(2, len(own), len(names[j])) for j in group)
        ]
        groups = [group for group in groups if group not in near]
        groups.append(sorted([i, *(j for group in near for j in group)]))
    return [[parts[i] for i in group] for group in sorted(groups)]


def _group(parts: Sequence[Part]) -> Group:
    lines = pd.concat([own for _, own in parts], ignore_index=True)
    uses = lines.groupby("algorithm")["use"].nunique()
    lines["label"] = [
        row if uses[row] == 1 else f"{row} ({use})"
        for row, use in zip(lines["algorithm"], lines["use"], strict=True)
    ]
    ran = lines[lines["rank"].notna()]
    wide = ran.pivot_table(index=["study", "family"], columns="label", values="mean_m", sort=False)
    block = complete_block(
        {
            (str(key[0]), str(key[1])): own["label"]
            for key, own in ran.groupby(["study", "family"], sort=False)
        }
    )
    ranked = None if block is None else ranks(wide.reindex(block.data_sets)[block.algorithms])
    labels = {
        (str(s), str(a)): str(x) for s, a, x in zip(ran["study"], ran["algorithm"], ran["label"], strict=True)
    }
    pairs = pd.concat([_pairs(study, labels) for study, _ in parts], ignore_index=True)
    settings = {label: _settings(parts, own) for label, own in ran.groupby("label", sort=False)}
    summary = _summary(ran, ranked, settings)
    return Group(
        name=parts[0][0].study,
        titles={study.study: study.title for study, _ in parts},
        lines=lines,
        pairs=pairs,
        summary=summary,
        outcomes=paired_outcomes(pairs),
        ranks=ranked,
    )


def _pairs(study: StudyTables, labels: Mapping[tuple[str, str], str]) -> pd.DataFrame:
    own = study.paired.assign(study=study.study)
    own["label"] = [labels.get((study.study, str(row))) for row in own["algorithm"]]
    own["against"] = [labels.get((study.study, str(row))) for row in own["against"]]
    return own[own["label"].notna() & own["against"].notna()].drop(columns="algorithm")


def _settings(parts: Sequence[Part], lines: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the different settings under which a row stands in the studies of a group."""
    row, studies = str(lines["algorithm"].iloc[0]), set(lines["study"])
    found: list[dict[str, Any]] = []
    for study, _ in parts:
        if study.study in studies:
            entry = study.entries[row]
            own = {**entry.get("parameters", {}), **entry.get("options", {})}
            found += [own] if own not in found else []
    return found


def _summary(
    ran: pd.DataFrame, ranked: Ranks | None, settings: Mapping[Any, Sequence[Mapping[str, Any]]]
) -> pd.DataFrame:
    best_m = ran.groupby(["study", "family"])["mean_m"].transform("min")
    ran = ran.assign(log_over_best=np.log(_positive(ran["mean_m"]) / _positive(best_m)))
    lines = []
    for label, own in ran.groupby("label", sort=False):
        lines.append(
            {
                "label": label,
                "use": own["use"].iloc[0],
                "new": bool(own["new"].any()),
                "synthetic": int((own["kind"] == "synthetic").sum()),
                "recorded": int((own["kind"] == "recorded").sum()),
                "beaten_share": own["beaten_share"].mean(),
                "won_share": own["worlds_won_share"].mean(),
                "over_best": float(np.exp(own["log_over_best"].mean())),
                "rank": np.nan if ranked is None else ranked.mean.get(label, np.nan),
                "seconds": own["seconds"].median(),
                "unlike_settings": len(settings[label]) > 1,
            }
        )
    return pd.DataFrame(lines).sort_values(
        ["rank", "beaten_share"], ascending=[True, False], kind="stable", ignore_index=True
    )


def _positive(values: "pd.Series[float]") -> NDArray[np.float64]:
    """Return values for a quotient: an error of zero has none."""
    numbers = values.to_numpy(dtype=float)
    return np.where(numbers > 0, numbers, np.nan)
