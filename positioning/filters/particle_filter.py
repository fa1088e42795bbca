"""Steps of a particle filter, for many filters in lock-step.

States are [..., particle, state]. The steps are fastest where the particles of one state variable lie
together in memory, as `empty_states` makes them. Nothing here depends on how many filters run side by
side: each has a generator of its own, and sums run over its own particles only.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.filters.resampling import Index, effective_sample_size, linear_time
from positioning.model import Array

Fusion = Literal["sum", "product"]
Generators = Sequence[np.random.Generator]

# Values of one array that is worked on at a time: four of them fit into the second-level cache.
_BLOCK = 1 << 14


def empty_states(filters: int, particles: int, states: int) -> Array:
    """Return uninitialised states [filter, particle, state], with each variable's particles side by side."""
    return np.swapaxes(np.empty((filters, states, particles)), -1, -2)


def standard_normal(rngs: Generators, shape: tuple[int, ...]) -> Array:
    """Return standard normal draws [filter, *shape], each filter's from its own generator."""
    draws = np.empty((len(rngs), *shape))
    for rng, row in zip(rngs, draws, strict=True):
        rng.standard_normal(out=row)
    return draws


def uniform(rngs: Generators, shape: tuple[int, ...]) -> Array:
    """Return draws from [0, 1), [filter, *shape], each filter's from its own generator."""
    draws = np.empty((len(rngs), *shape))
    for rng, row in zip(rngs, draws, strict=True):
        rng.random(out=row)
    return draws


def normalise(log_weight: ArrayLike) -> Array:
    """Return weights that sum to one from their logarithms, [..., p].

    See Raghavan et al., section IV.C. Where all logarithms are minus infinity nothing is known any more: all
    weights are equal.
    """
    logarithm = np.asarray(log_weight, dtype=np.float64)
    largest = np.max(logarithm, axis=-1, keepdims=True)
    impossible = np.isneginf(largest)
    if impossible.any():
        logarithm = np.where(impossible, 0.0, logarithm)
        largest = np.where(impossible, 0.0, largest)
    weight = np.exp(logarithm - largest)
    return np.asarray(weight / np.sum(weight, axis=-1, keepdims=True))


def reweight(weight: Array, log_likelihood: Array) -> Array:
    """Return the weights after a measurement, [..., p].

    See Raghavan et al., section IV.C, update. Where the measurement is impossible for every particle that
    has a weight (all products vanish in double precision), the measurement is taken for an outlier and the
    prior weights stay.

    Parameters
    ----------
    weight
        Prior weights that sum to one, [..., p].
    log_likelihood
        [..., p]; minus infinity is allowed.
    """
    largest = np.max(log_likelihood, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):
        posterior = weight * np.exp(log_likelihood - largest)
    total = np.sum(posterior, axis=-1, keepdims=True)
    known = total > 0
    posterior /= np.where(known, total, 1.0)
    return posterior if known.all() else np.where(known, posterior, weight)


def gaussian_mixture_log_likelihood(
    position_m: ArrayLike, fix_m: ArrayLike, sigma_m: ArrayLike, fusion: Fusion = "sum"
) -> Array:
    """Return the log-likelihood of places under a Gaussian about each fix.

    See Raghavan et al., section IV.E. How the fixes of one epoch come together is not printed: "sum" takes
    them for alternatives of which one is right (a mixture with equal weights), "product" for independent
    measurements. For a single fix both are the printed product over x and y.

    Parameters
    ----------
    position_m
        Places, [..., p, 2], metres.
    fix_m
        Fixes, [..., k, 2], metres; NaN fills up.
    sigma_m
        Standard deviation of each coordinate, scalar or [...], metres.
    fusion
        "sum" or "product".

    Returns
    -------
    Array
        [..., p]; zero where there is no fix. With "sum", minus infinity where the density of all fixes
        vanishes in double precision, which is from 38 standard deviations on.

    Raises
    ------
    InputError
        For shapes that do not fit, a standard deviation that is not positive, an infinite fix, or another
        fusion.
    """
    position, fix = np.asarray(position_m, dtype=np.float64), np.asarray(fix_m, dtype=np.float64)
    sigma = np.asarray(sigma_m, dtype=np.float64)
    leading = position.shape[:-2]
    if position.ndim < 2 or position.shape[-1] != 2 or (*fix.shape[:-2], fix.shape[-1]) != (*leading, 2):
        raise InputError(
            "position_m, fix_m",
            f"shapes {position.shape} and {fix.shape} do not fit [..., p, 2] and [..., k, 2]",
            "Give places and fixes the same leading axes",
        )
    if not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise InputError(f"sigma_m={sigma}", "it must be positive", "Choose a deviation in metres, such as 1")
    if np.isinf(fix).any():
        raise InputError("fix_m", "a fix is infinite", "Use NaN where there is no fix")
    if fusion not in ("sum", "product"):
        raise InputError(f"fusion={fusion!r}", "it must be one of sum, product", "Choose one of them")
    filters, particles = int(np.prod(leading, dtype=np.int64)), position.shape[-2]
    fix = fix.reshape(filters, *fix.shape[-2:])
    there = ~np.isnan(fix).any(axis=-1)
    count = np.count_nonzero(there, axis=-1)
    # Fixes first, in their order; then the filters with most of them first, so that those that still have
    # a fix are always the first ones.
    fix = np.take_along_axis(fix, np.argsort(~there, axis=-1, kind="stable")[..., None], axis=-2)
    busiest = np.argsort(-count, kind="stable")
    place = position.reshape(filters, particles, 2)
    result = np.zeros((filters, particles))
    kernel = _log_mixture if fusion == "sum" else _log_product
    precision = np.broadcast_to(sigma, leading).reshape(filters) ** -2.0
    step = max(1, _BLOCK // max(particles, 1))
    for start in range(0, int(np.count_nonzero(count)), step):
        rows = busiest[start : start + step]
        rows = rows[count[rows] > 0]
        result[rows] = kernel(
            place[rows, :, 0], place[rows, :, 1], fix[rows], count[rows], precision[rows, None]
        )
    return result.reshape(*leading, particles)


def _log_mixture(x_m: Array, y_m: Array, fix_m: Array, count: NDArray[np.intp], precision: Array) -> Array:
    total, away, across = np.zeros_like(x_m), np.empty_like(x_m), np.empty_like(x_m)
    for number in range(int(count[0])):
        busy = slice(0, int(np.count_nonzero(count > number)))
        squared, other = away[busy], across[busy]
        np.subtract(x_m[busy], fix_m[busy, number, 0, None], out=squared)
        np.multiply(squared, squared, out=squared)
        np.subtract(y_m[busy], fix_m[busy, number, 1, None], out=other)
        np.multiply(other, other, out=other)
        np.add(squared, other, out=squared)
        np.multiply(squared, -0.5 * precision[busy], out=squared)
        np.exp(squared, out=squared)
        np.add(total[busy], squared, out=total[busy])
    with np.errstate(divide="ignore"):
        np.log(total, out=total)
    total += np.log(precision / (2 * np.pi * count[:, None]))
    return total


def _log_product(x_m: Array, y_m: Array, fix_m: Array, count: NDArray[np.intp], precision: Array) -> Array:
    # The sum of squared distances to all fixes is that to their mean, k times, and their own spread. Running
    # sums add one after the other, so that what fills up leaves no trace.
    number = count[:, None]
    missing = np.isnan(fix_m)
    mean = np.cumsum(np.where(missing, 0.0, fix_m), axis=1)[:, -1] / number
    offset = np.where(missing, 0.0, fix_m - mean[:, None])
    spread = np.cumsum(np.cumsum(offset * offset, axis=1)[:, -1], axis=-1)[:, -1:]
    squared = number * ((x_m - mean[:, 0, None]) ** 2 + (y_m - mean[:, 1, None]) ** 2) + spread
    return np.asarray(-0.5 * precision * squared + number * np.log(precision / (2 * np.pi)))


def select(state: Array, index: Index) -> Array:
    """Return the particles that resampling has chosen, [..., n, state]."""
    variables = np.take_along_axis(np.swapaxes(state, -1, -2), index[..., None, :], axis=-1)
    return np.swapaxes(variables, -1, -2)


def resample(state: Array, weight: Array, share: float, rngs: Generators) -> NDArray[np.bool_]:
    """Resample, in place, the filters whose effective sample size has become too small.

    See Raghavan et al., section IV.C, degeneracy, and `linear_time`.

    Parameters
    ----------
    state
        [filter, particle, state]; changed.
    weight
        Weights that sum to one, [filter, particle]; changed.
    share
        Resample where the effective sample size is below this share of the particles.
    rngs
        One generator a filter, which draws only where its filter is resampled.

    Returns
    -------
    NDArray
        Which filters were resampled, [filter].
    """
    particles = weight.shape[-1]
    low = effective_sample_size(weight) < share * particles
    rows = np.flatnonzero(low)
    if len(rows):
        draws = uniform([rngs[int(row)] for row in rows], (particles + 1,))
        state[rows] = select(state[rows], linear_time(weight[rows], draws))
        weight[rows] = 1.0 / particles
    return np.asarray(low)


def weighted_mean(state: Array, weight: Array) -> Array:
    """Return the mean of weighted particles, [..., state].

    See Raghavan et al., section IV.C.

    Parameters
    ----------
    state
        [..., particle, state].
    weight
        Weights that sum to one, [..., particle].
    """
    # In C order, so that the sum runs along memory, and is the same for any number of filters.
    variables = np.multiply(np.swapaxes(state, -1, -2), weight[..., None, :], order="C")
    return np.asarray(np.sum(variables, axis=-1))


def weighted_covariance(state: Array, weight: Array) -> Array:
    """Return the covariance of weighted particles about their mean, [..., state, state].

    See Raghavan et al., section IV.C. Parameters as in `weighted_mean`.
    """
    mean = weighted_mean(state, weight)
    offset = np.subtract(np.swapaxes(state, -1, -2), mean[..., None], order="C")
    states = offset.shape[-2]
    covariance = np.empty((*mean.shape, states))
    for first in range(states):
        weighted = offset[..., first, :] * weight
        for second in range(first + 1):
            value = np.sum(weighted * offset[..., second, :], axis=-1)
            covariance[..., first, second] = covariance[..., second, first] = value
    return covariance
