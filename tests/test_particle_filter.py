"""Particle filter steps against direct sums, a Kalman filter, and each filter alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from positioning.errors import InputError
from positioning.filters import kalman, particle_filter, plane
from positioning.filters.particle_filter import (
    empty_states,
    gaussian_mixture_log_likelihood,
    normalise,
    resample,
    reweight,
    select,
    weighted_covariance,
    weighted_mean,
)
from positioning.filters.plane import MotionNoise, turn_advance_turn
from positioning.model import Array, Recording, Site


def padded_fixes(rng: np.random.Generator, filters: int, most: int) -> Array:
    """Return fixes [r, k, 2] with NaN in any place, and an epoch without any."""
    fix_m = rng.uniform(0, 8, (filters, most, 2))
    fix_m[rng.random((filters, most)) < 0.4] = np.nan
    fix_m[0] = np.nan
    return fix_m


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 7), st.integers(1, 12), st.sampled_from(["sum", "product"]))
def test_log_likelihood_equals_a_direct_sum(seed: int, filters: int, most: int, fusion: str) -> None:
    rng = np.random.default_rng(seed)
    position_m, fix_m = rng.uniform(0, 8, (filters, 9, 2)), padded_fixes(rng, filters, most)
    sigma_m = rng.uniform(0.5, 2, filters)
    found = gaussian_mixture_log_likelihood(position_m, fix_m, sigma_m, fusion)  # type: ignore[arg-type]
    for row in range(filters):
        fixes = fix_m[row][~np.isnan(fix_m[row, :, 0])]
        expected = np.zeros(9)
        if len(fixes):
            each = np.array(
                [multivariate_normal(f, sigma_m[row] ** 2 * np.eye(2)).logpdf(position_m[row]) for f in fixes]
            )
            mixture = logsumexp(each, axis=0) - np.log(len(fixes))
            expected = mixture if fusion == "sum" else each.sum(axis=0)
        np.testing.assert_allclose(found[row], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("fusion", ["sum", "product"])
def test_padding_stack_and_block_leave_no_trace(
    fusion: particle_filter.Fusion, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    position_m, fix_m = rng.uniform(0, 8, (6, 101, 2)), padded_fixes(rng, 6, 11)
    together = gaussian_mixture_log_likelihood(position_m, fix_m, 0.7, fusion)
    wide = np.concatenate([np.full((6, 5, 2), np.nan), fix_m, np.full((6, 30, 2), np.nan)], axis=1)
    np.testing.assert_array_equal(gaussian_mixture_log_likelihood(position_m, wide, 0.7, fusion), together)
    for row in range(6):
        fixes = fix_m[row][~np.isnan(fix_m[row, :, 0])]
        alone = gaussian_mixture_log_likelihood(position_m[row], fixes, 0.7, fusion)
        np.testing.assert_array_equal(alone, together[row])
    monkeypatch.setattr(particle_filter, "_BLOCK", 1)
    np.testing.assert_array_equal(gaussian_mixture_log_likelihood(position_m, fix_m, 0.7, fusion), together)


def test_one_fix_is_the_same_in_sum_and_product() -> None:
    rng = np.random.default_rng(6)
    position_m, fix_m = rng.uniform(0, 8, (3, 50, 2)), rng.uniform(0, 8, (3, 1, 2))
    one, other = (gaussian_mixture_log_likelihood(position_m, fix_m, 1.3, f) for f in ("sum", "product"))  # type: ignore[arg-type]
    np.testing.assert_allclose(one, other, rtol=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(-30, 30))
def test_log_likelihood_moves_with_the_plan_and_does_not_care_for_the_order_of_fixes(
    seed: int, shift_m: float
) -> None:
    rng = np.random.default_rng(seed)
    position_m, fix_m = rng.uniform(0, 8, (2, 20, 2)), padded_fixes(rng, 2, 6)
    found = gaussian_mixture_log_likelihood(position_m, fix_m, 1.0)
    moved = gaussian_mixture_log_likelihood(position_m + shift_m, fix_m[:, ::-1] + shift_m, 1.0)
    np.testing.assert_allclose(moved, found, atol=1e-9)


def test_senseless_fixes_are_refused() -> None:
    position_m, fix_m = np.zeros((2, 5, 2)), np.zeros((2, 3, 2))
    with pytest.raises(InputError, match="do not fit"):
        gaussian_mixture_log_likelihood(position_m, fix_m[:1], 1.0)
    with pytest.raises(InputError, match="sigma_m"):
        gaussian_mixture_log_likelihood(position_m, fix_m, 0.0)
    with pytest.raises(InputError, match="infinite"):
        gaussian_mixture_log_likelihood(position_m, fix_m + np.inf, 1.0)
    with pytest.raises(InputError, match="fusion='mean'"):
        gaussian_mixture_log_likelihood(position_m, fix_m, 1.0, "mean")  # type: ignore[arg-type]


def test_impossible_fixes_leave_the_prior() -> None:
    position_m = np.random.default_rng(0).uniform(0, 6, (2, 4, 2))
    fix_m = np.array([[[900.0, 900.0]], [[1.0, 1.0]]])
    log_likelihood = gaussian_mixture_log_likelihood(position_m, fix_m, 1.0)
    assert np.isneginf(log_likelihood[0]).all()
    prior = np.array([[0.1, 0.2, 0.3, 0.4]] * 2)
    posterior = reweight(prior, log_likelihood)
    np.testing.assert_array_equal(posterior[0], prior[0])
    assert np.abs(posterior[1] - prior[1]).max() > 0.05
    np.testing.assert_allclose(posterior.sum(axis=1), 1.0, rtol=1e-14)


def test_reweight_is_bayes() -> None:
    posterior = reweight(np.array([0.5, 0.25, 0.25, 0.0]), np.log([1e-300, 2e-300, 4e-300, 8e-300]))
    np.testing.assert_allclose(posterior, [0.25, 0.25, 0.5, 0.0], rtol=1e-12)
    # Only a particle without weight could explain it: an outlier, and the prior stays.
    np.testing.assert_array_equal(reweight(np.array([1.0, 0.0]), np.array([-np.inf, 0.0])), [1.0, 0.0])


def test_normalise() -> None:
    found = normalise([[-1e6, -1e6 + np.log(3.0)], [-np.inf, -np.inf], [-np.inf, 5.0]])
    np.testing.assert_allclose(found, [[0.25, 0.75], [0.5, 0.5], [0.0, 1.0]], rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_moments_equal_those_of_numpy(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    state, weight = rng.normal(size=(2, 3, 40, states)), rng.dirichlet(np.ones(40), (2, 3))
    mean, covariance = weighted_mean(state, weight), weighted_covariance(state, weight)
    for row in np.ndindex(2, 3):
        np.testing.assert_allclose(mean[row], np.average(state[row], axis=0, weights=weight[row]), rtol=1e-9)
        expected = np.cov(state[row].T, aweights=weight[row], bias=True)
        np.testing.assert_allclose(covariance[row], np.atleast_2d(expected), atol=1e-12)
    together = empty_states(6, 40, states)
    together[:] = state.reshape(6, 40, states)
    np.testing.assert_array_equal(weighted_mean(together, weight.reshape(6, 40)), mean.reshape(6, states))


def test_select_copies_whole_particles() -> None:
    state = np.arange(24.0).reshape(2, 4, 3)
    index = np.array([[0, 0, 3, 3], [1, 1, 1, 2]])
    found = select(state, index)
    for row in range(2):
        np.testing.assert_array_equal(found[row], state[row, index[row]])


def test_only_filters_below_the_threshold_are_resampled() -> None:
    state = np.random.default_rng(0).normal(size=(3, 6, 2))
    weight = np.array([[1 / 6] * 6, [0.9, 0.02, 0.02, 0.02, 0.02, 0.02], [0.5, 0.5, 0, 0, 0, 0]])
    before, old = state.copy(), weight.copy()
    rngs = [np.random.default_rng(n) for n in range(3)]
    chosen = resample(state, weight, 2.5 / 6, rngs)
    np.testing.assert_array_equal(chosen, [False, True, True])
    np.testing.assert_array_equal(state[0], before[0])
    np.testing.assert_array_equal(weight[1:], np.full((2, 6), 1 / 6))
    # The one that was left alone drew nothing.
    assert rngs[0].random() == np.random.default_rng(0).random()
    assert {tuple(p) for p in state[2]} <= {tuple(p) for p in before[2, :2]}
    np.testing.assert_allclose(old[0], weight[0])


def test_resampling_keeps_the_mean() -> None:
    rng = np.random.default_rng(3)
    state = np.tile(rng.normal(size=(1, 50, 1)), (4000, 1, 1))
    weight = np.tile(rng.dirichlet(np.full(50, 0.3)), (4000, 1))
    expected = weighted_mean(state, weight)[0, 0]
    deviation = np.sqrt(weighted_covariance(state, weight)[0, 0, 0])
    assert resample(state, weight, 1.0, [np.random.default_rng(n) for n in range(4000)]).all()
    assert abs(state.mean() - expected) < 5 * deviation / np.sqrt(50 * 4000)


def kalman_and_particles(filters: int, particles: int) -> tuple[Array, Array, int]:
    """Return errors of mean and of log evidence of particle filters, against Kalman filters on the same data.

    Four states, position and velocity; means are in standard deviations, [epoch, filter, state].
    """
    rng, epochs, dt, sigma_m = np.random.default_rng(7), 12, 0.5, 0.8
    transition = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    prior, process = np.diag([1.0, 1.0, 0.2, 0.2]), np.diag([0.02, 0.02, 0.05, 0.05])
    matrix, noise = np.eye(2, 4), sigma_m**2 * np.eye(2)
    true = rng.normal(size=(filters, 4)) * np.sqrt(np.diag(prior))
    mean, covariance = np.zeros((filters, 4)), np.tile(prior, (filters, 1, 1))
    rngs = [np.random.default_rng(n) for n in range(filters)]
    state = empty_states(filters, particles, 4)
    state[:] = np.swapaxes(particle_filter.standard_normal(rngs, (4, particles)), -1, -2) * np.sqrt(
        np.diag(prior)
    )
    weight = np.full((filters, particles), 1 / particles)
    errors, evidences, resampled = [], [], 0
    for _ in range(epochs):
        true = true @ transition.T + rng.normal(size=true.shape) * np.sqrt(np.diag(process))
        fix_m = true[:, None, :2] + sigma_m * rng.normal(size=(filters, 1, 2))
        mean, covariance = kalman.predict(mean, covariance, transition, process)
        after = kalman.update(mean, covariance, fix_m[:, 0] - mean[:, :2], matrix, noise)
        mean, covariance = after.mean, after.covariance
        draws = np.swapaxes(particle_filter.standard_normal(rngs, (4, particles)), -1, -2)
        state[:] = state @ transition.T + np.sqrt(np.diag(process)) * draws
        log_likelihood = gaussian_mixture_log_likelihood(state[..., :2], fix_m, sigma_m)
        evidences.append(np.log(np.sum(weight * np.exp(log_likelihood), axis=-1)) - after.log_likelihood)
        weight = reweight(weight, log_likelihood)
        deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        errors.append((weighted_mean(state, weight) - mean) / deviation)
        spread = weighted_covariance(state, weight) / (deviation[:, :, None] * deviation[:, None, :])
        expected = covariance / (deviation[:, :, None] * deviation[:, None, :])
        assert np.abs((spread - expected).mean(axis=0)).max() < 6 / np.sqrt(particles)
        resampled += int(resample(state, weight, 0.5, rngs).sum())
    return np.array(errors), np.array(evidences), resampled


def test_equals_a_kalman_filter_on_a_linear_gaussian_case() -> None:
    errors, evidences, resampled = kalman_and_particles(filters=60, particles=4000)
    assert resampled > 60
    # No bias: the mean over filters is within five of its standard errors, for every epoch and state.
    bias = errors.mean(axis=1) / (errors.std(axis=1) / np.sqrt(60))
    assert np.abs(bias).max() < 5
    rms = np.sqrt(np.mean(errors**2))
    # The mean of 4000 draws deviates by 0.016; unequal weights and rounds of resampling multiply that.
    assert 1 / np.sqrt(4000) < rms < 8 / np.sqrt(4000)
    assert np.sqrt(np.mean(evidences**2)) < 0.15
    # The error falls with the root of the number of particles.
    fewer, _, _ = kalman_and_particles(filters=60, particles=1000)
    assert 1.6 < np.sqrt(np.mean(fewer**2)) / rms < 2.5


def test_a_filter_in_the_plane_equals_a_kalman_filter_where_the_heading_is_certain() -> None:
    # Straight on along x with noise in the translation only: x is linear and Gaussian but for its start, a
    # uniform place, which several fixes make forgotten.
    epochs, sigma_m, noise_m = 14, 0.6, 0.3
    rng = np.random.default_rng(1)
    fix_m = np.column_stack([10 + np.arange(epochs), np.full(epochs, 10.0)]) + rng.normal(
        0, sigma_m, (epochs, 2)
    )
    still = np.zeros((1, epochs))
    recording = Recording(
        time_s=np.arange(epochs, dtype=float)[None],
        turn_before_rad=still,
        advance_m=np.where(np.arange(epochs) > 0, 1.0, 0.0)[None],
        turn_after_rad=still,
        start_heading_rad=np.zeros(1),
    )
    site = Site(corner_m=np.array([[[0.0, 0.0], [20.0, 20.0]]]))
    track = plane.filter_particles(
        recording,
        site,
        [np.random.default_rng(2)],
        lambda rows, epoch, place: gaussian_mixture_log_likelihood(place, fix_m[epoch, None, None], sigma_m),
        particles=60_000,
        noise=MotionNoise(0.0, noise_m, 0.0),
        heading_known=True,
        resample_below=0.5,
    )
    # A uniform prior wide enough is no prior: the first fix is the start.
    mean, covariance = fix_m[0], sigma_m**2 * np.eye(2)
    for epoch in range(1, epochs):
        mean, covariance = kalman.predict(mean, covariance, np.eye(2), np.diag([noise_m**2, 0.0]))
        mean = mean + np.array([1.0, 0.0])
        after = kalman.update(mean, covariance, fix_m[epoch] - mean, np.eye(2), sigma_m**2 * np.eye(2))
        mean, covariance = after.mean, after.covariance
    deviation = np.sqrt(np.diag(covariance))
    # Nothing spreads y after the start: of 60,000 particles on 400 square metres, about 170 are within one
    # sigma of the first fix, and each has its own y for ever.
    assert (np.abs(track.position_m[0, -1] - mean) < [0.15, 0.6] * deviation).all()
    np.testing.assert_allclose(track.covariance_m2[0, -1, 0, 0], covariance[0, 0], rtol=0.2)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_motion_without_noise_is_the_one_of_the_contract(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = rng.normal(size=(3, 5, 3))
    before, advance, after = rng.normal(size=(3, 3))
    heading = state[..., 2] + before[:, None]
    expected = np.stack(
        [
            state[..., 0] + advance[:, None] * np.cos(heading),
            state[..., 1] + advance[:, None] * np.sin(heading),
            heading + after[:, None],
        ],
        axis=-1,
    )
    turn_advance_turn(state, before, advance, after, MotionNoise(0, 0, 0), rng.normal(size=(3, 4, 5)))
    np.testing.assert_allclose(state, expected, atol=1e-12)


def test_motion_noise_has_the_deviations_that_it_is_given() -> None:
    rng = np.random.default_rng(9)
    state = np.zeros((2, 100_000, 3))
    noise = MotionNoise(np.array([0.02, 0.01]), np.array([0.05, 0.2]), np.array([0.03, 0.0]))
    advance = np.array([2.0, -1.0])
    turn_advance_turn(state, np.zeros(2), advance, np.zeros(2), noise, rng.standard_normal((2, 4, 100_000)))
    # Two turns and, along the line, the drift.
    expected = np.sqrt(2 * noise.turn_rad**2 + (noise.drift_rad_per_m * advance) ** 2)
    np.testing.assert_allclose(state[..., 2].std(axis=1), expected, rtol=0.01)
    np.testing.assert_allclose(state[..., 0].std(axis=1), noise.advance_m, rtol=0.02)
    # Sideways: the first turn and half of the drift, times the length.
    sideways = np.abs(advance) * np.sqrt(noise.turn_rad**2 + (noise.drift_rad_per_m * advance / 2) ** 2)
    np.testing.assert_allclose(state[..., 1].std(axis=1), sideways, rtol=0.03)
    np.testing.assert_allclose(state.mean(axis=1)[:, [1, 2]], 0.0, atol=0.002)
