"""What foot-mounted dead reckoning makes of a true walk, without simulating a sensor.

See Gu et al., section III.A: a zero-velocity-aided inertial filter reports the motion of each stride in the
frame of the body, and starts from an unknown place and heading. Random numbers come in as standard normals
and are scaled here: worlds of equal seeds share them whatever the size of the errors.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.model import Array
from positioning.simulation.imu import gauss_markov


@dataclass(frozen=True, kw_only=True)
class FootErrors:
    """The errors of dead reckoning with a foot-mounted inertial filter.

    The paper reports none (Gu et al., section IV.A, names drift of up to about 30 m).

    Attributes
    ----------
    stride_s
        Time of a stride: from one stance of the foot to its next.
    stride_m
        Length of the stride for which the noises below are stated. The variance of what adds up over an
        interval goes with the distance walked in it, so that standing adds nothing.
    heading_noise_rad
        Standard deviation of the turn that a stride adds to the heading.
    drift_rad_per_s
        Standard deviation of the drift rate of the heading, a stationary first-order Gauss-Markov process;
        it goes on while standing.
    drift_correlation_s
        Correlation time of that process.
    scale_deviation
        Standard deviation of the scale of a walk's distances; 0.01 is one per cent.
    position_noise_m
        Standard deviation of what a stride adds to each coordinate.
    """

    stride_s: float
    stride_m: float
    heading_noise_rad: float
    drift_rad_per_s: float
    drift_correlation_s: float
    scale_deviation: float
    position_noise_m: float

    def __post_init__(self) -> None:
        """Refuse errors that cannot be."""
        for name, value in vars(self).items():
            positive = name in ("stride_s", "stride_m", "drift_correlation_s")
            if not (np.isfinite(value) and value >= 0 and (value > 0 or not positive)):
                least = "a positive number" if positive else "zero or more"
                raise InputError(f"errors, {name}", f"{value} is not {least}", "Give a finite value")


class FootDraws(NamedTuple):
    """The random numbers of dead reckoning, standard normals.

    Attributes
    ----------
    scale
        One a walk, [...].
    turn, drift
        One a stride, [..., s].
    position
        Two a stride, [..., s, 2].
    """

    scale: Array
    turn: Array
    drift: Array
    position: Array


class Reckoned(NamedTuple):
    """A dead-reckoned walk in a frame of its own.

    Attributes
    ----------
    position_m
        [..., n, 2], metres; (0, 0) at time zero.
    heading_rad
        [..., n], radians, not wrapped.
    """

    position_m: Array
    heading_rad: Array


def draw_foot(rng: np.random.Generator, strides: int) -> FootDraws:
    """Draw what the dead reckoning of one walk needs.

    See `FootErrors`.

    Parameters
    ----------
    rng
        Source of 1 + 4 ``strides`` standard normals.
    strides
        Number of strides.
    """
    return FootDraws(
        scale=np.asarray(rng.standard_normal()),
        turn=rng.standard_normal(strides),
        drift=rng.standard_normal(strides),
        position=rng.standard_normal((strides, 2)),
    )


def own_frame(
    position_m: ArrayLike, heading_rad: ArrayLike, start_m: ArrayLike, turn_rad: ArrayLike
) -> Reckoned:
    """Return a walk in a frame whose origin is its start and whose axes are turned.

    See Gu et al., eq. 2.

    Parameters
    ----------
    position_m
        Places, [..., n, 2], metres.
    heading_rad
        Headings, [..., n], radians.
    start_m
        What becomes the origin, [..., 2], metres.
    turn_rad
        What the walk is turned by about it, [...], radians to the left.
    """
    away = np.asarray(position_m, dtype=np.float64) - np.asarray(start_m)[..., None, :]
    turn = np.asarray(turn_rad, dtype=np.float64)[..., None]
    return Reckoned(_turned(away, turn), np.asarray(heading_rad) + turn)


def dead_reckon(
    stride_position_m: ArrayLike,
    time_s: ArrayLike,
    position_m: ArrayLike,
    heading_rad: ArrayLike,
    start_heading_rad: ArrayLike,
    draws: FootDraws,
    errors: FootErrors,
) -> Reckoned:
    """Return what dead reckoning reports of true walks.

    See Gu et al., eqs. 2 and 6. A stride leads as far, by the heading that it has in the dead reckoning,
    as the true one does by the true heading: the increments in the frame of the body are the true ones
    but for scale and noise, and all else comes from the error of the heading. Within a stride
    the errors grow evenly.

    Parameters
    ----------
    stride_position_m
        True places at the ends of the strides, [..., s + 1, 2], metres: at 0, ``stride_s``, ... seconds; at
        rest after the end of a walk.
    time_s
        Times of the poses, [..., n], seconds, the first of them zero; NaN after the end.
    position_m, heading_rad
        True poses, [..., n, 2] and [..., n], metres and radians, not wrapped.
    start_heading_rad
        Heading that the dead reckoning begins with, [...], radians: psi of eq. 2.
    draws
        Standard normals, [..., s] and so on.
    errors
        Their sizes.

    Raises
    ------
    InputError
        If a pose is before the first or after the last stride.
    """
    knot = np.asarray(stride_position_m, dtype=np.float64)
    time, place = np.asarray(time_s, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    heading = np.asarray(heading_rad, dtype=np.float64)
    strides = knot.shape[-2] - 1
    if np.nanmin(time) < 0 or np.nanmax(time) > strides * errors.stride_s * (1 + 1e-12):
        raise InputError(
            "time_s",
            f"a pose is not within the {strides} strides of {errors.stride_s} s",
            "Give a stride for every pose",
        )
    step = np.diff(knot, axis=-2)
    noise_scale = np.sqrt(np.hypot(step[..., 0], step[..., 1]) / errors.stride_m)
    drift = errors.drift_rad_per_s * gauss_markov(
        draws.drift, correlation=errors.drift_correlation_s / errors.stride_s
    )
    turn = errors.heading_noise_rad * noise_scale * draws.turn + errors.stride_s * drift
    heading_error = _from_zero(turn[..., None])[..., 0]
    scale = 1.0 + errors.scale_deviation * np.asarray(draws.scale)[..., None, None]
    # A stride has the heading of its middle; its noise is in the frame of the dead reckoning.
    way = heading_error[..., :-1] + turn / 2
    blur = errors.position_noise_m * noise_scale[..., None] * draws.position
    reckoned = _from_zero(scale * _turned(step, way) + blur)

    index = np.clip(np.nan_to_num(time) / errors.stride_s, 0, strides)
    stride = np.minimum(index.astype(np.int64), strides - 1)
    share = np.where(np.isnan(time), np.nan, index - stride)

    def of(values: Array) -> Array:
        if values.ndim > stride.ndim:
            return np.take_along_axis(values, stride[..., None], axis=-2)
        return np.take_along_axis(values, stride, axis=-1)

    found = of(reckoned) + scale * _turned(place - of(knot), of(way)) + share[..., None] * of(blur)
    facing = heading + of(heading_error) + share * of(turn)
    first = np.asarray(start_heading_rad, dtype=np.float64) - facing[..., 0]
    return own_frame(found, facing, found[..., 0, :], first)


def _from_zero(increment: Array) -> Array:
    """Return sums of increments [..., s, part] from zero on, [..., s + 1, part]."""
    none = np.zeros((*increment.shape[:-2], 1, increment.shape[-1]))
    return np.concatenate([none, np.cumsum(increment, axis=-2)], axis=-2)


def _turned(vector: Array, angle_rad: Array) -> Array:
    """Turn vectors [..., 2] by angles [...] to the left."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
