"""Trilateration: from distances to known places to a position, epoch by epoch."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.fixes import locate
from positioning.model import Arrays
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
        all outputs of a world, filled up: ``output_m`` [world, t, 2], ``output_residual_m`` [world, t],
        ``output_sample`` [world, t] (epoch
        over all runs, -1 fills up), ``output_nearest_m`` [world, t], the smallest distance, and
        ``output_iterations`` [world, t], -1 with an output of NaN where the solver did not converge.
    """
    if "recording.time_s" not in observed:
        return Outcome(skipped="there is no recording")
    stacked = stack(observed, None, generators)
    if stacked.site.access_point_m is None:
        return Outcome(skipped="the places of the beacons are not known")
    start = perf_counter()
    if stacked.calibration is None and stacked.recording.range_m is None:
        return Outcome(skipped="there are neither distances nor a calibration run to learn them from")
    ranging = build(options.get("ranging") or DEFAULT_RANGING)
    try:
        fixes = locate(ranging, make(), stacked.calibration, stacked.recording, stacked.site)
    except TooManyCombinations as error:
        return Outcome(skipped=str(error))
    seconds = np.full(len(generators), (perf_counter() - start) / len(generators))

    best_m, given = fixes.least_residual(), ~np.isnan(fixes.nearest_m)
    if not np.isfinite(fixes.position_m[given & (fixes.iterations >= 0)]).all():
        raise InputError("its answer", "a solved position is not finite", "Correct the algorithm")
    worlds = len(generators)
    sample = np.arange(given[..., 0].size // worlds).reshape(-1, 1) * np.ones(given.shape[-1], dtype=int)
    sample = np.broadcast_to(sample, (worlds, *sample.shape)).reshape(given.shape)
    given = given.reshape(worlds, -1)
    most = int(given.sum(axis=1).max(initial=0))
    kept: dict[str, tuple[NDArray[Any], float]] = {
        "output_m": (fixes.position_m, np.nan),
        "output_residual_m": (fixes.residual_m, np.nan),
        "output_nearest_m": (fixes.nearest_m, np.nan),
        "output_iterations": (fixes.iterations.astype(np.int32), 0),
        "output_sample": (sample.astype(np.int32), -1),
    }
    outputs = {name: _packed(values, given, most, fill) for name, (values, fill) in kept.items()}
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


def _packed(
    values: NDArray[np.generic], given: NDArray[np.bool_], most: int, fill: float
) -> NDArray[np.generic]:
    """Return what is given of each world, [world, most, ...], in its order, filled up."""
    parts = values.reshape(*given.shape, *values.shape[3:])
    packed = np.full((len(given), most, *parts.shape[2:]), fill, dtype=values.dtype)
    for own, part, row in zip(given, parts, packed, strict=True):
        row[: np.count_nonzero(own)] = part[own]
    return packed
