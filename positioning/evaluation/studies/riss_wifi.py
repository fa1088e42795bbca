"""What the RISS/WiFi paper counts beside errors at way-points: shares, smoothness, evaluations of weights.

See Atia et al., sections 5.4 and 6.5, Figures 16 to 23.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.measures import MEASURES
from positioning.evaluation.statistics import mean_where
from positioning.files import Tree

Values = NDArray[np.float64]

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
        error of the others, absent where there are none. ``first_quarter_m``, ``first_half_m`` and
        ``second_half_m``: mean error at the epochs of these parts of the drive. ``final_m``: error at
        the last way-point. ``path_mean_m``: mean error at all epochs. ``jump_m``: root mean square of how
        far a step of the track differs from the true one. ``weight_evaluations``: weights
        computed at all epochs.
    """
    truths = {Path(p).parent.name: tree for p, tree in worlds.items() if Path(p).stem == "truth"}
    lines = []
    for path, tree in estimates.items():
        row, batch = Path(path).parent.name, Path(path).stem
        for branch, step in tree.items():
            if str(step["skipped"]):
                continue
            family, count = branch.rpartition("/")[0], len(step["world"])
            truth = {name: values[:count] for name, values in truths[batch][family].items()}
            for metric, values in _of_row(step, truth):
                kept = ~np.isnan(values)
                lines.append(
                    pd.DataFrame(
                        {
                            "family": family,
                            "algorithm": row,
                            "value": float(step["value"]),
                            "world": step["world"][kept],
                            "metric": metric,
                            "x": values[kept],
                        }
                    )
                )
    return pd.concat(lines, ignore_index=True)[MEASURES] if lines else pd.DataFrame(columns=MEASURES)


def _of_row(
    step: Mapping[str, NDArray[np.generic]], truth: Mapping[str, NDArray[np.generic]]
) -> Iterator[tuple[str, Values]]:
    position_m = np.asarray(step["estimate.position_m"], dtype=float)
    asked_m, path_m = (np.asarray(truth[f"truth.{name}"], dtype=float) for name in ("position_m", "path_m"))
    error_m = np.linalg.norm(position_m - asked_m, axis=-1)
    asked = ~np.isnan(error_m)
    near = asked & (error_m <= ACCURACY_M)
    yield "within_1m", near.sum(axis=1) / asked.sum(axis=1)
    yield "worst_rms_m", np.sqrt(mean_where(np.square(error_m), asked & ~near))
    last = asked.shape[1] - 1 - np.argmax(asked[:, ::-1], axis=1)
    yield "final_m", np.take_along_axis(error_m, last[:, None], axis=1)[:, 0]
    everywhere_m = np.linalg.norm(position_m - path_m, axis=-1)
    known = ~np.isnan(everywhere_m)
    yield "path_mean_m", mean_where(everywhere_m, known)
    part = np.arange(known.shape[1]) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    for name, chosen in (("first_quarter", part < 0.25), ("first_half", part < 0.5)):
        yield f"{name}_m", mean_where(everywhere_m, known & chosen)
    yield "second_half_m", mean_where(everywhere_m, known & (part >= 0.5))
    jump_m = np.linalg.norm(np.diff(position_m - path_m, axis=1), axis=-1)
    yield "jump_m", np.sqrt(mean_where(np.square(jump_m), ~np.isnan(jump_m)))
    if "estimate.extra_weight_evaluations" in step:
        evaluations = np.asarray(step["estimate.extra_weight_evaluations"], dtype=float)
        yield "weight_evaluations", np.nansum(evaluations, axis=1)
