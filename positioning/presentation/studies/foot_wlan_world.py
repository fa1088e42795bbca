"""Figures of one walk of the study of WLAN and foot-mounted inertial sensors, numbered as in the paper.

See Frank et al., Figures 4 to 6 and Figure 7, left.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, decimals

WLAN, FUSED = "wlan", "cascaded"

WORDS = {WLAN: "WLAN", FUSED: "fused"}
"""The two systems of Figure 7 and the words for them."""

MEAN = "mean_m"

POINT_SHOWN = 1
"""The calibration point of Figure 5: the first, chosen by its number before any was drawn."""

HISTOGRAMS = 3
"""Access points of Figure 5."""

HISTOGRAM_COLORS = ("#14507d", "#c8641a", "#4d7f58")

TRUE_COLOR, WALL_COLOR = "#111111", "#9aa4ac"

CALIBRATED = (
    "The noise of the scans is calibrated on the printed mean of WLAN alone, on other worlds; no other"
    " printed number entered."
)

PRINTED: dict[str, Any] = {
    "marker": "D",
    "markersize": 7,
    "markerfacecolor": "none",
    "markeredgecolor": TRUE_COLOR,
    "markeredgewidth": 1.2,
    "linestyle": "none",
    "zorder": 5,
    "clip_on": False,
}
"""How a printed number is marked."""

Array = np.ndarray[Any, np.dtype[np.float64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]


@dataclass(frozen=True)
class Walk:
    """The first world of the first family, and what the rows made of it.

    Attributes
    ----------
    study
        All results.
    family
        Its family.
    observed, truth
        Arrays of the world, without the axis of worlds.
    """

    study: Study
    family: str
    observed: Mapping[str, Array]
    truth: Mapping[str, Array]

    @classmethod
    def of(cls, study: Study) -> "Walk | None":
        """Take the first world of the first family; None where the worlds are not at hand."""
        family = study.families[0]
        observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
        if "recording.time_s" not in observed or "truth.path_m" not in truth:
            return None
        return cls(study, family, observed, truth)

    @property
    def kept(self) -> Flags:
        """Epochs before the end, [n]."""
        return ~np.isnan(self.observed["recording.time_s"])

    @property
    def asked(self) -> Flags:
        """Epochs at which a mark is passed that was noted, [n]."""
        return ~np.isnan(self.truth["truth.position_m"][:, 0])

    @property
    def duration_s(self) -> float:
        """Time of the last epoch."""
        return float(np.nanmax(self.observed["recording.time_s"]))

    def track_m(self, row: str) -> Array | None:
        """Return the places of a row at all epochs, [n, 2]; None where it has none."""
        found = self.study.results.estimate(row, self.family).get("position_m")
        return None if found is None else np.asarray(found[0], dtype=float)

    def error_m(self, row: str) -> Array | None:
        """Return the errors of a row at the passages, [k]; None where it has no track."""
        track_m = self.track_m(row)
        if track_m is None:
            return None
        error_m: Array = np.linalg.norm(track_m - self.truth["truth.position_m"], axis=-1)[self.asked]
        return error_m

    def where(self) -> str:
        """Return in words which world this is."""
        return where(self.study, self.family)

    def counted(self) -> str:
        """Return in words how many passages it has."""
        return f"n = {int(self.asked.sum())} passages of marks"


def where(study: Study, family: str) -> str:
    """Return in words which world the first is."""
    number = int(study.results.observed[family]["world"][0])
    worlds = max((len(values) for values in study.values.values()), default=1)
    return f"world {number + 1} of {worlds}, family {family}"


def draw_walk(study: Study) -> list[Drawn]:
    """Return the figures of the first walk, in the order of the paper.

    A figure whose row or array is absent is left out.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    walk = Walk.of(study)
    if walk is None:
        return []
    drawn = [make(walk) for make in FIGURES]
    return [item for item in drawn if item is not None]


def _floor(walk: Walk) -> Drawn:
    figure, axes = _plan(walk)
    point_m = _points(walk)
    if len(point_m):
        axes.plot(*point_m.T, "s", color="#5b8fb8", markersize=3.6, label="calibration points", zorder=3)
    access_point_m = walk.truth.get("plan.access_point_m", np.empty((0, 2)))
    if len(access_point_m):
        axes.plot(
            *access_point_m.T,
            "^",
            color="#d55e00",
            markeredgecolor="white",
            markersize=9,
            label="access points",
            zorder=5,
        )
    mark_m = _marks(walk)
    _draw_marks(axes, mark_m)
    legend_above(figure, axes)
    size_m = walk.observed["site.corner_m"][1] - walk.observed["site.corner_m"][0]
    return Drawn(
        name="fig4",
        figure=figure,
        title="Floor plan, access points, marks and calibration points",
        caption=f"n = {len(access_point_m)} access points, {len(mark_m)} marks and {len(point_m)} calibration"
        f" points, {walk.where()}. Grey: walls. The paper's plan has no scale: size, walls and all places are"
        " assumed, the numbers of access points and marks are printed. No algorithm is told where the access"
        " points are.",
        alt=f"Plan of {size_m[0]:g} m by {size_m[1]:g} m with a corridor in a ring, {len(access_point_m)}"
        f" access points, {len(mark_m)} marks and {len(point_m)} calibration points along the corridor.",
    )


def _histograms(walk: Walk) -> Drawn | None:
    if "survey.rss_dbm" not in walk.observed:
        return None
    point_m = _points(walk)
    place_m = point_m[min(POINT_SHOWN, len(point_m)) - 1]
    scans_dbm = walk.observed["survey.rss_dbm"][np.all(walk.observed["survey.position_m"] == place_m, axis=1)]
    heard = np.count_nonzero(~np.isnan(scans_dbm), axis=0)
    # A mean over nothing: those never heard come last.
    mean_dbm = np.nansum(scans_dbm, axis=0) / np.maximum(heard, 1)
    order = np.lexsort((-mean_dbm, heard == 0))
    chosen = [int(number) for number in order[:HISTOGRAMS] if heard[number]]
    if not chosen:
        return None
    figure = figures.new_figure(0.6 + 1.25 * len(chosen))
    panels = figure.subplots(len(chosen), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    told = []
    for axes, number, color in zip(panels, chosen, HISTOGRAM_COLORS, strict=False):
        level_dbm = scans_dbm[~np.isnan(scans_dbm[:, number]), number]
        levels, counts = np.unique(np.rint(level_dbm), return_counts=True)
        axes.bar(levels, counts, width=0.86, color=color)
        axes.grid(visible=False, axis="x")
        axes.set_title(f"access point {number + 1}: heard in {heard[number]} of {len(scans_dbm)} scans")
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=4))
        told.append(
            f"access point {number + 1} {decimals(float(level_dbm.mean()), least=1)} dBm and"
            f" {decimals(float(level_dbm.std()), least=1)} dB"
        )
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlabel("RSSI (dBm)")
    figure.supylabel("scans", fontsize=9)
    words = f"Mean and standard deviation: {'; '.join(told)}."
    return Drawn(
        name="fig5",
        figure=figure,
        title=f"Histograms of the RSSI of {len(chosen)} access points at one calibration point",
        caption=f"n = {len(scans_dbm)} scans at calibration point {min(POINT_SHOWN, len(point_m))},"
        f" {walk.where()}, one bar a dBm; the strongest access points there. {words} Which point the paper"
        f" shows is not said; this one was fixed by its number, before any was drawn. {CALIBRATED}",
        alt=f"{len(chosen)} histograms of {len(scans_dbm)} scans. {words}",
    )


def _track(walk: Walk) -> Drawn | None:
    track_m, error_m = walk.track_m(FUSED), walk.error_m(FUSED)
    if track_m is None or error_m is None:
        return None
    track_m, path_m = track_m[walk.kept], walk.truth["truth.path_m"][walk.kept]
    figure, axes = _plan(walk)
    axes.plot(*path_m.T, color=TRUE_COLOR, linewidth=0.7, label="true way", zorder=2)
    axes.plot(*track_m.T, color=stroke(FUSED).color, linewidth=1.1, label=f"track of {FUSED}", zorder=3)
    _draw_marks(axes, _marks(walk))
    _widen(axes, track_m)
    legend_above(figure, axes)
    told = f"Mean error at the passages {error_m.mean():.2f} m, largest {error_m.max():.2f} m."
    return Drawn(
        name="fig6",
        figure=figure,
        title="Recorded track of the fused filter",
        caption=f"Track of row {FUSED} over one walk of {walk.duration_s:.0f} s, {walk.counted()},"
        f" {len(track_m)} epochs, {walk.where()}. {told} The plan is assumed. {CALIBRATED}",
        alt=f"Plan with the track of {FUSED} around the corridor beside the true way, over"
        f" {walk.duration_s:.0f} s. {told}",
    )


def _over_time(walk: Walk) -> Drawn | None:
    errors = {row: error_m for row in WORDS if (error_m := walk.error_m(row)) is not None}
    if not errors:
        return None
    time_s = walk.observed["recording.time_s"][walk.asked]
    figure = figures.new_figure(3.1)
    axes = figure.subplots()
    for row, error_m in errors.items():
        look = stroke(row)
        axes.plot(
            time_s,
            error_m,
            linestyle="--" if row == WLAN else "-",
            marker=look.marker,
            markersize=4,
            linewidth=1.3,
            color=look.color,
            label=WORDS[row],
        )
    axes.set_ylim(bottom=0)
    axes.set_xlabel("walking time (s)")
    axes.set_ylabel("position error (m)")
    legend_above(figure, axes)
    means = ", ".join(
        f"{WORDS[row]} {error_m.mean():.2f} m, at most {error_m.max():.2f} m"
        for row, error_m in errors.items()
    )
    return Drawn(
        name="fig7a",
        figure=figure,
        title="Error over walking time",
        caption=f"Position error at each passage of a mark that was noted, {walk.counted()}, {walk.where()};"
        f" the lines only join them. Mean: {means}. Passages are kept by chance here, as if the others had"
        f" not been noted; how the paper comes to 49 in four laps past 17 marks is not said. {CALIBRATED}",
        alt=f"Errors at {len(time_s)} passages over {walk.duration_s:.0f} s. Mean: {means}.",
    )


FIGURES: tuple[Callable[[Walk], Drawn | None], ...] = (_floor, _histograms, _track, _over_time)
"""What draws each figure, in their order; None where what it shows is absent."""


def calibration_points(survey_m: Array) -> Array:
    """Return the places of a survey in which the scans of a place stand together, each once, [k, 2]."""
    if not len(survey_m):
        return survey_m
    first = np.any(np.diff(survey_m, axis=0, prepend=np.nan) != 0, axis=1)
    return np.asarray(survey_m[first])


def legend_above(figure: Figure, axes: Axes, columns: int = 5) -> None:
    """Explain what is drawn in a panel above the figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def passages(study: Study) -> str:
    """Return in words how many passages a world has."""
    family = study.families[0]
    counts = np.concatenate([study.get(family, row, "n") for row in study.rows("n", family)] or [np.zeros(1)])
    low, high = counts.min(), counts.max()
    return f"n = {high:.0f} passages" if low == high else f"n = {low:.0f} to {high:.0f} passages"


def worlds_of(study: Study) -> int:
    """Return the number of worlds."""
    return max((study.worlds(row, MEAN) for row in study.rows(MEAN)), default=0)


def counted(study: Study) -> str:
    """Return in words how many passages and worlds there are."""
    where = f"in each of {worlds_of(study)} worlds" if worlds_of(study) > 1 else "in one world"
    return f"{passages(study)} {where}, family {study.families[0]}"


def bars(study: Study) -> str:
    """Return in words what bars show, empty for one world."""
    return f", bar: {central(worlds_of(study))}" if worlds_of(study) > 1 else ""


def _points(walk: Walk) -> Array:
    return calibration_points(walk.observed.get("survey.position_m", np.empty((0, 2))))


def _marks(walk: Walk) -> Array:
    return walk.truth.get("plan.mark_m", np.empty((0, 2)))


def _plan(walk: Walk) -> tuple[Figure, Axes]:
    """Return a figure with the plan of the floor."""
    corner_m = walk.observed["site.corner_m"]
    size_m = corner_m[1] - corner_m[0]
    figure = figures.new_figure(6.4 * float(size_m[1] / size_m[0]) + 0.8)
    axes = figure.subplots()
    for wall_m in walk.observed.get("site.wall_m", ()):
        axes.plot(*wall_m.T, color=WALL_COLOR, linewidth=1.0, zorder=1)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlim(corner_m[0, 0] - 0.5, corner_m[1, 0] + 0.5)
    axes.set_ylim(corner_m[0, 1] - 0.5, corner_m[1, 1] + 0.5)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    return figure, axes


def _draw_marks(axes: Axes, mark_m: Sequence[Array] | Array) -> None:
    if len(mark_m):
        axes.plot(
            *np.asarray(mark_m).T,
            "D",
            color=GREY,
            markerfacecolor="white",
            markeredgecolor=TRUE_COLOR,
            markersize=5.5,
            label="marks",
            zorder=4,
        )


def _widen(axes: Axes, place_m: Array) -> None:
    """Take in a track that leaves the floor."""
    for limits, setter, values in (
        (axes.get_xlim(), axes.set_xlim, place_m[:, 0]),
        (axes.get_ylim(), axes.set_ylim, place_m[:, 1]),
    ):
        low, high = float(values.min()) - 0.5, float(values.max()) + 0.5
        setter(min(limits[0], low), max(limits[1], high))
