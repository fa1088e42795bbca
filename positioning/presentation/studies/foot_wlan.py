"""Figures of WLAN fingerprints and foot-mounted inertial sensors, numbered as in the paper where it has them.

See Frank et al., Figures 4 to 7. Those of one walk stand in `foot_wlan_world`, those of the inertial sensors
in `foot_wlan_steps`, those of sweeps in `foot_wlan_sweeps`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from positioning.evaluation.results import StudyResults
from positioning.evaluation.statistics import paired_difference, share_interval
from positioning.evaluation.studies.foot_wlan import ABOUT_ONE_M, LARGE_M, SMALL_M
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies import foot_wlan_steps, foot_wlan_sweeps
from positioning.presentation.studies.foot_wlan_world import (
    CALIBRATED,
    FUSED,
    MEAN,
    PRINTED,
    TRUE_COLOR,
    WLAN,
    WORDS,
    bars,
    counted,
    draw_walk,
    legend_above,
)
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central, decimals
from positioning.presentation.tones import is_control

NEAR_SHARE = 0.05
"""A share that is printed as a number is met within so much of it; assumed."""

OFF_SCALE = 5.0
"""A row whose mean is so many times that of WLAN alone is told beside the axis."""

Array = NDArray[np.float64]


class Fact(NamedTuple):
    """A share that the paper tells of the errors, where it stands among the claims, and in words."""

    claim: str
    row: str
    metric: str
    words: str


FACTS = (
    Fact("wlan.small", WLAN, "within_05m", f"WLAN below {SMALL_M:g} m"),
    Fact("wlan.large", WLAN, "over_4m", f"WLAN above {LARGE_M:g} m"),
    Fact("fused.large", FUSED, "over_4m", f"fused above {LARGE_M:g} m"),
    Fact("fused.about_one", FUSED, "about_1m", f"fused from {ABOUT_ONE_M[0]:g} to {ABOUT_ONE_M[1]:g} m"),
)
LEVELS_M = {"within_05m": SMALL_M, "over_4m": LARGE_M}
"""The errors to which two of the shares belong."""


class Printed(NamedTuple):
    """What the paper says of a share: at least or at most a limit, or a number; each with its sign."""

    value: float
    kind: str

    @property
    def sign(self) -> str:
        """What stands before the value in words."""
        return {"at_least": "more than ", "at_most": "at most ", "printed": ""}[self.kind]

    def met(self, shares: Array) -> NDArray[np.bool_]:
        """Say in which worlds it holds, [w]."""
        if self.kind == "printed":
            return np.asarray(np.abs(shares - self.value) <= NEAR_SHARE + 1e-9)
        return np.asarray(shares >= self.value if self.kind == "at_least" else shares <= self.value)


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
    drawn = [make(study) for make in FIGURES]
    return [*draw_walk(study), *(item for item in drawn if item is not None)]


def _cumulative(study: Study) -> Drawn | None:
    family = study.families[0]
    errors = {row: _errors_by_world(study, row) for row in WORDS if len(study.get(family, row, MEAN))}
    if not errors:
        return None
    reach_m = 1.05 * max(LARGE_M, *(float(np.percentile(np.concatenate(e), 97)) for e in errors.values()))
    grid_m = np.linspace(0, reach_m, 161)
    figure = figures.new_figure(3.7)
    axes = figure.subplots()
    told = []
    for row, worlds in errors.items():
        shares = 100 * np.stack(
            [np.searchsorted(np.sort(error_m), grid_m, side="right") / len(error_m) for error_m in worlds]
        )
        look = stroke(row)
        if len(worlds) > 1:
            ends = np.array([figures.interval_of(column)[:2] for column in shares.T])
            axes.fill_between(grid_m, ends[:, 0], ends[:, 1], color=look.color, alpha=0.17, linewidth=0)
        line = "--" if row == WLAN else "-"
        axes.plot(grid_m, np.median(shares, axis=0), color=look.color, linestyle=line, label=WORDS[row])
        told.append(f"{WORDS[row]} {decimals(float(study.get(family, row, MEAN).mean()))} m")
    said = _printed_on_curves(axes, study, errors)
    axes.set_xlim(0, reach_m)
    axes.set_ylim(0, 100)
    axes.set_xlabel("position error (m)")
    axes.set_ylabel("share of passages (%)")
    legend_above(figure, axes, columns=3)
    count = max(len(own) for own in errors.values())
    lines = f"median over worlds; band: {central(count)}" if count > 1 else "one world"
    return Drawn(
        name="fig7b",
        figure=figure,
        title="Cumulative error of WLAN alone and of the fused filter",
        caption=f"Share of errors up to a given size at the passages of marks, {counted(study)}. Line:"
        f" {lines}. Mean: {', '.join(told)}."
        + (f" Hollow, in the colour of its system: {said}." if said else "")
        + f" {CALIBRATED}",
        alt=f"Cumulative errors. Mean: {', '.join(told)}." + (f" Printed: {said}." if said else ""),
    )


def _means(study: Study) -> Drawn | None:
    family = study.families[0]
    rows = study.rows(MEAN, family)
    if not rows:
        return None
    figure = figures.new_figure(0.9 + 0.24 * len(rows))
    axes = figure.subplots()
    figures.means_against_printed(axes, study.results, family, rows)
    means_m, ends_m = figures.means_and_ends(study.results, family, rows)
    scale_m = means_m.get(WLAN, float(np.median(list(means_m.values()))))
    beyond = [row for row in rows if means_m[row] > OFF_SCALE * scale_m and not is_control(row)]
    axes.set_xlim(left=0)
    if beyond:
        figures.keep_in_reach(axes, means_m, {row: e for row, e in ends_m.items() if row not in beyond})
    return Drawn(
        name="means",
        figure=figure,
        title="Mean error of all rows",
        caption=f"Mean error at the passages of marks, {counted(study)}: mean over worlds"
        f"{bars(study)}; hollow diamond: printed.{figures.few_worlds(study.results, [family], rows)} Start,"
        f" variances and thresholds are assumed. {CALIBRATED}",
        alt=figures.means_alt(study.results, family, rows),
    )


def _shares(study: Study) -> Drawn | None:
    family = study.families[0]
    facts = [
        (fact, printed, values)
        for fact in FACTS
        if (printed := _printed(study, fact.claim)) is not None
        and len(values := study.get(family, fact.row, fact.metric))
    ]
    if not facts:
        return None
    figure = figures.new_figure(0.9 + 0.75 * len(facts))
    axes = figure.subplots()
    told = []
    for place, (fact, printed, values) in enumerate(facts):
        color, limit = stroke(fact.row).color, 100 * printed.value
        axes.plot(
            100 * values,
            place - _stacked(values),
            "o",
            color=color,
            markersize=3.5,
            alpha=0.75,
            clip_on=False,
        )
        axes.plot([limit, limit], [place - 0.42, place + 0.28], color=TRUE_COLOR, linewidth=1.2)
        # An arrow to the side on which the words of the paper hold.
        if printed.kind != "printed":
            side = ">" if printed.kind == "at_least" else "<"
            axes.plot(limit, place + 0.28, side, color=TRUE_COLOR, markersize=6)
        else:
            axes.plot(limit, place + 0.28, **PRINTED)
        met = int(np.count_nonzero(printed.met(values)))
        low, high, _ = share_interval(met, len(values))
        near = f" within {100 * NEAR_SHARE:g} points" if printed.kind == "printed" else ""
        told.append(
            f"{fact.words}, {printed.sign}{limit:g} %{near}: met in {met} of {len(values)} worlds"
            + (f" ({100 * low:.0f} to {100 * high:.0f} %)" if len(values) > 1 else "")
            + f", median {100 * np.median(values):.0f} %"
        )
        axes.annotate(
            f"met in {met} of {len(values)}",
            (1.01, place),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize=8.5,
        )
    figures.label_rows(axes, [f"{fact.words}:\n{p.sign}{100 * p.value:g} %" for fact, p, _ in facts])
    axes.set_xlim(left=0)
    axes.set_xlabel("share of passages (%), a dot a world")
    return Drawn(
        name="shares",
        figure=figure,
        title="The shares of Figure 7 in each world",
        caption=f"A dot is the share of passages in one world, {counted(study)}. Line: what the paper says;"
        " the arrow points to where it holds, the diamond is a number."
        f" {'; '.join(told)}. In brackets the 95 % interval of the share of worlds. The distance from a"
        f" printed number and the span about one metre are assumed. {CALIBRATED}",
        alt=f"Shares of passages by world. {'; '.join(told)}.",
    )


def _marks(study: Study) -> Drawn | None:
    family = study.families[0]
    metrics = {MEAN: "at marks", "on_points_m": "at calibration points"}
    rows = [row for row in WORDS if all(len(study.get(family, row, metric)) for metric in metrics)]
    if not rows:
        return None
    figure = figures.new_figure(0.9 + 0.5 * len(rows))
    axes = figure.subplots()
    told = []
    for place, row in enumerate(rows):
        color, own = stroke(row).color, {}
        for number, metric in enumerate(metrics):
            values, height = study.get(family, row, metric), place + 0.3 * (number - 0.5)
            own[metric] = values
            low, high, _ = figures.interval_of(values)
            axes.plot([low, high], [height, height], color=color, linewidth=3.2, alpha=0.4)
            axes.plot(
                values.mean(), height, "os"[number], color=color, markerfacecolor=(color, "white")[number]
            )
        words = " and ".join(f"{own[metric].mean():.2f} m {there}" for metric, there in metrics.items())
        difference = paired_difference(own["on_points_m"], own[MEAN]) if len(own[MEAN]) > 1 else None
        told.append(
            f"{WORDS[row]} {words}"
            + (
                f" (difference {decimals(difference.difference)} m, 95 % interval"
                f" {decimals(difference.low)} to {decimals(difference.high)} m)"
                if difference
                else ""
            )
        )
    for marker, words in zip("os", metrics.values(), strict=True):
        fill = GREY if marker == "o" else "white"
        axes.plot([], [], marker, color=GREY, markerfacecolor=fill, label=words)
    figures.label_rows(axes, rows)
    axes.set_xlim(left=0)
    axes.set_xlabel("mean position error (m)")
    legend_above(figure, axes)
    return Drawn(
        name="marks",
        figure=figure,
        title="At marks and at calibration points",
        caption=f"Mean error at the passages of marks, {counted(study)}, and at the passages of calibration"
        f" points in the same walks{_points_passed(study)}: mean over worlds{bars(study)}."
        f" {'; '.join(told)}. Here marks lie between calibration points; whether they do in the paper"
        " is not said, so that is assumed.",
        alt=f"Mean errors at two kinds of places. {'; '.join(told)}.",
    )


def _cascade(study: Study) -> Drawn | None:
    family = study.families[0]
    rows = study.rows(MEAN, family)
    if FUSED not in rows:
        return None
    kept = [
        row
        for row in rows
        if not row.startswith((WLAN, foot_wlan_steps.INERTIAL)) and row != "control_centre"
    ]
    frame = figures.differences(study.results, family, FUSED) if len(rows) > 1 else None
    if frame is None or not frame["algorithm"].isin(kept).any():
        return None
    frame = frame[frame["algorithm"].isin(kept)]
    figure = figures.new_figure(0.9 + 0.3 * len(frame))
    axes = figure.subplots()
    figures.difference_panel(axes, frame, FUSED)
    told = ", ".join(
        f"{line['algorithm']} {decimals(line['difference_m'])} m" for line in frame.to_dict("records")
    )
    worlds = study.worlds(FUSED, MEAN)
    pairs = (
        "on the same worlds, with the 95 % interval of the mean difference"
        if worlds > 1
        else "at the passages of one world, whose errors are not independent of each other"
    )
    return Drawn(
        name="cascade",
        figure=figure,
        title=f"Paired differences to {FUSED}",
        caption=f"Mean error minus that of {FUSED} {pairs}. {counted(study)}."
        + figures.few_worlds(study.results, [family], [FUSED, *frame["algorithm"]], bars=False)
        + " Rows joint have one filter"
        " for readings and fixes, particle a particle filter above, cascaded_15 an inertial filter with"
        " biases, rows with shoe another detector of rest. Weights are assumed; those of the joint filter"
        " are its own.",
        alt=f"Differences of the mean error to {FUSED}: {told}.",
    )


FIGURES: tuple[Callable[[Study], Drawn | None], ...] = (
    *(_cumulative, _means, _shares, _marks),
    *(foot_wlan_sweeps.density, foot_wlan_sweeps.weights, foot_wlan_sweeps.start_heading),
    *(foot_wlan_steps.drift, foot_wlan_steps.detectors, foot_wlan_steps.strides),
    *(foot_wlan_steps.headings, _cascade),
)
"""What draws each figure over all worlds, in their order; None where what it shows is absent."""


def _errors_by_world(study: Study, row: str) -> list[Array]:
    frame = study.results.errors(row, study.families[0])
    frame = frame[frame["value"].isna()]
    return [own["error_m"].to_numpy(dtype=float) for _, own in frame.groupby("world")]


def _printed(study: Study, claim: str) -> Printed | None:
    """Return what the paper says of a share, None where it does not."""
    found: dict[str, Any] = next((c for c in study.results.paper.get("claims", []) if c["id"] == claim), {})
    kind = next((kind for kind in ("at_least", "at_most", "printed") if kind in found), None)
    return None if kind is None else Printed(float(found[kind]), kind)


def _printed_on_curves(axes: Axes, study: Study, rows: Mapping[str, Sequence[Array]]) -> str:
    """Mark what the paper says of the curves; return it in words."""
    family = study.families[0]
    said: list[str] = []
    kinds: list[str] = []
    for fact in FACTS:
        printed = _printed(study, fact.claim)
        if printed is None or fact.row not in rows or fact.metric not in LEVELS_M:
            continue
        # More than a share below is a curve above it, less than a share above too.
        above = fact.metric == "over_4m"
        share = 1 - printed.value if above else printed.value
        marker = "D" if printed.kind == "printed" else "v" if above == (printed.kind == "at_least") else "^"
        kinds.append(marker)
        look = {**PRINTED, "marker": marker, "markeredgecolor": stroke(fact.row).color}
        axes.plot(LEVELS_M[fact.metric], 100 * share, **look)
        said.append(f"{fact.words} {printed.sign}{100 * printed.value:g} %")
    for row in rows:
        digits = study.printed.get((family, row), {}).get(MEAN)
        if digits:
            kinds.append("d")
            axes.plot(float(digits), 0, **{**PRINTED, "marker": "d", "markeredgecolor": stroke(row).color})
            said.append(f"mean of {WORDS[row]} {digits} m")
    words = {
        "D": "printed share",
        "^": "curve printed to be above",
        "v": "curve printed to be below",
        "d": "printed mean, on the axis",
    }
    for marker in dict.fromkeys(kinds):
        axes.plot([], [], **{**PRINTED, "marker": marker}, label=words[marker])
    return ", ".join(said)


def _stacked(values: Array) -> Array:
    """Return heights that pile up equal values."""
    rank = np.zeros(len(values))
    for value in np.unique(values):
        own = np.flatnonzero(np.isclose(values, value))
        rank[own] = np.arange(len(own))
    return 0.5 * rank / max(float(rank.max()), 8.0) - 0.15


def _points_passed(study: Study) -> str:
    on_m = study.results.truth.get(study.families[0], {}).get("truth.on_point_m")
    if on_m is None:
        return ""
    counts = np.count_nonzero(~np.isnan(np.asarray(on_m, dtype=float)[..., 0]), axis=1)
    low, high = int(counts.min()), int(counts.max())
    return f" ({high} of them)" if low == high else f" ({low} to {high} of them)"
