"""Figures of location fingerprinting on real recordings.

See Mirzababaei & Akbari, section 6, whose experiment was one such recording.
"""

from positioning.evaluation.results import StudyResults
from positioning.presentation import recorded
from positioning.presentation.figures import Drawn


def draw(results: StudyResults) -> list[Drawn]:
    """Return the error distributions and the mean errors of all recordings.

    Parameters
    ----------
    results
        What the workflow made of the study.
    """
    return recorded.draw(results)
