"""Ranging: from a received strength to the distances that it may stand for, with a calibration run."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Arrays, Calibration, Recording, world
from positioning.ranging import check_candidates
from positioning.registry import Factory
from positioning.tasks import Outcome

OPTIONS: tuple[str, ...] = ()
QUANTITY = "distance"


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run a ranging algorithm on every world of a stack.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays of `Calibration` and `Recording`, with a world axis.
    truth, options
        Not used.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``range_m`` [world, ..., n, beacon, candidate], metres; NaN fills up.

    Raises
    ------
    InputError
        For data without a calibration run, or an answer of the wrong shape.
    """
    ranges, seconds = [], []
    for index in range(len(generators)):
        arrays = world(observed, index)
        calibration, recording = Calibration.from_arrays(arrays), Recording.from_arrays(arrays)
        if calibration is None or recording is None or recording.rss_dbm is None:
            return Outcome(skipped="there is no calibration run with received strengths")
        start = perf_counter()
        algorithm = make().fit(calibration.distance_m, calibration.rss_dbm)
        found = np.asarray(algorithm.distances(recording.rss_dbm), dtype=float)
        seconds.append(perf_counter() - start)
        ranges.append(check_candidates(found, recording.rss_dbm.shape, "its answer"))
    most = max(found.shape[-1] for found in ranges)
    filled = [
        np.pad(found, [(0, 0)] * (found.ndim - 1) + [(0, most - found.shape[-1])], constant_values=np.nan)
        for found in ranges
    ]
    return Outcome(estimates={"range_m": np.stack(filled)}, seconds=np.asarray(seconds))


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the error of every candidate distance, [world, sample], metres.

    A sample is an epoch, a beacon and a candidate; ``error_distance_m`` has the sign, measured less true.
    """
    if "truth.distance_m" not in truth:
        raise InputError(
            "truth of a recording",
            "it holds no distance_m, with which ranging is compared",
            "Let the adapter give truth.distance_m, from each true place to each beacon",
        )
    offset = np.asarray(estimates["range_m"], dtype=float) - np.asarray(truth["truth.distance_m"])[..., None]
    offset = offset.reshape(len(offset), -1)
    return {"error_m": np.abs(offset), "error_distance_m": offset}
