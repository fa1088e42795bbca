"""Figures of the robot that Bluetooth locates, numbered as in the paper where it has them.

See Raghavan et al., Figures 1 to 3 and 5, Tables I and II.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from positioning.evaluation.results import StudyResults
from positioning.evaluation.studies.bluetooth_robot import NEAREST_M
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, stroke
from positioning.presentation.sweep_figures import sweep_figure
from positioning.presentation.tables import NOTHING, central, decimals
from positioning.ranging import crossings

ROBOT = "robot"
RANGING = "curve_crossings"
FILTER = "particle_filter"
ALONE = "trilateration_alone"

RUN_SHOWN = 2
"""The run of Figure 5: chosen by its number before any was drawn."""

STARTS = (
    "no furniture",
    "amidst furniture",
    "centre of 2 beacons",
    "near beacon",
    "centre of 3 beacons",
    "farthest from beacons",
)
"""The comments of Table II on where the runs start."""

LIMIT_COLOR = "#d7191c"

RUN_COLORS = ("#14507d", "#c8641a", "#2f7d4f", "#8a2f6b", "#6b5b00", "#55606a")

Array = np.ndarray[Any, np.dtype[np.float64]]
Line = tuple[str, str, str]
"""A line of a panel: its words, the row and the metric."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures in the order of the paper, then those that it does not have.

    What a configuration leaves out is left out here: a row has no line, a sweep no figure.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    drawn = [make(study) for make in FIGURES]
    return [item for item in drawn if item is not None]


def _world(study: Study) -> Drawn | None:
    family = study.families[0]
    observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
    if "truth.position_m" not in truth:
        return None
    corner_m, beacons_m = observed["site.corner_m"], observed["site.access_point_m"]
    furniture_m, runs_m = truth["truth.furniture_m"], truth["truth.position_m"]
    size_m = corner_m[1] - corner_m[0]
    lines, columns = -(-len(runs_m) // 3), min(3, len(runs_m))
    figure = figures.new_figure(lines * (2.35 * float(size_m[1] / size_m[0]) + 0.35))
    panels = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    lengths = [int(np.count_nonzero(~np.isnan(run_m[:, 0]))) for run_m in runs_m]
    for number, (axes, run_m) in enumerate(zip(panels, runs_m, strict=False), start=1):
        for low_m, high_m in furniture_m:
            axes.add_patch(Rectangle(tuple(low_m), *(high_m - low_m), fc="#ccd2d7", ec=GREY, linewidth=0.7))
        axes.add_patch(Rectangle(tuple(corner_m[0]), *size_m, fill=False, ec="#3c4650", linewidth=1.1))
        axes.plot(*beacons_m.T, "^", markersize=8, color="#d55e00", markeredgecolor="white", zorder=2)
        color, length = RUN_COLORS[(number - 1) % len(RUN_COLORS)], lengths[number - 1]
        axes.plot(*run_m.T, ".-", color=color, linewidth=1.1, markersize=4, zorder=3)
        axes.plot(*run_m[length - 1], "x", color=color, markersize=9, markeredgewidth=2.0, zorder=4)
        _numbered(axes, run_m[0], number, color)
        axes.set_title(_start(number), fontsize=8.5)
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set_xlim(corner_m[0, 0] - 0.15, corner_m[1, 0] + 0.15)
        axes.set_ylim(corner_m[0, 1] - 0.15, corner_m[1, 1] + 0.15)
    for axes in panels[len(runs_m) :]:
        axes.set_visible(False)
    figure.supxlabel("x (m)", fontsize=9)
    figure.supylabel("y (m)", fontsize=9)
    return Drawn(
        name="world",
        figure=figure,
        title="The runs of one synthetic world",
        caption=f"World {_first(study, family) + 1} of {_in_all(study)}, family {family},"
        f" {size_m[0]:g} m by {size_m[1]:g} m: one panel a run,"
        f" n = {_spread(lengths)} iterations; its number stands at the start, its end is a cross. Triangles:"
        " beacons, at the places printed for Figure 4. Grey: furniture. Furniture, starts and the lengths of"
        " moves are assumed, so that they fit the words of Table II.",
        alt=f"Plans of a floor of {size_m[0]:g} by {size_m[1]:g} metres with {len(beacons_m)} beacons,"
        f" {len(furniture_m)} pieces of furniture and {len(runs_m)} runs of "
        + ", ".join(map(str, lengths))
        + " iterations, which end near the boundary.",
    )


def _static_series(study: Study) -> Drawn | None:
    found = _static(study)
    if found is None:
        return None
    family, time_s, rss_dbm = found
    figure = figures.new_figure(2.7)
    axes = figure.subplots()
    axes.plot(time_s, rss_dbm, ".-", color=study.look(family).color, linewidth=0.8, markersize=4)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("time (s)")
    axes.set_ylabel("RSSI (dBm)")
    return Drawn(
        name="fig1",
        figure=figure,
        title=f"RSSI against time at {_static_place(study)}",
        caption=f"Single inquiries of a robot at rest, {_static_place(study)} from a beacon, in whole dBm;"
        f" n = {len(rss_dbm)} inquiries in one world, world {_first(study, family) + 1} of {_in_all(study)},"
        f" family {family}.",
        alt=_static_alt(rss_dbm),
    )


def _static_histogram(study: Study) -> Drawn | None:
    found = _static(study)
    if found is None:
        return None
    family, _, rss_dbm = found
    levels, counts = np.unique(np.rint(rss_dbm), return_counts=True)
    figure = figures.new_figure(2.7)
    axes = figure.subplots()
    axes.bar(levels, counts, width=0.86, color=study.look(family).color)
    axes.grid(visible=False, axis="x")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("RSSI (dBm)")
    axes.set_ylabel("inquiries")
    return Drawn(
        name="fig2",
        figure=figure,
        title=f"Histogram of the RSSI at {_static_place(study)}",
        caption=f"The inquiries of Figure 1 by level, one bar a dBm: n = {len(rss_dbm)} in one world,"
        f" world {_first(study, family) + 1} of {_in_all(study)}, family {family}; mean"
        f" {decimals(float(rss_dbm.mean()), least=1)} dBm, standard deviation"
        f" {decimals(float(rss_dbm.std()), least=1)} dB.",
        alt=_static_alt(rss_dbm),
    )


def _curve(study: Study) -> Drawn | None:
    seen = {family: study.first_world("observed", family) for family in study.families}
    families = [family for family in study.families if "calibration.rss_dbm" in seen[family]]
    if not families:
        return None
    figure = figures.new_figure(3.5)
    panels = figure.subplots(1, len(families), sharey=True, squeeze=False)[0]
    told = []
    for axes, family in zip(panels, families, strict=True):
        distance_m, rss_dbm = (seen[family][f"calibration.{name}"] for name in ("distance_m", "rss_dbm"))
        heard = ~(np.isnan(distance_m) | np.isnan(rss_dbm))
        distance_m, rss_dbm = distance_m[heard], rss_dbm[heard]
        truth, look = study.first_world("truth", family), study.look(family)
        if "truth.law_dbm" in truth:
            law_m = truth["truth.law_distance_m"]
            shown = (law_m >= distance_m.min()) & (law_m <= distance_m.max())
            axes.plot(
                law_m[shown], truth["truth.law_dbm"][shown], color="#333333", linewidth=0.8, label="true law"
            )
        axes.plot(distance_m, rss_dbm, "o-", color=look.color, markersize=3.5, label="calibration run")
        level_dbm = float(np.median(rss_dbm))
        found_m = crossings(distance_m, rss_dbm, level_dbm)
        axes.axhline(level_dbm, color="#8a2f6b", linestyle="--", linewidth=1.0)
        axes.plot(
            found_m,
            np.full(found_m.shape, level_dbm),
            "D",
            markersize=8,
            markerfacecolor="white",
            markeredgecolor="#8a2f6b",
            markeredgewidth=1.4,
            linestyle="--",
            color="#8a2f6b",
            linewidth=1.0,
            zorder=4,
            label="one level and its distances",
        )
        axes.set_title(family)
        axes.set_xlabel("distance (m)")
        places = ", ".join(f"{place:.2f}" for place in found_m)
        told.append(
            f"{family}: {decimals(level_dbm, least=1)} dBm is met at {len(found_m)}"
            f" distance{'s' if len(found_m) > 1 else ''}, {places} m"
        )
    panels[0].set_ylabel("RSSI (dBm)")
    _legend_above(figure, *panels[0].get_legend_handles_labels())
    stops = int(heard.sum())
    return Drawn(
        name="fig3",
        figure=figure,
        title="RSSI against distance",
        caption=f"The calibration run of one world, world {_first(study, families[0]) + 1} of"
        f" {_in_all(study)}, in each family: n = {stops} stops, the mean of the inquiries at each; thin:"
        " the law that all beacons of the world share, without shadowing. Diamonds: as an example, all"
        f" distances that the median level of the run stands for. {'; '.join(told)}.",
        alt="Received strength falls with distance, and rises and falls on its way. " + "; ".join(told) + ".",
    )


def _ranging_trials(study: Study) -> Drawn | None:
    runs = _runs(study, RANGING, "trial_{}_m")
    if not runs:
        return None
    lines: list[Line] = [(f"trial {run}", RANGING, f"trial_{run}_m") for run in runs]
    lines.append(("mean", RANGING, "trials_mean_m"))
    figure = figures.new_figure(1.0 + 0.4 * len(lines))
    axes = figure.subplots()
    _against_printed(axes, study, lines)
    axes.set_xlabel("mean error of the distances (m)")
    _legend_above(figure, *_families_and_printed(study, study.worlds(RANGING, "trials_mean_m")))
    return Drawn(
        name="table1",
        figure=figure,
        title="Errors of ranging, printed and rebuilt",
        caption="Mean absolute error of all candidate distances of a trial."
        f" {_dots(study, RANGING, 'trials_mean_m')}"
        " Which run a printed trial belongs to is not known: they stand in the order printed. Where the"
        " worlds are calibrated on the mean, its agreement is by construction.",
        alt=_alt("Error of ranging", study, lines, "m"),
    )


def _filter_run(study: Study) -> Drawn | None:
    rows = [row for row in (ALONE, FILTER) if row in study.rows("final_mean_m")]
    if not rows:
        return None
    errors = {row: study.results.errors(row) for row in rows}
    shown = []
    for family in study.families:
        observed = study.first_world("observed", family)
        if "recording.time_s" not in observed:
            continue
        time_s = np.atleast_2d(observed["recording.time_s"])
        run, world = min(RUN_SHOWN, len(time_s)), _first(study, family)
        first = (run - 1) * time_s.shape[1]
        found = {}
        for row, frame in errors.items():
            own = frame[(frame["family"] == family) & (frame["world"] == world) & frame["value"].isna()]
            own = own[own["sample"].between(first, first + time_s.shape[1] - 1)].sort_values("sample")
            if len(own):
                found[row] = (own["sample"].to_numpy() - first + 1, own["error_m"].to_numpy(dtype=float))
        if found:
            shown.append((family, run, world, found))
    if not shown:
        return None
    figure = figures.new_figure(0.5 + 2.2 * len(shown))
    panels = figure.subplots(len(shown), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    told = []
    for axes, (family, _, _, found) in zip(panels, shown, strict=True):
        for row, (iteration, error_m) in found.items():
            look = stroke(row)
            axes.plot(
                iteration, error_m, look.marker + look.line, color=look.color, markersize=4.5, label=row
            )
        axes.set_title(family)
        axes.set_ylabel("position error (m)")
        means = ", ".join(f"{row} {error_m.mean():.2f} m" for row, (_, error_m) in found.items())
        told.append(f"{family}: mean {means}")
    panels[0].set_ylim(bottom=0)
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlabel("iteration")
    _legend_above(figure, *panels[0].get_legend_handles_labels())
    _, run, world, found = shown[0]
    count = max(len(error_m) for _, error_m in found.values())
    return Drawn(
        name="fig5",
        figure=figure,
        title="Error with and without the particle filter",
        caption=f"Position error at each iteration of run {run} ({STARTS[run - 1]}) of world {world + 1} of"
        f" {_in_all(study)}, n = {count} iterations. The paper does not say which run it shows; this one"
        f" was fixed by its number, before any was drawn. Over the run, {'; '.join(told)}.",
        alt=f"Position error over {count} iterations of run {run}. {'; '.join(told)}.",
    )


def _runs_against_printed(study: Study) -> Drawn | None:
    parts = [
        ("iterations", ROBOT, "iterations_{}", "iterations_mean"),
        ("trilaterations, k", RANGING, "k_{}", "k_mean"),
        ("final error (m)", FILTER, "final_{}_m", "final_mean_m"),
    ]
    parts = [part for part in parts if _runs(study, part[1], part[2])]
    if not parts:
        return None
    figure = figures.new_figure(4.1)
    panels = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    told = []
    for axes, (words, row, metric, mean) in zip(panels, parts, strict=True):
        lines: list[Line] = [(_start(r), row, metric.format(r)) for r in _runs(study, row, metric)]
        lines.append(("mean", row, mean))
        _against_printed(axes, study, lines)
        axes.set_xlim(left=0)
        axes.set_xlabel(words)
        told.append(_alt(words[0].upper() + words[1:], study, lines, ""))
    _legend_above(figure, *_families_and_printed(study, study.worlds(parts[0][1], parts[0][3])))
    return Drawn(
        name="table2",
        figure=figure,
        title="The six runs, printed and rebuilt",
        caption=f"The columns of Table II and their means. {_dots(study, parts[-1][1], parts[-1][3])}"
        " Drives do not depend on the radio: the iterations are equal in all families.",
        alt=" ".join(told),
    )


def _summary(study: Study) -> Drawn | None:
    families = [family for family in study.families if len(study.get(family, FILTER, "final_mean_m"))]
    if not families:
        return None
    figure = figures.new_figure(3.3)
    axes = figure.subplots()
    digits = {study.printed.get((family, FILTER), {}).get("final_mean_m") for family in families} - {None}
    printed = min(digits, default=None, key=str)
    told = []
    for family in families:
        values, look = np.sort(study.get(family, FILTER, "final_mean_m")), study.look(family)
        label = f"{family}: mean {values.mean():.2f} m"
        if printed is not None:
            reached = int(np.count_nonzero(values <= float(printed)))
            label += f"; {reached} of {len(values)} worlds at or below {printed} m"
        axes.ecdf(values, color=look.color, linestyle=look.line, label=label)
        told.append(label)
    if printed is not None:
        axes.axvline(float(printed), color="#111111", linewidth=1.0, linestyle=(0, (2, 2)))
        axes.annotate(
            f"printed {printed}",
            (float(printed), 0.985),
            xycoords=("data", "axes fraction"),
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=8,
            va="top",
        )
    axes.set_xlim(left=0)
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f}")
    axes.set_xlabel("mean error at the end of six runs (m)")
    axes.set_ylabel("share of worlds (%)")
    _legend_above(figure, *axes.get_legend_handles_labels(), columns=1)
    return Drawn(
        name="summary",
        figure=figure,
        title="Mean final error of six runs",
        caption="A paper is one experiment, a world too: the share of worlds in which the mean of the six"
        f" final errors of {FILTER} is at most as large as the value on the axis; n = 6 runs in each of"
        f" {study.worlds(FILTER, 'final_mean_m')} worlds a family."
        + (f" Dashed: the printed mean. {'; '.join(told)}." if printed is not None else ""),
        alt="Cumulative distribution over worlds of the mean final error. " + "; ".join(told) + ".",
    )


def _ablations(study: Study) -> Drawn | None:
    rows = study.rows("final_mean_m")
    if not rows:
        return None
    figure = figures.new_figure(0.9 + 0.25 * len(rows))
    panels = _rows_of_families(figure, study, rows, {"mean_m": ("o", True)})
    for axes in panels:
        axes.set_xlabel("mean position error (m)")
    return Drawn(
        name="ablations",
        figure=figure,
        title="Tracking: the rows against each other",
        caption=f"Mean error over all iterations of six runs. {_dots(study, rows[0], 'mean_m', False)} Rows"
        f" named {FILTER}_ change one of its parts; {_epochs(study, rows)}.",
        alt=_rows_alt("Mean error of tracking", study, rows, ["mean_m"]),
    )


def _trilateration(study: Study) -> Drawn | None:
    rows = study.rows("outputs_m")
    if not rows:
        return None
    figure = figures.new_figure(1.15 + 0.42 * len(rows))
    panels = _rows_of_families(figure, study, rows, {"mean_m": ("o", True), "outputs_m": ("s", False)})
    for axes in panels:
        axes.set_xlabel("mean position error (m)")
    handles = [
        panels[0].plot([], [], "o", color=GREY)[0],
        panels[0].plot([], [], "s", color=GREY, markerfacecolor="white")[0],
    ]
    _legend_above(figure, handles, ["output whose distances fit best", "all outputs"])
    return Drawn(
        name="trilateration",
        figure=figure,
        title="Trilateration: the rows against each other",
        caption="Mean error of the output of an iteration whose distances fit best, and of all its outputs."
        f" {_dots(study, rows[0], 'mean_m', False)} An iteration without output counts in no mean:"
        f" {_epochs(study, rows)}.",
        alt=_rows_alt("Mean error of the best fit, and of all outputs", study, rows, ["mean_m", "outputs_m"]),
    )


def _convergence(study: Study) -> Drawn | None:
    own = study.results.measures
    own = own[(own["algorithm"] == "step") & own["metric"].str.startswith("converged")]
    family = next((name for name in study.families if (own["family"] == name).any()), None)
    if "step" not in study.results.sweeps or family is None:
        return None
    own = own[own["family"] == family]
    table = own.pivot_table(index="value", columns="metric", values="x", aggfunc="mean")
    steps = table.index.to_numpy(dtype=float)
    classes = [f"converged_{number}" for number in range(len(NEAREST_M))]
    share = 100 * table.reindex(columns=classes).to_numpy(dtype=float)
    present = np.flatnonzero(~np.isnan(share).all(axis=0))
    if not len(present):
        return None
    first, last = int(present[0]), int(present[-1])
    figure = figures.new_figure(1.2 + 0.36 * len(steps))
    axes = figure.subplots()
    image = axes.imshow(
        share[:, first : last + 1],
        cmap="cividis",
        vmin=0,
        vmax=100,
        aspect="auto",
        extent=(first, last + 1, len(steps), 0),
    )
    for line, step in enumerate(steps):
        for column in range(first, last + 1):
            value = share[line, column]
            axes.text(
                column + 0.5,
                line + 0.5,
                NOTHING if np.isnan(value) else _percent(value),
                ha="center",
                va="center",
                fontsize=8.5,
                color="#111111" if np.isnan(value) or value > 50 else "white",
            )
        # Each line of cells is one step, so that the limit is a staircase.
        limit = _column(step / 2)
        if first <= limit <= last + 1:
            for color, width in (("white", 4.5), (LIMIT_COLOR, 2.5)):
                axes.plot(
                    [limit, limit],
                    [line, line + 1],
                    color=color,
                    linewidth=width,
                    solid_capstyle="butt",
                    clip_on=False,
                )
    axes.plot([], [], color=LIMIT_COLOR, linewidth=2.5, label="step = twice the smallest distance")
    axes.set_xlim(first, last + 1)
    axes.set_yticks(np.arange(len(steps)) + 0.5, [f"{step:g}" for step in steps])
    axes.set_xticks(range(first, last + 1), [f"{low:g}" for low in NEAREST_M[first : last + 1]])
    axes.grid(visible=False)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("smallest of the three distances (m)")
    axes.set_ylabel("step")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
    figure.colorbar(image, ax=axes, label="trilaterations that converge (%)", pad=0.02)
    worlds = int(own["world"].nunique())
    total = ""
    if "converged" in table:
        told = ", ".join(f"{100 * mean:.1f} % at {step:g}" for step, mean in table["converged"].items())
        total = f" Of all trilaterations: {told}."
    return Drawn(
        name="convergence",
        figure=figure,
        title="Which steps converge",
        caption="Share of trilaterations whose iteration converges, by step and by the smallest of the three"
        f" distances: mean over n = {worlds} worlds of family {family}. The last class has no upper end."
        " Right of the red line the step is below twice the smallest distance, which is enough near the"
        " solution of distances that fit each other; measured ones need not. An iteration that reaches its"
        f" largest number of steps counts as not converged, and small steps are slow.{total}",
        alt="Heat map of the share of trilaterations that converge. By class of the smallest distance: "
        + "; ".join(
            f"step {step:g}: "
            + ", ".join(
                f"{_percent(share[line, column])} % from {NEAREST_M[column]:g} m"
                for column in present
                if not np.isnan(share[line, column])
            )
            for line, step in enumerate(steps)
        )
        + f".{total}",
        sweeps=("step",),
    )


def _particles(study: Study) -> Drawn | None:
    return _sweep(study, "particles", "particles", "Number of particles")


def _sigma(study: Study) -> Drawn | None:
    return _sweep(study, "sigma", "sigma of the likelihood (m)", "Width of the likelihood")


def _sweep(study: Study, name: str, label: str, title: str) -> Drawn | None:
    note = f"It is that of {FILTER}; the paper does not print this setting."
    return sweep_figure(study, name, name, label=label, title=title, note=note)


def _distributions(study: Study) -> Drawn | None:
    families = [family for family in study.families if study.rows("final_mean_m", family)]
    if not families:
        return None
    figure = figures.new_figure(3.6 * len(families))
    panels = figure.subplots(len(families), 1, sharex=True, squeeze=False)[:, 0]
    reaches_m = []
    for axes, family in zip(panels, families, strict=True):
        figures.distribution(axes, study.results, family, study.rows("final_mean_m", family))
        figures.legend_beside(axes)
        axes.set_title(family)
        reaches_m.append(axes.get_xlim()[1])
    panels[0].set_xlim(0, max(reaches_m))
    rows = study.rows("final_mean_m")
    return Drawn(
        name="distribution",
        figure=figure,
        title="Error distribution of tracking",
        caption="Share of iterations with a position error up to a given size, all iterations of all runs"
        f" and worlds pooled; {_epochs(study, rows)}.",
        alt=" ".join(
            figures.distribution_alt(study.results, family, study.rows("final_mean_m", family))
            for family in families
        ),
    )


FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (
    _world,
    _static_series,
    _static_histogram,
    _curve,
    _ranging_trials,
    _filter_run,
    _runs_against_printed,
    _summary,
    _ablations,
    _trilateration,
    _convergence,
    _particles,
    _sigma,
    _distributions,
)
"""What draws each figure, in their order; None where a configuration leaves out what it shows."""


def _against_printed(axes: Axes, study: Study, lines: Sequence[Line]) -> None:
    """Draw rebuilt means with where single experiments lie, a shade a family, and printed numbers."""
    for place, (_, row, metric) in enumerate(lines):
        digits = set()
        for family, offset in zip(study.families, _offsets(len(study.families)), strict=True):
            values, look = study.get(family, row, metric), study.look(family)
            if not len(values):
                continue
            _dot(axes, values, place + offset, look.color, look.marker)
            digits.add(study.printed.get((family, row), {}).get(metric))
        for printed in sorted(digits - {None}, key=str):
            axes.plot(
                float(str(printed)),
                place,
                "D",
                markersize=8,
                markerfacecolor="none",
                markeredgecolor="#111111",
                markeredgewidth=1.1,
                zorder=4,
                clip_on=False,
            )
    figures.label_rows(axes, [words for words, _, _ in lines])
    if lines[-1][0] == "mean" and len(lines) > 1:
        axes.axhline(len(lines) - 1.5, color=GREY, linewidth=0.7)


def _dot(axes: Axes, values: Array, place: float, color: str, marker: str, filled: bool = True) -> None:
    """Draw a mean over worlds, with where single experiments lie if there are several worlds."""
    if len(values) > 1:
        low, high, _ = figures.interval_of(values)
        axes.plot([low, high], [place, place], color=color, linewidth=3.2, alpha=0.45, solid_capstyle="round")
    axes.plot(
        values.mean(), place, marker, color=color, markersize=5, markerfacecolor=color if filled else "white"
    )


def _rows_of_families(
    figure: Figure, study: Study, rows: Sequence[str], metrics: Mapping[str, tuple[str, bool]]
) -> Sequence[Axes]:
    """Draw rows in one panel a family, side by side, cut at the same place behind those that compete."""
    panels: Sequence[Axes] = figure.subplots(1, len(study.families), sharey=True, squeeze=False)[0]
    first = next(iter(metrics))
    ends = dict.fromkeys(rows, 0.0)
    for axes, family in zip(panels, study.families, strict=True):
        for place, row in enumerate(rows):
            offsets = _offsets(len(metrics))
            for offset, (metric, (marker, filled)) in zip(offsets, metrics.items(), strict=True):
                values = study.get(family, row, metric)
                if len(values):
                    _dot(axes, values, place + offset, stroke(row).color, marker, filled)
                    ends[row] = max(ends[row], float(figures.interval_of(values).high))
        axes.set_title(family)
    figures.label_rows(panels[0], rows)
    for axes in panels:
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(0, 1.05 * max(ends.values()) or 1.0)
    for axes, family in zip(panels, study.families, strict=True):
        found = {row: study.get(family, row, first) for row in rows}
        figures.keep_in_reach(
            axes, {row: float(v.mean()) if len(v) else 0.0 for row, v in found.items()}, ends
        )
    return panels


def _legend_above(figure: Figure, handles: Sequence[Any], labels: Sequence[str], columns: int = 4) -> None:
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def _families_and_printed(study: Study, worlds: int) -> tuple[list[Any], list[str]]:
    """Return handles and labels: one a family, the interval, the printed number."""
    axes = figures.new_figure(1.0).subplots()
    handles: list[Any] = []
    for family in study.families:
        look = study.look(family)
        handles += axes.plot([], [], look.marker, color=look.color, markersize=5)
    labels = list(study.families)
    if worlds > 1:
        handles += axes.plot([], [], color=GREY, linewidth=3.2, alpha=0.45)
        labels.append(central(worlds))
    handles += axes.plot(
        [], [], "D", markersize=8, markerfacecolor="none", markeredgecolor="#111111", linestyle="none"
    )
    return handles, [*labels, "printed"]


def _offsets(count: int) -> Array:
    return 0.36 * (np.arange(count, dtype=float) - (count - 1) / 2)


def _numbered(axes: Axes, place_m: Array, number: int, color: str) -> None:
    axes.annotate(
        f"{number}",
        tuple(place_m),
        fontsize=8.5,
        weight="bold",
        color="white",
        ha="center",
        va="center",
        zorder=5,
        bbox={"boxstyle": "circle,pad=0.2", "fc": color, "ec": "white"},
    )


def _column(distance_m: float) -> float:
    """Return where a distance lies among the classes of smallest distance, in columns."""
    return float(np.interp(distance_m, NEAREST_M, np.arange(len(NEAREST_M))))


def _percent(value: float) -> str:
    """Return a share without rounding one that is not whole to all or nothing."""
    if 99.5 <= value < 100:
        return f"{np.floor(10 * value) / 10:.1f}"
    if 0 < value < 0.5:
        return f"{np.ceil(10 * value) / 10:.1f}"
    return f"{value:.0f}"


def _start(run: int) -> str:
    return f"{run} {STARTS[run - 1]}" if run <= len(STARTS) else f"{run}"


def _runs(study: Study, row: str, metric: str) -> list[int]:
    """Return the numbers of the runs for which a metric was measured."""
    names = {name for _, own, name in study.values if own == row}
    count = 0
    while metric.format(count + 1) in names:
        count += 1
    return list(range(1, count + 1))


def _static(study: Study) -> tuple[str, Array, Array] | None:
    family = study.families[0]
    observed = study.first_world("observed", family)
    if "static.rss_dbm" not in observed:
        return None
    return family, observed["static.time_s"], observed["static.rss_dbm"]


def _static_place(study: Study) -> str:
    settings = study.results.paper.get("settings", {}).get(study.results.study, {})
    distance_m = settings.get("static_distance_m", {}).get("value")
    return "a fixed distance" if distance_m is None else f"{distance_m:g} m"


def _static_alt(rss_dbm: Array) -> str:
    low, high = (decimals(float(end), least=0) for end in (rss_dbm.min(), rss_dbm.max()))
    mean, deviation = (decimals(float(value), least=1) for value in (rss_dbm.mean(), rss_dbm.std()))
    return (
        f"{len(rss_dbm)} readings of a robot at rest, from {low} to {high} dBm, mean {mean} dBm, standard"
        f" deviation {deviation} dB."
    )


def _first(study: Study, family: str) -> int:
    return int(np.asarray(study.results.observed[family]["world"])[0])


def _in_all(study: Study) -> int:
    """Return the number of worlds of a family."""
    return max(len(values) for values in study.values.values())


def _spread(counts: Sequence[float]) -> str:
    low, high = min(counts), max(counts)
    return f"{high:.0f}" if low == high else f"{low:.0f} to {high:.0f}"


def _epochs(study: Study, rows: Sequence[str]) -> str:
    """Return in words how many iterations the worlds of rows have."""
    counts = [study.get(family, row, "n") for family in study.families for row in rows]
    present = [count for values in counts for count in values]
    worlds = max(len(values) for values in counts)
    return f"n = {_spread(present)} iterations in each of {worlds} worlds a family"


def _dots(study: Study, row: str, metric: str, printed: bool = True) -> str:
    """Return in words what dots, bars and diamonds are."""
    worlds = study.worlds(row, metric)
    told = f"Dot: mean over {worlds} worlds" + (f", bar: {central(worlds)}" if worlds > 1 else "")
    return told + ("; hollow diamond: printed. Six runs a world, n = 6." if printed else ".")


def _alt(head: str, study: Study, lines: Sequence[Line], unit: str) -> str:
    """Return in words what a panel of rebuilt and printed numbers shows."""
    parts = []
    for words, row, metric in lines:
        told = []
        for family in study.families:
            values = study.get(family, row, metric)
            if len(values):
                digits = study.printed.get((family, row), {}).get(metric)
                told.append(f"{family} {values.mean():.2f}" + (f" (printed {digits})" if digits else ""))
        parts.append(f"{words}: {', '.join(told)}")
    return f"{head}{f' in {unit}' if unit else ''}. " + "; ".join(parts) + "."


def _rows_alt(head: str, study: Study, rows: Sequence[str], metrics: Sequence[str]) -> str:
    """Return in words what panels of rows show."""
    parts = []
    for family in study.families:
        told = []
        for row in rows:
            values = [study.get(family, row, metric) for metric in metrics]
            if len(values[0]):
                told.append(f"{row} " + " and ".join(f"{v.mean():.2f} m" for v in values if len(v)))
        parts.append(f"{family}: {', '.join(told)}")
    return f"{head}. " + "; ".join(parts) + "."
