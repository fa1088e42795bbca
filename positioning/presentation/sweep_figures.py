"""Figures of sweeps: the mean error over one setting, for each family of worlds in which it ran."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.ticker import NullLocator

from positioning.presentation import figures
from positioning.presentation.families import FAMILY_LOOKS, Study
from positioning.presentation.figures import Drawn
from positioning.presentation.tables import central_of, listed

METRIC = "mean_m"

LOGARITHMIC = 20.0
"""Settings of which the largest is so many times the smallest stand on a logarithmic axis."""


def others(study: Study, drawn: Iterable[Drawn]) -> list[Drawn]:
    """Return a figure of each sweep that no figure of the study shows yet.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    drawn
        The study's own figures, which name the sweeps that they show.
    """
    shown = {sweep for item in drawn for sweep in item.sweeps}
    found = [
        sweep_figure(study, sweep, f"sweep_{sweep}", label=setting, title=f"Sweep {sweep}")
        for sweep, (setting, _) in study.results.sweeps.items()
        if sweep not in shown
    ]
    return [item for item in found if item is not None]


def sweep_figure(
    study: Study, sweep: str, name: str, *, label: str, title: str, note: str = ""
) -> Drawn | None:
    """Draw the mean error over a setting, a curve a family; None where the sweep was not measured.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    sweep
        Which sweep.
    name
        Name of the figure.
    label
        The setting with its unit.
    title
        A few words.
    note
        What else the caption must say, a sentence.
    """
    own = study.results.measures
    own = own[(own["algorithm"] == sweep) & (own["metric"] == METRIC) & own["x"].notna()]
    families = [family for family in study.families if (own["family"] == family).any()]
    if sweep not in study.results.sweeps or not families:
        return None
    measured = replace(study.results, measures=own)
    curves = [
        figures.curve(replace(measured, observed={family: study.results.observed[family]}), sweep)
        for family in families
    ]
    most = len(FAMILY_LOOKS)
    chunks = [slice(first, first + most) for first in range(0, len(families), most)]
    figure = figures.new_figure(0.4 + 2.9 * len(chunks))
    panels = figure.subplots(len(chunks), 1, sharex=True, squeeze=False)[:, 0]
    told = []
    for axes, chunk in zip(panels, chunks, strict=True):
        for family, line in zip(families[chunk], curves[chunk], strict=True):
            look = study.look(family)
            if line.worlds > 1:
                axes.fill_between(
                    line.values, line.low_m, line.high_m, color=look.color, alpha=0.14, linewidth=0
                )
                # Bands that lie on each other are one grey in print: their ends tell them apart.
                for end_m in (line.low_m, line.high_m):
                    axes.plot(line.values, end_m, look.line, color=look.color, linewidth=0.7)
            axes.plot(line.values, line.mean_m, look.marker + look.line, color=look.color, label=family)
            numbers = ", ".join(f"{m:.2f} m at {v:g}" for v, m in zip(line.values, line.mean_m, strict=True))
            told.append(f"{family}: {numbers}; smallest at {line.best:g}")
        axes.set_ylim(bottom=0)
        axes.set_ylabel("mean error (m)")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=most, borderaxespad=0.2)
    values = np.unique(np.concatenate([line.values for line in curves]))
    if values[0] > 0 and values[-1] >= LOGARITHMIC * values[0]:
        panels[-1].set_xscale("log")
        panels[-1].xaxis.set_minor_locator(NullLocator())
    panels[-1].set_xticks(values, [f"{value:g}" for value in values])
    panels[-1].set_xlabel(label)
    return Drawn(
        name=name,
        figure=figure,
        title=title,
        caption=f"Mean error against {label}, {_worlds(families, curves)}."
        + f" {note}" * bool(note)
        + f" {'. '.join(told)}.",
        alt=f"Mean error against {label}. {'. '.join(told)}.",
        sweeps=(sweep,),
    )


def _worlds(families: Sequence[str], curves: Sequence[figures.Curve]) -> str:
    """Return in words over how many worlds each family's curve is, and what the bands are."""
    counts = {family: line.worlds for family, line in zip(families, curves, strict=True)}
    if max(counts.values()) == 1:
        return "one world a family" if len(families) > 1 else "in one world"
    each = listed([f"{count} of {family}" for family, count in counts.items()])
    return f"mean over worlds, n = {each}; bands: {central_of(counts)}"
