"""Figures of a rover with GPS and inertial navigation, whose GPS is cut out.

See Mirzababaei & Akbari, sections 2 and 3; the paper has no recording of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from positioning.evaluation.results import StudyResults
from positioning.evaluation.studies.sar_flight import LIMIT_M
from positioning.inertial.geodetic import to_local
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.sar_flight_world import OUTAGE_COLOR, TRUE_COLOR, logarithmic
from positioning.presentation.style import markers_apart, stroke
from positioning.presentation.tables import metres
from positioning.presentation.tones import is_control

TRACKS = ("gps_inertial", "gps_inertial_15")
"""Rows whose tracks are drawn; inertial navigation alone leaves the site within a minute."""

PLAIN, RAISED = "gps_inertial", "gps_inertial_raised"
"""Rows that are compared with GPS itself: the data sheet's Q, and a raised one."""

LEAST_M = 0.05
"""Below this a logarithmic axis ends."""

FAR_BELOW = 0.5
"""Where the normalised innovation squared is below, the page says that deviations are too large; assumed."""

REFERENCE = (
    "The reference is the publishers' own fusion of the same sensors, not a survey, and GPS lies about 1 m"
    " off it; where it has not settled at the start no error is taken."
)
ASSUMED = "Settings of the filters are those of the synthetic flight, assumed and not fitted to this drive."
NO_RESULT = "The paper prints no result of a drive or a flight."

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Drive:
    """One recording, and what rows made of it.

    Attributes
    ----------
    family
        Its name.
    observed, truth
        Arrays without the axis of worlds.
    outage_s
        Begin and end of the outage; None where GPS is never cut.
    position_m
        By row, [n, 2].
    """

    family: str
    observed: Mapping[str, Array]
    truth: Mapping[str, Array]
    outage_s: tuple[float, float] | None
    position_m: Mapping[str, Array]

    @property
    def time_s(self) -> Array:
        """Times of the epochs, [n]."""
        return self.observed["recording.time_s"]

    @property
    def away(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Epochs in the outage, [n]."""
        begin_s, end_s = self.outage_s or (np.inf, np.inf)
        return (self.time_s > begin_s) & (self.time_s <= end_s)

    def error_m(self, row: str) -> Array:
        """Return the horizontal error, [n]; NaN where no error is asked for."""
        found: Array = np.linalg.norm(self.position_m[row] - self.truth["truth.position_m"], axis=-1)
        return found

    def words(self) -> str:
        """Return in words what is cut."""
        if self.outage_s is None:
            return f"{self.family}: GPS throughout"
        begin_s, end_s = self.outage_s
        return f"{self.family}: no GPS {begin_s:g} to {end_s:g} s"


def draw(results: StudyResults) -> list[Drawn]:
    """Return tracks, errors over time, and errors in the outage.

    What a configuration leaves out is left out here.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    drives = [drive for family in study.families if (drive := _drive(study, family)) is not None]
    drawn = [_track(drives), _errors(drives, _innovations(study)), _outage(drives)]
    return [item for item in drawn if item is not None]


def _drive(study: Study, family: str) -> Drive | None:
    observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
    if "recording.time_s" not in observed or not {"truth.position_m", "truth.path_m"} <= truth.keys():
        return None
    found = {row: study.results.estimate(row, family) for row in study.results.rows}
    position_m = {
        row: np.asarray(own["position_m"][0], dtype=float)
        for row, own in found.items()
        if len(own.get("position_m", ()))
    }
    ends_s = observed.get("recording.gps_outage_s", np.full(2, np.nan))
    outage_s = (float(ends_s[0]), float(ends_s[1])) if np.isfinite(ends_s).all() else None
    return Drive(family, observed, truth, outage_s, position_m) if position_m else None


def _track(drives: list[Drive]) -> Drawn | None:
    """Draw the plan of the first drive with an outage, or of the first one."""
    drive = next((drive for drive in drives if drive.outage_s is not None), drives[0] if drives else None)
    rows = [row for row in TRACKS if drive is not None and row in drive.position_m]
    if drive is None or not rows:
        return None
    figure = figures.new_figure(4.6)
    axes = figure.subplots()
    path_m = drive.truth["truth.path_m"]
    known = np.isfinite(path_m[:, 0])
    axes.plot(*path_m[known].T, color=TRUE_COLOR, linewidth=1.2, label="reference", zorder=3)
    axes.plot(*path_m[known][0], "o", color=TRUE_COLOR, markersize=7, label="start", zorder=5)
    if drive.away.any():
        axes.plot(
            *path_m[drive.away].T,
            color=OUTAGE_COLOR,
            linewidth=7,
            solid_capstyle="butt",
            zorder=1,
            label="outage of GPS",
        )
    gps_m = _gps_m(drive)
    axes.plot(*gps_m.T, ".", color="#8a949c", markersize=3, label="GPS antenna", zorder=2)
    told = []
    for row in rows:
        look = stroke(row)
        axes.plot(*drive.position_m[row].T, look.line, color=look.color, linewidth=1.3, label=row, zorder=4)
        inside = drive.error_m(row)[drive.away & np.isfinite(drive.error_m(row))]
        if len(inside):
            told.append(f"{row} up to {metres(float(inside.max()))} m off in the outage")
        else:
            told.append(f"{row} {metres(float(np.nanmean(drive.error_m(row))))} m off on the mean")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    words = "; ".join(told)
    return Drawn(
        name="track",
        figure=figure,
        title="The rover, and its outage of GPS",
        caption=f"One drive, {drive.words()}; n = {len(drive.time_s)} epochs in {drive.time_s[-1]:.0f} s,"
        f" which is one world, and {len(gps_m)} readings of GPS, in the outage drawn but not used. The"
        f" antenna is not where the inertial unit is. {words}. {REFERENCE} {ASSUMED} {NO_RESULT}",
        alt=f"Plan of a drive of {drive.time_s[-1]:.0f} s with the reference, GPS and {len(rows)} tracks."
        f" {words}.",
    )


def _gps_m(drive: Drive) -> Array:
    """Return the readings of GPS in the plane, [g, 2]."""
    if not {"recording.gps_geodetic", "site.origin_geodetic"} <= drive.observed.keys():
        return np.empty((0, 2))
    local_m = to_local(drive.observed["recording.gps_geodetic"], drive.observed["site.origin_geodetic"])
    plane_m: Array = local_m[np.isfinite(local_m[:, 0]), :2]
    return plane_m


def _innovations(study: Study) -> str:
    """Return in words what the innovations of GPS tell of the deviations that the filters assume of it."""
    means = {}
    for row in study.rows("nis_gps"):
        nis = np.concatenate([study.get(family, row, "nis_gps") for family in study.families])
        means[row] = float(nis.mean())
    if not means:
        return ""
    numbers = ", ".join(f"{row} {mean:.2g}" for row, mean in means.items())
    told = (
        f" Mean normalised innovation squared of GPS, 1 where the filter's deviations are right: {numbers}."
    )
    best = min(means, key=lambda row: means[row])
    if means[best] < FAR_BELOW:
        told += (
            f" In {best} it is small: the deviations assumed of GPS are too large for this receiver,"
            f" by a factor of about {means[best] ** -0.5:.2g} if the rest is right."
        )
    return told


def _against_gps(drives: list[Drive]) -> str:
    """Return in words, of a drive with GPS throughout, what a filter adds to the GPS that it uses."""
    drive = next((drive for drive in drives if drive.outage_s is None), None)
    if drive is None or "recording.gps_time_s" not in drive.observed or PLAIN not in drive.position_m:
        return ""
    local_m = to_local(drive.observed["recording.gps_geodetic"], drive.observed["site.origin_geodetic"])
    true_m = drive.truth["truth.position_m"]
    at_s = drive.observed["recording.gps_time_s"]
    # Between epochs with a true place; NaN beside those without, and behind the last.
    moved = [
        np.interp(at_s, drive.time_s, true_m[:, axis], left=np.nan, right=np.nan) - local_m[:, axis]
        for axis in range(2)
    ]
    off_m = np.hypot(*moved)
    if not np.isfinite(off_m).any():
        return ""
    gps_m = float(np.nanmean(off_m))
    rows = {row: float(np.nanmean(drive.error_m(row))) for row in (PLAIN, RAISED) if row in drive.position_m}
    told = ", ".join(f"{row} {metres(mean_m)} m" for row, mean_m in rows.items())
    others = ["the GPS that it uses"] if rows[PLAIN] > gps_m else []
    others += [f"{RAISED}, the same filter with Q raised"] if rows[PLAIN] > rows.get(RAISED, np.inf) else []
    worse = f": {PLAIN} is worse than {' and than '.join(others)}" if others else ""
    return f" With GPS throughout, readings of GPS are {metres(gps_m)} m off on the mean, {told}{worse}."


def _errors(drives: list[Drive], innovations: str) -> Drawn | None:
    """Draw the error over time, a panel a recording."""
    if not drives:
        return None
    rows = list(dict.fromkeys(row for drive in drives for row in drive.position_m if not is_control(row)))
    if not rows:
        return None
    columns = min(2, len(drives))
    lines = -(-len(drives) // columns)
    figure = figures.new_figure(0.4 + 2.3 * lines)
    panels = figure.subplots(lines, columns, squeeze=False, sharey=True, sharex=True).ravel()
    handles, told, most_m = {}, [], LIMIT_M
    for axes, drive in zip(panels, drives, strict=False):
        own = []
        for row in rows:
            if row in drive.position_m:
                error_m, look = drive.error_m(row), stroke(row)
                (handles[row],) = axes.plot(
                    drive.time_s, np.maximum(error_m, LEAST_M), look.line, color=look.color, linewidth=1.3
                )
                most_m = max(most_m, float(np.nanmax(error_m)))
                own.append(f"{row} {metres(float(np.nanmean(error_m)))} m")
        if drive.outage_s is not None:
            axes.axvspan(*drive.outage_s, color=OUTAGE_COLOR, alpha=0.3, linewidth=0, zorder=0)
        axes.set_title(drive.words(), fontsize=8.5)
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("time (s)")
        told.append(f"{drive.family}: {', '.join(own)}")
    for axes in panels[len(drives) :]:
        axes.set_visible(False)
    logarithmic(panels[0], LEAST_M, 1.4 * most_m)
    for axes in panels[::columns]:
        axes.set_ylabel("horizontal error (m)")
    figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=4)
    count = [int(np.isfinite(drive.error_m(next(iter(drive.position_m)))).sum()) for drive in drives]
    return Drawn(
        name="errors",
        figure=figure,
        title="Errors over the drive",
        caption=f"Horizontal error against the reference; n = {max(count)} epochs with an error in each of"
        f" {len(drives)} recording{'s' if len(drives) > 1 else ''}, each one world: the same drive with other"
        f" outages, so these are no repetitions. The outage is shaded. Mean errors, {'; '.join(told)}."
        f"{innovations}{_against_gps(drives)} {REFERENCE} {ASSUMED} {NO_RESULT}",
        alt=f"Errors over time in {len(drives)} panels. Mean errors, {'; '.join(told)}.",
    )


def _outage(drives: list[Drive]) -> Drawn | None:
    """Draw dots of mean, largest and last error in the outage."""
    drives = [drive for drive in drives if drive.away.any()]
    rows = list(dict.fromkeys(row for drive in drives for row in drive.position_m if not is_control(row)))
    if not rows:
        return None
    figure = figures.new_figure(1.0 + len(drives) * (0.2 + 0.16 * len(rows)))
    panels = figure.subplots(1, 3, sharey=True, sharex=True)
    markers = markers_apart(rows)
    handles, told = {}, []
    for number, (axes, words) in enumerate(zip(panels, ("mean", "largest", "at the end"), strict=True)):
        for place, drive in enumerate(drives):
            for rank, row in enumerate(row for row in rows if row in drive.position_m):
                error_m, color = drive.error_m(row)[drive.away], stroke(row).color
                error_m = error_m[np.isfinite(error_m)]
                if not len(error_m):
                    continue
                levels = (error_m.mean(), error_m.max(), error_m[-1])
                at = place + 0.7 * ((rank + 0.5) / len(rows) - 0.5)
                (handles[row],) = axes.plot(
                    max(float(levels[number]), LEAST_M),
                    at,
                    markers[row],
                    color=color,
                    markersize=5,
                    linestyle="none",
                )
                if number == 0:
                    told.append(f"{drive.family}, {row} {metres(levels[0])} m, {metres(levels[1])} m")
        axes.axvline(LIMIT_M, color=TRUE_COLOR, linestyle=(0, (5, 3)), linewidth=1)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_title(words)
        axes.set_xlabel("horizontal error (m)")
    for axes in panels:
        figures.label_rows(axes, [drive.words().replace(": ", "\n") for drive in drives])
        axes.tick_params(labelleft=axes is panels[0])
    limit = panels[0].get_lines()[-1]
    figure.legend(
        [*handles.values(), limit], [*handles.keys(), f"limit {LIMIT_M} m"], loc="outside upper left", ncols=4
    )
    counts = " or ".join(str(count) for count in sorted({int(drive.away.sum()) for drive in drives}))
    return Drawn(
        name="outage",
        figure=figure,
        title="Errors in the outage",
        caption=f"Mean, largest and last horizontal error in the outage, n = {len(drives)}"
        f" recording{'s' if len(drives) > 1 else ''} with {counts} epochs in it, each one world and cut out"
        f" of one drive; there is no interval. The dashed line is the {LIMIT_M} m that the abstract has for"
        f" landing; the rover drives at less than 1 m/s. {REFERENCE} {ASSUMED} {NO_RESULT}",
        alt=f"Mean and largest error in the outage. {'; '.join(told)}.",
    )
