"""The page that puts all algorithms of a task beside each other, and its figures."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from positioning.evaluation.comparison import (
    ABSENT,
    CONTROL,
    LEAST_ALGORITHMS,
    LEAST_COVERAGE,
    LEAST_DATA_SETS,
    MAIN,
    ONE_SAMPLE,
    REFUSED,
    SAMPLE,
    VARIANT,
    WORLD,
    Comparison,
    Group,
    Ranks,
)
from positioning.files import read_json
from positioning.presentation import figures, tables
from positioning.presentation.environment import environment
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, Stroke, drawing, stroke
from positioning.presentation.svg import inline_svg

SINGLE_PANELS = 4
"""Studies of more data sets than this have one panel, with geometric means over them."""

NEW = " (new)"
TIMES = " \N{MULTIPLICATION SIGN}"
PANELS_A_ROW = 3

TOO_NARROW = (
    "Samples of one place depend on each other: these intervals are too narrow, and clear of zero more often"
    " than those over worlds."
)
OVER = {
    WORLD: "Synthetic families of several worlds, intervals over independent worlds.",
    SAMPLE: (
        f"Recordings and single worlds, intervals over samples. {TOO_NARROW} Several recordings of one place"
        " count as several."
    ),
}
"""What is said of paired differences, by what they are over."""

LEFT_OUT = {
    REFUSED: f"where a ranked row answers less than {100 * LEAST_COVERAGE:.0f} % of the samples",
    ABSENT: "where a ranked row did not run",
    ONE_SAMPLE: "of one error alone",
}
"""Which data sets are not in the mean ranks, in the order of telling."""


def draw(compared: Iterable[Comparison]) -> list[Drawn]:
    """Return the figures of all tasks: mean ranks, and run time against error, of every group.

    Parameters
    ----------
    compared
        As `positioning.evaluation.comparison.compare` returns them.
    """
    drawn = []
    for task in compared:
        for group in task.groups:
            with drawing([*group.summary["label"], "control_oracle"]):
                drawn += [item for item in (_ranks(task, group), _times(task, group)) if item is not None]
    return drawn


def page(
    compared: Sequence[Comparison], folder: str | Path, manifest: Mapping[str, Any], *, quick: bool = False
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    compared
        As `positioning.evaluation.comparison.compare` returns them.
    folder
        Where `positioning.presentation.figures.save` wrote what `draw` returns.
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
            data_sets=len({key for task in compared for key in _data_sets(task.lines)}),
            rows=sum(int(_competing(task.lines)["algorithm"].nunique()) for task in compared),
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


def percent(share: float) -> str:
    """Return a share in per cent, a dash where there is none."""
    return tables.NOTHING if math.isnan(share) else f"{100 * share:.0f} %"


def answered(share: float) -> str:
    """Return a share of samples in per cent, rounded down: only all of them are 100 %."""
    return tables.NOTHING if math.isnan(share) else f"{math.floor(100 * share + 1e-9)} %"


def duration(seconds: float) -> str:
    """Return a run time with two digits and the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.95 * size:
            value = seconds / size
            return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"
    return tables.NOTHING if math.isnan(seconds) else "below 1 µs"


def answer(group: Group) -> str:
    """Return which algorithm is ahead, how it does against the next one, and what the ranks leave out."""
    if group.ranks is None:
        return (
            f"{_counted(group)}; too few data sets share {LEAST_ALGORITHMS} algorithms that answer the same"
            " samples for a critical difference, so that the paired differences decide."
        )
    mean, best = group.ranks.mean, group.ranks.best()
    told = (
        f"Lowest mean rank over {len(group.ranks.rank)} data sets: {_listed(best)}"
        f" ({mean.iloc[0]:.1f} of {len(mean)})"
    )
    unlike = group.ranks.unlike_best()
    alike = [str(name) for name in mean.index if name not in unlike and name not in best]
    if alike:
        told += (
            f"; {_listed(alike)} {'is' if len(alike) == 1 else 'are'} not told apart from"
            f" {'it' if len(best) == 1 else 'them'} by mean ranks alone"
        )
    elif unlike:
        told += ", told apart from all others"
    return " ".join([f"{told}.", _against_second(group, mean), _left_out(group)]).strip()


def _against_second(group: Group, mean: "pd.Series[float]") -> str:
    """Return the paired outcomes of the best mean rank against the next one, by unit."""
    first, second = str(mean.index[0]), str(mean.index[1])
    own = group.outcomes[(group.outcomes["label"] == first) & (group.outcomes["against"] == second)]
    found = {line["unit"]: line for line in tables.records(own)}
    told = [
        f"{line['better']}:{line['worse']} of {line['n']} data set{'s' * (line['n'] != 1)} over {unit}s"
        for unit in (WORLD, SAMPLE)
        if (line := found.get(unit)) is not None
    ]
    if not told:
        return ""
    return (
        f"Paired with {second}, next in rank, the error of {first} is clearly smaller : larger in"
        f" {_listed(told)}."
    )


def _left_out(group: Group) -> str:
    counts = group.left_out["reason"].value_counts()
    told = [f"{counts[reason]} {text}" for reason, text in LEFT_OUT.items() if counts.get(reason, 0)]
    return f"Data sets left out of the ranks: {_listed(told)}." if told else ""


def reservation(group: Group) -> str:
    """Return Friedman's p and Nemenyi's critical difference, with what they cannot know."""
    if group.ranks is None:
        return ""
    return (
        f"Friedman's test: p = {_probability(group.ranks.friedman_p)}; Nemenyi's critical difference:"
        f" {group.ranks.critical_difference:.2f} ranks. {_dependent(group, group.ranks)}"
        + (
            " Rows without a mean rank ran, or answered enough samples, in too few of the data sets."
            if group.summary["rank"].isna().any()
            else ""
        )
    )


def _dependent(group: Group, ranked: Ranks) -> str:
    """Return how far from independent the data sets are that the tests take for independent."""
    data_sets = len(ranked.rank)
    told = "Both take data sets for independent."
    if group.sources < data_sets:
        told += (
            f" These {data_sets} are of {group.sources} source{'s' * (group.sources != 1)}, collections of"
            " recordings or synthetic studies: several of one place, device or simulation count as several,"
            " so that p and the critical difference are too small."
        )
    return told


def _counted(group: Group) -> str:
    algorithms, data_sets = len(group.summary), len(_data_sets(_competing(group.lines)))
    return f"{algorithms} algorithm{'s' * (algorithms != 1)} on {data_sets} data set{'s' * (data_sets != 1)}"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _data_sets(lines: pd.DataFrame) -> list[tuple[str, str]]:
    """Return study and family of the lines that were measured, in their order."""
    own = lines[lines["worlds"] > 0]
    return list(dict.fromkeys(zip(own["study"].astype(str), own["family"].astype(str), strict=True)))


def _competing(lines: pd.DataFrame) -> pd.DataFrame:
    """Return the lines that were measured and compete: only these may have a rank."""
    return lines[lines["competes"]]


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


def _name(task: Comparison, group: Group, what: str) -> str:
    return f"{task.task}_{what}" if len(task.groups) == 1 else f"{task.task}_{group.name}_{what}"


def _label(group: Group, label: str) -> str:
    new = set(group.summary.loc[group.summary["new"], "label"])
    return label + (NEW if label in new else "")


def _look(label: str) -> Stroke:
    # A label names its algorithm in brackets where studies use one name for two.
    return stroke(label.partition(" (")[0])


def _ranks(task: Comparison, group: Group) -> Drawn | None:
    """Draw mean ranks with bars of half the critical difference: apart where bars do not overlap."""
    if group.ranks is None:
        return None
    rank, mean, half = group.ranks.rank, group.ranks.mean, group.ranks.critical_difference / 2
    figure = figures.new_figure(1.0 + 0.27 * len(mean))
    axes = figure.subplots()
    axes.axvspan(mean.iloc[0] - half, mean.iloc[0] + half, color="#eef1f4", zorder=0)
    for place, (label, value) in enumerate(mean.items()):
        look = _look(str(label))
        ranks, times = np.unique(rank[label], return_counts=True)
        axes.scatter(ranks, np.full(len(ranks), place), s=10 + 9 * times, color="#b9c1c8", zorder=1)
        axes.plot([value - half, value + half], [place, place], color=look.color, linewidth=3.2, alpha=0.7)
        axes.plot(value, place, look.marker, color=look.color, markersize=7, zorder=3)
    labels = [_label(group, str(label)) for label in mean.index]
    figures.label_rows(axes, labels)
    for text in axes.get_yticklabels():
        text.set_fontweight("bold" if text.get_text().endswith(NEW) else "normal")
    axes.set_xlim(
        min(1.0, float(mean.iloc[0]) - half) - 0.2, max(len(mean), float(mean.iloc[-1]) + half) + 0.2
    )
    axes.set_xticks(range(1, len(mean) + 1))
    axes.set_xlabel("rank by error at common samples, 1 is the smallest")
    studies = list(dict.fromkeys(str(study) for study, _ in rank.index))
    told = "; ".join(f"{label} {value:.2f}" for label, value in mean.items())
    return Drawn(
        name=_name(task, group, "ranks"),
        figure=figure,
        title="Mean ranks",
        caption=(
            f"{len(mean)} algorithms on the {len(rank)} data sets of {_listed(studies)} in which all of them"
            f" answer at least {answered(LEAST_COVERAGE)} of the samples; ranks are of paired differences at"
            " common samples. Large marker: mean rank; small dots: ranks in single data sets, larger where"
            " several agree. The bar reaches half of Nemenyi's critical difference"
            f" ({2 * half:.2f} ranks) to either side: two algorithms differ at the 5 % level where their bars"
            " do not overlap; the grey band is that of the best."
            f" Friedman's test: p = {_probability(group.ranks.friedman_p)}."
            f" {_dependent(group, group.ranks)}"
        ),
        alt=f"Mean ranks, best first: {told}. Critical difference {2 * half:.2f}.",
    )


def _probability(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}".replace("e-0", "e-")


def _times(task: Comparison, group: Group) -> Drawn | None:
    """Draw run time against mean error, a panel a data set, or one a study with many of them."""
    panels = [panel for study in group.titles for panel in _panels(group.lines, study, len(group.titles) > 1)]
    panels = [(title, points) for title, points in panels if points["competes"].sum() > 1]
    if not panels:
        return None
    columns = min(PANELS_A_ROW, len(panels))
    rows = -(-len(panels) // columns)
    shown = {label for _, points in panels for label in points.loc[points["competes"], "label"]}
    labels = [str(label) for label in group.summary["label"] if label in shown]
    legend_rows = -(-(len(labels) + 3) // 3)
    figure = figures.new_figure(2.5 * rows + 0.2 * legend_rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (title, points) in zip(grid, panels, strict=False):
        _scatter(axes, points)
        axes.set_title(title, fontsize=8)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for number, axes in enumerate(grid[: len(panels)]):
        if number % columns == 0:
            axes.set_ylabel("mean error (m)")
        if number + columns >= len(panels):
            axes.set_xlabel("time a world")
    key = grid[0]
    for label in labels:
        look = _look(label)
        key.plot([], [], look.marker, color=look.color, label=_label(group, label))
    if any((~points["competes"] & (points["label"] != "control_oracle")).any() for _, points in panels):
        key.plot([], [], "o", markersize=3.5, markerfacecolor="none", markeredgecolor=GREY, label="variants")
    key.plot([], [], color=GREY, linewidth=0.9, label="no other is faster and better")
    if any((points["label"] == "control_oracle").any() for _, points in panels):
        key.plot([], [], "--", color="#000000", linewidth=0.9, label="control_oracle, any time")
    figure.legend(loc="outside lower left", ncols=3, handlelength=1.6, columnspacing=1.2)
    several = any(not points["complete"].all() for _, points in panels)
    return Drawn(
        name=_name(task, group, "times"),
        figure=figure,
        title="Run time against error",
        caption=(
            "Mean error against the median run time on a world or recording, both axes logarithmic; low and"
            " left is better."
            + (
                " A study of more than"
                f" {SINGLE_PANELS} data sets has one panel, with geometric means over them"
                + (
                    "; a hollow marker stands for fewer data sets than others and compares less."
                    if several
                    else "."
                )
                if any("data sets" in title for title, _ in panels)
                else ""
            )
            + " Variants beyond the axes are left out. A row that builds on the fixes or steps of another one"
            " is charged its own time alone."
        ),
        alt="Run time and mean error. "
        + " ".join(
            f"{title}: "
            + "; ".join(
                f"{line['label']} {duration(line['seconds'])}, {tables.metres(line['mean_m'])} m"
                for line in tables.records(points[points["competes"]].sort_values("mean_m"))
            )
            + "."
            for title, points in panels
        ),
    )


def _panels(lines: pd.DataFrame, study: str, named: bool) -> list[tuple[str, pd.DataFrame]]:
    """Return title and points of each panel of a study: ``label, seconds, mean_m, competes, complete``.

    Titles name the study where there are others beside it.
    """
    own = lines[(lines["study"] == study) & (lines["mean_m"] > 0) & (lines["seconds"] > 0)]
    kept = own[(own["role"] != CONTROL) | (own["algorithm"] == "control_oracle")]
    if kept.empty:
        return []
    families = list(dict.fromkeys(kept["family"].astype(str)))
    if len(families) <= SINGLE_PANELS:
        title = study if len(families) == 1 else f"{study}: {{}}" if named else "{}"
        return [
            (title.format(family), kept[kept["family"] == family].assign(complete=True))
            for family in families
        ]
    logs = kept.assign(seconds=np.log(kept["seconds"]), mean_m=np.log(kept["mean_m"]))
    means = logs.groupby("label", sort=False).agg(
        seconds=("seconds", "mean"),
        mean_m=("mean_m", "mean"),
        competes=("competes", "any"),
        new=("new", "any"),
        n=("family", "size"),
    )
    means[["seconds", "mean_m"]] = np.exp(means[["seconds", "mean_m"]])
    means["complete"] = means["n"] == means["n"].max()
    return [(f"{study}, {len(families)} data sets", means.reset_index())]


def _scatter(axes: Axes, points: pd.DataFrame) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    competing = points[points["competes"]].sort_values(["seconds", "mean_m"])
    others = points[~points["competes"] & (points["label"] != "control_oracle")]
    axes.plot(
        others["seconds"], others["mean_m"], "o", markersize=3.5, markerfacecolor="none", markeredgecolor=GREY
    )
    for limit in points.loc[points["label"] == "control_oracle", "mean_m"]:
        axes.axhline(limit, color="#000000", linestyle="--", linewidth=0.9)
    whole = competing[competing["complete"]]
    front = whole[whole["mean_m"] <= whole["mean_m"].cummin()]
    axes.plot(front["seconds"], front["mean_m"], color=GREY, linewidth=0.9, drawstyle="steps-post", zorder=1)
    for line in tables.records(competing):
        look, new = _look(line["label"]), bool(line.get("new", False))
        axes.plot(
            line["seconds"],
            line["mean_m"],
            look.marker,
            color=look.color,
            markersize=8 if new else 6,
            markerfacecolor=look.color if line["complete"] else "white",
            markeredgecolor="#111111" if new else look.color,
            zorder=4 if new else 3,
        )
    # Variants may be hopeless on purpose; the axes are for those that compete.
    shown = points[points["competes"] | (points["label"] == "control_oracle")]
    for name, limit in (("seconds", axes.set_xlim), ("mean_m", axes.set_ylim)):
        values = np.log10(shown[name].to_numpy(dtype=float))
        pad = 0.12 * max(float(np.ptp(values)), 0.3)
        limit(10 ** (values.min() - pad), 10 ** (values.max() + pad))
    # Words of a few ticks are much cheaper to set than powers of ten, and easier to read.
    for axis, words, most in ((axes.xaxis, _short_duration, 3), (axes.yaxis, _short_metres, 5)):
        low, high = axis.get_view_interval()
        axis.set_major_locator(FixedLocator(_decades(low, high, most)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _, words=words: words(value)))


def _decades(low: float, high: float, most: int) -> list[float]:
    """Return round numbers for an axis: powers of ten, thinned, or the parts of one where there are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    inside: list[float] = []
    for parts in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)):
        inside = [p * 10.0**k for k in range(first, last + 1) for p in parts if low <= p * 10.0**k <= high]
        if len(inside) >= 2:
            break
    # An axis of less than that has one number, so that it is not without any.
    return inside[:: -(-len(inside) // most)] if inside else [float(f"{math.sqrt(low * high):.3g}")]


def _short_duration(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.99 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0e} s"


def _short_metres(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value / 1000:.3g} km"


def _task(task: Comparison, pictures: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    lines = task.lines
    data_sets = _data_sets(lines)
    kinds = dict(zip(lines["study"], lines["kind"], strict=True))
    recorded = sum(kinds[study] == "recorded" for study, _ in data_sets)
    silent = lines[lines["worlds"] == 0]
    return {
        "name": task.task,
        "title": task.task.replace("_", " ").capitalize(),
        "quantity": "distance" if task.task == "ranging" else "position",
        "algorithms": int(_competing(lines)["algorithm"].nunique()),
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
    order = {data_set: number for number, data_set in enumerate(_data_sets(lines))}
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
    }


def _group(task: Comparison, group: Group, pictures: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    labels = [str(label) for label in group.summary["label"]]
    return {
        "name": f"{task.task}-{group.name}",
        "titles": group.titles,
        "alone": len(labels) < 2,
        "answer": answer(group),
        "reservation": reservation(group),
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
        "counted": _counted(group),
        "summary": [_summary(line) for line in tables.records(group.summary)],
        "with_ranks": group.ranks is not None,
        "ranks": pictures.get(_name(task, group, "ranks")),
        "times": pictures.get(_name(task, group, "times")),
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
