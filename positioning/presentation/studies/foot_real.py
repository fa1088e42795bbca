"""Figures of feet and phones of others: inertial navigation and fingerprints on recordings.

See Frank et al., sections 2 and 3; the paper has one walk of its own, which is not public.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import markers_apart, stroke
from positioning.presentation.tables import metres

MEAN, RIGID = "mean_m", "rigid_mean_m"

QUANTITIES = (MEAN, RIGID)

INERTIAL, WLAN = "inertial", "wlan"
"""How the names of rows begin that need inertial readings, or scans."""

MOCAP, CORRIDOR = "mocap_", "corridor_"

TRACKS = ("inertial", "inertial_shoe")
"""Rows whose tracks are drawn: the detector of the paper, and another one."""

FEW_DECADES = 1.5
"""An axis that spans less has more ticks, decades."""

ALMOST_NONE = 0.2
"""A detector that finds fewer steps a true stride than this finds almost none; assumed."""

TRUE_COLOR = "#111111"

Array = np.ndarray[Any, np.dtype[np.float64]]


class Shown(NamedTuple):
    """A recording whose tracks are drawn, and why."""

    family: str
    words: str


def draw(results: StudyResults) -> list[Drawn]:
    """Return the errors of all recordings, and tracks of a few.

    What a configuration leaves out is left out here.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    # Recordings behind the first batch have no tracks at hand, but errors all the same.
    study = replace(study, families=list(dict.fromkeys([*study.families, *results.measures["family"]])))
    drawn = [_errors(study), _tracks(study), _fingerprints(study)]
    return [item for item in drawn if item is not None]


def _errors(study: Study) -> Drawn | None:
    return _dots(
        study,
        [f for f in study.families if _ran(study, f, INERTIAL)],
        "from the noted start",
        Drawn(
            name="errors",
            figure=Figure(),
            title="Inertial navigation on the feet of others",
            caption="Mean position error of each row in each recording{counted}; left from the noted start"
            " and heading, right after the rotation and shift that fit the squares of the errors best, which"
            " takes the start away. A row without a dot was not measured; no recording is left out. In"
            " recordings mocap place and heading at the start are taken from the truth of the first"
            " metres, which are not scored; in corridor control points are paired with stances in order;"
            " loop has one error, that of its end. Detectors have the settings that were assumed for the"
            f" synthetic feet.{_steps_found(study)}",
            alt="",
        ),
    )


def _steps_found(study: Study) -> str:
    """Say how many steps each row has found for each true stride, and where almost none.

    Strides lead from one stance to the next, and the epochs of a recording are its stances; those of one of
    which start and end alone are known are not.
    """
    middle, few = [], []
    for row in study.results.rows:
        shares = []
        for family in study.families:
            steps = _steps(study, row, family)
            if steps is None:
                continue
            found, strides = steps
            shares.append(found / strides)
            if found < ALMOST_NONE * strides:
                few.append(f"{row} in {family} ({found} of {strides})")
        if shares:
            span = f"{min(shares):.2f} to {max(shares):.2f}, {len(shares)} recordings"
            middle.append(f"{row} {np.median(shares):.2f} ({span})")
    if not middle:
        return ""
    told = f" Steps found for each true stride, median and span over recordings: {'; '.join(middle)}."
    return told + (f" Fewer than {ALMOST_NONE:g}, almost none: {'; '.join(few)}." if few else "")


def _steps(study: Study, row: str, family: str) -> tuple[int, int] | None:
    """Return the steps that a row has found and the true strides; None where either is not known."""
    truth, estimate = study.first_world("truth", family), study.results.estimate(row, family)
    if "truth.stance_time_s" not in truth or not len(estimate.get("extra_step_time_s", ())):
        return None
    strides = int(np.count_nonzero(np.isfinite(truth["truth.path_m"][:, 0]))) - 1
    found = int(np.count_nonzero(np.isfinite(estimate["extra_step_time_s"][0])))
    return None if strides < 1 else (found, strides)


def _fingerprints(study: Study) -> Drawn | None:
    return _dots(
        study,
        [f for f in study.families if _ran(study, f, WLAN) and not _ran(study, f, INERTIAL)],
        "as located",
        Drawn(
            name="fingerprints",
            figure=Figure(),
            title="Fingerprints on recordings of a phone",
            caption="Mean position error of each row in each recording{counted}; left as located, right"
            " after the rotation and shift that fit the squares of the errors best. These recordings have"
            " scans of a phone, not of a computer, and no inertial readings of a foot.",
            alt="",
        ),
    )


def _dots(study: Study, families: Sequence[str], first: str, drawn: Drawn) -> Drawn | None:
    """Draw a line a recording with a dot a row, on a logarithmic axis."""
    rows = [row for row in study.results.rows if any(len(study.get(f, row, MEAN)) for f in families)]
    if not rows:
        return None
    metrics = [
        metric for metric in QUANTITIES if any(len(study.get(f, r, metric)) for f in families for r in rows)
    ]
    # A logarithmic axis has no zero, which the centre of a site that is one place has.
    positive_m = [v for f in families for r in rows for m in metrics for v in study.get(f, r, m) if v > 0]
    least_m = 0.5 * min(positive_m, default=1.0)
    zeros = [f"{r} in {f}" for f in families for r in rows if any(study.get(f, r, MEAN) == 0)]
    legend_lines = -(-len(rows) // 4)
    figure = figures.new_figure(0.9 + 0.31 * len(families) + 0.2 * legend_lines)
    panels = figure.subplots(1, len(metrics), sharey=True, sharex=True, squeeze=False)[0]
    markers = markers_apart(rows)
    for axes, metric in zip(panels, metrics, strict=True):
        for number, row in enumerate(rows):
            look, shift = stroke(row), 0.6 * ((number + 0.5) / len(rows) - 0.5)
            places = [place for place, f in enumerate(families) if len(study.get(f, row, metric))]
            values_m = [float(study.get(families[p], row, metric).mean()) for p in places]
            axes.plot(
                np.maximum(values_m, least_m),
                np.asarray(places) + shift,
                markers[row],
                color=look.color,
                markersize=4,
                label=row,
                clip_on=False,
            )
        for place in range(len(families)):
            axes.axhline(place + 0.5, color="#dde1e5", linewidth=0.6, zorder=0)
        axes.set_xscale("log")
        decades = np.log10(max(positive_m, default=1.0) / least_m)
        few = (1.0, 2.0, 5.0) if decades > FEW_DECADES else (1.0, 2.0, 3.0, 5.0, 7.0)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if decades > 3 else few))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(first if metric == MEAN else "after rotation and shift")
        axes.set_xlabel("mean position error (m)")
    figures.label_rows(panels[0], families)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    counts = [int(study.get(f, row, "n")[0]) for f in families for row in rows if len(study.get(f, row, "n"))]
    recordings = f"{len(families)} recording{'s' if len(families) > 1 else ''}"
    span = f"n = {min(counts)} to {max(counts)} samples in each" if counts else ""
    told = []
    for row in rows:
        means_m = np.array([study.get(f, row, MEAN).mean() for f in families if len(study.get(f, row, MEAN))])
        low, middle, high = (metres(float(v)) for v in (means_m.min(), np.median(means_m), means_m.max()))
        told.append(f"{row} {middle} m ({low} to {high} m, {len(means_m)} recordings)")
    counted = f", n = {recordings}, each of which is one world" + (f"; {span}" if span else "")
    return replace(
        drawn,
        figure=figure,
        caption=drawn.caption.replace("{counted}", counted)
        + (f" At the left end, for it is zero: {', '.join(zeros)}." if zeros else "")
        + f" Median and span over recordings: {'; '.join(told)}.",
        alt=f"Mean errors in {recordings}. Median and span: {'; '.join(told)}.",
    )


def _tracks(study: Study) -> Drawn | None:
    tracks = {row: _places(study, row) for row in TRACKS if row in study.results.rows}
    shown = [part for part in _chosen(study) if any(part.family in own for own in tracks.values())]
    if not shown:
        return None
    columns = min(2, len(shown))
    lines = -(-len(shown) // columns)
    figure = figures.new_figure(0.4 + 3.3 * lines)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    told = []
    for axes, (family, words) in zip(panels, shown, strict=False):
        truth = study.first_world("truth", family)
        path_m = truth.get("truth.path_m", truth["truth.position_m"])
        axes.plot(*path_m.T, ".-", color=TRUE_COLOR, linewidth=0.8, markersize=4, label="truth")
        own = []
        for row, found in tracks.items():
            if family in found:
                look, steps = stroke(row), _steps(study, row, family)
                axes.plot(
                    *found[family].T,
                    look.line,
                    marker=look.marker,
                    color=look.color,
                    linewidth=1.1,
                    markersize=2.5,
                    label=row,
                )
                share = "" if steps is None else f" (steps found {steps[0]}, true strides {steps[1]})"
                own.append(f"{row} {metres(float(study.get(family, row, MEAN).mean()))} m{share}")
        axes.plot(*path_m[0], "s", color=TRUE_COLOR, markerfacecolor="none", markersize=9, label="start")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"{family}\n{words}", fontsize=8.5)
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
        told.append(f"{family} ({words}): {', '.join(own)}")
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return Drawn(
        name="tracks",
        figure=figure,
        title="Tracks of a few recordings",
        caption=f"Places at the stances of the foot, n = {len(shown)} recordings, each one world; chosen by"
        " the speed or length of the true way, and of recordings with a start and an end alone the first."
        f" Mean error: {'; '.join(told)}."
        " Where the truth is start and end alone, the places at all steps are drawn. Start and heading are"
        " those that were noted, or were taken from the truth.",
        alt=f"Plans of {len(shown)} recordings with the truth and the tracks. Mean error: {'; '.join(told)}.",
    )


def _chosen(study: Study) -> list[Shown]:
    """Choose by the truth alone: mocap of middle speed and the fastest, the longest corridor, a loop."""
    speed, length_m, closed = {}, {}, []
    for family in study.families:
        observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
        if (
            not _ran(study, family, INERTIAL)
            or "truth.path_m" not in truth
            or "recording.time_s" not in observed
        ):
            continue
        known = np.isfinite(truth["truth.path_m"][:, 0])
        path_m, time_s = truth["truth.path_m"][known], observed["recording.time_s"][known]
        if len(path_m) < 3:
            closed.append(Shown(family, "start and end known"))
            continue
        way_m = float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())
        if family.startswith(MOCAP):
            speed[family] = way_m / float(time_s[-1] - time_s[0])
        elif family.startswith(CORRIDOR):
            length_m[family] = way_m
    found = []
    if speed:
        order = sorted(speed, key=speed.__getitem__)
        middle, fastest = order[(len(order) - 1) // 2], order[-1]
        found.append(Shown(middle, f"of middle speed, {speed[middle]:.2f} m/s"))
        if fastest != middle:
            found.append(Shown(fastest, f"the fastest, {speed[fastest]:.2f} m/s"))
    if length_m:
        longest = max(length_m, key=length_m.__getitem__)
        found.append(Shown(longest, f"the longest, {length_m[longest]:.0f} m"))
    return [*found, *closed[:1]]


def _places(study: Study, row: str) -> dict[str, Array]:
    """Return the places of a row by recording, [k, 2]: at the epochs, or at steps where epochs are few."""
    found = {}
    for family in study.families:
        estimate = study.results.estimate(row, family)
        if not len(estimate.get("position_m", ())):
            continue
        position_m = np.asarray(estimate["position_m"][0], dtype=float)
        if len(position_m) < 3:
            position_m = _reckoned(study, family, estimate, position_m)
        found[family] = position_m[np.isfinite(position_m[:, 0])]
    return found


def _reckoned(study: Study, family: str, estimate: dict[str, Any], position_m: Array) -> Array:
    """Return the places after each step, by Frank et al., eqs. 9 and 10."""
    heading_rad = study.first_world("observed", family).get("recording.start_heading_rad")
    names = [f"extra_step_{name}" for name in ("forward_m", "left_m", "turn_rad")]
    if heading_rad is None or not set(names) <= estimate.keys():
        return position_m
    forward_m, left_m, turn_rad = (np.nan_to_num(np.asarray(estimate[n][0], dtype=float)) for n in names)
    before_rad = float(heading_rad) + np.cumsum(turn_rad) - turn_rad
    cosine, sine = np.cos(before_rad), np.sin(before_rad)
    advance_m = np.stack([cosine * forward_m - sine * left_m, sine * forward_m + cosine * left_m], axis=-1)
    return np.asarray(np.concatenate([position_m[:1], position_m[0] + np.cumsum(advance_m, axis=0)]))


def _ran(study: Study, family: str, kind: str) -> bool:
    return any(row.startswith(kind) and len(study.get(family, row, MEAN)) for row in study.results.rows)
