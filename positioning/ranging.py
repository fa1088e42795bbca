"""From received strength to distance: all crossings of a curve, and all combinations of candidates.

See Raghavan et al., section II.B: with interference and multipath a strength belongs to several distances,
and all triplets of one distance a beacon are tried.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError

Array = NDArray[np.float64]

LEAST_BEACONS = 3
"""Distances to fewer beacons do not tell a place in the plane."""

MANY = 1e6
"""Of so many combinations an error tells the power of ten."""


def crossings(curve_distance_m: ArrayLike, curve_dbm: ArrayLike, rss_dbm: ArrayLike) -> Array:
    """Return all distances at which a piecewise linear curve has each level.

    See Raghavan et al., section II.B and Fig. 3. A level met exactly at a knot counts once, also where the
    curve only touches it; a piece of the curve that is flat at the level counts once, with its middle.
    A level that the curve does not reach has no distance.

    Parameters
    ----------
    curve_distance_m
        Distances of the knots of the curve, [m], metres, ascending; at least two.
    curve_dbm
        Levels of the curve there, [m], dBm.
    rss_dbm
        Levels that are looked up, [...], dBm; NaN = not heard.

    Returns
    -------
    Array
        Distances, [..., c], metres, ascending; NaN fills up. c is the largest number of distances that
        any of these levels has, at least 1.

    Raises
    ------
    InputError
        For a curve that is not one, or an infinite level.
    """
    distance, level = (np.asarray(values, dtype=np.float64) for values in (curve_distance_m, curve_dbm))
    rss = np.asarray(rss_dbm, dtype=np.float64)
    if distance.ndim != 1 or distance.shape != level.shape or len(distance) < 2:
        raise InputError(
            "curve_distance_m, curve_dbm",
            f"shapes {distance.shape} and {level.shape} are not twice [m] with at least two knots",
            "Give one level for each distance",
        )
    if not (np.isfinite(distance).all() and np.isfinite(level).all() and (np.diff(distance) > 0).all()):
        raise InputError(
            "curve_distance_m, curve_dbm",
            "they are not all finite numbers at ascending distances",
            "Sort the knots, and leave out repeated and missing ones",
        )
    if np.isinf(rss).any():
        raise InputError("rss_dbm", "a level is infinite", "Use NaN for a beacon that was not heard")

    # A flat piece becomes one knot with a width, so that neighbouring knots always differ.
    first = np.flatnonzero(np.concatenate([[True], np.diff(level) != 0]))
    last = np.append(first[1:], len(level)) - 1
    start, end, level = distance[first], distance[last], level[first]
    side = np.sign(rss[..., None] - level)
    at_knot = np.where(side == 0, (start + end) / 2, np.nan)
    # One side is compared with the next, so a level is at a knot or strictly inside a piece, never both.
    inside = side[..., :-1] * side[..., 1:] < 0
    share = (rss[..., None] - level[:-1]) / np.diff(level)
    in_piece = np.where(inside, end[:-1] + share * (start[1:] - end[:-1]), np.nan)
    found = np.sort(np.concatenate([at_knot, in_piece], axis=-1), axis=-1)
    most = int(np.count_nonzero(~np.isnan(found), axis=-1).max(initial=1))
    return found[..., :most]


def check_candidates(range_m: ArrayLike, readings: tuple[int, ...], name: str) -> Array:
    """Return what a ranging algorithm answered if it is candidate distances of these readings.

    Parameters
    ----------
    range_m
        The answer, [..., b, c], metres; NaN fills up.
    readings
        Shape of the readings, (..., b).
    name
        Whose answer it is, for the error.

    Raises
    ------
    InputError
        For another shape, or a distance that is infinite, zero or negative.
    """
    found = np.asarray(range_m, dtype=np.float64)
    if found.shape[:-1] != readings or np.isinf(found).any() or (found <= 0).any():
        raise InputError(
            name,
            f"shape {found.shape} for readings {readings}, or distances that are infinite, zero or negative",
            "Return [..., beacon, candidate] in metres, NaN fills up",
        )
    return found


class TooManyCombinations(InputError):
    """So many candidate distances that not all their combinations can be solved."""


def combinations(range_m: ArrayLike, *, limit: int = 10_000) -> tuple[Array, NDArray[np.intp]]:
    """Return every combination of one candidate distance for each beacon.

    See Raghavan et al., section II.B: the distance triplets of an observed vector of strengths. A beacon
    without candidates stays out of all combinations of its sample, as NaN; a sample with candidates
    for fewer than three beacons has no combination.

    Parameters
    ----------
    range_m
        Candidates, [s, b, c], metres; NaN fills up.
    limit
        Largest number of combinations of one sample.

    Returns
    -------
    range_m
        Combinations, [t, b], metres: sample after sample, the last beacon's candidates change fastest.
    sample
        The sample of each combination, [t], ascending.

    Raises
    ------
    InputError
        For another shape, or an infinite distance.
    TooManyCombinations
        For a sample with more combinations than ``limit``.
    """
    candidate = np.asarray(range_m, dtype=np.float64)
    if candidate.ndim != 3:
        raise InputError(
            "range_m", f"the shape is {candidate.shape}, not [s, b, c]", "Give samples, beacons, candidates"
        )
    if np.isinf(candidate).any():
        raise InputError("range_m", "a distance is infinite", "Use NaN where there is no distance")
    samples, beacons, _ = candidate.shape
    missing = np.isnan(candidate)
    # Candidates first, in their order. A beacon without any has one choice: none.
    candidate = np.take_along_axis(candidate, np.argsort(missing, axis=-1, kind="stable"), axis=-1)
    count = np.count_nonzero(~missing, axis=-1)
    choices = np.maximum(count, 1)
    usable = np.count_nonzero(count, axis=-1) >= LEAST_BEACONS
    # As floating-point numbers, because many beacons overflow whole ones before the limit is compared.
    most = np.where(usable, np.prod(choices, axis=-1, dtype=np.float64), 0.0).max(initial=0.0)
    if most > limit:
        told = f"{most:.0f}" if most < MANY else f"at least 10^{int(np.log10(most))}"
        raise TooManyCombinations(
            "range_m",
            f"a sample has {told} combinations of candidate distances, at most {limit} are allowed",
            "Use the ranging path_loss, which has one candidate, or a smoother curve",
        )
    total = np.where(usable, np.prod(choices, axis=-1), 0)
    sample = np.repeat(np.arange(samples), total)
    number = np.arange(len(sample)) - np.repeat(np.cumsum(total) - total, total)
    chosen = np.full((len(sample), beacons), np.nan)
    if len(sample):
        for beacon in reversed(range(beacons)):
            number, choice = np.divmod(number, choices[sample, beacon])
            chosen[:, beacon] = candidate[sample, beacon, choice]
    return chosen, sample


def calibration_pairs(distance_m: ArrayLike, rss_dbm: ArrayLike) -> tuple[Array, Array]:
    """Return the pairs of a calibration run that hold both a distance and a strength.

    See Raghavan et al., section II.B: the straight drive away from a beacon.

    Parameters
    ----------
    distance_m
        Distances, [n], metres; NaN fills up.
    rss_dbm
        Received signal strength there, [n], dBm; NaN = not heard.

    Returns
    -------
    distance_m, rss_dbm
        The pairs without NaN, each [m].

    Raises
    ------
    InputError
        For arrays that do not fit each other, infinite values, a distance that is not positive, or fewer
        than two different distances.
    """
    distance, rss = (np.asarray(values, dtype=np.float64) for values in (distance_m, rss_dbm))
    if distance.ndim != 1 or distance.shape != rss.shape:
        raise InputError(
            "calibration",
            f"distance_m {distance.shape} and rss_dbm {rss.shape} are not both [n]",
            "Give one strength for each distance",
        )
    heard = ~(np.isnan(distance) | np.isnan(rss))
    distance, rss = distance[heard], rss[heard]
    if not (np.isfinite(distance).all() and np.isfinite(rss).all()):
        raise InputError("calibration", "a value is infinite", "Use NaN for a beacon that was not heard")
    if (distance <= 0).any():
        raise InputError(
            "calibration, distance_m", f"{distance.min()} is not positive", "Give distances in metres"
        )
    different = len(np.unique(distance))
    if different < 2:
        raise InputError(
            "calibration",
            f"strengths were heard at {different} different distance(s), at least 2 are needed",
            "Calibrate at more distances",
        )
    return distance, rss
