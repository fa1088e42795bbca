"""What the Bluetooth paper counts beside errors: its six runs, its trials of ranging, its trilaterations.

See Raghavan et al., Tables I and II. A world holds six runs as Table II has them; what belongs to one run
has its number in the name of the metric.
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
Measured = Iterator[tuple[str, Values]]

ROWS = ("robot",)
"""Rows of the measures that are no algorithms."""

REFERENCE, FIXES = "trilateration_alone", "iterative_fractional_printed"
"""The errors of the former, at epochs at which the latter has a solution, tell which are outliers."""

OUTLIERS = 0.75
"""An epoch is an outlier above this quantile of its world."""

NEAR_M, FAR_M = 2.0, 4.0
"""Ends of what counts as a short distance, and as a long one."""

NEAREST_M = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Lower ends of the classes of smallest distance, metres, for the share of iterations that converge."""


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the study's own measures, one value a world, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the worlds by path, ``.../<batch>/<side>.npz``.

    Returns
    -------
    DataFrame
        Of the pseudo-row ``robot``: ``iterations_<run>``, ``iterations_mean``. Of ranging rows:
        ``trial_<run>_m``, ``trials_mean_m``, ``trials_sd_m``, ``nearest_m`` (the candidate nearest to the
        truth, which nobody can know), ``near_m`` and ``far_m`` (of short and of long distances),
        ``candidates``, ``k_<run>``, ``k_mean``, ``k_outlier`` and ``k_usual`` (at the epochs whose levels
        are farthest from the calibration curve, and at the others). Of trilateration rows:
        ``outputs_m`` (mean error of all outputs), ``solver_iterations``, ``converged`` and, by class of the
        smallest distance, ``converged_<class>``. Of tracking rows: ``final_<run>_m``,
        ``final_mean_m``, ``final_sd_m`` (population, as in the paper), ``outlier_m``.
    """
    sides = {(Path(p).parent.name, Path(p).stem): tree for p, tree in worlds.items()}
    lines: list[pd.DataFrame] = []
    batches = sorted({Path(path).stem for path in estimates})
    for batch in batches:
        truths = sides[(batch, "truth")]
        own = {Path(p).parent.name: tree for p, tree in estimates.items() if Path(p).stem == batch}
        for family, truth in truths.items():
            true_m = np.asarray(truth["truth.position_m"], dtype=float)
            runs = true_m[:, None] if true_m.ndim == 3 else true_m
            lines += [
                _lines(family, "robot", np.nan, truth["world"], name, values) for name, values in _robot(runs)
            ]
            outlier = _outliers(own, family, runs)
            off_curve = _off_curve(sides[(batch, "observed")][family], truth, runs.shape)
            for row, tree in own.items():
                for branch, step in tree.items():
                    if branch.rpartition("/")[0] == family and not str(step["skipped"]):
                        count = len(step["world"])
                        seen = None if outlier is None else outlier[:count]
                        shown = {n: v[:count] for n, v in truth.items()}
                        odd = None if off_curve is None else off_curve[:count]
                        found = _of_row(step, shown, runs[:count], seen, odd)
                        lines += [
                            _lines(family, row, float(step["value"]), step["world"], name, values)
                            for name, values in found
                        ]
    return pd.concat(lines, ignore_index=True)


def _lines(
    family: str, row: str, value: float, world: NDArray[np.generic], metric: str, x: Values
) -> pd.DataFrame:
    frame = pd.DataFrame(
        {"family": family, "algorithm": row, "value": value, "world": world, "metric": metric, "x": x}
    )
    return frame[frame["x"].notna()][MEASURES]


def _robot(true_m: Values) -> Measured:
    """Numbers of iterations of the runs of true positions [w, run, n, 2]."""
    counts = np.count_nonzero(~np.isnan(true_m[..., 0]), axis=-1).astype(float)
    yield from _by_run("iterations_{}", counts)
    yield "iterations_mean", counts.mean(axis=1)


def _of_row(
    step: Mapping[str, NDArray[np.generic]],
    truth: Mapping[str, NDArray[np.generic]],
    true_m: Values,
    outlier: NDArray[np.bool_] | None,
    off_curve: NDArray[np.bool_] | None,
) -> Measured:
    if "estimate.range_m" in step:
        yield from _ranging(step, truth, true_m.shape, off_curve)
    elif "estimate.output_m" in step:
        yield from _trilateration(step, true_m)
    elif "estimate.covariance_m2" in step:
        yield from _tracking(step, true_m, outlier)


def _ranging(
    step: Mapping[str, NDArray[np.generic]],
    truth: Mapping[str, NDArray[np.generic]],
    shape: tuple[int, ...],
    off_curve: NDArray[np.bool_] | None,
) -> Measured:
    range_m = np.asarray(step["estimate.range_m"], dtype=float)
    range_m = range_m.reshape(*shape[:3], *range_m.shape[-2:])
    true_m = np.asarray(truth["truth.distance_m"], dtype=float).reshape(range_m.shape[:-1])
    error_m = np.abs(range_m - true_m[..., None])
    given = ~np.isnan(error_m)
    trials_m = mean_where(error_m, given, axis=(2, 3, 4))
    nearest_m = np.where(given, error_m, np.inf).min(axis=-1)
    for name, chosen in (("near_m", true_m < NEAR_M), ("far_m", true_m >= FAR_M)):
        yield name, mean_where(error_m, given & chosen[..., None], axis=(1, 2, 3, 4))
    candidates = np.count_nonzero(~np.isnan(range_m), axis=-1)
    heard = ~np.isnan(true_m)
    yield from _by_run("trial_{}_m", trials_m)
    ranged = ~np.isnan(trials_m)
    mean_m = mean_where(trials_m, ranged)
    yield "trials_mean_m", mean_m
    yield "trials_sd_m", np.sqrt(mean_where(np.square(trials_m - mean_m[:, None]), ranged))
    yield "nearest_m", mean_where(nearest_m, np.isfinite(nearest_m), axis=(1, 2, 3))
    yield "candidates", candidates.sum(axis=(1, 2, 3)) / heard.sum(axis=(1, 2, 3))
    epochs = heard.any(axis=-1)
    combinations = np.where(epochs, candidates.prod(axis=-1), 0)
    trilaterations = combinations.sum(axis=2) / epochs.sum(axis=2)
    if off_curve is not None:
        yield "k_outlier", mean_where(combinations, epochs & off_curve, axis=(1, 2))
        yield "k_usual", mean_where(combinations, epochs & ~off_curve, axis=(1, 2))
    yield from _by_run("k_{}", trilaterations)
    yield "k_mean", trilaterations.mean(axis=1)


def _trilateration(step: Mapping[str, NDArray[np.generic]], true_m: Values) -> Measured:
    output_m = np.asarray(step["estimate.output_m"], dtype=float)
    sample = np.asarray(step["estimate.output_sample"], dtype=np.int64)
    given, worlds = sample >= 0, np.arange(len(sample))[:, None]
    error_m = np.linalg.norm(output_m - true_m.reshape(len(true_m), -1, 2)[worlds, sample], axis=-1)
    yield "outputs_m", mean_where(error_m, given & ~np.isnan(error_m))
    iterations = np.asarray(step["estimate.output_iterations"], dtype=np.int64)
    if not iterations.any():
        return
    converged, nearest_m = iterations > 0, np.asarray(step["estimate.output_nearest_m"], dtype=float)
    yield "solver_iterations", mean_where(iterations, given & converged)
    yield "converged", mean_where(converged, given)
    ends_m = (*NEAREST_M[1:], np.inf)
    for number, (low_m, high_m) in enumerate(zip(NEAREST_M, ends_m, strict=True)):
        yield (
            f"converged_{number}",
            mean_where(converged, given & (nearest_m >= low_m) & (nearest_m < high_m)),
        )


def _tracking(
    step: Mapping[str, NDArray[np.generic]], true_m: Values, outlier: NDArray[np.bool_] | None
) -> Measured:
    error_m = _errors(step, true_m)
    last = np.count_nonzero(~np.isnan(error_m), axis=-1) - 1
    final_m = np.take_along_axis(error_m, last[..., None], axis=-1)[..., 0]
    yield from _by_run("final_{}_m", final_m)
    yield "final_mean_m", final_m.mean(axis=1)
    yield "final_sd_m", final_m.std(axis=1)
    if outlier is not None:
        yield "outlier_m", mean_where(error_m.reshape(len(error_m), -1), outlier)


def _outliers(own: Mapping[str, Tree], family: str, true_m: Values) -> NDArray[np.bool_] | None:
    """Epochs with a fix [w, run * n] at which trilateration alone is far off; None where it did not run."""
    step = own.get(REFERENCE, {}).get(f"{family}/0")
    if step is None or str(step["skipped"]):
        return None
    error_m = _errors(step, true_m)
    error_m = error_m.reshape(len(error_m), -1)
    fixes = own.get(FIXES, {}).get(f"{family}/0")
    if fixes is not None and not str(fixes["skipped"]):
        solved_m = np.asarray(fixes["estimate.position_m"], dtype=float).reshape(*error_m.shape, 2)
        error_m = np.where(np.isnan(solved_m[..., 0]), np.nan, error_m)
    return _above(error_m)


def _off_curve(
    observed: Mapping[str, NDArray[np.generic]],
    truth: Mapping[str, NDArray[np.generic]],
    shape: tuple[int, ...],
) -> NDArray[np.bool_] | None:
    """Epochs [w, run, n] whose levels lie far from the calibration curve at the true distances."""
    if "calibration.rss_dbm" not in observed or "recording.rss_dbm" not in observed:
        return None
    curve_m, curve_dbm = (
        np.asarray(observed[f"calibration.{n}"], dtype=float) for n in ("distance_m", "rss_dbm")
    )
    true_m = np.asarray(truth["truth.distance_m"], dtype=float).reshape(*shape[:3], -1)
    expected_dbm = np.stack(
        [np.interp(m, *curve) for m, *curve in zip(true_m, curve_m, curve_dbm, strict=True)]
    )
    rss_dbm = np.asarray(observed["recording.rss_dbm"], dtype=float).reshape(true_m.shape)
    off_db = np.abs(rss_dbm - expected_dbm).max(axis=-1).reshape(shape[0], -1)
    return _above(off_db).reshape(shape[:3])


def _above(values: Values) -> NDArray[np.bool_]:
    """Tell which values [w, n] exceed the quantile `OUTLIERS` of their world; NaN does not."""
    limit = np.full((len(values), 1), np.inf)
    some = ~np.isnan(values).all(axis=1)
    limit[some] = np.nanquantile(values[some], OUTLIERS, axis=1, keepdims=True)
    return np.asarray(values > limit)


def _errors(step: Mapping[str, NDArray[np.generic]], true_m: Values) -> Values:
    position_m = np.asarray(step["estimate.position_m"], dtype=float).reshape(true_m.shape)
    return np.asarray(np.linalg.norm(position_m - true_m, axis=-1))


def _by_run(name: str, values: Values) -> Measured:
    for run in range(values.shape[1]):
        yield name.format(run + 1), values[:, run]
