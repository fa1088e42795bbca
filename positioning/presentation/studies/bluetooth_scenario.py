"""The figure of the printed scenario: where each solver puts the robot.

See Raghavan et al., section V.A and Figure 4.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import decimals

ZOOM_M = 0.3
"""Half the width of the panel about the true place."""

PRINTED = {
    "pseudo_inverse": ("fig4.pseudo_inverse", "P", "printed pseudo-inverse"),
    "iterative_fractional_printed": ("fig4.iterative", "D", "printed iterative"),
}
"""Rows with a printed point: the claims' common name, the marker and the words for it."""

Array = np.ndarray[Any, np.dtype[np.float64]]


def draw(results: StudyResults) -> list[Drawn]:
    """Return Figure 4.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    family = figures.measured_families(results)[0]
    observed = {name: values[0] for name, values in results.observed[family].items()}
    beacons_m, ranges_m = _numbers(observed["site.access_point_m"]), _numbers(observed["recording.range_m"])
    corner_m, true_m = (
        _numbers(observed["site.corner_m"]),
        _numbers(results.truth[family]["truth.position_m"][0]).reshape(2),
    )
    points_m, printed_m = _points(results, family), _printed(results)
    figure = figures.new_figure(4.9)
    whole, zoom = figure.subplots(1, 2, width_ratios=[1.12, 1])
    for axes in (whole, zoom):
        axes.add_patch(
            Rectangle(tuple(corner_m[0]), *(corner_m[1] - corner_m[0]), fill=False, ec=GREY, linewidth=0.9)
        )
        for beacon_m, range_m in zip(beacons_m, ranges_m.reshape(-1), strict=True):
            axes.add_patch(Circle(tuple(beacon_m), range_m, fill=False, ec="#8a949c", linewidth=0.9))
        _mark(axes, beacons_m, true_m, points_m, printed_m)
        axes.set_aspect("equal")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    for number, (x_m, y_m) in enumerate(beacons_m, start=1):
        whole.annotate(f"{number}", (x_m, y_m), xytext=(5, 4), textcoords="offset points", fontsize=8.5)
    whole.autoscale_view()
    whole.add_patch(
        Rectangle(tuple(true_m - ZOOM_M), 2 * ZOOM_M, 2 * ZOOM_M, fill=False, ec="#111111", linewidth=0.8)
    )
    whole.set_title("beacons, distances and solutions")
    zoom.set_xlim(true_m[0] - ZOOM_M, true_m[0] + ZOOM_M)
    zoom.set_ylim(true_m[1] - ZOOM_M, true_m[1] + ZOOM_M)
    zoom.set_title(f"\N{PLUS-MINUS SIGN}{ZOOM_M:g} m about the true place")
    handles, labels = whole.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, markerscale=0.8)
    return [
        Drawn(
            name="fig4",
            figure=figure,
            title="The printed scenario",
            caption=f"One scenario, n = 1 place, in 1 world: {len(beacons_m)} beacons (triangles), the"
            " printed distances (circles), the true place (cross) and the solution of each row; smaller"
            " markers lie on larger ones where rows agree. Hollow: the printed points."
            + _gaps(points_m, printed_m)
            + " Solutions: "
            + ", ".join(f"{row} {_place(place)}" for row, place in points_m.items())
            + ".",
            alt=f"The true place is {_place(true_m)}. Solutions: "
            + "; ".join(
                f"{row} {_place(place)}, {np.linalg.norm(place - true_m):.2f} m away"
                for row, place in points_m.items()
            )
            + "".join(f"; {PRINTED[row][2]} {_place(place)}" for row, place in printed_m.items())
            + ".",
        )
    ]


def _points(results: StudyResults, family: str) -> dict[str, Array]:
    """Return the solution of each row that ran, [2], metres."""
    found = {}
    for row in figures.measured_rows(results, family):
        place = [figures.per_world(results, family, row, metric) for metric in ("x_m", "y_m")]
        if all(len(values) for values in place):
            found[row] = np.array([values[0] for values in place])
    return found


def _printed(results: StudyResults) -> dict[str, Array]:
    """Return the printed points by row, [2], metres; only those that the paper has whole."""
    found = {}
    for row, (claim, _, _) in PRINTED.items():
        place = [figures.printed_or_none(results, f"{claim}.{axis}") for axis in "xy"]
        if None not in place:
            found[row] = np.array([float(digits or "nan") for digits in place])
    return found


def _mark(
    axes: Axes, beacons_m: Array, true_m: Array, points_m: dict[str, Array], printed_m: dict[str, Array]
) -> None:
    axes.plot(*beacons_m.T, "^", markersize=8, color="#111111", linestyle="none", label="beacon")
    axes.plot(*true_m, "x", markersize=9, color="#111111", markeredgewidth=1.8, label="true place", zorder=6)
    for number, (row, place) in enumerate(points_m.items()):
        look = stroke(row)
        axes.plot(
            *place,
            look.marker,
            linestyle="none",
            markersize=13.0 - 5.5 * number / max(len(points_m) - 1, 1),
            color=look.color,
            markeredgecolor="white",
            markeredgewidth=0.6,
            label=row,
            zorder=4,
        )
    for row, place in printed_m.items():
        _, marker, words = PRINTED[row]
        axes.plot(
            *place,
            marker,
            linestyle="none",
            markersize=15,
            markerfacecolor="none",
            markeredgecolor="#111111",
            label=words,
            zorder=5,
        )


def _gaps(points_m: dict[str, Array], printed_m: dict[str, Array]) -> str:
    """Return in words how far the printed points lie from the solutions of the rows they belong to."""
    told = ""
    for row, place in printed_m.items():
        if row in points_m:
            gap_m = decimals(float(np.linalg.norm(place - points_m[row])), least=4)
            told += f" The {PRINTED[row][2]} point lies {gap_m} m from that of {row}."
    return told


def _place(place_m: Array) -> str:
    return "(" + ", ".join(decimals(float(value), least=4) for value in place_m) + ") m"


def _numbers(values: Any) -> Array:
    return np.asarray(values, dtype=float)
