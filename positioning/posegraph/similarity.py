"""Which poses are near each other, by what they hear.

See Gu et al., eq. 9 and section III-B. As printed, eq. 9 subtracts a fingerprint from itself and is always
zero; the second term is read as that of the other fingerprint.
"""

from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError, check_whole
from positioning.model import Array

NOT_HEARD_DBM: Final = -110.0
"""What stands for an access point that only the other fingerprint of a pair hears; section III-B."""

Indices = NDArray[np.integer[Any]]

_ROWS = 256


def rss_distance_db(rss_dbm: ArrayLike, other_dbm: ArrayLike | None = None) -> Array:
    """Return the distance of all pairs of fingerprints in signal space.

    See Gu et al., eq. 9: the root mean square difference over the access points that at least one of the
    two hears. All pairs come from matrix products of shifted readings, in which an access point that is not
    heard is a zero: exact for readings in whole decibels, within some 1e-5 dB for others.

    Parameters
    ----------
    rss_dbm
        [..., m, ap], dBm; NaN = not heard.
    other_dbm
        Second set, [..., q, ap]; None = the first one.

    Returns
    -------
    Array
        [..., m, m] or [..., m, q], dB; NaN where one of the two hears nothing.

    Raises
    ------
    InputError
        For shapes that do not fit, or infinite readings.
    """
    first, first_heard = _shifted("rss_dbm", rss_dbm)
    second, second_heard = (first, first_heard) if other_dbm is None else _shifted("other_dbm", other_dbm)
    if first.shape[-1] != second.shape[-1]:
        raise InputError(
            "rss_dbm and other_dbm",
            f"they have {first.shape[-1]} and {second.shape[-1]} access points",
            "Give both a column for every access point, in the same order",
        )
    count, other_count = first_heard.sum(axis=-1), second_heard.sum(axis=-1)
    squared, other_squared = np.sum(first * first, axis=-1), np.sum(second * second, axis=-1)
    first_heard, second_heard = first_heard.astype(np.float32), second_heard.astype(np.float32)
    leading = np.broadcast_shapes(first.shape[:-2], second.shape[:-2])
    distance = np.empty((*leading, first.shape[-2], second.shape[-2]))
    # Some rows at a time stay in the cache; at thousands of fingerprints all pairs take tens of megabytes.
    for low in range(0, first.shape[-2], _ROWS):
        some = slice(low, low + _ROWS)
        # Of one set with itself, what is above the diagonal blocks mirrors what is below.
        to = slice(None) if other_dbm is not None else slice(low + _ROWS)
        # Counts are exact in single precision.
        union = first_heard[..., some, :] @ np.swapaxes(second_heard[..., to, :], -1, -2)
        np.subtract(other_count[..., None, to], union, out=union, casting="same_kind")
        union += count[..., some, None]
        np.maximum(union, 1.0, out=union)
        part = np.matmul(first[..., some, :], np.swapaxes(second[..., to, :], -1, -2))
        part *= -2.0
        part += squared[..., some, None]
        part += other_squared[..., None, to]
        np.maximum(part, 0.0, out=part)
        part /= union
        np.sqrt(part, out=part)
        distance[..., some, to] = part
        if other_dbm is None:
            distance[..., :low, some] = np.swapaxes(part[..., :low], -1, -2)
    if other_dbm is None:
        index = np.arange(first.shape[-2])
        distance[..., index, index] = 0.0
    deaf, other_deaf = count == 0, other_count == 0
    if deaf.any() or other_deaf.any():
        np.copyto(distance, np.nan, where=deaf[..., :, None] | other_deaf[..., None, :])
    return distance


def window_threshold_db(distance_db: ArrayLike, walk_of_scan: ArrayLike, window: int) -> Array:
    """Return the median distance of each scan to the others within a window about it.

    See Gu et al., section III-B. The paper does not say whether all pairs within the window count, or only
    those with the scan in its middle; it is read as the second.

    Parameters
    ----------
    distance_db
        [m, m], dB, scans of a walk one after the other in time.
    walk_of_scan
        Number of the walk, [m]; a window ends with its walk.
    window
        L, scans: half of them before and half of them after.

    Returns
    -------
    Array
        [m], dB; NaN where a walk has no second scan.

    Raises
    ------
    InputError
        For a window of less than two scans.
    """
    check_whole("window", window, least=2)
    distance, walk = np.asarray(distance_db, dtype=np.float64), np.asarray(walk_of_scan)
    # A window that is longer than all walks reaches no further than they do.
    half = min(int(window) // 2, max(len(walk) - 1, 0))
    lag = np.concatenate([np.arange(-half, 0), np.arange(1, half + 1)])
    here = np.arange(len(walk))
    there = here[:, None] + lag
    inside = (there >= 0) & (there < len(walk))
    there = np.where(inside, there, here[:, None])
    inside &= walk[there] == walk[:, None]
    values = np.where(inside, distance[here[:, None], there], np.nan)
    threshold = np.full(len(walk), np.nan)
    some = np.isfinite(values).any(axis=-1)
    threshold[some] = np.nanmedian(values[some], axis=-1)
    return threshold


def near_pairs(
    walk_of_pose: ArrayLike,
    time_s: ArrayLike,
    rss_dbm: ArrayLike,
    *,
    window: int,
    exclude_s: float,
    threshold: Literal["median"] | float = "median",
    position_m: ArrayLike | None = None,
    exclude_m: float = 0.0,
    decides: Literal["later", "either", "both"] = "later",
    distance_db: Array | None = None,
) -> tuple[Indices, Indices]:
    """Return pairs of poses that hear nearly the same.

    See Gu et al., section III-B: a pair is near if its distance in signal space is below the threshold of
    the scan that is looked at, which is compared with all before it. Walks count as one long one, in the
    order of their poses. Poses of one walk that are close in time or in place make no pair.

    Parameters
    ----------
    walk_of_pose
        Number of the walk of each pose, [m]; poses of a walk one after the other.
    time_s
        [m], seconds from the start of the walk, not decreasing within it.
    rss_dbm
        [m, ap], dBm; NaN = not heard; a pose that hears nothing makes no pair.
    window
        L, scans, of the adaptive threshold; not used with a number as threshold.
    exclude_s
        Poses of one walk make a pair only if they are at least this far apart in time.
    threshold
        "median" for the median within the window, or a number of decibels.
    position_m
        Dead-reckoned positions, [m, 2], metres; needed for ``exclude_m`` alone.
    exclude_m
        Poses of one walk make a pair only if they are at least this far apart in place.
    decides
        Whose threshold a distance must be below: that of the later scan, as printed, of either, or of both.
    distance_db
        `rss_distance_db` of the poses that hear something, for callers that have it; None = computed.

    Returns
    -------
    near_from, near_to
        Numbers of poses, each [f], the first below the second, in ascending order.

    Raises
    ------
    InputError
        For arrays that do not fit each other, no pose that hears anything, or settings outside their range.
    """
    walk, time, rss = np.asarray(walk_of_pose), np.asarray(time_s, dtype=np.float64), np.asarray(rss_dbm)
    if walk.ndim != 1 or time.shape != walk.shape or rss.ndim != 2 or len(rss) != len(walk):
        raise InputError(
            "walk_of_pose, time_s and rss_dbm",
            f"their shapes {walk.shape}, {time.shape} and {rss.shape} are not [m], [m] and [m, ap]",
            "Give one row for every pose",
        )
    if decides not in ("later", "either", "both"):
        raise InputError(f"decides={decides!r}", "it is none of later, either and both", "Correct it")
    if isinstance(threshold, str) and threshold != "median":
        raise InputError(f"threshold={threshold!r}", "it is neither 'median' nor a number", "Correct it")
    if exclude_m > 0 and position_m is None:
        raise InputError("position_m", f"exclude_m={exclude_m} needs positions", "Give them, or exclude none")
    scan = np.flatnonzero(np.isfinite(rss).any(axis=-1))
    if not len(scan):
        raise InputError("rss_dbm", "no pose hears an access point", "Give walks with WiFi scans")
    walk, time = walk[scan], time[scan]
    distance = rss_distance_db(rss[scan]) if distance_db is None else distance_db
    if distance.shape != (len(scan), len(scan)):
        raise InputError(
            "distance_db",
            f"its shape is {distance.shape}, {len(scan)} poses hear something",
            "Give the distances of these poses, or leave it out",
        )
    if threshold == "median":
        limit = window_threshold_db(distance, walk, window)
    else:
        limit = np.full(len(scan), float(threshold))
    later, earlier = _below(distance, limit, decides)
    same = np.flatnonzero(walk[later] == walk[earlier])
    one, two = earlier[same], later[same]
    close = np.abs(time[two] - time[one]) < exclude_s
    if position_m is not None:
        place = np.asarray(position_m, dtype=np.float64)[scan]
        close |= np.linalg.norm(place[two] - place[one], axis=-1) < exclude_m
    keep = np.ones(len(later), dtype=bool)
    keep[same[close]] = False
    start, end = scan[earlier[keep]], scan[later[keep]]
    order = np.argsort(start * len(rss) + end)
    return start[order], end[order]


def _below(distance: Array, limit: Array, decides: str) -> tuple[Indices, Indices]:
    """Return pairs, the later one first, whose distance is below the limits that decide."""
    later, earlier = [], []
    # Whole rows of all pairs would take megabytes, and half of them are not needed.
    for low in range(0, len(limit), _ROWS):
        some, until = slice(low, low + _ROWS), slice(low + _ROWS)
        part = distance[some, until]
        near = part < limit[some, None]
        if decides == "either":
            near |= part < limit[until]
        elif decides == "both":
            near &= part < limit[until]
        row, column = np.nonzero(np.tril(near, low - 1))
        later.append(low + row)
        earlier.append(column)
    return np.concatenate(later), np.concatenate(earlier)


def _shifted(name: str, rss_dbm: ArrayLike) -> tuple[Array, Array]:
    rss = np.asarray(rss_dbm, dtype=np.float64)
    if rss.ndim < 2 or np.isinf(rss).any():
        limit = f"its shape is {rss.shape}" if rss.ndim < 2 else "it holds infinite values"
        raise InputError(name, limit, "Give [m, ap] with NaN for an access point that was not heard")
    heard = ~np.isnan(rss)
    return np.where(heard, rss - NOT_HEARD_DBM, 0.0), heard.astype(np.float64)
