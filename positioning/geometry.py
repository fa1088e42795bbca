"""Plane geometry: distances, walls between two places, rotations, the best fit of one figure to another."""

import math
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError

Array = NDArray[np.float64]

# Bound on the relative rounding error of a 2 x 2 determinant of differences in double precision
# (Shewchuk 1997, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates").
_UNIT_ROUNDOFF = 2.0**-53
_DETERMINANT_ERROR = (3.0 + 16.0 * _UNIT_ROUNDOFF) * _UNIT_ROUNDOFF


def pairwise_distance_m(first_m: ArrayLike, second_m: ArrayLike) -> Array:
    """Return the Euclidean distance from each first to each second point.

    Parameters
    ----------
    first_m
        Points, [..., a, d], metres.
    second_m
        Points, [..., b, d], metres.

    Returns
    -------
    Array
        Distances, [..., a, b], metres.

    Raises
    ------
    InputError
        If the two do not have the same number of coordinates.
    """
    first, second = np.asarray(first_m, dtype=np.float64), np.asarray(second_m, dtype=np.float64)
    if first.ndim < 2 or second.ndim < 2 or first.shape[-1] != second.shape[-1]:
        raise InputError(
            "first_m, second_m",
            f"shapes {first.shape} and {second.shape} do not fit [..., a, d] and [..., b, d]",
            "Give points as rows with the same number of coordinates",
        )
    difference = first[..., :, None, :] - second[..., None, :, :]
    distance: Array = np.sqrt(np.sum(difference * difference, axis=-1))
    return distance


def rotated(point_m: ArrayLike, angle_rad: ArrayLike) -> Array:
    """Return points turned to the left about the origin.

    Parameters
    ----------
    point_m
        [..., 2].
    angle_rad
        Broadcast to the leading axes, radians.
    """
    point = np.asarray(point_m, dtype=np.float64)
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = point[..., 0], point[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def rigid_fit(
    point_m: ArrayLike, target_m: ArrayLike, known: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Return the rotation and the shift that bring points closest to their targets.

    See Umeyama (1991), "Least-squares estimation of transformation parameters between two point patterns";
    in the plane the rotation has a closed form. The scale stays. One known pair fixes no rotation: it is
    zero then.

    Parameters
    ----------
    point_m, target_m
        [..., n, 2], metres.
    known
        Pairs that count, [..., n]; None takes all.

    Returns
    -------
    tuple
        Angle [...], radians, and shift [..., 2], metres, so that the target is about
        ``rotated(point_m, angle) + shift``.

    Raises
    ------
    InputError
        Where no pair is known.
    """
    point, target = np.asarray(point_m, dtype=np.float64), np.asarray(target_m, dtype=np.float64)
    counted = np.ones(point.shape[:-1], dtype=bool) if known is None else known
    number = np.count_nonzero(counted, axis=-1)
    if np.any(number == 0):
        raise InputError("target_m", "no place is known", "Give at least one pair of places")

    def centred(values: Array) -> tuple[Array, Array]:
        kept = np.where(counted[..., None], values, 0.0)
        centre = np.sum(kept, axis=-2) / number[..., None]
        return np.where(counted[..., None], kept - centre[..., None, :], 0.0), centre

    (a, centre), (b, target_centre) = centred(point), centred(target)
    along = np.sum(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1], axis=-1)
    across = np.sum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], axis=-1)
    angle = np.arctan2(across, along)
    return np.asarray(angle), target_centre - rotated(centre, angle)


def wall_crossings(start_m: ArrayLike, end_m: ArrayLike, wall_m: ArrayLike) -> NDArray[np.int64]:
    """Count the walls that the straight line from each start to each end crosses.

    See Mirzababaei & Akbari, eq. 66: this is the number of walls w of the propagation model.

    The orientation test is exact (barring underflow): determinants that double precision cannot
    decide are computed in rational arithmetic. Touching is decided by a half-open rule: the plan is
    thought of as moved by an infinitely small step along +x, and by a much smaller one along +y, and
    then nothing touches any more. So a line through the joint of two walls in a row crosses one of
    them, a line through a corner into a room crosses one wall, a line that only grazes a corner
    crosses none or both, and a wall along the line is not crossed. The count does not depend on
    the direction of a line or of a wall.

    Parameters
    ----------
    start_m
        Start points, [..., a, 2], metres.
    end_m
        End points, [..., b, 2], metres.
    wall_m
        End points of the walls, [..., w, 2, 2], metres; a wall with a NaN counts as none.

    Returns
    -------
    NDArray
        Number of walls crossed, [..., a, b].

    Raises
    ------
    InputError
        For shapes that do not fit, points that are not finite, or infinite walls.
    """
    start, end, wall = (np.asarray(values, dtype=np.float64) for values in (start_m, end_m, wall_m))
    for name, points in (("start_m", start), ("end_m", end)):
        if points.ndim < 2 or points.shape[-1] != 2:
            raise InputError(name, f"the shape is {points.shape}, not [..., n, 2]", "Give rows of x, y")
        if not np.isfinite(points).all():
            raise InputError(name, "a coordinate is not a finite number", "Leave out points without position")
    if wall.ndim < 3 or wall.shape[-2:] != (2, 2):
        raise InputError(
            "wall_m", f"the shape is {wall.shape}, not [..., w, 2, 2]", "Give each wall as two points x, y"
        )
    if np.isinf(wall).any():
        raise InputError("wall_m", "a coordinate is infinite", "Use NaN for a wall that is not there")

    # A wall of length zero is never crossed, which is what NaN shall mean.
    present = ~np.isnan(wall).any(axis=(-2, -1), keepdims=True)
    wall = np.where(present, wall, 0.0)
    first, second = wall[..., 0, :], wall[..., 1, :]
    along = second - first
    leading = np.broadcast_shapes(start.shape[:-2], end.shape[:-2], wall.shape[:-3])

    # Points seen from the moved walls: they move by the opposite step, hence the sign of the tie.
    tie = (along[..., 1] > 0) | ((along[..., 1] == 0) & (along[..., 0] < 0))
    start_left, end_left = (
        _is_left(first[..., None, :, :], second[..., None, :, :], point[..., :, None, :], tie[..., None, :])
        for point in (start, end)
    )
    shape = (*leading, start.shape[-2], end.shape[-2])
    walls = wall.shape[-3]
    apart = np.broadcast_to(start_left[..., :, None, :] != end_left[..., None, :, :], (*shape, walls))

    # Few walls lie between two points, so the larger half of the test runs on these pairs only,
    # with lines and walls as flat lists.
    line, wall_index = np.divmod(np.flatnonzero(apart), max(walls, 1))
    wall_index += line // max(shape[-2] * shape[-1], 1) * walls
    line_start = np.broadcast_to(start[..., :, None, :], (*shape, 2)).reshape(-1, 2).take(line, axis=0)
    line_end = np.broadcast_to(end[..., None, :, :], (*shape, 2)).reshape(-1, 2).take(line, axis=0)
    along = line_end - line_start
    tie = (along[..., 1] < 0) | ((along[..., 1] == 0) & (along[..., 0] > 0))
    first_left, second_left = (
        _is_left(
            line_start,
            line_end,
            np.broadcast_to(point, (*leading, walls, 2)).reshape(-1, 2).take(wall_index, axis=0),
            tie,
        )
        for point in (first, second)
    )
    count = np.bincount(line[first_left != second_left], minlength=math.prod(shape))
    return count.astype(np.int64, copy=False).reshape(shape)


def _is_left(line_start: Array, line_end: Array, point: Array, tie: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell whether points [..., 2] lie left of directed lines; ``tie`` answers for points on the line."""
    along, offset = line_end - line_start, point - line_start
    plus, minus = along[..., 0] * offset[..., 1], along[..., 1] * offset[..., 0]
    determinant = plus - minus
    sign = np.sign(determinant)
    unsure = np.abs(determinant) < _DETERMINANT_ERROR * (np.abs(plus) + np.abs(minus))
    if unsure.any():
        corners = np.stack(np.broadcast_arrays(line_start, line_end, point), axis=-2)[unsure]
        sign[unsure] = [_exact_sign(*triangle) for triangle in corners.tolist()]
    left: NDArray[np.bool_] = np.where(sign == 0, tie, sign > 0)
    return left


def _exact_sign(line_start: list[float], line_end: list[float], point: list[float]) -> int:
    (start_x, start_y), (end_x, end_y), (x, y) = (map(Fraction, p) for p in (line_start, line_end, point))
    determinant = (end_x - start_x) * (y - start_y) - (end_y - start_y) * (x - start_x)
    return (determinant > 0) - (determinant < 0)
