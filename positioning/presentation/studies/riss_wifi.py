"""Figures of odometer, gyroscope and WiFi, numbered as in the paper where it has them.

See Atia et al., Figures 3 to 23 and Table 2. Those of one drive stand in `riss_wifi_world`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from positioning.evaluation.results import StudyResults
from positioning.evaluation.statistics import Interval, paired_difference
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.riss_wifi_world import FULL, INTEGRATED, RISS, SYSTEMS, draw_drive
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, decimals
from positioning.presentation.tones import is_control

RMSE, MAX = "rmse_m", "max_m"

SHARE_CLAIM, SHARE_M = "accuracy.share", 1.0
"""The claim with the printed share of Figure 23, and the error that it belongs to."""

COLUMNS = {
    "columns_fos": ("wifi_fos", "fast orthogonal search"),
    "columns_pca": ("wifi_pca", "principal components"),
    "columns_strongest": ("wifi_strongest", "strongest"),
    "columns_random": ("wifi_random", "random"),
}
PARTICLES = {
    "plain_particles": ("plain", "plain particle filter"),
    "mixture_particles": ("mixture", "mixture particle filter"),
}
SCANS = {"scan_every": (INTEGRATED, "integrated")}
"""Sweeps of a figure: the row whose look they have, and words."""

CALIBRATED = (
    "The residual bias of the gyroscope and the fading are calibrated on the printed RMSE of RISS and of the"
    " full map, on other worlds; no other printed number entered."
)

Array = np.ndarray[Any, np.dtype[np.float64]]
Dots = Mapping[tuple[str, str], tuple[float, Interval]]
"""Mean and interval by family and row."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures in the order of the paper, then those that it does not have.

    What a configuration leaves out is left out here: a row has no dot, a sweep no figure.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    drawn = [make(study) for make in FIGURES]
    return [*draw_drive(study), *(item for item in drawn if item is not None)]


def _cumulative(study: Study) -> Drawn | None:
    rows = {
        family: [row for row in SYSTEMS if len(study.get(family, row, RMSE))] for family in study.families
    }
    families = [family for family in study.families if rows[family]]
    if not families:
        return None
    printed = figures.printed_or_none(study.results, SHARE_CLAIM)
    figure = figures.new_figure(3.2)
    panels = figure.subplots(1, len(families), sharey=True, squeeze=False)[0]
    for axes, family in zip(panels, families, strict=True):
        figures.distribution(axes, study.results, family, rows[family])
        if printed is not None:
            look = {**_PRINTED, "markeredgecolor": stroke(INTEGRATED).color}
            axes.plot(SHARE_M, 100 * float(printed), **look, label=f"printed, {INTEGRATED}")
        axes.set_title(family)
        axes.set_xlabel("position error (m)")
    for axes in panels[1:]:
        axes.set_ylabel("")
    reach_m = max(axes.get_xlim()[1] for axes in panels)
    for axes in panels:
        axes.set_xlim(0, reach_m)
    _legend(figure, panels[0], columns=5)
    shares = _shares(study, families)
    told = f" Printed: {100 * float(printed):.0f} % within {SHARE_M:g} m." if printed else ""
    return Drawn(
        name="fig23",
        figure=figure,
        title="Cumulative error at the way-points",
        caption=f"Share of errors up to a given size at the way-points, all worlds pooled: {_counted(study)}."
        + (f" Hollow diamond, in its colour: printed for {INTEGRATED} at {SHARE_M:g} m." if printed else "")
        + (f" Within {SHARE_M:g} m: {shares}." if shares else "")
        + f" {CALIBRATED}",
        alt=" ".join(figures.distribution_alt(study.results, family, rows[family]) for family in families)
        + told,
    )


def _table(study: Study) -> Drawn | None:
    rows = [row for row in study.rows(RMSE) if row in SYSTEMS]
    if not rows:
        return None
    figure = figures.new_figure(1.2 + 0.42 * len(rows))
    panels = figure.subplots(1, 2, sharey=True)
    told = []
    for axes, metric, words in zip(
        panels, (RMSE, MAX), ("root mean square error", "largest error"), strict=True
    ):
        dots = _levels(study, rows, metric)
        _dots_of_families(axes, study, rows, dots)
        for place, row in enumerate(rows):
            digits = {study.printed.get((family, row), {}).get(metric) for family in study.families} - {None}
            for printed in digits:
                axes.plot(float(str(printed)), place, **_PRINTED)
        axes.set_xlim(left=0)
        axes.set_xlabel(f"{words} (m)")
        told.append(_told(words.capitalize(), study, rows, dots, metric))
    _families_above(figure, study, panels[0], "printed")
    return Drawn(
        name="table2",
        figure=figure,
        title="Errors of the four systems, printed and rebuilt",
        caption=f"Errors at the way-points: mean over worlds{_bars(study)}; hollow diamond: printed."
        f" {_counted(study)}. {CALIBRATED}",
        alt=" ".join(told),
    )


def _columns(study: Study) -> Drawn | None:
    return _sweeps(
        study,
        "columns",
        COLUMNS,
        "columns kept",
        "Columns of the radio map",
        "The paper keeps 4 of 132 columns and does not print the error of other numbers.",
        line=FULL,
    )


def _particles(study: Study) -> Drawn | None:
    return _sweeps(
        study,
        "particles",
        PARTICLES,
        "particles",
        "Number of particles",
        "The paper does not print the number of particles.",
    )


def _scan_rate(study: Study) -> Drawn | None:
    return _sweeps(
        study,
        "scan_rate",
        SCANS,
        "every how many-th scan is used",
        "How often WiFi is used",
        "The paper does not print how often it scans; here once a second. The adaptive mixture filter without"
        " clusters: each sample has its own weight.",
    )


def _filters(study: Study) -> Drawn | None:
    rows = _filter_rows(study)
    if not rows:
        return None
    dots = _levels(study, rows, RMSE)
    figure = figures.new_figure(0.9 + 0.3 * len(rows))
    axes = figure.subplots()
    _dots_of_families(axes, study, rows, dots)
    axes.set_xlim(left=0)
    axes.set_xlabel("root mean square error (m)")
    _families_above(figure, study, axes)
    return Drawn(
        name="filters",
        figure=figure,
        title="The filters against each other",
        caption=f"Root mean square error at the way-points: mean over worlds{_bars(study)}."
        f" {_counted(study)}."
        f" Noises and weights of the filters are assumed. {CALIBRATED}",
        alt=_told("Root mean square error", study, rows, dots),
    )


def _paired(study: Study) -> Drawn | None:
    rows = [row for row in _filter_rows(study) if row != INTEGRATED]
    dots = _differences(study, rows)
    rows = [row for row in rows if any((family, row) in dots for family in study.families)]
    if not rows:
        return None
    figure = figures.new_figure(1.05 + 0.3 * len(rows))
    axes = figure.subplots()
    _dots_of_families(axes, study, rows, dots)
    axes.axvline(0, color="#111111", linewidth=1.0)
    axes.set_xlabel(f"RMSE minus that of {INTEGRATED} (m)\nleft of the line: better than {INTEGRATED}")
    _families_above(figure, study, axes, interval="95 % interval of the mean")
    interval = ", with the 95 % interval of the mean difference" if _worlds(study) > 1 else ""
    return Drawn(
        name="paired",
        figure=figure,
        title=f"Paired differences to {INTEGRATED}",
        caption=f"Root mean square error minus that of {INTEGRATED} on the same worlds{interval}."
        f" {_counted(study)}. Noises and weights of the filters are assumed.",
        alt=_told(f"Difference to {INTEGRATED}", study, rows, dots),
    )


FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (
    *(_cumulative, _table),
    *(_columns, _filters, _paired, _particles, _scan_rate),
)
"""What draws each figure over all worlds, in their order; None where what it shows is absent."""

_PRINTED: dict[str, Any] = {
    "marker": "D",
    "markersize": 8,
    "markerfacecolor": "none",
    "markeredgecolor": "#111111",
    "markeredgewidth": 1.1,
    "linestyle": "none",
    "zorder": 5,
    "clip_on": False,
}


def _filter_rows(study: Study) -> list[str]:
    """Return the rows that take motion and WiFi together."""
    return [
        row for row in study.rows(RMSE) if row != RISS and not row.startswith("wifi_") and not is_control(row)
    ]


def _levels(study: Study, rows: Sequence[str], metric: str) -> Dots:
    """Return means over worlds, with where single experiments lie."""
    found = {}
    for family in study.families:
        for row in rows:
            values = study.get(family, row, metric)
            if len(values):
                found[family, row] = (float(values.mean()), figures.interval_of(values))
    return found


def _differences(study: Study, rows: Sequence[str]) -> Dots:
    """Return mean differences to the integrated system over the worlds that both have."""
    own = study.results.measures
    own = own[own["value"].isna() & (own["metric"] == RMSE)]
    found = {}
    for family in study.families:
        wide = own[own["family"] == family].pivot(index="world", columns="algorithm", values="x")
        for row in rows:
            if {row, INTEGRATED} <= set(wide.columns):
                both = wide[[row, INTEGRATED]].dropna().to_numpy(dtype=float)
                if len(both):
                    mean = float(np.mean(both[:, 0] - both[:, 1]))
                    low, high = (mean, mean)
                    if len(both) > 1:
                        _, low, high, _, _ = paired_difference(both[:, 0], both[:, 1])
                    found[family, row] = (mean, Interval(low, high, 0.95))
    return found


def _dots_of_families(axes: Axes, study: Study, rows: Sequence[str], dots: Dots) -> None:
    """Draw a dot and its interval for each row and family, the families one below the other."""
    count = len(study.families)
    for place, row in enumerate(rows):
        for number, family in enumerate(study.families):
            if (family, row) not in dots:
                continue
            mean, (low, high, _) = dots[family, row]
            look, height = study.look(family), place + 0.36 * (number - (count - 1) / 2)
            if high > low:
                axes.plot(
                    [low, high],
                    [height, height],
                    color=look.color,
                    linewidth=3.2,
                    alpha=0.45,
                    solid_capstyle="round",
                )
            axes.plot(mean, height, look.marker, color=look.color, markersize=5)
    figures.label_rows(axes, rows)


def _families_above(
    figure: Figure, study: Study, axes: Axes, printed: str = "", interval: str | None = None
) -> None:
    """Explain families, intervals and the printed marker above the panels."""
    handles: list[Any] = []
    labels = list(study.families)
    for family in study.families:
        look = study.look(family)
        handles += axes.plot([], [], look.marker, color=look.color, markersize=5)
    if _worlds(study) > 1:
        handles += axes.plot([], [], color=GREY, linewidth=3.2, alpha=0.45)
        labels.append(interval or central(_worlds(study)))
    if printed:
        handles += axes.plot([], [], **_PRINTED)
        labels.append(printed)
    figure.legend(handles, labels, loc="outside upper left", ncols=4)


def _sweeps(
    study: Study,
    name: str,
    sweeps: Mapping[str, tuple[str, str]],
    label: str,
    title: str,
    note: str,
    line: str = "",
) -> Drawn | None:
    """Draw the root mean square error over a setting, a panel a family and a curve a sweep."""
    own = study.results.measures
    own = own[
        (own["metric"] == RMSE) & own["algorithm"].isin([s for s in sweeps if s in study.results.sweeps])
    ]
    families = [family for family in study.families if (own["family"] == family).any()]
    if not families:
        return None
    figure = figures.new_figure(3.5)
    panels = figure.subplots(1, len(families), sharey=True, squeeze=False)[0]
    told, worlds = [], 1
    for axes, family in zip(panels, families, strict=True):
        present = [
            sweep for sweep in sweeps if ((own["family"] == family) & (own["algorithm"] == sweep)).any()
        ]
        for number, sweep in enumerate(present):
            row, words = sweeps[sweep]
            frame = own[(own["family"] == family) & (own["algorithm"] == sweep)]
            curve = frame.pivot(index="value", columns="world", values="x")
            # Intervals stand beside each other, not on each other; the axis is logarithmic.
            shift = 1.06 ** (number - (len(present) - 1) / 2)
            worlds = max(worlds, _curve(axes, curve, row, words, shift))
            numbers = ", ".join(f"{m:.2f} m at {v:g}" for v, m in curve.mean(axis=1).items())
            told.append(f"{family}, {words}: {numbers}")
        full = study.get(family, line, RMSE) if line else np.empty(0)
        if len(full):
            axes.axhline(
                full.mean(), color=stroke(line).color, linestyle="--", linewidth=1.2, label=SYSTEMS[line]
            )
            told.append(f"{family}, {SYSTEMS[line]}: {full.mean():.2f} m")
        ticks = sorted(own["value"].unique())
        axes.set_xscale("log")
        axes.set_xticks(ticks, [f"{value:g}" for value in ticks])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_title(family)
        axes.set_xlabel(label)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel("root mean square error (m)")
    _legend(figure, panels[0], columns=3)
    bars = f"; bars: {central(worlds)}" if worlds > 1 else ""
    count = f"{worlds} worlds" if worlds > 1 else "one world"
    if 1 < worlds < _worlds(study):
        count = f"the first {worlds} of {_worlds(study)} worlds"
    return Drawn(
        name=name,
        figure=figure,
        title=title,
        caption=f"Root mean square error at the way-points, mean over {count} of each family{bars};"
        f" {_waypoints(study)}. {note}",
        alt=f"Root mean square error against {label}. {'. '.join(told)}.",
        sweeps=tuple(sweeps),
    )


def _curve(axes: Axes, curve: pd.DataFrame, row: str, words: str, shift: float) -> int:
    """Draw means over worlds with where single experiments lie; return the number of worlds."""
    look, place = stroke(row), curve.index.to_numpy(dtype=float) * shift
    for at, values in zip(place, curve.to_numpy(dtype=float), strict=True):
        kept = values[~np.isnan(values)]
        if len(kept) > 1:
            low, high, _ = figures.interval_of(kept)
            axes.plot([at, at], [low, high], color=look.color, linewidth=2.2, alpha=0.3)
    mean = curve.mean(axis=1).to_numpy(dtype=float)
    axes.plot(place, mean, look.marker + look.line, color=look.color, markersize=4.5, label=words)
    return curve.shape[1]


def _legend(figure: Figure, axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def _worlds(study: Study) -> int:
    return max((len(study.get(f, row, RMSE)) for f in study.families for row in study.rows(RMSE)), default=0)


def _bars(study: Study) -> str:
    return f", bar: {central(_worlds(study))}" if _worlds(study) > 1 else ""


def _waypoints(study: Study) -> str:
    """Return in words how many way-points a world has."""
    counts = np.concatenate(
        [v for (_, _, metric), v in study.values.items() if metric == "n"] or [np.zeros(1)]
    )
    low, high = counts.min(), counts.max()
    return f"n = {high:.0f} way-points" if low == high else f"n = {low:.0f} to {high:.0f} way-points"


def _counted(study: Study) -> str:
    worlds = _worlds(study)
    where = f"in each of {worlds} worlds" if worlds > 1 else "in one world"
    return f"{_waypoints(study)} {where} of {' and '.join(study.families)}"


def _shares(study: Study, families: Sequence[str]) -> str:
    """Return in words the mean share of way-points within one metre."""
    told = []
    for family in families:
        found = {row: study.get(family, row, "within_1m") for row in SYSTEMS}
        own = ", ".join(f"{row} {100 * v.mean():.0f} %" for row, v in found.items() if len(v))
        if own:
            told.append(f"{family}: {own}")
    return "; ".join(told)


def _told(head: str, study: Study, rows: Sequence[str], dots: Dots, metric: str = "") -> str:
    """Return in words what dots show, with the printed numbers of a metric."""
    parts = []
    for family in study.families:
        own = []
        for row in rows:
            if (family, row) in dots:
                digits = study.printed.get((family, row), {}).get(metric)
                own.append(
                    f"{row} {decimals(dots[family, row][0])} m" + (f" (printed {digits} m)" if digits else "")
                )
        if own:
            parts.append(f"{family}: {', '.join(own)}")
    return f"{head}. {'; '.join(parts)}."
