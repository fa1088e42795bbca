"""Inertial sensors: each error by itself against its closed form or an independent library."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from positioning.errors import InputError
from positioning.simulation.imu import (
    Gyro,
    GyroDraws,
    draw_gyro,
    gauss_markov,
    read_encoder,
    read_gyro,
    vertical_earth_rate,
)

IDEAL = Gyro(
    turn_on_bias_rad_per_s=0.0,
    in_run_bias_rad_per_s=0.0,
    in_run_correlation_s=100.0,
    angle_random_walk_rad_per_sqrt_s=0.0,
)


def draws(count, samples, seed=0):
    rng = np.random.default_rng(seed)
    return GyroDraws(*map(np.stack, zip(*(draw_gyro(rng, samples) for _ in range(count)), strict=True)))


def allan_deviation(rate, samples):
    """Deviation of neighbouring means over ``samples`` readings, by its definition."""
    means = rate[..., : rate.shape[-1] // samples * samples].reshape(*rate.shape[:-1], -1, samples).mean(-1)
    return np.sqrt(np.mean(np.diff(means, axis=-1) ** 2) / 2)


def test_an_ideal_gyroscope_reads_the_truth():
    rate = np.random.default_rng(1).normal(size=(3, 50))
    np.testing.assert_array_equal(read_gyro(rate, draws(3, 50), IDEAL, sample_rate_hz=100.0), rate)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_white_noise_walks_the_angle_as_the_data_sheet_says(rate_hz):
    walk = np.deg2rad(1.9) / 60
    gyro = replace(IDEAL, angle_random_walk_rad_per_sqrt_s=walk)
    reading = read_gyro(np.zeros(60_000), draws(8, 60_000), gyro, sample_rate_hz=rate_hz)
    for averaged_s in (0.1, 1.0, 5.0):
        deviation = allan_deviation(reading, round(averaged_s * rate_hz))
        assert deviation == pytest.approx(walk / np.sqrt(averaged_s), rel=0.06)
    # The angle after ten seconds deviates by the random walk times the root of them.
    angle = reading.reshape(8, -1, round(10 * rate_hz)).sum(axis=-1) / rate_hz
    assert angle.std() == pytest.approx(walk * np.sqrt(10), rel=0.1)


def test_the_bias_of_a_run_is_a_stationary_gauss_markov_process():
    gyro = replace(IDEAL, in_run_bias_rad_per_s=0.2, in_run_correlation_s=0.5)
    bias = read_gyro(np.zeros(400), draws(4000, 400), gyro, sample_rate_hz=100.0)
    np.testing.assert_allclose(bias.std(axis=0), 0.2, rtol=0.06)
    for lag in (10, 50, 100):
        alike = np.mean(bias[:, :-lag] * bias[:, lag:]) / 0.2**2
        assert alike == pytest.approx(np.exp(-lag / 50), abs=0.03)


@pytest.mark.parametrize("correlation", [1e-4, 0.5, 3.0, 1e4, 1e9])
@pytest.mark.parametrize("samples", [1, 2, 3, 1000])
def test_gauss_markov_is_the_recursion(correlation, samples):
    normal = np.random.default_rng(2).normal(size=(2, samples))
    before = normal.copy()
    process = gauss_markov(normal, correlation=correlation)
    np.testing.assert_array_equal(normal, before)
    decay = np.exp(-1 / correlation)
    noise = normal * np.where(np.arange(samples) == 0, 1.0, np.sqrt(-np.expm1(-2 / correlation)))
    np.testing.assert_allclose(process, lfilter([1.0], [1.0, -decay], noise), rtol=1e-10, atol=1e-11)


def test_turn_on_bias_and_scale_hold_for_a_run():
    gyro = replace(IDEAL, turn_on_bias_rad_per_s=0.05, scale_deviation=0.01)
    drawn = draws(5000, 4)
    still, turning = (read_gyro(np.full(4, rate), drawn, gyro, sample_rate_hz=100.0) for rate in (0.0, 2.0))
    assert (np.ptp(still, axis=-1) == 0).all()
    assert still[:, 0].std() == pytest.approx(0.05, rel=0.05)
    scale = (turning - still)[:, 0] / 2
    assert scale.mean() == pytest.approx(1, abs=0.001)
    assert scale.std() == pytest.approx(0.01, rel=0.05)
    assert abs(np.corrcoef(scale, still[:, 0])[0, 1]) < 0.05


def test_readings_are_multiples_of_the_resolution_and_nearest_to_the_value():
    step = np.deg2rad(0.05)
    gyro = replace(IDEAL, angle_random_walk_rad_per_sqrt_s=1e-3)
    drawn = draws(1, 500)
    fine = read_gyro(np.zeros(500), drawn, gyro, sample_rate_hz=100.0)
    coarse = read_gyro(np.zeros(500), drawn, replace(gyro, step_rad_per_s=step), sample_rate_hz=100.0)
    np.testing.assert_allclose(coarse / step, np.rint(coarse / step), atol=1e-9)
    assert np.abs(coarse - fine).max() <= step / 2 * (1 + 1e-9)
    assert len(np.unique(coarse)) > 10


def test_errors_scale_with_their_setting_and_share_their_draws():
    drawn, zero = draws(2, 100), np.zeros(100)
    for name in ("turn_on_bias_rad_per_s", "in_run_bias_rad_per_s", "angle_random_walk_rad_per_sqrt_s"):
        once, twice = (
            read_gyro(zero, drawn, replace(IDEAL, **{name: value}), sample_rate_hz=100.0)
            for value in (0.1, 0.2)
        )
        np.testing.assert_allclose(twice, 2 * once)
        assert once.any()


def test_the_earth_turns_to_the_left_in_the_north():
    # Once in a sidereal day of 86164.1 s, seen from above.
    assert vertical_earth_rate(np.pi / 2) == pytest.approx(2 * np.pi / 86164.1, rel=1e-5)
    assert vertical_earth_rate(0.0) == 0.0
    assert vertical_earth_rate(-0.3) == -vertical_earth_rate(0.3)
    assert np.rad2deg(vertical_earth_rate(np.deg2rad(44.23))) * 3600 == pytest.approx(10.49, abs=0.01)


@given(
    moves=st.lists(st.floats(0, 0.02), min_size=1, max_size=60),
    scale=st.floats(0.8, 1.2),
    step_m=st.floats(1e-4, 0.05),
    phase=st.floats(0, 1, exclude_max=True),
)
def test_an_encoder_loses_less_than_a_step_of_the_way(moves, scale, step_m, phase):
    distance = np.concatenate([[0.0], np.cumsum(moves)])
    speed = read_encoder(distance, scale=scale, step_m=step_m, phase=phase, sample_rate_hz=100.0)
    assert speed[0] == 0
    assert (speed >= 0).all()
    counts = speed / (100 * step_m)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert np.abs(np.cumsum(speed) / 100 - scale * distance).max() <= step_m * (1 + 1e-6)


def test_an_encoder_is_silent_after_the_end_and_each_row_is_its_own():
    distance = np.array([[0.0, 0.01, 0.02, np.nan], [0.0, 0.0, 0.03, 0.05]])
    speed = read_encoder(
        distance, scale=np.array([1.0, 2.0]), step_m=0.01, phase=np.array([0.5, 0.5]), sample_rate_hz=10.0
    )
    np.testing.assert_allclose(speed, [[0, 0.1, 0.1, np.nan], [0, 0, 0.6, 0.4]])


def test_senseless_sensors_are_named():
    for name in vars(IDEAL):
        for value in (-1.0, float("nan"), float("inf")):
            with pytest.raises(InputError, match=name):
                replace(IDEAL, **{name: value})
    with pytest.raises(InputError, match="in_run_correlation_s"):
        replace(IDEAL, in_run_correlation_s=0.0)
    with pytest.raises(InputError, match="sample_rate_hz"):
        read_gyro(np.zeros(3), draws(1, 3), IDEAL, sample_rate_hz=0.0)
    with pytest.raises(InputError, match="correlation"):
        gauss_markov(np.zeros(3), correlation=0.0)
    with pytest.raises(InputError, match="step_m"):
        read_encoder(np.zeros(3), scale=1.0, step_m=0.0, phase=0.0, sample_rate_hz=100.0)
    with pytest.raises(InputError, match="sample_rate_hz"):
        read_encoder(np.zeros(3), scale=1.0, step_m=0.1, phase=0.0, sample_rate_hz=-1.0)
