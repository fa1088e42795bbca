"""Walks that are to be aligned: what must hold of them, and the motion between their poses."""

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.geometry import rotated
from positioning.model import Array, Walks

_MOST_TURN_RAD = 2 * np.pi


def check_walks(walks: Walks) -> NDArray[np.bool_]:
    """Return which poses exist, [k, n], of walks that can be used.

    A walk of one pose, or one that never hears anything, is allowed: it stays where its dead reckoning is.

    Parameters
    ----------
    walks
        One world, without leading axes.

    Raises
    ------
    InputError
        For arrays that do not fit each other, a walk without a pose, times that do not increase or are
        missing in between, poses that are not numbers, headings that turn by more than a whole turn from one
        pose to the next (degrees do), or strengths that are infinite or not below 0 dBm.
    """
    time_s = np.asarray(walks.time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.size == 0:
        raise InputError(
            "walks.time_s", f"its shape is {time_s.shape}", "Give [walk, pose] with a pose or more"
        )
    there = ~np.isnan(time_s)
    position_m, heading_rad = np.asarray(walks.position_m), np.asarray(walks.heading_rad)
    rss_dbm = np.asarray(walks.rss_dbm)
    for name, found, shape in (
        ("position_m", position_m.shape, (*time_s.shape, 2)),
        ("heading_rad", heading_rad.shape, time_s.shape),
        ("rss_dbm", rss_dbm.shape[:-1], time_s.shape),
    ):
        if found != shape:
            raise InputError(
                f"walks.{name}", f"its shape {found} does not fit {shape} of time_s", "Give every pose one"
            )
    length = np.count_nonzero(there, axis=1)
    _refuse("walks.time_s", length == 0, "the walk has no pose", "Leave it out")
    _refuse("walks.time_s", np.isinf(time_s), "the time is infinite", "Use NaN after the end of a walk")
    last = time_s.shape[1] - 1 - np.argmax(there[:, ::-1], axis=1)
    missing = ~there & (np.arange(time_s.shape[1]) < last[:, None])
    _refuse("walks.time_s", missing, "the time is missing before the end", "Use NaN after the end only")
    with np.errstate(invalid="ignore"):
        backwards = np.diff(time_s, axis=1, prepend=-np.inf) <= 0
    _refuse("walks.time_s", backwards & there, "time does not increase", "Sort the poses by time")
    for name, known in (
        ("position_m", np.isfinite(position_m).all(axis=-1)),
        ("heading_rad", np.isfinite(heading_rad)),
    ):
        _refuse(f"walks.{name}", ~known & there, "the pose is not a number", "Dead reckon every pose")
    # Wrapped headings may jump by nearly a whole turn, and people turn about between two scans.
    turned = np.abs(np.diff(heading_rad, axis=1, prepend=heading_rad[:, :1])) > _MOST_TURN_RAD
    cure = "Give headings in radians, not in degrees"
    _refuse("walks.heading_rad", turned & there, "it is more than a whole turn from the pose before", cure)
    _refuse("walks.rss_dbm", np.isinf(rss_dbm), "a strength is infinite", "Use NaN for not heard")
    with np.errstate(invalid="ignore"):
        loud = rss_dbm >= 0
    cure = "Use NaN for not heard, and dBm for what is"
    _refuse("walks.rss_dbm", loud, "a strength is not below 0 dBm", cure)
    return there


def motion(position_m: Array, heading_rad: Array) -> Array:
    """Return the change from each pose to the next in the frame of the former.

    See Gu et al., eq. 6: this is u, from the poses that the foot-mounted module gives.

    Parameters
    ----------
    position_m, heading_rad
        Poses, [..., n, 2] and [..., n], metres and radians.

    Returns
    -------
    Array
        Forward, left and turn, [..., n - 1, 3], metres and radians; the turn as it is, not wrapped.
    """
    step_m = rotated(np.diff(position_m, axis=-2), -np.asarray(heading_rad)[..., :-1])
    return np.concatenate([step_m, np.diff(heading_rad, axis=-1)[..., None]], axis=-1)


def _refuse(name: str, bad: NDArray[np.bool_], what: str, cure: str) -> None:
    if bad.any():
        where = [int(i) for i in np.argwhere(bad)[0]]
        raise InputError(f"{name}{where}", what, cure)
