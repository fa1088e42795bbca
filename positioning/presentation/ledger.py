"""The page of all claims: printed beside rebuilt, drawn to scale, with the reason of each verdict."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from positioning.presentation import tables
from positioning.presentation.claim_lines import told
from positioning.presentation.environment import environment
from positioning.presentation.front import in_short, shown_groups
from positioning.presentation.pages import WORLDS_NEEDED, build_lines


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
    for line in told(tables.records(claims), kinds, figures):
        place = f"figure-{line['figure']}" if line["figure"] else f"claim-{line['claim']}"
        lines.append({**line, "link": f"{line['study']}.html#{place}"})
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
