"""Kalman filter steps for any number of states, broadcasting over leading axes.

See Bar-Shalom, Li & Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation", section
5.2, and section 5.2.6 for the form of Joseph.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.model import Array


class Prediction(NamedTuple):
    """A state before the measurement: mean [..., s] and covariance [..., s, s]."""

    mean: Array
    covariance: Array


class Update(NamedTuple):
    """A state after the measurement, and how well the two fitted.

    Attributes
    ----------
    mean
        [..., s].
    covariance
        [..., s, s].
    gain
        Kalman gain, [..., s, m].
    innovation_covariance
        [..., m, m].
    log_likelihood
        Logarithm of the density of the innovation, [...]: the weight of this filter in a mixture.
    normalised_innovation_squared
        [...], on average m where the model is right.
    """

    mean: Array
    covariance: Array
    gain: Array
    innovation_covariance: Array
    log_likelihood: Array
    normalised_innovation_squared: Array


def predict(mean: ArrayLike, covariance: ArrayLike, transition: ArrayLike, noise: ArrayLike) -> Prediction:
    """Move a state on.

    See Bar-Shalom et al., section 5.2. For an extended filter, take the covariance from here, with the
    Jacobian as transition, and compute the mean by the motion model itself.

    Parameters
    ----------
    mean
        [..., s].
    covariance
        [..., s, s].
    transition
        [..., s, s].
    noise
        Covariance of the process noise, [..., s, s].

    Raises
    ------
    InputError
        For shapes that do not fit.
    """
    means, covariances, transitions, noises = _arrays(mean, covariance, transition, noise)
    states = means.shape[-1:]
    _fit(means, "covariance", covariances, states * 2)
    _fit(means, "transition", transitions, states * 2)
    _fit(means, "noise", noises, states * 2)
    moved = (transitions @ means[..., None])[..., 0]
    return Prediction(moved, symmetric(transitions @ covariances @ _transposed(transitions) + noises))


def update(
    mean: ArrayLike,
    covariance: ArrayLike,
    innovation: ArrayLike,
    measurement_matrix: ArrayLike,
    noise: ArrayLike,
) -> Update:
    """Correct a state by a measurement, in the form of Joseph.

    See Bar-Shalom et al., sections 5.2 and 5.2.6.

    Parameters
    ----------
    mean
        [..., s].
    covariance
        [..., s, s].
    innovation
        Measurement less its prediction, [..., m].
    measurement_matrix
        Derivative of the measurement by the state, [..., m, s].
    noise
        Covariance of the measurement, [..., m, m].

    Raises
    ------
    InputError
        For shapes that do not fit, or an innovation covariance that is not positive definite.
    """
    means, covariances, innovations, matrices, noises = _arrays(
        mean, covariance, innovation, measurement_matrix, noise
    )
    states, values = means.shape[-1:], innovations.shape[-1:]
    _fit(means, "covariance", covariances, states * 2)
    _fit(means, "measurement_matrix", matrices, values + states)
    _fit(means, "noise", noises, values * 2)
    cross = covariances @ _transposed(matrices)
    innovation_covariance = symmetric(matrices @ cross + noises)
    log_likelihood, squared = log_density(innovations, innovation_covariance)
    gain = _transposed(np.asarray(np.linalg.solve(innovation_covariance, _transposed(cross)), np.float64))
    corrected = means + (gain @ innovations[..., None])[..., 0]
    kept = np.eye(states[0]) - gain @ matrices
    joseph = kept @ covariances @ _transposed(kept) + gain @ noises @ _transposed(gain)
    return Update(corrected, symmetric(joseph), gain, innovation_covariance, log_likelihood, squared)


def log_density(innovation: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Return the logarithm of a Gaussian density with mean zero, and the squared Mahalanobis distance.

    See Bar-Shalom et al., section 1.4.14.

    Parameters
    ----------
    innovation
        [..., m].
    covariance
        [..., m, m].

    Returns
    -------
    log_density, squared_distance
        Each [...].

    Raises
    ------
    InputError
        For a covariance that is not positive definite.
    """
    innovations, covariances = _arrays(innovation, covariance)
    try:
        root = np.linalg.cholesky(covariances)
    except np.linalg.LinAlgError as error:
        raise InputError(
            "innovation covariance",
            "it is not positive definite",
            "Give measurements a noise above zero, and no NaN",
        ) from error
    white = (np.linalg.inv(root) @ innovations[..., None])[..., 0]
    squared = np.sum(white * white, axis=-1)
    diagonal = np.diagonal(root, axis1=-2, axis2=-1)
    log_normal = np.sum(np.log(diagonal), axis=-1) + 0.5 * innovations.shape[-1] * np.log(2 * np.pi)
    return np.asarray(-0.5 * squared - log_normal), np.asarray(squared)


def mixture_moments(weight: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Return mean and covariance of a mixture of Gaussians.

    See Bar-Shalom et al., section 1.4.16.

    Parameters
    ----------
    weight
        Weights that sum to one, [..., h].
    mean
        [..., h, s].
    covariance
        [..., h, s, s].

    Returns
    -------
    mean, covariance
        [..., s] and [..., s, s].
    """
    weights, means, covariances = _arrays(weight, mean, covariance)
    # Running sums add one after the other, whatever the memory layout: a stack gives what one gives.
    centre = np.cumsum(weights[..., None] * means, axis=-2)[..., -1, :]
    offset = means - centre[..., None, :]
    spread = covariances + offset[..., :, None] * offset[..., None, :]
    return centre, symmetric(np.cumsum(weights[..., None, None] * spread, axis=-3)[..., -1, :, :])


def symmetric(matrix: Array) -> Array:
    """Return the symmetric part of matrices [..., s, s], which rounding may have left."""
    return np.asarray(0.5 * (matrix + _transposed(matrix)))


def _transposed(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)


def _arrays(*values: ArrayLike) -> tuple[Array, ...]:
    return tuple(np.asarray(value, dtype=np.float64) for value in values)


def _fit(mean: Array, name: str, matrix: Array, shape: tuple[int, ...]) -> None:
    if matrix.ndim < 2 or matrix.shape[-2:] != shape:
        raise InputError(
            name,
            f"its shape is {matrix.shape}, not [..., {shape[0]}, {shape[1]}]",
            f"Give one that fits a mean {mean.shape}",
        )
