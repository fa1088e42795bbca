"""Position fixes of a moving receiver from a map of fingerprints, one fix a scan."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError, Reason
from positioning.estimator import clone
from positioning.model import Array, Calibration, Recording, Site, Survey

LEAST_DEVIATION_M = 0.1
"""No fix is surer than this in either coordinate: receivers and map points are not placed any better."""


def cannot_fix(
    fingerprinting: Any, survey: Survey | Calibration | None, recording: Recording, site: Site
) -> str:
    """Say why no scan can have a fix: a reason to skip these data, empty where there is none.

    See Atia et al., section 3. Fixes of a recording train with the whole map: nothing is left out.

    Parameters
    ----------
    fingerprinting
        The algorithm, whose own ``skip`` is asked as well.
    survey, recording, site
        Stacks with one leading axis.
    """
    if not isinstance(survey, Survey):
        return Reason("there is no survey of fingerprints", "Give fingerprints at known places")
    if recording.rss_dbm is None:
        return Reason("the recording holds no received strengths", "Give rss_dbm")
    skip = getattr(fingerprinting, "skip", None)
    return "" if skip is None else skip(_with_one_to_leave_out(survey.at(0)), site.at(0)) or ""


def fingerprint_fixes(
    fingerprinting: Any, survey: Survey | Calibration | None, recording: Recording
) -> Array:
    """Locate every scan of a stack of recordings in the map of its world.

    See Atia et al., section 3. Access points that the map never heard are ignored: the map cannot tell
    where they are heard, and a regressor would take them for a difference. A scan that hears nothing else
    has no fix.

    Parameters
    ----------
    fingerprinting
        A regressor from fingerprints to positions; it is copied, not changed, and fitted once for all
        recordings that share a map.
    survey
        Maps, [r, p, ap] and [r, p, 2].
    recording
        Scans, [r, n, ap], dBm; all NaN where an epoch has none.

    Returns
    -------
    Array
        [r, n, 2], metres; NaN where an epoch has no fix.

    Raises
    ------
    InputError
        For arrays that do not fit each other, infinite values, a map or a recording that is missing, or an
        answer of the regressor that is not finite.
    """
    maps = _checked(survey)
    if recording.rss_dbm is None:
        raise InputError("recording", "it holds no received strengths", "Give rss_dbm")
    scan_dbm = np.asarray(recording.rss_dbm, dtype=np.float64)
    count, _, columns = maps.rss_dbm.shape
    expected = (*np.shape(recording.time_s), columns)
    if scan_dbm.shape != expected or len(scan_dbm) != count:
        raise InputError(
            "recording.rss_dbm",
            f"its shape {scan_dbm.shape} does not fit {np.shape(recording.time_s)} epochs and the"
            f" {count} maps of {columns} access points",
            "Give one map a recording, and the columns of the map",
        )
    if np.isinf(scan_dbm).any():
        where = ", ".join(str(i) for i in np.argwhere(np.isinf(scan_dbm))[0])
        raise InputError(f"recording.rss_dbm[{where}]", "a reading is infinite", "Use NaN for none")
    never = np.isnan(maps.rss_dbm).all(axis=1, keepdims=True)
    scan_dbm = np.where(never, np.nan, scan_dbm)
    heard = ~np.isnan(scan_dbm).all(axis=-1) & ~np.isnan(recording.time_s)
    fix_m = np.full((*heard.shape, 2), np.nan)
    for members in _alike(maps):
        fitted = clone(fingerprinting)
        fitted.fit(maps.rss_dbm[members[0]], maps.position_m[members[0]])
        # Each recording by itself, so that its fixes do not depend on the others of the stack.
        for index in members:
            if heard[index].any():
                fix_m[index, heard[index]] = _located(fitted, scan_dbm[index, heard[index]])
    return fix_m


def best_of_three(fix_m: Array) -> Array:
    """Return, at each fix, the value that at least two of the last three fixes have, else the latest.

    See Frank et al., section 2, on equation 1. The last three are those before the vote. It helps where
    fixes are places of a map, so that two can be exactly equal; nothing else is ever replaced.

    Parameters
    ----------
    fix_m
        Fixes, [r, n, 2], metres; an epoch with NaN has none and takes no part.

    Returns
    -------
    Array
        [r, n, 2], metres; NaN where an epoch has no fix.

    Raises
    ------
    InputError
        For another shape.
    """
    fixes_m = np.asarray(fix_m, dtype=np.float64)
    if fixes_m.ndim != 3 or fixes_m.shape[-1] != 2:
        raise InputError("fix_m", f"its shape is {fixes_m.shape}", "Give [recording, epoch, 2]")
    none: NDArray[np.bool_] = np.asarray(np.isnan(fixes_m).any(axis=-1))
    # Fixes first, in their order; the epochs without one behind them.
    order = np.argsort(none, axis=1, kind="stable")
    voted_m = np.take_along_axis(np.where(none[..., None], np.nan, fixes_m), order[..., None], axis=1)
    latest, former, first = voted_m[:, 2:], voted_m[:, 1:-1], voted_m[:, :-2]
    # Any other two that agree have the value of the latest, which is the answer anyway.
    outvoted = (former == first).all(axis=-1) & ~np.isnan(latest[..., 0])
    chosen_m = np.where(outvoted[..., None], former, latest)
    result_m = np.full_like(fixes_m, np.nan)
    np.put_along_axis(result_m, order[..., None], np.concatenate([voted_m[:, :2], chosen_m], axis=1), axis=1)
    return result_m


def fix_covariance_m2(fingerprinting: Any, survey: Survey | Calibration | None) -> Array:
    """Return how far fixes are off, as the map itself tells.

    Every second place of the map, in the order of their coordinates, is located with the others, and these
    with the former: two fits a map. The mean square of the errors, with that of `LEAST_DEVIATION_M` added,
    is the covariance. A half is sparser than the map, which makes the errors larger, and a survey does not
    know how a later scan differs, which makes them smaller. The paper has no covariance of a fix.

    Where a half is too small for the regressor, it is the spread of the map's places.

    Parameters
    ----------
    fingerprinting
        A regressor from fingerprints to positions; it is copied, not changed.
    survey
        Maps, [r, p, ap] and [r, p, 2].

    Returns
    -------
    Array
        [r, 2, 2], square metres.

    Raises
    ------
    InputError
        For a survey that is missing or cannot be used.
    """
    maps = _checked(survey)
    covariance_m2 = np.empty((len(maps.rss_dbm), 2, 2))
    for members in _alike(maps):
        rss_dbm, position_m = maps.rss_dbm[members[0]], maps.position_m[members[0]]
        covariance_m2[members] = _mean_square(_halves_error_m(fingerprinting, rss_dbm, position_m))
    return covariance_m2


def map_centre_and_variance(survey: Survey) -> tuple[Array, Array]:
    """Return mean [r, 2], metres, and covariance [r, 2, 2], square metres, of a place drawn from a map.

    The covariance has that of `LEAST_DEVIATION_M` added.

    Parameters
    ----------
    survey
        Maps, [r, p, ap] and [r, p, 2].
    """
    position_m = np.asarray(survey.position_m, dtype=np.float64)
    centre_m = position_m.mean(axis=1)
    return centre_m, np.stack([_mean_square(own - own.mean(axis=0)) for own in position_m])


def _with_one_to_leave_out(survey: Survey) -> Survey:
    """Return a map [p, ap] with a place more: who leaves out the largest place has the map itself left."""
    position_m = np.asarray(survey.position_m, dtype=np.float64)
    if len(position_m) == 0:
        return survey
    _, counts = np.unique(position_m, axis=0, return_counts=True)
    most = int(counts.max())
    return Survey(
        rss_dbm=np.concatenate([survey.rss_dbm, np.repeat(survey.rss_dbm[:1], most, axis=0)]),
        position_m=np.concatenate([position_m, np.repeat(position_m.max(axis=0)[None] + 1.0, most, axis=0)]),
    )


def _checked(survey: Survey | Calibration | None) -> Survey:
    if not isinstance(survey, Survey):
        raise InputError("survey", "there is no survey of fingerprints", "Give fingerprints at known places")
    maps = Survey(
        rss_dbm=np.asarray(survey.rss_dbm, dtype=np.float64),
        position_m=np.asarray(survey.position_m, dtype=np.float64),
    ).check(least=1)
    if maps.rss_dbm.ndim != 3:
        raise InputError("survey.rss_dbm", f"its shape is {maps.rss_dbm.shape}", "Give [recording, n, ap]")
    return maps


def _alike(maps: Survey) -> Iterator[list[int]]:
    """Yield the numbers of the recordings that share a map, map by map."""
    groups: dict[tuple[bytes, bytes], list[int]] = {}
    for index, (rss_dbm, position_m) in enumerate(zip(maps.rss_dbm, maps.position_m, strict=True)):
        groups.setdefault((rss_dbm.tobytes(), position_m.tobytes()), []).append(index)
    yield from groups.values()


def _halves_error_m(fingerprinting: Any, rss_dbm: Array, position_m: Array) -> Array:
    """Return the errors [p, 2] of locating each half of a map with the other, metres."""
    places, place = np.unique(position_m, axis=0, return_inverse=True)
    odd: NDArray[np.bool_] = place.reshape(-1) % 2 == 1
    error_m = position_m.mean(axis=0) - position_m
    if len(places) == 1:
        return np.asarray(error_m)
    try:
        for half in (odd, ~odd):
            fitted = clone(fingerprinting).fit(rss_dbm[~half], position_m[~half])
            error_m[half] = _located(fitted, rss_dbm[half]) - position_m[half]
    except InputError:
        # The whole map was enough, or its own fit tells why not.
        return np.asarray(position_m.mean(axis=0) - position_m)
    return np.asarray(error_m)


def _mean_square(error_m: Array) -> Array:
    """Return the mean of outer products of errors [p, 2], [2, 2], square metres."""
    square_m2 = error_m.T @ error_m / len(error_m)
    return np.asarray((square_m2 + square_m2.T) / 2 + LEAST_DEVIATION_M**2 * np.eye(2))


def _located(fitted: Any, rss_dbm: Array) -> Array:
    position_m = np.asarray(fitted.predict(rss_dbm), dtype=np.float64)
    if position_m.shape != (len(rss_dbm), 2) or not np.isfinite(position_m).all():
        raise InputError(
            f"the answer of {type(fitted).__name__}",
            f"its shape is {position_m.shape} for {len(rss_dbm)} scans, or it is not finite",
            "Give a fingerprinting algorithm that answers every scan with two coordinates",
        )
    return position_m
