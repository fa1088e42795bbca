"""Figures of GPS, inertial navigation, landmarks and fingerprint fixes on a flight.

See Mirzababaei & Akbari, sections 3 to 5. The paper prints no result of a flight, so no figure has a number
of it but the limit for landing. Those over time stand in `sar_flight_world`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from positioning.evaluation.results import StudyResults
from positioning.evaluation.statistics import mean_interval, share_interval
from positioning.evaluation.studies.sar_flight import LIMIT_M
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.sar_flight_world import (
    ASSUMED,
    NO_RESULT,
    TRUE_COLOR,
    draw_flights,
    logarithmic,
    three_digits,
)
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, central_of, decimals, metres

LEVELS = {"outage_mean_m": "mean", "outage_max_m": "largest", "outage_final_m": "at the end"}

LENGTHS = {
    "outage_gps": ("gps_inertial", "GPS/INS"),
    "outage_gps_15": ("gps_inertial_15", "GPS/INS, 15 states"),
    "outage_slam_15": ("slam_15", "with map, 15 states"),
    "outage_wlpf_15": ("wlpf_15", "with fixes, 15 states"),
}
"""Sweeps over the length of the outage: the row whose look they have, and words."""

DECADES_A_LABEL = 1.5
"""How far apart two factors on Q must lie for both to have a label, decades."""

NOISE, NOISE_ROW = "noise_gps", "gps_inertial"

LAG = "gps_lag_s"
"""How far behind the true course the estimates are; not drawn, told with the noise."""

NOISE_ROWS = {1.0: NOISE_ROW, 100.0: "gps_inertial_raised"}
"""Rows of the table that have a factor on Q which the sweep need not run again."""

VARIANTS = {
    "gps_inertial_flat": "gps_inertial",
    "slam_flat": "slam",
    "gps_inertial_lagrange": "gps_inertial",
    "gps_inertial_radians": "gps_inertial",
}
"""Rows that differ from another in one thing."""

VARIANT_LEVELS = {"gps_mean_m": "mean error under GPS", "outage_mean_m": "mean error in the outage"}

LEAST_PERCENT = 1e-3
"""Between this and its negative the axis of the differences is linear."""

ORDER = (
    *("block", "outage", "outage_place", "table", "below_limit", "consistency", "outage_length"),
    *("noise", "weak", "variants", "height"),
)

_LIMIT: dict[str, Any] = {"color": TRUE_COLOR, "linestyle": (0, (5, 3)), "linewidth": 1.0}

Array = np.ndarray[Any, np.dtype[np.float64]]


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures: the flight, its errors, consistency, sweeps and variants.

    What a configuration leaves out is left out here: a row has no line, a sweep no figure.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    if not study.families:
        return []
    drawn = draw_flights(study)
    drawn |= {item.name: item for make in FIGURES if (item := make(study)) is not None}
    shown = [drawn[name] for name in ORDER if name in drawn]
    # What is assumed of all of them is said once, below the first.
    return shown[:1] + [replace(item, caption=item.caption.replace(f" {ASSUMED}", "")) for item in shown[1:]]


def _table(study: Study) -> Drawn | None:
    rows = study.rows("outage_mean_m")
    if not rows:
        return None
    figure = figures.new_figure(1.1 + 0.3 * len(rows))
    panels = figure.subplots(1, len(LEVELS), sharey=True)
    worlds = max(study.worlds(row, "outage_mean_m") for row in rows)
    ends: list[float] = []
    for axes, (metric, words) in zip(panels, LEVELS.items(), strict=True):
        for place, family, row in _places(study, rows, metric):
            values, look = study.get(family, row, metric), study.look(family)
            if len(values) > 1:
                low, high, _ = figures.interval_of(values)
                axes.plot([low, high], [place] * 2, color=look.color, linewidth=2.4, alpha=0.4)
                ends += [low, high]
            axes.plot(values.mean(), place, look.marker, color=look.color, markersize=3.6)
            ends.append(float(values.mean()))
        axes.axvline(LIMIT_M, **_LIMIT)
        axes.set_title(words)
        axes.set_xlabel("horizontal error (m)")
    positive = [end for end in ends if end > 0] or [1.0]
    for axes in panels:
        _logarithmic_across(axes, min(*positive, LIMIT_M) / 1.3, max(*positive, LIMIT_M) * 1.3)
    for axes in panels:
        figures.label_rows(axes, rows)
        axes.tick_params(labelleft=axes is panels[0])
    _families_above(figure, study, panels[0], worlds > 1 and central(worlds), limit=True)
    return Drawn(
        name="table",
        figure=figure,
        title="Errors in the outage",
        caption="Mean, largest and last horizontal error in the outage of GPS, mean over"
        f" {_number(worlds)} of each family{f'; bars: {central(worlds)}' if worlds > 1 else ''}."
        f"{figures.few_worlds(study.results, study.families, rows)} {_epochs(study)} The"
        f" dashed line is the limit of {LIMIT_M} m that the abstract has for landing."
        f" A row runs in the families that its line names. In numbers, mean / largest / last in m:"
        f" {_told(study, rows, 'outage_mean_m', lambda f, r: ' / '.join(_levels(study, f, r)))}"
        f" {ASSUMED} {NO_RESULT}",
        alt="Mean, largest and last error in the outage. "
        + _told(study, rows, "outage_mean_m", lambda f, r: f"{', '.join(_levels(study, f, r))} m"),
    )


def _below_limit(study: Study) -> Drawn | None:
    metrics = {"outage_mean_m": "mean error", "outage_max_m": "largest error"}
    rows = study.rows("outage_mean_m")
    if not rows:
        return None
    figure = figures.new_figure(1.1 + 0.3 * len(rows))
    panels = figure.subplots(1, 2, sharey=True)
    worlds = max(study.worlds(row, "outage_mean_m") for row in rows)
    for axes, (metric, words) in zip(panels, metrics.items(), strict=True):
        for place, family, row in _places(study, rows, metric):
            values, look = study.get(family, row, metric), study.look(family)
            held = int((values < LIMIT_M).sum())
            if len(values) > 1:
                low, high, _ = share_interval(held, len(values))
                axes.plot([100 * low, 100 * high], [place] * 2, color=look.color, linewidth=2.4, alpha=0.4)
            axes.plot(
                100 * held / len(values), place, look.marker, color=look.color, markersize=3.6, clip_on=False
            )
        axes.set_xlim(0, 100)
        axes.set_title(f"{words} in the outage")
        axes.set_xlabel(f"worlds below {LIMIT_M} m (%)")
    for axes in panels:
        figures.label_rows(axes, rows)
        axes.tick_params(labelleft=axes is panels[0])
    _families_above(figure, study, panels[0], worlds > 1 and "95 % interval of the share")
    counts = sorted({len(study.get(f, r, "outage_mean_m")) for _, f, r in _places(study, rows)})
    return Drawn(
        name="below_limit",
        figure=figure,
        title=f"Below {LIMIT_M} m",
        caption=f"Share of worlds whose mean, left, or largest, right, horizontal error in the outage is"
        f" below {LIMIT_M} m, n = {' or '.join(map(str, counts))} world{'s' if counts != [1] else ''} a row"
        f" and family{'; bars: the exact 95 % interval of the share' if worlds > 1 else ''}. The abstract has"
        f" {LIMIT_M} m for the largest error with which the robot can land, and speaks of an average below"
        f" it. {ASSUMED} {NO_RESULT}",
        alt=f"Share of worlds whose mean and whose largest error is below {LIMIT_M} m. "
        + _told(
            study,
            rows,
            "outage_mean_m",
            lambda f, r: " and ".join(f"{_share(study, f, r, metric):.0f} %" for metric in metrics),
        ),
    )


def _outage_length(study: Study) -> Drawn | None:
    own = _swept(study, LENGTHS)
    if own.empty:
        return None
    family = _first(study, own)
    own = own[own["family"] == family]
    figure = figures.new_figure(3.4)
    panels = figure.subplots(1, 2, sharey=True)
    told, worlds, ends = [], {}, [LIMIT_M]
    for axes, metric in zip(panels, ("outage_mean_m", "outage_max_m"), strict=True):
        present = [sweep for sweep in LENGTHS if (own["algorithm"] == sweep).any()]
        for number, sweep in enumerate(present):
            row, words = LENGTHS[sweep]
            curve = _curve(own, sweep, metric)
            shift = 1.035 ** (number - (len(present) - 1) / 2)
            ends += _line(axes, curve, row, words, shift)
            worlds[words] = curve.shape[1]
            if metric == "outage_max_m":
                numbers = ", ".join(f"{metres(m)} m in {v:g} s" for v, m in curve.mean(axis=1).items())
                told.append(f"{words}: {numbers}")
        axes.axhline(
            LIMIT_M, color=TRUE_COLOR, linestyle=(0, (5, 3)), linewidth=1, label=f"limit {LIMIT_M} m"
        )
        _ticks(axes, own["value"])
        axes.set_xlabel("length of the outage (s)")
        axes.set_title(f"{LEVELS[metric]} error in the outage")
    logarithmic(panels[0], max(min(ends), 1e-3) / 1.3, max(ends) * 1.3)
    panels[0].set_ylabel("horizontal error (m)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return Drawn(
        name="outage_length",
        figure=figure,
        title="Errors and the length of the outage",
        caption=f"Mean and largest horizontal error in an outage from the same begin, mean over worlds of"
        f" family {family}{_bars(worlds)}. {_counted(worlds)} {ASSUMED} {NO_RESULT}",
        alt=f"Errors against the length of the outage. Largest error, {'; '.join(told)}.",
        sweeps=tuple(present),
    )


def _noise(study: Study) -> Drawn | None:
    metrics = {
        "gps_mean_m": ("under GPS", "mean error (m)"),
        "outage_mean_m": ("in the outage", "mean error (m)"),
        "gps_nees": ("under GPS", "normalised error squared (1)"),
    }
    own = _swept(study, {NOISE: ()})
    present = [metric for metric in metrics if (own["metric"] == metric).any()]
    if not present:
        return None
    family = _first(study, own)
    own = own[own["family"] == family]
    figure = figures.new_figure(2.9)
    told, worlds = [], {}
    for axes, metric in zip(np.atleast_1d(figure.subplots(1, len(present))), present, strict=True):
        curve = _curve(own, NOISE, metric)
        ends = _line(axes, curve, NOISE_ROW, "", 1.0)
        worlds[NOISE_ROW] = curve.shape[1]
        if metric == "gps_nees":
            axes.axhline(9, **_LIMIT)
            axes.annotate(
                "right: 9", (0.03, 9), (0, 3), ("axes fraction", "data"), "offset points", fontsize=8
            )
            ends.append(9.0)
        if max(ends) > 10 * min(ends) > 0:
            logarithmic(axes, min(ends) / 1.3, max(ends) * 1.3)
        else:
            axes.set_ylim(0, 1.1 * max(ends))
        axes.set_xscale("log")
        axes.set_xticks(_apart(sorted(own["value"].unique())))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("factor on Q (1)")
        title, label = metrics[metric]
        axes.set_title(title)
        axes.set_ylabel(label)
        levels = zip(curve.index.to_numpy(dtype=float), curve.mean(axis=1), strict=True)
        numbers = ", ".join(f"{three_digits(mean)} at {three_digits(value)}" for value, mean in levels)
        told.append(f"{label} {title}: {numbers}")
    if lags := _lags(_curve(own, NOISE, LAG)):
        told.append(lags)
    return Drawn(
        name="noise",
        figure=figure,
        title="The process noise Q",
        caption=f"{NOISE_ROW} with Q as a data sheet has it (1) times a factor, mean over worlds of family"
        f" {family}{_bars(worlds)}. {_counted(worlds)} Section 3 raises Q until the filter is"
        f" stable. {'; '.join(told)}. {ASSUMED} {NO_RESULT}",
        alt=f"{len(present)} panels against the factor on Q. {'; '.join(told)}.",
        sweeps=(NOISE,),
    )


def _apart(values: Sequence[float]) -> list[float]:
    """Return those of rising values whose labels have room on a logarithmic axis, from the greatest down."""
    kept = list(values[-1:])
    for value in values[-2::-1]:
        if kept[-1] >= value * 10**DECADES_A_LABEL:
            kept.append(value)
    return kept[::-1]


def _lags(curve: pd.DataFrame) -> str:
    """Return in words the mean lag at each value of a sweep, with the interval of the mean."""
    parts = []
    for value, (_, lag_s) in zip(curve.index.to_numpy(dtype=float), curve.iterrows(), strict=True):
        kept = lag_s.dropna().to_numpy(dtype=float)
        low, high, _ = mean_interval(kept)
        interval = f" ({low:.3f} to {high:.3f})" if len(kept) > 1 else ""
        parts.append(f"{kept.mean():.3f} s{interval} at {three_digits(value)}".replace("-", "\N{MINUS SIGN}"))
    inside = " (in brackets the 95 % interval of the mean)" if curve.shape[1] > 1 else ""
    return f"lag behind the true course under GPS{inside}: {', '.join(parts)}" if parts else ""


def _variants(study: Study) -> Drawn | None:
    family = study.families[0]
    differences = {metric: _differences(study, family, metric) for metric in VARIANT_LEVELS}
    differences = {metric: own for metric, own in differences.items() if own}
    conditioned = [row for row in study.results.rows if len(study.get(family, row, "condition"))]
    conditioned = [row for row in conditioned if row in VARIANTS or row in VARIANTS.values()]
    if not differences:
        return None
    rows = [row for row in VARIANTS if any(row in own for own in differences.values())]
    figure = figures.new_figure(1.2 + 0.5 * len(rows) + (0.7 + 0.24 * len(conditioned)))
    parts = figure.subfigures(
        2, 1, height_ratios=[1.2 + 0.5 * len(rows), 0.7 + 0.24 * len(conditioned)], squeeze=False
    ).ravel()
    panels = np.atleast_1d(parts[0].subplots(1, len(differences), sharey=True))
    told = []
    for axes, (metric, own) in zip(panels, differences.items(), strict=True):
        reach = LEAST_PERCENT
        for row, (mean, low, high) in own.items():
            place, color = rows.index(row), stroke(row).color
            if np.isfinite(low):
                axes.plot([low, high], [place] * 2, color=color, linewidth=2.4, alpha=0.5)
            axes.plot(mean, place, "o", color=color)
            reach = float(np.nanmax(np.abs([reach, mean, low, high])))
            axes.annotate(
                _percent(mean),
                (mean, place),
                (0, 7),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="#333333",
                bbox={"fc": "white", "ec": "none", "pad": 0.5},
            )
        _signed_logarithmic(axes, reach)
        axes.axvline(0, color=TRUE_COLOR, linewidth=1)
        axes.set_title(VARIANT_LEVELS[metric])
        axes.set_xlabel("difference (%)")
        told.append(f"{VARIANT_LEVELS[metric]}: {', '.join(f'{r} {_percent(own[r][0])}' for r in own)}")
    figures.label_rows(panels[0], [f"{row}\nless {VARIANTS[row]}" for row in rows])
    panels[0].set_ylim(len(rows) - 0.4, -0.8)
    axes = parts[1].subplots()
    levels = []
    for place, row in enumerate(conditioned):
        values, color = study.get(family, row, "condition"), stroke(row).color
        if len(values) > 1:
            axes.plot(
                [values.min(), values.max()], [place] * 2, color=stroke(row).color, linewidth=2.4, alpha=0.5
            )
        axes.plot(values.mean(), place, "o", color=stroke(row).color)
        levels.append(f"{row} {values.mean():.1f}")
    figures.label_rows(axes, conditioned)
    axes.set_xlim(left=0)
    axes.set_xlabel("greatest condition number of the innovation covariance (logarithm to base 10)")
    worlds = max(study.worlds(row, "gps_mean_m") for row in rows)
    interval = ", with the 95 % interval of the mean difference" if worlds > 1 else ""
    return Drawn(
        name="variants",
        figure=figure,
        title="Variants of the filter",
        caption="Above: paired differences, in per cent of the mean error of the row that the variant belongs"
        f" to{interval}; the axis is linear near zero and logarithmic elsewhere. Below: conditioning"
        f"{', span and mean' if worlds > 1 else ''}. n = {_number(worlds)} of family {family}."
        f" flat: the model of eq. 42; lagrange: eqs. 34 and 35; radians: eq. 28. {'; '.join(told)}."
        f" {ASSUMED} {NO_RESULT}",
        alt=f"Paired differences of variants. {'; '.join(told)}. Logarithm of the condition number:"
        f" {', '.join(levels) or 'none'}.",
    )


FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (
    *(_table, _below_limit, _outage_length, _noise, _variants),
)
"""What draws each figure of one value a world; None where what it shows is absent."""


def _places(study: Study, rows: Sequence[str], metric: str = "outage_mean_m") -> list[tuple[float, str, str]]:
    """Return the height of each dot, with its family and row: families of a row one below the other."""
    found = []
    for place, row in enumerate(rows):
        own = [family for family in study.families if len(study.get(family, row, metric))]
        for number, family in enumerate(own):
            found.append((place + 0.22 * (number - (len(own) - 1) / 2), family, row))
    return found


def _families_above(
    figure: Figure, study: Study, axes: Axes, interval: str | bool, *, limit: bool = False
) -> None:
    handles: list[Any] = []
    labels = list(study.families)
    for family in study.families:
        look = study.look(family)
        handles += axes.plot([], [], look.marker, color=look.color, markersize=5)
    if interval:
        handles += axes.plot([], [], color=GREY, linewidth=2.4, alpha=0.45)
        labels.append(str(interval))
    if limit:
        handles += axes.plot([], [], **_LIMIT)
        labels.append(f"limit {LIMIT_M} m")
    figure.legend(handles, labels, loc="outside upper left", ncols=6)


def _logarithmic_across(axes: Axes, low: float, high: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high / low > 100 else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _signed_logarithmic(axes: Axes, reach: float) -> None:
    """Make the horizontal axis logarithmic on both sides of a linear middle, with few ticks."""
    axes.set_xscale("symlog", linthresh=LEAST_PERCENT, linscale=0.5)
    axes.set_xlim(-8 * reach, 8 * reach)
    top = int(np.floor(np.log10(8 * reach)))
    step = max(1, -(-(top - round(np.log10(LEAST_PERCENT))) // 2))
    powers = list(range(top, round(np.log10(LEAST_PERCENT)), -step))
    ticks = [-(10.0**power) for power in powers] + [0.0] + [10.0**power for power in reversed(powers)]
    axes.set_xticks(ticks, [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(axis="x", labelsize=7.5)


def _swept(study: Study, sweeps: Mapping[str, object]) -> pd.DataFrame:
    """Return the measures of sweeps, in the families in which they ran, with those of `_beside`."""
    all_of = study.results.measures
    known = [sweep for sweep in sweeps if sweep in study.results.sweeps]
    own = all_of[all_of["algorithm"].isin(known) & all_of["value"].notna()]
    own = own[own["family"].isin(study.families)]
    parts = [own]
    for sweep, swept in own.groupby("algorithm", sort=False):
        for value, row in _beside(study, str(sweep), str(swept["family"].iloc[0])).items():
            same = all_of["family"].isin(swept["family"]) & all_of["world"].isin(swept["world"])
            same &= (all_of["algorithm"] == row) & all_of["value"].isna()
            if not (swept["value"] == value).any():
                parts.append(all_of[same].assign(algorithm=sweep, value=value))
    return pd.concat([part for part in parts if len(part)], ignore_index=True) if len(own) else own


def _beside(study: Study, sweep: str, family: str) -> dict[float, str]:
    """Return the rows of the table that belong to a sweep, by the value that they have of its setting."""
    if sweep == NOISE:
        return NOISE_ROWS
    outage_s = study.results.observed.get(family, {}).get("recording.gps_outage_s")
    lasts_s = np.empty(0) if outage_s is None else np.unique(np.diff(np.asarray(outage_s, dtype=float)))
    return {float(lasts_s[0]): LENGTHS[sweep][0]} if len(lasts_s) == 1 else {}


def _first(study: Study, own: pd.DataFrame) -> str:
    return next(family for family in study.families if (own["family"] == family).any())


def _curve(own: pd.DataFrame, sweep: str, metric: str) -> pd.DataFrame:
    """Return a metric of a sweep, a line a value and a column a world."""
    own = own[(own["algorithm"] == sweep) & (own["metric"] == metric)]
    return own.pivot(index="value", columns="world", values="x").sort_index()


def _line(axes: Axes, curve: pd.DataFrame, row: str, words: str, shift: float) -> list[float]:
    """Draw means over worlds with where single experiments lie; return all ends."""
    look, ends = stroke(row), []
    values = curve.index.to_numpy(dtype=float) * shift
    for at, numbers in zip(values, curve.to_numpy(dtype=float), strict=True):
        kept = numbers[np.isfinite(numbers)]
        if len(kept) > 1:
            low, high, _ = figures.interval_of(kept)
            axes.plot([at, at], [low, high], color=look.color, linewidth=2.2, alpha=0.3)
            ends += [low, high]
    mean = curve.mean(axis=1).to_numpy(dtype=float)
    axes.plot(values, mean, look.marker + look.line, color=look.color, markersize=4.5, label=words)
    return ends + [float(level) for level in mean]


def _ticks(axes: Axes, values: pd.Series) -> None:
    ticks = sorted(values.unique())
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{value:g}" for value in ticks])
    axes.xaxis.set_minor_locator(NullLocator())


def _differences(study: Study, family: str, metric: str) -> dict[str, tuple[float, float, float]]:
    """Return mean paired differences with their intervals, in per cent of the mean of the other row."""
    own = study.results.measures
    own = own[own["value"].isna() & (own["metric"] == metric) & (own["family"] == family)]
    wide = own.pivot(index="world", columns="algorithm", values="x")
    found = {}
    for row, other in VARIANTS.items():
        if {row, other} <= set(wide.columns):
            both = wide[[row, other]].dropna().to_numpy(dtype=float)
            if len(both) and both[:, 1].mean() > 0:
                percent = 100 * (both[:, 0] - both[:, 1]) / both[:, 1].mean()
                interval = mean_interval(percent)
                found[row] = (float(percent.mean()), interval.low, interval.high)
    return found


def _percent(value: float) -> str:
    if abs(value) < LEAST_PERCENT:
        return f"less than {LEAST_PERCENT:g} %".replace("-", "\N{MINUS SIGN}")
    return f"{value:+.2g} %".replace("-", "\N{MINUS SIGN}")


def _mean(study: Study, family: str, row: str, metric: str) -> float:
    return float(study.get(family, row, metric).mean())


def _levels(study: Study, family: str, row: str) -> list[str]:
    """Return mean, largest and last error in the outage as they are printed."""
    return [metres(_mean(study, family, row, metric)) for metric in LEVELS]


def _share(study: Study, family: str, row: str, metric: str) -> float:
    return float(100 * (study.get(family, row, metric) < LIMIT_M).mean())


def _told(study: Study, rows: Sequence[str], metric: str, words: Callable[[str, str], str]) -> str:
    """Return in words what rows show, family by family."""
    parts = []
    for family in study.families:
        own = [f"{row} {words(family, row)}" for row in rows if len(study.get(family, row, metric))]
        if own:
            parts.append(f"{family}: {', '.join(own)}")
    return f"{'; '.join(parts)}."


def _number(worlds: int) -> str:
    return f"{worlds} worlds" if worlds > 1 else "one world"


def _epochs(study: Study) -> str:
    counts = [v for (_, _, metric), v in study.values.items() if metric == "n"]
    return f"n = {decimals(float(np.concatenate(counts).max()), least=0)} epochs a flight." if counts else ""


def _bars(worlds: Mapping[str, int]) -> str:
    """Return in words what bars show of curves with so many worlds."""
    return f"; bars: {central_of(worlds)}" if max(worlds.values(), default=1) > 1 else ""


def _counted(worlds: Mapping[str, int]) -> str:
    """Return in words how many worlds curves have."""
    counts = set(worlds.values())
    if len(counts) == 1:
        return f"n = {_number(counts.pop())}."
    return f"n = {', '.join(f'{_number(count)} ({words})' for words, count in worlds.items())}."
