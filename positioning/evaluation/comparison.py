"""All algorithms of a task beside each other, over the data sets of all studies.

A data set is a family of worlds or a recording of one study. Ranks, shares and paired outcomes are made
inside a data set and only then joined, because errors of different places do not compare. Inside a data
set, rows are compared at the samples that both have: one that refuses hard samples gains nothing by it.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from positioning.evaluation.comparison_lines import (
    COLUMNS,
    CONTROL,
    VARIANT,
    StudyTables,
    study_lines,
)
from positioning.evaluation.entries import protocol_of
from positioning.evaluation.ranks import (
    LEAST_COVERAGE,
    Block,
    DataSet,
    Ranks,
    complete_block,
    difference_ranks,
    mean_ranks,
)

WORLD, SAMPLE = "world", "sample"
"""What a paired difference is over."""

ONE_SAMPLE, REFUSED, ABSENT = "one sample", "samples unanswered", "not run there"
"""Why a data set is not in the block of ranks."""


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
    better_variants
        Variants of settings whose mean error is smaller than that of every competitor, with the number of
        data sets in which this is so. They are not ranked, and rows that train with the tested sample are
        none.
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
    better_variants: dict[str, int]
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
        better_variants=_better_variants(parts),
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


def _better_variants(parts: Sequence[Part]) -> dict[str, int]:
    """Return the variants that are ahead of all competitors on a data set, the first there, with counts."""
    found: Counter[str] = Counter()
    for study, lines in parts:
        learned = {row for row, entry in study.entries.items() if protocol_of(entry) == "resubstitution"}
        fit = lines[(lines["coverage"] >= LEAST_COVERAGE) & (lines["worlds"] == lines["of_worlds"])]
        for _, own in fit.groupby("family", sort=False):
            rivals = own[own["competes"]]
            variants = own[(own["role"] == VARIANT) & ~own["competes"] & ~own["algorithm"].isin(learned)]
            if len(rivals) and len(variants) and variants["mean_m"].min() < rivals["mean_m"].min():
                found[str(variants.sort_values("mean_m", kind="stable")["algorithm"].iloc[0])] += 1
    return dict(found.most_common())


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


def _common(lines: pd.DataFrame, ranked: Ranks | None) -> pd.DataFrame:
    """Return a row's lines on the data sets of the mean ranks, which all ranked rows share, else all."""
    if ranked is None:
        return lines
    inside = lines[[data_set in ranked.rank.index for data_set in _keys(lines)]]
    return inside if len(inside) else lines


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
                "seconds": _common(own, ranked)["seconds"].median(),
                "unlike_settings": len(settings[label]) > 1,
            }
        )
    return pd.DataFrame(lines).sort_values(
        ["rank", "beaten_share"], ascending=[True, False], kind="stable", ignore_index=True
    )
