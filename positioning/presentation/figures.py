"""What figures of studies are made of: a drawing with its words, panels that many studies have, files."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from positioning.errors import InputError
from positioning.evaluation.measures import paired, published_numbers
from positioning.evaluation.results import StudyResults
from positioning.evaluation.statistics import Interval, single_experiment_interval
from positioning.files import write_text
from positioning.presentation.figure_svg import draw_svg
from positioning.presentation.style import GREY, WIDTH_IN, drawing, stroke
from positioning.presentation.svg import compact, svg_to_pdf
from positioning.presentation.tables import central
from positioning.presentation.tones import is_control

PERCENTILES = {"p50_m": 50, "p75_m": 75, "p90_m": 90, "p95_m": 95}
_LEVELS = np.linspace(0, 100, 201)
TALLEST_IN = 9.0
"""On paper a taller figure is made smaller, until nobody can read it."""

_FIRST_MARKER, _BETWEEN_MARKERS = 16, 60
"""Where the markers of a distribution stand, in steps of `_LEVELS`: three a curve."""


@dataclass(frozen=True)
class Drawn:
    """A figure with what a reader needs beside it.

    Attributes
    ----------
    name
        Its file name without ending; where the paper has the figure, the paper's number.
    figure
        The drawing.
    title
        A few words.
    caption
        What is shown, over how many samples and worlds.
    alt
        What a reader who cannot see it needs to know.
    sweeps
        Sweeps that it shows.
    """

    name: str
    figure: Figure
    title: str
    caption: str
    alt: str
    sweeps: tuple[str, ...] = ()


def save(drawn: Iterable[Drawn], folder: str | Path) -> None:
    """Write every figure as SVG and PDF, and ``captions.json`` in the order given.

    Equal figures give equal bytes: no dates, and names inside the SVG that depend on content alone.
    The SVG is `compact`, because pages hold it.

    Parameters
    ----------
    drawn
        Figures as `positioning.presentation.study_figures.draw` returns them.
    folder
        Where they go; it exists.

    Raises
    ------
    InputError
        If two figures have one name: the second would take the first one's file.
    """
    drawn = list(drawn)
    repeated = [name for name, times in Counter(item.name for item in drawn).items() if times > 1]
    if repeated:
        raise InputError(
            f"figure {repeated[0]}", "two figures have this name, and a name is a file", "Rename one of them"
        )
    captions = []
    with drawing():
        for item in drawn:
            paths, letters = draw_svg(item.figure)
            write_text(Path(folder) / f"{item.name}.svg", compact(paths))
            pdf = svg_to_pdf(letters, item.title)
            (Path(folder) / f"{item.name}.pdf").write_bytes(pdf)
            captions.append(
                {
                    "name": item.name,
                    "title": item.title,
                    "caption": item.caption,
                    "alt": item.alt,
                    "sweeps": item.sweeps,
                }
            )
    write_text(Path(folder) / "captions.json", json.dumps(captions, indent=2, ensure_ascii=False) + "\n")


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return an empty figure whose parts keep clear of each other."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


class Part(NamedTuple):
    """Some of the families of a figure that is too tall for one page: how it is named, and which."""

    suffix: str
    words: str
    families: list[str]


def parts(families: Sequence[str], height_in: Callable[[Sequence[str]], float]) -> list[Part]:
    """Divide families among figures of which none is taller than a page can show in readable type.

    Parameters
    ----------
    families
        All of them, in their order.
    height_in
        How tall a figure of some of them is, inches.

    Returns
    -------
    list of Part
        A single family may be taller; without families, none.
    """
    groups: list[list[str]] = []
    for family in families:
        if groups and height_in([*groups[-1], family]) <= TALLEST_IN:
            groups[-1].append(family)
        else:
            groups.append([family])
    if len(groups) < 2:
        return [Part("", "", group) for group in groups]
    return [
        Part(f"_{number}" if number > 1 else "", f", {number} of {len(groups)}", group)
        for number, group in enumerate(groups, start=1)
    ]


def measured_families(results: StudyResults) -> list[str]:
    """Return the families in which some row of the table was measured."""
    present = set(results.measures["family"])
    return [family for family in results.families() if family in present]


def measured_rows(results: StudyResults, family: str) -> list[str]:
    """Return the rows of the table that ran in a family, in their order."""
    own = results.measures[(results.measures["family"] == family) & results.measures["value"].isna()]
    present = set(own["algorithm"])
    return [row for row in results.rows if row in present]


def per_world(results: StudyResults, family: str, row: str, metric: str = "mean_m") -> np.ndarray[Any, Any]:
    """Return a metric of a row of the table, one value a world, in the order of worlds."""
    return results.per_world(row, family, metric)


def counted(results: StudyResults, family: str) -> str:
    """Return in words how many samples and worlds a family has; rows that have others are named."""
    rows = measured_rows(results, family)
    worlds = max(len(per_world(results, family, row)) for row in rows)
    few = "; ".join(f"{row} in {where}" for row, where in fewer_worlds(results, family).items())
    return (
        sample_counts(results, family, rows)
        + (f" in each of {worlds} worlds" if worlds > 1 else "")
        + (f" ({few})" if few else "")
    )


def fewer_worlds(results: StudyResults, family: str) -> dict[str, str]:
    """Return the rows of a family that have answers in fewer worlds than others, with which, in words."""
    own = results.measures[(results.measures["family"] == family) & results.measures["value"].isna()]
    found = {str(row): sorted(set(worlds)) for row, worlds in own.groupby("algorithm")["world"]}
    found = {row: found[row] for row in results.rows if row in found}
    every = sorted(set().union(*found.values()))
    most = max(map(len, found.values()), default=0)
    return {
        row: f"the first {len(worlds)}" if worlds == every[: len(worlds)] else f"{len(worlds)} of them"
        for row, worlds in found.items()
        if len(worlds) < most
    }


def few_worlds(
    results: StudyResults, families: Iterable[str], rows: Iterable[str], *, bars: bool = True
) -> str:
    """Return the sentence that names rows with fewer worlds than others, empty where all have the same.

    Parameters
    ----------
    results
        What the workflow made of the study.
    families, rows
        What a figure shows.
    bars
        Whether it shows where single experiments lie, which takes many worlds for 95 %.
    """
    shown = set(rows)
    told: dict[str, list[str]] = {}
    for family in families:
        for row, where in fewer_worlds(results, family).items():
            count = len(per_world(results, family, row))
            words = where + (f", bar: {central(count)}" if bars and count > 1 else "")
            if row in shown and row not in told.setdefault(words, []):
                told[words].append(row)
    kept = [f"{', '.join(names)} in {words}" for words, names in told.items() if names]
    return f" On fewer worlds: {'; '.join(kept)}." if kept else ""


def sample_counts(results: StudyResults, family: str, rows: Sequence[str]) -> str:
    """Return in words how many samples rows have: the number of most rows, then those that have another."""
    counts: dict[int, list[str]] = {}
    for row in rows:
        counts.setdefault(int(per_world(results, family, row, "n")[0]), []).append(row)
    most = max(counts, key=lambda count: len(counts[count]))
    others = [f"{count} of {', '.join(own)}" for count, own in sorted(counts.items()) if count != most]
    return f"n = {most} samples" + (f" ({'; '.join(others)})" if others else "")


def differ(results: StudyResults, families: Iterable[str], rows: Iterable[str] | None = None) -> str:
    """Return the sentence that rows with other samples need, empty where all have the same."""
    kept = None if rows is None else set(rows)
    for family in families:
        own = [row for row in measured_rows(results, family) if kept is None or row in kept]
        if len({int(per_world(results, family, row, "n")[0]) for row in own}) > 1:
            return (
                " Rows with another n answer at other samples, so their errors do not compare one to one:"
                " the paired differences do."
            )
    return ""


def published(results: StudyResults) -> dict[tuple[str, str], dict[str, str]]:
    """Return the printed digits by (family, row) and metric."""
    claims = [claim for claim in results.paper.get("claims", []) if claim["study"] == results.study]
    return published_numbers(claims, measured_families(results)[:1])


def printed_or_none(results: StudyResults, claim: str) -> str | None:
    """Return the printed digits of a claim, None where the paper has no such claim or no number in it."""
    found = next((c for c in results.paper.get("claims", []) if c["id"] == claim), None)
    return None if found is None or "printed" not in found else results.printed(claim)


def distribution(axes: Axes, results: StudyResults, family: str, rows: Sequence[str]) -> None:
    """Draw cumulative distributions of the pooled errors of rows, printed percentiles as hollow markers.

    Filled markers, which stand elsewhere on each curve, tell the curves apart where colours do not.
    """
    numbers, reach = published(results), [0.0]
    for place, row in enumerate(rows):
        own = results.errors(row, family)
        errors = own[own["value"].isna()]["error_m"].to_numpy(dtype=float)
        look = stroke(row)
        axes.plot(
            np.percentile(errors, _LEVELS),
            _LEVELS,
            color=look.color,
            linestyle=look.line,
            marker=look.marker,
            markersize=4,
            markevery=(_FIRST_MARKER + round(_BETWEEN_MARKERS * place / len(rows)), _BETWEEN_MARKERS),
            # Where two curves are one, the gaps of a broken line show the other.
            zorder=2 if look.line == "-" else 2.1,
            label=row,
        )
        printed = numbers.get((family, row), {})
        levels = [
            (float(printed[metric]), level) for metric, level in PERCENTILES.items() if metric in printed
        ]
        if levels:
            axes.plot(
                *zip(*levels, strict=True), look.marker, color=look.color, markerfacecolor="white", zorder=3
            )
        if not is_control(row) or len(rows) == 1:
            reach.append(float(np.percentile(errors, 97)))
        reach.extend(metres for metres, _ in levels)
    axes.set_xlim(0, 1.05 * max(reach) or 1.0)
    axes.set_ylim(0, 100)
    axes.tick_params(labelbottom=True)
    axes.set_xlabel("position error (m)")
    axes.set_ylabel("share of samples (%)")


def distribution_alt(results: StudyResults, family: str, rows: Sequence[str]) -> str:
    """Return in words what an error distribution shows: the medians and 95 % errors, best first."""
    parts = []
    for row in rows:
        median, p95 = (float(per_world(results, family, row, metric).mean()) for metric in ("p50_m", "p95_m"))
        parts.append((median, p95, row))
    told = "; ".join(f"{row} {median:.2f} m and {p95:.2f} m" for median, p95, row in sorted(parts))
    return (
        f"Cumulative error distributions, {family}. Median and 95 % error, means over worlds,"
        f" best first: {told}."
    )


def legend_beside(axes: Axes) -> None:
    """Put the legend to the right of a panel, where it covers nothing."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0, handlelength=2.4)


def interval_of(values: np.ndarray[Any, Any]) -> Interval:
    """Return where single experiments lie, for drawing; a single world has no extent."""
    return single_experiment_interval(values)


def bars(axes: Axes, results: StudyResults, family: str, rows: Sequence[str]) -> None:
    """Draw mean errors as bars from above, with the interval of single experiments."""
    for place, row in enumerate(rows):
        values = per_world(results, family, row)
        axes.barh(place, values.mean(), height=0.62, color=stroke(row).color, alpha=0.85)
        if len(values) > 1:
            low, high, _ = interval_of(values)
            axes.plot([low, high], [place, place], color="#111111", linewidth=1.2)
    label_rows(axes, rows)
    keep_in_reach(axes, *means_and_ends(results, family, rows))
    axes.set_xlim(left=0)
    axes.set_xlabel("mean position error (m)")


def keep_in_reach(axes: Axes, means_m: Mapping[str, float], ends_m: Mapping[str, float]) -> None:
    """Cut the axis behind the rows that compete, and write beside it how far a control beyond lies.

    Parameters
    ----------
    axes
        Where rows are drawn, the first on top.
    means_m
        What is drawn of each row, metres, in their order.
    ends_m
        How far the drawing of each row reaches to the right, metres.
    """
    low, high = axes.get_xlim()
    competing = [end for row, end in ends_m.items() if not is_control(row)]
    if not competing:
        return
    reach = max(competing) + 0.3 * (max(competing) - low)
    if reach >= high:
        return
    axes.set_xlim(low, reach)
    for place, mean in enumerate(means_m.values()):
        if mean > reach:
            axes.annotate(
                f"{mean:.2f} m \N{RIGHTWARDS ARROW}",
                (1, place),
                xycoords=("axes fraction", "data"),
                xytext=(-3, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                fontsize=8,
                color="#333333",
                bbox={"fc": "white", "ec": "none", "pad": 1.0},
            )


def means_and_ends(
    results: StudyResults, family: str, rows: Sequence[str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the mean of each row, and the upper end of its interval of single experiments, metres."""
    values = {row: per_world(results, family, row) for row in rows}
    means = {row: float(own.mean()) for row, own in values.items()}
    return means, {row: float(interval_of(own).high) for row, own in values.items()}


def label_rows(axes: Axes, rows: Sequence[str]) -> None:
    """Write the names of rows along the vertical axis, the first on top."""
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def means_against_printed(axes: Axes, results: StudyResults, family: str, rows: Sequence[str]) -> None:
    """Draw rebuilt means with the interval of single experiments, printed means as hollow markers."""
    numbers = published(results)
    for place, row in enumerate(rows):
        values, color = per_world(results, family, row), stroke(row).color
        if len(values) > 1:
            low, high, _ = interval_of(values)
            axes.plot(
                [low, high], [place, place], color=color, linewidth=3.2, alpha=0.45, solid_capstyle="round"
            )
        axes.plot(values.mean(), place, "o", color=color)
        printed = numbers.get((family, row), {}).get("mean_m")
        if printed is not None:
            axes.plot(
                float(printed),
                place,
                "D",
                markersize=7,
                markerfacecolor="none",
                markeredgecolor="#111111",
                markeredgewidth=1.1,
                zorder=4,
            )
    label_rows(axes, rows)
    keep_in_reach(axes, *means_and_ends(results, family, rows))
    axes.set_xlabel("mean position error (m)")
    axes.plot([], [], "o", color=GREY, label="rebuilt mean")
    axes.plot(
        [], [], color=GREY, linewidth=3.2, alpha=0.45, label=central(len(per_world(results, family, rows[0])))
    )
    axes.plot(
        [], [], "D", markersize=7, markerfacecolor="none", markeredgecolor="#111111", label="printed mean"
    )
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3, borderaxespad=0.2)


def means_alt(results: StudyResults, family: str, rows: Sequence[str]) -> str:
    """Return in words what a figure of mean errors shows."""
    numbers = published(results)
    parts = []
    for row in rows:
        printed = numbers.get((family, row), {}).get("mean_m")
        mean = per_world(results, family, row).mean()
        parts.append(f"{row} {mean:.2f} m" + (f" (printed {printed} m)" if printed else ""))
    return f"Mean error, {family}: " + ", ".join(parts) + "."


@dataclass(frozen=True)
class Curve:
    """A sweep as it is drawn: the metric's mean over worlds and where single experiments lie."""

    name: str
    setting: str
    values: np.ndarray[Any, Any]
    mean_m: np.ndarray[Any, Any]
    low_m: np.ndarray[Any, Any]
    high_m: np.ndarray[Any, Any]
    worlds: int

    @property
    def best(self) -> float:
        """The value of the setting at which the mean over worlds is smallest."""
        return float(self.values[int(np.argmin(self.mean_m))])


def curve(results: StudyResults, sweep: str) -> Curve:
    """Return a sweep over the first family, ready for drawing."""
    family = measured_families(results)[0]
    own = results.measures[results.measures["family"] == family]
    frame = replace(results, measures=own).curve(sweep)
    numbers = frame.to_numpy(dtype=float)
    ends = np.asarray([interval_of(line[~np.isnan(line)])[:2] for line in numbers])
    return Curve(
        name=sweep,
        setting=results.sweeps[sweep][0],
        values=frame.index.to_numpy(dtype=float),
        mean_m=np.nanmean(numbers, axis=1),
        low_m=ends[:, 0],
        high_m=ends[:, 1],
        worlds=frame.shape[1],
    )


def sweep_panel(
    axes: Axes,
    line: Curve,
    *,
    color: str,
    label: str,
    optimum: str | None = None,
    printed_mean: str | None = None,
) -> None:
    """Draw a sweep with its band, the printed optimum as a labelled line and the printed mean on it.

    Parameters
    ----------
    axes
        Where to draw.
    line
        The sweep.
    color
        The algorithm's colour.
    label
        Name and unit of the setting.
    optimum
        The printed best value of the setting.
    printed_mean
        The printed mean error at that value, metres.
    """
    axes.fill_between(line.values, line.low_m, line.high_m, color=color, alpha=0.16, linewidth=0)
    axes.plot(line.values, line.mean_m, "o-", color=color)
    best = int(np.argmin(line.mean_m))
    axes.plot(
        line.values[best], line.mean_m[best], "o", markersize=9, markerfacecolor="none", markeredgecolor=color
    )
    low, high = float(line.low_m.min()), float(line.high_m.max())
    if printed_mean is not None:
        low, high = min(low, float(printed_mean)), max(high, float(printed_mean))
    pad = 0.06 * (high - low) or 0.1
    axes.set_ylim(low - pad, high + 3.2 * pad)
    if optimum is not None:
        place = float(optimum)
        axes.axvline(place, color="#111111", linestyle="--", linewidth=1.0)
        right = place > (line.values[0] + line.values[-1]) / 2
        axes.annotate(
            f"printed optimum {optimum}",
            (place, 0.985),
            xycoords=("data", "axes fraction"),
            xytext=(-4 if right else 4, 0),
            textcoords="offset points",
            fontsize=8,
            ha="right" if right else "left",
            va="top",
        )
        if printed_mean is not None:
            axes.plot(
                place,
                float(printed_mean),
                "D",
                markersize=7,
                markerfacecolor="white",
                markeredgecolor="#111111",
                zorder=4,
            )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(label)
    axes.set_ylabel("mean position error (m)")


def differences(results: StudyResults, family: str, reference: str) -> pd.DataFrame:
    """Return paired differences of all rows of a family to one of them, in the order of the table."""
    against = results.errors(reference)
    parts = []
    for row in measured_rows(results, family):
        if row != reference:
            found = paired({row: results.errors(row), reference: against}, [row, reference], [family])
            parts.append(found[found["algorithm"] == row])
    return pd.concat(parts, ignore_index=True)


def difference_panel(axes: Axes, frame: pd.DataFrame, reference: str) -> None:
    """Draw paired differences as dots with 95 % intervals of their mean."""
    for place, line in enumerate(frame.to_dict("records")):
        color = stroke(str(line["algorithm"])).color
        axes.plot(line["difference_m"], place, "o", color=color)
        if not math.isnan(line["low_m"]):
            axes.plot([line["low_m"], line["high_m"]], [place, place], color=color, linewidth=2.4, alpha=0.6)
    axes.axvline(0, color="#111111", linewidth=1.0)
    label_rows(axes, [str(name) for name in frame["algorithm"]])
    means = dict(zip(frame["algorithm"].astype(str), frame["difference_m"].astype(float), strict=True))
    highs = dict(zip(means, frame["high_m"].fillna(frame["difference_m"]).astype(float), strict=True))
    keep_in_reach(axes, means, highs)
    axes.set_xlabel(f"mean error minus that of {reference} (m)\nleft of the line: better than {reference}")
