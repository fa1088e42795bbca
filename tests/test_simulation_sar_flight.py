"""The worlds of the flight study: course, readings, GPS, landmarks, fixes, what is paired and hidden."""

from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from scipy.stats import kstest, norm

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.inertial.geodetic import attitude_of, position_scale_m, to_local
from positioning.inertial.geodetic_strapdown import navigate
from positioning.model import Recording, Site
from positioning.seeds import stream
from positioning.simulation.flight import Lap
from positioning.simulation.sar_flight import simulate

ROOT = Path(__file__).parents[1]
PAPER = yaml.safe_load((ROOT / "data/papers/robo_sar.yaml").read_text("utf-8"))
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["sar_flight"].items()}
WORLDS = 16
FORCE, RATE = "recording.specific_force_m_per_s2", "recording.angular_rate_rad_per_s"
START = {"recording.start_geodetic", "recording.start_velocity_m_per_s", "recording.start_attitude_rad"}
GPS = {"recording.gps_geodetic", "recording.gps_velocity_m_per_s"}
SIGHTINGS = {"recording.sighting_time_s", "recording.sighting_landmark", "recording.sighting"}
QUIET = {name: 0.0 for name in SETTINGS if name.startswith(("accelerometer_", "gyro_", "start_"))}
QUIET |= {name: [0.0] * 3 for name in ("gps_white_m", "gps_correlated_m", "gps_velocity_m_per_s")}
NO_SIGHTINGS = {"sighting_rate_hz": 0.1, "landmarks": 1}
SHORT = {"duration_s": 20.0, "outage_begin_s": 0.0, "outage_s": 0.0}


def rngs(seeds):
    return [stream(seed, "sar_flight") for seed in seeds]


def drawn(seeds=range(2), **changes):
    return simulate({**SETTINGS, **changes}, rngs(seeds))


def together(worlds):
    return {**worlds.observed, **worlds.truth}


def changed(first, second):
    first, second = together(first), together(second)
    assert first.keys() == second.keys()
    return {
        name
        for name in first
        if first[name].shape != second[name].shape
        or not np.array_equal(first[name], second[name], equal_nan=True)
    }


@pytest.fixture(scope="module")
def worlds():
    return drawn(range(WORLDS))


@pytest.fixture(scope="module")
def exact():
    return drawn(range(WORLDS), noise=0.0)


def local_ned(geodetic, origin):
    return to_local(geodetic, origin)[..., [1, 0, 2]] * [1, 1, -1]


def gps_errors(worlds, exact):
    """North, east, down, [world, g, 3], metres."""
    found, true = (each.observed["recording.gps_geodetic"] for each in (worlds, exact))
    return (found - true) * position_scale_m(true)


def test_the_settings_fit_the_schema_of_papers():
    schema = yaml.safe_load((ROOT / "workflow/schemas/paper.schema.yaml").read_text("utf-8"))
    jsonschema.validate(PAPER, schema)


def test_shapes_and_types(worlds, exact):
    assert {name: values.shape[1:] for name, values in worlds.observed.items()} == {
        "site.corner_m": (2, 2),
        "site.wall_m": (8, 2, 2),
        "site.origin_geodetic": (3,),
        "recording.time_s": (641,),
        "recording.imu_time_s": (32_000,),
        FORCE: (32_000, 3),
        RATE: (32_000, 3),
        "recording.gps_time_s": (320,),
        "recording.gps_geodetic": (320, 3),
        "recording.gps_velocity_m_per_s": (320, 3),
        "recording.gps_lever_arm_m": (3,),
        "recording.gps_outage_s": (2,),
        "recording.start_geodetic": (3,),
        "recording.start_velocity_m_per_s": (3,),
        "recording.start_attitude_rad": (3,),
        "recording.sighting_time_s": (12_800,),
        "recording.sighting_landmark": (12_800,),
        "recording.sighting": (12_800, 3),
        "recording.sighting_lever_arm_m": (3,),
        "recording.fix_m": (641, 1, 2),
    }
    assert {name: values.shape[1:] for name, values in worlds.truth.items()} == {
        "truth.position_m": (641, 2),
        "truth.path_m": (641, 2),
        "truth.height_m": (641,),
        "truth.velocity_m_per_s": (641, 3),
        "truth.attitude_rad": (641, 3),
        "truth.landmark_m": (36, 3),
    }
    for single, each in ((np.float32, worlds), (np.float64, exact)):
        for name, values in together(each).items():
            assert len(values) == WORLDS
            kind = {FORCE: single, RATE: single, "recording.sighting_landmark": np.int64}.get(name, float)
            assert values.dtype == kind, name
    assert Site.from_arrays(worlds.observed).origin_geodetic.shape == (WORLDS, 3)
    assert Recording.from_arrays(worlds.observed).fix_m.shape == (WORLDS, 641, 1, 2)


@settings(max_examples=15, deadline=None)
@given(
    sides=st.tuples(st.floats(70, 200), st.floats(70, 200)),
    radius=st.floats(2, 15),
    at=st.floats(0, 1),
)
def test_a_lap_closes_and_is_as_smooth_as_it_says(sides, radius, at):
    lap = Lap(side_m=np.array(sides), corner_radius_m=radius)
    length = lap.length_m
    along = np.linspace(0, length, 20_001)
    heading, curvature = lap.heading_rad(along), lap.curvature_per_m(along)
    np.testing.assert_allclose([heading[0], heading[-1]], [0, 2 * np.pi], atol=1e-12)
    assert curvature.min() >= 0
    assert curvature.max() == pytest.approx(1 / radius, rel=1e-2)
    np.testing.assert_allclose(np.gradient(heading, along)[1:-1], curvature[1:-1], atol=2e-3 / radius)
    # Continuous to its derivative: no step of the curvature, nor of what it changes by.
    step = along[1]
    assert np.abs(np.diff(curvature)).max() < 1.01 * step / radius**2
    assert np.abs(np.diff(curvature, 2)).max() < 2.02 * step**2 / radius**3
    np.testing.assert_allclose(lap.place_m(length), [0, -sides[1] / 2], atol=1e-3)
    np.testing.assert_allclose(lap.place_m(0.5 * length), [0, sides[1] / 2], atol=1e-3)
    np.testing.assert_allclose(
        lap.heading_rad([at * length + length]) - lap.heading_rad([at * length]), 2 * np.pi
    )
    # The corners touch the sides of the rectangle, and stay within.
    place = np.array([lap.place_m(share * length) for share in np.linspace(0, 1, 60)])
    assert (np.abs(place) <= np.array(sides) / 2 + 1e-3).all()
    np.testing.assert_allclose(np.abs(place).max(axis=0), np.array(sides) / 2, atol=1e-3)


def test_a_place_on_the_lap_is_the_integral_of_its_direction():
    lap = Lap(side_m=np.array([120.0, 82.0]), corner_radius_m=8.0)
    for end in (30.0, 55.0, 120.0):
        marks = np.linspace(0, end, 40)[1:-1]
        way = [
            quad(lambda s, f=f: f(lap.heading_rad([s])[0]), 0, end, points=marks, limit=200)[0]
            for f in (np.cos, np.sin)
        ]
        np.testing.assert_allclose(lap.place_m(end) - lap.place_m(0.0), way, atol=1e-5)


def test_laps_of_about_eighty_seconds_at_the_speeds_and_the_height_of_the_settings(worlds):
    velocity, time_s = worlds.truth["truth.velocity_m_per_s"], worlds.observed["recording.time_s"]
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    assert speed.min() >= 3.7
    assert speed.min() < 3.75
    assert 5.6 < speed.max() <= 5.9
    assert np.abs(velocity[..., 2]).max() < 0.3
    course = np.unwrap(np.arctan2(velocity[..., 1], velocity[..., 0]))
    assert {-1.0, 1.0} == set(np.sign(course[:, -1] - course[:, 0]))
    # The place where a lap ends is where it began.
    position = worlds.truth["truth.position_m"]
    lap_s = []
    for world in range(WORLDS):
        late = time_s[world] > 40
        nearest = np.linalg.norm(position[world] - position[world, 0], axis=-1) + np.where(late, 0, 1e3)
        lap_s.append(time_s[world, np.flatnonzero(nearest < 3.5)[0]])
        turned = course[world, nearest.argmin()] - course[world, 0]
        assert abs(np.angle(np.exp(1j * turned))) < 0.4
    assert 70 < min(lap_s) <= max(lap_s) < 95
    assert np.mean(lap_s) == pytest.approx(80, abs=5)
    height = worlds.truth["truth.height_m"]
    assert np.abs(height - 9.144).max() <= 0.3 + 1e-3
    assert height.std() > 0.05
    assert height.mean() == pytest.approx(9.144, abs=0.05)


def test_the_flight_stays_in_the_streets(worlds):
    wall = worlds.observed["site.wall_m"]
    position = worlds.truth["truth.position_m"]
    half = np.abs(wall[:, :4]).max(axis=(1, 2))
    outside = (np.abs(position) - half[:, None]).max(axis=-1)
    # The corner is nearer to that of the block, yet not by much.
    assert outside.min() > 5
    assert outside.max() < 10 + 1e-2
    np.testing.assert_allclose(worlds.observed["site.corner_m"][:, 1], half + 20)
    np.testing.assert_allclose(np.median(outside), 10, atol=1e-2)
    sides = 2 * half
    assert ((sides >= [95, 58]) & (sides <= [105, 66])).all()
    assert np.ptp(sides, axis=0).min() > 3
    # Everything lies around the origin, which is in Tehran.
    np.testing.assert_allclose(np.rad2deg(worlds.observed["site.origin_geodetic"][0, :2]), [35.7, 51.4])


def test_velocity_is_the_rate_of_the_place_and_bank_and_yaw_follow_from_it():
    truth = drawn(noise=0.0, epoch_rate_hz=100.0, wobble_deg=0.0, **SHORT).truth
    position = np.concatenate([truth["truth.position_m"], truth["truth.height_m"][..., None]], axis=-1)
    velocity = truth["truth.velocity_m_per_s"]
    rate = (position[:, 2:] - position[:, :-2])[..., [1, 0, 2]] * [1, 1, -1] / 0.02
    np.testing.assert_allclose(rate, velocity[:, 1:-1], atol=1e-3)
    roll, pitch, yaw = np.moveaxis(truth["truth.attitude_rad"], -1, 0)
    np.testing.assert_allclose(pitch, 0, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * np.arctan2(velocity[..., 1], velocity[..., 0])))
    acceleration = np.gradient(velocity, 0.01, axis=1)
    to_the_right = -np.sin(yaw) * acceleration[..., 0] + np.cos(yaw) * acceleration[..., 1]
    np.testing.assert_allclose(9.80665 * np.tan(roll)[:, 2:-2], to_the_right[:, 2:-2], atol=0.01)
    assert np.rad2deg(np.abs(roll)).max() > 8
    # Continuous acceleration: its change in a hundredth of a second is small.
    assert np.abs(np.diff(acceleration[:, 2:-2], axis=1)).max() < 0.05


def test_in_a_coordinated_flight_the_force_stays_in_the_middle():
    observed = drawn(range(3), noise=0.0, wobble_deg=0.0).observed
    force = observed[FORCE]
    assert np.abs(force[..., 1]).max() < 0.02
    assert np.abs(force[..., 2] + 9.79).mean() < 0.05
    turning = drawn(range(3), noise=0.0, wobble_deg=1.0).observed[FORCE]
    assert turning[..., 1].std() == pytest.approx(9.8 * np.deg2rad(1), rel=0.2)


def test_without_errors_the_readings_lead_from_the_start_along_the_path(exact):
    observed, truth = exact
    nav = navigate(
        observed[FORCE][:, :12_000],
        observed[RATE][:, :12_000],
        0.01,
        geodetic=observed["recording.start_geodetic"],
        velocity_m_per_s=observed["recording.start_velocity_m_per_s"],
        attitude=attitude_of(observed["recording.start_attitude_rad"]),
    )
    local = to_local(nav.geodetic[:, ::50], observed["site.origin_geodetic"][:, None])
    epochs = slice(0, 241)
    assert np.abs(local[..., :2] - truth["truth.position_m"][:, epochs]).max() < 1e-3
    assert np.abs(local[..., 2] - truth["truth.height_m"][:, epochs]).max() < 1e-3
    assert np.abs(nav.velocity_m_per_s[:, ::50] - truth["truth.velocity_m_per_s"][:, epochs]).max() < 1e-6
    true = attitude_of(truth["truth.attitude_rad"][:, epochs])
    assert np.abs(nav.attitude[:, ::50] - true).max() < 1e-7
    np.testing.assert_allclose(observed["recording.imu_time_s"][0], np.arange(1, 32_001) / 100)
    np.testing.assert_allclose(observed["recording.time_s"][0], np.arange(641) / 2)
    np.testing.assert_array_equal(truth["truth.path_m"], truth["truth.position_m"])


def test_gps_reads_the_place_and_the_velocity_of_its_antenna_on_its_own_clock():
    lever = np.array([-0.8, 0.5, -0.3])
    observed, truth = drawn(noise=0.0, epoch_rate_hz=100.0, gps_lever_arm_m=lever.tolist(), **SHORT)
    time_s = observed["recording.time_s"][0]
    gps_s = observed["recording.gps_time_s"][0]
    np.testing.assert_allclose(gps_s, 0.374 + np.arange(20))
    apart = np.abs(gps_s[:, None] - observed["recording.imu_time_s"][0]).min(axis=1)
    assert apart.min() > 0.003
    for world in range(2):
        east, north = truth["truth.position_m"][world].T
        place = np.stack([north, east, -truth["truth.height_m"][world]], axis=-1)
        attitude = attitude_of(truth["truth.attitude_rad"][world])
        antenna = CubicSpline(time_s, place + attitude @ lever)
        origin = observed["site.origin_geodetic"][world]
        found = local_ned(observed["recording.gps_geodetic"][world], origin)
        np.testing.assert_allclose(found, antenna(gps_s), atol=1e-4)
        velocity = observed["recording.gps_velocity_m_per_s"][world]
        np.testing.assert_allclose(velocity, antenna(gps_s, 1), atol=3e-3)
        # A lever arm that did not count would be seen.
        assert np.abs(found - CubicSpline(time_s, place)(gps_s)).max() > 0.3


def test_errors_of_gps_are_white_and_wandering(worlds, exact):
    error = gps_errors(worlds, exact)
    white, wandering = np.array(SETTINGS["gps_white_m"]), np.array(SETTINGS["gps_correlated_m"])
    jumps = np.diff(error, axis=1)
    # Of the wandering part 2 (1 - exp(-1/100)) of the variance changes within a second.
    np.testing.assert_allclose(
        jumps.std(axis=(0, 1)), np.sqrt(2 * white**2 + 0.0199 * wandering**2), rtol=0.05
    )
    lagged = np.mean(error[:, 5:] * error[:, :-5], axis=(0, 1))
    np.testing.assert_allclose(lagged, wandering**2 * np.exp(-0.05), rtol=0.6)
    assert error.mean() == pytest.approx(0, abs=0.4)
    only = drawn(range(WORLDS), gps_correlated_m=[0.0] * 3, **NO_SIGHTINGS)
    error = gps_errors(only, exact)
    np.testing.assert_allclose(error.std(axis=(0, 1)), white, rtol=0.05)
    assert np.abs(np.mean(error[:, 1:] * error[:, :-1], axis=(0, 1)) / white**2).max() < 0.05
    speed = (
        worlds.observed["recording.gps_velocity_m_per_s"] - exact.observed["recording.gps_velocity_m_per_s"]
    )
    np.testing.assert_allclose(speed.std(axis=(0, 1)), SETTINGS["gps_velocity_m_per_s"], rtol=0.05)


def sensor_errors(exact, seeds=range(4), **errors):
    found = drawn(seeds, **{**QUIET, **NO_SIGHTINGS, **errors}).observed
    return {name: found[name] - exact.observed[name][: len(found[name])] for name in (FORCE, RATE)}


def test_errors_of_the_inertial_sensors_are_those_of_their_data_sheet(exact):
    white = sensor_errors(
        exact,
        accelerometer_noise_density_m_per_s2_sqrt_hz=0.002,
        gyro_noise_density_deg_per_s_sqrt_hz=0.0172,
    )
    for name, density in ((FORCE, 0.002), (RATE, np.deg2rad(0.0172))):
        np.testing.assert_allclose(white[name].std(axis=1), density * 10, rtol=0.03)
        # What is summed up over a second walks by the density.
        seconds = white[name].reshape(4, 320, 100, 3).mean(axis=2)
        np.testing.assert_allclose(seconds.std(axis=(0, 1)), density, rtol=0.1)
    bias = sensor_errors(
        exact,
        range(WORLDS),
        accelerometer_turn_on_bias_m_per_s2=0.02,
        gyro_turn_on_bias_deg_per_s=0.05,
    )
    for name, deviation in ((FORCE, 0.02), (RATE, np.deg2rad(0.05))):
        assert np.ptp(bias[name], axis=1).max() < 2e-6
        assert bias[name].mean(axis=1).std() == pytest.approx(deviation, rel=0.3)
    scale = sensor_errors(exact, accelerometer_scale_deviation=0.01)
    share = scale[FORCE][..., 2] / exact.observed[FORCE][:4, :, 2]
    assert np.ptp(share, axis=1).max() < 1e-6
    assert 1e-4 < np.abs(share).max() < 0.04
    np.testing.assert_allclose(scale[RATE], 0, atol=1e-7)
    wandering = sensor_errors(exact, range(WORLDS), gyro_in_run_bias_deg_per_s=1.0)[RATE]
    assert np.rad2deg(wandering).std() == pytest.approx(1.0, rel=0.3)
    # Over a correlation time it changes by sqrt(2 (1 - 1/e)), within a second by little.
    change = np.rad2deg(wandering[:, 30_000] - wandering[:, 0]).std()
    assert change == pytest.approx(1.12, rel=0.35)
    knots = np.rad2deg(wandering[:, ::100])
    assert np.diff(knots, axis=1).std() == pytest.approx(np.sqrt(2 / 300), rel=0.05)


def test_the_start_is_noted_with_the_errors_of_a_levelling(worlds, exact):
    # Only a constant bias of the accelerometers: what a level unit at rest would find from its readings.
    only = {**QUIET, "accelerometer_turn_on_bias_m_per_s2": 0.02}
    found = drawn(range(4), **only)
    bias = (found.observed[FORCE] - exact.observed[FORCE][:4]).mean(axis=1)
    reading = bias + np.array([0, 0, -9.80665])
    roll = np.arctan2(-reading[:, 1], -reading[:, 2])
    pitch = np.arctan2(reading[:, 0], np.hypot(reading[:, 1], reading[:, 2]))
    error = found.observed["recording.start_attitude_rad"] - found.truth["truth.attitude_rad"][:, 0]
    np.testing.assert_allclose(error, np.stack([roll, pitch, 0 * roll], axis=-1), atol=5e-5)
    assert np.abs(error[:, :2]).max() > 0.002
    for name in START - {"recording.start_attitude_rad"}:
        np.testing.assert_array_equal(found.observed[name], exact.observed[name][:4])

    error = worlds.observed["recording.start_attitude_rad"] - worlds.truth["truth.attitude_rad"][:, 0]
    error = np.rad2deg(np.angle(np.exp(1j * error)))
    assert error[:, 2].std() == pytest.approx(1.0, rel=0.5)
    assert error[:, :2].std() == pytest.approx(np.hypot(0.5, np.rad2deg(0.0206 / 9.8)), rel=0.35)
    velocity = worlds.observed["recording.start_velocity_m_per_s"]
    assert (velocity - worlds.truth["truth.velocity_m_per_s"][:, 0]).std() == pytest.approx(0.1, rel=0.3)
    # The place is one more reading of GPS: it shares what wanders.
    start, true = (each.observed["recording.start_geodetic"] for each in (worlds, exact))
    error = (start - true) * position_scale_m(true)
    np.testing.assert_allclose(error.std(axis=0), np.hypot([1.5, 1.5, 3], [1, 1, 2]), rtol=0.5)
    wandering = drawn(range(4), gps_white_m=[0.0] * 3)
    error = (wandering.observed["recording.start_geodetic"] - true[:4]) * position_scale_m(true[:4])
    np.testing.assert_allclose(error, gps_errors(wandering, drawn(range(4), noise=0.0))[:, 0], atol=1e-6)


def test_landmarks_stand_off_the_facades_evenly_spread(worlds):
    landmark, wall = worlds.truth["truth.landmark_m"], worlds.observed["site.wall_m"]
    assert 2 <= landmark[..., 2].min() < landmark[..., 2].max() <= 16
    for world in range(WORLDS):
        (left, bottom), (right, top) = wall[world, :4].min(axis=(0, 1)), wall[world, :4].max(axis=(0, 1))
        x, y = landmark[world, :, :2].T
        off = np.maximum.reduce([left - x, x - right, bottom - y, y - top])
        np.testing.assert_allclose(off[::2], 0.2)
        np.testing.assert_allclose(off[1::2], 19.8)
        # To the left around the block from its lower left corner, one in each equal part.
        x, y = np.clip(x, left, right), np.clip(y, bottom, top)
        width, depth = right - left, top - bottom
        along = np.select(
            [np.isclose(y, bottom), np.isclose(x, right), np.isclose(y, top)],
            [x - left, width + y - bottom, width + depth + right - x],
            2 * width + depth + top - y,
        )
        part = np.floor(36 * along / (2 * (width + depth))).astype(int)
        np.testing.assert_array_equal(part, np.arange(36))
        assert np.ptp(36 * along / (2 * (width + depth)) - part) > 0.5
    # The walls: the block, and the same sides across the street.
    np.testing.assert_allclose(np.linalg.norm(wall[:, 4:] - wall[:, :4], axis=-1), 20)
    np.testing.assert_allclose(wall[:, :4].mean(axis=(1, 2)), 0, atol=1e-12)


def blocked(start, end, half):
    """Whether the straight line enters the block, by walking along it."""
    share = np.linspace(0, 1, 2001)[:, None]
    way = start + share * (end - start)
    return bool((np.abs(way) < half - 1e-6).all(axis=-1).any())


def test_what_is_seen_is_near_in_the_field_of_view_and_not_hidden():
    observed, truth = drawn([5], noise=0.0, epoch_rate_hz=5.0, sightings_at_once=36)
    landmark = truth["truth.landmark_m"][0]
    east, north = truth["truth.position_m"][0].T
    place = np.stack([east, north, truth["truth.height_m"][0]], axis=-1)
    turn = Rotation.from_euler("ZYX", truth["truth.attitude_rad"][0][:, ::-1])
    away = (landmark - place[:, None])[..., [1, 0, 2]] * [1, 1, -1]
    body = np.stack([turn[t].inv().apply(away[t]) for t in range(len(place))]) - [0.25, 0, 0.1]
    range_m = np.linalg.norm(body, axis=-1)
    bearing = np.arctan2(body[..., 1], body[..., 0])
    elevation = np.arcsin(body[..., 2] / range_m)

    time = np.rint(5 * observed["recording.sighting_time_s"][0])
    seen = np.isfinite(time)
    time, number = time[seen].astype(int), observed["recording.sighting_landmark"][0][seen]
    expected = np.stack([range_m, bearing, elevation], axis=-1)[time, number]
    np.testing.assert_allclose(observed["recording.sighting"][0][seen], expected, atol=1e-8)
    assert len(set(zip(time, number, strict=True))) == len(time)
    half = np.abs(observed["site.wall_m"][0, :4]).max(axis=(0, 1))
    view = (range_m <= 35) & (np.abs(bearing) <= np.deg2rad(100)) & (np.abs(elevation) <= np.pi / 4)
    view[0] = False
    found = np.zeros_like(view)
    found[time, number] = True
    assert not (found & ~view).any()
    hidden = 0
    for t, k in np.argwhere(view)[::7]:
        is_hidden = blocked(place[t, :2], landmark[k, :2], half)
        hidden += is_hidden
        assert found[t, k] != is_hidden
    assert hidden > 20
    # All are seen from somewhere, on both sides, and above and below.
    assert set(number) == set(range(36))
    assert 2 < found[1:].sum(axis=1).mean() < 6
    assert bearing[found].min() < -1.5
    assert bearing[found].max() > 1.5
    assert elevation[found].min() < -0.1
    assert elevation[found].max() > 0.1


def test_only_the_nearest_landmarks_are_followed_at_a_time():
    every, two = (drawn([2], noise=0.0, sightings_at_once=k).observed for k in (36, 2))
    for time in np.arange(1, 1601, 40) / 5:
        ranges = [
            np.sort(each["recording.sighting"][0, np.isclose(each["recording.sighting_time_s"][0], time), 0])
            for each in (every, two)
        ]
        np.testing.assert_allclose(ranges[1], ranges[0][:2])
    assert two["recording.sighting_time_s"].shape == (1, 3200)


def test_sightings_are_in_order_noisy_and_filled_up(worlds, exact):
    time_s = worlds.observed["recording.sighting_time_s"]
    number = worlds.observed["recording.sighting_landmark"]
    there = np.isfinite(time_s)
    np.testing.assert_array_equal(there, number >= 0)
    np.testing.assert_array_equal(there, np.isfinite(worlds.observed["recording.sighting"]).all(axis=-1))
    # Nothing follows the first gap.
    assert (np.diff(there.astype(int), axis=1) <= 0).all()
    assert (there.sum(axis=1) > 3000).all()
    assert (np.diff(time_s, axis=1)[there[:, 1:]] >= 0).all()
    np.testing.assert_allclose(5 * time_s[there], np.rint(5 * time_s[there]))
    assert set(np.unique(number)) == set(range(-1, 36))
    # What is seen does not depend on the noise.
    np.testing.assert_array_equal(number, exact.observed["recording.sighting_landmark"])
    error = (worlds.observed["recording.sighting"] - exact.observed["recording.sighting"])[there]
    np.testing.assert_allclose(error.std(axis=0), [0.2, 0.01, 0.01], rtol=0.02)
    np.testing.assert_allclose(error.mean(axis=0) / [0.2, 0.01, 0.01], 0, atol=0.02)
    assert kstest(error[:, 0] / 0.2, norm.cdf).pvalue > 1e-4


def fix_errors(worlds):
    fix = worlds.observed["recording.fix_m"][:, :, 0]
    return fix - worlds.truth["truth.position_m"]


def test_white_fix_errors_have_the_distribution_of_the_best_fingerprint_row():
    worlds = drawn(range(24), imu_rate_hz=10.0)
    error = fix_errors(worlds)
    there = np.isfinite(error)
    # Every second epoch, none at the start.
    np.testing.assert_array_equal(there.all(axis=-1), there.any(axis=-1))
    np.testing.assert_array_equal(
        there[..., 0], np.broadcast_to((np.arange(641) % 2 == 0) & (np.arange(641) > 0), (24, 641))
    )
    error = error[:, 2::2]
    size = np.hypot(*np.moveaxis(error, -1, 0)).ravel()
    assert kstest(size, "rayleigh", args=(0, 2.074)).pvalue > 1e-3
    share = np.array([0.5, 0.75, 0.9, 0.95])
    quartiles = np.quantile(size, share)
    np.testing.assert_allclose(quartiles, 2.074 * np.sqrt(-2 * np.log(1 - share)), rtol=0.03)
    # Table 1, last row.
    assert size.mean() == pytest.approx(2.6, abs=0.05)
    np.testing.assert_allclose(quartiles, [2.56, 3.34, 4.42, 5.53], rtol=0.1)
    np.testing.assert_allclose(error.std(axis=(0, 1)), 2.074, rtol=0.03)
    neighbours = np.mean(error[:, 1:] * error[:, :-1], axis=(0, 1)) / 2.074**2
    assert np.abs(neighbours).max() < 0.05


def test_place_fixed_errors_are_smooth_and_come_again_in_every_lap():
    worlds = drawn(range(24), imu_rate_hz=10.0, fix_errors="place")
    error, place = fix_errors(worlds)[:, 2::2] / 2.074, worlds.truth["truth.position_m"][:, 2::2]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1.0, rel=0.1)
    size = 2.074 * np.hypot(*np.moveaxis(error, -1, 0)).ravel()
    assert size.mean() == pytest.approx(2.6, rel=0.1)
    products, distances = [], []
    for world in range(24):
        # Different laps: more than a minute apart.
        first, second = np.triu_indices(320, k=61)
        distances.append(pairwise_distance_m(place[world], place[world])[first, second])
        products.append((error[world][first] * error[world][second]).mean(axis=-1))
    product, distance = np.concatenate(products), np.concatenate(distances)
    for low, high in ((0.0, 0.5), (2.0, 3.0), (4.5, 5.5), (8.0, 9.0), (20.0, 150.0)):
        pairs = (distance >= low) & (distance < high)
        expected = np.exp(-(distance[pairs] ** 2) / 50).mean()
        assert product[pairs].mean() == pytest.approx(expected, abs=0.1)


def test_the_families_share_all_but_the_errors_of_the_fixes(worlds):
    base = drawn()
    assert changed(base, drawn(fix_errors="place")) == {"recording.fix_m"}
    assert changed(base, drawn(fix_error_m=1.0)) == {"recording.fix_m"}
    assert changed(base, drawn(outage_s=120.0)) == {"recording.gps_outage_s"}
    np.testing.assert_array_equal(base.observed["recording.gps_outage_s"], [[100, 140]] * 2)
    assert changed(base, drawn(sighting_range_m=1.0)) == {"recording.sighting"}
    assert changed(base, drawn(sighting_reach_m=20.0)) == SIGHTINGS
    assert changed(base, drawn(landmarks=8)) == SIGHTINGS | {"truth.landmark_m"}
    assert changed(base, drawn(gyro_turn_on_bias_deg_per_s=1.0)) == {RATE}
    levelled = {FORCE, "recording.start_attitude_rad"}
    assert changed(base, drawn(accelerometer_turn_on_bias_m_per_s2=1.0)) == levelled
    assert changed(base, drawn(gps_white_m=[0.0] * 3)) == {
        "recording.gps_geodetic",
        "recording.start_geodetic",
    }
    errors = {FORCE, RATE, "recording.sighting", "recording.fix_m"} | START | GPS
    assert changed(base, drawn(noise=0.0)) == errors
    longer = drawn(duration_s=400.0)
    np.testing.assert_array_equal(base.truth["truth.landmark_m"], longer.truth["truth.landmark_m"])
    np.testing.assert_allclose(
        base.truth["truth.position_m"], longer.truth["truth.position_m"][:, :641], atol=1e-9
    )


def test_a_world_depends_on_its_seed_alone(worlds):
    assert changed(drawn(), drawn()) == set()
    parts = [drawn([3]), drawn([4, 3])]
    for name, values in together(worlds).items():
        for part, index in ((parts[0], 0), (parts[1], 1)):
            np.testing.assert_array_equal(together(part)[name][index], values[3], err_msg=name)
    for name in (FORCE, RATE, "recording.fix_m", "recording.sighting", "site.wall_m", *START, *GPS):
        assert not np.array_equal(worlds.observed[name][0], worlds.observed[name][1], equal_nan=True)


def test_truth_stays_out_of_what_is_observed(worlds):
    assert not any(name.startswith("truth") for name in worlds.observed)
    assert "site.access_point_m" not in worlds.observed
    for name, values in worlds.truth.items():
        # A velocity of exactly zero hides nothing.
        hidden = values[values != 0]
        for seen_as, seen in worlds.observed.items():
            assert not np.isin(hidden, seen).any(), (name, seen_as)


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_every_setting_is_needed_and_named_when_missing(name):
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("origin_deg", [90.0, 0.0]),
        ("origin_deg", 35.7),
        ("origin_height_m", float("nan")),
        ("block_length_m", [0.0, 100.0]),
        ("block_width_m", [66.0, 58.0]),
        ("street_m", 0.0),
        ("street_m", 5.0),
        ("corner_radius_m", 0.0),
        ("corner_radius_m", 30.0),
        ("speed_m_per_s", [0.0, 5.0]),
        ("speed_m_per_s", [5.9, 3.7]),
        ("speed_change_m", [0.0, 5.0]),
        ("height_m", "high"),
        ("height_change_m", -0.1),
        ("height_period_s", [0.0, 5.0]),
        ("wobble_deg", -1.0),
        ("wobble_hz", [0.0, 1.0]),
        ("duration_s", 0.0),
        ("duration_s", 320.005),
        ("duration_s", 120.0),
        ("epoch_rate_hz", 3.0),
        ("epoch_rate_hz", 200.0),
        ("noise", -1.0),
        ("imu_rate_hz", 0.0),
        ("accelerometer_turn_on_bias_m_per_s2", -0.1),
        ("accelerometer_in_run_bias_m_per_s2", -0.1),
        ("accelerometer_noise_density_m_per_s2_sqrt_hz", -0.1),
        ("accelerometer_scale_deviation", -0.1),
        ("gyro_turn_on_bias_deg_per_s", -0.1),
        ("gyro_in_run_bias_deg_per_s", True),
        ("gyro_noise_density_deg_per_s_sqrt_hz", -0.1),
        ("gyro_scale_deviation", -0.1),
        ("in_run_correlation_s", 0.0),
        ("start_velocity_m_per_s", -0.1),
        ("start_level_deg", -0.1),
        ("start_heading_deg", -0.1),
        ("gps_rate_hz", 0.0),
        ("gps_offset_s", -0.1),
        ("gps_offset_s", 320.0),
        ("gps_white_m", [1.0, 1.0]),
        ("gps_white_m", [1.0, 1.0, -1.0]),
        ("gps_correlated_m", 1.0),
        ("gps_correlation_s", 0.0),
        ("gps_velocity_m_per_s", [-0.1, 0.1, 0.1]),
        ("gps_lever_arm_m", [0.0, 0.0]),
        ("outage_begin_s", -1.0),
        ("outage_begin_s", 40.0),
        ("outage_s", -1.0),
        ("outage_s", 230.0),
        ("landmarks", 0),
        ("landmarks", 2.5),
        ("landmark_height_m", [16.0, 2.0]),
        ("landmark_off_m", 20.0),
        ("sighting_rate_hz", 3.0),
        ("sighting_reach_m", 0.0),
        ("sighting_bearing_deg", 181.0),
        ("sighting_elevation_deg", 90.0),
        ("sightings_at_once", 0),
        ("sighting_range_m", -0.1),
        ("sighting_angle_rad", float("inf")),
        ("sighting_lever_arm_m", "front"),
        ("fix_rate_hz", 4.0),
        ("fix_error_m", -1.0),
        ("fix_errors", "grey"),
        ("fix_errors", 1.0),
        ("fix_correlation_m", 0.0),
    ],
)
def test_senseless_settings_are_named(name, value):
    # Where two settings do not fit each other, one of them is named.
    named = {("street_m", "5.0"): "corner_radius_m", ("duration_s", "120.0"): "outage_s"}.get(
        (name, str(value)), name
    )
    with pytest.raises(InputError, match=rf"setting {named}(\[\d\])?: "):
        simulate({**SETTINGS, name: value}, rngs([0]))


def test_no_generator_is_an_error_and_other_settings_are_left_alone():
    with pytest.raises(InputError, match="rngs"):
        simulate(SETTINGS, [])
    assert changed(drawn([0], **SHORT), drawn([0], neurons=500, **SHORT)) == set()
