"""What is told of a claim: its numbers as a reader writes them, and a drawing of them to scale."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from positioning.evaluation.claims import CONDITIONS
from positioning.presentation import tables

WIDTH, HEIGHT = 130, 22
"""Size of a drawing, pixels."""

_MARGIN = 7


def told(
    lines: Iterable[Mapping[str, Any]], kinds: Mapping[str, str], figures: Mapping[str, Sequence[str]]
) -> list[dict[str, Any]]:
    """Return claims as their tables show them, each with its drawing and the figure that shows it.

    Parameters
    ----------
    lines
        Of the ledger.
    kinds
        Kind by claim.
    figures
        Names of the figures on each study's page.
    """
    return [
        {
            **(shown := claim_line(line, kinds)),
            "drawn": drawn(line, shown["kind"]),
            "figure": figure_of(str(line["claim"]), figures.get(str(line["study"]), ())),
            "value": "" if math.isnan(float(line["rebuilt"])) else repr(float(line["rebuilt"])),
        }
        for line in lines
    ]


def claim_line(line: Mapping[str, Any], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Return a claim as its table shows it; ``kinds`` by claim.

    Parameters
    ----------
    line
        A line of the ledger.
    kinds
        Kind by claim.
    """
    printed, kind = str(line["printed"]), kinds.get(str(line["claim"]), "")
    share = kind in CONDITIONS
    rebuilt, low, high = (float(line[name]) for name in ("rebuilt", "low", "high"))
    least = 0 if line["unit"] in tables.COUNTS else 2
    unit = "" if printed or rebuilt != rebuilt or line["unit"] in ("", "1", "share") else f" {line['unit']}"
    return {
        **line,
        "kind": kind,
        "printed": f"{printed} {line['unit']}".strip() if printed else "",
        "rebuilt": f"{100 * rebuilt:.0f} % of worlds"
        if share and rebuilt == rebuilt
        else tables.decimals(rebuilt, printed, least) + unit,
        "span": f"{100 * low:.0f} to {100 * high:.0f} %"
        if share and low == low
        else tables.span(low, high, printed, least),
        "worlds": tables.worlds_text(line["worlds"]),
    }


def figure_of(claim: str, figures: Iterable[str]) -> str:
    """Return which of a page's figures shows a claim, by the part of its name before the first dot, or "".

    Parameters
    ----------
    claim
        The claim's name.
    figures
        Names of the figures.
    """
    part = claim.partition(".")[0]
    return part if part in figures else ""


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
    share = kind in CONDITIONS
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
