"""Trilateration: from distances to known places to a position, epoch by epoch."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.fixes import locate
from positioning.model import Arrays, Calibration
from positioning.ranging import TooManyCombinations
from positioning.registry import Factory, build
from positioning.stacks import stack
from positioning.tasks import Outcome

OPTIONS = ("ranging",)
QUANTITY = "position"
DEFAULT_RANGING = {"use": "curve_crossings", "task": "ranging"}


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run a trilateration algorithm on all epochs of a stack of worlds at once.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays of `Recording`, `Site`, and `Calibration` where distances must be learned.
    truth
        Not used.
    options
        ``ranging``: the algorithm that gives the candidate distances, by default all crossings of the
        calibration curve. A recording that holds distances needs none.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``position_m`` [world, ..., n, 2], the output of each epoch whose distances fit best; and of
        all outputs of a world, filled up: ``output_m`` [world, t, 2], ``output_sample`` [world, t] (epoch
        over all runs, -1 fills up), ``output_nearest_m`` [world, t], the smallest distance, and
        ``output_iterations`` [world, t], -1 with an output of NaN where the solver did not converge.
    """
    stacked = stack(observed, None, generators)
    if stacked.site.access_point_m is None:
        return Outcome(skipped="the places of the beacons are not known")
    start = perf_counter()
    survey = stacked.survey if isinstance(stacked.survey, Calibration) else None
    if survey is None and stacked.recording.range_m is None:
        return Outcome(skipped="there are neither distances nor a calibration run to learn them from")
    ranging = build(options.get("ranging") or DEFAULT_RANGING)
    try:
        fixes = locate(ranging, make(), survey, stacked.recording, stacked.site)
    except TooManyCombinations as error:
        return Outcome(skipped=str(error))
    seconds = np.full(len(generators), (perf_counter() - start) / len(generators))

    best_m, given = fixes.least_residual(), ~np.isnan(fixes.nearest_m)
    if not np.isfinite(fixes.position_m[given & (fixes.iterations >= 0)]).all():
        raise InputError("its answer", "a solved position is not finite", "Correct the algorithm")
    worlds = len(generators)
    given = given.reshape(worlds, -1)
    sample = np.broadcast_to(
        np.arange(given[0].size // fixes.residual_m.shape[-1])[:, None], (*_flat(fixes.residual_m, worlds),)
    ).reshape(-1)
    most = int(given.sum(axis=1).max(initial=0))
    outputs = {
        "output_m": np.full((worlds, most, 2), np.nan),
        "output_sample": np.full((worlds, most), -1, dtype=np.int32),
        "output_nearest_m": np.full((worlds, most), np.nan),
        "output_iterations": np.zeros((worlds, most), dtype=np.int32),
    }
    position_m = fixes.position_m.reshape(worlds, -1, 2)
    nearest_m, iterations = fixes.nearest_m.reshape(worlds, -1), fixes.iterations.reshape(worlds, -1)
    for index, own in enumerate(given):
        count = np.count_nonzero(own)
        outputs["output_m"][index, :count] = position_m[index, own]
        outputs["output_sample"][index, :count] = sample[own]
        outputs["output_nearest_m"][index, :count] = nearest_m[index, own]
        outputs["output_iterations"][index, :count] = iterations[index, own]
    return Outcome(estimates={"position_m": stacked.unstacked(best_m), **outputs}, seconds=seconds)


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the error of each epoch, [world, epoch over all runs], metres.

    ``error_m`` is that of the output whose distances fit best, NaN where an epoch has none;
    ``error_outputs_m`` the mean over all outputs of the epoch.
    """
    true_m = np.asarray(truth["truth.position_m"], dtype=float)
    true_m = true_m.reshape(len(true_m), -1, 2)
    offset = np.asarray(estimates["position_m"], dtype=float).reshape(true_m.shape) - true_m
    sample = np.asarray(estimates["output_sample"], dtype=np.int64)
    worlds = np.arange(len(sample))[:, None]
    error_m = np.linalg.norm(np.asarray(estimates["output_m"], dtype=float) - true_m[worlds, sample], axis=-1)
    given = (sample >= 0) & ~np.isnan(error_m)
    total, count = np.zeros(true_m.shape[:2]), np.zeros(true_m.shape[:2])
    at = (np.broadcast_to(worlds, sample.shape)[given], sample[given])
    np.add.at(total, at, error_m[given])
    np.add.at(count, at, 1)
    # An output of an epoch behind the end of a run cannot exist: its reading is NaN.
    mean_m = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return {
        "error_m": np.hypot(offset[..., 0], offset[..., 1]),
        "error_x_m": offset[..., 0],
        "error_y_m": offset[..., 1],
        "error_outputs_m": mean_m,
    }


def _flat(values: NDArray[np.float64], worlds: int) -> tuple[int, int]:
    return values.size // worlds // values.shape[-1], values.shape[-1]
