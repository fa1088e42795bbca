"""GPS beside an inertial navigation: masks, interpolation and lever arm, with finite differences."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.inertial.geodetic import attitude_of, position_scale_m
from positioning.inertial.gps import (
    antenna,
    lagrange_weights,
    linear_weights,
    metric_observation_matrix,
    observation_matrix,
    usable_gps,
    without_lever_arm,
)
from positioning.inertial.strapdown import cross_matrix
from positioning.model import Recording

SEEDS = st.integers(0, 10_000)


def recorded(**parts: Any) -> Recording:
    filled: dict[str, Any] = {
        "time_s": np.zeros((1, 1)),
        "gps_time_s": np.arange(10.0)[None] + 0.5,
        "gps_geodetic": np.zeros((1, 10, 3)),
        "gps_outage_s": np.array([[2.5, 5.5]]),
    }
    return Recording(**(filled | parts))


def used(recording: Recording, outage_s: float | None = None) -> list[int]:
    return [int(number) for number in np.flatnonzero(usable_gps(recording, outage_s)[0])]


def test_the_outage_masks_and_its_length_can_be_chosen() -> None:
    assert used(recorded()) == [0, 1, 5, 6, 7, 8, 9]
    assert used(recorded(), 1.0) == [0, 1, 3, 4, 5, 6, 7, 8, 9]
    assert used(recorded(), 100.0) == [0, 1]
    assert used(recorded(), 0.0) == list(range(10))
    assert used(recorded(gps_outage_s=None)) == list(range(10))
    assert used(recorded(gps_outage_s=np.full((1, 2), np.nan)), 5.0) == list(range(10))


def test_missing_readings_of_gps_do_not_count() -> None:
    velocity, time_s = np.zeros((1, 10, 3)), np.arange(10.0)[None] + 0.5
    velocity[0, 7, 1] = np.nan
    time_s[0, 9] = np.nan
    assert used(recorded(gps_velocity_m_per_s=velocity, gps_time_s=time_s)) == [0, 1, 5, 6, 8]


def test_impossible_outages_are_refused() -> None:
    with pytest.raises(InputError, match="no GPS"):
        usable_gps(Recording(time_s=np.zeros((1, 1))))
    with pytest.raises(InputError, match="below zero"):
        usable_gps(recorded(), -1.0)
    with pytest.raises(InputError, match="where it begins"):
        usable_gps(recorded(gps_outage_s=None), 10.0)


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.integers(0, 4))
def test_lagrange_meets_polynomials_and_is_linear_at_order_zero(seed: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    count = 2 * more + 2
    samples = np.sort(rng.uniform(-1, 1, (3, count)) * 0.1 + np.arange(count), axis=-1)
    time = rng.uniform(0, count - 1, 3)
    weights = lagrange_weights(samples, time)
    # Of unit size over the samples: no entry is lost to cancellation.
    polynomial = np.polynomial.Polynomial(rng.normal(size=count), domain=[0, count - 1])
    found = np.sum(weights * polynomial(samples), axis=-1)
    np.testing.assert_allclose(found, polynomial(time), rtol=1e-8, atol=1e-8)
    if more == 0:
        np.testing.assert_allclose(weights, linear_weights(samples, time), rtol=0, atol=1e-12)


def state(seed: int) -> tuple[Any, Any, Any, Any, Any]:
    rng = np.random.default_rng(seed)
    place = np.array([rng.uniform(-1.2, 1.2), rng.uniform(-3, 3), rng.uniform(0, 500)])
    return (
        place,
        rng.normal(0, 10, 3),
        attitude_of(rng.normal(size=3)),
        rng.normal(size=3),
        rng.normal(size=3),
    )


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_the_lever_arm_comes_off_again(seed: int) -> None:
    place, velocity, matrix, rate, lever = state(seed)
    there = antenna(place, velocity, matrix, rate, lever)
    back = without_lever_arm(*there, matrix, rate, lever)
    np.testing.assert_allclose(back[0] * position_scale_m(place), place * position_scale_m(place), atol=1e-4)
    np.testing.assert_allclose(back[1], velocity, atol=1e-12)
    away = (there[0] - place) * position_scale_m(place)
    np.testing.assert_allclose(away, matrix @ lever, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.sampled_from(["metres", "radians"]))
def test_what_gps_observes_is_a_derivative(seed: int, units: str) -> None:
    place, velocity, matrix, rate, lever = state(seed)
    scale = np.abs(position_scale_m(place))
    steps = np.array([1e-6, 1e-6, 1.0, 1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])

    def seen(off: Any, bias: Any) -> Any:
        turned = (np.eye(3) - cross_matrix(off[6:9])) @ matrix
        # The lever arm leads by the radii of the place before, as in eq. 36.1.
        away = turned @ lever / position_scale_m(place)
        _, speed = antenna(place, velocity + off[3:6], turned, rate + bias, lever)
        return np.concatenate([(off[:3] + away) * (scale if units == "metres" else 1.0), speed])

    found = observation_matrix(place, matrix, rate, lever, units=units, states=15)
    for column, step in enumerate(steps):
        shift = step * np.eye(9)[column]
        numeric = (seen(shift, np.zeros(3)) - seen(-shift, np.zeros(3))) / (2 * step)
        np.testing.assert_allclose(found[:, column], numeric, rtol=1e-6, atol=1e-9)
    for column in range(3):
        off = np.eye(3)[column]
        numeric = (seen(np.zeros(9), off) - seen(np.zeros(9), -off)) / 2
        np.testing.assert_allclose(found[:, 12 + column], numeric, rtol=1e-6, atol=1e-9)
    assert not found[:, 9:12].any()


def test_metric_matrix_without_a_lever_arm_is_that_of_the_paper() -> None:
    found = metric_observation_matrix(np.eye(3), np.ones(3), np.zeros(3))
    np.testing.assert_array_equal(found, np.eye(6, 9))
    printed = observation_matrix([0.9, 0.1, 100.0], np.eye(3), np.ones(3), np.zeros(3))
    np.testing.assert_allclose(
        np.diag(printed), [*np.abs(position_scale_m([0.9, 0.1, 100.0])), 1, 1, 1], rtol=1e-15
    )
    many = metric_observation_matrix(np.tile(np.eye(3), (4, 5, 1, 1)), np.zeros((5, 3)), np.ones(3))
    assert many.shape == (4, 5, 6, 9)


def test_unknown_units_are_refused() -> None:
    with pytest.raises(InputError, match="no such units"):
        observation_matrix([0.9, 0.1, 100.0], np.eye(3), np.ones(3), np.zeros(3), units="degrees")
    with pytest.raises(InputError, match="9 or 15"):
        observation_matrix([0.9, 0.1, 100.0], np.eye(3), np.ones(3), np.zeros(3), states=6)
