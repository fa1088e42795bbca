"""Strapdown navigation against matrix exponentials, closed forms, and its own inverse."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from positioning.errors import InputError
from positioning.inertial.strapdown import (
    GRAVITY_M_PER_S2,
    attitude_of,
    cross_matrix,
    levelled,
    mean_rotation,
    navigate,
    readings,
    roll_pitch_heading,
    rotation,
    rotation_vector,
)

SEEDS = st.integers(0, 10_000)


def directions(rng: np.random.Generator, *shape: int) -> Any:
    vector = rng.normal(size=(*shape, 3))
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 0.0999, 0.1001, 1.0, 3.0, np.pi - 1e-7, np.pi])
def test_rotations_equal_an_independent_library(angle: float) -> None:
    vector = angle * directions(np.random.default_rng(1), 50)
    np.testing.assert_allclose(rotation(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    # At exactly half a turn both signs are right.
    found = rotation_vector(rotation(vector))
    np.testing.assert_allclose(rotation(found), rotation(vector), atol=1e-14)
    if angle < 3.14:
        np.testing.assert_allclose(found, vector, atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from([1e-9, 0.09, 0.11, 1.0, 3.0, 7.0]))
def test_rotation_and_its_mean_are_blocks_of_one_matrix_exponential(seed: int, angle: float) -> None:
    # The exponential of [[K, I], [0, 0]] has Exp(v) and the integral of Exp(s v) ds in its upper row.
    vector = angle * directions(np.random.default_rng(seed))
    block = np.zeros((6, 6))
    block[:3, :3], block[:3, 3:] = cross_matrix(vector), np.eye(3)
    expected = expm(block)
    np.testing.assert_allclose(rotation(vector), expected[:3, :3], atol=1e-13)
    np.testing.assert_allclose(mean_rotation(vector), expected[:3, 3:], atol=1e-13)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_attitudes_are_turns_about_three_axes(seed: int) -> None:
    roll, pitch, heading = np.random.default_rng(seed).uniform(-1.5, 1.5, (3, 4))
    expected = Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=-1)).as_matrix()
    np.testing.assert_allclose(attitude_of(roll, pitch, heading), expected, atol=1e-14)
    np.testing.assert_allclose(roll_pitch_heading(expected), [roll, pitch, heading], atol=1e-12)
    gravity = np.swapaxes(expected, -1, -2) @ [0.0, 0.0, 3.0]
    np.testing.assert_allclose(levelled(gravity), [roll, pitch], atol=1e-12)


def test_signs_of_the_angles() -> None:
    forward, left = np.eye(3)[:2]
    assert (attitude_of(0.0, 0.1, 0.0) @ forward)[2] < 0
    assert (attitude_of(0.1, 0.0, 0.0) @ left)[2] > 0
    assert (attitude_of(0.0, 0.0, 0.1) @ forward)[1] > 0
    # A unit lying on its back reads gravity downwards.
    assert abs(levelled([0.0, 0.0, -9.8])[0]) == pytest.approx(np.pi)


def test_a_thrown_sensor_flies_a_parabola_however_it_tumbles() -> None:
    rate = np.tile([3.0, -2.0, 5.0], (100, 1))
    found = navigate(
        np.zeros((100, 3)), rate, 0.01, velocity_m_per_s=[2.0, 1.0, 5.0], position_m=[1.0, 0.0, 0.0]
    )
    expected = [3.0, 1.0, 5.0 - GRAVITY_M_PER_S2 / 2]
    np.testing.assert_allclose(found.position_m[-1], expected, rtol=1e-12)
    turned = Rotation.from_rotvec([3.0, -2.0, 5.0]).as_matrix()
    np.testing.assert_allclose(found.attitude[-1], turned, atol=1e-12)


def test_a_carousel_is_exact_in_velocity_at_any_sampling() -> None:
    # Constant speed on a circle: constant rate and centripetal force to the left.
    speed, rate, count = 3.0, 0.8, 7
    force = np.tile([0.0, speed * rate, GRAVITY_M_PER_S2], (count, 1))
    turn = np.tile([0.0, 0.0, rate], (count, 1))
    found = navigate(force, turn, 0.5, velocity_m_per_s=[speed, 0.0, 0.0])
    angle = rate * 0.5 * np.arange(count + 1)
    expected = speed * np.stack([np.cos(angle), np.sin(angle), np.zeros(count + 1)], axis=-1)
    np.testing.assert_allclose(found.velocity_m_per_s, expected, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(0.001, 0.5), st.booleans())
def test_readings_are_the_inverse_of_navigation(seed: int, duration: float, uneven: bool) -> None:
    rng = np.random.default_rng(seed)
    velocity, start = rng.normal(0, 3, (2, 3, 12, 3)), rng.normal(0, 9, (2, 3, 3))
    attitude = rotation(rng.normal(0, 1, (2, 3, 12, 3)))
    steps = duration * rng.uniform(0.5, 1.5, (2, 3, 11)) if uneven else np.asarray(duration)
    gravity = [0.3, -0.1, -9.7]
    force, rate = readings(velocity, attitude, steps, gravity)
    found = navigate(
        force,
        rate,
        steps,
        position_m=start,
        velocity_m_per_s=velocity[..., 0, :],
        attitude=attitude[..., 0, :, :],
        gravity_m_per_s2=gravity,
    )
    np.testing.assert_allclose(found.velocity_m_per_s, velocity, atol=1e-11)
    np.testing.assert_allclose(found.attitude, attitude, atol=1e-11)
    mean = (
        0.5 * (velocity[..., 1:, :] + velocity[..., :-1, :]) * np.broadcast_to(steps, (2, 3, 11))[..., None]
    )
    np.testing.assert_allclose(np.diff(found.position_m, axis=-2), mean, atol=1e-11)
    np.testing.assert_allclose(found.position_m[..., 0, :], start)


def foot_path(time_s: Any, lap_m: float, stride_s: float, stride_m: float) -> tuple[Any, Any, Any]:
    """Return position, velocity and attitude of a foot that swings smoothly around a circle."""
    phase, rate = 2 * np.pi * time_s / stride_s, 2 * np.pi / stride_s
    along = stride_m * (phase - np.sin(phase)) / (2 * np.pi)
    speed = stride_m / stride_s * (1 - np.cos(phase))
    radius = lap_m / (2 * np.pi)
    angle = along / radius
    lift, climb = 0.05 * (1 - np.cos(phase)), 0.05 * rate * np.sin(phase)
    place = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), lift], axis=-1)
    velocity = np.stack([speed * np.cos(angle), speed * np.sin(angle), climb], axis=-1)
    return place, velocity, attitude_of(0.1 * np.sin(phase), 0.8 * np.sin(phase), angle + 0.2 * np.cos(phase))


def test_four_laps_at_100_hz_without_noise_return_the_path() -> None:
    time_s = 0.01 * np.arange(40_001)
    place, velocity, attitude = foot_path(time_s, lap_m=115.0, stride_s=1.1, stride_m=1.32)
    assert 4 * 115 < 400 / 1.1 * 1.32
    force, rate = readings(velocity, attitude, 0.01)
    start = {"position_m": place[0], "velocity_m_per_s": velocity[0], "attitude": attitude[0]}
    found = navigate(force, rate, 0.01, **start)
    assert np.linalg.norm(found.position_m - place, axis=-1).max() < 1e-3
    # The same readings are not forgiving: a hundredth of a degree a second ruins them.
    worse = navigate(force, rate + np.deg2rad(0.01), 0.01, **start)
    assert np.linalg.norm(worse.position_m - place, axis=-1).max() > 1.0


def test_a_stack_gives_what_one_gives() -> None:
    rng = np.random.default_rng(4)
    force, rate = rng.normal(size=(2, 5, 40, 3))
    stacked = navigate(force, rate, 0.01)
    for row in range(5):
        alone = navigate(force[row], rate[row], 0.01)
        for one, many in zip(alone, stacked, strict=True):
            np.testing.assert_array_equal(one, many[row])


@pytest.mark.parametrize(
    ("call", "thing"),
    [
        (lambda: rotation([1.0, 2.0]), "vector_rad"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((5, 3)), 0.1), "specific_force"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), np.ones(3)), "duration_s"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.0), "duration_s"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), [0.1, np.nan, 0.1, 0.1]), "duration_s"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, attitude=np.eye(2)), "attitude"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, attitude=np.ones(3)), "attitude"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, attitude=2 * np.eye(3)), "attitude"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, attitude=-np.eye(3)), "attitude"),
        (
            lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, attitude=np.full((3, 3), np.nan)),
            "attitude",
        ),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, gravity_m_per_s2=-9.8), "gravity"),
        (lambda: navigate(np.zeros((4, 3)), np.zeros((4, 3)), 0.1, gravity_m_per_s2=[0.0, 9.8]), "gravity"),
        (lambda: readings(np.zeros((4, 3)), np.zeros((3, 3, 3)), 0.1), "velocity"),
        (lambda: readings(np.zeros((1, 3)), np.zeros((1, 3, 3)), 0.1), "velocity"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(call: Any, thing: str) -> None:
    with pytest.raises(InputError, match=thing):
        call()
