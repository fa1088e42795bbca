"""Figures of leave-one-out location fingerprinting, numbered as in the paper.

See Mirzababaei & Akbari, section 6, Figures 2 and 3 and Table 1.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.figures import Drawn
from positioning.presentation.style import stroke
from positioning.presentation.tables import central, decimals

REFERENCE = "wknn"


class Sweep(NamedTuple):
    """A sweep as the paper has it: figure, row whose printed mean belongs to the optimum, claim, words."""

    figure: str
    row: str
    claim: str
    label: str
    title: str


SWEEPS = {
    "rbf_samples": Sweep("fig2a", "rbf_network", "", "training samples", "Global network: training samples"),
    "rbf_neurons": Sweep("fig2b", "rbf_network", "fig2.rbf.neurons", "neurons", "Global network: neurons"),
    "rbf_spread": Sweep("fig2c", "rbf_network", "fig2.rbf.spread", "spread (dB)", "Global network: spread"),
    "rbf_nearest_samples": Sweep(
        "local_samples",
        "rbf_network_nearest",
        "fig2.rbf_nearest.samples",
        "nearest training samples",
        "Local network: nearest samples",
    ),
    "rbf_nearest_neurons": Sweep(
        "local_neurons",
        "rbf_network_nearest",
        "fig2.rbf_nearest.neurons",
        "neurons",
        "Local network: neurons",
    ),
    "rbf_nearest_spread": Sweep(
        "local_spread",
        "rbf_network_nearest",
        "fig2.rbf_nearest.spread",
        "spread (dB)",
        "Local network: spread",
    ),
    "wknn_k": Sweep("wknn_k", "wknn", "", "neighbours k", "Weighted k nearest neighbours: k"),
    "knn_k": Sweep("knn_k", "knn", "fig2.knn.k", "neighbours k", "k nearest neighbours: k"),
}
"""The sweeps in the order of the figures. The paper names no best number of training samples; a sweep
that a configuration leaves out has no figure."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures in the order of the paper.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    family = figures.measured_families(results)[0]
    rows = figures.measured_rows(results, family)
    drawn = [_world(results, family)]
    drawn += [_sweep(results, family, name) for name in SWEEPS if _measured(results, name)]
    drawn += [_distribution(results, family, rows), _table(results, family, rows)]
    if len(rows) > 1:
        drawn.append(_paired(results, family, REFERENCE if REFERENCE in rows else rows[0]))
    return drawn


def _measured(results: StudyResults, sweep: str) -> bool:
    return sweep in results.sweeps and sweep in set(results.measures["algorithm"])


def _world(results: StudyResults, family: str) -> Drawn:
    observed = {name: values[0] for name, values in results.observed[family].items()}
    truth = {name: values[0] for name, values in results.truth[family].items()}
    corner_m, places_m = _numbers(observed["site.corner_m"]), _numbers(observed["survey.position_m"])
    access_point_m, field_dbm = _numbers(observed["site.access_point_m"]), _numbers(truth["truth.field_dbm"])
    size_m = corner_m[1] - corner_m[0]
    figure = figures.new_figure(min(7.0, 5.9 * float(size_m[1] / size_m[0]) + 0.7))
    axes = figure.subplots()
    for wall in _numbers(observed["site.wall_m"]):
        if np.isfinite(wall).all():
            axes.plot(wall[:, 0], wall[:, 1], color="#3c4650", linewidth=1.1, zorder=1)
    points = axes.scatter(places_m[:, 0], places_m[:, 1], c=field_dbm[:, 0], cmap="cividis", s=20, zorder=2)
    figure.colorbar(points, ax=axes, label="mean signal of access point 1 (dBm)", shrink=0.85, pad=0.02)
    for number, (x_m, y_m) in enumerate(access_point_m, start=1):
        axes.plot(x_m, y_m, "^", markersize=9, color="#d55e00", markeredgecolor="white", zorder=3)
        axes.annotate(
            f"{number}",
            (x_m, y_m),
            xytext=(6, 4),
            textcoords="offset points",
            fontsize=9,
            weight="bold",
            color="#8a3d00",
            zorder=4,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
        )
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    number, count = int(np.asarray(observed["world"])), len(places_m)
    return Drawn(
        name="world",
        figure=figure,
        title="One synthetic world",
        caption=f"World {number + 1} of {_worlds(results, family)}: walls with doors, {count} surveyed places"
        f" (n = {count}), {len(access_point_m)} access points (triangles). Colour is the true mean signal of"
        " access point 1, before fading and rounding; rooms without places are closed,"
        " and furniture stands where a place is missing.",
        alt=f"Floor plan of {size_m[0]:.0f} by {size_m[1]:.0f} metres with {count} surveyed places and"
        f" {len(access_point_m)} access points; the signal of access point 1 falls from"
        f" {decimals(field_dbm[:, 0].max(), least=0)} dBm beside it to"
        f" {decimals(field_dbm[:, 0].min(), least=0)} dBm behind the walls.",
    )


def _sweep(results: StudyResults, family: str, name: str) -> Drawn:
    sweep, line = SWEEPS[name], figures.curve(results, name)
    optimum = figures.printed_or_none(results, sweep.claim)
    mean = figures.published(results).get((family, sweep.row), {}).get("mean_m")
    figure = figures.new_figure(3.4)
    figures.sweep_panel(
        figure.subplots(),
        line,
        color=stroke(sweep.row).color,
        label=sweep.label,
        optimum=optimum,
        printed_mean=mean,
    )
    printed = f" Dashed: printed optimum {optimum}" if optimum else ""
    printed += f"; diamond: printed mean {mean} m." if optimum and mean else "." if optimum else ""
    return Drawn(
        name=sweep.figure,
        figure=figure,
        title=sweep.title,
        caption=f"Mean error over {line.worlds} worlds against {sweep.label}; band:"
        f" {central(line.worlds)}; ring: smallest mean, at {line.best:g}.{printed}"
        f" {_sized(results, family)}, each world.",
        alt=f"Mean error against {sweep.label}: "
        + ", ".join(f"{m:.2f} m at {v:g}" for v, m in zip(line.values, line.mean_m, strict=True))
        + (f". The paper's optimum is {optimum}." if optimum else "."),
        sweeps=(name,),
    )


def _distribution(results: StudyResults, family: str, rows: list[str]) -> Drawn:
    numbers = figures.published(results)
    printed = [row for row in rows if (family, row) in numbers]
    others = [row for row in rows if row not in printed]
    groups = [
        (title, group) for title, group in (("rows of the paper", printed), ("other rows", others)) if group
    ]
    figure = figures.new_figure(3.7 * len(groups))
    panels = np.atleast_1d(figure.subplots(len(groups), 1, sharex=True))
    reaches_m = []
    for axes, (title, group) in zip(panels, groups, strict=True):
        figures.distribution(axes, results, family, group)
        figures.legend_beside(axes)
        axes.set_title(title)
        reaches_m.append(axes.get_xlim()[1])
    # The panels share an axis, and the paper's rows decide how far it goes.
    panels[0].set_xlim(0, reaches_m[0])
    return Drawn(
        name="fig3",
        figure=figure,
        title="Error distribution",
        caption="Share of position errors up to a given size, leave-one-out unless the row's name says"
        f" otherwise; all worlds pooled, {figures.counted(results, family)}. Hollow markers: the printed"
        " percentiles of Table 1; filled ones tell the curves apart.",
        alt=figures.distribution_alt(results, family, rows),
    )


def _table(results: StudyResults, family: str, rows: list[str]) -> Drawn:
    figure = figures.new_figure(0.9 + 0.29 * len(rows))
    axes = figure.subplots()
    figures.means_against_printed(axes, results, family, rows)
    return Drawn(
        name="table1",
        figure=figure,
        title="Printed means beside rebuilt ones",
        caption=f"Dot: mean error over worlds; bar: {central(_worlds(results, family))}; hollow diamond:"
        f" the mean printed in Table 1, where there is one. {_sized(results, family)},"
        f" {_worlds(results, family)} worlds.{figures.few_worlds(results, [family], rows)}",
        alt=figures.means_alt(results, family, rows),
    )


def _paired(results: StudyResults, family: str, reference: str) -> Drawn:
    frame = figures.differences(results, family, reference)
    figure = figures.new_figure(1.1 + 0.29 * len(frame))
    figures.difference_panel(figure.subplots(), frame, reference)
    return Drawn(
        name="paired",
        figure=figure,
        title=f"Paired differences to {reference}",
        caption=f"Mean error minus that of {reference} on the same {_of(frame)}, with the 95 % interval"
        f" of the mean difference. {_sized(results, family)}, {_worlds(results, family)} worlds."
        + figures.few_worlds(results, [family], [reference, *frame["algorithm"]], bars=False),
        alt=f"Paired differences to {reference}: "
        + ", ".join(
            f"{r['algorithm']} {r['difference_m']:+.2f} m".replace(" -", " \N{MINUS SIGN}")
            for r in frame.to_dict("records")
        )
        + ".",
    )


def _of(frame: pd.DataFrame) -> str:
    return "worlds" if (frame["unit"] == "world").all() else "samples"


def _worlds(results: StudyResults, family: str) -> int:
    return max(len(figures.per_world(results, family, row)) for row in figures.measured_rows(results, family))


def _sized(results: StudyResults, family: str) -> str:
    samples = figures.per_world(results, family, figures.measured_rows(results, family)[0], "n")[0]
    return f"n = {int(samples)} places"


def _numbers(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.asarray(values, dtype=float)
