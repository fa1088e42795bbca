"""Figures of the settings that were swept: distance of calibration points, weights, heading at the start.

See Frank et al., sections 1, 2 and 4; the paper draws none of them.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.foot_wlan_world import (
    CALIBRATED,
    FUSED,
    MEAN,
    PRINTED,
    TRUE_COLOR,
    WLAN,
    WORDS,
    calibration_points,
    legend_above,
    passages,
)
from positioning.presentation.style import stroke
from positioning.presentation.tables import central

DENSITY = {"points_every": FUSED, "points_every_wlan": WLAN}
WEIGHTS = {
    "sigma_wlan": "standard deviation of a WLAN fix (m)",
    "sigma_step": "standard deviation of a step (m)",
}
START = "start_heading"
TUNED = "cascaded_tuned"
MARKED = {FUSED: ("written down before", "--"), TUNED: ("best on other worlds", ":")}
"""Rows whose setting is marked on a sweep: words and line."""

Array = NDArray[np.float64]


def density(study: Study) -> Drawn | None:
    """Draw the mean error over the distance of calibration points.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    curves = [figures.curve(study.results, sweep) for sweep in DENSITY if _swept(study, sweep)]
    if not curves:
        return None
    family = study.families[0]
    spacing_m = _spacing_m(study)
    figure = figures.new_figure(3.3)
    axes = figure.subplots()
    told = []
    for number, curve in enumerate(curves):
        row = DENSITY[curve.name]
        place = curve.values * (spacing_m or 1.0)
        _sweep(axes, place, curve, row, WORDS[row], 1.03 ** (number - (len(curves) - 1) / 2))
        digits = study.printed.get((family, row), {}).get(MEAN)
        if digits and 1.0 in curve.values:
            place_m = (spacing_m or 1.0) * 1.03 ** (number - (len(curves) - 1) / 2)
            look = {**PRINTED, "markeredgecolor": stroke(row).color}
            axes.plot(place_m, float(digits), **look)
        told.append(_sweep_told(WORDS[row], place, curve, " m" if spacing_m else ""))
    if any(study.printed.get((family, DENSITY[curve.name]), {}).get(MEAN) for curve in curves):
        axes.plot([], [], **PRINTED, label="printed mean")
    label = "distance of calibration points (m)" if spacing_m else "every how many-th calibration point (1)"
    _log_axis(axes, np.unique(np.concatenate([c.values for c in curves])) * (spacing_m or 1.0), label)
    axes.set_ylim(bottom=0)
    legend_above(figure, axes)
    return Drawn(
        name="density",
        figure=figure,
        title="Distance of the calibration points",
        caption="Mean error at the passages of marks where all calibration points are kept, or every so"
        f" many-th, {_sweep_counted(study, curves)}. The paper names 2.5 and 5 m and prints means for one of"
        f" them only. {CALIBRATED}",
        alt=f"Mean error against the {label}. {'. '.join(told)}.",
        sweeps=tuple(curve.name for curve in curves),
    )


def weights(study: Study) -> Drawn | None:
    """Draw the mean error over the standard deviations of fixes and steps.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    curves = [figures.curve(study.results, sweep) for sweep in WEIGHTS if _swept(study, sweep)]
    if not curves:
        return None
    figure = figures.new_figure(3.2)
    panels = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    told, found = [], set()
    for axes, curve in zip(panels, curves, strict=True):
        _sweep(axes, curve.values, curve, FUSED, WORDS[FUSED])
        marks = []
        for row, (words, line) in MARKED.items():
            value = _value_of(study, curve.name, row)
            if value is not None:
                axes.axvline(value, color=TRUE_COLOR, linestyle=line, linewidth=1.0)
                marks.append(f"{words}: {value:g}")
                found.add(row)
        _log_axis(axes, curve.values, WEIGHTS[curve.name])
        told.append(
            _sweep_told(WEIGHTS[curve.name], curve.values, curve) + "".join(f", {mark}" for mark in marks)
        )
    for words, line in (mark for row, mark in MARKED.items() if row in found):
        panels[0].plot([], [], color=TRUE_COLOR, linestyle=line, linewidth=1.0, label=words)
    for axes in panels[1:]:
        axes.set_ylabel("")
    panels[0].set_ylim(bottom=0)
    legend_above(figure, panels[0])
    return Drawn(
        name="weights",
        figure=figure,
        title="Weights of fixes and steps",
        caption=f"Mean error of {FUSED} at the passages of marks, {_sweep_counted(study, curves)}. The paper"
        f" prints no variance. Dashed: the values of {FUSED}, assumed and written down before the first run."
        + (f" Dotted: that of {TUNED}, the best of a sweep on other worlds." if TUNED in found else "")
        + f" {CALIBRATED}",
        alt=f"Mean error against weights. {'. '.join(told)}.",
        sweeps=tuple(curve.name for curve in curves),
    )


def start_heading(study: Study) -> Drawn | None:
    """Draw the mean error over the error of the noted heading.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    if not _swept(study, START):
        return None
    curve = figures.curve(study.results, START)
    angle_deg = np.degrees(curve.values)
    figure = figures.new_figure(3.0)
    axes = figure.subplots()
    _sweep(axes, angle_deg, curve, FUSED, WORDS[FUSED])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("error added to the noted heading (degrees)")
    told = _sweep_told("Mean error", angle_deg, curve, " degrees", digits=0)
    return Drawn(
        name="start_heading",
        figure=figure,
        title="Error of the heading at the start",
        caption=f"Mean error of {FUSED} at the passages of marks, {_sweep_counted(study, [curve])}. The start"
        " is not printed; the filter assumes the noted heading with a standard deviation of nearly 30"
        " degrees."
        f" {CALIBRATED}",
        alt=f"Mean error of {FUSED} against the error of the noted heading. {told}.",
        sweeps=(START,),
    )


def _swept(study: Study, sweep: str) -> bool:
    own = study.results.measures
    own = own[(own["algorithm"] == sweep) & (own["family"] == study.families[0]) & (own["metric"] == MEAN)]
    return sweep in study.results.sweeps and len(own) > 0


def _sweep(axes: Axes, place: Array, curve: figures.Curve, row: str, label: str, shift: float = 1.0) -> None:
    """Draw means over worlds and where single experiments lie."""
    look = stroke(row)
    if curve.worlds > 1:
        axes.vlines(place * shift, curve.low_m, curve.high_m, color=look.color, linewidth=2.4, alpha=0.3)
    line = "--" if row == WLAN else "-"
    axes.plot(
        place * shift, curve.mean_m, look.marker, linestyle=line, color=look.color, markersize=5, label=label
    )
    axes.set_ylabel("mean position error (m)")


def _log_axis(axes: Axes, ticks: Array, label: str) -> None:
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{value:.3g}" for value in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(label)


def _sweep_told(
    head: str, place: Array, curve: figures.Curve, unit: str = "", digits: int | None = None
) -> str:
    values = [f"{v:.3g}" if digits is None else f"{v:.{digits}f}" for v in place]
    points = ", ".join(f"{m:.2f} m at {v}{unit}" for v, m in zip(values, curve.mean_m, strict=True))
    return f"{head}: {points}"


def _sweep_counted(study: Study, curves: Sequence[figures.Curve]) -> str:
    worlds = max(curve.worlds for curve in curves)
    if worlds == 1:
        return f"{passages(study)} in one world, family {study.families[0]}"
    return (
        f"{passages(study)} in each of {worlds} worlds, family {study.families[0]}: mean over worlds, bar:"
        f" {central(worlds)}"
    )


def _value_of(study: Study, sweep: str, row: str) -> float | None:
    """Return the swept value that a row has: where both make the same errors in all common worlds."""
    own = study.results.measures
    own = own[(own["metric"] == MEAN) & (own["family"] == study.families[0])]
    swept = own[own["algorithm"] == sweep].pivot(index="value", columns="world", values="x")
    fixed = own[(own["algorithm"] == row) & own["value"].isna()].set_index("world")["x"]
    common = swept.columns.intersection(fixed.index)
    if not len(common):
        return None
    same = np.isclose(swept[common], fixed[common], rtol=1e-9, atol=0).all(axis=1)
    return float(swept.index[int(np.argmax(same))]) if same.any() else None


def _spacing_m(study: Study) -> float | None:
    """Return the distance of calibration points in the first world, None where there is no survey."""
    place_m = study.first_world("observed", study.families[0]).get("survey.position_m", np.empty((0, 2)))
    point_m = calibration_points(place_m)
    if len(point_m) < 2:
        return None
    return round(float(np.median(np.linalg.norm(np.diff(point_m, axis=0), axis=1))), 2)
