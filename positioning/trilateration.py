"""Trilateration: from distances to known places to a position, all triplets of all worlds in one call."""

from functools import reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.model import Array

Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

WEIGHTINGS = {"absolute": 0, "printed": 1, "fractional": 2}
"""Readings of the error that is minimised, and the power of the measured distance that divides its square."""

LEAST_RANGES = 3

# Beacons count as identical, or as collinear, within this part of their extent.
_DEGENERATE = 1e-6
# A normal matrix whose determinant is below this part of its squared trace counts as singular.
_SINGULAR = 1e-12
# A correction longer than this is divergence, metres: positions stay far from overflow.
_DIVERGED_M = 1e9
# Triplets that are iterated together: many against the cost of a call to NumPy, few for the cache.
_BATCH = 6144


def check_beacons(beacon_m: ArrayLike) -> Array:
    """Return the places of the beacons, [..., b, 2], metres, if a position can be found with them.

    See Raghavan et al., section III. An `InputError` are fewer than three beacons, coordinates that are not
    finite, two beacons at one place, and beacons on one line (within a millionth of their extent).
    """
    beacon = np.asarray(beacon_m, dtype=np.float64)
    if beacon.ndim < 2 or beacon.shape[-1] != 2:
        limit = f"its shape is {beacon.shape}, not [..., b, 2]"
        raise InputError("beacon_m", limit, "Give two coordinates for every beacon")
    count = beacon.shape[-2]
    if count < LEAST_RANGES:
        limit = f"{count} beacon(s), at least {LEAST_RANGES} are needed"
        raise InputError("beacon_m", limit, "Add beacons at known places")
    cure = "Leave out beacons whose place is not known"
    _refuse("beacon_m", beacon, ~np.isfinite(beacon), "it is not a finite number", cure)
    centred = beacon - beacon.mean(axis=-2, keepdims=True)
    extent = np.max(np.abs(centred), axis=(-2, -1))
    separation = np.max(np.abs(beacon[..., :, None, :] - beacon[..., None, :, :]), axis=-1)
    identical = (separation <= _DEGENERATE * extent[..., None, None]) & ~np.eye(count, dtype=bool)
    if identical.any():
        *world, first, second = np.argwhere(identical)[0].tolist()
        limit = f"beacons {first} and {second} stand at the same place {beacon[(*world, first)].tolist()}"
        raise InputError(f"beacon_m{world or ''}", limit, "Leave one of them out")
    collinear = np.linalg.matrix_rank(centred, tol=_DEGENERATE * extent) < 2
    if collinear.any():
        world = np.argwhere(collinear)[0].tolist()
        limit = "all beacons stand on one line, which leaves two mirror images of every position"
        raise InputError(f"beacon_m{world or ''}", limit, "Add a beacon beside the line")
    return beacon


def check_ranges(range_m: ArrayLike, beacon_m: Array) -> Array:
    """Return measured distances, [..., b], metres, NaN = not ranged, with the leading axes of both arguments.

    See Raghavan et al., section III. An `InputError` are another number of distances than beacons
    [..., b, 2], leading axes that do not broadcast, and a distance that is zero, negative or infinite.
    """
    ranges = np.asarray(range_m, dtype=np.float64)
    try:
        shape = np.broadcast_shapes(ranges.shape, beacon_m.shape[:-1])
    except ValueError:
        shape = ()
    if ranges.shape[-1:] != beacon_m.shape[-2:-1] or not shape:
        limit = f"its shape {ranges.shape} does not fit beacons {beacon_m.shape}"
        raise InputError("range_m", limit, "Give one distance for every beacon, NaN where there is none")
    bad = (ranges <= 0) | np.isinf(ranges)
    cure = "Use NaN for a beacon that was not ranged"
    _refuse("range_m", ranges, bad, "a distance must be positive and finite", cure)
    return np.broadcast_to(ranges, shape)


def enough_ranges(range_m: Array) -> Mask:
    """Tell where at least three distances, [..., b], were measured, [...].

    See Raghavan et al., section III. Elsewhere the position of every solver is NaN.
    """
    return np.asarray(np.count_nonzero(~np.isnan(range_m), axis=-1) >= LEAST_RANGES)


def objective_weight(range_m: Array, weighting: str) -> Array:
    """Return the weight of each squared error in the sum that a reading of the method minimises.

    See Raghavan et al., section III.B. With r the distance from the estimate to a beacon and d the measured
    one, [..., b], the sums are those of (r - d)^2 for ``absolute``, (r - d)^2 / d for ``printed`` and
    ((r - d) / d)^2 for ``fractional``. The weight is zero where a beacon was not ranged. Another weighting
    is an `InputError`.
    """
    _check(weighting)
    ranged = ~np.isnan(range_m)
    return np.where(ranged, 1.0 / np.where(ranged, range_m, 1.0) ** WEIGHTINGS[weighting], 0.0)


def weighted_error(position_m: Array, beacon_m: Array, range_m: Array, weight: Array) -> Array:
    """Return sqrt(weight) (r - d), [..., b]: the squares sum to the objective.

    See Raghavan et al., section III.B. Estimates are [..., 2], beacons [..., b, 2], measured distances and
    weights from `objective_weight` [..., b]. Zero where a beacon was not ranged.
    """
    offset = position_m[..., None, :] - beacon_m
    error = np.hypot(offset[..., 0], offset[..., 1]) - range_m
    return np.where(np.isnan(range_m), 0.0, np.sqrt(weight) * error)


def weighted_error_jacobian(position_m: Array, beacon_m: Array, weight: Array) -> Array:
    """Return the derivative of `weighted_error` with respect to the position, [..., b, 2].

    See Raghavan et al., section III.B: the unit vectors of matrix B, pointing away from the beacons. At the
    place of a beacon, where there is no derivative, its row is zero, the middle of all directions.
    """
    offset = position_m[..., None, :] - beacon_m
    distance = np.hypot(offset[..., 0], offset[..., 1])[..., None]
    return np.asarray(np.sqrt(weight)[..., None] * offset / np.where(distance > 0, distance, 1.0))


def pseudo_inverse(beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
    """Return the position from the linear system in (s, x, y), solved with the pseudo-inverse.

    See Raghavan et al., section III.A. The system is written about the centroid of the ranged beacons: if
    these stand on one line, the position is the point of the line midway between the two mirror images.

    Parameters
    ----------
    beacon_m
        Places of the beacons, [..., b, 2], metres.
    range_m
        Measured distances, [..., b], metres; NaN = not ranged. Leading axes of both broadcast.

    Returns
    -------
    Array
        Positions, [..., 2], metres; NaN where fewer than three beacons were ranged.

    Raises
    ------
    InputError
        As `check_beacons` and `check_ranges`.
    """
    beacon = check_beacons(beacon_m)
    ranges = check_ranges(range_m, beacon)
    beacons, distances, centroid = _about_centroid(beacon, ranges)
    x, y = beacons
    # Distances so long that their squares overflow give no position; iterations start elsewhere then.
    with np.errstate(all="ignore"):
        side = np.where(np.isnan(distances), 0.0, distances**2 - x**2 - y**2)
        # About the centroid the column of ones is orthogonal to the others, and drops out with s.
        position = centroid + _solve(-2.0 * beacons, side)
    return position.T.reshape(*ranges.shape[:-1], 2)


def starting_point(beacon_m: ArrayLike, range_m: ArrayLike) -> Array:
    """Return `pseudo_inverse`, [..., 2], metres, or the centroid of the beacons where that is not finite.

    See Raghavan et al., section III.A.
    """
    start = pseudo_inverse(beacon_m, range_m)
    centroid = np.asarray(beacon_m, dtype=np.float64).mean(axis=-2)
    return np.where(np.isfinite(start).all(axis=-1, keepdims=True), start, centroid)


def iterate_from_pseudo_inverse(
    beacon_m: ArrayLike,
    range_m: ArrayLike,
    *,
    weighting: str,
    step: float = 0.05,
    tolerance_m: float = 1e-6,
    most_iterations: int = 5000,
) -> tuple[Array, Counts]:
    """Iterate from `starting_point`; parameters, results and errors as in `iterate`.

    See Raghavan et al., sections III.A and III.B.
    """
    return iterate(
        beacon_m,
        range_m,
        start_m=starting_point(beacon_m, range_m),
        weighting=weighting,
        step=step,
        tolerance_m=tolerance_m,
        most_iterations=most_iterations,
    )


def iterate(
    beacon_m: ArrayLike,
    range_m: ArrayLike,
    *,
    start_m: ArrayLike,
    weighting: str,
    step: float = 0.05,
    tolerance_m: float = 1e-6,
    most_iterations: int = 5000,
) -> tuple[Array, Counts]:
    """Return the positions that the damped iteration comes to rest at, and how long it took.

    See Raghavan et al., section III.B. With d_i a measured distance, r_i the one from the estimate, and rows
    of B the unit vectors from estimate to beacon, the gradient of d_i - r_i, the correction is
    Delta = -(B'B)^-1 B'f; the printed plus sign leads away from the solution. The three readings are

    - ``absolute``: f_i = d_i - r_i; at rest sum (r_i - d_i)^2 is least, 2 B'f being its gradient;
    - ``printed``: f_i = (d_i - r_i) / d_i with B as printed; at rest sum (r_i - d_i)^2 / d_i is least;
    - ``fractional``: the same f, and B its own gradient, rows divided by d_i; at rest the sum of
      ((r_i - d_i) / d_i)^2 is least.

    The estimate moves by ``step`` Delta. The printed reading takes some d / step ln(error / tolerance)
    iterations, d being the longest distance, and converges up to a step of about twice the shortest distance
    (in metres), the others up to about 2. The limit may be below 0.05 where a short distance contradicts
    the others or the unit vectors are nearly parallel. On a beacon its unit vector, 0/0, counts as zero;
    where B'B is singular, its pseudo-inverse moves the estimate along the line of the beacons.

    Parameters
    ----------
    beacon_m, range_m
        As in `pseudo_inverse`.
    start_m
        First estimate, [..., 2], metres, with the same leading axes or fewer.
    weighting
        ``absolute``, ``printed`` or ``fractional``.
    step
        Part of the correction that is made. A negative one is the printed sign, which diverges.
    tolerance_m
        Length of the undamped correction below which the iteration stops, metres (in the printed reading,
        whose f has no unit, a pure number, and the step a length).
    most_iterations
        Where this many do not suffice, the iteration has not converged.

    Returns
    -------
    position_m
        [..., 2], metres; NaN where fewer than three beacons were ranged. Where the iteration did not
        converge it is the last estimate, or the last one before a correction above 1e9 m.
    iterations
        [...]; -1 where it did not converge, 0 where fewer than three beacons were ranged.

    Raises
    ------
    InputError
        As `check_beacons` and `check_ranges`; for a weighting, start or setting that makes no sense.
    """
    _check(weighting, step, tolerance_m, most_iterations)
    beacon = check_beacons(beacon_m)
    ranges = check_ranges(range_m, beacon)
    enough = enough_ranges(ranges)
    try:
        start = np.broadcast_to(np.asarray(start_m, dtype=np.float64), (*enough.shape, 2))
    except ValueError:
        limit = f"its shape {np.shape(start_m)} does not fit {(*enough.shape, 2)}"
        raise InputError("start_m", limit, "Give two coordinates for every position") from None
    cure = "Start from the pseudo-inverse solution or the centroid of the beacons"
    _refuse("start_m", start, ~np.isfinite(start) & enough[..., None], "it is not a finite number", cure)

    # Coordinates about the centroid lose no digits where the origin is far away.
    beacons, distances, centroid = _about_centroid(beacon, ranges)
    estimates = start.reshape(-1, 2).T - centroid
    iterations = np.zeros(enough.size, dtype=np.int64)
    batch, waiting = np.split(np.flatnonzero(enough), [_BATCH])
    with np.errstate(all="ignore"):
        while batch.size:
            estimate, places, measured = (a.take(batch, axis=-1) for a in (estimates, beacons, distances))
            count = iterations[batch]
            running, converged = np.ones(batch.size, dtype=bool), np.zeros(batch.size, dtype=bool)
            # When a quarter has finished, others take its place.
            while 4 * np.count_nonzero(running) > 3 * batch.size:
                delta = _correction(estimate, places, measured, weighting)
                length = np.sqrt(delta[0] ** 2 + delta[1] ** 2)
                count += running
                running &= length <= _DIVERGED_M
                estimate += np.where(running, step * delta, 0.0)
                converged |= running & (length < tolerance_m)
                running &= ~converged & (count < most_iterations)
            estimates[:, batch] = estimate
            iterations[batch] = np.where(running | converged, count, -1)
            new, waiting = np.split(waiting, [_BATCH - np.count_nonzero(running)])
            batch = np.concatenate([batch[running], new])
    return (estimates + centroid).T.reshape(start.shape), iterations.reshape(enough.shape)


def _correction(estimate_m: Array, beacon_m: Array, range_m: Array, weighting: str) -> Array:
    """Return Delta = -(B'B)^-1 B'f, [2, n], of estimates [2, n], beacons [2, b, n] and distances [b, n].

    Every operation is elementwise over the n triplets: the bits of one do not depend on the others.
    """
    offset_m = beacon_m - estimate_m[:, None]
    distance_m = np.sqrt(offset_m[0] ** 2 + offset_m[1] ** 2)
    f = range_m - distance_m
    B = offset_m / distance_m
    if weighting != "absolute":
        f /= range_m
    if weighting == "fractional":
        B /= range_m
    # Beacons that were not ranged, and the one the estimate stands on, have no say.
    given = (distance_m > 0) & (range_m > 0)
    if not given.all():
        f, B = np.where(given, f, 0.0), np.where(given, B, 0.0)
    return -_solve(B, f)


def _solve(A: Array, side: Array) -> Array:
    """Return (A'A)^-1 A' side, [2, n], of matrices given by columns, [2, b, n], and right sides [b, n]."""
    x, y = A
    xx, xy, yy = _sum(x * x), _sum(x * y), _sum(y * y)
    x_side, y_side = _sum(x * side), _sum(y * side)
    determinant, trace = xx * yy - xy * xy, xx + yy
    solution = np.stack([yy * x_side - xy * y_side, xx * y_side - xy * x_side]) / determinant
    singular = ~(determinant > _SINGULAR * trace**2)
    if singular.any():
        # The pseudo-inverse: A' side lies along the only direction, where the value of A'A is its trace.
        solution[:, singular] = (np.stack([x_side, y_side]) / trace)[:, singular]
    return solution


def _sum(values: Array) -> Array:
    """Add up the first axis, in the same order whatever the others; the order of np.sum depends on them."""
    return np.asarray(reduce(np.add, values))


def _about_centroid(beacon: Array, ranges: Array) -> tuple[Array, Array, Array]:
    """Return beacons [2, b, n], distances [b, n] and centroids [2, n], with all leading axes in n.

    The beacons lie about the centroid of the ranged ones, NaN for fewer than three; others lie at it.
    """
    distances = ranges.reshape(-1, ranges.shape[-1]).T
    beacons = np.broadcast_to(beacon, (*ranges.shape, 2)).reshape(*distances.T.shape, 2).transpose(2, 1, 0)
    ranged = ~np.isnan(distances)
    total = np.stack([_sum(np.where(ranged, axis, 0.0)) for axis in beacons])
    centroid = total / np.where(enough_ranges(distances.T), np.count_nonzero(ranged, axis=0), np.nan)
    return np.where(ranged, beacons - centroid[:, None], 0.0), distances, centroid


def _check(weighting: str, step: float = 1.0, tolerance_m: float = 1.0, most_iterations: int = 1) -> None:
    names = ", ".join(WEIGHTINGS)
    for setting, good, limit, cure in (
        (f"{weighting=}", weighting in WEIGHTINGS, f"one of {names}", "Choose one of them"),
        (f"{step=}", np.isfinite(step) and step != 0, "finite and not zero", "Choose 0.05 or so"),
        (f"{tolerance_m=}", 0 < tolerance_m < np.inf, "positive and finite", "Choose 1e-6 or so"),
        (f"{most_iterations=}", most_iterations >= 1, "at least 1", "Choose 5000 or so"),
    ):
        if not good:
            raise InputError(setting, f"it must be {limit}", cure)


def _refuse(name: str, values: Array, bad: Mask, limit: str, cure: str) -> None:
    """Raise an error that names the first bad entry."""
    if bad.any():
        where = tuple(np.argwhere(bad)[0].tolist())
        raise InputError(f"{name}{list(where)} = {values[where]}", limit, cure)
