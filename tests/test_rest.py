"""Detectors of rest against loops written out, known times, and each other's limits."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.inertial.rest import (
    DETECTORS,
    acceleration_magnitude,
    angular_rate_energy,
    detect,
    shoe,
    spans,
)
from positioning.inertial.strapdown import GRAVITY_M_PER_S2, rotation

RATE_HZ = 100.0


def signals(seed: int, samples: int = 300) -> tuple[Any, Any]:
    """Return force and rate of a sensor that rests and shakes in turns."""
    rng = np.random.default_rng(seed)
    shaken = np.repeat(rng.random(samples // 10) < 0.5, 10)[:, None] * rng.choice([0.8, 3.0])
    force = np.array([0.0, 0.0, GRAVITY_M_PER_S2]) + (0.02 + 2 * shaken) * rng.normal(size=(samples, 3))
    return force, (0.005 + shaken) * rng.normal(size=(samples, 3))


def test_the_band_must_be_kept_for_some_time() -> None:
    force = np.tile([0.0, 0.0, GRAVITY_M_PER_S2], (60, 1))
    force[20] *= 1.2
    force[40, 0] = 3.0  # 10.25 m/s^2 together: within the band
    found = acceleration_magnitude(force, 0 * force, RATE_HZ, threshold_m_per_s2=1.0, least_duration_s=0.1)
    # Ten samples within the band: number 9 is the first that rests, and 30 after the blow at 20.
    np.testing.assert_array_equal(np.flatnonzero(~found), [*range(9), *range(20, 30)])
    narrow = acceleration_magnitude(force, 0 * force, RATE_HZ, threshold_m_per_s2=0.4, least_duration_s=0.1)
    assert not narrow[40:50].any()
    assert narrow[50:].all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.02, 0.3))
def test_the_band_equals_a_counter(seed: int, duration: float) -> None:
    force, rate = signals(seed)
    found = acceleration_magnitude(force, rate, RATE_HZ, threshold_m_per_s2=0.5, least_duration_s=duration)
    count, expected = 0, []
    for reading in force:
        count = count + 1 if abs(np.sqrt(reading @ reading) - GRAVITY_M_PER_S2) <= 0.5 else 0
        expected.append(count >= max(1, round(duration * RATE_HZ)))
    np.testing.assert_array_equal(found, expected)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_shoe_equals_its_definition(seed: int) -> None:
    force, rate = signals(seed, 120)
    found = shoe(force, rate, RATE_HZ)
    expected = np.zeros(120, dtype=bool)
    for begin in range(116):
        part = slice(begin, begin + 5)
        mean = force[part].mean(axis=0)
        up = GRAVITY_M_PER_S2 * mean / np.linalg.norm(mean)
        statistic = np.mean(
            np.sum((force[part] - up) ** 2, axis=1) / 0.01**2
            + np.sum(rate[part] ** 2, axis=1) / np.deg2rad(0.1) ** 2
        )
        if statistic < 1e5:
            expected[part] = True
    np.testing.assert_array_equal(found, expected)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_angular_rate_energy_equals_its_definition(seed: int) -> None:
    force, rate = signals(seed, 120)
    expected = np.zeros(120, dtype=bool)
    for begin in range(116):
        if np.sqrt(np.mean(np.sum(rate[begin : begin + 5] ** 2, axis=1))) < 0.5:
            expected[begin : begin + 5] = True
    np.testing.assert_array_equal(angular_rate_energy(force, rate, RATE_HZ), expected)


@pytest.mark.parametrize("name", list(DETECTORS))
@pytest.mark.parametrize("seed", [1, 2])
def test_every_detector(name: str, seed: int) -> None:
    force, rate = signals(seed)
    found = DETECTORS[name](force, rate, RATE_HZ)
    assert found.dtype == bool
    assert 0.05 < found.mean() < 0.95
    # However the sensor is mounted, and stacked or alone.
    mount = rotation(np.array([0.4, -2.0, 1.0]))
    np.testing.assert_array_equal(DETECTORS[name](force @ mount, rate @ mount, RATE_HZ), found)
    stacked = DETECTORS[name](np.stack([force, force[::-1]]), np.stack([rate, rate[::-1]]), RATE_HZ)
    np.testing.assert_array_equal(stacked[0], found)
    # At most one window of the future counts.
    np.testing.assert_array_equal(DETECTORS[name](force[:200], rate[:200], RATE_HZ)[:195], found[:195])
    np.testing.assert_array_equal(detect(name, {}, force, rate, RATE_HZ), found)


def test_a_window_longer_than_the_recording_finds_nothing() -> None:
    still = np.tile([0.0, 0.0, GRAVITY_M_PER_S2], (4, 1))
    for name in DETECTORS:
        assert not DETECTORS[name](still, 0 * still, RATE_HZ).any()


def test_spans() -> None:
    first, second, third = spans(np.array([[1, 1, 0, 1], [0, 1, 1, 0], [0, 0, 0, 0]], dtype=bool))
    np.testing.assert_array_equal(first, [[0, 2], [3, 4]])
    np.testing.assert_array_equal(second, [[1, 3]])
    assert third.shape == (0, 2)


@pytest.mark.parametrize(
    ("name", "settings_", "message"),
    [
        ("shoes", {}, "no such detector"),
        ("shoe", {"window": 5}, "does not have"),
        ("shoe", {"threshold": 0.0}, "threshold=0.0"),
        ("acceleration_magnitude", {"least_duration_s": -1.0}, "least_duration_s=-1.0"),
        ("angular_rate_energy", {"window_s": float("nan")}, "window_s=nan"),
    ],
)
def test_senseless_settings_are_refused(name: str, settings_: Any, message: str) -> None:
    force, rate = signals(1)
    with pytest.raises(InputError, match=message):
        detect(name, settings_, force, rate, RATE_HZ)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match="shapes"):
        shoe(np.zeros((5, 3)), np.zeros((6, 3)), RATE_HZ)


@pytest.mark.parametrize("answer", [np.ones(5, dtype=bool), np.ones(6), np.ones((6, 1), dtype=bool)])
def test_a_detector_answers_with_one_truth_value_a_reading(
    answer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(DETECTORS, "own", lambda force, rate, rate_hz: answer)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"detector 'own': it is .* not bool of shape \(6,\)"):
        detect("own", {}, np.zeros((6, 3)), np.zeros((6, 3)), 100.0)
