"""Kalman steps against closed forms, batch least squares, and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from positioning.errors import InputError
from positioning.filters.kalman import log_density, mixture_moments, predict, symmetric, update
from positioning.model import Array


def spd(rng: np.random.Generator, *shape: int) -> Array:
    """Return symmetric positive definite matrices [..., s, s]."""
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])


def test_one_dimension_by_hand() -> None:
    before = predict([2.0], [[3.0]], [[2.0]], [[0.5]])
    np.testing.assert_allclose([before.mean[0], before.covariance[0, 0]], [4.0, 12.5])
    after = update([4.0], [[12.0]], [1.0], [[1.0]], [[4.0]])
    np.testing.assert_allclose(after.mean, [4.75])
    np.testing.assert_allclose(after.covariance, [[3.0]])
    np.testing.assert_allclose(after.gain, [[0.75]])
    np.testing.assert_allclose(after.innovation_covariance, [[16.0]])
    assert after.normalised_innovation_squared == pytest.approx(1 / 16)
    assert after.log_likelihood == pytest.approx(-0.5 / 16 - 0.5 * np.log(2 * np.pi * 16))


def test_steady_state_of_a_random_walk() -> None:
    # The variance after the update solves p = (p + q) r / (p + q + r).
    process, noise, covariance = 0.3, 2.0, np.array([[50.0]])
    for _ in range(200):
        covariance = predict([0.0], covariance, [[1.0]], [[process]]).covariance
        covariance = update([0.0], covariance, [0.0], [[1.0]], [[noise]]).covariance
    expected = (-process + np.sqrt(process**2 + 4 * process * noise)) / 2
    assert covariance[0, 0] == pytest.approx(expected, rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(1, 4))
def test_update_equals_the_information_form(seed: int, states: int, values: int) -> None:
    rng = np.random.default_rng(seed)
    mean, covariance, noise = rng.normal(size=states), spd(rng, states), spd(rng, values)
    matrix, measured = rng.normal(size=(values, states)), rng.normal(size=values)
    found = update(mean, covariance, measured - matrix @ mean, matrix, noise)
    information = np.linalg.inv(covariance) + matrix.T @ np.linalg.inv(noise) @ matrix
    vector = np.linalg.inv(covariance) @ mean + matrix.T @ np.linalg.inv(noise) @ measured
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.mean, np.linalg.solve(information, vector), rtol=1e-7, atol=1e-9)
    expected = multivariate_normal(matrix @ mean, matrix @ covariance @ matrix.T + noise).logpdf(measured)
    assert found.log_likelihood == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_whole_track_equals_batch_least_squares() -> None:
    rng = np.random.default_rng(3)
    transition, process = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.01, 0.04])
    matrix, noise, steps = np.array([[1.0, 0.0]]), np.array([[0.5]]), 8
    start, prior = np.array([1.0, -1.0]), np.diag([4.0, 1.0])
    measured = rng.normal(size=steps)
    mean, covariance = start, prior
    for value in measured:
        mean, covariance = predict(mean, covariance, transition, process)
        mean, covariance, *_ = update(mean, covariance, value - matrix @ mean, matrix, noise)
    # All states are jointly Gaussian: condition the last one on all measurements at once.
    mixing = [np.linalg.matrix_power(transition, n) for n in range(steps + 1)]
    cross = np.zeros((2 * steps, 2 * steps))
    for row in range(1, steps + 1):
        for column in range(1, steps + 1):
            block = mixing[row] @ prior @ mixing[column].T
            for noisy in range(1, min(row, column) + 1):
                block = block + mixing[row - noisy] @ process @ mixing[column - noisy].T
            cross[2 * row - 2 : 2 * row, 2 * column - 2 : 2 * column] = block
    seen = cross[::2, ::2] + noise[0, 0] * np.eye(steps)
    expected = np.array([(mixing[n] @ start)[0] for n in range(1, steps + 1)])
    gain = cross[-2:, ::2] @ np.linalg.inv(seen)
    np.testing.assert_allclose(mean, mixing[steps] @ start + gain @ (measured - expected), rtol=1e-10)
    np.testing.assert_allclose(covariance, cross[-2:, -2:] - gain @ cross[::2, -2:], rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_leading_axes_broadcast(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    mean, covariance = rng.normal(size=(3, 4, states)), spd(rng, 4, states)
    matrix, noise, innovation = rng.normal(size=(2, states)), spd(rng, 2), rng.normal(size=(3, 4, 2))
    moved = predict(mean, covariance, np.eye(states), np.eye(states))
    found = update(moved.mean, moved.covariance, innovation, matrix, noise)
    for row in np.ndindex(3, 4):
        alone = predict(mean[row], covariance[row[1]], np.eye(states), np.eye(states))
        one = update(alone.mean, alone.covariance, innovation[row], matrix, noise)
        np.testing.assert_allclose(found.mean[row], one.mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariance[row[1]], one.covariance, rtol=1e-12)
        np.testing.assert_allclose(found.log_likelihood[row], one.log_likelihood, rtol=1e-12)


def test_joseph_form_stays_positive_where_the_short_form_does_not() -> None:
    # Scales far apart, and nearly exact measurements over and over.
    rng = np.random.default_rng(0)
    covariance = np.diag([1e10, 1e4, 1.0, 1e-2])
    short, least, least_short = covariance, 0.0, 0.0
    noise = np.array([[1e-10]])
    for matrix in rng.normal(size=(100, 1, 4)):
        covariance = update(np.zeros(4), covariance, np.zeros(1), matrix, noise).covariance
        np.testing.assert_array_equal(covariance, covariance.T)
        least = min(least, np.linalg.eigvalsh(covariance).min())
        gain = short @ matrix.T / (matrix @ short @ matrix.T + noise)
        short = symmetric((np.eye(4) - gain @ matrix) @ short)
        least_short = min(least_short, np.linalg.eigvalsh(short).min())
    assert least >= -1e-18
    assert least_short < -1e-9


def test_a_certain_measurement_leaves_the_rest_alone() -> None:
    found = update([0.0, 5.0], np.diag([1e6, 2.0]), [3.0], [[1.0, 0.0]], [[1e-12]])
    np.testing.assert_allclose(found.mean, [3.0, 5.0], rtol=1e-12)
    np.testing.assert_allclose(np.diag(found.covariance), [1e-12, 2.0], rtol=1e-6)


def test_normalised_innovations_have_their_dimension_as_mean() -> None:
    rng = np.random.default_rng(1)
    covariance = spd(rng, 3)
    innovation = rng.multivariate_normal(np.zeros(3), covariance, 20_000)
    _, squared = log_density(innovation, covariance)
    assert squared.mean() == pytest.approx(3.0, abs=5 * np.sqrt(6 / 20_000))


def test_mixture_moments_equal_those_of_its_samples() -> None:
    rng = np.random.default_rng(2)
    weight, mean, covariance = np.array([0.2, 0.5, 0.3]), rng.normal(size=(3, 2)), spd(rng, 3, 2)
    which = rng.choice(3, 200_000, p=weight)
    root = np.linalg.cholesky(covariance)
    sample = mean[which] + (root[which] @ rng.normal(size=(200_000, 2, 1)))[..., 0]
    centre, spread = mixture_moments(weight, mean, covariance)
    np.testing.assert_allclose(centre, sample.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(spread, np.cov(sample.T), rtol=0.03, atol=0.03)


def test_symmetric_part() -> None:
    np.testing.assert_array_equal(symmetric(np.array([[1.0, 2.0], [4.0, 3.0]])), [[1, 3], [3, 3]])


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="covariance"):
        predict(np.zeros(2), np.eye(3), np.eye(2), np.eye(2))
    with pytest.raises(InputError, match="transition"):
        predict(np.zeros(2), np.eye(2), np.eye(3), np.eye(2))
    with pytest.raises(InputError, match="measurement_matrix"):
        update(np.zeros(2), np.eye(2), np.zeros(1), np.eye(2), np.eye(1))
    with pytest.raises(InputError, match="noise"):
        update(np.zeros(2), np.eye(2), np.zeros(1), [[1.0, 0.0]], np.eye(2))
    with pytest.raises(InputError, match="not positive definite"):
        update(np.zeros(2), np.zeros((2, 2)), np.zeros(1), [[1.0, 0.0]], np.zeros((1, 1)))
