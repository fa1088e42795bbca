"""Figures of the settings that were swept in the WiFi graph SLAM studies.

See Gu et al., section III-B; the paper prints none of these numbers but the farthest distance of eq. 10.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.graph_slam_world import (
    ALIGNED,
    MEAN,
    TRUE_COLOR,
    legend_above,
    long_walks,
)
from positioning.presentation.style import stroke
from positioning.presentation.tables import central

MAX, EDGES = "max_m", "edges"

RIGID, ALONE = "control_rigid", "ransac"


class Sweep(NamedTuple):
    """A swept setting: the row that has its usual value, its axis, the title, and what must be said."""

    row: str
    label: str
    title: str
    note: str


SWEEPS = {
    "window": Sweep(
        ALIGNED,
        "window L (scans)",
        "Length of the window",
        "The paper does not print it. The threshold is the median distance of a scan to the others in it.",
    ),
    "farthest": Sweep(
        ALIGNED,
        "farthest distance of eq. 10 (m)",
        "Farthest distance that attracts",
        "The paper prints 30 m. All have one weight, so that a nearer end makes the line of eq. 10 steeper.",
    ),
    "fixed_threshold": Sweep(
        "aligned_fixed",
        "fixed threshold (dB)",
        "A fixed threshold in place of the adaptive one",
        "The paper holds that a fixed one cannot be used and prints no value; all of these are assumed.",
    ),
    "access_points": Sweep(
        ALIGNED,
        "access points heard (1)",
        "Number of access points",
        "The paper does not print their number; the first so many of all are heard.",
    ),
}

WEIGHTS = {
    "weight": (ALIGNED, "squared"),
    "weight_linear": ("aligned_linear", "linear, eq. 5"),
    "weight_cauchy": ("aligned_cauchy", "squared, Cauchy loss"),
}
"""Sweeps of the weight of WiFi edges: the row whose look they have, and the cost in words."""

LEVELS = {RIGID: ("walks laid on true paths", "--"), ALONE: ("aligned, no graph", ":")}
"""Rows that do not have the weight: words and line."""

Array = NDArray[np.float64]


def settings(study: Study) -> list[Drawn]:
    """Return the figures of the sweeps that were made.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    drawn = [_setting(study, name, sweep) for name, sweep in SWEEPS.items()]
    return [item for item in drawn if item is not None]


def weight(study: Study) -> Drawn | None:
    """Draw the mean landmark error over the weight of WiFi edges, for each cost.

    See Gu et al., eq. 5.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = long_walks(study)
    curves = [] if family is None else [(n, c) for n in WEIGHTS if len(c := _curve(study, family, n, MEAN))]
    if family is None or not curves:
        return None
    figure = figures.new_figure(3.7)
    axes = figure.subplots()
    told, best, worlds = [], {}, 1
    for number, (name, curve) in enumerate(curves):
        row, words = WEIGHTS[name]
        look = stroke(row)
        worlds = max(worlds, curve.shape[1] - 1)
        shift = 1.12 ** (number - (len(curves) - 1) / 2)
        _draw_curve(axes, curve, look.color, look.marker + look.line, words, shift)
        means_m = np.nanmean(curve[:, 1:], axis=1)
        least = int(np.argmin(means_m))
        best[name] = float(curve[least, 0])
        axes.plot(best[name] * shift, means_m[least], "o", color=look.color, fillstyle="none", markersize=11)
        told.append(f"{_told(words, curve)}; least at {best[name]:g}")
    used: dict[float, list[str]] = {}
    verdicts = []
    for name, _ in curves:
        row, words = WEIGHTS[name]
        value = value_of(study, family, name, row)
        if value is not None:
            used.setdefault(value, []).append(row)
            found = "is" if np.isclose(value, best[name]) else "is not"
            verdicts.append(f" Row {row} has {value:g} (line), which {found} the best shown for {words}.")
    for value, rows in used.items():
        named = f"{'rows' if len(rows) > 1 else 'row'} {', '.join(rows)}: {value:g}"
        axes.axvline(value, color=TRUE_COLOR, linewidth=1.0, label=named)
    for row, (words, line) in LEVELS.items():
        values = study.get(family, row, MEAN)
        if len(values):
            axes.axhline(values.mean(), color=stroke(row).color, linestyle=line, linewidth=1.1, label=words)
            told.append(f"{words}: {values.mean():.2f} m")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("weight of WiFi edges, \N{GREEK CAPITAL LETTER OMEGA} of eq. 5 (1)")
    axes.set_ylabel("mean landmark error (m)")
    _plain_log(axes)
    legend_above(figure, axes, columns=3)
    tried = sum(len(curve) for _, curve in curves)
    others = {name: len(values) for name, (_, values) in study.results.sweeps.items() if name not in WEIGHTS}
    more = "".join(
        f" {count} values of {name} were tried on these worlds as well." for name, count in others.items()
    )
    least_at = ", ".join(f"{WEIGHTS[name][1]} at {weight:g}" for name, weight in best.items())
    verdict = "".join(verdicts)
    return Drawn(
        name="weight",
        figure=figure,
        title="Weight of WiFi edges, on worlds of their own",
        caption=f"Mean landmark error, {_counted(study, family, worlds)}. {tried} weights are shown."
        f"{more} The largest error of eq. 10 is 1. The paper prints no weight. Ring: least of each cost,"
        f" {least_at}.{verdict} Both axes are logarithmic; markers of one weight stand beside each"
        " other. These worlds judge nothing else; they are assumed.",
        alt=f"Mean landmark error against the weight of WiFi edges, {tried} settings. {'. '.join(told)}."
        + verdict,
        sweeps=tuple(name for name, _ in curves),
    )


def value_of(study: Study, family: str, sweep: str, row: str) -> float | None:
    """Return the swept value that a row has: where both make the same errors in all common worlds.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    family
        A family of worlds.
    sweep
        Name of the sweep.
    row
        A row of the table.
    """
    own = study.results.measures
    own = own[(own["metric"] == MEAN) & (own["family"] == family)]
    swept = own[own["algorithm"] == sweep].pivot(index="value", columns="world", values="x")
    fixed = own[(own["algorithm"] == row) & own["value"].isna()].set_index("world")["x"]
    common = swept.columns.intersection(fixed.index)
    if not len(common):
        return None
    # A build with other libraries, or a row run apart, may differ in the last digits.
    same = np.isclose(swept[common], fixed[common], rtol=1e-6, atol=0).all(axis=1)
    return float(swept.index[int(np.argmax(same))]) if same.any() else None


def _setting(study: Study, name: str, sweep: Sweep) -> Drawn | None:
    family = long_walks(study)
    if family is None:
        return None
    curves = {metric: _curve(study, family, name, metric) for metric in (MEAN, MAX, EDGES)}
    if not len(curves[MEAN]):
        return None
    color = stroke(sweep.row).color
    panels_wide = 2 if len(curves[EDGES]) else 1
    figure = figures.new_figure(3.2)
    panels = figure.subplots(1, panels_wide, squeeze=False, width_ratios=[1.5, 1][:panels_wide])[0]
    told, worlds = [], curves[MEAN].shape[1] - 1
    for (metric, marker, words), shift in zip(
        ((MEAN, "o-", "mean of the visits"), (MAX, "^--", "largest of the visits")),
        (0.985, 1.015),
        strict=True,
    ):
        if len(curves[metric]):
            _draw_curve(panels[0], curves[metric], color, marker, words, shift)
            told.append(_told(words, curves[metric]))
    adaptive = study.get(family, ALIGNED, MEAN)
    if name == "fixed_threshold" and len(adaptive):
        same = adaptive[:worlds].mean()
        panels[0].axhline(
            same, color=stroke(ALIGNED).color, linestyle=":", linewidth=1.2, label="mean, adaptive threshold"
        )
        told.append(f"adaptive threshold, mean {same:.2f} m")
    panels[0].set_ylabel("landmark error (m)")
    if len(curves[EDGES]):
        thousands = np.column_stack([curves[EDGES][:, 0], curves[EDGES][:, 1:] / 1000])
        _draw_curve(panels[1], thousands, color, "s-", "edges", 1.0)
        panels[1].set_ylabel("WiFi edges (thousands)")
        told.append("edges: " + ", ".join(f"{line[1:].mean():.0f} at {line[0]:g}" for line in curves[EDGES]))
    value = value_of(study, family, name, sweep.row)
    for axes in panels:
        if value is not None:
            axes.axvline(value, color=TRUE_COLOR, linewidth=0.9, label=f"row {sweep.row}: {value:g}")
        axes.set_xscale("log")
        ticks = curves[MEAN][:, 0]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel(sweep.label)
        axes.set_ylim(bottom=0)
    legend_above(figure, panels[0], columns=4)
    return Drawn(
        name=name,
        figure=figure,
        title=sweep.title,
        caption=f"Errors at landmarks after alignment and graph SLAM, {_counted(study, family, worlds)}."
        f" {sweep.note} Other settings, the weight of WiFi edges among them, are assumed.",
        alt=f"Landmark errors against {sweep.label}. {'. '.join(told)}.",
        sweeps=(name,),
    )


def _curve(study: Study, family: str, sweep: str, metric: str) -> Array:
    """Return the setting's values in the first column, and a column for each world; empty without a sweep."""
    own = study.results.measures
    own = own[(own["family"] == family) & (own["algorithm"] == sweep) & (own["metric"] == metric)]
    if sweep not in study.results.sweeps or own.empty:
        return np.empty((0, 1))
    frame = own.pivot(index="value", columns="world", values="x")
    return np.column_stack([frame.index.to_numpy(dtype=float), frame.to_numpy(dtype=float)])


def _draw_curve(axes: Axes, curve: Array, color: str, look: str, label: str, shift: float) -> None:
    """Draw means over worlds with where single experiments lie."""
    place, worlds = curve[:, 0] * shift, curve[:, 1:]
    if worlds.shape[1] > 1:
        ends = np.array([figures.interval_of(line[~np.isnan(line)])[:2] for line in worlds])
        axes.vlines(place, ends[:, 0], ends[:, 1], color=color, linewidth=2.4, alpha=0.3)
    axes.plot(place, np.nanmean(worlds, axis=1), look, color=color, markersize=4.5, label=label)


def _told(head: str, curve: Array) -> str:
    points = ", ".join(f"{np.nanmean(line[1:]):.2f} m at {line[0]:g}" for line in curve)
    return f"{head}: {points}"


def _counted(study: Study, family: str, worlds: int) -> str:
    visits = _visits(study.values, family)
    if worlds < 2:
        return f"{visits} in one world, family {family}"
    return f"{visits} in each of {worlds} worlds, family {family}: mean over worlds, bar: {central(worlds)}"


def _visits(values: Mapping[tuple[str, str, str], Array], family: str) -> str:
    counts: Sequence[Array] = [v for (own, _, metric), v in values.items() if metric == "n" and own == family]
    return f"n = {np.concatenate(counts).max():.0f} visits of landmarks" if counts else "n = 0 visits"


def _plain_log(axes: Axes) -> None:
    """Write plain numbers along a logarithmic axis of metres."""
    low, high = axes.get_ylim()
    ticks = [tick for tick in (0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if low <= tick <= high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.yaxis.set_minor_locator(NullLocator())
