"""Residuals of the graph against hand computation, finite differences, and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.model import Array
from positioning.posegraph.residuals import (
    MOTION_INFORMATION,
    motion_jacobians,
    motion_residual,
    move,
    near_jacobians,
    near_residual,
    relative_pose,
    wrap,
)

STEP = 1e-6


def differences(function: object, pose: Array) -> Array:
    """Return central differences of a function of one pose, [..., value, 3]."""
    columns = []
    for axis in range(3):
        shift = STEP * np.eye(3)[axis]
        columns.append((function(pose + shift) - function(pose - shift)) / (2 * STEP))  # type: ignore[operator]
    return np.stack(columns, axis=-1)


def poses(seed: int, count: int = 20, size_m: float = 20.0) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    one, two = rng.uniform(-size_m, size_m, (2, count, 3))
    return one, two


def test_wrap_by_hand() -> None:
    np.testing.assert_allclose(wrap([0.0, 4.0, -4.0, 7.0]), [0, 4 - 2 * np.pi, 2 * np.pi - 4, 7 - 2 * np.pi])
    np.testing.assert_allclose(wrap([np.pi, -np.pi]), [-np.pi, -np.pi])


def test_relative_pose_by_hand() -> None:
    # At (1, 2) looking along y, a pose at (0, 5) is three metres ahead and one to the left.
    found = relative_pose([1.0, 2.0, np.pi / 2], [0.0, 5.0, np.pi])
    np.testing.assert_allclose(found, [3.0, 1.0, np.pi / 2], atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_moving_and_looking_back_are_inverse(seed: int) -> None:
    start, motion = poses(seed)
    np.testing.assert_allclose(relative_pose(start, move(start, motion)), motion, atol=1e-12)
    np.testing.assert_allclose(motion_residual(start, move(start, motion), motion), 0.0, atol=1e-12)


def test_turns_are_compared_on_the_circle() -> None:
    residual = motion_residual([0.0, 0.0, 3.1], [0.0, 0.0, -3.1], [0.0, 0.0, 0.0])
    assert residual[2] == pytest.approx(2 * np.pi - 6.2)
    whole = motion_residual([0.0, 0.0, 0.0], [1.0, 0.0, 8 * np.pi], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(whole, 0.0, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_motion_jacobians_equal_differences(seed: int) -> None:
    start, end = poses(seed)
    # The measured motion is near the actual one, so that no turn is at the cut of the circle.
    motion = relative_pose(start, end) + 0.3
    by_from, by_to = motion_jacobians(start, end)
    np.testing.assert_allclose(
        by_from, differences(lambda p: motion_residual(p, end, motion), start), rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(
        by_to, differences(lambda p: motion_residual(start, p, motion), end), rtol=1e-6, atol=1e-6
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 5.0), st.floats(6.0, 40.0), st.floats(0.1, 10.0))
def test_near_jacobians_equal_differences(seed: int, least: float, most: float, e_max: float) -> None:
    start, end = poses(seed)
    shape = {"e_max": e_max, "d_min_m": least, "d_max_m": most}
    distance = np.linalg.norm((end - start)[:, :2], axis=-1)
    smooth = (np.abs(distance - least) > 1e-3) & (np.abs(distance - most) > 1e-3)
    start, end = start[smooth], end[smooth]
    by_from, by_to = near_jacobians(start, end, **shape)
    expected = differences(lambda p: near_residual(p, end, **shape)[..., None], start)[..., 0, :]
    np.testing.assert_allclose(by_from, expected, rtol=1e-6, atol=1e-6)
    expected = differences(lambda p: near_residual(start, p, **shape)[..., None], end)[..., 0, :]
    np.testing.assert_allclose(by_to, expected, rtol=1e-6, atol=1e-6)


def test_equation_10_by_hand() -> None:
    end = np.zeros((6, 3))
    end[:, 0] = [0.0, 1.9, 2.0, 16.0, 30.0, 99.0]
    np.testing.assert_allclose(near_residual(np.zeros(3), end, e_max=4.0), [0, 0, 0, 2, 4, 4])
    by_from, by_to = near_jacobians(np.zeros(3), end, e_max=4.0)
    np.testing.assert_allclose(by_to[:, 0], [0, 0, 0, 4 / 28, 0, 0])
    np.testing.assert_array_equal(by_from, -by_to)
    assert (by_to[:, 1:] == 0).all()


def test_information_of_equation_8() -> None:
    np.testing.assert_array_equal(MOTION_INFORMATION, np.diag([1.0, 1.0, 20.0]))


def test_leading_axes_broadcast() -> None:
    start, end = poses(1)
    many = np.stack([start, start + 1.0])
    stacked = motion_residual(many, end, np.zeros(3))
    np.testing.assert_array_equal(stacked[1], motion_residual(start + 1.0, end, np.zeros(3)))
    assert motion_jacobians(many, end)[0].shape == (2, 20, 3, 3)
    np.testing.assert_array_equal(near_jacobians(many, end)[0][0], near_jacobians(start, end)[0])
