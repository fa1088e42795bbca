"""The page that puts all algorithms of a task beside each other."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from positioning.evaluation.comparison import SAMPLE, WORLD, Comparison, Group
from positioning.evaluation.comparison_lines import CONTROL, MAIN, VARIANT
from positioning.evaluation.ranks import LEAST_ALGORITHMS, LEAST_COVERAGE, LEAST_DATA_SETS
from positioning.files import read_json
from positioning.presentation import tables
from positioning.presentation.comparison_figures import figure_name
from positioning.presentation.comparison_text import (
    LEFT_OUT,
    OVER,
    TOO_NARROW,
    answer,
    answered,
    competing,
    counted,
    data_sets_of,
    duration,
    fewer_worlds,
    percent,
    reservation,
)
from positioning.presentation.environment import environment
from positioning.presentation.svg import inline_svg

TIMES = " \N{MULTIPLICATION SIGN}"


def page(
    compared: Sequence[Comparison], folder: str | Path, manifest: Mapping[str, Any], *, quick: bool = False
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    compared
        As `positioning.evaluation.comparison.compare` returns them.
    folder
        Where `positioning.presentation.figures.save` wrote what `comparison_figures.draw` returns.
    manifest
        What the numbers came from.
    quick
        Whether they are those of a quick build.
    """
    pictures = _pictures(Path(folder))
    return (
        environment()
        .get_template("comparison.html")
        .render(
            title="Comparison of all algorithms",
            here="comparison",
            tasks=[_task(task, pictures) for task in compared],
            new=sorted(
                {str(row) for task in compared for row in task.lines.loc[task.lines["new"], "algorithm"]}
            ),
            data_sets=len({key for task in compared for key in data_sets_of(task.lines)}),
            rows=sum(int(competing(task.lines)["algorithm"].nunique()) for task in compared),
            manifest={key: value for key, value in manifest.items() if not isinstance(value, Mapping)},
            versions=manifest.get("packages", {}),
            seconds=sum(_numbers(manifest.get("seconds_by_rule", {}))),
            least={
                "algorithms": LEAST_ALGORITHMS,
                "data_sets": LEAST_DATA_SETS,
                "coverage": answered(LEAST_COVERAGE),
            },
            too_narrow=TOO_NARROW,
            quick=quick,
        )
    )


def _numbers(values: Any) -> list[float]:
    if isinstance(values, Mapping):
        return [number for value in values.values() for number in _numbers(value)]
    return [float(values)] if isinstance(values, (int, float)) else []


def _pictures(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the figures that were written, by name, ready for a page."""
    found = {}
    for item in read_json(folder / "captions.json"):
        text = (folder / f"{item['name']}.svg").read_text(encoding="utf-8")
        svg = Markup(inline_svg(text, item["name"], item["alt"]))
        found[item["name"]] = {**item, "svg": svg}
    return found


def _task(task: Comparison, pictures: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    lines = task.lines
    data_sets = data_sets_of(lines)
    kinds = dict(zip(lines["study"], lines["kind"], strict=True))
    recorded = sum(kinds[study] == "recorded" for study, _ in data_sets)
    silent = lines[lines["worlds"] == 0]
    return {
        "name": task.task,
        "title": task.task.replace("_", " ").capitalize(),
        "quantity": "distance" if task.task == "ranging" else "position",
        "algorithms": int(competing(lines)["algorithm"].nunique()),
        "synthetic": len(data_sets) - recorded,
        "recorded": recorded,
        "groups": [_group(task, group, pictures) for group in task.groups],
        "several": len(task.groups) > 1,
        "lines": [_line(line) for line in _in_order(lines)],
        "families": {study: [f for s, f in data_sets if s == study] for study, _ in data_sets},
        "skipped": [
            {
                "algorithm": row,
                "reason": reason,
                "places": [f"{s}: {f}" for s, f in zip(own["study"], own["family"], strict=True)],
            }
            for (row, reason), own in silent.groupby(["algorithm", "note"], sort=False)
        ],
    }


def _in_order(lines: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the measured lines by data set: those that compete by rank, then variants, then controls."""
    order = {data_set: number for number, data_set in enumerate(data_sets_of(lines))}
    places = {MAIN: 0, VARIANT: 1, CONTROL: 2}

    def place(line: Mapping[str, Any]) -> tuple[int, int, float]:
        return (
            order[(line["study"], line["family"])],
            0 if line["competes"] else places[line["role"]],
            line["mean_m"] if math.isnan(line["rank"]) else line["rank"],
        )

    return sorted(tables.records(lines[lines["worlds"] > 0]), key=place)


def _line(line: Mapping[str, Any]) -> dict[str, Any]:
    role = MAIN if line["competes"] else line["role"]
    low, high = line["interval_low_m"], line["interval_high_m"]
    return {
        **line,
        "role": role,
        "under": ", ".join([role] * (role != MAIN) + [line["use"]] * (line["use"] != line["algorithm"])),
        "cells": [
            (line[metric], tables.metres(line[metric])) for metric in ("p50_m", "p75_m", "p90_m", "p95_m")
        ],
        "mean": tables.metres(line["mean_m"]),
        "span": "" if math.isnan(low) else f"{tables.metres(low)} to {tables.metres(high)}",
        "rank_text": tables.NOTHING if math.isnan(line["rank"]) else f"{line['rank']:g}",
        "answered": answered(line["coverage"]),
        "won": percent(line["worlds_won_share"]),
        "time": duration(line["seconds"]),
        "in_worlds": (
            f"{line['worlds']} worlds"
            if line["worlds"] == line["of_worlds"]
            else f"{line['worlds']} of {line['of_worlds']:.0f} worlds"
        ),
    }


def _group(task: Comparison, group: Group, pictures: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    labels = [str(label) for label in group.summary["label"]]
    return {
        "name": f"{task.task}-{group.name}",
        "titles": group.titles,
        "alone": len(labels) < 2,
        "answer": answer(group),
        "reservation": " ".join(
            told for told in (fewer_worlds(competing(group.lines)), reservation(group)) if told
        ),
        "left_out": [
            {
                "reason": text,
                "places": [
                    f"{study}: {family} ({'synthetic' if kind == 'synthetic' else 'real'})"
                    for study, family, kind in zip(own["study"], own["family"], own["kind"], strict=True)
                ],
            }
            for reason, text in LEFT_OUT.items()
            if len(own := group.left_out[group.left_out["reason"] == reason])
        ],
        "counted": counted(group),
        "summary": [_summary(line) for line in tables.records(group.summary)],
        "with_ranks": group.ranks is not None,
        "ranks": pictures.get(figure_name(task, group, "ranks")),
        "times": pictures.get(figure_name(task, group, "times")),
        "labels": labels,
        "new": set(group.summary.loc[group.summary["new"], "label"]),
        "outcomes": [
            _outcomes(group.outcomes[group.outcomes["unit"] == unit], unit, labels)
            for unit in (WORLD, SAMPLE)
            if (group.outcomes["unit"] == unit).any()
        ],
        "matrices": [
            _matrix(own, str(study), str(family), labels)
            for (study, family), own in group.pairs.groupby(["study", "family"], sort=False)
            if (own["n"] > 1).any()
        ],
    }


def _summary(line: Mapping[str, Any]) -> dict[str, Any]:
    return {
        **line,
        "data_sets": line["synthetic"] + line["recorded"],
        "rank_text": tables.decimals(line["rank"]),
        "beaten": percent(line["beaten_share"]),
        "won": percent(line["won_share"]),
        "answered": answered(line["coverage"]),
        "least_answered": (
            f"least {answered(line['least_coverage'])}" if line["least_coverage"] < LEAST_COVERAGE else ""
        ),
        "over": tables.decimals(line["over_best"]) + ("" if math.isnan(line["over_best"]) else TIMES),
        "time": duration(line["seconds"]),
        "under": line["use"] if line["use"] != line["label"] else "",
    }


def _outcomes(own: pd.DataFrame, unit: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return in how many data sets paired differences over one unit are clear of zero, as a matrix."""
    found = {(line["label"], line["against"]): line for line in tables.records(own)}
    present = [label for label in labels if any(label == row for row, _ in found)]
    return {
        "unit": unit,
        "told": OVER[unit],
        "labels": present,
        "rows": [
            {
                "label": row,
                "cells": [_outcome(found.get((row, column)), row == column) for column in present],
            }
            for row in present
        ],
    }


def _outcome(found: Mapping[str, Any] | None, same: bool) -> dict[str, str]:
    if same or found is None:
        return {"text": "" if same else tables.NOTHING, "under": "", "tone": "same" if same else ""}
    better, worse, n = found["better"], found["worse"], found["n"]
    tone = "good" if better > worse else "bad" if worse > better else ""
    return {"text": f"{better}:{worse}", "under": f"of {n}", "tone": tone}


def _matrix(pairs: pd.DataFrame, study: str, family: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return the paired differences of one data set as a matrix, row minus column."""
    found = {(line["label"], line["against"]): line for line in tables.records(pairs)}
    present = [label for label in labels if any(label == row for row, _ in found)]
    unit = str(pairs["unit"].iloc[0])
    return {
        "study": study,
        "family": family,
        "unit": unit,
        "warning": TOO_NARROW if unit == SAMPLE else "",
        "n": _range(pairs.loc[pairs["n"] > 1, "n"]),
        "labels": present,
        "rows": [
            {
                "label": row,
                "cells": [_difference(found.get((row, column)), row == column) for column in present],
            }
            for row in present
        ],
    }


def _range(counts: "pd.Series[int]") -> str:
    low, high = int(counts.min()), int(counts.max())
    return f"{low}" if low == high else f"{low} to {high}"


def _difference(line: Mapping[str, Any] | None, same: bool) -> dict[str, str]:
    if same or line is None or line["n"] < 2:
        return {"text": "" if same else tables.NOTHING, "under": "", "tone": "same" if same else ""}
    low, high = line["low_m"], line["high_m"]
    return {
        "text": tables.metres(line["difference_m"]),
        "under": f"{tables.metres(low)} to {tables.metres(high)}",
        "tone": "good" if high < 0 else "bad" if low > 0 else "",
    }
