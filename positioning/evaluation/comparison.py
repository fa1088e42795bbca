"""All algorithms of a task beside each other, over the data sets of all studies.

A data set is a family of worlds or a recording of one study. Ranks, shares and paired outcomes are made
inside a data set and only then joined, because errors of different places do not compare. Inside a data
set, rows are compared at the samples that both have: one that refuses hard samples gains nothing by it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from positioning.evaluation.statistics import CONFIDENCE, Interval, mean_interval

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
"""Columns of the table of a task."""

MAIN, VARIANT, CONTROL = "main", "variant", "control"
"""What a row is to a comparison: a competitor, one with other settings, or a limit."""

LEAST_ALGORITHMS, LEAST_DATA_SETS = 3, 5
"""Smaller comparisons have no critical difference worth drawing."""

LEAST_COVERAGE, LEAST_SAMPLES = 0.98, 2
"""Rows that answer a smaller share of a data set's samples, and data sets of fewer, are in no mean rank."""

TIE = 1e-4
"""Mean errors that are closer than this share of the larger one are equal, here and in all counts."""

WORLD, SAMPLE = "world", "sample"
"""What a paired difference is over."""

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


@dataclass(frozen=True)
class Ranks:
    """Mean ranks over data sets in which the same algorithms ran, with Nemenyi's critical difference.

    Attributes
    ----------
    rank
        One line a data set, one column an algorithm, the best mean rank first; 1 is the smallest error.
        Made of paired differences, as `difference_ranks` says.
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

    def best(self) -> list[str]:
        """Return the algorithm of the lowest mean rank, or all that share it."""
        mean = self.mean
        return [str(name) for name in mean.index if np.isclose(mean[name], mean.iloc[0])]

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
        recorded, coverage, least_coverage, rank, beaten_share, won_share, over_best, seconds,
        unlike_settings``. Data sets count alike in shares and in ``over_best``, a geometric mean.
    outcomes
        One line an ordered pair of them and unit, ``world`` or ``sample``: in how many data sets the
        interval of the paired difference is below zero, ``better``, or above, ``worse``, of how many, ``n``.
    ranks
        Over the largest complete block of data sets and algorithms; None where it is too small.
    left_out
        Data sets that are not in that block: ``study, family, kind, reason``. Empty without ranks.
    sources
        How many sources the data sets of the block have, or all of them without ranks: collections of
        recordings, and synthetic studies. Data sets of one source depend on each other.
    """

    name: str
    titles: dict[str, str]
    lines: pd.DataFrame
    pairs: pd.DataFrame
    summary: pd.DataFrame
    outcomes: pd.DataFrame
    ranks: Ranks | None
    left_out: pd.DataFrame
    sources: int


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
            [_group(members) for members in _meeting([p for p in parts if p[1]["competes"].any()])],
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
        tasks.setdefault(str(entry.get("task", "fingerprinting")), []).append(
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
            # What nobody answers is unknown here: the row that answers most stands for all samples.
            samples = max((_samples(line) for line in answering), default=0)
            for own in answering:
                own["coverage"] = _samples(own) / samples if samples else np.nan
                own["competes"] = own["role"] == MAIN or _is_new_rival(own)
            rivals = [line for line in answering if line["competes"]]
            if rivals and samples >= LEAST_SAMPLES:
                names = [line["algorithm"] for line in rivals]
                _place(
                    rivals,
                    np.array([[differences_m.get((family, a, b), np.nan) for b in names] for a in names]),
                    [per_world[(family, name)] for name in names],
                )
    return {task: pd.DataFrame(lines, columns=COLUMNS) for task, lines in tasks.items()}


def _is_new_rival(line: Mapping[str, Any]) -> bool:
    return bool(line["new"]) and line["role"] == VARIANT


def _samples(line: Mapping[str, Any]) -> int:
    return int(line["n"]) * int(line["worlds"])


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
    # A mean over a row's own samples says nothing beside one over others, and worlds have no paired ones.
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
    most = min(range(len(rivals)), key=lambda i: (-rivals[i]["coverage"], rivals[i]["mean_m"]))
    difference_m = np.where(np.eye(len(rivals), dtype=bool), 0.0, difference_m)
    likened_m = _positive(rivals[most]["mean_m"] + difference_m[:, most])
    if not np.isnan(likened_m).all():
        for line, own in zip(rivals, likened_m / np.nanmin(likened_m), strict=True):
            line["over_best"] = float(own)


def _is_whole(line: Mapping[str, Any]) -> bool:
    return bool(line["coverage"] >= LEAST_COVERAGE)


def difference_ranks(difference_m: NDArray[np.float64], mean_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rank of each algorithm on a data set from paired differences; 1 is the smallest error.

    A rank is one more than the number of algorithms with a smaller error at the samples that both have;
    equal ones count half, and so do those that have no sample in common. Where all answer at the same
    samples, these are the ranks of the mean errors. Ranks of a data set sum up alike in any case.

    Parameters
    ----------
    difference_m
        Mean error of the former minus that of the latter, [..., former, latter]; NaN where nothing is
        common. The diagonal does not count.
    mean_m
        Mean errors, [..., algorithm], which say what difference is none.
    """
    same = np.eye(difference_m.shape[-1], dtype=bool)
    tie_m = TIE * np.maximum(mean_m[..., :, None], mean_m[..., None, :])
    larger = (difference_m > tie_m) & ~same
    equal = ~(np.abs(difference_m) > tie_m) & ~same
    rank: NDArray[np.float64] = 1 + larger.sum(axis=-1) + equal.sum(axis=-1) / 2
    return rank


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

    Two algorithms may find one answer on two ways, so that values within ``TIE`` are equal.

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


def mean_ranks(rank: pd.DataFrame) -> Ranks:
    """Return mean ranks with Nemenyi's critical difference, as Demsar (2006) compares classifiers.

    Parameters
    ----------
    rank
        Ranks inside each data set: one line a data set, one column an algorithm, complete.
    """
    # These two take longer to import than all the rest of a comparison to run.
    from scipy.stats import friedmanchisquare, studentized_range

    data_sets, algorithms = rank.shape
    values = rank.to_numpy(dtype=float)
    quantile = studentized_range.ppf(CONFIDENCE, algorithms, np.inf) / np.sqrt(2)
    # Friedman's statistic divides by zero where all are equal everywhere: nothing speaks for a difference.
    tied = bool((values == values[:, :1]).all())
    return Ranks(
        rank[rank.mean().sort_values(kind="stable").index],
        float(quantile * np.sqrt(algorithms * (algorithms + 1) / (6 * data_sets))),
        1.0 if tied else float(friedmanchisquare(*values.T).pvalue),
    )


def paired_outcomes(pairs: pd.DataFrame) -> pd.DataFrame:
    """Return in how many data sets a row's paired difference is clear of zero, by ordered pair and unit.

    Units stay apart: samples of a place depend on each other, so that intervals over them are too narrow
    and clear of zero more often than those over worlds.

    Parameters
    ----------
    pairs
        Paired differences with the columns ``label``, ``against``, ``unit``, ``low_m``, ``high_m`` and
        ``n``; those of a single sample or world say nothing and count nowhere.
    """
    own = pairs[pairs["n"] > 1]
    marked = own.assign(better=own["high_m"] < 0, worse=own["low_m"] > 0, data_sets=1)
    counted = marked.groupby(["label", "against", "unit"], sort=False)[["better", "worse", "data_sets"]].sum()
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
    ran = lines[lines["competes"]]
    labels = {
        (str(s), str(a)): str(x) for s, a, x in zip(ran["study"], ran["algorithm"], ran["label"], strict=True)
    }
    pairs = pd.concat([_pairs(study, labels) for study, _ in parts], ignore_index=True)
    fit = ran[ran["rank"].notna() & (ran["coverage"] >= LEAST_COVERAGE)]
    block = complete_block(
        {(str(s), str(f)): own["label"] for (s, f), own in fit.groupby(["study", "family"], sort=False)}
    )
    ranked = None if block is None else _block_ranks(block, ran, pairs)
    settings = {label: _settings(parts, own) for label, own in ran.groupby("label", sort=False)}
    inside = list(dict.fromkeys(_keys(ran))) if block is None else block.data_sets
    sources = {study.study: study.sources for study, _ in parts}
    return Group(
        name=parts[0][0].study,
        titles={study.study: study.title for study, _ in parts},
        lines=lines,
        pairs=pairs,
        summary=_summary(ran, ranked, settings),
        outcomes=paired_outcomes(pairs),
        ranks=ranked,
        left_out=_left_out(ran, block),
        sources=len({sources[study].get(family, f"study {study}") for study, family in inside}),
    )


def _keys(lines: pd.DataFrame) -> list[DataSet]:
    return [(str(study), str(family)) for study, family in zip(lines["study"], lines["family"], strict=True)]


def _block_ranks(block: Block, ran: pd.DataFrame, pairs: pd.DataFrame) -> Ranks:
    """Return the ranks among the algorithms of a block alone, from paired differences."""
    mean_m = ran.pivot(index=["study", "family"], columns="label", values="mean_m")
    wide = pairs.pivot(index=["study", "family", "label"], columns="against", values="difference_m")
    shape = (len(block.data_sets), len(block.algorithms), len(block.algorithms))
    order = [(*data_set, label) for data_set in block.data_sets for label in block.algorithms]
    difference_m = wide.reindex(order)[block.algorithms].to_numpy(dtype=float).reshape(shape)
    own_m = mean_m.reindex(block.data_sets)[block.algorithms]
    rank = difference_ranks(difference_m, own_m.to_numpy(dtype=float))
    return mean_ranks(pd.DataFrame(rank, index=own_m.index, columns=own_m.columns))


ONE_SAMPLE, REFUSED, ABSENT = "one sample", "samples unanswered", "not run there"
"""Why a data set is not in the block of ranks."""


def _left_out(ran: pd.DataFrame, block: Block | None) -> pd.DataFrame:
    """Return the data sets outside the block, with what keeps them out."""
    found = []
    if block is not None:
        for (study, family), own in ran.groupby(["study", "family"], sort=False):
            if (str(study), str(family)) in block.data_sets:
                continue
            if own["rank"].isna().all():
                reason = ONE_SAMPLE
            else:
                reason = REFUSED if set(block.algorithms) <= set(own["label"]) else ABSENT
            found.append((str(study), str(family), str(own["kind"].iloc[0]), reason))
    return pd.DataFrame(found, columns=["study", "family", "kind", "reason"])


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
    ran = ran.assign(log_over_best=np.log(ran["over_best"].astype(float)))
    lines = []
    for label, own in ran.groupby("label", sort=False):
        lines.append(
            {
                "label": label,
                "use": own["use"].iloc[0],
                "new": bool(own["new"].any()),
                "synthetic": int((own["kind"] == "synthetic").sum()),
                "recorded": int((own["kind"] == "recorded").sum()),
                "coverage": own["coverage"].mean(),
                "least_coverage": own["coverage"].min(),
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


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values for a quotient: an error of zero has none."""
    return np.where(values > 0, values, np.nan)
