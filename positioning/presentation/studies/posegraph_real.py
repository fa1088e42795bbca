"""Figures of pose graphs: where each row puts the poses, and what its answer costs.

See Gu et al., Figures 5 and 6, for the former.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.figures import Drawn
from positioning.presentation.style import stroke
from positioning.tasks.pose_graph import fit_to

Array = np.ndarray[Any, np.dtype[np.float64]]

COLUMNS = 3
START_COLOR = "#b4bcc3"
"""Pale, for most of it lies below the answer, but to be seen in print."""
DECADES_BESIDE = 1.6
"""Room to the right of the largest cost, decades, for what is written there."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the trajectories of each graph, then the costs of all answers.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    families = figures.measured_families(results)
    drawn = [_trajectories(results, family) for family in families]
    return [*drawn, _costs(results, families)] if families else []


def _trajectories(results: StudyResults, family: str) -> Drawn:
    observed, true_m = results.observed[family], _numbers(results.truth[family]["truth.position_m"])
    known = bool(np.isfinite(true_m).all(axis=-1).any())
    answers = {row: results.estimate(row, family) for row in figures.measured_rows(results, family)}
    places = {row: _numbers(found["position_m"]) for row, found in answers.items() if found}
    lines = math.ceil(len(places) / COLUMNS)
    figure = figures.new_figure(1.0 + 2.1 * lines)
    panels = figure.subplots(lines, min(COLUMNS, len(places)), squeeze=False).ravel()
    start_m = _numbers(observed["graph.position_m"])
    told = []
    for axes, (row, place_m) in zip(panels, places.items(), strict=False):
        if known:
            place_m = fit_to(place_m, true_m)
            axes.plot(*true_m[0].T, color="#111111", linewidth=0.8, label="truth", zorder=3)
        elif row != "dead_reckoning":
            axes.plot(*start_m[0].T, color=START_COLOR, linewidth=0.6, label="start", zorder=1)
            low_m, high_m = place_m[0].min(axis=0), place_m[0].max(axis=0)
            room_m = 0.15 * (high_m - low_m).max()
            axes.set(
                xlim=(low_m[0] - room_m, high_m[0] + room_m), ylim=(low_m[1] - room_m, high_m[1] + room_m)
            )
        axes.plot(*place_m[0].T, color=stroke(row).color, linewidth=0.7, zorder=2)
        axes.set_aspect("equal", adjustable="datalim" if known else "box")
        axes.set_title(row, fontsize=8)
        axes.tick_params(labelsize=7)
        error_m = figures.per_world(results, family, row)
        error_m = error_m[np.isfinite(error_m)]
        told.append(f"{row} {error_m[0]:.2f} m" if len(error_m) else row)
    for axes in panels[len(places) :]:
        axes.set_visible(False)
    for axes in panels[max(len(places) - COLUMNS, 0) : len(places)]:
        axes.set_xlabel("x (m)")
    for axes in panels[: len(places) : COLUMNS]:
        axes.set_ylabel("y (m)")
    handles = {
        label: line for axes in panels for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if handles:
        figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2)
    size = f"{start_m.shape[1]} poses, {observed['graph.motion'].shape[1]} motions"
    size += f" and {observed['graph.near_from'].shape[1]} pairs of near places"
    frame = (
        "Each answer, in colour, is turned and shifted as a whole so that it fits the true places best."
        if known
        else "Nobody knows the true places; the first pose is the same in all panels, and the axes are those"
        " of the answer, in colour; grey: where the search starts, cut off where it lies outside."
    )
    frame += _stopped_words(results, {family: list(places)}, "No minimum was reached.")
    words = "with their mean errors after this fit" if known else "without any known truth"
    return Drawn(
        name=f"trajectories_{family}",
        figure=figure,
        title=f"Trajectories, {family}",
        caption=f"{size}. {frame}",
        alt=f"Trajectories of {family}, {words}: {'; '.join(told)}.",
    )


def _costs(results: StudyResults, families: list[str]) -> Drawn:
    rows = {family: figures.measured_rows(results, family) for family in families}
    figure = figures.new_figure(0.6 + sum(0.55 + 0.22 * len(own) for own in rows.values()))
    panels = figure.subplots(
        len(families), 1, squeeze=False, height_ratios=[2 + len(own) for own in rows.values()]
    )
    told = []
    for axes, (family, own) in zip(panels.ravel(), rows.items(), strict=True):
        told.append(_cost_panel(axes, results, family, own))
    panels.ravel()[-1].set_xlabel("cost: sum of squares of all edges, in standard deviations")
    return Drawn(
        name="costs",
        figure=figure,
        title="Cost of every answer under one and the same cost",
        caption="The same sum of squares for all rows: motions with the information of their file, pairs of"
        " near places by what they are apart beyond 2 m, with an assumed standard deviation of one metre for"
        " a score of one, flat from 30 m on; no robust loss, which some rows minimise instead. Written: the"
        " cost, the steps of the search, and the mean error after the best rotation and shift where true"
        " places are known. The least cost is not the least error where many pairs are wrong."
        + _stopped_words(results, rows, "Hollow: no minimum was reached."),
        alt=" ".join(told),
    )


def _cost_panel(axes: Axes, results: StudyResults, family: str, rows: list[str]) -> str:
    told, costs = [], []
    for place, row in enumerate(rows):
        cost = float(figures.per_world(results, family, row, "cost")[0])
        steps, error_m = (
            figures.per_world(results, family, row, metric) for metric in ("iterations", "mean_m")
        )
        text = f"{cost:,.0f}" if cost >= 1000 else f"{cost:.4g}"
        stopped = _stopped(results, family, row)
        text += f", {int(steps[0])} steps" + (" (stopped)" if stopped else "") if len(steps) else ""
        text += f", {error_m[0]:.2f} m" if len(error_m) and np.isfinite(error_m[0]) else ""
        look = stroke(row)
        filling = "white" if stopped else look.color
        axes.plot(cost, place, look.marker, color=look.color, markerfacecolor=filling, linestyle="none")
        axes.annotate(
            text, (cost, place), xytext=(7, 0), textcoords="offset points", va="center", fontsize=7.5
        )
        told.append(f"{row} {text}")
        costs.append(cost)
    axes.set_xscale("log")
    positive = [cost for cost in costs if cost > 0] or [1.0]
    axes.set_xlim(min(positive) / 2, max(positive) * 10**DECADES_BESIDE)
    figures.label_rows(axes, rows)
    axes.set_title(family)
    return f"Costs of {family}: {'; '.join(told)}."


def _stopped(results: StudyResults, family: str, row: str) -> bool:
    """Tell whether a search did not end by itself; False for a row that does not tell."""
    return not np.all(results.estimate(row, family).get("extra_converged", True))


def _stopped_words(results: StudyResults, rows: Mapping[str, Sequence[str]], mark: str) -> str:
    """Return a sentence on the searches that did not end by themselves; empty where all did."""
    stopped = {family: [row for row in own if _stopped(results, family, row)] for family, own in rows.items()}
    told = "; ".join(f"{', '.join(own)} in {family}" for family, own in stopped.items() if own)
    words = f" {mark} The search stopped before it ended by itself, as a rule at the limit of its steps"
    return f"{words}: {told}." if told else ""


def _numbers(values: Any) -> Array:
    return np.asarray(values, dtype=float)
