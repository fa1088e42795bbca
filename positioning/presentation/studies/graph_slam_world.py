"""Figures of one world of the WiFi graph SLAM studies: walks raw and in one frame.

See Gu et al., Figures 4 to 6.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.tables import decimals
from positioning.tasks.alignment import fit_to

RAW, PRINTED_START, ALIGNED = "dead_reckoning", "graph_slam", "aligned"

WORDS = {RAW: "raw", PRINTED_START: "start as printed", ALIGNED: "aligned first"}
"""Rows that are drawn as walks, and words for them."""

LINES = "lines"
"""The family of straight lines, Figure 4."""

MEAN = "mean_m"

WALK_COLORS = ("#0072b2", "#d55e00", "#009e73", "#b5478f", "#8a6d00")

LANDMARK_COLOR, WALL_COLOR, TRUE_COLOR = "#111111", "#9aa4ac", "#111111"

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

TIED = "One rotation and shift for all walks, the best over all visits of landmarks, ties them to the plan."

ASSUMED = (
    "Worlds, drift and the weight of WiFi edges are assumed; study graph_slam_weight shows other weights."
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Scene:
    """The first world of a family, and where the rows put its walks.

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
    def of(cls, study: Study, family: str) -> "Scene | None":
        """Take the first world of a family; None where the worlds are not at hand."""
        observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
        if "walks.position_m" not in observed or not {"truth.position_m", "truth.path_m"} <= truth.keys():
            return None
        return cls(study, family, observed, truth)

    @property
    def visited(self) -> Flags:
        """Poses at which the true place is known to the scoring, [k, n]."""
        return np.asarray(np.isfinite(self.truth["truth.position_m"]).all(axis=-1))

    def own_m(self, row: str) -> Array | None:
        """Return the walks of a row in the frame of the row, [k, n, 2]; None where it has none."""
        found = self.study.results.estimate(row, self.family).get("position_m")
        return None if found is None or not len(found) else np.asarray(found[0], dtype=float)

    def tied_m(self, row: str, by_first: bool = False) -> Array | None:
        """Return the walks of a row in the frame of the plan, [k, n, 2]; None where it has none.

        Parameters
        ----------
        row
            A row of the table.
        by_first
            True ties the frame by the first walk alone, False by all.
        """
        own_m, true_m = self.own_m(row), self.truth["truth.position_m"]
        if own_m is None:
            return None
        if by_first:
            true_m = np.where(np.arange(len(true_m))[:, None, None] == 0, true_m, np.nan)
        return np.asarray(fit_to(own_m[None], true_m[None])[0])

    def error_m(self, place_m: Array) -> Array:
        """Return the errors of walks in the frame of the plan at all visits, [m]."""
        error_m: Array = np.linalg.norm(place_m - self.truth["truth.position_m"], axis=-1)[self.visited]
        return error_m

    def where(self) -> str:
        """Return in words which world this is."""
        return where(self.study, self.family)

    def counted(self) -> str:
        """Return in words how many walks and visits it has."""
        walks = len(self.truth["truth.path_m"])
        asked = int(self.visited.sum())
        what = "ends of lines" if self.family == LINES else "visits of landmarks"
        return f"{walks} walks, n = {asked} {what}"


def where(study: Study, family: str) -> str:
    """Return in words which world the first is.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    family
        Its family.
    """
    number = int(study.results.observed[family]["world"][0])
    worlds = max((len(v) for (own, _, _), v in study.values.items() if own == family), default=1)
    return f"world {number + 1} of {worlds}, family {family}"


def straight_lines(study: Study) -> Drawn | None:
    """Draw the walks along one line, raw and in one frame.

    See Gu et al., Figure 4.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    if LINES not in study.families:
        return None
    scene = Scene.of(study, LINES)
    rows = [] if scene is None else [row for row in WORDS if scene.own_m(row) is not None]
    if scene is None or not rows:
        return None
    places = {row: np.asarray(scene.tied_m(row, by_first=True)) for row in rows}
    last = rows[-1]
    figure = figures.new_figure(4.6)
    layout: list[Any] = [rows, [last + "_wide"] * len(rows)]
    mosaic: Any = figure.subplot_mosaic(layout, height_ratios=[1.5, 1])
    true_m = scene.truth["truth.path_m"][0]
    told = []
    for row in rows:
        axes = mosaic[row]
        _lines(axes, places[row], true_m)
        axes.set_xlabel("x (m)")
        words = WORDS[row]
        found = study.get(LINES, row, "heading_mean_deg")
        if len(found):
            words += f": {decimals(float(found[0]))}\N{DEGREE SIGN}"
            told.append(
                f"{WORDS[row]} {decimals(float(found.mean()))} \N{PLUS-MINUS SIGN}"
                f" {decimals(float(study.get(LINES, row, 'heading_sd_deg').mean()))} degrees"
            )
        axes.set_title(words)
    reach = _reach([places[row] for row in rows])
    for row in rows:
        mosaic[row].set(xlim=reach[0], ylim=reach[1], aspect="equal")
    for row in rows[1:]:
        mosaic[row].tick_params(labelleft=False)
    mosaic[rows[0]].set_ylabel("y (m)")
    wide = mosaic[last + "_wide"]
    _lines(wide, places[last], true_m)
    wide.set_title(f"{WORDS[last]}, y stretched")
    wide.set_xlabel("x (m)")
    wide.set_ylabel("y (m)")
    worlds = max((len(study.get(LINES, row, "heading_mean_deg")) for row in rows), default=1)
    headings = ", ".join(told)
    printed = [figures.printed_or_none(study.results, claim) for claim in ("fig4.heading", "fig4.heading.sd")]
    stated = f" Printed: {printed[0]} \N{PLUS-MINUS SIGN} {printed[1]} degrees." if all(printed) else ""
    return Drawn(
        name="fig4",
        figure=figure,
        title="Walks along one straight line",
        caption=f"{scene.counted()}, {scene.where()}; black: the true line. As in the paper, the first walk"
        " alone is turned onto the line. In the titles: mean error of the headings of the other walks against"
        " the first, this world."
        + (f" Mean and standard deviation over {_of_worlds(worlds)}: {headings}." if told else "")
        + f"{stated} Headings at the start and drift are assumed.",
        alt=f"Walks along one line, {', '.join(WORDS[row] for row in rows)}."
        + (f" Heading errors: {headings}." if told else "")
        + stated,
    )


def raw_walks(study: Study) -> Drawn | None:
    """Draw the long walks as they were dead reckoned.

    See Gu et al., Figure 5.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    scene = _walks_of(study)
    if scene is None:
        return None
    own_m = scene.observed["walks.position_m"]
    figure = figures.new_figure(4.4)
    axes = figure.subplots()
    _walks(axes, own_m)
    axes.plot(0, 0, "o", color=TRUE_COLOR, markersize=6, markerfacecolor="white", label="start", zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, own frame of each walk (m)")
    axes.set_ylabel("y, own frame of each walk (m)")
    legend_above(figure, axes, columns=6)
    minutes, length_m = _durations_and_length(scene)
    most = _largest_raw(scene)
    drift = f" Largest error within a walk, tied by its own first pose: {most}." if most else ""
    return Drawn(
        name="fig5",
        figure=figure,
        title="Raw walks",
        caption=f"Dead reckoning of {scene.counted()}, {scene.where()}: {minutes} minutes, {length_m:.0f} m"
        f" in all. Each walk begins at (0, 0) with a heading that nobody knows.{drift} Ways and the error"
        " model of dead reckoning are assumed.",
        alt=f"{len(own_m)} raw walks laid upon each other at their starts, {minutes} minutes long,"
        f" {length_m:.0f} m in all.{drift}",
    )


def walks_on_plan(study: Study) -> Drawn | None:
    """Draw the long walks in one frame over the floor plan, aligned first beside the printed start.

    See Gu et al., Figure 6.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    scene = _walks_of(study)
    if scene is None:
        return None
    return plans(
        scene,
        [ALIGNED, PRINTED_START],
        "fig6",
        "Walks in one frame over the floor plan",
        "Plan, ways, landmarks, radio and the weight of WiFi edges are assumed.",
        enlarged=True,
    )


def raw_and_aligned(study: Study) -> Drawn | None:
    """Draw walks from inertial readings, raw and in one frame.

    See Gu et al., Figures 5 and 6.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    scene = _walks_of(study)
    if scene is None:
        return None
    return plans(
        scene,
        [RAW, ALIGNED],
        "walks",
        "Walks from simulated inertial readings of the foot",
        "Sensors, gait, plan and ways are assumed; the readings go through the project's own zero-velocity"
        " filter.",
    )


WORLD_FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (straight_lines, raw_walks, walks_on_plan)
"""What draws each figure of the first world, in their order; None where what it shows is absent."""


def plans(
    scene: Scene, rows: Sequence[str], name: str, title: str, note: str, *, enlarged: bool = False
) -> Drawn | None:
    """Draw walks of some rows over the plan, side by side.

    Parameters
    ----------
    scene
        The world.
    rows
        Rows of the table; one without estimates is left out.
    name, title
        Of the figure.
    note
        What the caption says is assumed.
    enlarged
        Whether the building is drawn once more, enlarged.
    """
    places = {row: place_m for row in rows if (place_m := scene.tied_m(row)) is not None}
    if not places:
        return None
    reach = _reach([*places.values(), scene.truth["truth.path_m"]])
    parts = [reach] + (
        [_reach([scene.observed["site.wall_m"]])] if enlarged and "site.wall_m" in scene.observed else []
    )
    ratios = [float(np.ptp(limits[1]) / np.ptp(limits[0])) for limits in parts]
    width_in = 6.6 / max(2, len(places))
    figure = figures.new_figure(0.75 + sum(width_in * ratio + 0.35 for ratio in ratios))
    panels: Any = figure.subplots(len(parts), len(places), squeeze=False, height_ratios=ratios)
    told = []
    for column, (row, place_m) in enumerate(places.items()):
        for axes, limits in zip(panels[:, column], parts, strict=True):
            _plan(axes, scene)
            _walks(axes, place_m)
            _landmarks(axes, scene, place_m)
            axes.set_aspect("equal")
            axes.grid(visible=False)
            axes.set(xlim=limits[0], ylim=limits[1])
            axes.set_xlabel("x (m)")
        error_m = scene.error_m(place_m)
        words = WORDS.get(row, row)
        told.append(f"{words} {error_m.mean():.2f} m, largest {error_m.max():.2f} m")
        panels[0, column].set_title(f"{words}: mean {error_m.mean():.2f} m")
    if len(parts) > 1:
        for axes in panels[1]:
            axes.set_title("the building, enlarged")
    for line in panels:
        line[0].set_ylabel("y (m)")
    legend_above(figure, panels[0, 0], columns=6)
    errors = f"Errors at the landmarks: {'; '.join(told)}"
    return Drawn(
        name=name,
        figure=figure,
        title=title,
        caption=f"{scene.counted()}, {scene.where()}. {TIED} Star: landmark, joined to where visits were"
        f" found. {errors}. {note}",
        alt=f"Plans with {len(scene.visited)} walks. {errors}.",
    )


def legend_above(figure: Figure, axes: Axes, columns: int = 4) -> None:
    """Explain what a panel shows above all panels.

    Parameters
    ----------
    figure
        The figure.
    axes
        The panel with the labels.
    columns
        Entries in a line.
    """
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def name_printed(axes: Axes, label: str, marker: str = "D") -> None:
    """Give a printed marker a place in the legend.

    Parameters
    ----------
    axes
        The panel whose legend it is.
    label
        The words.
    marker
        Its shape.
    """
    # An empty line that is not clipped counts as one at the figure's corner, to which the layout makes room.
    axes.plot([], [], **{**PRINTED, "marker": marker, "clip_on": True}, label=label)


def long_walks(study: Study) -> str | None:
    """Return the family of long walks; None where lines alone were measured.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    return next((family for family in study.families if family != LINES), None)


def _walks_of(study: Study) -> Scene | None:
    """Return the first world of the family of long walks."""
    family = long_walks(study)
    return None if family is None else Scene.of(study, family)


def _of_worlds(worlds: int) -> str:
    return f"{worlds} worlds" if worlds > 1 else "one world"


def _lines(axes: Axes, place_m: Array, true_m: Array) -> None:
    for number, walk_m in enumerate(place_m):
        color = WALK_COLORS[number % len(WALK_COLORS)]
        axes.plot(*walk_m.T, color=color, linewidth=0.9, alpha=0.85)
    ends_m = true_m[np.isfinite(true_m).all(axis=-1)][[0, -1]]
    axes.plot(*ends_m.T, color=TRUE_COLOR, linewidth=1.4, linestyle="--", zorder=4)


def _walks(axes: Axes, place_m: Array) -> None:
    for number, walk_m in enumerate(place_m):
        color = WALK_COLORS[number % len(WALK_COLORS)]
        axes.plot(*walk_m.T, color=color, linewidth=0.7, alpha=0.8, label=f"walk {number + 1}", zorder=2)


def _plan(axes: Axes, scene: Scene) -> None:
    for wall_m in scene.observed.get("site.wall_m", ()):
        axes.plot(*wall_m.T, color=WALL_COLOR, linewidth=0.8, zorder=1)


def _landmarks(axes: Axes, scene: Scene, place_m: Array) -> None:
    """Mark the landmarks, and join them to where their visits were found."""
    true_m, found_m = scene.truth["truth.position_m"][scene.visited], place_m[scene.visited]
    for ends_m in np.stack([true_m, found_m], axis=1):
        axes.plot(*ends_m.T, color=LANDMARK_COLOR, linewidth=0.7, alpha=0.6, zorder=4)
    places_m = np.unique(np.round(true_m, 3), axis=0)
    axes.plot(
        *places_m.T,
        "*",
        color="#ffd400",
        markeredgecolor=LANDMARK_COLOR,
        markeredgewidth=0.7,
        markersize=10,
        label="landmark",
        zorder=5,
    )


def _reach(places: Sequence[Array]) -> Array:
    """Return limits of both axes that hold all places with some room, [2, 2]."""
    every = np.concatenate([place_m.reshape(-1, 2) for place_m in places])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    room = 0.04 * float((high - low).max()) or 1.0
    return np.stack([low - room, high + room], axis=-1)


def _durations_and_length(scene: Scene) -> tuple[str, float]:
    """Return in words how long walks take, and their length together, metres."""
    minutes = np.nanmax(scene.observed["walks.time_s"], axis=1) / 60
    step_m = np.linalg.norm(np.diff(scene.truth["truth.path_m"], axis=1), axis=-1)
    return f"{minutes.min():.0f} to {minutes.max():.0f}", float(np.nansum(step_m))


def _largest_raw(scene: Scene) -> str:
    """Return in words the largest error within raw walks, this world and over all; empty where unknown."""
    values = scene.study.get(scene.family, RAW, "own_first_max_m")
    if not len(values):
        return ""
    told = f"{values[0]:.1f} m"
    if len(values) > 1:
        low, high, _ = figures.interval_of(values)
        told += f"; over {len(values)} worlds {values.mean():.1f} m ({low:.1f} to {high:.1f} m)"
    printed = figures.printed_or_none(scene.study.results, "raw.max")
    return told + (f"; printed: about {printed} m" if printed else "")
