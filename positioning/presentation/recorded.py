"""Figures of any study on real recordings: one panel a recording, positions and distances apart."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.artist import Artist

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.figures import Drawn
from positioning.presentation.style import stroke

COLUMNS = 2

DISTANCE = "error_distance_m"
"""The column that only errors of a distance have."""

PREFIX = {"position": "", "distance": "distance_"}
"""What the names of the figures begin with, by what the errors are errors of."""

SAMPLE = {"position": "", "distance": " A sample is one candidate distance."}
"""What must be said of the samples."""


def draw(results: StudyResults) -> list[Drawn]:
    """Return the error distributions and the mean errors of all recordings, positions before distances.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    families = figures.measured_families(results)
    present = {row for family in families for row in figures.measured_rows(results, family)}
    groups: dict[str, list[str]] = {"position": [], "distance": []}
    for row in results.rows:
        if row in present:
            groups["distance" if DISTANCE in results.errors(row) else "position"].append(row)
    drawn = []
    for quantity, rows in groups.items():
        own = [family for family in families if _rows(results, family, rows)]
        legend_in = 0.2 * math.ceil(len(rows) / 3) + 0.2
        for draw_part, line_in, more_in in (
            (_distributions, 2.5, legend_in),
            (_means, 0.8 + 0.2 * len(rows), 0.0),
        ):
            height_in = partial(_height_in, line_in=line_in, more_in=more_in)
            drawn += [
                draw_part(results, part, rows, quantity, height_in(part.families))
                for part in figures.parts(own, height_in)
            ]
    return drawn


def _height_in(families: Sequence[str], *, line_in: float, more_in: float) -> float:
    """Return how tall a figure with a panel a family is, inches."""
    return math.ceil(len(families) / COLUMNS) * line_in + more_in


def _distributions(
    results: StudyResults, part: figures.Part, rows: Sequence[str], quantity: str, height_in: float
) -> Drawn:
    families = part.families
    lines = math.ceil(len(families) / COLUMNS)
    figure = figures.new_figure(height_in)
    panels = np.atleast_1d(figure.subplots(lines, min(COLUMNS, len(families)), squeeze=False)).ravel()
    handles: dict[str, Artist] = {}
    for axes, family in zip(panels, families, strict=False):
        figures.distribution(axes, results, family, _rows(results, family, rows))
        axes.set_xlabel(f"{quantity} error (m)")
        axes.set_title(f"{family} ({_samples(results, family, rows)})")
        handles |= {str(line.get_label()): line for line in axes.get_lines() if line.get_label() in rows}
    for axes in panels[len(families) :]:
        axes.set_visible(False)
    shown = [row for row in rows if row in handles]
    figure.legend(
        [handles[row] for row in shown], shown, loc="outside lower center", ncols=3, handlelength=2.4
    )
    return Drawn(
        name=f"{PREFIX[quantity]}error_distribution{part.suffix}",
        figure=figure,
        title=f"Distribution of the {quantity} error in each recording{part.words}",
        caption=f"Share of {quantity} errors up to a given size; the number of samples, n, stands"
        f" above each panel, each recording is one world.{SAMPLE[quantity]} The axes differ, because the"
        f" sites differ in size.{_different(results, families, rows)}",
        alt=" ".join(
            figures.distribution_alt(results, family, _rows(results, family, rows)) for family in families
        ),
    )


def _means(
    results: StudyResults, part: figures.Part, rows: Sequence[str], quantity: str, height_in: float
) -> Drawn:
    families = part.families
    lines = math.ceil(len(families) / COLUMNS)
    figure = figures.new_figure(height_in)
    panels = np.atleast_1d(
        figure.subplots(lines, min(COLUMNS, len(families)), squeeze=False, sharey=True)
    ).ravel()
    for axes, family in zip(panels, families, strict=False):
        centres, ends = dict.fromkeys(rows, 0.0), dict.fromkeys(rows, 0.0)
        for place, row in enumerate(rows):
            values = figures.per_world(results, family, row)
            if len(values):
                error = figures.per_world(results, family, row, "se_m").mean()
                centres[row], ends[row] = float(values.mean()), float(values.mean() + error)
                look = stroke(row)
                axes.plot([values.mean() - error, values.mean() + error], [place, place], color=look.color)
                axes.plot(values.mean(), place, look.marker, color=look.color)
        figures.label_rows(axes, rows)
        figures.keep_in_reach(axes, centres, ends)
        axes.set_xlim(left=0)
        axes.set_xlabel(f"mean {quantity} error (m)")
        axes.set_title(f"{family} ({_samples(results, family, rows)})")
    for axes in panels[len(families) :]:
        axes.set_visible(False)
    return Drawn(
        name=f"{PREFIX[quantity]}mean_error{part.suffix}",
        figure=figure,
        title=f"Mean {quantity} error of each algorithm and recording{part.words}",
        caption=f"Mean {quantity} error; the line is one standard error to either side, which takes samples"
        " of one site for independent. n stands above each panel, each recording is one world; a row"
        f" without a dot did not run.{SAMPLE[quantity]}{_different(results, families, rows)}",
        alt=" ".join(figures.means_alt(results, family, _rows(results, family, rows)) for family in families),
    )


def _different(results: StudyResults, families: Sequence[str], rows: Sequence[str]) -> str:
    """Return in words which rows have another number of samples, and what that means."""
    own = {family: _rows(results, family, rows) for family in families}
    told = [
        f"{family}: {words}"
        for family in families
        if "(" in (words := figures.sample_counts(results, family, own[family]))
    ]
    return f" {'; '.join(told)}.{figures.differ(results, families, rows)}" if told else ""


def _rows(results: StudyResults, family: str, rows: Sequence[str]) -> list[str]:
    return [row for row in figures.measured_rows(results, family) if row in rows]


def _samples(results: StudyResults, family: str, rows: Sequence[str]) -> str:
    """Return the number of samples; not every row has an answer to every sample."""
    counts = [int(figures.per_world(results, family, row, "n")[0]) for row in _rows(results, family, rows)]
    low, high = min(counts), max(counts)
    return f"n = {high}" if low == high else f"n = {low} to {high}"
