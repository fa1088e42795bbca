"""The worlds of the foot/WLAN study: corridor, marks, calibration, sensors, what is paired and hidden."""

from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from positioning.errors import InputError
from positioning.geometry import wall_crossings
from positioning.inertial.strapdown import attitude_of, navigate
from positioning.radio import path_loss_dbm
from positioning.seeds import stream
from positioning.simulation.foot_wlan import simulate
from positioning.simulation.imu import (
    Triad,
    TriadDraws,
    draw_triad,
    earth_field_ut,
    read_triad,
    smooth_field,
)

ROOT = Path(__file__).parents[1]
PAPER = yaml.safe_load((ROOT / "data/papers/foot_wlan.yaml").read_text("utf-8"))
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["foot_wlan"].items()}
WORLDS = 4
LAP_M = 2 * (40 + 19.2) - 4 * 2.0 * (2 - np.pi / 2)
POINTS, SCANS = 46, 60
MOTION = (
    "recording.imu_time_s",
    "recording.specific_force_m_per_s2",
    "recording.angular_rate_rad_per_s",
    "recording.magnetic_field_ut",
)
RADIO = {"survey.rss_dbm", "recording.rss_dbm"}
PLAIN = {"scan_noise_db": 0.0, "shadowing_db": 0.0, "body_loss_db": 0.0, "floor_dbm": -300.0}
FAULTLESS = {
    name: 0.0
    for name in SETTINGS
    if name.startswith(("accelerometer_", "gyro_", "magnetometer_")) and "_limit_" not in name
}


# Little radio, for tests of many walks.
SMALL = {"access_points": 1, "calibration_scans": 1, "room_m": 60.0, "floor_dbm": -300.0}


def rngs(seeds):
    return [stream(seed, "foot_wlan") for seed in seeds]


def drawn(seeds=range(2), **changes):
    return simulate({**SETTINGS, "imu": False, **changes}, rngs(seeds))


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
    return simulate(SETTINGS, rngs(range(WORLDS)))


@pytest.fixture(scope="module")
def plain():
    return drawn(**PLAIN)


def test_the_settings_fit_the_schema_of_papers():
    schema = yaml.safe_load((ROOT / "workflow/schemas/paper.schema.yaml").read_text("utf-8"))
    jsonschema.validate(PAPER, schema)


def test_shapes_and_types(worlds):
    assert {name: values.shape[1:] for name, values in worlds.observed.items()} == {
        "site.corner_m": (2, 2),
        "site.wall_m": (48, 2, 2),
        "site.magnetic_north_rad": (),
        "survey.rss_dbm": (POINTS * SCANS, 11),
        "survey.position_m": (POINTS * SCANS, 2),
        "recording.time_s": (699,),
        "recording.rss_dbm": (699, 11),
        "recording.imu_time_s": (60_000,),
        "recording.specific_force_m_per_s2": (60_000, 3),
        "recording.angular_rate_rad_per_s": (60_000, 3),
        "recording.magnetic_field_ut": (60_000, 3),
        "recording.start_heading_rad": (),
        "recording.start_position_m": (2,),
    }
    assert {name: values.shape[1:] for name, values in worlds.truth.items()} == {
        "truth.position_m": (699, 2),
        "truth.path_m": (699, 2),
        "truth.on_point_m": (699, 2),
        "truth.heading_rad": (699,),
        "truth.stance_time_s": (498, 2),
        "truth.stance_m": (498, 3),
        "plan.access_point_m": (11, 2),
        "plan.mark_m": (17, 2),
        "plan.misalignment_rad": (),
    }
    for name, values in together(worlds).items():
        assert len(values) == WORLDS
        assert values.dtype == (np.float32 if name in MOTION[1:] else np.float64)
    # Forty worlds of sensors and radio.
    assert sum(values.nbytes for values in together(worlds).values()) * 10 < 150e6


def test_four_laps_of_the_ring_start_and_end_at_one_place():
    path = drawn([0], scan_period_s=0.1).truth["truth.path_m"][0]
    path = path[np.isfinite(path[:, 0])]
    assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(4 * LAP_M, abs=0.05)
    assert pytest.approx(115, abs=0.1) == LAP_M
    np.testing.assert_allclose(path[[0, -1]], [[30, 8], [30, 8]], atol=1e-9)
    heading = drawn([0]).truth["truth.heading_rad"][0]
    assert np.nanmax(heading) - np.nanmin(heading) == pytest.approx(8 * np.pi)
    assert heading[0] == 0


def test_forty_nine_of_sixty_eight_passages_are_evaluated(worlds):
    observed, truth = worlds
    asked = np.isfinite(truth["truth.position_m"])
    assert (asked.all(-1) == asked.any(-1)).all()
    asked = asked[..., 0]
    np.testing.assert_array_equal(asked.sum(axis=-1), 49)
    np.testing.assert_array_equal(truth["truth.position_m"][asked], truth["truth.path_m"][asked])
    laps = []
    for world in range(WORLDS):
        mark = truth["plan.mark_m"][world]
        apart = np.linalg.norm(truth["truth.position_m"][world, asked[world], None] - mark, axis=-1)
        assert apart.min(axis=1).max() < 1e-6
        times = np.bincount(apart.argmin(axis=1), minlength=17)
        assert times.max() <= 4
        laps.append(times)
        # Marks are neighbours at least half of their mean distance away.
        assert (np.linalg.norm(np.diff(mark, axis=0), axis=-1) > 2.4).all()
    assert not np.array_equal(laps[0], laps[1])
    assert np.mean(laps) * 17 == pytest.approx(49)
    # Every kept passage lies at the time at which it is passed.
    time_s = observed["recording.time_s"]
    assert (
        np.diff(np.where(np.isfinite(time_s), time_s, 1e9), axis=-1)[np.isfinite(time_s)[:, 1:]] > 1e-3
    ).all()


def test_any_passage_may_be_missed():
    truth = drawn(range(40), **SMALL).truth
    asked = np.isfinite(truth["truth.position_m"][..., 0])
    # From corner to corner, the first and the last turn of the ring are not whole.
    turn = np.floor(truth["truth.heading_rad"][asked] / (2 * np.pi)).astype(int)
    counts = np.bincount(turn, minlength=5)
    np.testing.assert_allclose(counts[1:4] / 40, 17 * 49 / 68, rtol=0.06)
    world = np.nonzero(asked)[0]
    apart = truth["truth.position_m"][asked][:, None] - truth["plan.mark_m"][world]
    times = np.bincount(np.linalg.norm(apart, axis=-1).argmin(axis=1)) / 40
    np.testing.assert_allclose(times, 49 / 17, rtol=0.15)


def test_marks_lie_uniformly_off_calibration_points_and_have_twins_on_them():
    worlds = drawn(range(24), **SMALL)
    points = worlds.observed["survey.position_m"][0]
    apart = np.linalg.norm(worlds.truth["plan.mark_m"][:, :, None] - points, axis=-1).min(axis=-1).ravel()
    # Chords of the corners are shorter than the way along them.
    assert apart.max() <= LAP_M / POINTS / 2 + 1e-9
    quantiles = np.quantile(apart, [0.25, 0.5, 0.75])
    np.testing.assert_allclose(quantiles, LAP_M / POINTS / 2 * np.array([0.25, 0.5, 0.75]), atol=0.1)
    asked, twin = (
        np.isfinite(worlds.truth[f"truth.{name}"][..., 0]) for name in ("position_m", "on_point_m")
    )
    assert not (asked & twin).any()
    np.testing.assert_array_equal(twin.sum(axis=-1), 49)
    on_m = worlds.truth["truth.on_point_m"][twin]
    assert np.linalg.norm(on_m[:, None] - points, axis=-1).min(axis=-1).max() < 1e-6
    np.testing.assert_array_equal(on_m, worlds.truth["truth.path_m"][twin])
    # A twin is passed within half a spacing of its mark, in the same lap.
    heading = [worlds.truth["truth.heading_rad"][where].reshape(24, 49) for where in (asked, twin)]
    assert np.abs(heading[0] - heading[1]).max() < np.pi


def test_calibration_points_lie_every_two_and_a_half_metres_with_sixty_scans(worlds):
    place = worlds.observed["survey.position_m"]
    points = place.reshape(WORLDS, POINTS, SCANS, 2)
    assert (points == points[:, :, :1]).all()
    assert (points == points[:1]).all()
    step = np.linalg.norm(np.diff(points[0, :, 0], axis=0), axis=-1)
    assert step.max() == pytest.approx(LAP_M / POINTS)
    assert step.max() == pytest.approx(2.5, abs=0.01)
    heard = np.isfinite(worlds.observed["survey.rss_dbm"]).reshape(WORLDS, POINTS, SCANS, 11)
    assert heard.any(axis=2).sum(axis=-1).min() >= 3
    assert 4 < heard.sum(axis=-1).mean() < 10


def test_a_thinner_survey_is_a_part_of_the_denser_one():
    dense, thin = drawn(), drawn(calibration_spacing_m=5.0)
    assert changed(dense, thin) == {"survey.rss_dbm", "survey.position_m"}
    for name in ("survey.rss_dbm", "survey.position_m"):
        parts = dense.observed[name].reshape(2, POINTS, SCANS, -1)[:, ::2]
        np.testing.assert_array_equal(parts.reshape(2, POINTS // 2 * SCANS, -1), thin.observed[name])


def test_readings_are_whole_dbm_above_the_floor(worlds):
    for name in RADIO:
        rss = worlds.observed[name]
        heard = rss[np.isfinite(rss)]
        np.testing.assert_array_equal(heard, np.rint(heard))
        assert heard.min() >= -92
        assert heard.max() < -25


def test_without_noise_the_radio_is_path_loss_walls_and_body(plain):
    behind = drawn(**{**PLAIN, "body_loss_db": 6.0})
    for side, body_db in ((plain, 0.0), (behind, 6.0)):
        rss = side.observed["recording.rss_dbm"][0]
        scan = np.isfinite(rss).any(axis=-1)
        place = side.truth["truth.path_m"][0, scan]
        access_point = side.truth["plan.access_point_m"][0]
        towards = access_point - place[:, None]
        distance = np.linalg.norm(towards, axis=-1)
        expected = path_loss_dbm(distance, reference_dbm=-40.0, path_loss_exponent=2.5)
        expected -= 3.0 * wall_crossings(place, access_point, side.observed["site.wall_m"][0])
        heading = side.truth["truth.heading_rad"][0, scan, None]
        ahead = (towards[..., 0] * np.cos(heading) + towards[..., 1] * np.sin(heading)) / distance
        np.testing.assert_allclose(rss[scan], expected - body_db * (1 - ahead) / 2, atol=0.5 + 1e-9)
    # A survey without noise repeats itself at a point.
    survey = plain.observed["survey.rss_dbm"].reshape(2, POINTS, SCANS, 11)
    assert (survey == survey[:, :, :1]).all()


def test_access_points_stand_in_rooms_all_around(worlds):
    place = worlds.truth["plan.access_point_m"]
    assert (place >= 0).all()
    assert (place <= [60, 35]).all()
    inner = ((place > [11, 9]) & (place < [49, 26])).all(axis=-1)
    assert 0.2 < inner.mean() < 0.8
    bearing = np.unwrap(np.arctan2(*(place - [30, 17.6]).transpose(2, 0, 1)[::-1]), axis=-1)
    assert np.abs(bearing[:, -1] - bearing[:, 0]).min() > np.pi


def test_the_noise_of_scans_has_its_size_and_a_part_that_lasts():
    base = {**PLAIN, "survey_motion_m": 0.0}
    silent, noisy = drawn(range(4), **base), drawn(range(4), **{**base, "scan_noise_db": 6.0})
    assert changed(silent, noisy) == RADIO
    for name, shape in (("survey.rss_dbm", (4, POINTS, SCANS, 11)), ("recording.rss_dbm", None)):
        noise = noisy.observed[name] - silent.observed[name]
        if shape is None:
            noise = np.stack([row[np.isfinite(row).all(-1)][:400] for row in noise])[:, None]
        else:
            noise = noise.reshape(shape)
        assert noise.std() == pytest.approx(6, rel=0.03)
        for lag in (1, 5):
            product = np.mean(noise[:, :, lag:] * noise[:, :, :-lag]) / noise.var()
            assert product == pytest.approx(0.5 * np.exp(-lag / 5), abs=0.04)


def test_the_slight_motion_of_the_calibration_spreads_the_readings_of_a_point():
    silent = {"scan_noise_db": 0.0, "floor_dbm": -300.0}
    still, moving = drawn(survey_motion_m=0.0, **silent), drawn(**silent)
    spread = [
        side.observed["survey.rss_dbm"].reshape(2, POINTS, SCANS, 11).std(axis=2) for side in (still, moving)
    ]
    assert spread[0].max() == 0
    assert 0.2 < spread[1].mean() < 2


def test_the_calibrated_setting_changes_received_strengths_alone():
    first = simulate(SETTINGS, rngs([0]))
    second = simulate({**SETTINGS, "scan_noise_db": 7.5}, rngs([0]))
    assert changed(first, second) == RADIO


def test_without_inertial_readings_all_else_is_the_same(worlds):
    without = drawn(range(WORLDS))
    left_out = together(worlds).keys() - together(without).keys()
    assert left_out == set(MOTION)
    for name, values in together(without).items():
        np.testing.assert_array_equal(values, together(worlds)[name])


def test_a_world_depends_on_its_own_seed_alone(worlds):
    alone = simulate(SETTINGS, rngs([2]))
    for name, values in together(alone).items():
        np.testing.assert_array_equal(values[0], together(worlds)[name][2])
    assert changed(alone, simulate(SETTINGS, rngs([2]))) == set()
    fixed = {"survey.position_m", "site.corner_m", "site.wall_m", "site.magnetic_north_rad"}
    fixed |= {"recording.start_position_m"}
    for name, values in together(worlds).items():
        assert np.array_equal(values[0], values[1], equal_nan=True) == (name in fixed)


def test_nan_follows_the_end_and_the_readings_have_their_times(worlds):
    observed, truth = worlds
    for name in ("recording.time_s", "recording.imu_time_s"):
        there = np.isfinite(observed[name])
        assert (np.diff(there.astype(int), axis=-1) <= 0).all()
    going = np.isfinite(observed["recording.imu_time_s"])
    for name in MOTION[1:]:
        np.testing.assert_array_equal(np.isfinite(observed[name]).all(axis=-1), going)
        np.testing.assert_array_equal(np.isfinite(observed[name]).any(axis=-1), going)
    np.testing.assert_array_equal(observed["recording.imu_time_s"][0, :500], np.arange(1, 501) / 100)
    end_s = np.nanmax(truth["truth.stance_time_s"], axis=(1, 2))
    np.testing.assert_allclose(np.nanmax(observed["recording.imu_time_s"], axis=1), end_s, atol=0.0101)
    assert (end_s > 420).all()
    assert (end_s < 540).all()
    first_s = truth["truth.stance_time_s"][:, 0]
    assert (first_s[:, 0] == 0).all()
    assert (first_s[:, 1] >= 12).all()
    epochs = np.isfinite(observed["recording.time_s"])
    for name in ("truth.path_m", "truth.heading_rad"):
        there = np.isfinite(truth[name])
        np.testing.assert_array_equal(there if there.ndim == 2 else there.all(-1), epochs)


def test_the_foot_is_beside_the_body_and_rests_in_its_stances(worlds):
    observed, truth = worlds
    for world in range(WORLDS):
        time_s, place = truth["truth.stance_time_s"][world], truth["truth.stance_m"][world]
        there = np.isfinite(time_s[:, 0])
        np.testing.assert_array_equal(np.isfinite(place).all(axis=-1), there)
        # The ball stands at the body's side; the sensor lies a bit behind.
        epoch_s = observed["recording.time_s"][world]
        going = np.isfinite(epoch_s)
        middle = time_s[there].mean(axis=-1)
        body = [
            np.interp(middle, epoch_s[going], truth["truth.path_m"][world, going, axis]) for axis in (0, 1)
        ]
        assert np.linalg.norm(place[there, :2] - np.stack(body, axis=-1), axis=-1).max() < 0.6
        # Force near gravity and little turn in a stance, neither in a swing.
        imu_s = np.nan_to_num(observed["recording.imu_time_s"][world], nan=-1.0)
        stance = np.searchsorted(time_s[there, 0], imu_s - 0.01, side="right") - 1
        rest = (imu_s <= time_s[stance, 1]) & (imu_s > 0) & (stance >= 0)
        force = np.linalg.norm(observed["recording.specific_force_m_per_s2"][world], axis=-1)
        turn = np.linalg.norm(observed["recording.angular_rate_rad_per_s"][world], axis=-1)
        assert np.abs(force[rest] - 9.80665).max() < 1.5
        swing = (imu_s > 0) & ~rest
        assert force[swing].std() > 3
        assert np.median(turn[swing]) > 5 * np.median(turn[rest])


def test_faultless_readings_lead_along_the_foot():
    # Without these the attitude at the start is known; readings in single precision do the rest.
    known = dict.fromkeys(("mounting_tilt_deg", "wobble_m", "wobble_deg", "yaw_deviation_deg"), 0.0)
    observed, truth = simulate({**SETTINGS, **FAULTLESS, **known}, rngs(range(2)))
    for world in range(2):
        count = np.isfinite(observed["recording.imu_time_s"][world]).sum()
        force, rate = (observed[name][world, :count].astype(float) for name in MOTION[1:3])
        stance_s, stance_m = truth["truth.stance_time_s"][world], truth["truth.stance_m"][world]
        there = np.isfinite(stance_m[:, 0])
        attitude = attitude_of(0.0, 0.0, truth["plan.misalignment_rad"][world])
        motion = navigate(force, rate, 0.01, position_m=stance_m[0], attitude=attitude)
        middle = np.rint(stance_s[there].mean(axis=-1) * 100).astype(int)
        error = np.linalg.norm(motion.position_m[middle] - stance_m[there], axis=-1)
        assert error.max() < 0.3
        # Heading, time and frame all matter.
        off = navigate(force, rate, 0.01, position_m=stance_m[0], attitude=attitude_of(0.0, 0.0, 0.3))
        assert np.linalg.norm(off.position_m[middle] - stance_m[there], axis=-1).max() > 3


def test_the_magnetometer_shows_north_where_nothing_disturbs_it():
    quiet = {**SETTINGS, **FAULTLESS, "disturbance_ut": 0.0, "mounting_tilt_deg": 0.0, "wobble_deg": 0.0}
    quiet |= {"yaw_deviation_deg": 0.0}
    observed, truth = simulate(quiet, rngs([0]))
    field = observed["recording.magnetic_field_ut"][0, :1000].astype(float)
    np.testing.assert_allclose(np.linalg.norm(field, axis=-1), 49, atol=1e-4)
    np.testing.assert_allclose(field[:, 2], -49 * np.sin(np.deg2rad(66)), atol=1e-4)
    north = observed["site.magnetic_north_rad"][0]
    assert north == pytest.approx(np.deg2rad(70))
    heading = north - np.arctan2(field[:, 1], field[:, 0])
    # The walking direction is along x at the start.
    np.testing.assert_allclose(heading, truth["plan.misalignment_rad"][0], atol=1e-5)
    disturbed = simulate({**quiet, "disturbance_ut": 4.0}, rngs([0]))
    assert changed(disturbed, simulate(quiet, rngs([0]))) == {"recording.magnetic_field_ut"}
    size = np.linalg.norm(disturbed.observed["recording.magnetic_field_ut"][0], axis=-1)
    assert 1.5 < np.nanstd(size) < 6


def test_starts_are_noted_with_their_error(worlds):
    np.testing.assert_array_equal(
        worlds.observed["recording.start_position_m"], worlds.truth["truth.path_m"][:, 0]
    )
    many = drawn(range(60), **SMALL)
    noted = np.rad2deg(many.observed["recording.start_heading_rad"])
    assert noted.std() == pytest.approx(2, rel=0.3)
    assert np.rad2deg(many.truth["plan.misalignment_rad"]).std() == pytest.approx(8, rel=0.3)


@pytest.mark.parametrize(
    ("change", "thing"),
    [
        ({"size_m": [60.0, 0.0]}, "size_m"),
        ({"size_m": [60.0, 20.0]}, "ring_m"),
        ({"ring_m": [10.0, 8.0, 12.0, 27.0]}, "ring_m"),
        ({"ring_m": [10.0, 8.0, 50.0]}, "ring_m"),
        ({"laps": 0}, "laps"),
        ({"mark_count": 30}, "mark_lattice_m"),
        ({"passages": 69}, "passages"),
        ({"pauses": 40}, "pauses"),
        ({"first_rest_s": [0.0, 3.0]}, "first_rest_s"),
        ({"duration_most_s": 300.0}, "duration_most_s"),
        ({"grid_m": 0.7}, "grid_m"),
        ({"floor_dbm": -45.0}, "floor_dbm"),
        ({"scan_noise_db": -1.0}, "scan_noise_db"),
        ({"noise_slow_share": 1.1}, "noise_slow_share"),
        ({"survey_motion_m": 5.0}, "survey_motion_m"),
        ({"calibration_spacing_m": 200.0}, "calibration_spacing_m"),
        ({"imu": 1}, "imu"),
        ({"stance_share": [0.5, 1.2]}, "stance_share"),
        ({"toe_off_deg": -5.0}, "toe_off_deg"),
        ({"speed_m_per_s": [0.0, 1.0]}, "speed_m_per_s"),
        ({"gyro_limit_deg_per_s": 0.0}, "gyro_limit_deg_per_s"),
        ({"accelerometer_noise_density_m_per_s2_sqrt_hz": -0.1}, "accelerometer_noise_density"),
        ({"in_run_correlation_s": 0.0}, "in_run_correlation_s"),
        ({"inclination_deg": 100.0}, "inclination_deg"),
    ],
)
def test_a_senseless_setting_is_refused_by_name(change, thing):
    with pytest.raises(InputError, match=f"^setting {thing}"):
        drawn([0], **change)


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_no_setting_hides_in_the_code(name):
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


def test_no_world_is_refused():
    with pytest.raises(InputError, match="rngs"):
        simulate(SETTINGS, [])


IDEAL = Triad(turn_on_bias=0.0, in_run_bias=0.0, in_run_correlation_s=50.0, noise_density=0.0)


def triad_draws(count, samples, rate_hz=100.0):
    draws = [draw_triad(np.random.default_rng(k), samples, sample_rate_hz=rate_hz) for k in range(count)]
    return TriadDraws(*(np.stack(parts) for parts in zip(*draws, strict=True)))


def test_ideal_sensors_read_the_truth_and_no_more_than_their_limit():
    true = np.random.default_rng(1).normal(size=(2, 50, 3))
    draws = triad_draws(2, 60)
    np.testing.assert_array_equal(read_triad(true, draws, IDEAL, sample_rate_hz=100.0), true)
    limited = read_triad(true, draws, replace(IDEAL, limit=0.5), sample_rate_hz=100.0)
    np.testing.assert_array_equal(limited, true.clip(-0.5, 0.5))
    rounded = read_triad(true, draws, replace(IDEAL, step=0.25), sample_rate_hz=100.0)
    np.testing.assert_array_equal(rounded, np.rint(true * 4) / 4)


def test_each_error_of_a_triad_has_its_size():
    still = np.zeros((300, 400, 3))
    draws = triad_draws(300, 400)
    noise = read_triad(still, draws, replace(IDEAL, noise_density=0.02), sample_rate_hz=100.0)
    assert noise.std() == pytest.approx(0.2, rel=0.01)
    # Means over a second deviate by the density.
    assert noise.reshape(300, 4, 100, 3).mean(axis=2).std() == pytest.approx(0.02, rel=0.05)
    bias = read_triad(still, draws, replace(IDEAL, turn_on_bias=0.3), sample_rate_hz=100.0)
    assert (bias == bias[:, :1]).all()
    assert bias[:, 0].std() == pytest.approx(0.3, rel=0.08)
    scaled = read_triad(still + 2, draws, replace(IDEAL, scale_deviation=0.1), sample_rate_hz=100.0)
    assert (scaled == scaled[:, :1]).all()
    assert scaled[:, 0].std() == pytest.approx(0.2, rel=0.08)


def test_the_bias_of_a_run_wanders_as_an_independent_filter_has_it():
    draws = triad_draws(3, 1000)
    found = read_triad(np.zeros((3, 1000, 3)), draws, replace(IDEAL, in_run_bias=0.4), sample_rate_hz=100.0)
    decay = np.exp(-1 / 50)
    drive = np.sqrt(1 - decay**2) * draws.in_run
    drive[..., 0] = draws.in_run[..., 0]
    knots = 0.4 * lfilter([1], [1, -decay], drive, axis=-1)
    np.testing.assert_allclose(found[:, ::100], np.swapaxes(knots, -1, -2)[:, :10], atol=1e-12)
    middle = (knots[..., :-1] + knots[..., 1:]) / 2
    np.testing.assert_allclose(found[:, 50::100], np.swapaxes(middle, -1, -2)[:, :10], atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [{"noise_density": -1.0}, {"limit": 0.0}, {"in_run_correlation_s": 0.0}, {"step": np.inf}],
)
def test_sensors_that_cannot_be_are_refused_by_name(change):
    with pytest.raises(InputError, match=next(iter(change))):
        replace(IDEAL, **change)


def test_a_triad_needs_draws_for_all_readings():
    with pytest.raises(InputError, match="draws"):
        read_triad(np.zeros((2, 20, 3)), triad_draws(2, 10), IDEAL, sample_rate_hz=100.0)
    with pytest.raises(InputError, match="sample_rate_hz"):
        draw_triad(np.random.default_rng(0), 10, sample_rate_hz=0.0)


def test_the_field_of_the_earth_points_north_and_down():
    field = earth_field_ut(50.0, np.deg2rad(60), np.deg2rad([0.0, 90.0]))
    np.testing.assert_allclose(
        field, [[25, 0, -50 * np.sqrt(3) / 2], [0, 25, -50 * np.sqrt(3) / 2]], atol=1e-9
    )


def test_the_smooth_field_has_unit_deviation_and_its_correlation():
    rng = np.random.default_rng(5)
    place = np.array([[3.0, 4.0], [4.0, 4.0], [3.0, 6.0], [12.0, 4.0]])
    field = smooth_field(
        rng.standard_normal((4000, 64, 2)), 2 * np.pi * rng.random((4000, 64, 3)), place, correlation_m=2.0
    )
    assert field.shape == (4000, 4, 3)
    np.testing.assert_allclose(field.std(axis=(0, 2)), 1, atol=0.03)
    found = np.mean(field[:, :1] * field, axis=(0, 2))
    np.testing.assert_allclose(found, np.exp(-(np.array([0, 1, 2, 9.0]) ** 2) / 8), atol=0.04)
    # Parts are independent of each other.
    assert np.abs(np.mean(field[..., 0] * field[..., 1])) < 0.04
    with pytest.raises(InputError, match="correlation_m"):
        smooth_field(np.zeros((1, 2)), np.zeros((1, 1)), place, correlation_m=0.0)
