"""The error-state filter against finite differences, dense Kalman steps, and its own consistency."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.filters import kalman
from positioning.inertial.error_state import ErrorStateFilter, ProcessNoise, increments, transition
from positioning.inertial.strapdown import attitude_of, navigate, readings, rotation, rotation_vector

SEEDS = st.integers(0, 10_000)
NOISE = ProcessNoise(0.05, 0.003, 0.002, 0.0005)


def spd(rng: np.random.Generator, worlds: int, states: int) -> Any:
    root = 0.1 * rng.normal(size=(worlds, states, states))
    return root @ root.swapaxes(1, 2) + 1e-4 * np.eye(states)


def engine(seed: int, worlds: int, states: int) -> ErrorStateFilter:
    rng = np.random.default_rng(seed)
    return ErrorStateFilter(
        position_m=rng.normal(size=(worlds, 3)),
        velocity_m_per_s=rng.normal(size=(worlds, 3)),
        attitude=rotation(rng.normal(size=(worlds, 3))),
        covariance=spd(rng, worlds, states),
        noise=NOISE,
    )


def predict_all(filter_: ErrorStateFilter, force: Any, rate: Any, duration: Any) -> None:
    """Run a filter over readings [n, w, 3]."""
    made = increments(force, rate, duration, biases=filter_.states == 15)
    for step in range(len(force)):
        mean = None if made.mean_rotation_s is None else made.mean_rotation_s[step]
        filter_.predict(made.turn_and_advance[step], made.duration_s[step], mean)


def moved(state: Any, force: Any, rate: Any, duration: float, error: Any) -> Any:
    """Return the error after one sample, of a navigation whose truth is off by ``error`` before it."""
    position, velocity, attitude = state
    bias = error[9:] if len(error) == 15 else np.zeros(6)

    def step(shift: Any, off: Any) -> Any:
        found = navigate(
            (force - off[:3])[None],
            (rate - off[3:])[None],
            duration,
            position_m=position + shift[:3],
            velocity_m_per_s=velocity + shift[3:6],
            attitude=rotation(shift[6:9]) @ attitude,
        )
        return found.position_m[-1], found.velocity_m_per_s[-1], found.attitude[-1]

    true, estimate = step(error, bias), step(np.zeros(9), np.zeros(6))
    turned = rotation_vector(true[2] @ estimate[2].T)
    return np.concatenate([true[0] - estimate[0], true[1] - estimate[1], turned, bias[: len(error) - 9]])


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([9, 15]), st.sampled_from([0.0025, 0.01, 0.1]))
def test_the_transition_is_the_derivative_of_strapdown_navigation(
    seed: int, states: int, duration: float
) -> None:
    rng = np.random.default_rng(seed)
    state = rng.normal(size=3), rng.normal(size=3), rotation(rng.normal(size=3))
    force, rate, tiny = rng.normal(0, 20, 3), rng.normal(0, 5, 3), 1e-6
    numeric = np.stack(
        [
            (
                moved(state, force, rate, duration, tiny * unit)
                - moved(state, force, rate, duration, -tiny * unit)
            )
            / (2 * tiny)
            for unit in np.eye(states)
        ],
        axis=-1,
    )
    found = transition(state[2], force, rate, duration, states=states)
    difference = np.abs(found - numeric)
    if states == 15:
        # Left out, and said so: a gyroscope bias moves the velocity within the same sample.
        assert difference[3:6, 12:].max() <= 0.6 * np.linalg.norm(force) * duration**2
        assert difference[:3, 12:].max() <= 0.3 * np.linalg.norm(force) * duration**3
        difference[:6, 12:] = 0.0
    np.testing.assert_allclose(difference, 0.0, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.sampled_from([9, 15]))
def test_prediction_equals_strapdown_and_the_dense_matrix_equation(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    force, rate = rng.normal(0, 20, (1, 4, 3)), rng.normal(0, 5, (1, 4, 3))
    duration = rng.uniform(0.005, 0.02, (1, 4))
    found, before = engine(seed, 4, states), engine(seed, 4, states)
    predict_all(found, force, rate, duration)
    for world in range(4):
        start = before.position_m[:, world], before.velocity_m_per_s[:, world], before.attitude[..., world]
        expected = navigate(
            force[:, world],
            rate[:, world],
            duration[:, world],
            position_m=start[0],
            velocity_m_per_s=start[1],
            attitude=start[2],
        )
        np.testing.assert_allclose(found.position_m[:, world], expected.position_m[-1], atol=1e-13)
        np.testing.assert_allclose(
            found.velocity_m_per_s[:, world], expected.velocity_m_per_s[-1], atol=1e-13
        )
        np.testing.assert_allclose(found.attitude[..., world], expected.attitude[-1], atol=1e-13)
        step = float(duration[0, world])
        change = transition(start[2], force[0, world], rate[0, world], step, states=states)
        density = np.repeat([0.0, *NOISE], 3)[:states] ** 2
        dense = kalman.predict(
            np.zeros(states), before.covariance[world], change, np.diag(density * step)
        ).covariance
        np.testing.assert_allclose(found.covariance[world], dense, rtol=1e-12, atol=1e-15)


def test_biases_are_taken_off_the_readings() -> None:
    rng = np.random.default_rng(5)
    force, rate, bias = (
        rng.normal(0, 20, (50, 3, 3)),
        rng.normal(0, 3, (50, 3, 3)),
        rng.normal(0, 1e-3, (6, 3)),
    )
    duration = np.full((50, 3), 0.01)
    told, clean = engine(5, 3, 15), engine(5, 3, 15)
    told.bias[...] = bias
    predict_all(told, force + bias[:3].T, rate + bias[3:].T, duration)
    predict_all(clean, force, rate, duration)
    np.testing.assert_allclose(told.attitude, clean.attitude, atol=1e-7)
    np.testing.assert_allclose(told.velocity_m_per_s, clean.velocity_m_per_s, atol=1e-4)
    untold = engine(5, 3, 15)
    predict_all(untold, force + bias[:3].T, rate + bias[3:].T, duration)
    assert np.abs(untold.velocity_m_per_s - clean.velocity_m_per_s).max() > 1e-3


@pytest.mark.parametrize("states", [9, 15])
def test_updates_equal_dense_ones(states: int) -> None:
    worlds, seed = 3, 8
    used = np.array([1.0, 0.0, 1.0])
    found, before = engine(seed, worlds, states), engine(seed, worlds, states)
    rng = np.random.default_rng(9)
    field, north, variance = rng.normal(size=(3, worlds)), rng.uniform(-3, 3, worlds), 0.04
    fix, spread = rng.normal(size=(worlds, 2)), np.array([[2.0, 0.7], [0.7, 1.0]])
    found.zero_velocity(used, 0.01)
    found.magnetic_heading(field, north, variance, used)
    root = np.linalg.inv(np.linalg.cholesky(spread))
    found.position_fix(fix.T, np.repeat(root[..., None], worlds, axis=-1), used)
    for world in range(worlds):
        mean, covariance = np.zeros(states), before.covariance[world]
        if used[world]:
            matrix = np.eye(states)[3:6]
            innovation = -before.velocity_m_per_s[:, world]
            mean, covariance, *_ = kalman.update(mean, covariance, innovation, matrix, 0.01 * np.eye(3))
            # The derivative of the direction of the field, by finite differences.
            level = before.attitude[..., world] @ field[:, world]
            turned = [rotation(1e-6 * unit) @ level for unit in np.eye(3)]
            angle = np.arctan2(level[1], level[0])
            row = np.zeros((1, states))
            row[0, 6:9] = [(np.arctan2(one[1], one[0]) - angle) / 1e-6 for one in turned]
            away = np.angle(np.exp(1j * (north[world] - angle)))
            mean, covariance, *_ = kalman.update(mean, covariance, away - row @ mean, row, [[variance]])
            matrix = np.eye(states)[:2]
            away = fix[world] - before.position_m[:2, world] - mean[:2]
            mean, covariance, *_ = kalman.update(mean, covariance, away, matrix, spread)
        np.testing.assert_allclose(found.error[:, world], mean, rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(found.covariance[world], covariance, rtol=1e-4, atol=1e-8)
    error = found.error.copy()
    found.correct()
    np.testing.assert_allclose(found.position_m, before.position_m + error[:3])
    np.testing.assert_array_equal(found.attitude[..., 1], before.attitude[..., 1])
    np.testing.assert_array_equal(found.covariance[1], before.covariance[1])
    np.testing.assert_array_equal(found.error, 0.0)


def test_a_correction_is_a_rotation() -> None:
    found, before = engine(3, 5, 9), engine(3, 5, 9)
    found.error[6:9] = turn = 0.02 * np.random.default_rng(3).normal(size=(3, 5))
    expected = rotation(found.error[6:9].T) @ np.moveaxis(before.attitude, -1, 0)
    found.correct()
    turned = np.moveaxis(found.attitude, -1, 0)
    np.testing.assert_allclose(turned @ turned.swapaxes(1, 2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-14)
    third = np.linalg.norm(turn, axis=0).max() ** 3 / 12
    np.testing.assert_allclose(turned, expected, rtol=0, atol=1.01 * third)
    assert third < 1e-4


def test_tidying_mends_what_rounding_left() -> None:
    found, before = engine(3, 5, 9), engine(3, 5, 9)
    rng = np.random.default_rng(3)
    found.attitude += 1e-7 * rng.normal(size=found.attitude.shape)
    found.covariance += 1e-12 * rng.normal(size=found.covariance.shape)
    found.tidy()
    turned = np.moveaxis(found.attitude, -1, 0)
    np.testing.assert_allclose(turned @ turned.swapaxes(1, 2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(found.covariance, found.covariance.swapaxes(1, 2))
    np.testing.assert_allclose(found.covariance, before.covariance, atol=1e-11)


def world(worlds: int, count: int, duration: float) -> tuple[Any, Any, Any]:
    """Return true force, rate and rests of feet that walk in circles, rest in each stride's second half."""
    time_s = duration * np.arange(count + 1)
    stride = time_s % 1.0
    swinging = stride < 0.5
    swing = np.where(swinging, stride, 0.5) / 0.5
    speed = np.where(swinging, 2.6 * np.sin(np.pi * swing) ** 2, 0.0)
    heading = 0.2 * (np.floor(time_s) + swing)
    velocity = speed[:, None] * np.stack(
        [np.cos(heading), np.sin(heading), 0.3 * np.sin(2 * np.pi * swing)], axis=-1
    )
    attitude = attitude_of(0.0, 0.9 * np.sin(2 * np.pi * swing) ** 2, heading)
    force, rate = readings(velocity, attitude, duration)
    tile = (slice(None), None)
    return (
        np.broadcast_to(force[tile], (count, worlds, 3)),
        np.broadcast_to(rate[tile], (count, worlds, 3)),
        (~swinging[1:] & (np.linalg.norm(velocity[1:], axis=-1) < 1e-9), velocity, attitude),
    )


@pytest.mark.parametrize("states", [9, 15])
def test_the_covariance_tells_the_error(states: int) -> None:
    # Normalised errors squared of 60 runs: a chi-square number with 60 x states degrees of freedom.
    worlds, count, duration, sigma = 60, 1000, 0.01, 0.02
    rng = np.random.default_rng(21 + states)
    force, rate, (rests, velocity, attitude) = world(worlds, count, duration)
    prior = np.repeat([0.1, 0.05, 0.02, 0.03, 0.003], 3)[:states]
    error = prior * rng.normal(size=(worlds, states))
    bias = error[:, 9:] if states == 15 else np.zeros((worlds, 6))
    densities = np.repeat([NOISE.force_m_per_s2_per_rt_hz, NOISE.rate_rad_per_s_per_rt_hz], 3)
    walks = np.repeat([NOISE.force_bias_m_per_s2_per_rt_s, NOISE.rate_bias_rad_per_s_per_rt_s], 3)
    read = densities / np.sqrt(duration) * rng.normal(size=(count, worlds, 6))
    if states == 15:
        walked = walks * np.sqrt(duration) * rng.normal(size=(count, worlds, 6))
        path = bias + np.cumsum(walked, axis=0) - walked
        read, bias = read + path, path[-1] + walked[-1]
    true = navigate(force[:, 0], rate[:, 0], duration, velocity_m_per_s=velocity[0], attitude=attitude[0])
    found = ErrorStateFilter(
        position_m=true.position_m[0] - error[:, :3],
        velocity_m_per_s=true.velocity_m_per_s[0] - error[:, 3:6],
        attitude=rotation(-error[:, 6:9]) @ attitude[0],
        covariance=np.tile(np.diag(prior**2), (worlds, 1, 1)),
        noise=NOISE,
    )
    made = increments(
        force + read[..., :3], rate + read[..., 3:], np.full((count, worlds), duration), biases=states == 15
    )
    magnetic = np.array([0.4, 0.1, -0.7])
    north = np.full(worlds, np.arctan2(0.1, 0.4))
    for step in range(count):
        mean = None if made.mean_rotation_s is None else made.mean_rotation_s[step]
        found.predict(made.turn_and_advance[step], made.duration_s[step], mean)
        if not rests[step]:
            continue
        # The filter measures zero; a measurement with noise is the same as a velocity that is off by it.
        off = sigma * rng.normal(size=(3, worlds))
        found.velocity_m_per_s -= off
        found.zero_velocity(np.ones(worlds), sigma**2)
        found.velocity_m_per_s += off
        if step % 100 == 60:
            seen = (attitude[step + 1].T @ magnetic)[:, None] * np.ones(worlds)
            found.magnetic_heading(seen, north + 0.1 * rng.normal(size=worlds), 0.01, np.ones(worlds))
        found.correct()
    turned = rotation_vector(true.attitude[-1] @ np.moveaxis(found.attitude, -1, 0).swapaxes(1, 2))
    parts = [
        true.position_m[-1] - found.position_m.T,
        true.velocity_m_per_s[-1] - found.velocity_m_per_s.T,
        turned,
    ]
    if states == 15:
        parts.append(bias - found.bias.T)
    left = np.concatenate(parts, axis=-1)
    squared = np.einsum("wi,wij,wj->w", left, np.linalg.inv(found.covariance), left)
    # Three and a half standard deviations.
    assert abs(squared.mean() - states) < 3.5 * np.sqrt(2 * states / worlds)
    # And it has learnt: horizontal tilt, velocity, and what is left of the gyroscope's bias about level axes.
    spread = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)).mean(axis=0)
    assert (spread[3:8] < 0.5 * prior[3:8]).all()
    if states == 15:
        assert (spread[12:14] < 0.6 * prior[12:14]).all()
        assert np.abs(left[:, 12:14]).mean() < 0.6 * np.abs(error[:, 12:14]).mean()


def test_one_world_gives_what_a_stack_gives() -> None:
    rng = np.random.default_rng(2)
    force, rate = rng.normal(0, 20, (30, 4, 3)), rng.normal(0, 5, (30, 4, 3))
    resting = (rng.random((30, 4)) < 0.5).astype(float)

    def run(rows: slice, states: int) -> ErrorStateFilter:
        whole = engine(1, 4, states)
        part = ErrorStateFilter(
            position_m=whole.position_m.T[rows],
            velocity_m_per_s=whole.velocity_m_per_s.T[rows],
            attitude=np.moveaxis(whole.attitude, -1, 0)[rows],
            covariance=whole.covariance[rows],
            noise=NOISE,
        )
        size = force[:, rows].shape[1]
        made = increments(force[:, rows], rate[:, rows], np.full((30, size), 0.01), biases=states == 15)
        for step in range(30):
            mean = None if made.mean_rotation_s is None else made.mean_rotation_s[step]
            part.predict(made.turn_and_advance[step], made.duration_s[step], mean)
            part.zero_velocity(resting[step, rows], 1e-4)
            part.correct()
        return part

    for states in (9, 15):
        stacked, alone = run(slice(None), states), run(slice(2, 3), states)
        np.testing.assert_array_equal(stacked.covariance[2:3], alone.covariance)
        for name in ("position_m", "velocity_m_per_s", "attitude", "bias"):
            np.testing.assert_array_equal(getattr(stacked, name)[..., 2:3], getattr(alone, name))


def test_senseless_input_is_refused() -> None:
    good = {
        "position_m": np.zeros((2, 3)),
        "velocity_m_per_s": np.zeros((2, 3)),
        "attitude": np.tile(np.eye(3), (2, 1, 1)),
        "covariance": np.tile(np.eye(9), (2, 1, 1)),
        "noise": NOISE,
    }
    ErrorStateFilter(**good)
    for name, value in (
        ("position_m", np.zeros((3, 3))),
        ("attitude", np.eye(3)),
        ("covariance", np.eye(9)),
        ("covariance", np.tile(np.eye(12), (2, 1, 1))),
    ):
        with pytest.raises(InputError, match="states=12" if np.shape(value)[-1] == 12 else name):
            ErrorStateFilter(**{**good, name: value})
