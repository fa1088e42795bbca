"""The RISS mechanisation against circles, lines, a differential equation solver, and itself cut up anew."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from algorithms.tracking.control_calibrated_riss import ControlCalibratedRiss
from algorithms.tracking.riss import Riss
from positioning.errors import InputError
from positioning.filters.plane import with_leading_axis
from positioning.inertial.earth import EARTH_RATE_RAD_PER_S, meridian_radius_m, normal_radius_m
from positioning.inertial.riss import Increments, Mechanised, increments, mechanise, move
from positioning.inertial.riss_readings import check_motion, downsample, first_rest, motion_missing, readings
from positioning.model import Array, Recording, Site, Track, Truth

LATITUDE_RAD = np.deg2rad(44.23)
EARTH_UP_RAD_PER_S = EARTH_RATE_RAD_PER_S * np.sin(LATITUDE_RAD)
STEP_S = 0.01


def recorded(epoch_s: Any, gyro: Any, speed: Any, step_s: float = STEP_S, **more: Any) -> Recording:
    """Return a stack of one, whose readings hold from 0 s on, each for ``step_s``."""
    count = max(np.size(gyro), np.size(speed))
    return Recording(
        time_s=np.asarray(epoch_s, dtype=float)[None],
        motion_time_s=((np.arange(count) + 0.5) * step_s)[None],
        gyro_rad_per_s=np.broadcast_to(np.asarray(gyro, dtype=float), count)[None].copy(),
        odometer_m_per_s=np.broadcast_to(np.asarray(speed, dtype=float), count)[None].copy(),
        **more,
    )


def poses(steps: Increments, start: Any = (0.0, 0.0, 0.0)) -> Array:
    """Add increments up as a filter does; [r, n, 3]."""
    state = np.tile(np.asarray(start, dtype=float), (len(steps.turn_rad), 1))
    found = []
    for epoch in range(steps.turn_rad.shape[1]):
        forward, left = steps.forward_m[:, epoch], steps.left_m[:, epoch]
        ahead, aside = np.cos(state[:, 2]), np.sin(state[:, 2])
        state = state + np.stack(
            [ahead * forward - aside * left, aside * forward + ahead * left, steps.turn_rad[:, epoch]],
            axis=-1,
        )
        found.append(state)
    return np.stack(found, axis=1)


def circle(time_s: Array, rate: float, speed: float) -> Array:
    """Return x, y and heading of a drive on a circle, [n, 3]."""
    turn = rate * time_s
    return np.stack([speed / rate * np.sin(turn), speed / rate * (1 - np.cos(turn)), turn], axis=-1)


def level(recording: Recording, **more: Any) -> Mechanised:
    """Mechanise the readings of a recording as they are."""
    read = readings(recording)
    known = {"azimuth_rad": 0.0, "latitude_rad": LATITUDE_RAD} | more
    return mechanise(read.edge_s, read.gyro_rad_per_s, read.speed_m_per_s, **known)


# Increments


@settings(max_examples=30, deadline=None)
@given(st.floats(0.01, 3.0), st.floats(0.05, 2.0), st.booleans(), st.integers(0, 1000))
def test_constant_turn_and_speed_make_a_circle(rate: float, speed: float, left: bool, seed: int) -> None:
    # Exact whatever the sampling and wherever the epochs are.
    rate = rate if left else -rate
    epoch_s = np.concatenate([[0.0], np.sort(np.random.default_rng(seed).uniform(0, 20, 6)), [20.0]])
    steps = increments(recorded(epoch_s, rate, speed * np.ones(20), step_s=1.0))
    np.testing.assert_allclose(poses(steps)[0], circle(epoch_s, rate, speed), atol=1e-9)
    np.testing.assert_allclose(steps.distance_m[0], np.diff(epoch_s, prepend=0.0) * speed, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_any_epochs_in_between_lead_to_the_same_end(seed: int, between: int) -> None:
    rng = np.random.default_rng(seed)
    gyro, speed = rng.normal(0, 1, 400), rng.uniform(-0.2, 1, 400)
    ends = np.array([0.0, 4.0])
    cut = np.unique(np.concatenate([ends, rng.uniform(0, 4, between), [1.0, 1.005]]))
    few, many = (increments(recorded(epochs, gyro, speed)) for epochs in (ends, cut))
    np.testing.assert_allclose(poses(many)[0, -1], poses(few)[0, -1], atol=1e-10)
    assert many.distance_m.sum() == pytest.approx(few.distance_m.sum())


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_way_back_ends_at_the_start(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gyro, speed = rng.normal(0, 2, 300), rng.uniform(0.1, 1, 300)
    there_and_back = recorded(
        [0.0, 3.0, 6.0], np.concatenate([gyro, -gyro[::-1]]), np.concatenate([speed, -speed[::-1]])
    )
    found = poses(increments(there_and_back))[0]
    assert np.linalg.norm(found[1]) > 0.01
    np.testing.assert_allclose(found[2], 0.0, atol=1e-10)


def test_increments_do_not_depend_on_the_heading() -> None:
    rng = np.random.default_rng(0)
    gyro, speed = rng.normal(0, 1, 900), rng.uniform(0.1, 1, 900)
    turned = increments(recorded([0.0, 3.0, 6.0, 9.0], np.concatenate([[90.0], gyro[1:]]), speed))
    plain = increments(recorded([0.0, 3.0, 6.0, 9.0], gyro, speed))
    for name in ("turn_rad", "forward_m", "left_m"):
        np.testing.assert_allclose(getattr(turned, name)[0, 2:], getattr(plain, name)[0, 2:], atol=1e-10)


def test_a_smooth_drive_is_integrated_to_second_order() -> None:
    def rates(time_s: Any) -> tuple[Any, Any]:
        return 0.8 * np.sin(1.3 * time_s) + 0.2, 0.7 + 0.3 * np.cos(0.9 * time_s)

    def slope(time_s: float, pose: Any) -> list[float]:
        turn, speed = rates(time_s)
        return [speed * np.cos(pose[2]), speed * np.sin(pose[2]), turn]

    end_s = 8.03
    exact = solve_ivp(slope, (0, end_s), [0, 0, 0], rtol=1e-12, atol=1e-12).y[:, -1]
    errors = []
    for step_s in (0.04, 0.02, 0.01):
        gyro, speed = rates((np.arange(round(10 / step_s)) + 0.5) * step_s)
        found = poses(increments(recorded([0.0, end_s], gyro, speed, step_s=step_s)))[0, -1]
        errors.append(np.abs(found - exact).max())
    assert errors[-1] < 2e-5
    assert errors[0] / errors[2] == pytest.approx(16, rel=0.3)


def test_uneven_times_are_integrated_to_second_order_as_well() -> None:
    rng = np.random.default_rng(3)
    errors = []
    for count in (200, 800):
        time_s = np.linspace(0, 8, count) + rng.uniform(-1.5, 1.5, count) / count
        recording = replace(
            recorded([0.5, 7.5], np.cos(time_s), 1.0),
            motion_time_s=time_s[None],
            odometer_m_per_s=np.ones((1, count)),
        )
        found = increments(recording).turn_rad[0, 1]
        errors.append(abs(found - (np.sin(7.5) - np.sin(0.5))))
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 4


def test_moving_tells_whether_the_odometer_moved_since_the_epoch_before() -> None:
    speed = np.concatenate([np.zeros(300), np.full(10, 0.5), np.zeros(190), np.full(100, 0.005)])
    steps = increments(recorded(np.arange(7.0), 0.0, speed))
    np.testing.assert_array_equal(steps.moving[0], [False, False, False, False, True, False, False])
    np.testing.assert_allclose(steps.distance_m[0], [0, 0, 0, 0, 0.05, 0, 0.005], atol=1e-12)
    assert steps.moving.dtype == bool
    begun = increments(recorded([3.0, 4.0, 5.0], 0.0, speed))
    np.testing.assert_array_equal(begun.moving[0], [True, True, False])
    # In reverse, too.
    assert increments(recorded([0.0, 1.0], 0.0, -np.ones(100))).moving.all()


# Rest


def resting_drive(bias: float, epoch_s: Any = (0.0, 5.0, 10.0, 20.0), **more: Any) -> Recording:
    """Return ten seconds of rest and ten of driving straight on, with a gyroscope off by ``bias``."""
    speed = np.repeat([0.0, 1.0], 1000)
    return recorded(epoch_s, bias, speed, **more)


def test_what_the_gyroscope_reads_at_rest_is_taken_off() -> None:
    rest = first_rest(resting_drive(0.05))
    assert rest.gyro_rad_per_s[0] == pytest.approx(0.05)
    assert rest.duration_s[0] == rest.end_s[0] == pytest.approx(10.0)
    steps = increments(resting_drive(0.05))
    np.testing.assert_allclose(steps.turn_rad, 0.0, atol=1e-12)
    np.testing.assert_allclose(steps.forward_m[0], [0, 0, 0, 10], atol=1e-9)


def test_a_bias_that_comes_with_the_motion_turns_the_track() -> None:
    gyro = 0.05 + np.repeat([0.0, 0.002], 1000)
    found = poses(increments(replace(resting_drive(0.0), gyro_rad_per_s=gyro[None])))[0, -1]
    np.testing.assert_allclose(found, circle(np.array([10.0]), 0.002, 1.0)[0], atol=1e-9)
    assert found[2] == pytest.approx(0.02)


@pytest.mark.parametrize("still_s", [0.0, 0.9])
def test_without_a_rest_nothing_is_taken_off(still_s: float) -> None:
    speed = np.where(np.arange(500) < still_s / STEP_S, 0.0, 1.0)
    recording = recorded([0.0, 5.0], 0.05, speed)
    rest = first_rest(recording)
    assert rest.gyro_rad_per_s[0] == rest.duration_s[0] == 0
    assert rest.end_s[0] == -np.inf
    assert increments(recording).turn_rad[0, 1] == pytest.approx(0.25)


def test_a_recording_that_never_moves_is_all_rest() -> None:
    recording = recorded([0.0, 5.0], np.random.default_rng(1).normal(0, 1, 500), 0.0)
    assert first_rest(recording).duration_s[0] == pytest.approx(5.0)
    assert increments(recording).turn_rad[0, 1] == pytest.approx(0.0, abs=1e-12)


def test_later_rests_do_not_calibrate() -> None:
    gyro = np.repeat([0.01, 0.01, 0.5], 500)
    recording = recorded([0.0, 15.0], gyro, np.repeat([0.0, 1.0, 0.0], 500))
    assert first_rest(recording).gyro_rad_per_s[0] == pytest.approx(0.01)


def test_drop_outs_in_the_rest_neither_end_it_nor_count() -> None:
    recording = resting_drive(0.05)
    odometer, gyro = recording.odometer_m_per_s.copy(), recording.gyro_rad_per_s.copy()  # type: ignore[union-attr]
    odometer[0, :200], gyro[0, :200] = np.nan, 7.0
    rest = first_rest(replace(recording, odometer_m_per_s=odometer, gyro_rad_per_s=gyro))
    assert rest.gyro_rad_per_s[0] == pytest.approx(0.05)
    assert rest.duration_s[0] == pytest.approx(10.0)


# Drop-outs and averaging


def test_drop_outs_are_bridged_by_the_last_speed() -> None:
    speed = np.repeat([0.5, np.nan, 1.0, np.nan], 100)
    steps = increments(recorded(np.arange(5.0), 0.0, speed))
    np.testing.assert_allclose(steps.forward_m[0], [0, 0.5, 0.5, 1.0, 1.0], atol=1e-9)
    # None before the first: it stands.
    steps = increments(recorded([0.0, 1.0, 2.0], 0.0, np.repeat([np.nan, 1.0], 100)))
    np.testing.assert_allclose(steps.forward_m[0], [0, 0, 1.0], atol=1e-9)


def test_an_odometer_that_never_reads_is_no_motion() -> None:
    silent = recorded([0.0, 1.0], 0.0, np.full(100, np.nan))
    assert motion_missing(silent) == motion_missing(silent.at(0)) == "the odometer has no reading"
    with pytest.raises(InputError, match=r"no reading\. Give odometer_m_per_s"):
        increments(silent)
    pair = {
        name: np.repeat(getattr(silent, name), 2, axis=0)
        for name in ("time_s", "motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    }
    pair["odometer_m_per_s"][0] = 1.0
    assert "no reading" in motion_missing(Recording(**pair))


@pytest.mark.parametrize("begin", [0, 150, 300])
def test_drop_outs_are_bridged_up_to_a_limit(begin: int) -> None:
    speed = np.ones(500)
    speed[begin : begin + 200] = np.nan
    bridged = recorded([0.0, 5.0], 0.0, speed)
    assert motion_missing(bridged) == ""
    assert increments(bridged).forward_m[0, 1] == pytest.approx(3.0 if begin == 0 else 5.0)
    speed = np.ones(500)
    speed[max(begin - 1, 0) : begin + 201] = np.nan
    refused = recorded([0.0, 5.0], 0.0, speed)
    assert "dropped out for 2.0" in motion_missing(refused)
    with pytest.raises(InputError, match="more than 2 s"):
        increments(refused)


def test_a_single_recording_is_refused_with_what_makes_a_stack_of_it() -> None:
    stack = resting_drive(0.0)
    single = stack.at(0)
    for function in (increments, first_rest, downsample):
        with pytest.raises(InputError, match="with_leading_axis"):
            function(single)
    np.testing.assert_array_equal(increments(with_leading_axis(single)).turn_rad, increments(stack).turn_rad)


def test_edges_that_decrease_are_refused() -> None:
    for edges in ([0.0, 2.0, 1.0], [0.0, np.nan, 2.0]):
        with pytest.raises(InputError, match=r"edge_s\[1|edge_s\[0"):
            mechanise(edges, [0.1, 0.1], [1.0, 1.0], azimuth_rad=0.0, latitude_rad=0.5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([2, 3, 5, 10]))
def test_averaging_keeps_the_angle(seed: int, factor: int) -> None:
    rng = np.random.default_rng(seed)
    recording = recorded([0.0, 3.0, 6.0], rng.normal(0, 1, 600), rng.uniform(0.1, 1, 600))
    slower = downsample(recording, factor=factor)
    assert slower.gyro_rad_per_s is not None
    assert slower.gyro_rad_per_s.shape == (1, 600 // factor)
    np.testing.assert_allclose(increments(slower).turn_rad, increments(recording).turn_rad, atol=1e-12)
    np.testing.assert_allclose(increments(slower).distance_m, increments(recording).distance_m, atol=1e-12)


def test_averaging_is_over_neighbours() -> None:
    recording = recorded([0.0], [1.0, 3.0, 5.0, 9.0, 70.0], [1.0, np.nan, np.nan, np.nan, 1.0], step_s=0.5)
    slower = downsample(recording)
    np.testing.assert_array_equal(slower.motion_time_s, [[0.5, 1.5]])
    np.testing.assert_array_equal(slower.gyro_rad_per_s, [[2.0, 7.0]])
    np.testing.assert_array_equal(slower.odometer_m_per_s, [[1.0, np.nan]])
    assert downsample(recording, factor=1) is recording


def test_averaging_halves_the_variance_of_white_noise() -> None:
    recording = recorded([0.0], np.random.default_rng(5).normal(0, 1, 20_000), 0.0)
    slower = downsample(recording)
    assert slower.gyro_rad_per_s is not None
    assert slower.gyro_rad_per_s.var() == pytest.approx(0.5, rel=0.04)


def test_recordings_of_different_length_share_a_stack() -> None:
    rng = np.random.default_rng(2)
    alone = [
        recorded(np.arange(epochs), rng.normal(0.1, 1, count), np.where(np.arange(count) < 150, 0, 1.0))
        for epochs, count in ((7, 601), (4, 333), (6, 520))
    ]

    def padded(name: str) -> Array:
        rows = [getattr(one, name)[0] for one in alone]
        longest = max(map(len, rows))
        return np.stack([np.append(row, np.full(longest - len(row), np.nan)) for row in rows])

    names = ("time_s", "motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    stack = Recording(**{name: padded(name) for name in names})
    for factor in (1, 2):
        together = increments(downsample(stack, factor=factor))
        for row, one in enumerate(alone):
            single, count = increments(downsample(one, factor=factor)), one.time_s.shape[1]
            for name in Increments._fields:
                np.testing.assert_array_equal(getattr(together, name)[row, :count], getattr(single, name)[0])
                assert not getattr(together, name)[row, count:].any()


# Mechanisation


def test_straight_to_the_north_and_to_the_east() -> None:
    for azimuth, expected in (
        (0.0, (0, 20)),
        (np.pi / 2, (20, 0)),
        (np.pi, (0, -20)),
        (-np.pi / 2, (-20, 0)),
    ):
        # A gyroscope that reads the earth rate and no more.
        way = level(recorded([0.0, 20.0], EARTH_UP_RAD_PER_S, np.ones(2000)), azimuth_rad=azimuth)
        np.testing.assert_allclose([way.east_m[0, -1], way.north_m[0, -1]], expected, atol=2e-4)
        north, east = (expected[1], expected[0])
        latitude = north / meridian_radius_m(LATITUDE_RAD)
        longitude = east / normal_radius_m(LATITUDE_RAD) / np.cos(LATITUDE_RAD)
        np.testing.assert_allclose(way.latitude_rad[0, -1] - LATITUDE_RAD, latitude, atol=2e-11)
        np.testing.assert_allclose(way.longitude_rad[0, -1], longitude, atol=3e-11)


def test_the_gyroscope_counts_to_the_left_and_azimuth_to_the_right() -> None:
    # Eq. 1 with its sign: to the left from north is to the west.
    way = level(recorded([0.0, 10.0], 0.1, np.ones(1000)), earth_rate_rad_per_s=0.0)
    assert way.azimuth_rad[0, -1] == pytest.approx(-1.0, abs=1e-5)
    x, y, _ = circle(np.array([10.0]), 0.1, 1.0)[0]
    np.testing.assert_allclose([way.north_m[0, -1], way.east_m[0, -1]], [x, -y], atol=1e-4)


def test_coarse_readings_are_arcs_in_the_mechanisation_too() -> None:
    way = level(recorded([0.0, 10.0], 0.6, np.ones(10), step_s=1.0), earth_rate_rad_per_s=0.0)
    x, y, _ = circle(np.array([10.0]), 0.6, 1.0)[0]
    np.testing.assert_allclose([way.north_m[0, -1], way.east_m[0, -1]], [x, -y], atol=1e-5)


def test_an_earth_that_turns_below() -> None:
    # What stands still against the stars turns to the right over the northern hemisphere.
    for latitude in (LATITUDE_RAD, -LATITUDE_RAD):
        way = level(recorded([0.0, 600.0], 0.0, np.zeros(600), step_s=1.0), latitude_rad=latitude)
        expected = 600 * EARTH_RATE_RAD_PER_S * np.sin(latitude)
        assert way.azimuth_rad[0, -1] == pytest.approx(expected, rel=1e-12)
        assert way.east_m[0, -1] == way.north_m[0, -1] == 0


def test_without_turning_a_vehicle_follows_a_geodesic() -> None:
    # Clairaut: the distance from the axis times the sine of the azimuth stays.
    way = level(
        recorded([0.0, 2000.0], 0.0, np.ones(2000), step_s=1.0), azimuth_rad=1.2, earth_rate_rad_per_s=0.0
    )
    constant = normal_radius_m(way.latitude_rad) * np.cos(way.latitude_rad) * np.sin(way.azimuth_rad)
    assert np.ptp(way.azimuth_rad) > 2e-4
    # Two passes leave less than the square of distance over radius of the earth.
    np.testing.assert_allclose(constant / constant[0, 0], 1.0, rtol=1e-8)


def test_the_equations_of_the_paper_by_a_solver() -> None:
    altitude_m = 100.0

    def rates(time_s: Any) -> tuple[Any, Any]:
        return 0.5 * np.sin(0.7 * time_s), 0.6 + 0.4 * np.sin(0.4 * time_s)

    def slope(time_s: float, state: Any) -> list[float]:
        azimuth, latitude, _ = state
        gyro, speed = rates(time_s)
        east, north = speed * np.sin(azimuth), speed * np.cos(azimuth)
        normal, meridian = (float(radius(latitude)) for radius in (normal_radius_m, meridian_radius_m))
        transport = east * np.tan(latitude) / (normal + altitude_m)
        return [
            -(gyro - EARTH_RATE_RAD_PER_S * np.sin(latitude) - transport),
            north / (meridian + altitude_m),
            east / ((normal + altitude_m) * np.cos(latitude)),
        ]

    start = [0.3, LATITUDE_RAD, -1.3]
    exact = solve_ivp(slope, (0, 40), start, rtol=1e-13, atol=1e-15).y[:, -1]
    gyro, speed = rates((np.arange(16_000) + 0.5) * 0.0025)
    way = level(
        recorded([0.0, 40.0], gyro, speed, step_s=0.0025),
        azimuth_rad=0.3,
        longitude_rad=-1.3,
        altitude_m=altitude_m,
    )
    assert way.azimuth_rad[0, -1] == pytest.approx(exact[0], abs=3e-7)
    # One metre is 1.6e-7 rad.
    np.testing.assert_allclose([way.latitude_rad[0, -1], way.longitude_rad[0, -1]], exact[1:], atol=1e-12)
    normal, meridian = (radius(exact[1]) + altitude_m for radius in (normal_radius_m, meridian_radius_m))
    expected = (exact[2] + 1.3) * normal * np.cos(exact[1]), (exact[1] - LATITUDE_RAD) * meridian
    np.testing.assert_allclose([way.east_m[0, -1], way.north_m[0, -1]], expected, atol=4e-6)


def test_on_the_plane_it_equals_the_increments() -> None:
    rng = np.random.default_rng(9)
    recording = recorded([0.0, 10.0, 30.0], rng.normal(0, 1, 3000), rng.uniform(0.2, 1, 3000))
    read = readings(recording)
    heading = 0.4
    way = level(recording, azimuth_rad=np.pi / 2 - heading, earth_rate_rad_per_s=0.0)
    expected = poses(increments(recording), (0, 0, heading))[0]
    at = read.epoch[0]
    found = np.stack([way.east_m[0, at], way.north_m[0, at], np.pi / 2 - way.azimuth_rad[0, at]], axis=-1)
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_leading_axes_of_the_mechanisation() -> None:
    rng = np.random.default_rng(4)
    edge_s = np.arange(51.0)
    gyro, speed = rng.normal(0, 0.1, (3, 2, 50)), rng.uniform(0, 1, (3, 2, 50))
    azimuth, latitude = rng.uniform(-3, 3, (3, 2)), rng.uniform(-1, 1, (3, 2))
    edges = np.broadcast_to(edge_s, (3, 2, 51))
    together = mechanise(edges, gyro, speed, azimuth_rad=azimuth, latitude_rad=latitude)
    for row in np.ndindex(3, 2):
        alone = mechanise(edge_s, gyro[row], speed[row], azimuth_rad=azimuth[row], latitude_rad=latitude[row])
        for one, many in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, many[row])


def test_readings_that_do_not_fit_their_edges_are_refused() -> None:
    with pytest.raises(InputError, match="edge"):
        mechanise(np.arange(5.0), np.zeros(5), np.zeros(5), azimuth_rad=0.0, latitude_rad=0.0)


# Derivatives


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([3, 5]))
def test_derivatives_equal_finite_differences(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    state = rng.normal(size=(2, states))
    state[:, 4:] = rng.uniform(0.7, 1.3, (2, max(states - 4, 0)))
    turn, forward, left, seconds = rng.normal(size=(4, 2))
    seconds = np.abs(seconds)
    found, step = move(state, turn, forward, left, seconds), 1e-6
    for part in range(states):
        high, low = state.copy(), state.copy()
        high[:, part] += step
        low[:, part] -= step
        slope = (
            move(high, turn, forward, left, seconds).state - move(low, turn, forward, left, seconds).state
        ) / 2e-6
        np.testing.assert_allclose(found.by_state[..., part], slope, atol=1e-7)

    def noisy(turned: float, longer: float) -> Array:
        # The error of a turn bends the step: half of it is there in the middle.
        ahead, aside = np.cos(turned / 2), np.sin(turned / 2)
        x, y = (1 + longer) * forward, (1 + longer) * left
        return move(state, turn + turned, ahead * x - aside * y, aside * x + ahead * y, seconds).state

    for part, unit in enumerate(np.eye(2) * step):
        slope = (noisy(*unit) - noisy(*-unit)) / 2e-6
        np.testing.assert_allclose(found.by_noise[..., part], slope, atol=1e-7)


def test_a_step_without_errors_is_the_increment() -> None:
    moved = move(np.array([[1.0, 2.0, np.pi / 2, 0.0, 1.0]]), [0.3], [2.0], [0.5], [1.0])
    np.testing.assert_allclose(moved.state, [[0.5, 4.0, np.pi / 2 + 0.3, 0.0, 1.0]])


# Bad input


def broken(**changes: Any) -> Recording:
    """Return a recording of which something is wrong."""
    return replace(resting_drive(0.0), **changes)


def test_bad_times_are_refused() -> None:
    plain = resting_drive(0.0)
    assert plain.motion_time_s is not None
    for number, value, message in (
        (7, plain.motion_time_s[0, 6], "does not increase"),
        (7, 0.0, "does not increase"),
        (7, np.nan, "missing"),
        (0, np.nan, "missing"),
        (7, np.inf, "infinite"),
    ):
        time_s = plain.motion_time_s.copy()
        time_s[0, number] = value
        for function in (increments, downsample, first_rest):
            with pytest.raises(InputError, match=message) as caught:
                function(broken(motion_time_s=time_s))
            assert "motion_time_s" in caught.value.thing
    for times, message in (
        ([0.0, 1.0, 1.0], "does not increase"),
        ([0.0, 2.0, 1.0], "does not increase"),
        ([0.0, np.nan, 1.0], "missing"),
        ([0.0, np.inf], "infinite"),
        ([np.nan, np.nan], "at least 1"),
        ([0.0, 30.0], "outside the readings"),
        ([-3.0, 3.0], "outside the readings"),
    ):
        with pytest.raises(InputError, match=message):
            increments(broken(time_s=np.array([times])))


def test_bad_readings_are_refused() -> None:
    plain = resting_drive(0.0)
    for name, value in (("gyro_rad_per_s", np.nan), ("gyro_rad_per_s", np.inf), ("odometer_m_per_s", np.inf)):
        values = getattr(plain, name).copy()
        values[0, 3] = value
        with pytest.raises(InputError, match=rf"{name}\[0, 3\]"):
            increments(broken(**{name: values}))
    for name in ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s"):
        with pytest.raises(InputError, match="no readings of the motion"):
            check_motion(broken(**{name: None}))
    with pytest.raises(InputError, match="its shape is"):
        increments(broken(gyro_rad_per_s=np.zeros((1, 7))))
    with pytest.raises(InputError, match="its shape is"):
        increments(broken(time_s=np.zeros((2, 3))))
    single = {
        name: getattr(plain, name)[:, :1] for name in ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
    }
    with pytest.raises(InputError, match="at least 2"):
        increments(broken(**single))


def test_senseless_averages_are_refused() -> None:
    for factor in (0, -1, 1.5):
        with pytest.raises(InputError, match="whole number"):
            downsample(resting_drive(0.0), factor=factor)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="two groups"):
        downsample(resting_drive(0.0), factor=1001)


def test_the_first_and_last_reading_are_held_a_little() -> None:
    steps = increments(recorded([-0.5, 0.0, 5.0, 5.5], 0.1, np.ones(500)))
    np.testing.assert_allclose(steps.turn_rad[0], [0, 0.05, 0.5, 0.05], atol=1e-12)


# Dead reckoning


SITE = Site(corner_m=np.array([[[-50.0, -50.0], [50.0, 50.0]]]))
START = {"start_position_m": np.array([[3.0, -2.0]]), "start_heading_rad": np.array([0.6])}


def dead_reckoned(recording: Recording, algorithm: Any = None) -> Track:
    """Track a stack of one."""
    tracker = Riss() if algorithm is None else algorithm
    return tracker.track_stack(recording, None, SITE, [np.random.default_rng(0)])  # type: ignore[no-any-return]


def test_riss_adds_the_way_to_the_noted_start() -> None:
    found = dead_reckoned(resting_drive(0.05 + EARTH_UP_RAD_PER_S, **START))
    expected = np.array([[0, 0], [0, 0], [0, 0], [np.cos(0.6), np.sin(0.6)]]) * 10 + [3.0, -2.0]
    np.testing.assert_allclose(found.position_m[0], expected, atol=1e-4)
    np.testing.assert_allclose(found.extra["heading_rad"], 0.6, atol=1e-5)


def test_the_earth_rate_is_taken_off_once() -> None:
    # At rest with the bias; without a rest by eq. 1.
    moving = recorded([0.0, 600.0], EARTH_UP_RAD_PER_S, np.ones(600), step_s=1.0, **START)
    found = dead_reckoned(moving, Riss(downsampling=1)).extra["heading_rad"][0, -1]
    assert found == pytest.approx(0.6, abs=2e-4)
    rested = recorded([0.0, 600.0], EARTH_UP_RAD_PER_S, np.repeat([0.0, 1.0], 300), step_s=1.0, **START)
    found = dead_reckoned(rested, Riss(downsampling=1)).extra["heading_rad"][0, -1]
    assert found == pytest.approx(0.6, abs=2e-4)
    # Taken off twice, it would be this far off.
    assert 300 * EARTH_UP_RAD_PER_S > 0.015


def test_dead_reckoning_begins_at_the_first_epoch() -> None:
    found = dead_reckoned(resting_drive(0.0, epoch_s=[15.0, 16.0, 20.0], **START))
    driven = np.linalg.norm(found.position_m[0] - [3.0, -2.0], axis=-1)
    np.testing.assert_allclose(driven, [0.0, 1.0, 5.0], atol=1e-4)


@pytest.mark.parametrize(("noise", "bias", "scale"), [(0.003, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.07)])
def test_the_covariance_of_a_straight_drive(noise: float, bias: float, scale: float) -> None:
    # Over t seconds at v: random walk q gives q^2 v^2 t^3 / 3 aside, a bias b gives (b v t^2 / 2)^2 aside,
    # and a scale s gives (s v t)^2 ahead.
    time_s = np.linspace(0, 60, 121)
    recording = recorded(
        time_s,
        0.0,
        np.ones(600),
        step_s=0.1,
        start_heading_rad=np.array([0.0]),
        start_position_m=np.zeros((1, 2)),
    )
    tracker = Riss(
        turn_noise_rad_per_sqrt_s=max(noise, 1e-9), bias_sigma_rad_per_s=max(bias, 1e-9), scale_sigma=scale
    )
    found = dead_reckoned(recording, tracker).covariance_m2[0]
    np.testing.assert_allclose(found[:, 0, 0], (scale * time_s) ** 2, atol=1e-5)
    aside = noise**2 * time_s**3 / 3 + (bias * time_s**2 / 2) ** 2
    np.testing.assert_allclose(found[:, 1, 1], aside, rtol=1e-3, atol=1e-5)


def test_a_rest_makes_the_bias_surer() -> None:
    noted = {"start_heading_rad": np.array([0.0]), "start_position_m": np.zeros((1, 2))}
    rested = dead_reckoned(resting_drive(0.0, np.linspace(0, 20, 201), **noted))
    straight = dead_reckoned(recorded(np.linspace(0, 10, 101), 0.0, np.ones(1000), **noted))
    # The mean over ten seconds is sure to q / sqrt(10 s), and so are ten seconds of driving.
    aside = [found.covariance_m2[0, -1, 1, 1] for found in (rested, straight)]
    assert aside[0] == pytest.approx(0.00055**2 * (10**3 / 3 + 10**3 / 4), rel=0.02)
    assert aside[1] == pytest.approx((0.052 * 50) ** 2, rel=0.02)


def simulated(seed: int, runs: int = 3) -> tuple[Recording, Truth]:
    """Return drives with biases and scales, and what is true of them."""
    rng = np.random.default_rng(seed)
    count, rest = 6000, 1500
    time_s = (np.arange(count) + 0.5) * STEP_S
    speed = np.where(np.arange(count) < rest, 0.0, 0.8)
    rate = np.where(speed > 0, 0.3 * np.sin(0.5 * time_s), 0.0)
    scale, bias = rng.uniform(0.9, 1.1, runs), rng.choice([-0.002, 0.002], runs)
    gyro = rate + rng.normal(0, 0.05, (runs, 1)) + np.where(speed > 0, bias[:, None], 0.0)
    epoch_s = np.tile(np.arange(0.0, 60.0, 0.7), (runs, 1))
    start_m, heading = rng.uniform(-5, 5, (runs, 2)), rng.uniform(-3, 3, runs)
    exact = recorded(epoch_s[0], rate, speed)
    path = np.concatenate([poses(increments(exact), (*start_m[r], heading[r])) for r in range(runs)])
    recording = Recording(
        time_s=epoch_s,
        motion_time_s=np.tile(time_s, (runs, 1)),
        gyro_rad_per_s=gyro,
        odometer_m_per_s=speed * scale[:, None],
        start_position_m=start_m,
        start_heading_rad=heading,
    )
    truth = Truth(
        position_m=path[..., :2],
        path_m=path[..., :2],
        heading_rad=path[..., 2],
        gyro_bias_rad_per_s=bias,
        odometer_scale=scale,
    )
    return recording, truth


SITES = Site(corner_m=np.tile(SITE.corner_m, (3, 1, 1)))


def test_perfect_calibration_leaves_no_error_without_noise() -> None:
    recording, truth = simulated(1)
    tracker = ControlCalibratedRiss(truth=truth)
    assert tracker.skip(recording, None, SITES) == ""
    calibrated = tracker.track_stack(recording, None, SITES, []).position_m
    # Averaged to 50 Hz, and a transport rate that the plane does not have.
    np.testing.assert_allclose(calibrated, truth.path_m, atol=2e-3)
    error_m = np.linalg.norm(
        Riss().track_stack(recording, None, SITES, []).position_m - truth.path_m, axis=-1
    )
    assert (error_m.max(axis=1) > 0.5).all()


def test_the_control_starts_from_the_truth_and_needs_it() -> None:
    recording, truth = simulated(2)
    nothing_noted = replace(recording, start_position_m=None, start_heading_rad=None)
    tracker = ControlCalibratedRiss(truth=truth)
    first, second = (tracker.track_stack(r, None, SITES, []).position_m for r in (recording, nothing_noted))
    np.testing.assert_array_equal(first, second)
    for missing in (None, replace(truth, odometer_scale=None), replace(truth, path_m=None)):
        assert "synthetic" in ControlCalibratedRiss(truth=missing).skip(recording, None, SITES)
        with pytest.raises(InputError, match="synthetic"):
            ControlCalibratedRiss(truth=missing).track_stack(recording, None, SITES, [])
    assert "readings" in tracker.skip(replace(recording, gyro_rad_per_s=None), None, SITES)
    with pytest.raises(InputError, match="truth"):
        ControlCalibratedRiss(truth=truth.at(slice(0, 2))).track_stack(recording, None, SITES, [])  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["riss", "control"])
def test_a_stack_gives_what_each_recording_gives(name: str) -> None:
    recording, truth = simulated(3)
    time_s = recording.time_s.copy()
    time_s[1, 50:] = np.nan
    recording = replace(recording, time_s=time_s)
    kept = replace(recording, **{k: v.copy() for k, v in vars(recording).items() if v is not None})
    tracker: Any = Riss() if name == "riss" else ControlCalibratedRiss(truth=truth)
    together = tracker.track_stack(recording, None, SITES, [])
    assert np.isnan(together.position_m[1, 50:]).all()
    assert np.isnan(together.covariance_m2[1, 50:]).all()
    for row, length in enumerate((86, 50, 86)):
        parts = {key: values for key, values in vars(truth).items() if values is not None}
        own = Truth(**{k: v[row, :length] if np.ndim(v) > 1 else v[row] for k, v in parts.items()})
        one: Any = Riss() if name == "riss" else ControlCalibratedRiss(truth=own)
        alone = one.track(recording.at(row).until(length), None, SITES.at(row), np.random.default_rng(0))
        np.testing.assert_array_equal(alone.position_m, together.position_m[row, :length])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[row, :length])
        assert np.isfinite(alone.position_m).all()
        np.testing.assert_array_equal(alone.covariance_m2, np.swapaxes(alone.covariance_m2, -1, -2))
        assert np.linalg.eigvalsh(alone.covariance_m2).min() > 0
        np.testing.assert_array_equal(alone.extra["heading_rad"], together.extra["heading_rad"][row, :length])
    for field, values in vars(kept).items():
        if values is not None:
            np.testing.assert_array_equal(values, getattr(recording, field))


def test_riss_says_what_it_lacks() -> None:
    recording, _ = simulated(4)
    for missing, reason in (
        ("start_position_m", "start place"),
        ("start_heading_rad", "start heading"),
        ("odometer_m_per_s", "odometer"),
    ):
        lacking = replace(recording, **{missing: None})
        assert reason in Riss().skip(lacking, None, SITES)
        with pytest.raises(InputError, match=reason):
            Riss().track_stack(lacking, None, SITES, [])
    assert Riss().skip(recording, None, SITES) == ""
    for setting in ({"latitude_deg": 90.0}, {"downsampling": 0}, {"scale_sigma": -1.0}):
        with pytest.raises(InputError, match=next(iter(setting))):
            Riss(**setting).track_stack(recording, None, SITES, [])  # type: ignore[arg-type]
