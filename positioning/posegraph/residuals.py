"""How far poses contradict the edges between them, with derivatives.

See Gu et al., eqs. 6 to 8 and 10. Everything broadcasts over leading axes: one call takes all edges.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from positioning.model import Array

MOTION_INFORMATION: Final[Array] = np.diag([1.0, 1.0, 20.0])
"""Information of a step of dead reckoning: per square metre, twice, and per square radian; eq. 8."""
D_MIN_M: Final = 2.0
"""Poses that are nearer than this do not contradict a proximity edge; section III-B."""
D_MAX_M: Final = 30.0
"""From here on the error of a proximity edge does not grow; section III-B."""

# Two poses in one place have no direction between them; any number does, as it is multiplied by zero.
_NO_DISTANCE_M = 1e-12


def wrap(angle_rad: ArrayLike) -> Array:
    """Return angles in [-pi, pi), radians."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def relative_pose(pose_from: ArrayLike, pose_to: ArrayLike) -> Array:
    """Return the second pose as seen from the first.

    See Gu et al., eq. 6, solved for u.

    Parameters
    ----------
    pose_from, pose_to
        x and y, metres, and heading, radians, [..., 3].

    Returns
    -------
    Array
        Forward and left, metres, and turn, radians, not wrapped, [..., 3].
    """
    start, end = np.asarray(pose_from, dtype=np.float64), np.asarray(pose_to, dtype=np.float64)
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    offset = end - start
    forward = cos * offset[..., 0] + sin * offset[..., 1]
    left = cos * offset[..., 1] - sin * offset[..., 0]
    return np.stack([forward, left, offset[..., 2]], axis=-1)


def move(pose: ArrayLike, motion: ArrayLike) -> Array:
    """Return the pose after a motion.

    See Gu et al., eq. 6.

    Parameters
    ----------
    pose
        x and y, metres, and heading, radians, [..., 3].
    motion
        Forward and left, metres, and turn, radians, [..., 3].
    """
    start, step = np.asarray(pose, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    x_m = start[..., 0] + step[..., 0] * cos - step[..., 1] * sin
    y_m = start[..., 1] + step[..., 0] * sin + step[..., 1] * cos
    return np.stack([x_m, y_m, start[..., 2] + step[..., 2]], axis=-1)


def motion_residual(pose_from: ArrayLike, pose_to: ArrayLike, motion: ArrayLike) -> Array:
    """Return the motion between two poses less the measured one, the turn wrapped.

    See Gu et al., eq. 7.

    Parameters
    ----------
    pose_from, pose_to
        [..., 3].
    motion
        Forward and left, metres, and turn, radians, [..., 3].

    Returns
    -------
    Array
        [..., 3], metres, metres and radians; the turn in [-pi, pi).
    """
    residual = relative_pose(pose_from, pose_to) - np.asarray(motion, dtype=np.float64)
    residual[..., 2] = wrap(residual[..., 2])
    return residual


def motion_jacobians(pose_from: ArrayLike, pose_to: ArrayLike) -> tuple[Array, Array]:
    """Return the derivatives of `motion_residual` by the first and by the second pose.

    Parameters
    ----------
    pose_from, pose_to
        [..., 3].

    Returns
    -------
    by_from, by_to
        Each [..., 3, 3], residual by pose.
    """
    start = np.asarray(pose_from, dtype=np.float64)
    relative = relative_pose(start, pose_to)
    by_to = np.zeros((*relative.shape, 3))
    by_to[..., 0, 0] = by_to[..., 1, 1] = np.cos(start[..., 2])
    by_to[..., 0, 1] = np.sin(start[..., 2])
    by_to[..., 1, 0] = -by_to[..., 0, 1]
    by_to[..., 2, 2] = 1.0
    by_from = -by_to
    by_from[..., 0, 2] = relative[..., 1]
    by_from[..., 1, 2] = -relative[..., 0]
    return by_from, by_to


def near_residual(
    pose_from: ArrayLike,
    pose_to: ArrayLike,
    *,
    e_max: float = 1.0,
    d_min_m: float = D_MIN_M,
    d_max_m: float = D_MAX_M,
) -> Array:
    """Return how far two poses contradict that their fingerprints are alike.

    See Gu et al., eq. 10: zero below ``d_min_m``, ``e_max`` above ``d_max_m``, a straight line between.

    Parameters
    ----------
    pose_from, pose_to
        [..., 3] or [..., 2]; the heading is not used.
    e_max
        Largest error, without unit; the paper gives no value, and only its product with the weight counts.
    d_min_m, d_max_m
        Ends of the straight line, metres.

    Returns
    -------
    Array
        [...], without unit.
    """
    _, distance_m = _between(pose_from, pose_to)
    return near_error(distance_m, e_max=e_max, d_min_m=d_min_m, d_max_m=d_max_m)


def near_error(distance_m: Array, *, e_max: float, d_min_m: float, d_max_m: float) -> Array:
    """Return `near_residual` of poses at this distance, metres, [...]."""
    return np.asarray(e_max * np.clip((distance_m - d_min_m) / (d_max_m - d_min_m), 0.0, 1.0))


def near_jacobians(
    pose_from: ArrayLike,
    pose_to: ArrayLike,
    *,
    e_max: float = 1.0,
    d_min_m: float = D_MIN_M,
    d_max_m: float = D_MAX_M,
) -> tuple[Array, Array]:
    """Return the derivatives of `near_residual` by the first and by the second pose.

    Both are zero up to ``d_min_m`` and from ``d_max_m``: poses that are too far apart do not attract.

    Returns
    -------
    by_from, by_to
        Each [..., 3], by x, y and heading.
    """
    offset_m, distance_m = _between(pose_from, pose_to)
    between = (distance_m > d_min_m) & (distance_m < d_max_m)
    slope = np.where(between, e_max / (d_max_m - d_min_m), 0.0) / np.maximum(distance_m, _NO_DISTANCE_M)
    by_to = np.concatenate([slope[..., None] * offset_m, np.zeros((*slope.shape, 1))], axis=-1)
    return -by_to, by_to


def _between(pose_from: ArrayLike, pose_to: ArrayLike) -> tuple[Array, Array]:
    offset_m = np.asarray(pose_to, dtype=np.float64)[..., :2] - np.asarray(pose_from, np.float64)[..., :2]
    return offset_m, np.asarray(np.hypot(offset_m[..., 0], offset_m[..., 1]))
