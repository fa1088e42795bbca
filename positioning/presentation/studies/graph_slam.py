"""Figures of WiFi graph SLAM, numbered as in the paper where it has them.

See Gu et al., Figures 1 and 4 to 8. Those of one world stand in `graph_slam_world`, those of scans and
radio maps in `graph_slam_radio`, those of sweeps in `graph_slam_sweeps`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.evaluation.claims import per_world
from positioning.evaluation.results import StudyResults
from positioning.evaluation.statistics import paired_difference
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies import graph_slam_sweeps
from positioning.presentation.studies.graph_slam_radio import MAPS, radio_maps, scans
from positioning.presentation.studies.graph_slam_world import (
    ALIGNED,
    ASSUMED,
    LINES,
    MEAN,
    PRINTED,
    PRINTED_START,
    TRUE_COLOR,
    WORDS,
    WORLD_FIGURES,
    legend_above,
    long_walks,
    name_printed,
)
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, decimals
from positioning.presentation.tones import is_control

BIN_M = 0.25
"""Width of the bars of Figure 7."""


class Tie(NamedTuple):
    """How the frame is tied: column of the errors, metrics of mean, deviation and largest, and words."""

    column: str
    mean: str
    deviation: str
    largest: str
    words: str


TIES = (
    Tie("error_m", MEAN, "sd_m", "max_m", "tied by all visits"),
    Tie("error_first_m", "first_mean_m", "first_sd_m", "first_max_m", "tied by the first pose"),
)

PRINTED_ERRORS = {"mean": "fig7.mean", "deviation": "fig7.sd", "largest": "fig7.max"}


LABELS = {
    "fig4.heading": "Fig. 4, mean heading error",
    "fig4.heading.sd": "Fig. 4, standard deviation",
    "fig4.heading.as_printed": "Fig. 4, mean, start as printed",
    "fig7.mean": "Fig. 7, mean",
    "fig7.sd": "Fig. 7, standard deviation",
    "fig7.max": "Fig. 7, largest",
    "fig7.mean.first": "Fig. 7, mean, first pose",
    "fig7.sd.first": "Fig. 7, standard deviation, first pose",
    "fig7.max.first": "Fig. 7, largest, first pose",
    "fig7.mean.as_printed": "Fig. 7, mean, start as printed",
    "fig7.max.as_printed": "Fig. 7, largest, start as printed",
    "fig7.mean.first.as_printed": "Fig. 7, mean, start as printed, first pose",
    "fig7.sd.first.as_printed": "Fig. 7, standard deviation, start as printed, first pose",
    "fig7.max.first.as_printed": "Fig. 7, largest, start as printed, first pose",
    "fig7.mean.linear": "Fig. 7, mean, linear cost",
    "raw.max": "raw walks, largest",
    "fig8.surveyed": "Fig. 8, surveyed every 2 m",
    "fig8.surveyed_sparse": "Fig. 8, surveyed every 5 m",
    "fig8.crowdsourced": "Fig. 8, crowdsourced",
}
"""Short words for claims; a claim without is called by its name."""

AXES = {"degrees": "heading error (degrees)", "m": "error (m)", "share": "share of errors below 10 m (1)"}
"""What stands along the axis of printed numbers, by their unit."""

LARGE_M = 10.0
"""Lengths of which the printed or the rebuilt one reaches beyond have a panel of their own."""

COSTS = {"aligned": "squared", "aligned_linear": "linear", "aligned_cauchy": "Cauchy"}

Array = NDArray[np.float64]


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures in the order of the paper, then those that it does not have.

    What a configuration leaves out is left out here: a row has no dot, a sweep no figure.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    if not study.families:
        return []
    drawn = [make(study) for make in (scans, *WORLD_FIGURES, *FIGURES)]
    return [*(item for item in drawn if item is not None), *graph_slam_sweeps.settings(study)]


def _histogram(study: Study) -> Drawn | None:
    family = long_walks(study)
    if family is None or not len(study.get(family, ALIGNED, MEAN)):
        return None
    frame = study.results.errors(ALIGNED, family)
    frame = frame[frame["value"].isna()]
    ties = [tie for tie in TIES if tie.column in frame and frame[tie.column].notna().any()]
    if not ties:
        return None
    printed = {
        name: float(digits)
        for name, claim in PRINTED_ERRORS.items()
        if (digits := figures.printed_or_none(study.results, claim)) is not None
    }
    figure = figures.new_figure(3.1)
    panels = figure.subplots(1, len(ties), sharey=True, squeeze=False)[0]
    told, reach_m = [], 0.0
    for axes, tie in zip(panels, ties, strict=True):
        error_m = frame[tie.column].dropna().to_numpy(dtype=float)
        reach_m = max(reach_m, float(error_m.max()))
        edges_m = np.arange(0, error_m.max() + BIN_M, BIN_M)
        # One outline, for bars that touch would show a seam wherever edges of two overlap.
        color = stroke(ALIGNED).color
        axes.hist(error_m, edges_m, density=True, histtype="stepfilled", color=color, alpha=0.75, linewidth=0)
        axes.set_title(tie.words)
        axes.set_xlabel("error at a visit of a landmark (m)")
    # Above the bars, of which both panels have one scale: what is rebuilt, and above it what is printed.
    top = panels[0].get_ylim()[1]
    for axes, tie in zip(panels, ties, strict=True):
        values = {
            name: study.get(family, ALIGNED, getattr(tie, name)) for name in ("mean", "deviation", "largest")
        }
        found = {name: float(v.mean()) for name, v in values.items() if len(v)}
        told.append(
            f"{tie.words}: "
            + ", ".join(
                f"{words} {found[name]:.2f} m"
                for name, words in (
                    *(("mean", "mean"), ("deviation", "standard deviation")),
                    ("largest", "largest"),
                )
                if name in found
            )
        )
        _marks(axes, found, 1.08 * top, "rebuilt", stroke(ALIGNED).color, filled=True)
        _marks(axes, printed, 1.2 * top, "printed", TRUE_COLOR, filled=False)
    panels[0].set_ylim(0, (1.3 if printed else 1.18) * top)
    for axes in panels:
        axes.set_xlim(0, 1.04 * max(reach_m, *printed.values()) if printed else 1.04 * reach_m)
    panels[0].set_ylabel("density (1/m)")
    legend_above(figure, panels[0], columns=4)
    worlds = study.worlds(ALIGNED, MEAN)
    stated = ", ".join(
        f"{words} {printed[name]:g} m"
        for name, words in (("mean", "mean"), ("deviation", "standard deviation"), ("largest", "largest"))
        if name in printed
    )
    means = "means over worlds, " if worlds > 1 else ""
    return Drawn(
        name="fig7",
        figure=figure,
        title="Errors at the landmarks",
        caption=f"Errors at visits after alignment and graph SLAM, {_counted(study, family)}, all pooled;"
        f" bars of {BIN_M:g} m. Above: mean with one standard deviation to both sides, and largest error"
        f" ({means}{'; '.join(told)})." + (f" Printed: {stated}." if stated else "") + " The paper does not"
        f" say how the frame was tied to the building. {ASSUMED}",
        alt=f"Histograms of landmark errors. {'. '.join(told)}." + (f" Printed: {stated}." if stated else ""),
    )


def _printed(study: Study) -> Drawn | None:
    groups: dict[tuple[str, bool], list[tuple[str, str, Array]]] = {}
    measures, first = study.results.measures, study.families[0]
    for claim in study.results.paper.get("claims", []):
        if claim["study"] != study.results.study or claim.get("kind") != "value":
            continue
        try:
            values = per_world(measures, claim["quantity"], first, claim["id"]).to_numpy(dtype=float)
        except InputError:
            continue
        digits, unit = str(claim["printed"]), str(claim.get("unit", ""))
        reach = max(float(digits), figures.interval_of(values).high, values.mean())
        key = (unit, unit == "m" and reach > LARGE_M)
        groups.setdefault(key, []).append((claim["id"], digits, values))
    if not groups:
        return None
    lines = [len(own) for own in groups.values()]
    figure = figures.new_figure(0.5 + sum(0.62 + 0.25 * count for count in lines))
    panels = figure.subplots(
        len(groups), 1, squeeze=False, height_ratios=[count + 1.2 for count in lines]
    ).ravel()
    told, worlds = [], 1
    for axes, ((unit, _), own) in zip(panels, groups.items(), strict=True):
        for place, (claim, digits, values) in enumerate(own):
            worlds = max(worlds, len(values))
            low, high, _ = figures.interval_of(values)
            color = _color(_row_of(study, claim))
            if high > low:
                axes.plot([low, high], [place, place], color=color, linewidth=3.2, alpha=0.45)
            axes.plot(values.mean(), place, "o", color=color)
            axes.plot(float(digits), place, **PRINTED)
            told.append(
                f"{LABELS.get(claim, claim)} {decimals(float(values.mean()), digits)} {unit}"
                f" (printed {digits})"
            )
        figures.label_rows(axes, [LABELS.get(claim, claim) for claim, _, _ in own])
        axes.set_xlim(left=0)
        if unit == "share":
            axes.set_xlim(0, 1.02)
        axes.set_xlabel(AXES.get(unit, f"value ({unit})"))
    panels[0].plot([], [], "o", color=GREY, label="rebuilt mean")
    if worlds > 1:
        panels[0].plot([], [], color=GREY, linewidth=3.2, alpha=0.45, label=central(worlds))
    name_printed(panels[0], "printed")
    legend_above(figure, panels[0])
    counts = [_counted(study, family) for family in study.families]
    bars = f": mean over worlds, bar: {central(worlds)}" if worlds > 1 else ", one world"
    return Drawn(
        name="printed",
        figure=figure,
        title="Printed and rebuilt numbers",
        caption=f"Every printed number of results beside the rebuilt one{bars}. {'; '.join(counts)}. Rows are"
        " aligned first unless said; the frame is tied by all visits, or by the first pose where said."
        f" {ASSUMED}",
        alt=f"Printed and rebuilt numbers: {'; '.join(told)}.",
    )


def _starts(study: Study) -> Drawn | None:
    family = long_walks(study)
    rows = [PRINTED_START, ALIGNED]
    if family is None or not all(len(study.get(family, row, MEAN)) for row in rows):
        return None
    ties = [tie for tie in TIES if all(len(study.get(family, row, tie.mean)) for row in rows)]
    figure = figures.new_figure(3.2)
    panels = figure.subplots(1, len(ties), squeeze=False)[0]
    told = []
    for axes, tie in zip(panels, ties, strict=True):
        told.append(_by_world(axes, study, family, {row: WORDS[row] for row in rows}, tie.mean))
        axes.set_title(tie.words)
        axes.set_ylabel("mean landmark error (m)")
        _printed_level(axes, study, "fig7.mean")
        told[-1] = f"{tie.words.capitalize()}: {told[-1]}"
    legend_above(figure, panels[0])
    return Drawn(
        name="starts",
        figure=figure,
        title="The start as printed, and walks aligned first",
        caption=f"Mean landmark error of graph SLAM, {_counted(study, family)}; a dot is a world, a grey line"
        f" joins the same world. {'. '.join(told)}. As printed, all walks begin at (0, 0) with an unknown"
        f" heading. {ASSUMED}",
        alt=f"Mean landmark errors by world. {'. '.join(told)}.",
    )


def _costs(study: Study) -> Drawn | None:
    family = long_walks(study)
    rows = {} if family is None else {r: w for r, w in COSTS.items() if len(study.get(family, r, MEAN))}
    if family is None or len(rows) < 2:
        return None
    figure = figures.new_figure(3.2)
    panels = figure.subplots(1, 2)
    told = []
    for axes, metric, claim, words in (
        (panels[0], MEAN, "fig7.mean", "mean landmark error"),
        (panels[1], "max_m", "fig7.max", "largest landmark error"),
    ):
        told.append(f"{words.capitalize()}: " + _by_world(axes, study, family, rows, metric))
        axes.set_ylabel(f"{words} (m)")
        _printed_level(axes, study, claim)
    legend_above(figure, panels[0])
    return Drawn(
        name="costs",
        figure=figure,
        title="Squared, linear and robust cost of WiFi edges",
        caption=f"Landmark errors, {_counted(study, family)}, tied by all visits; a dot is a world, a grey"
        f" line joins the same world. {'. '.join(told)}. Eq. 5 prints the linear cost, the paper's library"
        f" squares; the Cauchy loss is the robust baseline.{_weights(study, rows)} Each cost has a best"
        f" weight of its own. {ASSUMED}",
        alt=f"Landmark errors by world for costs of WiFi edges. {'. '.join(told)}.",
    )


def _paired(study: Study) -> Drawn | None:
    family = long_walks(study)
    rows = [] if family is None else study.rows(MEAN, family)
    if family is None or ALIGNED not in rows or len(rows) < 2:
        return None
    frame = figures.differences(study.results, family, ALIGNED)
    figure = figures.new_figure(0.9 + 0.28 * len(frame))
    axes = figure.subplots()
    figures.difference_panel(axes, frame, ALIGNED)
    _keep_near(axes, frame["algorithm"].astype(str).tolist(), frame["difference_m"].to_numpy(dtype=float))
    told = ", ".join(
        f"{line['algorithm']} {decimals(line['difference_m'])} m" for line in frame.to_dict("records")
    )
    pairs = (
        "on the same worlds, with the 95 % interval of the mean difference"
        if study.worlds(ALIGNED, MEAN) > 1
        else "at the visits of one world, whose errors are not independent of each other"
    )
    return Drawn(
        name="paired",
        figure=figure,
        title=f"Paired differences to {ALIGNED}",
        caption=f"Mean landmark error minus that of {ALIGNED} {pairs}. {_counted(study, family)}, tied by all"
        f" visits. Controls see the truth or nothing. {ASSUMED}",
        alt=f"Differences of the mean landmark error to {ALIGNED}: {told}.",
    )


FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (
    *(_histogram, radio_maps, _printed, _starts, _costs),
    _paired,
)
"""What draws each figure over all worlds, in their order; None where what it shows is absent."""


def _counted(study: Study, family: str) -> str:
    """Return in words how many visits and worlds a family has."""
    rows = study.rows(MEAN, family)
    counts = [study.get(family, row, "n") for row in rows]
    visits = max((float(count.max()) for count in counts if len(count)), default=0.0)
    worlds = max((len(study.get(family, row, MEAN)) for row in rows), default=0)
    what = "ends of lines" if family == LINES else "visits of landmarks"
    where = f"each of {worlds} worlds" if worlds > 1 else "one world"
    return f"n = {visits:.0f} {what} in {where}, family {family}"


def _marks(
    axes: Axes, values: Mapping[str, float], height: float, words: str, color: str, *, filled: bool
) -> None:
    """Mark a mean with its standard deviation, and the largest value, at one height."""
    look: dict[str, Any] = {"color": color, "markerfacecolor": color if filled else "white", "zorder": 5}
    if {"mean", "deviation"} <= values.keys():
        ends = [values["mean"] - values["deviation"], values["mean"] + values["deviation"]]
        axes.plot(ends, [height, height], color=color, linewidth=1.4, solid_capstyle="butt")
    if "mean" in values:
        axes.plot(values["mean"], height, "D", linestyle="none", label=f"{words} mean", **look)
    if "largest" in values:
        axes.plot(values["largest"], height, "^", linestyle="none", label=f"{words} largest", **look)


def _row_of(study: Study, claim: str) -> str:
    """Return the row that a claim is about."""
    quantity = next(c["quantity"] for c in study.results.paper["claims"] if c["id"] == claim)
    return str(quantity.get("algorithm", quantity.get("sweep")))


def _color(row: str) -> str:
    """Return the colour of a row, or of a map that belongs to no row."""
    return MAPS[row].color if row in MAPS and row != ALIGNED else stroke(row).color


def _by_world(axes: Axes, study: Study, family: str, rows: Mapping[str, str], metric: str) -> str:
    """Draw a dot a world for each row, joined over the rows, and the means; return these in words."""
    values = {row: study.get(family, row, metric) for row in rows}
    told = []
    if len({len(own) for own in values.values()}) == 1:
        axes.plot(range(len(rows)), np.stack(list(values.values())), color=GREY, linewidth=0.6, alpha=0.6)
    for place, (row, own) in enumerate(values.items()):
        color = stroke(row).color
        axes.plot(np.full(len(own), place), own, "o", color=color, markersize=4, alpha=0.7)
        axes.plot([place - 0.22, place + 0.22], [own.mean()] * 2, color=color, linewidth=2.4)
        told.append(f"{rows[row]} {own.mean():.2f} m")
    told_differences = []
    first, *others = rows
    for row in others:
        if len(values[row]) == len(values[first]) > 1:
            found = paired_difference(values[row], values[first])
            told_differences.append(
                f"{rows[row]} minus {rows[first]} {decimals(found.difference)} m"
                f" (95 % interval {decimals(found.low)} to {decimals(found.high)} m)"
            )
    axes.set_xticks(range(len(rows)), list(rows.values()))
    axes.set_xlim(-0.5, len(rows) - 0.5)
    axes.set_ylim(bottom=0)
    axes.grid(visible=False, axis="x")
    return ", ".join(told) + (f"; {', '.join(told_differences)}" if told_differences else "")


def _weights(study: Study, rows: Mapping[str, str]) -> str:
    """Return in words which weight of WiFi edges rows have; empty where their settings are unknown."""
    weights = {words: study.results.settings.get(row, {}).get("wifi_weight") for row, words in rows.items()}
    if None in weights.values():
        return ""
    if len(set(weights.values())) == 1:
        return f" The weight of WiFi edges is {next(iter(weights.values())):g} for all."
    return f" Weight of WiFi edges: {', '.join(f'{words} {weight:g}' for words, weight in weights.items())}."


def _printed_level(axes: Axes, study: Study, claim: str) -> None:
    digits = figures.printed_or_none(study.results, claim)
    if digits is not None:
        level = float(digits)
        axes.axhline(level, color=TRUE_COLOR, linestyle="--", linewidth=1.0, label="printed")
        # Limits that were set do not grow by themselves.
        axes.set_ylim(top=max(axes.get_ylim()[1], 1.08 * level))


def _keep_near(axes: Axes, rows: Sequence[str], differences_m: Array) -> None:
    """Cut the axis behind rows in one frame: walks laid upon each other lie tens of metres away."""
    near = {row: d for row, d in zip(rows, differences_m, strict=True) if row != "dead_reckoning"}
    competing = [d for row, d in near.items() if not is_control(row)]
    if competing and "dead_reckoning" in rows:
        means = dict(zip(rows, differences_m.tolist(), strict=True))
        figures.keep_in_reach(axes, means, {row: float(max(competing)) for row in competing and near})
