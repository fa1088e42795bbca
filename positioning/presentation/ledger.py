"""The page of all claims: printed beside rebuilt, drawn to scale, with the reason of each verdict."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup, escape

from positioning.presentation import tables
from positioning.presentation.environment import environment
from positioning.presentation.front import in_short, shown_groups
from positioning.presentation.pages import SHARES, WORLDS_NEEDED, build_lines, claim_line, figure_of

WIDTH, HEIGHT = 130, 22
"""Size of a drawing, pixels."""

_MARGIN = 7


def claims_page(
    claims: pd.DataFrame,
    kinds: Mapping[str, str],
    papers: Mapping[str, Mapping[str, Any]],
    figures: Mapping[str, Sequence[str]],
    manifest: Mapping[str, Any],
    *,
    quick: bool = False,
) -> str:
    """Return the page of all claims as HTML.

    Parameters
    ----------
    claims
        The ledger of all studies.
    kinds
        Kind by claim.
    papers
        By key: ``authors``, ``title``.
    figures
        Names of the figures on each study's page.
    manifest
        What the numbers came from.
    quick
        Whether they are those of a quick build.
    """
    lines = []
    for line in tables.records(claims):
        told = claim_line(line, kinds)
        figure = figure_of(str(line["claim"]), figures.get(str(line["study"]), ()))
        anchor = f"figure-{figure}" if figure else f"claim-{line['claim']}"
        lines.append(
            {
                **told,
                "drawn": drawn(line, told["kind"]),
                "link": f"{line['study']}.html#{anchor}",
                "figure": figure,
                "value": "" if math.isnan(float(line["rebuilt"])) else repr(float(line["rebuilt"])),
            }
        )
    return (
        environment()
        .get_template("claims.html")
        .render(
            title="All claims",
            here="claims",
            quick=quick,
            worlds_needed=WORLDS_NEEDED,
            answer=in_short(claims),
            lines=lines,
            papers={key: papers[key] for key in dict.fromkeys(claims["paper"])},
            studies=list(dict.fromkeys(claims["study"])),
            kinds=sorted({line["kind"] for line in lines}),
            groups=shown_groups(claims),
            build=build_lines(manifest),
        )
    )


def drawn(line: Mapping[str, Any], kind: str) -> Markup:
    """Return a claim as a small drawing to scale; empty where there is no number to draw.

    The axis of a number begins at zero, or at the least value where that is negative. Shares of worlds stand
    on 0 to 100 %, with marks at 5 and 95 %.

    Parameters
    ----------
    line
        A line of the ledger.
    kind
        Kind of the claim.
    """
    rebuilt, low, high = (float(line[name]) for name in ("rebuilt", "low", "high"))
    share = kind in SHARES
    printed = math.nan if share else _number(str(line["printed"]))
    values = [value for value in (rebuilt, low, high, printed) if math.isfinite(value)]
    if math.isnan(rebuilt) or not values:
        return Markup("")
    least, most = (0.0, 1.0) if share else (min(0.0, *values), max(0.0, *values))
    span = (most - least) or 1.0

    def place(value: float) -> str:
        return f"{_MARGIN + (WIDTH - 2 * _MARGIN) * (value - least) / span:.1f}"

    middle = HEIGHT / 2
    parts = [f'<path class="axis" d="M{place(least)} {middle:g}H{place(most)}"/>']
    for mark in (0.05, 0.95) if share else (0.0,):
        parts.append(f'<path class="axis" d="M{place(mark)} {middle - 5:g}v10"/>')
    if math.isfinite(low) and math.isfinite(high):
        parts.append(f'<path class="span" d="M{place(low)} {middle:g}H{place(high)}"/>')
    parts.append(f'<circle class="rebuilt" cx="{place(rebuilt)}" cy="{middle:g}" r="3.6"/>')
    if math.isfinite(printed):
        parts.append(f'<path class="printed" d="M{place(printed)} {middle - 7:g}l4 7-4 7-4-7z"/>')
    said = f"rebuilt {rebuilt:.3g}"
    if math.isfinite(low):
        said += f", {low:.3g} to {high:.3g}"
    if math.isfinite(printed):
        said = f"printed {line['printed']}, {said}"
    return Markup(
        f'<svg class="scale" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img"'
        f' aria-label="{escape(said)}">{"".join(parts)}</svg>'
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
