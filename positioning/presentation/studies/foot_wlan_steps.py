"""Figures of the foot-mounted inertial sensors: drift, detectors of rest, strides, headings.

See Frank et al., section 3, and section 5.3 for inertial navigation alone; the paper draws none of them.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.foot_wlan_world import FUSED, TRUE_COLOR, Walk, legend_above
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, decimals

INERTIAL = "inertial"

HEADINGS = (FUSED, "joint", "particle", INERTIAL, "inertial_shoe", "inertial_no_magnetometer")
"""Rows whose headings are drawn, at most one a panel."""

COLUMNS = 3

GRID_S = 2.0
"""Distance of the times at which worlds are compared."""

OFF_SCALE = 10.0
"""A row that drifts so many times as far as `inertial` is told in words."""

STRIDES_SHOWN = (20, 24)
"""Stances of the cut, counted from the first: chosen by their numbers before any was drawn."""

MARGIN_S = 0.4

Array = NDArray[np.float64]


class OverTime(NamedTuple):
    """How a quantity of a row goes over time: times [t], median over worlds and band of single worlds."""

    time_s: Array
    median: Array
    low: Array
    high: Array
    worlds: int

    @property
    def end(self) -> float:
        """The median at the last time."""
        return float(self.median[-1])


def drift(study: Study) -> Drawn | None:
    """Draw the error of inertial navigation alone over time, a panel a row.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = study.families[0]
    rows = [row for row in study.results.rows if row.startswith(INERTIAL)]
    courses = {row: course for row in rows if (course := _error(study, family, row)) is not None}
    if not courses:
        return None
    first = courses.get(INERTIAL) or next(iter(courses.values()))
    shown = {row: c for row, c in courses.items() if c.end <= OFF_SCALE * max(first.end, 0.1)}
    shown = shown or courses
    told = _told(courses, "m")
    beyond = [f"{row} ({_number(c.end)} m)" for row, c in courses.items() if row not in shown]
    return _panels(
        shown,
        INERTIAL,
        "position error (m)",
        Drawn(
            name="inertial",
            figure=figures.new_figure(_height_in(shown)),
            title="Inertial navigation alone drifts",
            caption=f"Position error at all epochs from the noted start and heading, {_counted(shown)},"
            f" family {family}, until the shortest walk ends.{_band(first)}"
            + (f" Grey: the median of {INERTIAL}." if INERTIAL in shown and len(shown) > 1 else "")
            + f" Median at the end: {told}."
            + (f" Far off the scale and not drawn: {', '.join(beyond)}." if beyond else "")
            + " Gait, sensor errors and magnetic disturbance are assumed; the paper prints no number.",
            alt=f"Error of inertial navigation alone over {first.time_s[-1]:.0f} s. Median at the end:"
            f" {told}.",
        ),
    )


def headings(study: Study) -> Drawn | None:
    """Draw the error of the heading over time, a panel a row.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = study.families[0]
    courses = {row: course for row in HEADINGS if (course := _heading(study, family, row)) is not None}
    if not courses:
        return None
    means = {row: study.get(family, row, "heading_deg") for row in courses}
    told = ", ".join(f"{row} {values.mean():.1f} degrees" for row, values in means.items() if len(values))
    first = next(iter(courses.values()))
    return _panels(
        courses,
        FUSED,
        "heading error (degrees)",
        Drawn(
            name="heading",
            figure=figures.new_figure(_height_in(courses)),
            title="Error of the heading",
            caption=f"Error of the heading without sign at all epochs, {_counted(courses)}, family {family},"
            f" until the shortest walk ends.{_band(first)}"
            + (f" Grey: the median of {FUSED}." if FUSED in courses and len(courses) > 1 else "")
            + (f" Mean over time and worlds: {told}." if told else "")
            + " The true heading is that of the body; corners are walked by a foot that turns before or after"
            " it. The noted heading at the start is assumed to be off by some degrees.",
            alt=f"Heading errors over {first.time_s[-1]:.0f} s. Mean over time and worlds:"
            f" {told or _told(courses, 'degrees at the end')}.",
        ),
    )


def detectors(study: Study) -> Drawn | None:
    """Draw how many steps each detector of rest finds for a true stride.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = study.families[0]
    found: dict[str, Array] = {}
    same: dict[str, list[str]] = {}
    for row in study.rows("steps_per_stride", family):
        values = study.get(family, row, "steps_per_stride")
        # Rows with one detector find the same steps, whatever else they do with them.
        twin = next((other for other, own in found.items() if np.array_equal(own, values)), None)
        if twin is None:
            found[row] = values
        else:
            same.setdefault(twin, []).append(row)
    if not found:
        return None
    figure = figures.new_figure(1.2 + 0.42 * len(found))
    axes = figure.subplots()
    axes.axvline(1.0, color=TRUE_COLOR, linewidth=1.0, label="one step a stride")
    for place, (row, values) in enumerate(found.items()):
        look = stroke(row)
        axes.plot(values, _stacked(values, place), ".", color=look.color, markersize=3.5, alpha=0.6)
        axes.plot(values.mean(), place, look.marker, color=look.color, markersize=6)
    axes.plot([], [], ".", color=GREY, markersize=3.5, label="one world")
    axes.plot([], [], "o", color=GREY, markersize=6, label="mean over worlds")
    figures.label_rows(axes, list(found))
    axes.set_xlabel("steps found for each true stride (1)")
    legend_above(figure, axes)
    worlds = max(len(values) for values in found.values())
    told = "; ".join(
        f"{row} {values.mean():.3f}, {values.min():.3f} to {values.max():.3f}"
        for row, values in found.items()
    )
    twins = "; ".join(f"{', '.join(others)} as {row}" for row, others in same.items())
    walk = Walk.of(study)
    strides = 0 if walk is None else int(np.isfinite(_stances_s(walk)[:, 0]).sum()) - 1
    counted = (
        f"n = {strides} strides in the first of {worlds} worlds" if strides > 0 else f"n = {worlds} worlds"
    )
    return Drawn(
        name="detectors",
        figure=figure,
        title="Steps that the detectors of rest find",
        caption=f"Steps found for each true stride of the instrumented foot, {counted}, family {family}; mean"
        f" and span over worlds: {told}.{figures.few_worlds(study.results, [family], found, bars=False)}"
        + (f" The same steps, for they have the same detector: {twins}." if twins else "")
        + " The gait is assumed and more even than that of people; thresholds and windows are assumed.",
        alt=f"Steps for each true stride over {worlds} {'worlds' if worlds > 1 else 'world'}: {told}."
        + figures.few_worlds(study.results, [family], found, bars=False),
    )


def strides(study: Study) -> Drawn | None:
    """Draw a few strides: the specific force, the true stances, and where rows find steps.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    walk = Walk.of(study)
    names = ("recording.imu_time_s", "recording.specific_force_m_per_s2")
    if walk is None or not set(names) <= walk.observed.keys():
        return None
    stance_s = _stances_s(walk)
    stance_s = stance_s[np.isfinite(stance_s[:, 0])]
    if not len(stance_s):
        return None
    first, last = (min(number, len(stance_s) - 1) for number in STRIDES_SHOWN)
    begin_s, end_s = float(stance_s[first, 0]) - MARGIN_S, float(stance_s[last, 1]) + MARGIN_S
    time_s, force = (walk.observed[name] for name in names)
    cut = (time_s >= begin_s) & (time_s <= end_s)
    found: dict[str, Array] = {}
    for row in study.rows("steps_per_stride", walk.family):
        step_s = np.asarray(
            study.results.estimate(row, walk.family).get("extra_step_time_s", [[]])[0], dtype=float
        )
        if len(step_s) and not any(np.array_equal(step_s, own, equal_nan=True) for own in found.values()):
            found[row] = step_s
    figure = figures.new_figure(2.7 + 0.25 * len(found))
    lines = 2 if found else 1
    panels = figure.subplots(lines, 1, sharex=True, squeeze=False, height_ratios=[6, 1 + len(found)][:lines])[
        :, 0
    ]
    for axes in panels:
        for number, (low_s, high_s) in enumerate(stance_s[first : last + 1]):
            label = "true stance" if number == 0 else None
            axes.axvspan(low_s, high_s, color="#dde3e8", linewidth=0, label=label)
    magnitude = np.linalg.norm(force[cut], axis=1)
    panels[0].plot(time_s[cut], magnitude, color="#14507d", linewidth=1.0, label="specific force")
    panels[0].set_ylabel("magnitude (m/s²)")
    panels[0].set_xlim(begin_s, end_s)
    late = []
    for place, (row, all_s) in enumerate(found.items()):
        step_s = all_s[(all_s >= begin_s) & (all_s <= end_s)]
        panels[1].plot(
            step_s,
            np.full(len(step_s), place),
            "|",
            color=stroke(row).color,
            markersize=11,
            markeredgewidth=2,
        )
        late.append(f"{row} {len(step_s)}")
    if found:
        figures.label_rows(panels[1], list(found))
        panels[0].plot([], [], "|", color=GREY, markersize=9, markeredgewidth=2, label="step found")
    panels[-1].set_xlabel("time (s)")
    legend_above(figure, panels[0])
    stances = last - first + 1
    told = f"Steps found at these {stances} stances: {', '.join(late)}." if late else ""
    return Drawn(
        name="strides",
        figure=figure,
        title="Some strides and the steps that are found",
        caption=f"Magnitude of the specific force over n = {int(cut.sum())} readings and {stances} stances,"
        f" {walk.where()}; shaded: true stances; ticks: steps, stored at the first reading of a rest that"
        f" updates the filter. {told} The cut was fixed by the numbers of its stances, before any was drawn."
        " Gait and thresholds are assumed.",
        alt=f"Magnitude of the specific force from {decimals(float(magnitude.min()), least=0)} to"
        f" {magnitude.max():.0f} m/s² over {stances} stances. {told}",
    )


def _stances_s(walk: Walk) -> Array:
    return walk.truth.get("truth.stance_time_s", np.empty((0, 2)))


def _stacked(values: Array, place: float) -> Array:
    """Return heights about a place at which equal values stand beside each other."""
    order = np.argsort(values, kind="stable")
    rank = np.empty(len(values), dtype=int)
    rank[order] = np.arange(len(values))
    return place + 0.32 * ((rank * 0.618034) % 1.0 - 0.5) * 2


def _error(study: Study, family: str, row: str) -> OverTime | None:
    estimate = study.results.estimate(row, family)
    truth = study.results.truth.get(family, {})
    if "position_m" not in estimate or "truth.path_m" not in truth:
        return None
    position_m = np.asarray(estimate["position_m"], dtype=float)
    path_m = np.asarray(truth["truth.path_m"], dtype=float)[: len(position_m)]
    return _course(study, family, np.linalg.norm(position_m - path_m, axis=-1))


def _heading(study: Study, family: str, row: str) -> OverTime | None:
    estimate = study.results.estimate(row, family)
    truth = study.results.truth.get(family, {})
    if "extra_heading_rad" not in estimate or "truth.heading_rad" not in truth:
        return None
    heading_rad = np.asarray(estimate["extra_heading_rad"], dtype=float)
    off_rad = heading_rad - np.asarray(truth["truth.heading_rad"], dtype=float)[: len(heading_rad)]
    return _course(study, family, np.degrees(np.abs(np.angle(np.exp(1j * off_rad)))))


def _course(study: Study, family: str, values: Array) -> OverTime | None:
    """Bring values at the epochs of each world, [w, n], to common times, and these to median and band."""
    observed = study.results.observed.get(family, {})
    if "recording.time_s" not in observed:
        return None
    epoch_s = np.asarray(observed["recording.time_s"], dtype=float)[: len(values)]
    known = np.isfinite(epoch_s) & np.isfinite(values)
    if not known.any(axis=1).all():
        return None
    end_s = min(float(times[own].max()) for times, own in zip(epoch_s, known, strict=True))
    time_s = np.arange(0.0, end_s + GRID_S / 2, GRID_S)
    common = np.stack(
        [
            np.interp(time_s, times[own], line[own])
            for times, own, line in zip(epoch_s, known, values, strict=True)
        ]
    )
    ends = np.array([figures.interval_of(column)[:2] for column in common.T])
    return OverTime(time_s, np.median(common, axis=0), ends[:, 0], ends[:, 1], len(common))


def _panels(courses: Mapping[str, OverTime], reference: str, label: str, drawn: Drawn) -> Drawn:
    """Draw each row with its band into a panel of its own, a reference row behind all others."""
    figure = drawn.figure
    columns = min(COLUMNS, len(courses))
    lines = -(-len(courses) // columns)
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (row, course) in zip(panels, courses.items(), strict=False):
        color = stroke(row).color
        if course.worlds > 1:
            axes.fill_between(course.time_s, course.low, course.high, color=color, alpha=0.2, linewidth=0)
        if row != reference and reference in courses:
            axes.plot(courses[reference].time_s, courses[reference].median, color=GREY, linewidth=1.0)
        axes.plot(course.time_s, course.median, color=color)
        axes.set_title(row)
    for axes in panels[len(courses) :]:
        axes.set_visible(False)
    panels[0].set_ylim(bottom=0)
    panels[0].set_xlim(0, max(float(course.time_s[-1]) for course in courses.values()))
    figure.supxlabel("time (s)", fontsize=9)
    figure.supylabel(label, fontsize=9)
    return drawn


def _height_in(courses: Mapping[str, OverTime]) -> float:
    return 0.5 + 1.85 * -(-len(courses) // COLUMNS)


def _counted(courses: Mapping[str, OverTime]) -> str:
    worlds = max(course.worlds for course in courses.values())
    return f"n = {worlds} {'worlds' if worlds > 1 else 'world'}"


def _band(course: OverTime) -> str:
    return f" Line: median over worlds; band: {central(course.worlds)}." if course.worlds > 1 else ""


def _told(courses: Mapping[str, OverTime], unit: str) -> str:
    return ", ".join(f"{row} {_number(course.end)} {unit}" for row, course in courses.items())


def _number(value: float) -> str:
    return f"{value:.1f}" if value < 100 else f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
