"""Steps of a foot, made of its navigation, and how the sensor is turned on the foot.

See Frank et al., section 3.3.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.inertial.foot import FootNavigation
from positioning.inertial.rest import spans
from positioning.model import Array


class Steps(NamedTuple):
    """Steps of the instrumented foot, each [r, s]; NaN fills up.

    Attributes
    ----------
    time_s
        When each step was complete: the first sample of the rest behind it.
    forward_m, left_m
        Displacement, in the frame of the heading before the step.
    turn_rad
        Change of the heading, from -pi to pi, positive to the left.
    """

    time_s: Array
    forward_m: Array
    left_m: Array
    turn_rad: Array


def steps(navigation: FootNavigation) -> Steps:
    """Return what a step sensor on the foot measures.

    See Frank et al., section 3.3, eqs. 3 to 5, without the misalignment of the sensor, for which there are
    `misalignment_rad` and `aligned`. The state is stored at the first sample of each rest, after its update.

    Parameters
    ----------
    navigation
        Of a stack.
    """
    begins = [span[:, 0] for span in spans(navigation.rest)]
    most = max((len(begin) for begin in begins), default=0) - 1
    found = np.full((4, len(begins), max(most, 0)), np.nan)
    for row, begin in enumerate(begins):
        if len(begin) < 2:
            continue
        place, heading = navigation.position_m[row, begin, :2], navigation.heading_rad[row, begin]
        east, north = np.diff(place, axis=0).T
        ahead, aside = np.cos(heading[:-1]), np.sin(heading[:-1])
        turn = np.diff(heading)
        found[:, row, : len(begin) - 1] = (
            navigation.time_s[row, begin[1:]],
            ahead * east + aside * north,
            ahead * north - aside * east,
            np.arctan2(np.sin(turn), np.cos(turn)),
        )
    return Steps(*found)


def misalignment_rad(
    made: Steps, *, count: int = 5, least_step_m: float = 0.5, most_turn_rad: float = 0.2
) -> Array:
    """Return the direction of the walk in the frame of the sensor, [r], from the first straight steps.

    See Frank et al., section 3.3: Psi_eps, which has to be fixed initially; how is not said. Assumed: the
    direction of the sum of the first ``count`` steps that are neither short nor part of a turn.

    Parameters
    ----------
    made
        Steps of a stack.
    count
        How many steps are added up.
    least_step_m
        Shorter ones do not count: the first and the last one of a walk.
    most_turn_rad
        Steps with more of a turn do not count.

    Returns
    -------
    Array
        [r]; zero where there is no such step.
    """
    straight = straight_steps(made, least_step_m=least_step_m, most_turn_rad=most_turn_rad)
    straight &= np.cumsum(straight, axis=-1) <= count
    left, forward = (
        np.cumsum(np.where(straight, part, 0.0), axis=-1)[..., -1]
        if part.shape[-1]
        else np.zeros(part.shape[:-1])
        for part in (made.left_m, made.forward_m)
    )
    return np.asarray(np.arctan2(left, forward))


def straight_steps(made: Steps, *, least_step_m: float, most_turn_rad: float) -> NDArray[np.bool_]:
    """Return which steps are neither short nor part of a turn, [r, s], as in `misalignment_rad`.

    See Frank et al., section 3.3.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(
            (np.hypot(made.forward_m, made.left_m) >= least_step_m) & (np.abs(made.turn_rad) <= most_turn_rad)
        )


def aligned(made: Steps, misalignment: ArrayLike) -> Steps:
    """Return steps in the frame of the pedestrian.

    See Frank et al., eq. 4.

    Parameters
    ----------
    made
        Steps of a stack.
    misalignment
        Direction of the walk in the frame of the sensor, [r], radians.
    """
    angle = np.asarray(misalignment, dtype=np.float64)[..., None]
    ahead, aside = np.cos(angle), np.sin(angle)
    return made._replace(
        forward_m=ahead * made.forward_m + aside * made.left_m,
        left_m=ahead * made.left_m - aside * made.forward_m,
    )
