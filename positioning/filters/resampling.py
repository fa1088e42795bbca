"""Resampling of weighted particles: which particle each new one copies.

All functions broadcast over leading axes, and each leading index has uniform draws of its own: what is
drawn for one filter does not depend on how many run beside it.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.model import Array

Index = NDArray[np.intp]

# n w of equal weights may round to just below one, which is one copy, not none.
_ROUNDING = 1e-9


def effective_sample_size(weight: ArrayLike) -> Array:
    """Return how many equally weighted particles would be worth as much as these.

    See Raghavan et al., section IV.C, with the square that the printed coefficient of variation lost:
    N / (1 + mean of (N w - 1)^2) = 1 / sum of w^2. As printed, the mean of N w - 1 is zero and the size
    is always N.

    Parameters
    ----------
    weight
        Weights that sum to one, [..., n].

    Returns
    -------
    Array
        [...], from 1 to n.
    """
    weights = np.asarray(weight, dtype=np.float64)
    return np.asarray(1.0 / np.sum(weights * weights, axis=-1))


def systematic(weight: ArrayLike, uniform: ArrayLike) -> Index:
    """Resample at equal steps with one random start.

    See Arulampalam et al. (2002), algorithm 2. A particle of weight w has the floor or the ceiling of n w
    copies.

    Parameters
    ----------
    weight
        Weights, [..., n]; they need not sum to one.
    uniform
        Draws from [0, 1), [...].

    Returns
    -------
    NDArray
        Index of the particle that each new one copies, [..., n], ascending.

    Raises
    ------
    InputError
        For weights or draws that cannot be used.
    """
    weights = _weights(weight)
    draws = _draws(uniform, weights.shape[:-1])
    count = weights.shape[-1]
    return _merge(weights, (np.arange(count) + draws[..., None]) / count)


def stratified(weight: ArrayLike, uniform: ArrayLike) -> Index:
    """Resample with one draw in each of n equal parts.

    See Kitagawa (1996), section A.1. Parameters, result and errors as in `systematic`, with draws [..., n].
    """
    weights = _weights(weight)
    draws = _draws(uniform, weights.shape)
    count = weights.shape[-1]
    return _merge(weights, (np.arange(count) + draws) / count)


def multinomial(weight: ArrayLike, uniform: ArrayLike) -> Index:
    """Resample with n independent draws.

    See Gordon et al. (1993). Parameters, result and errors as in `systematic`, with draws [..., n].
    """
    weights = _weights(weight)
    return _merge(weights, np.sort(_draws(uniform, weights.shape), axis=-1))


def linear_time(weight: ArrayLike, uniform: ArrayLike) -> Index:
    """Resample with n independent draws that come sorted, so that nothing has to be sorted.

    See Raghavan et al., section IV.C, which takes it from Carpenter et al. (1997): running sums of
    n + 1 exponential draws, divided by the last of them, are distributed as n sorted uniform ones.
    Parameters, result and errors as in `systematic`, with draws [..., n + 1].
    """
    weights = _weights(weight)
    draws = _draws(uniform, (*weights.shape[:-1], weights.shape[-1] + 1))
    running = np.cumsum(-np.log1p(-draws), axis=-1)
    # All draws zero: no room between any two of them, and all at the start.
    total = np.maximum(running[..., -1:], np.finfo(np.float64).tiny)
    return _merge(weights, running[..., :-1] / total)


def residual(weight: ArrayLike, uniform: ArrayLike) -> Index:
    """Copy each particle as often as the whole part of n w says, and draw the rest independently.

    See Liu & Chen (1998). The rest is drawn with the fractional parts of n w as weights.
    Parameters, result and errors as in `systematic`, with draws [..., n], of which the first are used.
    """
    weights = _weights(weight)
    draws = _draws(uniform, weights.shape)
    count = weights.shape[-1]
    share = count * (weights / np.sum(weights, axis=-1, keepdims=True))
    copies = np.floor(share + _ROUNDING).astype(np.intp)
    rest = np.maximum(share - copies, 0.0)
    missing = count - np.sum(copies, axis=-1, keepdims=True)
    # Where nothing is missing, the weights of the rest may all be zero, and do not matter.
    rest = np.where(missing > 0, rest, 1.0)
    used = np.arange(count) < missing
    drawn = _merge(rest, np.sort(np.where(used, draws, np.inf), axis=-1))
    rows = np.arange(copies.size // count).reshape(*copies.shape[:-1], 1)
    flat = copies.reshape(-1)
    flat += np.bincount((rows * count + drawn)[used], minlength=flat.size)
    return np.repeat(np.broadcast_to(np.arange(count), copies.shape).reshape(-1), flat).reshape(copies.shape)


def _merge(weight: Array, position: Array) -> Index:
    """Return the first particle whose cumulative weight exceeds each position.

    Parameters
    ----------
    weight
        [..., n].
    position
        Shares of the total weight, [..., m], ascending; those above one give the last particle.
    """
    count, cumulative = weight.shape[-1], np.cumsum(weight, axis=-1)
    both = np.concatenate([cumulative, position * cumulative[..., -1:]], axis=-1)
    # Two ascending runs: the stable sort merges them in linear time. At a tie the cumulative weight
    # goes first, so that a particle of weight zero is never chosen.
    chosen = np.argsort(both, axis=-1, kind="stable") >= count
    place = np.nonzero(chosen)[-1].reshape(position.shape)
    # The n-th of the positions has as many cumulative weights before it as its place says, less n.
    index = place - np.arange(position.shape[-1])
    # Rounding may put the last position at the total, behind all particles.
    last = count - 1 - np.argmax(weight[..., ::-1] > 0, axis=-1)
    return np.asarray(np.minimum(index, last[..., None]))


def _weights(weight: ArrayLike) -> Array:
    weights = np.asarray(weight, dtype=np.float64)
    usable = weights.ndim > 0 and weights.shape[-1] > 0
    if usable and weights.size:
        with np.errstate(invalid="ignore"):
            total = np.sum(weights, axis=-1)
            usable = bool(weights.min() >= 0 and np.isfinite(total).all() and (total > 0).all())
    if not usable:
        raise InputError(
            "weights",
            f"shape {weights.shape} with negative or infinite values or NaN, or all of them zero",
            "Normalise the weights before resampling",
        )
    return weights


def _draws(uniform: ArrayLike, shape: tuple[int, ...]) -> Array:
    draws = np.asarray(uniform, dtype=np.float64)
    if draws.shape != shape:
        raise InputError("uniform draws", f"their shape is {draws.shape}, not {shape}", "Draw that many")
    if draws.size and not (draws.min() >= 0 and draws.max() < 1):
        raise InputError(
            "uniform draws", "a value is outside [0, 1)", "Draw them with numpy.random.Generator.random"
        )
    return draws
