"""Navigation over the ellipsoid against an independent integration, closed forms, and finite differences."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.inertial import error_state
from positioning.inertial.earth import (
    EARTH_RATE_RAD_PER_S,
    ECCENTRICITY_SQUARED,
    gravity_m_per_s2,
    meridian_radius_m,
    normal_radius_m,
)
from positioning.inertial.geodetic import (
    attitude_of,
    position_scale_m,
    roll_pitch_yaw,
    surroundings,
    to_geodetic,
    to_local,
)
from positioning.inertial.geodetic_error_state import (
    error_dynamics,
    fill_metric_error_dynamics,
    flat_transition,
    noise_input,
)
from positioning.inertial.geodetic_strapdown import Strapdown, navigate, readings, together, travelled
from positioning.inertial.strapdown import cross_matrix, rotation_vector

SEEDS = st.integers(0, 10_000)
ORIGIN = np.array([0.9, 0.3, 120.0])


def flight(worlds: int, seconds: float, rate_hz: float = 100.0) -> tuple[Any, Any, Any]:
    """Return places, velocities and attitudes of winding flights."""
    time_s = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    phase = np.linspace(0.0, 5.0, worlds)[:, None]
    yaw = 2 * np.pi * time_s / 80 + phase + 0.3 * np.sin(time_s)
    speed = 5 + 0.8 * np.sin(0.3 * time_s + phase)
    climb = 0.3 * np.sin(0.2 * time_s + phase)
    velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), climb], axis=-1)
    roll, pitch = 0.2 * np.sin(time_s + phase), 0.1 * np.cos(1.3 * time_s + phase)
    attitude = attitude_of(np.stack([roll, pitch, yaw], axis=-1))
    return travelled(ORIGIN, velocity, 1 / rate_hz), velocity, attitude


def test_navigation_returns_where_the_readings_come_from() -> None:
    place, velocity, attitude = flight(2, 120.0)
    force, rate = readings(place, velocity, attitude, 0.01)
    found = navigate(
        force,
        rate,
        0.01,
        geodetic=place[:, 0],
        velocity_m_per_s=velocity[:, 0],
        attitude=attitude[:, 0],
    )
    assert np.abs(to_local(found.geodetic, ORIGIN) - to_local(place, ORIGIN)).max() < 1e-6
    turned = rotation_vector(found.attitude @ attitude.swapaxes(-1, -2))
    assert np.abs(turned).max() < 1e-10
    assert np.abs(found.velocity_m_per_s - velocity).max() < 1e-9


def continuous(state: Any, force: Any, rate: Any) -> Any:
    """Return eq. 1 as it stands, for latitude, longitude, height, velocity, and the nine of the attitude."""
    place, velocity, matrix = state[:3], state[3:6], state[6:].reshape(3, 3)
    north = meridian_radius_m(place[0]) + place[2]
    east = normal_radius_m(place[0]) + place[2]
    return derivative(place, velocity, matrix, force, rate, north, east, gravity_m_per_s2(place[0], place[2]))


def derivative(
    place: Any, velocity: Any, matrix: Any, force: Any, rate: Any, north: Any, east: Any, gravity: Any
) -> Any:
    sine, cosine, tangent = np.sin(place[0]), np.cos(place[0]), np.tan(place[0])
    earth = EARTH_RATE_RAD_PER_S * np.array([cosine, 0.0, -sine])
    transport = np.array([velocity[1] / east, -velocity[0] / north, -velocity[1] * tangent / east])
    moved = np.array([velocity[0] / north, velocity[1] / (east * cosine), -velocity[2]])
    faster = matrix @ force - np.cross(2 * earth + transport, velocity) + np.array([0.0, 0.0, gravity])
    turned = matrix @ cross_matrix(rate) - cross_matrix(earth + transport) @ matrix
    return np.concatenate([moved, faster, turned.ravel()])


@settings(max_examples=5, deadline=None)
@given(SEEDS)
def test_navigation_agrees_with_a_runge_kutta_integration(seed: int) -> None:
    # Fast and turning, and readings that jump: what points instead of increments would not survive.
    rng = np.random.default_rng(seed)
    count, step_s = 300, 0.01
    force = rng.normal([0.0, 0.0, -9.8], 5.0, (count, 3))
    rate = rng.normal(0.0, 1.0, (count, 3))
    velocity, matrix = rng.normal(0.0, 60.0, 3), attitude_of(rng.normal(size=3))
    place = np.array([rng.uniform(-1.2, 1.2), 1.0, 500.0])
    found = navigate(force, rate, step_s, geodetic=place, velocity_m_per_s=velocity, attitude=matrix)
    state = np.concatenate([place, velocity, matrix.ravel()])
    for f, w in zip(force, rate, strict=True):
        one = continuous(state, f, w)
        two = continuous(state + 0.5 * step_s * one, f, w)
        three = continuous(state + 0.5 * step_s * two, f, w)
        four = continuous(state + step_s * three, f, w)
        state = state + step_s / 6 * (one + 2 * two + 2 * three + four)
    # The trapezoid of the velocity: a few 1e-5 m for such jumps of the force.
    assert np.abs(to_local(found.geodetic[-1], state[:3])).max() < 1e-3
    assert np.abs(found.velocity_m_per_s[-1] - state[3:6]).max() < 3e-5
    assert np.abs(found.attitude[-1] - state[6:].reshape(3, 3)).max() < 1e-7


def test_a_body_at_rest_reads_gravity_and_the_rotation_of_the_earth() -> None:
    matrix = attitude_of([0.1, -0.2, 2.0])
    force, rate = readings(np.tile(ORIGIN, (2, 1)), np.zeros((2, 3)), np.tile(matrix, (2, 1, 1)), 0.01)
    gravity = gravity_m_per_s2(ORIGIN[0], ORIGIN[2])
    earth = EARTH_RATE_RAD_PER_S * np.array([np.cos(0.9), 0.0, -np.sin(0.9)])
    np.testing.assert_allclose(rate[0], matrix.T @ earth, atol=1e-13)
    np.testing.assert_allclose(force[0], matrix.T @ [0.0, 0.0, -gravity], atol=1e-5)


def test_a_steady_flight_to_the_east_reads_coriolis_and_centripetal_force() -> None:
    east = np.array([0.0, 200.0, 0.0])
    velocity = np.tile(east, (2, 1))
    place = travelled(ORIGIN, velocity, 1e-4)
    force, _ = readings(place, velocity, np.tile(np.eye(3), (2, 1, 1)), 1e-4)
    radius = normal_radius_m(0.9) + 120.0
    turn = EARTH_RATE_RAD_PER_S * 2 + 200.0 / (radius * np.cos(0.9))
    wanted = [200 * turn * np.sin(0.9), 0.0, 200 * turn * np.cos(0.9) - gravity_m_per_s2(0.9, 120.0)]
    np.testing.assert_allclose(force[0], wanted, atol=1e-6)


def perturbed(state: Any, shift: Any, bias: Any) -> Any:
    """Return the rate of the error of a navigation that is off by ``shift``, by eq. 1 and constant radii."""
    place, velocity, matrix, force, rate = state
    north, east = meridian_radius_m(place[0]), normal_radius_m(place[0])
    gravity, mean = gravity_m_per_s2(place[0], place[2]), np.sqrt(north * east)

    def moved(off: Any, wrong: Any) -> tuple[Any, Any]:
        at, speed = place + off[:3], velocity + off[3:6]
        turned = (np.eye(3) - cross_matrix(off[6:9])) @ matrix
        fallen = gravity * ((mean + place[2]) / (mean + at[2])) ** 2
        change = derivative(
            at, speed, turned, force + wrong[:3], rate + wrong[3:], north + at[2], east + at[2], fallen
        )
        return change[:6], change[6:].reshape(3, 3)

    true, true_turn = moved(np.zeros(9), np.zeros(6))
    found, found_turn = moved(shift, bias)
    # From C_navigation = (I - E) C: E' = ((I - E) C' - C_navigation') C^T.
    skew = ((np.eye(3) - cross_matrix(shift[6:9])) @ true_turn - found_turn) @ matrix.T
    return np.concatenate([found - true, [skew[2, 1], skew[0, 2], skew[1, 0]]])


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_all_entries_of_the_error_dynamics_are_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = np.array([rng.uniform(0.3, 1.2) * rng.choice([-1, 1]), 1.0, rng.uniform(0, 2000)])
    velocity = rng.uniform(20, 200, 3) * rng.choice([-1, 1], 3)
    matrix = attitude_of(rng.normal(size=3))
    state = place, velocity, matrix, rng.normal(0, 10, 3), rng.normal(size=3)
    found = error_dynamics(place, velocity, matrix, state[3], states=15, bias_time_s=50.0)
    steps = np.array([1e-4, 1e-3, 1e3, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    for column in range(9):
        shift = steps[column] * np.eye(9)[column]
        numeric = (perturbed(state, shift, np.zeros(6)) - perturbed(state, -shift, np.zeros(6))) / (
            2 * steps[column]
        )
        # Below these floors an entry is lost in the rounding of 10 m/s^2 and 1 rad/s.
        floor = 2e-15 * np.array([1e-5, 1e-5, 100, 100, 100, 100, 10, 10, 10]) / steps[column]
        assert (np.abs(found[:9, column] - numeric) <= 1e-4 * np.abs(found[:9, column]) + floor).all()
    for column in range(6):
        wrong = np.eye(6)[column]
        numeric = (perturbed(state, np.zeros(9), wrong) - perturbed(state, np.zeros(9), -wrong)) / 2
        np.testing.assert_allclose(found[:9, 9 + column], numeric, atol=1e-12)
        np.testing.assert_allclose(noise_input(matrix)[:, column], numeric, atol=1e-12)
    np.testing.assert_array_equal(found[9:], np.hstack([np.zeros((6, 9)), -np.eye(6) / 50]))
    np.testing.assert_array_equal(error_dynamics(*state[:4]), found[:9, :9])
    assert noise_input(matrix, states=15).shape == (15, 12)


def test_each_printed_entry_is_off_the_derivative_and_the_mended_one_is_not() -> None:
    latitude, north, east, down = 0.9, 60.0, 150.0, 100.0
    cosine, tangent = np.cos(latitude), np.tan(latitude)
    meridian, normal = float(meridian_radius_m(latitude)), float(normal_radius_m(latitude))
    coriolis = 2 * EARTH_RATE_RAD_PER_S * east * cosine
    printed = {
        # Eq. 8.1, row 2, column 1.
        (1, 0): east * np.sin(latitude) / (normal**2 * cosine),
        # Eq. 9.1, row 1, column 1.
        (3, 0): -coriolis - east / (normal * cosine**2),
        # Eq. 9.1, row 2, column 3.
        (4, 2): -east * down / meridian**2 - north * east * tangent / normal**2,
    }
    state = (
        np.array([latitude, 0.0, 0.0]),
        np.array([north, east, down]),
        np.eye(3),
        np.array([0.0, 0.0, -9.8]),
        np.zeros(3),
    )
    found = error_dynamics(*state[:4])
    for (row, column), wrong in printed.items():
        shift = (1e-4, 1e-3, 1e3)[column] * np.eye(9)[column]
        change = perturbed(state, shift, np.zeros(6)) - perturbed(state, -shift, np.zeros(6))
        numeric = change[row] / (2 * shift[column])
        assert found[row, column] == pytest.approx(numeric, rel=1e-4, abs=0)
        assert abs(wrong - numeric) > 10e-4 * abs(numeric), (row, column)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_the_dynamics_in_metres_are_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = np.array([rng.uniform(0.3, 1.2) * rng.choice([-1, 1]), 1.0, rng.uniform(0, 2000)])
    velocity = rng.uniform(20, 200, 3) * rng.choice([-1, 1], 3)
    state = place, velocity, np.eye(3), np.zeros(3), np.zeros(3)
    found = np.zeros((1, 9, 9))
    around = surroundings(place[:1], place[2:])
    fill_metric_error_dynamics(found, around, velocity[:, None])
    radii = meridian_radius_m(place[0]), normal_radius_m(place[0])

    def scale(later_s: float) -> Any:
        """Metres per unit after a while, with the radii of curvature taken as constant."""
        at = place + later_s * derivative(*state, radii[0] + place[2], radii[1] + place[2], 0.0)[:3]
        return np.array([radii[0] + at[2], (radii[1] + at[2]) * np.cos(at[0]), -1.0])

    for column in range(6):
        step = (100.0, 100.0, 1e3, 1.0, 1.0, 1.0)[column]
        metric = step * np.eye(9)[column]
        shift = metric / np.concatenate([scale(0.0), np.ones(6)])
        change = (perturbed(state, shift, np.zeros(6)) - perturbed(state, -shift, np.zeros(6))) / 2
        numeric = change / step
        numeric[:3] *= scale(0.0)
        # The error itself stays, while a unit of it becomes another number of metres.
        numeric[:3] += (scale(1.0) - scale(-1.0)) / 2 * shift[:3] / step
        floor = 1e-13 * np.array([1, 1, 1, 1, 1, 1, 0.1, 0.1, 0.1])
        assert (np.abs(found[0, :, column] - numeric) <= 2e-4 * np.abs(numeric) + floor).all()


def test_the_flat_model_is_the_limit_of_the_full_one() -> None:
    rng = np.random.default_rng(0)
    matrix, force, step_s = attitude_of(rng.normal(size=3)), rng.normal(0, 10, 3), 0.05
    velocity = np.array([3.0, 4.0, 0.1])
    full = error_dynamics(ORIGIN, velocity, matrix, force)
    scale = position_scale_m(ORIGIN)
    full[:3] *= scale[:, None]
    full[:, :3] /= scale
    change = np.eye(9) + full * step_s + 0.5 * (full @ full) * step_s**2
    flat = flat_transition(matrix @ force, step_s)
    # Rotation of the earth, and gravity with the height: 1.5e-4 a second at most.
    assert np.abs(change - flat).max() < 2e-4 * step_s
    assert np.abs(change - flat).max() > 0
    moved = flat @ np.concatenate([np.zeros(6), [1e-3, 0.0, 0.0]])
    pushed = np.cross(matrix @ force, [1e-3, 0.0, 0.0])
    np.testing.assert_allclose(moved[3:6], pushed * step_s)
    np.testing.assert_allclose(moved[:3], pushed * step_s**2 / 2)


def earth_centred(place: Any) -> Any:
    latitude, longitude, height = np.moveaxis(place, -1, 0)
    radius = normal_radius_m(latitude)
    across = (radius + height) * np.cos(latitude)
    axial = ((1 - ECCENTRICITY_SQUARED) * radius + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), axial], axis=-1)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(-1.4, 1.4), st.sampled_from([1.0, 1e3, 5e4]))
def test_the_local_frame_is_that_of_earth_centred_coordinates(seed: int, latitude: float, far: float) -> None:
    rng = np.random.default_rng(seed)
    origin = np.array([latitude, rng.uniform(-3, 3), rng.uniform(-100, 1000)])
    local = rng.normal(0, far, (5, 3))
    place = to_geodetic(local, origin)
    np.testing.assert_allclose(to_local(place, origin), local, rtol=1e-11, atol=1e-8)
    # The axes of the local frame as derivatives of earth-centred coordinates would be: closed form.
    (sn, sl), (cn, cl) = np.sin(origin[:2]), np.cos(origin[:2])
    axes = np.array([[-sl, cl, 0], [-sn * cl, -sn * sl, cn], [cn * cl, cn * sl, sn]])
    wanted = (earth_centred(place) - earth_centred(origin)) @ axes.T
    np.testing.assert_allclose(local, wanted, atol=5e-8)


def test_the_position_scale_is_the_derivative_of_the_local_frame() -> None:
    for part, step in enumerate((1e-6, 1e-6, 1.0)):
        shift = step * np.eye(3)[part]
        slope = (to_local(ORIGIN + shift, ORIGIN) - to_local(ORIGIN - shift, ORIGIN)) / (2 * step)
        north_east_down = slope[[1, 0, 2]] * [1, 1, -1]
        np.testing.assert_allclose(
            north_east_down, position_scale_m(ORIGIN)[part] * np.eye(3)[part], atol=1e-3
        )


@pytest.mark.parametrize("count", [1, 5, 10])
@pytest.mark.parametrize("biased", [False, True])
def test_readings_together_lead_where_they_lead_one_by_one(count: int, biased: bool) -> None:
    rng = np.random.default_rng(count)
    place, velocity, attitude = flight(3, 20.0)
    force, rate = readings(place, velocity, attitude, 0.01)
    force = force + 0.02 * rng.standard_normal(force.shape)
    rate = rate + 0.003 * rng.standard_normal(rate.shape)
    duration = np.full(force.shape[:2], 0.01) * rng.uniform(0.5, 1.5, force.shape[:2])
    # The last ones of one world are past its end.
    duration[1, -7:] = 0.0
    bias = rng.standard_normal((6, 3)) * np.repeat([0.1, 0.002], 3)[:, None] * biased
    lasting = np.ascontiguousarray(duration.T)
    made = error_state.increments(force.swapaxes(0, 1), rate.swapaxes(0, 1), lasting, biases=biased)
    unbiased = error_state.increments(
        force.swapaxes(0, 1) - bias[:3].T, rate.swapaxes(0, 1) - bias[3:].T, lasting
    )
    mover, single = (Strapdown(place[:, 0], velocity[:, 0], attitude[:, 0]) for _ in range(2))
    pushed = np.zeros((3, 3))
    for number, part in enumerate(together(made, count)):
        mover.look_around()
        single.look_around()
        way = mover.advance_together(part, bias if biased else None)
        pushed += way.force_advance
        for own in range(count):
            reading = number * count + own
            single.advance(unbiased.turn_and_advance[reading], lasting[reading])
            away = (way.geodetic[own] - single.geodetic) * position_scale_m(ORIGIN)[:, None]
            assert np.abs(away).max() < (2e-4 if biased else 1e-6)
            np.testing.assert_allclose(
                way.velocity_m_per_s[own], single.velocity_m_per_s, atol=2e-5 if biased else 1e-7
            )
            np.testing.assert_allclose(way.attitude[own], single.attitude, atol=1e-7 if biased else 1e-8)
    np.testing.assert_array_equal(mover.velocity_m_per_s, way.velocity_m_per_s[-1])
    np.testing.assert_array_equal(mover.attitude, way.attitude[-1])
    # What is left of the velocity's change is gravity, and the little of Coriolis.
    fallen = single.velocity_m_per_s.T - velocity[:, 0] - pushed.T
    gravity = gravity_m_per_s2(place[:, 0, 0], place[:, 0, 2]) * duration.sum(axis=1)
    np.testing.assert_allclose(fallen, gravity[:, None] * [0, 0, 1], atol=0.03)


def test_attitudes_of_known_angles() -> None:
    ahead = attitude_of([0.0, 0.0, np.pi / 2])[:, 0]
    np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-15)
    nose_up = attitude_of([0.0, 0.3, 0.0])[:, 0]
    np.testing.assert_allclose(nose_up, [np.cos(0.3), 0, -np.sin(0.3)])
    right_down = attitude_of([0.3, 0.0, 0.0])[:, 1]
    np.testing.assert_allclose(right_down, [0, np.cos(0.3), np.sin(0.3)])
    angles = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 3))
    np.testing.assert_allclose(roll_pitch_yaw(attitude_of(angles)), angles, atol=1e-12)


def test_worlds_do_not_touch_each_other() -> None:
    place, velocity, attitude = flight(3, 1.0)
    force, rate = readings(place, velocity, attitude, 0.01)
    start = {"geodetic": place[:, 0], "velocity_m_per_s": velocity[:, 0], "attitude": attitude[:, 0]}
    found = navigate(force, rate, 0.01, **start)
    alone = navigate(force[1], rate[1], 0.01, **{name: value[1] for name, value in start.items()})
    np.testing.assert_array_equal(found.geodetic[1], alone.geodetic)
    np.testing.assert_array_equal(found.attitude[1], alone.attitude)


@pytest.mark.parametrize(
    ("geodetic", "force", "message"),
    [
        ([np.pi / 2, 0.0, 0.0], np.zeros((2, 3)), "equator"),
        ([45.0, 0.0, 0.0], np.zeros((2, 3)), "radians"),
        ([np.nan, 0.0, 0.0], np.zeros((2, 3)), "not finite"),
        ([0.5, 0.0, 0.0], np.zeros((2, 2)), "three parts"),
        ([0.5, 0.0, 0.0], np.zeros((3, 3)), "one of each"),
    ],
)
def test_bad_input_is_refused(geodetic: Any, force: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        navigate(
            force,
            np.zeros((2, 3)),
            0.01,
            geodetic=geodetic,
            velocity_m_per_s=np.zeros(3),
            attitude=np.eye(3),
        )


def test_shapes_and_poles_are_refused_elsewhere() -> None:
    pole = np.tile([1.5707, 0.0, 0.0], (2, 1))
    with pytest.raises(InputError, match="equator"):
        readings(pole, np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), 0.01)
    with pytest.raises(InputError, match="equator"):
        travelled(pole[0], np.zeros((2, 3)), 0.01)
    with pytest.raises(InputError, match="do not fit"):
        readings(pole, np.zeros((2, 3)), np.eye(3), 0.01)
    with pytest.raises(InputError, match="two samples"):
        travelled(ORIGIN, np.zeros((1, 3)), 0.01)
    with pytest.raises(InputError, match="9 or 15"):
        error_dynamics(ORIGIN, np.zeros(3), np.eye(3), np.zeros(3), states=12)
    with pytest.raises(InputError, match="does not fit"):
        travelled(ORIGIN, np.zeros((3, 3)), [0.1, 0.1, 0.1])
