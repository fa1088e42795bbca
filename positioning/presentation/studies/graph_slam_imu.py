"""Figures of WiFi graph SLAM on walks from simulated inertial readings of the foot.

See Gu et al., Figures 5 to 7.
"""

import numpy as np

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.graph_slam_world import (
    MEAN,
    PRINTED,
    TRUE_COLOR,
    legend_above,
    name_printed,
    raw_and_aligned,
)
from positioning.presentation.style import stroke
from positioning.presentation.tables import decimals

PRINTED_CLAIMS = {"mean": "fig7.mean", "largest": "fig7.max"}

LEAST_M = 0.05
"""Where the logarithmic axis begins; smaller errors are drawn there."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the walks and the errors at the landmarks.

    What a configuration leaves out is left out here.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    if not study.families:
        return []
    drawn = (raw_and_aligned(study), _landmarks(study))
    return [item for item in drawn if item is not None]


def _landmarks(study: Study) -> Drawn | None:
    family = study.families[0]
    rows = study.rows(MEAN, family)
    if not rows:
        return None
    figure = figures.new_figure(1.0 + 0.42 * len(rows))
    axes = figure.subplots()
    told, counts = [], set()
    for place, row in enumerate(rows):
        frame = study.results.errors(row, family)
        error_m = frame[frame["value"].isna()]["error_m"].to_numpy(dtype=float)
        if not len(error_m):
            continue
        counts.add(len(error_m))
        # Ranks from below to above keep dots of like errors apart.
        height = place + 0.22 * (2 * (np.arange(len(error_m)) % 5) / 4 - 1)
        axes.plot(
            np.maximum(np.sort(error_m), LEAST_M),
            height,
            "o",
            color=stroke(row).color,
            markersize=3,
            alpha=0.6,
        )
        mean_m = float(error_m.mean())
        axes.plot([mean_m, mean_m], [place - 0.34, place + 0.34], color=TRUE_COLOR, linewidth=1.6)
        told.append(f"{row} {mean_m:.2f} m, largest {error_m.max():.2f} m")
    axes.plot([], [], color=TRUE_COLOR, linewidth=1.6, label="mean")
    printed = {
        words: digits
        for words, claim in PRINTED_CLAIMS.items()
        if (digits := figures.printed_or_none(study.results, claim)) is not None
    }
    if "aligned" in rows:
        for (words, digits), marker in zip(printed.items(), "D^", strict=False):
            look = {**PRINTED, "marker": marker}
            axes.plot(float(digits), rows.index("aligned"), **look)
            name_printed(axes, f"printed {words}", marker)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if low <= tick <= high]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("error at a visit of a landmark (m)")
    figures.label_rows(axes, rows)
    legend_above(figure, axes)
    worlds = study.worlds(rows[0], MEAN)
    pooled = f"pooled over {worlds} worlds" if worlds > 1 else "one world"
    stated = ", ".join(f"{words} {decimals(float(d), d, least=1)} m" for words, d in printed.items())
    return Drawn(
        name="landmarks",
        figure=figure,
        title="Errors at the landmarks, walks from inertial readings",
        caption=f"A dot is the error at a visit, n = {max(counts, default=0)} visits a row, {pooled}, family"
        f" {family}; logarithmic axis. One rotation and shift, the best over all visits, ties the frame."
        f" {'; '.join(told)}."
        + (f" Printed: {stated}." if stated else "")
        # One world is one experiment: it says that the chain holds, not how large errors are elsewhere.
        + (" One world says that the chain of readings, filter and graph holds." if worlds == 1 else "")
        + " Sensors, gait and worlds are assumed.",
        alt=f"Errors at the landmarks. {'; '.join(told)}.",
    )
