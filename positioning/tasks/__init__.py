"""What an algorithm of each task is given, what it returns, and how that is scored.

One module a task, named like its folder in ``algorithms/``, with ``OPTIONS``, the keys of a row that
are the task's and not the algorithm's, ``QUANTITY``, what its errors are errors of, and two functions:

``run(make, observed, truth, options, generators) -> Outcome``
    Runs one algorithm on a stack of worlds. ``truth`` is None for all but controls.
``score(estimates, truth) -> columns``
    Joins estimates of a stack of worlds with the truth; each column has the shape [world, sample],
    one of them is ``error_m``. NaN in ``error_m`` means: no estimate was asked for here.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

NOT_ASKED = "its line names other families of worlds"
"""Why a row has no answer in a family that its line leaves out; tables do not list it there."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one algorithm made of a stack of worlds.

    Attributes
    ----------
    estimates
        Named arrays with a world axis in front; empty where it was skipped.
    seconds
        Time spent in the algorithm, [world].
    skipped
        Why it did not run; empty where it did.
    """

    estimates: dict[str, NDArray[np.generic]] = field(default_factory=dict)
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    skipped: str = ""
