"""Figures of ranging, trilateration and tracking on real recordings.

See Raghavan et al., section V, whose six runs were such recordings.
"""

from positioning.evaluation.results import StudyResults
from positioning.presentation import recorded
from positioning.presentation.figures import Drawn


def draw(results: StudyResults) -> list[Drawn]:
    """Return the errors of positions, then those of distances, of all recordings.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    return recorded.draw(results)
