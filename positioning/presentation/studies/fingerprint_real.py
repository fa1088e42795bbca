"""Figures of location fingerprinting on real recordings: one panel a recording."""

import math

import numpy as np
from matplotlib.artist import Artist

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.figures import Drawn
from positioning.presentation.style import stroke

COLUMNS = 2


def draw(results: StudyResults) -> list[Drawn]:
    """Return the error distributions and the mean errors of all recordings.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    families = figures.measured_families(results)
    present = {row for family in families for row in figures.measured_rows(results, family)}
    rows = [row for row in results.rows if row in present]
    return [_distributions(results, families, rows), _means(results, families, rows)]


def _distributions(results: StudyResults, families: list[str], rows: list[str]) -> Drawn:
    lines = math.ceil(len(families) / COLUMNS)
    legend_lines = math.ceil(len(rows) / 3)
    figure = figures.new_figure(2.5 * lines + 0.2 * legend_lines + 0.2)
    panels = np.atleast_1d(figure.subplots(lines, min(COLUMNS, len(families)), squeeze=False)).ravel()
    handles: dict[str, Artist] = {}
    for axes, family in zip(panels, families, strict=False):
        figures.distribution(axes, results, family, figures.measured_rows(results, family))
        axes.set_title(f"{family} ({_samples(results, family)})")
        handles |= {str(line.get_label()): line for line in axes.get_lines() if line.get_label() in rows}
    for axes in panels[len(families) :]:
        axes.set_visible(False)
    shown = [row for row in rows if row in handles]
    figure.legend(
        [handles[row] for row in shown], shown, loc="outside lower center", ncols=3, handlelength=2.4
    )
    return Drawn(
        name="error_distribution",
        figure=figure,
        title="Error distribution of each recording",
        caption="Share of position errors up to a given size; the number of located fingerprints, n, stands"
        " above each panel, each recording is one world. The axes differ, because the sites differ in size.",
        alt=" ".join(
            figures.distribution_alt(results, family, figures.measured_rows(results, family))
            for family in families
        ),
    )


def _means(results: StudyResults, families: list[str], rows: list[str]) -> Drawn:
    lines = math.ceil(len(families) / COLUMNS)
    figure = figures.new_figure(lines * (0.8 + 0.2 * len(rows)))
    panels = np.atleast_1d(
        figure.subplots(lines, min(COLUMNS, len(families)), squeeze=False, sharey=True)
    ).ravel()
    for axes, family in zip(panels, families, strict=False):
        for place, row in enumerate(rows):
            values = figures.per_world(results, family, row)
            if len(values):
                error = figures.per_world(results, family, row, "se_m").mean()
                look = stroke(row)
                axes.plot([values.mean() - error, values.mean() + error], [place, place], color=look.color)
                axes.plot(values.mean(), place, look.marker, color=look.color)
        figures.label_rows(axes, rows)
        means = {row: figures.per_world(results, family, row) for row in rows}
        centres = {row: float(v.mean()) if len(v) else 0.0 for row, v in means.items()}
        figures.keep_in_reach(axes, centres, centres)
        axes.set_xlim(left=0)
        axes.set_xlabel("mean position error (m)")
        axes.set_title(f"{family} ({_samples(results, family)})")
    for axes in panels[len(families) :]:
        axes.set_visible(False)
    return Drawn(
        name="mean_error",
        figure=figure,
        title="Mean error of each algorithm and recording",
        caption="Mean position error; the line is one standard error to either side, which takes samples of"
        " one site for independent. n stands above each panel, each recording is one world; a row without a"
        " dot did not run.",
        alt=" ".join(
            figures.means_alt(results, family, figures.measured_rows(results, family)) for family in families
        ),
    )


def _samples(results: StudyResults, family: str) -> str:
    row = figures.measured_rows(results, family)[0]
    return f"n = {int(figures.per_world(results, family, row, 'n')[0])}"
