"""Figures of a study: a study's own set where it has one, otherwise the same two kinds for every study."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from positioning.evaluation.results import StudyResults
from positioning.presentation import figures, sweep_figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import drawing


def draw(results: StudyResults) -> list[Drawn]:
    """Return the figures of a study, in the order in which they are shown; sweeps that none shows come last.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    with drawing(results.rows):
        module = f"{__package__}.studies.{results.study}"
        own = import_module(module).draw if find_spec(module) is not None else default_figures
        drawn: list[Drawn] = own(results)
        return [*drawn, *sweep_figures.others(Study.of(results), drawn)]


def default_figures(results: StudyResults) -> list[Drawn]:
    """Return an error distribution for every family, and the mean errors with their intervals."""
    drawn = []
    families = figures.measured_families(results)
    rows_of = {family: figures.measured_rows(results, family) for family in families}
    for family in families:
        figure = figures.new_figure(4.2)
        axes = figure.subplots()
        rows = rows_of[family]
        figures.distribution(axes, results, family, rows)
        figures.legend_beside(axes)
        drawn.append(
            Drawn(
                name="error_distribution" if len(families) == 1 else f"error_distribution_{family}",
                figure=figure,
                title=f"Error distribution, {family}",
                caption="Share of position errors up to a given size, all samples pooled:"
                f" {figures.counted(results, family)}.{figures.differ(results, [family])}",
                alt=figures.distribution_alt(results, family, rows),
            )
        )

    def height_in(some: Sequence[str]) -> float:
        return 0.6 + sum(0.5 + 0.26 * len(rows_of[family]) for family in some)

    for part in figures.parts(families, height_in):
        drawn.append(_means(results, part, rows_of, height_in(part.families)))
    return drawn


def _means(
    results: StudyResults, part: figures.Part, rows_of: Mapping[str, list[str]], height_in: float
) -> Drawn:
    families = part.families
    figure = figures.new_figure(height_in)
    ratios = [2 + len(rows_of[family]) for family in families]
    panels = np.atleast_1d(figure.subplots(len(families), 1, height_ratios=ratios))
    for axes, family in zip(panels, families, strict=True):
        figures.bars(axes, results, family, rows_of[family])
        axes.set_title(family)
    several = any(len(figures.per_world(results, f, row)) > 1 for f in families for row in results.rows)
    return Drawn(
        name=f"mean_error{part.suffix}",
        figure=figure,
        title=f"Mean error{part.words}",
        caption=f"Mean position error{'; the line is where single experiments lie' * several}. "
        + "; ".join(f"{family}: {figures.counted(results, family)}" for family in families)
        + f".{figures.differ(results, families)}",
        alt="; ".join(figures.means_alt(results, family, rows_of[family]) for family in families),
    )
