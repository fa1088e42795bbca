"""What the RISS/WiFi paper counts beside errors at way-points: shares, smoothness, evaluations of weights.

See Atia et al., sections 5.4 and 6.5, Figures 16 to 23.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from positioning.evaluation.statistics import mean_where
from positioning.evaluation.tracks import Answer, Named, answers, lines, of_track, share, table
from positioning.files import Tree

ACCURACY_M = 1.0
"""The error of which the paper tells the share of time."""


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the study's own measures of every row, one value a world, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the worlds by path, ``.../<batch>/<side>.npz``.

    Returns
    -------
    DataFrame
        ``within_1m``: share of way-points with an error of at most 1 m. ``worst_rms_m``: root mean square
        error of the others, absent where there are none. ``weight_evaluations``: weights computed at all
        epochs. With those of `positioning.evaluation.tracks.of_track`.
    """
    return table(lines(answer, _of_row(answer)) for answer in answers(estimates, worlds))


def _of_row(answer: Answer) -> Iterator[Named]:
    position_m = np.asarray(answer.estimates["position_m"], dtype=float)
    asked_m, path_m = (
        np.asarray(answer.truth[f"truth.{name}"], dtype=float) for name in ("position_m", "path_m")
    )
    error_m = np.linalg.norm(position_m - asked_m, axis=-1)
    asked = ~np.isnan(error_m)
    near = asked & (error_m <= ACCURACY_M)
    yield "within_1m", share(near, asked)
    yield "worst_rms_m", np.sqrt(mean_where(np.square(error_m), asked & ~near))
    yield from of_track(position_m, asked_m, path_m)
    if "extra_weight_evaluations" in answer.estimates:
        evaluations = np.asarray(answer.estimates["extra_weight_evaluations"], dtype=float)
        yield "weight_evaluations", np.nansum(evaluations, axis=1)
