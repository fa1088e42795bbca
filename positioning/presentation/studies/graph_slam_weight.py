"""The figure of the study that chooses the weight of WiFi edges, on worlds that judge nothing.

See Gu et al., eq. 5, whose weight is not printed.
"""

from positioning.evaluation.results import StudyResults
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies import graph_slam_sweeps


def draw(results: StudyResults) -> list[Drawn]:
    """Return the sweep of the weight; nothing where it was not made.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    study = Study.of(results)
    drawn = graph_slam_sweeps.weight(study)
    return [] if drawn is None else [drawn]
