"""The page that tells how worlds, scores and verdicts are made."""

from collections.abc import Mapping
from typing import Any

from positioning.evaluation.claims import FEW
from positioning.presentation.environment import environment
from positioning.presentation.pages import WORLDS_NEEDED, build_lines
from positioning.presentation.tones import GROUPS

MEANINGS = {
    "exact": "A scenario without chance: every printed digit comes out.",
    "reproduced": "The printed number lies where single experiments lie, the central 95 % of many worlds.",
    "holds": "An ordering, a ratio or a bound is met in at least 95 % of the worlds.",
    "depends": "It is met in more than 5 % and fewer than 95 % of the worlds.",
    "undecided": "Too few worlds were made to judge the claim either way.",
    "not reproduced": "The printed number lies outside that interval; the reason tells how far.",
    "fails": "An ordering, a ratio or a bound is met in at most 5 % of the worlds.",
    "contradicts itself": "The paper's own printed numbers break the claim; the reason shows the arithmetic.",
    "calibrated": "The number set a free setting: it agrees by construction and counts for nothing.",
    "none given": "The paper prints no number; the rebuilt one stands alone.",
    "not testable": "Nothing that could be measured here decides it; the reason says why.",
}
"""What each verdict means, for readers."""


def method_page(studies: Mapping[str, str], manifest: Mapping[str, Any], *, quick: bool = False) -> str:
    """Return the page on method as HTML.

    Parameters
    ----------
    studies
        On what each study runs, in words, by its name.
    manifest
        What the numbers came from.
    quick
        Whether they are those of a quick build.
    """
    return (
        environment()
        .get_template("method.html")
        .render(
            title="How the verdicts are made",
            here="method",
            quick=quick,
            worlds_needed=WORLDS_NEEDED,
            few=FEW,
            groups={
                group: {verdict: MEANINGS[verdict] for verdict in verdicts}
                for group, verdicts in GROUPS.items()
            },
            studies=studies,
            build=build_lines(manifest),
        )
    )
