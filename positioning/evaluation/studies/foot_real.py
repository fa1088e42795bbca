"""What recordings of real feet allow to say beside the error from a noted start: the shape of the track.

See Frank et al., section 5.3, where inertial navigation alone is called no sensible approach.

All recordings have one alignment: the first rest of at least 0.05 s, some ten readings, so that with every
detector it is the one in which the recording begins. The shortest of these lasts 0.14 s; to ask for 0.2 s
would begin that navigation a second later, in another stance. Rests below a second give roll and pitch but no
bias of the gyroscope, of which they tell too little.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from positioning.evaluation.statistics import mean_where
from positioning.evaluation.tracks import answers, lines, table
from positioning.files import Tree
from positioning.geometry import rigid_fit, rotated


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return ``rigid_mean_m`` of every row and recording, columns ``MEASURES``.

    It is the mean error after the rotation and shift that lay the track on the truth best, by least squares
    over all epochs that are scored. The noted place and direction of the start are thus out of it. What it
    contains is all else: the drift of the inertial filter; steps that a detector missed, added or reported
    after the epoch, which is the last still reading of a stance; and the jumps of the truth, up to 0.1 m. It
    is no lower bound of the mean error from the noted start, as the fit minimises squares. A fit also takes
    up some of a drift, the more the fewer the epochs; a recording with fewer than three has none.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the recordings by path.
    """
    parts = []
    for answer in answers(estimates, worlds):
        position_m = np.asarray(answer.estimates["position_m"], dtype=float)
        true_m = np.asarray(answer.truth["truth.position_m"], dtype=float)
        asked = np.isfinite(position_m).all(axis=-1) & np.isfinite(true_m).all(axis=-1)
        if position_m.ndim != 3 or (asked.sum(axis=1) < 3).any():
            continue
        angle_rad, shift_m = rigid_fit(position_m, true_m, asked)
        fitted_m = rotated(position_m, angle_rad[:, None]) + shift_m[:, None]
        error_m = np.linalg.norm(fitted_m - true_m, axis=-1)
        parts.append(lines(answer, [("rigid_mean_m", mean_where(error_m, asked))]))
    return table(parts)
