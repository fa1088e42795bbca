"""The front page: the verdicts at a glance, then each study's answer with the figure that stands for it."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from positioning.evaluation.entries import task_of
from positioning.evaluation.ranks import LEAST_COVERAGE
from positioning.presentation import tables
from positioning.presentation.environment import environment
from positioning.presentation.pages import WORLDS_NEEDED, Picture, build_lines
from positioning.presentation.tones import GROUPS, is_control

GUESS = "control_centre"
"""The row that answers the centre of the site whatever was observed."""

SIDE_REM = 2.6
"""Side of the square of the largest count."""

PREDICATES = {
    "agrees": ("agrees", "agree"),
    "depends on the world": ("depends on the world", "depend on the world"),
    "undecided": ("is undecided", "are undecided"),
    "differs": ("differs", "differ"),
    "contradicts itself": ("contradicts the paper's own numbers", "contradict the paper's own numbers"),
    "not judged": ("is not judged", "are not judged"),
}


@dataclass(frozen=True)
class Summary:
    """What the front page says of a study.

    Attributes
    ----------
    study
        Its name.
    title
        Its title.
    paper
        Key of its paper.
    page
        Link to its own page.
    recorded
        Whether it runs on real recordings.
    worlds
        On what it runs, in words.
    table
        As `tables.read_table` reads it.
    claims
        What the paper claims of this study, as ``data/papers`` has it.
    entries
        Settings by row.
    reference
        The row of reference.
    picture
        The figure that stands for it.
    """

    study: str
    title: str
    paper: str
    page: str
    recorded: bool
    worlds: str
    table: pd.DataFrame
    claims: Sequence[Mapping[str, Any]]
    entries: Mapping[str, Mapping[str, Any]]
    reference: str
    picture: Picture | None


def front_page(
    summaries: Sequence[Summary],
    papers: Mapping[str, Mapping[str, Any]],
    claims: pd.DataFrame,
    manifest: Mapping[str, Any],
    *,
    quick: bool = False,
) -> str:
    """Return the front page as HTML.

    Parameters
    ----------
    summaries
        One a study, in their order.
    papers
        By key: ``authors``, ``title`` and whatever else names a paper.
    claims
        The ledger of all studies.
    manifest
        What the numbers came from.
    quick
        Whether they are those of a quick build.
    """
    order = list(dict.fromkeys(summary.paper for summary in summaries))
    return (
        environment()
        .get_template("index.html")
        .render(
            title="Reposition",
            here="index",
            quick=quick,
            worlds_needed=WORLDS_NEEDED,
            answer=in_short(claims),
            groups=shown_groups(claims),
            matrix=glance(order, claims),
            papers=[_paper(key, papers[key], summaries, claims) for key in order],
            build=build_lines(manifest),
        )
    )


def in_short(claims: pd.DataFrame) -> str:
    """Return the verdicts of a ledger in one sentence, by what they come to.

    Parameters
    ----------
    claims
        The ledger, or a part of it.
    """
    counted = [
        (int(claims["verdict"].isin(verdicts).sum()), PREDICATES[group]) for group, verdicts in GROUPS.items()
    ]
    told = [f"{count} {predicate[count != 1]}" for count, predicate in counted if count]
    if not told:
        return "The papers claim nothing here."
    return f"Of {len(claims)} claim{'s' * (len(claims) != 1)}, {tables.listed(told)}."


def shown_groups(claims: pd.DataFrame) -> dict[str, list[str]]:
    """Return the verdicts that a ledger has, by what they come to.

    Parameters
    ----------
    claims
        The ledger.
    """
    found = set(claims["verdict"])
    groups = {
        group: [verdict for verdict in verdicts if verdict in found] for group, verdicts in GROUPS.items()
    }
    return {group: verdicts for group, verdicts in groups.items() if verdicts}


def glance(papers: Sequence[str], claims: pd.DataFrame) -> list[dict[str, Any]]:
    """Return counts of verdicts by paper; areas of the squares are as the counts.

    Parameters
    ----------
    papers
        Keys, in the order of the lines.
    claims
        The ledger.
    """
    verdicts = [verdict for group in shown_groups(claims).values() for verdict in group]
    counts = claims.groupby(["paper", "verdict"]).size()
    most = max(counts, default=1)
    lines = []
    for paper in papers:
        numbers = [int(counts.get((paper, verdict), 0)) for verdict in verdicts]
        cells = [
            {"verdict": verdict, "count": count, "side_rem": round(SIDE_REM * math.sqrt(count / most), 3)}
            for verdict, count in zip(verdicts, numbers, strict=True)
        ]
        lines.append({"paper": paper, "cells": cells, "total": sum(numbers)})
    return lines


def best_rows(rows: Sequence[tables.Row], entries: Mapping[str, Mapping[str, Any]], reference: str) -> str:
    """Return which rows have the smallest mean error, over families or recordings, a sentence a task.

    A mean over easy samples alone is no merit: rows that answer less than `LEAST_COVERAGE` of what another
    one answers do not compete, and the sentence says so. It also says where no row beats a guess.

    Parameters
    ----------
    rows
        Of the table.
    entries
        Settings by row.
    reference
        The row of reference; its task is told first. Errors of different tasks do not compare.
    """
    first = task_of(entries[reference])
    by_task = tables.by_task(rows, entries)
    tasks = sorted((task for task in by_task), key=lambda task: task != first)
    found = [(task, _best_of(by_task[task], entries)) for task in tasks]
    told = [(task, sentence) for task, sentence in found if sentence]
    if len(told) == 1:
        return told[0][1]
    return " ".join(f"{task.replace('_', ' ').capitalize()}: {s[:1].lower()}{s[1:]}" for task, s in told)


def _best_of(competing: Sequence[tables.Row], entries: Mapping[str, Mapping[str, Any]]) -> str:
    """Return which rows of a task have the smallest mean error, and where no row beats a guess."""
    asked = list(dict.fromkeys(row.family for row in competing))
    families = [f for f in asked if any(row.cells for row in competing if row.family == f)]
    whole = [row for f in families for row in tables.whole_rows(r for r in competing if r.family == f)]
    own = {f: [row for row in whole if row.family == f] for f in families}
    # Where one row alone answers enough there is nothing to be better than.
    rivals = {f: sum(not is_control(row.algorithm) for row in own[f]) for f in families}
    best = {
        f: row for f in families if rivals[f] > 1 and (row := tables.best_row(own[f], entries)) is not None
    }
    if not best:
        return ""
    start = "The smallest mean error"
    if len(whole) < sum(bool(row.cells) for row in competing):
        start += f" of rows that answer at least {100 * LEAST_COVERAGE:.0f} % of the samples"
    if len(asked) == 1:
        told = f"{start} is that of {best[asked[0]]}."
    else:
        named = [f"{row} on {count}" for row, count in Counter(best.values()).most_common()]
        told = f"{start} is that of {tables.listed(named)}"
        alone = len(asked) - len(best)
        told += f"; on {alone} there is nothing to compare." if alone else "."
    guesses = 0
    for family, row in best.items():
        mean_m = {r.algorithm: r.cells["mean_m"].rebuilt for r in own[family]}
        guesses += mean_m.get(GUESS, math.inf) <= mean_m[row]
    if guesses:
        place = "There" if len(asked) == 1 else f"On {guesses}"
        told += f" {place} no row beats {GUESS}, which hears nothing."
    return told


def main_claims(claims: Sequence[Mapping[str, Any]], ledger: pd.DataFrame) -> list[dict[str, str]]:
    """Return what a paper mainly claims of a study, in its own order: the verdict and the claim in words.

    Parameters
    ----------
    claims
        As ``data/papers`` has them; those with ``main: true`` count.
    ledger
        Verdicts of the study.
    """
    chosen = {str(claim["id"]) for claim in claims if claim.get("main")}
    lines = []
    for line in tables.records(ledger):
        if line["claim"] in chosen:
            told = told_number(line)
            lines.append({"verdict": str(line["verdict"]), "what": str(line["what"]), "told": told})
    return lines


def told_number(line: Mapping[str, Any]) -> str:
    """Return the numbers of a claim in words: printed and rebuilt, or in how many worlds it is true."""
    rebuilt, worlds = float(line["rebuilt"]), int(line["worlds"])
    if math.isnan(rebuilt):
        return ""
    if line["printed"]:
        unit = f" {line['unit']}" if line["unit"] else ""
        return (
            f"printed {line['printed']}{unit}, rebuilt {tables.decimals(rebuilt, str(line['printed']))}{unit}"
        )
    if line["verdict"] == "none given":
        unit = f" {line['unit']}" if line["unit"] else ""
        return f"rebuilt {tables.decimals(rebuilt, least=0 if line['unit'] in tables.COUNTS else 2)}{unit}"
    return f"true in {round(rebuilt * worlds)} of {worlds} worlds"


def _paper(
    key: str, paper: Mapping[str, Any], summaries: Sequence[Summary], claims: pd.DataFrame
) -> dict[str, Any]:
    own = [summary for summary in summaries if summary.paper == key]
    return {
        "key": key,
        "paper": paper,
        "answer": in_short(claims[claims["paper"] == key]),
        "studies": [_study(summary, claims) for summary in own],
    }


def _study(summary: Summary, claims: pd.DataFrame) -> dict[str, Any]:
    own = claims[claims["study"] == summary.study]
    rows = tables.rows_of(summary.table, own, {"claims": summary.claims})
    printed = [row for row in rows if row.cells and row.cells["mean_m"].printed]
    said = in_short(own) if len(own) else best_rows(rows, summary.entries, summary.reference)
    where = summary.worlds[:1].upper() + summary.worlds[1:]
    said = (
        f"{where}: {said[:1].lower()}{said[1:]}" if said else f"The algorithms are compared {summary.worlds}."
    )
    return {
        "summary": summary,
        "answer": said,
        "main": main_claims(summary.claims, own),
        "printed": [(row.algorithm, row.cells["mean_m"]) for row in printed],
        "central": tables.central_of(tables.worlds_by_row(printed)) if printed else "",
    }
