"""From received strengths to position fixes: all candidate distances, all combinations, one solver.

See Raghavan et al., sections II.B and III: a level of the curve may belong to several distances, so that an
epoch gives several combinations of one distance a beacon, and each combination a fix of its own.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array, Arrays, Calibration, Recording, Site
from positioning.ranging import check_candidates, combinations


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """The fixes of a stack of recordings; NaN fills up where an epoch has fewer than others.

    Attributes
    ----------
    position_m
        Solution of each combination of distances, [r, n, k, 2], metres; NaN where an iteration did not
        converge: it has no output.
    residual_m
        Root mean square of measured distance less distance from the solution, [r, n, k], metres.
    nearest_m
        Smallest distance of each combination, [r, n, k], metres; NaN where the recording holds the fixes.
    iterations
        Iterations of the solver, [r, n, k]; -1 where it did not converge, 0 where it does not iterate
        and where there was nothing to solve.
    """

    position_m: Array
    residual_m: Array
    nearest_m: Array
    iterations: NDArray[np.int64]

    @property
    def count(self) -> NDArray[np.int64]:
        """How many fixes each epoch has, [r, n]."""
        return np.asarray(np.count_nonzero(~np.isnan(self.residual_m), axis=-1), dtype=np.int64)

    def least_residual(self) -> Array:
        """Return the fix of each epoch whose distances fit best, [r, n, 2], metres; NaN where none is."""
        filled = np.where(np.isnan(self.residual_m), np.inf, self.residual_m)
        best = np.argmin(filled, axis=-1)[..., None, None]
        return np.take_along_axis(self.position_m, best, axis=-2)[..., 0, :]


def locate(
    ranging: Any, trilateration: Any, calibration: Calibration | None, recording: Recording, site: Site
) -> Fixes:
    """Solve every combination of candidate distances of every epoch of a stack of recordings.

    Parameters
    ----------
    ranging
        Turns received strengths into candidate distances; learns from each recording's calibration. Not
        used where the recording holds distances.
    trilateration
        The solver.
    calibration
        Stack [r, m].
    recording
        Stack [r, n, ap].
    site
        Stack with the places of the beacons, [r, ap, 2].

    Returns
    -------
    Fixes
        Those of the recording itself, where it holds fixes.

    Raises
    ------
    InputError
        Where the places of the beacons are not known, or there is nothing to learn distances from.
    """
    if recording.fix_m is not None:
        # Fixes without residuals fit equally well.
        residual_m = recording.fix_residual_m
        if residual_m is None:
            residual_m = np.where(np.isnan(recording.fix_m).any(axis=-1), np.nan, 0.0)
        return Fixes(
            position_m=recording.fix_m,
            residual_m=residual_m,
            nearest_m=np.full(residual_m.shape, np.nan),
            iterations=np.zeros(residual_m.shape, dtype=np.int64),
        )
    if site.access_point_m is None:
        raise InputError("site", "the places of the beacons are not known", "Give access_point_m")
    if recording.range_m is not None:
        candidates = [np.asarray(ranges, dtype=float)[..., None] for ranges in recording.range_m]
    elif recording.rss_dbm is not None and calibration is not None:
        whose = f"answer of the ranging {type(ranging).__name__}"
        candidates = [
            check_candidates(ranging.fit(distance_m, rss_dbm).distances(heard_dbm), heard_dbm.shape, whose)
            for distance_m, rss_dbm, heard_dbm in zip(
                calibration.distance_m, calibration.rss_dbm, recording.rss_dbm, strict=True
            )
        ]
    else:
        raise InputError(
            "recording",
            "it holds neither fixes, nor distances, nor received strengths with a calibration",
            "Give fix_m, range_m, or rss_dbm and a calibration run",
        )
    parts = [combinations(candidate) for candidate in candidates]
    range_m = np.concatenate([part[0] for part in parts])
    epoch = np.concatenate([part[1] for part in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part[1]) for part in parts])
    position_m, iterations = _solved(trilateration, site.access_point_m, range_m, owner)
    distance_m = pairwise_distance_m(position_m[:, None, :], site.access_point_m[owner])[:, 0, :]
    residual_m = _root_mean_square(range_m - distance_m)
    shape = recording.time_s.shape
    slot = _slots(owner * shape[1] + epoch)
    place = (owner, epoch, slot)
    most = int(slot.max(initial=0)) + 1
    fixes = Fixes(
        position_m=np.full((*shape, most, 2), np.nan),
        residual_m=np.full((*shape, most), np.nan),
        nearest_m=np.full((*shape, most), np.nan),
        iterations=np.zeros((*shape, most), dtype=np.int64),
    )
    fixes.position_m[place] = position_m
    fixes.residual_m[place] = residual_m
    fixes.nearest_m[place] = np.nanmin(range_m, axis=-1, initial=np.inf)
    fixes.iterations[place] = iterations
    return fixes


def of_outputs(estimates: Arrays, time_s: Array) -> dict[str, Array]:
    """Return the outputs of a trilateration row as fixes of the recordings that it ran on.

    Parameters
    ----------
    estimates
        ``output_m`` [world, t, 2], ``output_residual_m`` and ``output_sample`` [world, t], as the task
        trilateration leaves them.
    time_s
        Times of the recordings, [world, ..., n].

    Returns
    -------
    dict
        ``recording.fix_m`` [world, ..., n, k, 2] and ``recording.fix_residual_m`` [world, ..., n, k].
    """
    output_m = np.asarray(estimates["output_m"], dtype=float)
    residual_m = np.asarray(estimates["output_residual_m"], dtype=float)
    sample = np.asarray(estimates["output_sample"], dtype=np.int64)
    world, output = np.nonzero((sample >= 0) & ~np.isnan(residual_m))
    epochs = time_s[0].size
    epoch = world * epochs + sample[world, output]
    slot = _slots(epoch)
    most = int(slot.max(initial=0)) + 1
    fix_m = np.full((time_s.size, most, 2), np.nan)
    fix_residual_m = np.full((time_s.size, most), np.nan)
    fix_m[epoch, slot], fix_residual_m[epoch, slot] = output_m[world, output], residual_m[world, output]
    return {
        "recording.fix_m": fix_m.reshape(*time_s.shape, most, 2),
        "recording.fix_residual_m": fix_residual_m.reshape(*time_s.shape, most),
    }


def _solved(
    trilateration: Any, beacon_m: Array, range_m: Array, owner: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int64]]:
    """Solve all combinations [t, ap]: those that share their beacons in one call."""
    position_m = np.full((len(owner), 2), np.nan)
    iterations = np.zeros(len(owner), dtype=np.int64)
    layouts, layout = np.unique(beacon_m.reshape(len(beacon_m), -1), axis=0, return_inverse=True)
    for number, beacons in enumerate(layouts.reshape(-1, *beacon_m.shape[1:])):
        own = layout.reshape(-1)[owner] == number
        if own.any():
            solved = np.asarray(trilateration.solve(beacons, range_m[own]), dtype=float)
            if solved.shape != (np.count_nonzero(own), 2):
                raise InputError(
                    f"answer of the trilateration {type(trilateration).__name__}",
                    f"shape {solved.shape} for ranges {range_m[own].shape}",
                    "Return [..., 2] in metres",
                )
            position_m[own] = solved
            iterations[own] = getattr(trilateration, "iterations_", 0)
    position_m[iterations < 0] = np.nan
    return position_m, iterations


def _root_mean_square(values: Array) -> Array:
    """Root mean square over the last axis, leaving out NaN; NaN where there is nothing else."""
    given = ~np.isnan(values)
    count = given.sum(axis=-1)
    total = np.where(given, np.square(values), 0.0).sum(axis=-1)
    mean: Array = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    return np.sqrt(mean)


def _slots(epoch: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the combinations within their epoch: 0, 1, ... in the order in which they stand."""
    order = np.argsort(epoch, kind="stable")
    ordered = epoch[order]
    first = np.searchsorted(ordered, ordered, side="left")
    slots = np.empty(len(epoch), dtype=np.int64)
    slots[order] = np.arange(len(epoch)) - first
    return slots
