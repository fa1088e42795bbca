"""Many samples of an inertial unit between two updates as one, for a filter without biases.

See Groves (2013), section 5.4, and Frank et al., section 3.1. Where nothing is measured in between, what n
samples do to navigation and covariance is a product of matrices, which is known before the navigation is but
for the attitude at the start. So a filter need not stop at each sample of a swing; its answer is the same.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.inertial.strapdown import mean_rotation, rotation
from positioning.model import Array

MOMENTS = 8
"""Size of the vector that a noise is carried on by: way (3), advance (3), one, and time."""
_FILLED = 32
_WAY, _ADVANCE, _ONE, _TIME = slice(0, 3), slice(3, 6), 6, 7


class Merged(NamedTuple):
    """Samples of w worlds that are taken as one each, in the frame of the sensor before them.

    Attributes
    ----------
    world
        Which worlds have more than one sample, [k]; the others have what `Increments` tells.
    way_m
        Double integral of their specific force over the samples, [3, k].
    moments
        Sum of the outer products of (way, advance, 1, time) from the end of each sample to that of the last
        one, times its duration, [k, 8, 8]: with the attitude, all that the noise of the samples does.
    """

    world: NDArray[np.intp]
    way_m: Array
    moments: Array


class Sums(NamedTuple):
    """What m runs of samples do together, each [m, ...].

    Attributes
    ----------
    rotation
        [m, 3, 3].
    advance_m_per_s, way_m
        Integral and double integral of the specific force, [m, 3], in the frame before the first sample.
    duration_s
        [m].
    moments
        As in `Merged`, [m, 8, 8].
    """

    rotation: Array
    advance_m_per_s: Array
    way_m: Array
    duration_s: Array
    moments: Array


def merge(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    duration_s: ArrayLike,
    count: NDArray[np.intp],
) -> Sums:
    """Integrate runs of samples, each as `strapdown.navigate` does.

    See Groves (2013), section 5.4.

    Parameters
    ----------
    specific_force_m_per_s2, angular_rate_rad_per_s
        [n, 3], in the frame of the sensor: the first samples of all runs, then the second ones of those that
        have one, and so on.
    duration_s
        [n].
    count
        Samples of each run, [m], the longest first; n is their sum.
    """
    duration, runs = np.asarray(duration_s, dtype=np.float64), len(count)
    turn = np.asarray(angular_rate_rad_per_s, dtype=np.float64) * duration[:, None]
    impulse = np.asarray(specific_force_m_per_s2, dtype=np.float64) * duration[:, None]
    own = np.sum(mean_rotation(turn) * impulse[:, None], axis=-1)
    turned = rotation(turn)
    # How many runs still go on at each sample, and where these samples lie.
    going = np.searchsorted(-count, -np.arange(count[0]), side="left")
    ends = np.cumsum(going)
    parts = [(many, slice(end - many, end)) for many, end in zip(going.tolist(), ends.tolist(), strict=True)]
    attitude = np.broadcast_to(np.eye(3), (runs, 3, 3)).copy()
    # Way, advance and time until the end of each sample.
    until = np.empty((len(duration), MOMENTS - 1))
    now = np.zeros((runs, MOMENTS - 1))
    for many, here in parts:
        some, lasts = now[:many], duration[here, None]
        step = np.sum(attitude[:many] * own[here, None], axis=-1)
        some[:, _WAY] += lasts * (some[:, _ADVANCE] + 0.5 * step)
        some[:, _ADVANCE] += step
        some[:, 6] += duration[here]
        attitude[:many] = attitude[:many] @ turned[here]
        until[here] = some
    left = np.ones((len(duration), MOMENTS))
    for many, here in parts:
        np.subtract(now[:many, :6], until[here, :6], out=left[here, :6])
        np.subtract(now[:many, 6], until[here, 6], out=left[here, _TIME])
    left[:, _WAY] -= until[:, _ADVANCE] * left[:, _TIME, None]
    left *= np.sqrt(duration)[:, None]
    return Sums(attitude, now[:, _ADVANCE], now[:, _WAY], now[:, 6], _moments(left, count, ends - going))


def _moments(vector: Array, count: NDArray[np.intp], begins: NDArray[np.intp]) -> Array:
    """Return sums of the outer products of the vectors of each run, in the order of `merge`."""
    moments = np.empty((len(count), MOMENTS, MOMENTS))
    # Zeros fill up to a length that hangs on that of a run alone, and so do the bits of its sums.
    blocks = -(-count // _FILLED)
    for size in np.unique(blocks):
        run = np.flatnonzero(blocks == size)
        inside = np.arange(size * _FILLED)
        there = inside < count[run, None]
        filled = np.zeros((len(run), len(inside), MOMENTS))
        filled[there] = vector[(begins[np.minimum(inside, len(begins) - 1)] + run[:, None])[there]]
        moments[run] = filled.swapaxes(1, 2) @ filled
    return moments


def noise_of_moments(force_density: float, rate_density: float, heading_density: float) -> Array:
    """Return what leads moments to the covariance that the noise of their samples leaves, [64, 81].

    See Groves (2013), section 3.2.3. The moments are in the navigation frame, the covariance is that of
    position, velocity and attitude. Left out is what `ErrorStateFilter.predict` adds for any sample: density
    times duration.

    Parameters
    ----------
    force_density, rate_density, heading_density
        Of force and rate along each axis, and of the heading beside it: squares of `ProcessNoise`.
    """
    found = np.zeros((9, 9, MOMENTS, MOMENTS))
    for axis in range(3):
        moved = np.zeros((9, MOMENTS))
        moved[axis, _TIME] = moved[3 + axis, _ONE] = 1.0
        found += force_density * np.einsum("ia,jb->ijab", moved, moved)
        found[3 + axis, 3 + axis, _ONE, _ONE] -= force_density
        # A rotation of the error about an axis turns way and advance, by their cross products with it.
        turned = np.zeros((9, MOMENTS))
        turned[:3, _WAY] = turned[3:6, _ADVANCE] = _crossed_by(axis)
        turned[6 + axis, _ONE] = 1.0
        density = rate_density + heading_density * (axis == 2)
        found += density * np.einsum("ia,jb->ijab", turned, turned)
        found[6 + axis, 6 + axis, _ONE, _ONE] -= density
    return np.ascontiguousarray(found.reshape(81, -1).T)


def _crossed_by(axis: int) -> Array:
    """Return the matrix that leads a vector to the cross product of an axis with it."""
    return np.cross(np.eye(3)[axis], np.eye(3)).T
