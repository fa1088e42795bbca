"""Sightings of landmarks against closed forms and finite differences."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.inertial.geodetic import attitude_of
from positioning.inertial.landmarks import (
    first_sight,
    from_sensor_m,
    has_direction,
    observation_matrices,
    polar_derivative,
    relative_m,
    sighting_of,
)
from positioning.inertial.strapdown import cross_matrix

SEEDS = st.integers(0, 10_000)


def scene(seed: int) -> tuple[Any, Any, Any, Any]:
    rng = np.random.default_rng(seed)
    landmark = rng.uniform(5, 30, 3) * rng.choice([-1, 1], 3)
    return landmark, rng.normal(size=3), attitude_of(rng.uniform(-1, 1, 3)), rng.normal(0, 0.3, 3)


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_sightings_lead_back_to_the_landmark(seed: int) -> None:
    landmark, position, matrix, lever = scene(seed)
    relative = from_sensor_m(landmark, position, matrix, lever)
    seen = sighting_of(relative)
    np.testing.assert_allclose(relative_m(seen), relative, atol=1e-12)
    found, _, _ = first_sight(position, matrix, lever, seen)
    np.testing.assert_allclose(found, landmark, atol=1e-12)


def test_known_sightings() -> None:
    # Ahead, to the right, below, and behind the sensor.
    seen = sighting_of(np.array([[2.0, 0, 0], [0, 2.0, 0], [1.0, 0, 1.0], [-2.0, 0, 0]]))
    np.testing.assert_allclose(seen[0], [2, 0, 0])
    np.testing.assert_allclose(seen[1], [2, np.pi / 2, 0])
    np.testing.assert_allclose(seen[2], [np.sqrt(2), 0, np.pi / 4])
    np.testing.assert_allclose(seen[3], [2, np.pi, 0])
    # A body that looks east sees a landmark in the north on its left.
    relative = from_sensor_m([10.0, 0, 0], np.zeros(3), attitude_of([0, 0, np.pi / 2]), np.zeros(3))
    np.testing.assert_allclose(relative, [0, -10, 0], atol=1e-12)


def wrapped(difference: Any) -> Any:
    difference[1] = (difference[1] + np.pi) % (2 * np.pi) - np.pi
    return difference


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_what_a_sighting_observes_is_a_derivative(seed: int) -> None:
    landmark, position, matrix, lever = scene(seed)

    def seen(off: Any, moved: Any) -> Any:
        turned = (np.eye(3) - cross_matrix(off[6:9])) @ matrix
        return sighting_of(from_sensor_m(landmark + moved, position + off[:3], turned, lever))

    by_vehicle, by_landmark = observation_matrices(landmark, position, matrix, lever)
    # The nearer to straight above or below, the faster bearings bend: what a step of 1e-5 rounds off grows
    # with the third power of range by horizontal distance, 2e-6 at a ratio of 42.
    relative = from_sensor_m(landmark, position, matrix, lever)
    step = 1e-5 * np.hypot(relative[0], relative[1]) / np.linalg.norm(relative)
    for column in range(9):
        shift = step * np.eye(9)[column]
        numeric = wrapped(seen(shift, np.zeros(3)) - seen(-shift, np.zeros(3))) / (2 * step)
        np.testing.assert_allclose(by_vehicle[:, column], numeric, rtol=1e-6, atol=1e-7)
    for column in range(3):
        shift = step * np.eye(3)[column]
        numeric = wrapped(seen(np.zeros(9), shift) - seen(np.zeros(9), -shift)) / (2 * step)
        np.testing.assert_allclose(by_landmark[:, column], numeric, rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(by_vehicle[:, :3], -by_landmark)
    assert not by_vehicle[:, 3:6].any()


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_the_first_sight_hangs_on_vehicle_and_sensor_by_its_derivatives(seed: int) -> None:
    landmark, position, matrix, lever = scene(seed)
    sighting = sighting_of(from_sensor_m(landmark, position, matrix, lever))

    def found(off: Any, wrong: Any) -> Any:
        turned = (np.eye(3) - cross_matrix(off[6:9])) @ matrix
        return first_sight(position + off[:3], turned, lever, sighting + wrong)[0]

    _, by_vehicle, by_sighting = first_sight(position, matrix, lever, sighting)
    step = 1e-5
    for column in range(9):
        shift = step * np.eye(9)[column]
        numeric = (found(shift, np.zeros(3)) - found(-shift, np.zeros(3))) / (2 * step)
        np.testing.assert_allclose(by_vehicle[:, column], numeric, rtol=1e-6, atol=1e-7)
    for column in range(3):
        shift = step * np.eye(3)[column]
        numeric = (found(np.zeros(9), shift) - found(np.zeros(9), -shift)) / (2 * step)
        np.testing.assert_allclose(by_sighting[:, column], numeric, rtol=1e-6, atol=1e-7)
    # A landmark that is where the navigation put it tells that navigation nothing new.
    by_error, by_mark = observation_matrices(landmark, position, matrix, lever)
    np.testing.assert_allclose(by_error + by_mark @ by_vehicle, np.zeros((3, 9)), atol=1e-12)
    np.testing.assert_allclose(by_mark @ by_sighting, np.eye(3), atol=1e-10)


def test_places_without_a_direction() -> None:
    places = np.array([[0.0, 0, 0], [0, 0, 5.0], [1e-4, 0, -5.0], [-5.0, 0, 0], [0.1, 0, 5], [np.nan, 0, 1]])
    np.testing.assert_array_equal(has_direction(places), [False, False, False, True, True, False])
    good = places[3:5]
    assert np.isfinite(polar_derivative(good)).all()
