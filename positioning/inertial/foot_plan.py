"""The plan of a foot's navigation: at which readings the filter stops, and what it takes in there.

See Frank et al., section 3.2. Between two stops nothing is measured.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.foot_alignment import Alignment
from positioning.inertial.foot_checks import sample_rate_hz
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.rest import Flags
from positioning.model import Array, Recording

# So many samples are taken as one at most: what is prepared at a time stays small.
_MOST_MERGED = 256


class Fixes(NamedTuple):
    """Positions in the plane from elsewhere, at the epochs of a recording.

    Attributes
    ----------
    position_m
        [r, n, 2]; NaN where there is none.
    covariance_m2
        [r, n, 2, 2].
    """

    position_m: Array
    covariance_m2: Array


class PlannedFixes(NamedTuple):
    """Fixes in the order of worlds, then time: each [k, ...], with the roots of their precisions."""

    world: NDArray[np.intp]
    sample: NDArray[np.intp]
    place_m: Array
    root: Array


def magnetic_updates(
    recording: Recording,
    flags: Flags,
    settings: FootFilter,
    north_rad: Array | None,
    alignment: Alignment,
) -> tuple[Flags, Array | None]:
    """Return at which readings the magnetic field counts, [r, i], and the field, None where it is not used.

    See Frank et al., section 3.2, which leaves its extent open.

    Parameters
    ----------
    recording
        Stack with inertial readings [r, i].
    flags
        When each foot rests, [r, i].
    settings
        Of the filter.
    north_rad
        Direction to magnetic north, [r], NaN where it is not known; None where the magnetometer is not used.
    alignment
        Until its end nothing counts; has the magnitude of the field.
    """
    if north_rad is None or recording.magnetic_field_ut is None:
        return np.zeros(flags.shape, dtype=np.bool_), None
    field_ut = np.asarray(recording.magnetic_field_ut)
    magnitude = np.sqrt(np.einsum("rik,rik->ri", field_ut, field_ut, dtype=np.float64))
    expected = alignment.magnetic_field_ut[:, None]
    index = np.arange(flags.shape[1])
    since = index - np.maximum.accumulate(np.where(flags, -1, index), axis=1) - 1
    every = np.maximum(1, np.rint(settings.magnetic_interval_s * sample_rate_hz(recording))).astype(np.intp)
    with np.errstate(invalid="ignore"):
        fits = np.abs(magnitude - expected) <= settings.magnetic_gate * expected
    due = flags & (since % every[:, None] == 0) & (index >= alignment.end[:, None])
    return due & fits & np.isfinite(north_rad)[:, None], field_ut


def planned_fixes(recording: Recording, fixes: Fixes | None, time_s: Array) -> PlannedFixes:
    """Return the fixes, with the sample after which each counts.

    Parameters
    ----------
    recording
        Stack with epochs [r, n].
    fixes
        At these epochs, or None.
    time_s
        Of the inertial readings, [r, i].

    Raises
    ------
    InputError
        For fixes that do not fit the epochs, or covariances that are not finite and positive definite.
    """
    if fixes is None:
        none = np.zeros(0, dtype=np.intp)
        return PlannedFixes(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)))
    epoch_s = np.asarray(recording.time_s, dtype=np.float64)
    place, spread = np.asarray(fixes.position_m, np.float64), np.asarray(fixes.covariance_m2, np.float64)
    if place.shape != (*epoch_s.shape, 2) or spread.shape != (*epoch_s.shape, 2, 2):
        raise InputError(
            "fixes",
            f"their shapes {place.shape} and {spread.shape} do not fit epochs {epoch_s.shape}",
            "Give one an epoch, NaN for none",
        )
    there = np.isfinite(place).all(axis=-1) & ~np.isnan(epoch_s)
    try:
        root = np.linalg.inv(np.linalg.cholesky(spread[there]))
    except np.linalg.LinAlgError as error:
        raise InputError(
            "fixes.covariance_m2", "one is not positive definite", "Give every fix a covariance"
        ) from error
    if not np.isfinite(root).all():
        raise InputError("fixes.covariance_m2", "one is not finite", "Give every fix a covariance")
    rows, epochs = np.nonzero(there)
    samples = np.empty(len(rows), dtype=np.intp)
    for row in np.unique(rows):
        own, mine = time_s[row, ~np.isnan(time_s[row])], rows == row
        samples[mine] = np.searchsorted(own, epoch_s[row, epochs[mine]], side="right") - 1
    return PlannedFixes(rows, np.maximum(samples, 0), place[there], root)


def wanted_stops(
    recording: Recording,
    flags: Flags,
    at_rest: Flags,
    used: Flags,
    found: PlannedFixes,
    length: NDArray[np.intp],
    *,
    every_reading: bool,
    readings: int | None,
) -> Flags:
    """Return at which readings the filter stops, [r, i].

    Parameters
    ----------
    recording
        Stack with epochs [r, n] and inertial readings [r, i].
    flags, at_rest, used
        When each foot rests, when this counts, and when the magnetic field does, [r, i].
    found
        Fixes.
    length
        Number of readings of each recording, [r].
    every_reading, readings
        As in `foot.foot_navigation`.
    """
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    stops = flags.copy()
    stops[:, 1:] &= at_rest[:, 1:] | ~flags[:, :-1]
    # The reading behind a rest says that it has ended.
    stops[:, 1:] |= flags[:, :-1] & ~flags[:, 1:]
    stops |= used
    if every_reading:
        stops[...] = True
    for row, epoch_s in enumerate(np.asarray(recording.time_s, dtype=np.float64)):
        until = np.searchsorted(time_s[row, : length[row]], epoch_s[~np.isnan(epoch_s)], side="right") - 1
        stops[row, until[until >= 0]] = True
    stops[found.world, found.sample] = True
    end = length if readings is None else np.minimum(length, readings)
    stops &= np.arange(time_s.shape[1]) < end[:, None]
    stops[:, 0], stops[np.arange(len(end)), end - 1] = True, True
    return stops


def numbered_stops(stops: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the samples at which each world stops, and those of the stops before, each [n, w].

    Where a world has no stop left, both are the same; before the first stop there is sample -1. Adds stops
    to ``stops`` itself, of no other use than that no more than the most samples are merged.
    """
    each = []
    for row in stops:
        own = np.flatnonzero(row)
        for gap in np.flatnonzero(np.diff(own) > _MOST_MERGED):
            row[own[gap] : own[gap + 1] : _MOST_MERGED] = True
        each.append(np.flatnonzero(row))
    longest = max(len(own) for own in each)
    stop = np.stack([np.pad(own, (0, longest - len(own)), mode="edge") for own in each], axis=1)
    return stop, np.concatenate([np.full((1, len(each)), -1), stop[:-1]])


def fixes_by_stop(
    found: PlannedFixes, stops: Flags
) -> dict[int, list[tuple[NDArray[np.intp], Array, Array]]]:
    """Return by number of the stop which worlds have a fix there, their fixes, and the roots.

    A world has one fix a pass; where two fall into one sample, there is a second pass.
    """
    taken: dict[int, list[list[int]]] = {}
    number = np.where(stops, np.cumsum(stops, axis=1) - 1, -1)[found.world, found.sample]
    for fix, (row, stop) in enumerate(zip(found.world.tolist(), number.tolist(), strict=True)):
        if stop < 0:
            continue
        passes = taken.setdefault(stop, [])
        free = next((one for one in passes if row not in found.world[one]), None)
        if free is None:
            passes.append([fix])
        else:
            free.append(fix)
    return {
        stop: [(found.world[one], found.place_m[one], found.root[one]) for one in passes]
        for stop, passes in taken.items()
    }
