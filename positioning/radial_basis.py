"""Radial basis function networks: greedy choice of centres, and their weights, many folds at once."""

from typing import NamedTuple

import numpy as np

from positioning.errors import InputError
from positioning.fingerprints import Index, Mask
from positioning.model import Array

KERNELS = ("paper", "newrb")

# A candidate's squared norm is down-dated by subtraction. Below this part of the value that was
# last computed from its residual, the difference is no longer trusted and the residual is formed.
_TRUSTED = 1e-5
# A residual shorter than 1e-6 of its column counts as zero: its direction, and so the choice among
# several of them, would come from rounding, and its weight would be millions of metres.
_DEPENDENT = 1e-12
# Scores that differ by less are rounding of the same number (equal fingerprints): the first wins.
_TIE = 1e-10
# Below this the targets are fitted to their last digits.
_EXPLAINED = 1e-20
# The bases of folds that are worked on together stay in a processor's cache.
_CHUNK_BYTES = 2**22


class Network(NamedTuple):
    """Networks of all folds.

    See Mirzababaei & Akbari, eq. 62.

    Attributes
    ----------
    centre
        Indices of the centres, [fold, neurons]; -1 where the choice stopped early.
    weight
        Weights, [fold, neurons, 2], metres; zero where there is no centre.
    bias
        [fold, 2], metres.
    """

    centre: Index
    weight: Array
    bias: Array


def gaussian_kernel(distance_db: Array, spread_db: float, kernel: str = "paper") -> Array:
    """Return the Gaussian of signal distances.

    See Mirzababaei & Akbari, eqs. 61 and 63.

    Parameters
    ----------
    distance_db
        Distances in signal space, [...], dB.
    spread_db
        Width s of the Gaussian, dB.
    kernel
        ``paper``: exp(-d^2/s^2). ``newrb``: exp(-ln2 d^2/s^2), one half at d = s, as MATLAB's
        newrb does.

    Raises
    ------
    InputError
        For another kernel, or a spread that is not positive.
    """
    if kernel not in KERNELS:
        raise InputError(
            f"kernel={kernel!r}", f"it must be one of {', '.join(KERNELS)}", "Choose one of them"
        )
    if not spread_db > 0:
        raise InputError(f"spread_db={spread_db}", "it must be positive", "Choose a width in dB, such as 45")
    scale = np.log(2.0) if kernel == "newrb" else 1.0
    gaussian: Array = np.exp(-scale * (distance_db / spread_db) ** 2)
    return gaussian


def orthogonal_least_squares(kernel: Array, target: Array, member: Mask, neurons: int) -> Index:
    """Choose the centres of all folds greedily from their own training samples.

    See Mirzababaei & Akbari, eqs. 60-64; the method is that of Chen, Cowan & Grant (1991), which
    MATLAB's newrb uses. In each step the sample is taken whose kernel column, made orthogonal to
    those taken before, has the largest error-reduction ratio, summed over both outputs. There is
    no bias in the choice, and the targets are not centred.

    Parameters
    ----------
    kernel
        Kernel between all samples, row = sample, column = candidate centre, [n, n].
    target
        Positions, [n, 2], metres.
    member
        [fold, n], True where a sample trains (and may become a centre) in that fold.
    neurons
        Largest number of centres.

    Returns
    -------
    NDArray
        Indices of the centres in order of choice, [fold, neurons]; -1 from where no column that is
        independent of the chosen ones, or nothing to explain, is left.

    Raises
    ------
    InputError
        If ``neurons`` is not positive.
    """
    return fit_network(kernel, target, member, neurons).centre


def fit_network(kernel: Array, target: Array, member: Mask, neurons: int) -> Network:
    """Choose the centres of all folds and solve for weights and bias by least squares.

    See Mirzababaei & Akbari, eqs. 60-64. The bias enters the final solution only; where the
    kernel columns span the constant already, it is zero.

    Parameters
    ----------
    kernel, target, member, neurons
        As in `orthogonal_least_squares`.

    Raises
    ------
    InputError
        If ``neurons`` is not positive.
    """
    if neurons < 1:
        raise InputError(
            f"neurons={neurons}", "it must be at least 1", "Choose a number of neurons such as 30"
        )
    samples = kernel.shape[0]
    column = np.ascontiguousarray(kernel.T)
    squared = kernel * kernel
    # Folds are independent of each other.
    part = max(1, _CHUNK_BYTES // (8 * samples * min(neurons, samples)))
    parts = []
    for first in range(0, len(member), part):
        chosen = member[first : first + part]
        masked_target = np.where(chosen, target.T[:, None, :], 0.0)
        centre, basis = _select(kernel, column, squared, masked_target, chosen, neurons)
        parts.append(Network(centre, *_solve(column, masked_target, chosen, centre, basis)))
    return Network(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def estimate(network: Network, kernel: Array) -> Array:
    """Return the output of each fold's network.

    See Mirzababaei & Akbari, eq. 62.

    Parameters
    ----------
    network
        Networks of all folds, or of one fold that is used for all rows.
    kernel
        Kernel between the tested fingerprints, one a fold, and all samples, [fold, n].

    Returns
    -------
    Array
        Positions, [fold, 2], metres.
    """
    # Index -1 reads some column; its weight is zero.
    response = np.take_along_axis(
        kernel, np.broadcast_to(network.centre, (len(kernel), network.centre.shape[1])), 1
    )
    position: Array = np.einsum("fc,fco->fo", response, np.broadcast_to(network.weight, (*response.shape, 2)))
    return position + network.bias


def _select(
    kernel: Array, column: Array, squared: Array, target: Array, member: Mask, neurons: int
) -> tuple[Index, Array]:
    """Return centres [fold, neurons] and the orthonormal basis [fold, steps, n] of their columns.

    ``target`` [2, fold, n] is zero outside the members.
    """
    folds, samples = member.shape
    fold = np.arange(folds)
    steps = min(neurons, samples)
    centre = np.full((folds, neurons), -1, dtype=np.intp)
    basis = np.zeros((folds, steps, samples))
    energy = np.sum(target * target, axis=2, keepdims=True)
    # Both outputs count alike: each is measured in parts of its own energy.
    scaled = target / np.sqrt(np.where(energy > 0, energy, 1.0))
    weight = member.astype(np.float64)
    original = weight @ squared
    projection = scaled @ kernel
    # What is no candidate, or none any more, has an infinite norm and so a score of zero.
    norm = np.where(member & (original > 0), original, np.inf)
    trusted = norm.copy()
    work, score = np.empty_like(norm), np.empty_like(norm)
    recomputed = False
    for step in range(steps):
        np.multiply(projection[0], projection[0], out=score)
        score += np.multiply(projection[1], projection[1], out=work)
        score /= norm
        best = score.max(axis=1, initial=0.0)
        active = best > _EXPLAINED
        if not active.any():
            break
        pick = np.argmax(score >= best[:, None] * (1.0 - _TIE), axis=1)
        direction = np.where(member & active[:, None], column[pick], 0.0)
        direction = _orthogonal(direction, basis[:, :step])
        length = np.sqrt(np.sum(direction * direction, axis=1, keepdims=True))
        direction /= np.where(length > 0, length, 1.0)
        basis[:, step] = direction
        centre[:, step] = np.where(active, pick, -1)
        norm[fold, pick] = np.inf
        norm[~active] = np.inf
        product = direction @ kernel
        norm -= np.multiply(product, product, out=work)
        for output in range(2):
            along = np.sum(direction * scaled[output], axis=1, keepdims=True)
            projection[output] -= np.multiply(along, product, out=work)
        stale = norm < np.multiply(trusted, _TRUSTED, out=work)
        # A norm that was never formed anew cannot have fallen as low as dependence: it would be stale.
        recomputed = recomputed or bool(stale.any())
        if not recomputed:
            continue
        # One fold after the other: a padded or pooled product would have a shape, and so a rounding,
        # that depends on the other folds.
        for index in np.flatnonzero(stale.any(axis=1)):
            again = np.flatnonzero(stale[index])
            residual = column[again] * weight[index]
            done = basis[index, : step + 1]
            for _ in range(2):
                residual -= (residual @ done.T) @ done
            norm[index, again] = np.einsum("cn,cn->c", residual, residual)
            projection[:, index, again] = scaled[:, index] @ residual.T
        trusted = np.where(stale, norm, trusted)
        norm[norm <= _DEPENDENT * original] = np.inf
    return centre, basis


def _orthogonal(vector: Array, basis: Array) -> Array:
    """Remove from vectors [fold, n] their parts along orthonormal rows [fold, k, n]."""
    # Once is not enough in floating point, twice is.
    for _ in range(2):
        along = basis @ vector[..., None]
        vector = vector - (along.swapaxes(1, 2) @ basis)[:, 0]
    return vector


def _solve(column: Array, target: Array, member: Mask, centre: Index, basis: Array) -> tuple[Array, Array]:
    """Return weights [fold, neurons, 2] and bias [fold, 2] by back substitution in the known basis."""
    folds, neurons = centre.shape
    steps = basis.shape[1]
    present = centre[:, :steps] >= 0
    constant = member.astype(np.float64)
    direction = _orthogonal(constant, basis)
    length = np.sqrt(np.sum(direction * direction, axis=1, keepdims=True))
    independent = length > np.sqrt(_DEPENDENT) * np.sqrt(member.sum(axis=1, keepdims=True))
    direction = np.where(independent, direction / np.where(independent, length, 1.0), 0.0)
    orthonormal = np.concatenate([basis, direction[:, None]], axis=1)
    regressor = np.concatenate([column[centre[:, :steps]] * present[..., None], constant[:, None]], axis=1)
    # Rows of the basis are zero outside the members, so the regressors need no mask of their own.
    triangle = np.triu(orthonormal @ regressor.swapaxes(1, 2))
    missing = ~np.concatenate([present, independent], axis=1)
    triangle += missing[:, :, None] * np.eye(steps + 1)
    solution = np.linalg.solve(triangle, orthonormal @ np.moveaxis(target, 0, 2))
    weight = np.zeros((folds, neurons, 2))
    weight[:, :steps] = solution[:, :steps]
    return weight, solution[:, steps]
