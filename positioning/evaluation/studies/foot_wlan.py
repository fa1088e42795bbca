"""What the WLAN and foot-mounted inertial paper counts: shares of small and large errors, steps, drift.

See Frank et al., section 5.3 and Figure 7.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from positioning.evaluation.statistics import mean_where
from positioning.evaluation.tracks import Answer, Named, Values, answers, lines, of_track, share, table
from positioning.files import Tree

SMALL_M, LARGE_M, ABOUT_ONE_M = 0.5, 4.0, (0.5, 1.5)
"""Errors of which the paper tells the share; the span about one metre is assumed here."""

WLAN = "wlan"
"""The row with whose errors those of others are correlated."""


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
        Of passages of marks: ``within_05m``, ``over_4m``, ``about_1m``, shares of errors; ``sd_m``, their
        standard deviation; ``on_points_m``, the mean error at passages of calibration points instead;
        ``first_lap_m`` and ``last_lap_m``, means of the first and the last quarter of the passages;
        ``wlan_correlation``, of the errors with those of the row `wlan` in the same world.
        Of all epochs: ``heading_deg``, mean error of the heading without sign; those of
        `positioning.evaluation.tracks.of_track`. ``steps_per_stride``: steps found for each true stride.
    """
    found = list(answers(estimates, worlds))
    errors = {(a.family, a.batch): _error_m(a) for a in found if a.row == WLAN and np.isnan(a.value)}
    return table(
        lines(answer, _of_row(answer, errors.get((answer.family, answer.batch)))) for answer in found
    )


def _error_m(answer: Answer, true: str = "position_m") -> Values:
    position_m = np.asarray(answer.estimates["position_m"], dtype=float)
    return np.asarray(np.linalg.norm(position_m - np.asarray(answer.truth[f"truth.{true}"]), axis=-1))


def _of_row(answer: Answer, wlan_m: Values | None) -> Iterator[Named]:
    error_m = _error_m(answer)
    asked = ~np.isnan(error_m)
    yield "within_05m", share(error_m < SMALL_M, asked)
    yield "over_4m", share(error_m > LARGE_M, asked)
    yield "about_1m", share((error_m >= ABOUT_ONE_M[0]) & (error_m <= ABOUT_ONE_M[1]), asked)
    mean_m = mean_where(error_m, asked)
    yield "sd_m", np.sqrt(mean_where(np.square(error_m - mean_m[:, None]), asked))
    order = (np.cumsum(asked, axis=1) - 1) / np.maximum(asked.sum(axis=1, keepdims=True), 1)
    yield "first_lap_m", mean_where(error_m, asked & (order < 0.25))
    yield "last_lap_m", mean_where(error_m, asked & (order >= 0.75))
    if "truth.on_point_m" in answer.truth:
        on_m = _error_m(answer, "on_point_m")
        yield "on_points_m", mean_where(on_m, ~np.isnan(on_m))
    if wlan_m is not None and answer.row != WLAN:
        yield "wlan_correlation", _correlation(error_m, wlan_m[: len(error_m)])
    if "extra_heading_rad" in answer.estimates:
        heading_rad = np.asarray(answer.estimates["extra_heading_rad"], dtype=float)
        off_rad = heading_rad - np.asarray(answer.truth["truth.heading_rad"], dtype=float)
        off_deg = np.degrees(np.abs(np.angle(np.exp(1j * off_rad))))
        yield "heading_deg", mean_where(off_deg, ~np.isnan(off_deg))
    if "extra_step_time_s" in answer.estimates and "truth.stance_time_s" in answer.truth:
        steps = np.count_nonzero(
            ~np.isnan(np.asarray(answer.estimates["extra_step_time_s"], dtype=float)), axis=1
        )
        stances = np.count_nonzero(~np.isnan(np.asarray(answer.truth["truth.stance_time_s"])[..., 0]), axis=1)
        yield "steps_per_stride", steps / (stances - 1.0)
    yield from of_track(
        np.asarray(answer.estimates["position_m"], dtype=float),
        np.asarray(answer.truth["truth.position_m"], dtype=float),
        np.asarray(answer.truth["truth.path_m"], dtype=float),
    )


def _correlation(first: Values, second: Values) -> Values:
    """Return the correlation of two errors over the passages of each world; NaN where one does not vary."""
    asked = ~np.isnan(first) & ~np.isnan(second)
    a, b = (values - mean_where(values, asked)[:, None] for values in (first, second))
    covariance = mean_where(a * b, asked)
    scale = np.sqrt(mean_where(a * a, asked) * mean_where(b * b, asked))
    return np.asarray(np.divide(covariance, scale, out=np.full(len(scale), np.nan), where=scale > 1e-12))
