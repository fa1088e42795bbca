"""Figures of the comparison of all algorithms: mean ranks, and run time against error."""

import math
from collections.abc import Iterable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from positioning.evaluation.comparison import Comparison, Group
from positioning.evaluation.comparison_lines import CONTROL
from positioning.evaluation.ranks import LEAST_COVERAGE
from positioning.presentation import figures, tables
from positioning.presentation.comparison_text import (
    answered,
    competing,
    dependent,
    duration,
    fewer_worlds,
    probability,
)
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, Stroke, drawing, stroke

SINGLE_PANELS = 4
"""Studies of more data sets than this have one panel, with geometric means over them."""

NEW = " (new)"
PANELS_A_ROW = 3


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


def figure_name(task: Comparison, group: Group, what: str) -> str:
    """Return the name of the figure ``ranks`` or ``times``; it tells the group where a task has several."""
    return f"{task.task}_{what}" if len(task.groups) == 1 else f"{task.task}_{group.name}_{what}"


def _place(task: Comparison, group: Group) -> str:
    """Return in words which task a figure is of, and which group where the task has several."""
    words = task.task.replace("_", " ")
    return words if len(task.groups) == 1 else f"{words} of {group.name}"


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
    own = competing(group.lines)
    few = fewer_worlds(own[own["label"].isin(mean.index) & own["study"].isin(studies)])
    return Drawn(
        name=figure_name(task, group, "ranks"),
        figure=figure,
        title=f"Mean ranks, {_place(task, group)}",
        caption=(
            f"{len(mean)} algorithms on the {len(rank)} data sets of {tables.listed(studies)} in which all of"
            f" them answer at least {answered(LEAST_COVERAGE)} of the samples; ranks are of paired"
            f" differences at common samples.{' ' * bool(few)}{few}"
            " Large marker: mean rank; small dots: ranks in single data sets, larger where several agree."
            f" The bar reaches half of Nemenyi's critical difference ({2 * half:.2f} ranks) to either side:"
            " two algorithms differ at the 5 % level where their bars do not overlap;"
            " the grey band is that of the best."
            f" Friedman's test: p = {probability(group.ranks.friedman_p)}."
            f" {dependent(group, group.ranks)}"
        ),
        alt=f"Mean ranks, best first: {told}. Critical difference {2 * half:.2f}.",
    )


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
    with_rings = False
    for axes, (title, points) in zip(grid, panels, strict=False):
        with_rings |= _scatter(axes, points)
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
    if with_rings:
        key.plot([], [], "o", markersize=3.5, markerfacecolor="none", markeredgecolor=GREY, label="variants")
    if any(len(_unbeaten(points)) > 1 for _, points in panels):
        key.plot([], [], color=GREY, linewidth=0.9, label="no other is faster and better")
    if any((points["label"] == "control_oracle").any() for _, points in panels):
        key.plot([], [], "--", color="#000000", linewidth=0.9, label="control_oracle, any time")
    figure.legend(loc="outside lower left", ncols=3, handlelength=1.6, columnspacing=1.2)
    several = any(not points["complete"].all() for _, points in panels)
    return Drawn(
        name=figure_name(task, group, "times"),
        figure=figure,
        title=f"Run time against error, {_place(task, group)}",
        caption=(
            "Mean error over a row's own samples against the median run time on a world or recording, both"
            " axes logarithmic; low and left is better."
            + (
                f" A study of more than {SINGLE_PANELS} data sets has one panel, with geometric means over"
                " them."
                if any("data sets" in title for title, _ in panels)
                else ""
            )
            + (
                " A hollow marker stands for fewer data sets or worlds than others, or for less than"
                f" {answered(LEAST_COVERAGE)} of the samples of one, and compares less: the grey line passes"
                " it by."
                if several
                else ""
            )
            + " Variants beyond the axes, which hold all better ones, are left out. A row that builds on the"
            " fixes or steps of another one is charged its own time alone."
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

    A mean of all samples of all data sets and worlds that the study has is complete.
    Titles name the study where there are others beside it.
    """
    own = lines[(lines["study"] == study) & (lines["mean_m"] > 0) & (lines["seconds"] > 0)]
    whole = (own["coverage"] >= LEAST_COVERAGE) & (own["worlds"] == own["of_worlds"])
    own = own.assign(complete=whole)
    kept = own[(own["role"] != CONTROL) | (own["algorithm"] == "control_oracle")]
    if kept.empty:
        return []
    families = list(dict.fromkeys(kept["family"].astype(str)))
    if len(families) <= SINGLE_PANELS:
        title = study if len(families) == 1 else f"{study}: {{}}" if named else "{}"
        return [(title.format(family), kept[kept["family"] == family]) for family in families]
    logs = kept.assign(seconds=np.log(kept["seconds"]), mean_m=np.log(kept["mean_m"]))
    means = logs.groupby("label", sort=False).agg(
        seconds=("seconds", "mean"),
        mean_m=("mean_m", "mean"),
        competes=("competes", "any"),
        new=("new", "any"),
        n=("family", "size"),
        complete=("complete", "all"),
    )
    means[["seconds", "mean_m"]] = np.exp(means[["seconds", "mean_m"]])
    means["complete"] &= means["n"] == means["n"].max()
    return [(f"{study}, {len(families)} data sets", means.reset_index())]


def _scatter(axes: Axes, points: pd.DataFrame) -> bool:
    """Draw the rows of a panel; return whether rings for variants are among them."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    competing = points[points["competes"]].sort_values(["seconds", "mean_m"])
    # Variants may be hopeless on purpose; the axes are for those that compete.
    # A variant that is better than all of these is no reason to look away.
    better = points["mean_m"] < competing["mean_m"].min()
    shown = points[points["competes"] | (points["label"] == "control_oracle") | better]
    others = points[~points["competes"] & (points["label"] != "control_oracle")]
    for name, limit in (("seconds", axes.set_xlim), ("mean_m", axes.set_ylim)):
        values = np.log10(shown[name].to_numpy(dtype=float))
        pad = 0.12 * max(float(np.ptp(values)), 0.3)
        low, high = limit(10 ** (values.min() - pad), 10 ** (values.max() + pad))
        others = others[others[name].between(low, high)]
    (rings,) = axes.plot(
        others["seconds"], others["mean_m"], "o", markersize=3.5, markerfacecolor="none", markeredgecolor=GREY
    )
    rings.set_clip_on(False)
    rings.set_in_layout(False)
    for limit in points.loc[points["label"] == "control_oracle", "mean_m"]:
        axes.axhline(limit, color="#000000", linestyle="--", linewidth=0.9)
    front = _unbeaten(points)
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
    # Words of a few ticks are much cheaper to set than powers of ten, and easier to read.
    for axis, words, most in ((axes.xaxis, _short_duration, 3), (axes.yaxis, _short_metres, 5)):
        low, high = axis.get_view_interval()
        axis.set_major_locator(FixedLocator(_decades(low, high, most)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _, words=words: words(value)))
    return bool(len(others))


def _unbeaten(points: pd.DataFrame) -> pd.DataFrame:
    """Return the whole competing rows that no other one beats in both, the fastest first."""
    whole = points[points["competes"] & points["complete"]].sort_values(["seconds", "mean_m"])
    return whole[whole["mean_m"] <= whole["mean_m"].cummin()]


def _decades(low: float, high: float, most: int) -> list[float]:
    """Return round numbers for an axis: powers of ten, thinned, or the parts of one where there are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    inside: list[float] = []
    for parts in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)):
        inside = [p * 10.0**k for k in range(first, last + 1) for p in parts if low <= p * 10.0**k <= high]
        if len(inside) >= 2:
            return inside[:: -(-len(inside) // most)]
    # A short axis is almost linear.
    even = MaxNLocator(nbins=3, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(f"{value:.6g}") for value in even if low <= value <= high]


def _short_duration(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.99 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0e} s"


def _short_metres(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value / 1000:.3g} km"
