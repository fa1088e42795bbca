"""Figures of one drive of the RISS/WiFi study, numbered as in the paper.

See Atia et al., Figures 3 to 5, 7 to 9, 11 and 13 to 22.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from positioning.inertial.riss_readings import REST_SPEED_M_PER_S, downsample, first_rest
from positioning.model import Recording
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import decimals

RISS, FULL, FOS, INTEGRATED = "riss", "wifi_full", "wifi_fos", "adaptive_fast_mixture"

SYSTEMS = {
    RISS: "RISS",
    FULL: "WiFi (full map)",
    FOS: "WiFi (4 access points)",
    INTEGRATED: "integrated",
}
"""The four systems of Table 2 and the words for them."""

AXES = {"east": 0, "north": 1}

SELECTED = 4
"""Access points that the paper keeps."""

CUT_S = (-1.0, 5.0)
"""The cut of Figures 13 and 14, about the end of the first rest: chosen before any was drawn."""

BIN_S = 0.5
"""Where more readings lie side by side than a figure can show, their span in each of these is drawn."""

NORMAL_95 = 1.96

REFERENCE_COLOR = "#111111"
WALL_COLOR = "#9aa4ac"

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Drive:
    """The first world of a family, and what the rows made of it.

    Attributes
    ----------
    study
        All results.
    family
        Its family.
    observed, truth
        Arrays of the world, without the axis of worlds; epochs after the end are cut off.
    tracks
        Estimates by row, [n, ...].
    """

    study: Study
    family: str
    observed: Mapping[str, Array]
    truth: Mapping[str, Array]
    tracks: Mapping[str, Mapping[str, Array]]

    @classmethod
    def of(cls, study: Study) -> "Drive | None":
        """Take the first world of the first family; None where the worlds are not at hand."""
        family = study.families[0]
        observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
        if "recording.time_s" not in observed or "truth.path_m" not in truth:
            return None
        kept = ~np.isnan(observed["recording.time_s"])
        epochs = ("recording.time_s", "recording.rss_dbm", "truth.position_m", "truth.path_m")
        observed = {name: v[kept] if name in epochs else v for name, v in observed.items()}
        truth = {name: v[kept] if name in epochs else v for name, v in truth.items()}
        tracks = {}
        for row in study.results.rows:
            found = study.results.estimate(row, family)
            if len(found.get("position_m", ())):
                tracks[row] = {name: np.asarray(v[0], dtype=float)[kept] for name, v in found.items()}
        return cls(study, family, observed, truth, tracks)

    @property
    def time_s(self) -> Array:
        """Times of the epochs, [n]."""
        return self.observed["recording.time_s"]

    @property
    def asked(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Epochs at which a way-point is passed, [n]."""
        return ~np.isnan(self.truth["truth.position_m"][:, 0])

    @property
    def waypoint_m(self) -> Array:
        """The way-points, [k, 2]."""
        waypoint_m: Array = self.truth["truth.position_m"][self.asked]
        return waypoint_m

    def rmse_m(self, row: str) -> float:
        """Return the root mean square error of a row at the way-points."""
        error_m = self.tracks[row]["position_m"][self.asked] - self.waypoint_m
        return float(np.sqrt(np.mean(np.sum(np.square(error_m), axis=1))))

    def where(self) -> str:
        """Return in words which world this is."""
        numbers = self.study.results.observed[self.family]["world"]
        worlds = max((len(values) for values in self.study.values.values()), default=len(numbers))
        return f"world {int(numbers[0]) + 1} of {worlds}, family {self.family}"

    def counted(self) -> str:
        """Return in words how many way-points and epochs it has."""
        return f"n = {int(self.asked.sum())} way-points, {len(self.time_s)} epochs"


def draw_drive(study: Study) -> list[Drawn]:
    """Return the figures of the first world of the first family, in the order of the paper.

    A figure whose row or array is absent is left out.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    drive = Drive.of(study)
    if drive is None:
        return []
    drawn = [make(drive) for make in FIGURES]
    return [item for item in drawn if item is not None]


def _reference(drive: Drive) -> Drawn:
    figure, (axes,) = _plans(drive, 1)
    map_m = drive.observed.get("survey.position_m", np.empty((0, 2)))
    axes.plot(*map_m.T, "s", color="#5b8fb8", markersize=3.2, label="places of the radio map", zorder=3)
    _way(axes, drive, joined=False)
    axes.plot(*drive.truth["truth.path_m"].T, color=REFERENCE_COLOR, linewidth=1.0, label="way", zorder=2)
    start_m, end_m = drive.waypoint_m[0], drive.waypoint_m[-1]
    axes.plot(*start_m, "o", color="#009e73", markersize=9, zorder=5, label="start")
    axes.plot(*end_m, "X", color="#d55e00", markersize=9, zorder=5, label="end")
    _legend(figure, axes)
    length_m = float(np.linalg.norm(np.diff(drive.truth["truth.path_m"], axis=0), axis=1).sum())
    return Drawn(
        name="fig3",
        figure=figure,
        title="The way of the robot",
        caption=f"One drive, {drive.where()}: {drive.counted()}, {len(map_m)} places of the radio map. Grey:"
        " walls of the corridors. The paper's plan has no coordinates: way and walls are assumed, the length"
        " is printed.",
        alt=f"Plan of corridors with a way of about {length_m:.0f} m, {len(drive.waypoint_m)} way-points and"
        f" {len(map_m)} places of the radio map; start at {_place(start_m)}, end at {_place(end_m)}.",
    )


def _riss(drive: Drive) -> Drawn | None:
    return _plan(
        drive,
        "fig4",
        RISS,
        "RISS alone",
        "Start and first heading are given; the residual bias of the gyroscope is calibrated on the printed"
        " error of RISS, on other worlds.",
    )


def _static(drive: Drive) -> Drawn | None:
    if "static.rss_dbm" not in drive.observed:
        return None
    rss_dbm = drive.observed["static.rss_dbm"]
    rss_dbm = rss_dbm[~np.isnan(rss_dbm)]
    if not len(rss_dbm):
        return None
    levels, counts = np.unique(np.rint(rss_dbm), return_counts=True)
    figure = figures.new_figure(2.8)
    axes = figure.subplots()
    axes.bar(levels, counts, width=0.86, color=stroke(FULL).color)
    axes.grid(visible=False, axis="x")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("RSSI (dBm)")
    axes.set_ylabel("readings")
    mean, deviation = decimals(float(rss_dbm.mean()), least=1), decimals(float(rss_dbm.std()), least=1)
    return Drawn(
        name="fig5",
        figure=figure,
        title="RSSI at one place",
        caption=f"Readings of the strongest access point at the start, one bar a dBm: n = {len(rss_dbm)}"
        f" readings at one place, {drive.where()}; mean {mean} dBm, standard deviation {deviation} dB. The"
        " size of the fading is calibrated on the printed error of the full map, on other worlds.",
        alt=f"Histogram of {len(rss_dbm)} levels from {decimals(levels[0], least=0)} to"
        f" {decimals(levels[-1], least=0)} dBm, mean {mean} dBm, standard deviation {deviation} dB.",
    )


def _full_east(drive: Drive) -> Drawn | None:
    return _coordinate(drive, "fig7", [FULL], "east")


def _full_north(drive: Drive) -> Drawn | None:
    return _coordinate(drive, "fig8", [FULL], "north")


def _full_plan(drive: Drive) -> Drawn | None:
    return _plan(drive, "fig9", FULL, "WiFi on the full map")


def _weights(drive: Drive) -> Drawn | None:
    names = {"extra_weight_prediction": "A, prediction", "extra_weight_wifi": "B, WiFi"}
    track = drive.tracks.get(INTEGRATED, {})
    if not names.keys() <= track.keys():
        return None
    figure = figures.new_figure(2.9)
    axes = figure.subplots()
    rests_s = _rests(drive)
    for number, (begin_s, end_s) in enumerate(rests_s):
        label = "robot at rest" if number == 0 else None
        axes.axvspan(begin_s, end_s, color="#dde3e8", linewidth=0, label=label)
    looks = (("#0072b2", "-"), ("#d55e00", "--"))
    for (name, words), (color, line) in zip(names.items(), looks, strict=True):
        axes.plot(drive.time_s, track[name], color=color, linestyle=line, label=words)
    axes.set_ylim(0, 1.02)
    axes.set_xlim(drive.time_s[0], drive.time_s[-1])
    axes.set_xlabel("time (s)")
    axes.set_ylabel("weight")
    _legend(figure, axes)
    spans = ", ".join(
        f"{words.split(',')[0]} {np.nanmin(track[name]):.2g} to {np.nanmax(track[name]):.2g}"
        for name, words in names.items()
    )
    return Drawn(
        name="fig11",
        figure=figure,
        title="Weights of prediction and WiFi",
        caption=f"Factors A and B of {INTEGRATED} over one drive, n = {len(drive.time_s)} epochs,"
        f" {drive.where()}: {spans}. Their values and times are assumed, the paper prints none; A is above B"
        f" at the start and after each stop. Grey: {len(rests_s)} rests.",
        alt=f"Two lines over {drive.time_s[-1]:.0f} s that cross after rests ({len(rests_s)}): {spans}.",
    )


def _raw(drive: Drive) -> Drawn | None:
    return _motion(drive, "fig13", 1)


def _averaged(drive: Drive) -> Drawn | None:
    return _motion(drive, "fig14", 2)


def _motion(drive: Drive, name: str, factor: int) -> Drawn | None:
    """Draw gyroscope and speed: the whole drive as spans, a cut as readings."""
    recording = _recording(drive)
    if recording is None:
        return None
    raw, rest_end_s = _readings(recording), float(first_rest(recording).end_s[0])
    time_s, *values = _readings(downsample(recording, factor=factor))
    begin_s = rest_end_s if np.isfinite(rest_end_s) else float(time_s[0])
    cut = (time_s >= begin_s + CUT_S[0]) & (time_s <= begin_s + CUT_S[1])
    figure = figures.new_figure(4.3)
    panels = figure.subplots(2, 2, sharex="col", width_ratios=[1.3, 1])
    color = "#14507d"
    labels = ("turn rate (degrees/s)", "speed (m/s)")
    for (whole, part), series, limits, label in zip(panels, values, raw[1:], labels, strict=True):
        centre_s, low, high = _spans(time_s, series)
        whole.fill_between(centre_s, low, high, color=color, linewidth=0.4, edgecolor=color)
        whole.axvspan(begin_s + CUT_S[0], begin_s + CUT_S[1], color="#f0c48a", alpha=0.55, linewidth=0)
        part.plot(time_s[cut], series[cut], color=color, linewidth=0.8)
        raw_cut = (raw[0] >= begin_s + CUT_S[0]) & (raw[0] <= begin_s + CUT_S[1])
        for axes, inside in ((whole, limits), (part, limits[raw_cut])):
            low_end, high_end = float(np.nanmin(inside)), float(np.nanmax(inside))
            pad = 0.05 * (high_end - low_end) or 0.1
            axes.set_ylim(low_end - pad, high_end + pad)
        whole.set_ylabel(label)
    for axes, words in zip(panels[0], ("whole drive", "the marked cut"), strict=True):
        axes.set_title(words)
    for axes in panels[1]:
        axes.set_xlabel("time (s)")
    rate_hz = 1 / float(np.median(np.diff(time_s)))
    at_rest = time_s < rest_end_s
    deviations = ""
    if at_rest.sum() > 1:
        noise = float(np.nanstd(values[0][at_rest]))
        deviations = f" At the first rest the turn rate has a standard deviation of {noise:.3f} degrees/s."
    return Drawn(
        name=name,
        figure=figure,
        title=f"Gyroscope and odometer at {rate_hz:.0f} Hz",
        caption=("Readings as recorded" if factor == 1 else f"Means of {factor} neighbouring readings")
        + f", n = {len(time_s)}, {drive.where()}. Left: smallest to largest in each {BIN_S:g} s; right:"
        f" {CUT_S[1] - CUT_S[0]:g} s about the end of the first rest. The axes are those of the raw"
        f" readings.{deviations} Corners, whose radius is assumed, stand out.",
        alt=f"Turn rate and speed over {time_s[-1]:.0f} s at {rate_hz:.0f} Hz: turn rate"
        f" {decimals(float(np.nanmin(values[0])), least=0)} to {np.nanmax(values[0]):.0f} degrees/s, speed up"
        f" to {np.nanmax(values[1]):.1f} m/s.{deviations}",
    )


def _selected(drive: Drive) -> Drawn | None:
    if "survey.rss_dbm" not in drive.observed:
        return None
    rss_dbm, position_m = drive.observed["survey.rss_dbm"], drive.observed["survey.position_m"]
    columns = min(SELECTED, rss_dbm.shape[1])
    found = FastOrthogonalSearch(columns=columns).fit(rss_dbm)
    chosen = [int(number) for number in found.selected_]
    levels = rss_dbm[:, chosen]
    if np.isnan(levels).all():
        return None
    low, high = float(np.nanmin(levels)), float(np.nanmax(levels))
    figure, panels = _plans(drive, columns)
    told = []
    for rank, (axes, number) in enumerate(zip(panels, chosen, strict=True), start=1):
        level = rss_dbm[:, number]
        heard = ~np.isnan(level)
        axes.plot(*position_m[~heard].T, "o", color=GREY, markerfacecolor="white", markersize=4.5, zorder=3)
        image = axes.scatter(
            position_m[heard, 0],
            position_m[heard, 1],
            c=level[heard],
            cmap="cividis",
            vmin=low,
            vmax=high,
            s=26,
            zorder=3,
        )
        axes.set_title(f"{rank}: column {number + 1}, heard at {heard.sum()}")
        told.append(f"column {number + 1} heard at {heard.sum()} places" + _span(level[heard]))
    figure.colorbar(image, ax=list(panels), label="level on the map (dBm)", shrink=0.8, pad=0.02)
    return Drawn(
        name="fig15",
        figure=figure,
        title="The access points that FOS selects",
        caption=f"Fast orthogonal search keeps {columns} of {rss_dbm.shape[1]} access points, in the order"
        f" of choice; columns are counted from 1. n = {len(position_m)} places of the radio map,"
        f" {drive.where()}. Colour: mean level of the scans that heard the access point; hollow: not heard,"
        " which the search takes for"
        f" {decimals(float(found.not_heard_dbm), least=0)} dBm (assumed).",
        alt=f"{columns} plans with the level of one access point each at {len(position_m)} places: "
        + "; ".join(told)
        + ".",
    )


def _fos_east(drive: Drive) -> Drawn | None:
    return _coordinate(drive, "fig16", [FOS], "east")


def _fos_north(drive: Drive) -> Drawn | None:
    return _coordinate(drive, "fig17", [FOS], "north")


def _fos_plan(drive: Drive) -> Drawn | None:
    return _plan(drive, "fig18", FOS, f"WiFi on {SELECTED} selected access points")


def _integrated_north(drive: Drive) -> Drawn | None:
    return _beside(drive, "fig19", "north")


def _integrated_east(drive: Drive) -> Drawn | None:
    return _beside(drive, "fig20", "east")


def _beside(drive: Drive, name: str, axis: str) -> Drawn | None:
    rows = [RISS, FOS, INTEGRATED] if INTEGRATED in drive.tracks else []
    return _coordinate(drive, name, rows, axis)


def _confidence(drive: Drive) -> Drawn | None:
    track = drive.tracks.get(INTEGRATED, {})
    if "covariance_m2" not in track:
        return None
    error_m = track["position_m"] - drive.truth["truth.path_m"]
    sigma_m = np.sqrt(np.diagonal(track["covariance_m2"], axis1=-2, axis2=-1))
    color = stroke(INTEGRATED).color
    figure = figures.new_figure(4.4)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    told = []
    for axes, (words, axis) in zip(panels, AXES.items(), strict=True):
        half_m = NORMAL_95 * sigma_m[:, axis]
        axes.fill_between(
            drive.time_s, -half_m, half_m, color=color, alpha=0.25, linewidth=0, label="stated 95 %"
        )
        axes.plot(drive.time_s, error_m[:, axis], color=REFERENCE_COLOR, linewidth=1.0, label="true error")
        asked = drive.asked
        axes.plot(
            drive.time_s[asked],
            error_m[asked, axis],
            "D",
            color=REFERENCE_COLOR,
            markersize=4,
            label="at a way-point",
        )
        axes.set_ylabel(f"{words} error (m)")
        inside = 100 * float(np.mean(np.abs(error_m[:, axis]) <= half_m))
        told.append(
            f"{words}: {inside:.0f} % of the epochs inside, half width {np.median(half_m):.2f} m (median)"
        )
    panels[0].set_xlim(drive.time_s[0], drive.time_s[-1])
    panels[1].set_xlabel("time (s)")
    _legend(figure, panels[0])
    return Drawn(
        name="fig21",
        figure=figure,
        title="Confidence of the integrated position",
        caption=f"Error of {INTEGRATED} and {NORMAL_95} times the standard deviation that it states,"
        f" {drive.counted()}, {drive.where()}. {'; '.join(told)}. The paper knows no true error between"
        " way-points; a normal distribution is assumed.",
        alt=f"Error and 95 % band of both coordinates over {drive.time_s[-1]:.0f} s. {'; '.join(told)}.",
    )


def _all_systems(drive: Drive) -> Drawn | None:
    rows = [row for row in SYSTEMS if row in drive.tracks]
    if not rows:
        return None
    figure, panels = _plans(drive, len(rows))
    reach_m = np.concatenate([drive.tracks[row]["position_m"][drive.asked] for row in rows])
    told = []
    for axes, row in zip(panels, rows, strict=True):
        look, place_m = stroke(row), drive.tracks[row]["position_m"][drive.asked]
        _way(axes, drive)
        for true_m, found_m in zip(drive.waypoint_m, place_m, strict=True):
            axes.plot(*np.stack([true_m, found_m]).T, color=look.color, linewidth=0.9, zorder=3)
        axes.plot(*place_m.T, look.marker, color=look.color, linestyle="none", zorder=4, label=row)
        _widen(axes, reach_m)
        told.append(f"{SYSTEMS[row]} {drive.rmse_m(row):.2f} m")
        axes.set_title(f"{SYSTEMS[row]}: RMSE {drive.rmse_m(row):.2f} m")
    return Drawn(
        name="fig22",
        figure=figure,
        title="All systems at the way-points",
        caption=f"Estimates at the way-points, each joined to the true one (diamond): {drive.counted()},"
        f" {drive.where()}. Walls and way are assumed. The paper has all systems in one plan.",
        alt="Plans of the estimates at "
        f"{len(drive.waypoint_m)} way-points. Root mean square errors: " + ", ".join(told) + ".",
    )


FIGURES: tuple[Callable[[Drive], Drawn | None], ...] = (
    *(_reference, _riss, _static),
    *(_full_east, _full_north, _full_plan),
    *(_weights, _raw, _averaged, _selected),
    *(_fos_east, _fos_north, _fos_plan),
    *(_integrated_north, _integrated_east, _confidence, _all_systems),
)
"""What draws each figure, in their order; None where what it shows is absent."""


def _coordinate(drive: Drive, name: str, rows: Sequence[str], axis: str) -> Drawn | None:
    """Draw one coordinate of some rows over time, the way-points joined as in the paper."""
    rows = [row for row in rows if row in drive.tracks]
    if not rows:
        return None
    figure = figures.new_figure(3.2)
    axes, asked = figure.subplots(), drive.asked
    for row in rows:
        look = stroke(row)
        axes.plot(
            drive.time_s,
            drive.tracks[row]["position_m"][:, AXES[axis]],
            color=look.color,
            linewidth=1.7 if row == INTEGRATED else 0.8,
            marker="." if row in (FOS, FULL) else None,
            markersize=3,
            label=SYSTEMS[row],
            zorder=3 if row == INTEGRATED else 2,
        )
    axes.plot(
        drive.time_s[asked],
        drive.waypoint_m[:, AXES[axis]],
        "D-",
        color=REFERENCE_COLOR,
        markersize=4,
        linewidth=1.0,
        label="way-points",
        zorder=4,
    )
    axes.set_xlim(drive.time_s[0], drive.time_s[-1])
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"{axis} (m)")
    _legend(figure, axes)
    told = []
    for row in rows:
        error_m = (drive.tracks[row]["position_m"][asked] - drive.waypoint_m)[:, AXES[axis]]
        rms_m, most_m = float(np.sqrt(np.mean(np.square(error_m)))), float(np.abs(error_m).max())
        told.append(f"{SYSTEMS[row]} {rms_m:.2f} m, at most {most_m:.2f} m")
    errors = f"Root mean square of the {axis} error at the way-points: {'; '.join(told)}."
    return Drawn(
        name=name,
        figure=figure,
        title=f"{axis.capitalize()}: {', '.join(SYSTEMS[row] for row in rows)}",
        caption=f"{axis.capitalize()} over one drive, {drive.counted()}, {drive.where()}. {errors} The line"
        f" through the way-points only joins them; way, stops and scan period are assumed.",
        alt=f"{axis.capitalize()} over {drive.time_s[-1]:.0f} s beside {len(drive.waypoint_m)} way-points. "
        + errors,
    )


def _plan(drive: Drive, name: str, row: str, title: str, note: str = "") -> Drawn | None:
    """Draw the track of a row at all epochs over the way-points."""
    if row not in drive.tracks:
        return None
    figure, (axes,) = _plans(drive, 1)
    look, place_m = stroke(row), drive.tracks[row]["position_m"]
    # Fixes jump from scan to scan: joined, they hide each other.
    scans = row in (FULL, FOS)
    axes.plot(*place_m.T, "." if scans else "-", color=look.color, linewidth=1.6, markersize=4, label=title)
    _way(axes, drive)
    _widen(axes, place_m)
    _legend(figure, axes)
    told = f"Root mean square error at the way-points: {drive.rmse_m(row):.2f} m."
    return Drawn(
        name=name,
        figure=figure,
        title=f"Track of {title}",
        caption=f"Track of row {row}, {drive.counted()}, {drive.where()}. {told}"
        + (" A point is the fix of a scan; they are not joined." if scans else "")
        + " Walls and way are assumed."
        + (f" {note}" if note else ""),
        alt=f"Plan with the track of {title} beside {len(drive.waypoint_m)} way-points. {told} The track lies"
        f" between {_place(place_m.min(axis=0))} and {_place(place_m.max(axis=0))}.",
    )


def _plans(drive: Drive, count: int) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with plans of the floor, two side by side where there are several."""
    corner_m = drive.observed["site.corner_m"]
    size_m = corner_m[1] - corner_m[0]
    columns = min(2, count)
    lines = -(-count // columns)
    width_in = 4.8 if count == 1 else 3.0
    figure = figures.new_figure(lines * (width_in * float(size_m[1] / size_m[0]) + 0.3) + 0.4)
    panels: Any = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes in panels[:count]:
        for wall_m in drive.observed.get("site.wall_m", ()):
            axes.plot(*wall_m.T, color=WALL_COLOR, linewidth=1.0, zorder=1)
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set_xlim(corner_m[0, 0], corner_m[1, 0])
        axes.set_ylim(corner_m[0, 1], corner_m[1, 1])
    for axes in panels[count:]:
        axes.set_visible(False)
    if count == 1:
        panels[0].set_xlabel("east (m)")
        panels[0].set_ylabel("north (m)")
    else:
        figure.supxlabel("east (m)", fontsize=9)
        figure.supylabel("north (m)", fontsize=9)
    return figure, panels[:count]


def _way(axes: Axes, drive: Drive, joined: bool = True) -> None:
    axes.plot(
        *drive.waypoint_m.T,
        "D-" if joined else "D",
        color=REFERENCE_COLOR,
        markerfacecolor="white",
        markersize=4.5,
        linewidth=0.8,
        label="way-points",
        zorder=4 if not joined else 2.5,
    )


def _widen(axes: Axes, place_m: Array) -> None:
    """Take in tracks that leave the floor."""
    for limits, setter, values in (
        (axes.get_xlim(), axes.set_xlim, place_m[:, 0]),
        (axes.get_ylim(), axes.set_ylim, place_m[:, 1]),
    ):
        low, high = float(values.min()) - 0.5, float(values.max()) + 0.5
        setter(min(limits[0], low), max(limits[1], high))


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=5)


def _recording(drive: Drive) -> Recording | None:
    """Return the readings of the motion as a stack of one; None where there are none."""
    names = ("time_s", "motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    if not {f"recording.{name}" for name in names} <= drive.observed.keys():
        return None
    readings: dict[str, Any] = {name: drive.observed[f"recording.{name}"][None] for name in names}
    return Recording(**readings)


def _readings(recording: Recording) -> tuple[Array, Array, Array]:
    """Return times, turn rates in degrees a second and speeds of a stack of one, without its end."""
    time_s, gyro, odometer = (
        np.asarray(v, dtype=float)[0]
        for v in (recording.motion_time_s, recording.gyro_rad_per_s, recording.odometer_m_per_s)
    )
    kept = ~np.isnan(time_s)
    return time_s[kept], np.degrees(gyro[kept]), odometer[kept]


def _spans(time_s: Array, values: Array) -> tuple[Array, Array, Array]:
    """Return the middles of bins, and the smallest and largest value in each."""
    number = np.floor((time_s - time_s[0]) / BIN_S).astype(int)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    middle_s = time_s[0] + (number[first] + 0.5) * BIN_S
    return middle_s, np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)


def _rests(drive: Drive) -> list[tuple[float, float]]:
    """Return when the odometer reads nothing for a second or more: begin and end, seconds."""
    recording = _recording(drive)
    if recording is None:
        return []
    time_s, _, speed = _readings(recording)
    moving_s = time_s[np.abs(speed) > REST_SPEED_M_PER_S]
    edge_s = np.concatenate([time_s[:1], moving_s, [min(time_s[-1], drive.time_s[-1])]])
    long = np.flatnonzero(np.diff(edge_s) >= 1.0)
    return [(float(edge_s[index]), float(edge_s[index + 1])) for index in long]


def _span(values: Array) -> str:
    if not len(values):
        return ""
    return f" from {decimals(values.min(), least=0)} to {decimals(values.max(), least=0)} dBm"


def _place(place_m: Array) -> str:
    return "(" + ", ".join(decimals(float(value), least=1) for value in place_m) + ") m"
