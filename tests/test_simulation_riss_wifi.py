"""The worlds of the RISS/WiFi study: the drive, the sensors, the radio map, what is paired and hidden."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import least_squares

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.seeds import stream
from positioning.simulation.riss_wifi import simulate
from positioning.simulation.wheeled import rounded_course, schedule

PAPER = yaml.safe_load((Path(__file__).parents[1] / "data/papers/riss_wifi.yaml").read_text("utf-8"))
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["riss_wifi"].items()}
WORLDS = 12
EPOCHS, SAMPLES, WAYPOINTS = 320, 30001, 19
MOTION = ("recording.motion_time_s", "recording.gyro_rad_per_s", "recording.odometer_m_per_s")
NO_NOISE = {
    "turn_on_bias_deg_per_s": 0.0,
    "in_run_bias_deg_per_s": 0.0,
    "angle_random_walk_deg_per_sqrt_h": 0.0,
    "gyro_step_deg_per_s": 0.0,
}
PLAIN = {"fading_db": 0.0, "virtual_power_db": 0.0, "shadowing_db": 0.0, "floor_dbm": -300.0}
EARTH = 7.292115e-5 * np.sin(np.deg2rad(44.23))


def rngs(seeds):
    return [stream(seed, "riss_wifi") for seed in seeds]


def drawn(seeds=range(3), **changes):
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
    return simulate(SETTINGS, rngs(range(WORLDS)))


@pytest.fixture(scope="module")
def noiseless():
    return drawn(residual_bias_deg_per_s=0.0, encoder_step_m=1e-6, **NO_NOISE)


def drives(worlds):
    """Each world's way-points, and its motion readings up to the end of the drive."""
    observed, truth = worlds
    for world, time_s in enumerate(observed["recording.time_s"]):
        waypoint = np.isfinite(truth["truth.position_m"][world, :, 0])
        going = np.isfinite(observed["recording.motion_time_s"][world] + 0.005)
        motion = [observed[name][world, going] for name in MOTION]
        # A reading stands for the interval that ends half a step after its time.
        motion[0] = motion[0] + 0.005
        yield time_s[waypoint], truth["truth.position_m"][world, waypoint], *motion


def rests(time_s, speed):
    """Begin and end of each time without a count, of a second at least."""
    moving = np.flatnonzero(speed > 0)
    edge = np.concatenate([[0], moving, [len(speed) - 1]])
    long = np.diff(edge) > 100
    return np.stack([time_s[edge[:-1][long]], time_s[edge[1:][long]]], axis=-1)


def scan_rows(worlds):
    return np.isfinite(worlds.observed["recording.rss_dbm"]).any(axis=-1)


def test_shapes_are_fixed_and_forty_worlds_stay_small(worlds):
    assert {name: values.shape[1:] for name, values in worlds.observed.items()} == {
        "site.corner_m": (2, 2),
        "site.wall_m": (12, 2, 2),
        "survey.rss_dbm": (67, 132),
        "survey.position_m": (67, 2),
        "recording.time_s": (EPOCHS,),
        "recording.rss_dbm": (EPOCHS, 132),
        "recording.motion_time_s": (SAMPLES,),
        "recording.gyro_rad_per_s": (SAMPLES,),
        "recording.odometer_m_per_s": (SAMPLES,),
        "recording.start_heading_rad": (),
        "recording.start_position_m": (2,),
        "static.time_s": (200,),
        "static.rss_dbm": (200,),
    }
    assert {name: values.shape[1:] for name, values in worlds.truth.items()} == {
        "truth.position_m": (EPOCHS, 2),
        "truth.path_m": (EPOCHS, 2),
        "truth.heading_rad": (EPOCHS,),
        "truth.gyro_bias_rad_per_s": (),
        "truth.odometer_scale": (),
    }
    assert all(len(v) == WORLDS and v.dtype == np.float64 for v in together(worlds).values())
    assert sum(v.nbytes for v in together(worlds).values()) / WORLDS * 40 < 60e6


def test_the_track_has_the_printed_length_and_the_odometer_reads_the_printed_one(worlds):
    for _, place, _, _, speed in drives(worlds):
        # Straight pieces of 98 m come before the last; five corners of 1 m save 2 - pi / 2 each.
        end_x = 3 + 110.5 - 98 + 5 * (2 - np.pi / 2)
        np.testing.assert_allclose(place[[0, -1]], [[15, 17], [end_x, 3]], atol=1e-9)
        assert speed.sum() / 100 == pytest.approx(118.8, abs=0.2)
    np.testing.assert_allclose(worlds.truth["truth.odometer_scale"], 118.8 / 110.5)
    # The chords of a track that is sampled densely are as long as itself.
    path = drawn([0], scan_period_s=0.1).truth["truth.path_m"][0]
    length = np.nansum(np.hypot(*np.diff(path, axis=0).T))
    assert length == pytest.approx(110.5, abs=0.01)


def test_waypoints_are_five_to_seven_metres_apart(worlds):
    spacings = []
    for passage_s, place, time_s, _, speed in drives(worlds):
        assert len(place) == WAYPOINTS
        distance = np.interp(passage_s, time_s, np.cumsum(speed) / 100 / (118.8 / 110.5))
        spacings.append(np.diff(distance))
        assert np.hypot(*np.diff(place, axis=0).T).max() <= 7 + 1e-9
    spacings = np.array(spacings)
    assert spacings.min() >= 5 - 0.02
    assert spacings.max() <= 7 + 0.02
    assert spacings.std() > 0.3
    assert np.abs(spacings[0] - spacings[1]).max() > 0.1


def test_the_robot_rests_first_then_at_five_waypoints_and_last(worlds):
    stops = set()
    for passage_s, _, time_s, _, speed in drives(worlds):
        rest = rests(time_s, speed)
        lasts = np.diff(rest, axis=-1)[:, 0]
        assert len(rest) == 7
        assert 20 <= lasts[0] <= 30.1
        assert ((lasts[1:] >= 4 - 0.02) & (lasts[1:] <= 10.2)).all()
        assert rest[0, 0] == 0
        assert rest[-1, 1] == time_s[-1]
        # The passage of a way-point with a stop is the middle of the stop.
        apart = np.abs(rest.mean(axis=1)[:, None] - passage_s)
        assert apart.min(axis=1).max() < 0.06
        stops |= set(apart.argmin(axis=1)[1:-1].tolist())
        assert apart.argmin(axis=1)[[0, -1]].tolist() == [0, WAYPOINTS - 1]
    assert len(stops) > 10


def test_speeds_differ_and_stay_within_their_limits(noiseless):
    for passage_s, _, time_s, _, speed in drives(noiseless):
        true = speed / (118.8 / 110.5)
        assert true.max() <= 1.0 + 1e-3
        assert np.abs(np.diff(true)).max() * 100 <= 0.5 + 0.05
        # A reading is the mean since the one before, so the first of a leg has some of the leg before.
        legs = [true[(time_s > t0 + 0.01) & (time_s < t1)].max() for t0, t1 in pairwise(passage_s)]
        # One speed in each eighteenth of the range.
        rank = np.floor((np.sort(legs) - 0.4) / (0.6 / 18) + 1e-3)
        np.testing.assert_array_equal(rank, np.arange(18))
        assert legs != sorted(legs)


def test_after_the_end_all_is_nan_and_before_nothing_is(worlds):
    observed, truth = worlds
    time_s, motion_s = observed["recording.time_s"], observed["recording.motion_time_s"]
    going, moving = np.isfinite(time_s), np.isfinite(motion_s)
    for there in (going, moving):
        assert (np.diff(there.astype(int), axis=-1) <= 0).all()
        assert len(np.unique(there.sum(axis=-1))) > 3
    np.testing.assert_array_equal(np.isfinite(truth["truth.heading_rad"]), going)
    np.testing.assert_array_equal(np.isfinite(truth["truth.path_m"]), going[..., None].repeat(2, -1))
    for name in MOTION:
        np.testing.assert_array_equal(np.isfinite(observed[name]), moving)
    waypoint = np.isfinite(truth["truth.position_m"])
    assert (waypoint.all(axis=-1) == waypoint.any(axis=-1)).all()
    assert (waypoint[..., 0].sum(axis=-1) == WAYPOINTS).all()
    np.testing.assert_array_equal(truth["truth.position_m"][waypoint], truth["truth.path_m"][waypoint])
    assert not scan_rows(worlds)[~going].any()
    for name in ("survey.position_m", "static.rss_dbm", "recording.start_heading_rad", "site.wall_m"):
        assert np.isfinite(observed[name]).all()


def test_epochs_are_the_scans_and_the_passages(worlds):
    observed, truth = worlds
    for world, time_s in enumerate(observed["recording.time_s"]):
        going = np.isfinite(time_s)
        end_s = np.nanmax(observed["recording.motion_time_s"][world]) + 0.005
        assert (np.diff(time_s[going]) > 1e-3).all()
        scan = scan_rows(worlds)[world]
        np.testing.assert_allclose(time_s[scan], np.arange(int(end_s) + 1), atol=1e-3)
        waypoint = np.isfinite(truth["truth.position_m"][world, :, 0])
        assert ((scan | waypoint) == going).all()
        assert (going & ~scan).sum() > 15
    np.testing.assert_array_equal(observed["recording.start_position_m"], truth["truth.path_m"][:, 0])
    off_deg = np.rad2deg(observed["recording.start_heading_rad"] + np.pi / 2)
    assert (np.abs(off_deg) < 4 * 2.0).all()
    assert off_deg.all()
    # Each reading has the middle of its interval.
    np.testing.assert_allclose(observed["recording.motion_time_s"][0, :1000], np.arange(1000) / 100 - 0.005)


@pytest.mark.parametrize(("first_rest_s", "shared"), [(20.0, True), (20.0016, True), (20.01, False)])
def test_a_scan_at_the_passage_shares_its_epoch(first_rest_s, shared):
    result = drawn([0], first_rest_s=[first_rest_s, first_rest_s])
    time_s = result.observed["recording.time_s"][0]
    epoch = np.flatnonzero(np.isfinite(result.truth["truth.position_m"][0, :, 0]))[0]
    assert time_s[epoch] == pytest.approx(first_rest_s / 2, abs=1e-12)
    assert scan_rows(result)[0, epoch] == shared
    assert (np.abs(time_s - 10) < 0.1).sum() == (1 if shared else 2)
    assert scan_rows(result)[0, np.abs(time_s - 10) < 0.1].sum() == 1


def test_the_sensors_without_errors_tell_the_motion(noiseless):
    observed, truth = noiseless
    for world, (_, _, time_s, gyro, speed) in enumerate(drives(noiseless)):
        epoch_s = observed["recording.time_s"][world]
        going = np.isfinite(epoch_s)
        turned = np.interp(epoch_s[going], time_s, np.cumsum(gyro - EARTH) / 100)
        heading = truth["truth.heading_rad"][world, going]
        np.testing.assert_allclose(heading[0] + turned, heading, atol=1e-4)
        # Right-angled corners: one to the left, and four more.
        assert heading[-1] - heading[0] == pytest.approx(5 * np.pi / 2 - np.pi * (heading[-1] < 5))
        at = truth["truth.heading_rad"][world, 0] + np.cumsum(gyro - EARTH) / 100
        step = (speed / (118.8 / 110.5) / 100)[:, None] * np.stack([np.cos(at), np.sin(at)], axis=-1)
        place = observed["recording.start_position_m"][world] + np.cumsum(step, axis=0)
        path = truth["truth.path_m"][world, going]
        for axis in (0, 1):
            np.testing.assert_allclose(
                np.interp(epoch_s[going], time_s, place[:, axis]), path[:, axis], atol=0.05
            )


def test_the_residual_bias_begins_after_the_first_rest_with_a_random_sign(noiseless):
    biased = drawn(residual_bias_deg_per_s=0.3, encoder_step_m=1e-6, **NO_NOISE)
    assert changed(noiseless, biased) == {"recording.gyro_rad_per_s", "truth.gyro_bias_rad_per_s"}
    bias = biased.truth["truth.gyro_bias_rad_per_s"]
    np.testing.assert_allclose(np.abs(bias), np.deg2rad(0.3))
    for world, (still, with_bias) in enumerate(zip(drives(noiseless), drives(biased), strict=True)):
        first_s = rests(still[2], still[4])[0, 1]
        added = with_bias[3] - still[3]
        np.testing.assert_allclose(added[still[2] < first_s - 0.2], 0, atol=1e-15)
        np.testing.assert_allclose(added[still[2] > first_s + 0.01], bias[world])
    many = simulate({**SETTINGS, "map_scans": 1}, rngs(range(24))).truth["truth.gyro_bias_rad_per_s"]
    assert 4 <= (many > 0).sum() <= 20


def test_the_gyroscope_has_the_noise_of_the_data_sheet(noiseless, worlds):
    walk = np.deg2rad(1.9) / 60
    noisy = drawn(
        residual_bias_deg_per_s=0.0,
        encoder_step_m=1e-6,
        **{**NO_NOISE, "angle_random_walk_deg_per_sqrt_h": 1.9},
    )
    for still, with_noise in zip(drives(noiseless), drives(noisy), strict=True):
        noise = with_noise[3] - still[3]
        # Allan deviation: it falls with the root of the time that is averaged over.
        for averaged in (1, 10, 100):
            means = noise[: len(noise) // averaged * averaged].reshape(-1, averaged).mean(axis=-1)
            deviation = np.sqrt(np.mean(np.diff(means) ** 2) / 2)
            assert deviation == pytest.approx(walk / np.sqrt(averaged / 100), rel=0.2)
    rest = worlds.observed["recording.gyro_rad_per_s"][:, :2000]
    assert rest.std(axis=-1) == pytest.approx(np.full(WORLDS, walk * 10), rel=0.06)
    step = np.deg2rad(0.05)
    readings = rest / step
    np.testing.assert_allclose(readings, np.rint(readings), atol=1e-6)
    # The bias from one switching on to the next is by far the largest part of the mean at rest.
    assert 1.5 < np.rad2deg(rest.mean(axis=-1).std()) < 5
    wandering = drawn(
        residual_bias_deg_per_s=0.0, encoder_step_m=1e-6, **{**NO_NOISE, "in_run_bias_deg_per_s": 0.007}
    )
    spread = np.concatenate([w[3] - s[3] for s, w in zip(drives(noiseless), drives(wandering), strict=True)])
    assert 0.002 < np.rad2deg(spread.std()) < 0.02


def test_counts_of_the_encoder_are_whole(worlds):
    speed = worlds.observed["recording.odometer_m_per_s"]
    counts = speed[np.isfinite(speed)] / (100 * SETTINGS["encoder_step_m"])
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert set(np.unique(np.rint(counts))) >= {0, 4, 8}


def test_the_calibrated_settings_change_only_what_they_must():
    base = drawn()
    assert changed(base, drawn(residual_bias_deg_per_s=0.17)) == {
        "recording.gyro_rad_per_s",
        "truth.gyro_bias_rad_per_s",
    }
    louder = drawn(fading_db=8.0)
    assert changed(base, louder) == {"survey.rss_dbm", "recording.rss_dbm", "static.rss_dbm"}
    # The normals are shared: without rounding and floor, the deviation from the mean only grows.
    none, five, ten = (
        drawn(fading_db=fading_db, floor_dbm=-300.0).observed["recording.rss_dbm"]
        for fading_db in (0.0, 5.0, 10.0)
    )
    np.testing.assert_allclose(ten - none, 2 * (five - none), atol=2.1)
    assert np.isfinite(none[:, :200]).sum() > 1e5 / 5


def test_ageing_changes_the_drive_alone_and_is_neutral_by_default():
    base = drawn(**PLAIN)
    assert SETTINGS["gone_share"] == SETTINGS["moved_share"] == SETTINGS["repowered_db"] == 0
    assert changed(base, drawn(moved_m=9.0, **PLAIN)) == set()
    only = {"recording.rss_dbm"}
    before, scan = base.observed["recording.rss_dbm"], scan_rows(base)

    def columns_where(test):
        return [set(np.flatnonzero(test[world][scan[world]].all(axis=0))) for world in range(3)]

    few, more = (drawn(gone_share=share, **PLAIN) for share in (0.25, 0.5))
    assert changed(base, few) == changed(base, more) == only
    gone, gone_more = (columns_where(np.isnan(aged.observed["recording.rss_dbm"])) for aged in (few, more))
    for small, large in zip(gone, gone_more, strict=True):
        # Ten of forty radios with three or four access points each, and with a higher share the same ones.
        assert 30 <= len(small) <= 40
        assert small < large
    here = np.isfinite(few.observed["recording.rss_dbm"])
    np.testing.assert_array_equal(few.observed["recording.rss_dbm"][here], before[here])

    moved = drawn(moved_share=0.25, **PLAIN)
    assert changed(base, moved) == only
    same = columns_where(moved.observed["recording.rss_dbm"] == before)
    assert all(132 - 40 <= len(kept) <= 132 - 25 for kept in same)

    power = drawn(repowered_db=6.0, **PLAIN)
    assert changed(base, power) == only
    change = power.observed["recording.rss_dbm"] - before
    change = np.stack([np.nanmedian(change[world], axis=0) for world in range(3)])
    assert 3 < change.std() < 9
    for world in range(3):
        spread = np.nanmax(np.abs(power.observed["recording.rss_dbm"][world] - before[world] - change[world]))
        assert spread <= 1
        assert len(np.unique(change[world])) > 10


def test_a_moved_radio_is_shadowed_anew_as_far_as_it_moved():
    plain = {**PLAIN, "shadowing_db": 6.0, "path_loss_exponent": 0.0, "wall_loss_db": 0.0, "moved_share": 1.0}
    kept = drawn(range(8), moved_m=0.0, **plain).observed["recording.rss_dbm"]
    for moved_m in (1.5, 30.0):
        moved = drawn(range(8), moved_m=moved_m, **plain).observed["recording.rss_dbm"]
        first, second = (
            (rss - np.nanmean(rss, axis=1, keepdims=True))[np.isfinite(rss)] for rss in (kept, moved)
        )
        assert np.corrcoef(first, second)[0, 1] == pytest.approx(np.exp(-moved_m / 3), abs=0.08)
        assert second.std() == pytest.approx(first.std(), rel=0.1)


def test_access_points_of_a_radio_are_alike():
    one = {**PLAIN, "fading_db": 5.0, "fading_common_share": 1.0, "shadowing_db": 5.0}
    rss = drawn(**one).observed
    for world in range(3):
        heard = rss["survey.rss_dbm"][world]
        _, radio, counts = np.unique(heard, axis=1, return_inverse=True, return_counts=True)
        # 132 access points of 40 radios, in a random order of columns.
        assert sorted(counts) == [3] * 28 + [4] * 12
        assert (np.diff(heard, axis=1) != 0).any(axis=0).sum() > 120
        assert len(np.unique(radio[:40])) < 36
        scans = rss["recording.rss_dbm"][world]
        assert len(np.unique(scans[np.isfinite(scans).any(axis=-1)], axis=1).T) == 40
    virtual = drawn(**{**one, "virtual_power_db": 2.0}).observed["survey.rss_dbm"] - rss["survey.rss_dbm"]
    assert virtual.mean(axis=1).std() == pytest.approx(2.0, rel=0.15)
    assert np.ptp(virtual, axis=1).max() <= 1


def test_fading_has_its_deviation_and_its_common_part():
    plain = {**PLAIN, "shadowing_db": 5.0}
    mean = drawn(**plain).observed["recording.rss_dbm"]
    noise = drawn(**{**plain, "fading_db": 5.0}).observed["recording.rss_dbm"] - mean
    scans = np.isfinite(noise).all(axis=-1)
    assert noise[scans].std() == pytest.approx(5.0, rel=0.02)
    assert noise[scans].mean() == pytest.approx(0.0, abs=0.1)
    for world in range(3):
        level = mean[world][scans[world]]
        alike = (level[:, :, None] == level[:, None]).all(axis=0)
        correlation = np.corrcoef(noise[world][scans[world]].T)
        np.fill_diagonal(alike, False)
        assert correlation[alike].mean() == pytest.approx(0.5, abs=0.04)
        np.fill_diagonal(alike, True)
        assert correlation[~alike].mean() == pytest.approx(0.0, abs=0.02)
        in_time = [np.corrcoef(row[:-1], row[1:])[0, 1] for row in noise[world][scans[world]].T]
        assert np.mean(in_time) == pytest.approx(0.0, abs=0.03)


def test_near_radios_follow_the_law_of_distance_and_walls():
    near = {**PLAIN, "near_radios": 40}
    free, walled = (drawn([0], wall_loss_db=loss, **near).observed for loss in (0.0, 4.0))
    place, level = free["survey.position_m"][0], free["survey.rss_dbm"][0]
    grid = np.stack(np.meshgrid(np.arange(0.5, 30), np.arange(0.5, 30)), axis=-1).reshape(-1, 2)
    found = []
    for column in range(0, 132, 6):

        def misfit(radio, column=column):
            distance = pairwise_distance_m(place, np.reshape(radio, (-1, 2)))
            return (-40 - 25 * np.log10(np.maximum(distance, 1)) - level[:, [column]]).T

        first = grid[np.abs(misfit(grid)).max(axis=1).argmin()]
        fit = least_squares(lambda radio: misfit(radio)[0], first)
        assert np.abs(fit.fun).max() < 0.7
        found.append(fit.x)
    assert ((np.array(found) > -0.5) & (np.array(found) < 30.5)).all()
    loss = (free["survey.rss_dbm"] - walled["survey.rss_dbm"]) / 4
    np.testing.assert_array_equal(loss, np.rint(loss))
    assert set(np.unique(loss)) >= {0, 1, 2, 3}


def test_far_radios_are_weak_and_every_access_point_is_on_the_map(worlds):
    assert np.isfinite(worlds.observed["survey.rss_dbm"]).any(axis=1).all()
    assert np.isnan(worlds.observed["survey.rss_dbm"]).mean() > 0.05
    far = drawn(**{**PLAIN, "near_radios": 0, "shadowing_db": 5.0}).observed["survey.rss_dbm"]
    strongest = far.max(axis=1)
    assert strongest.min() >= -90.5
    assert strongest.max() <= -64.5
    assert np.ptp(strongest) > 20
    level = np.nanmax(worlds.observed["survey.rss_dbm"], axis=1)
    # Ten of forty radios are near, and outshine the others.
    assert 15 < (level > -60).sum(axis=-1).mean() < 45


def test_a_far_radio_follows_the_law_of_distance_from_another_storey():
    above = {**PLAIN, "near_radios": 0, "far_distance_m": [0.0, 0.0], "moved_share": 1.0}
    observed = drawn([0], moved_m=0.0, **above).observed
    for rss, place in (
        (observed["survey.rss_dbm"][0], observed["survey.position_m"][0]),
        (observed["recording.rss_dbm"][0, :1], observed["recording.start_position_m"][:1]),
    ):
        level = -25 * np.log10(np.hypot(np.hypot(*(place - 15.0).T), 4.0))
        best = observed["survey.rss_dbm"][0].max(axis=0)
        map_m = observed["survey.position_m"][0]
        level -= (-25 * np.log10(np.hypot(np.hypot(*(map_m - 15.0).T), 4.0))).max()
        np.testing.assert_allclose(rss - best, np.repeat(level[:, None], 132, axis=1), atol=1.01)


def test_shadowing_has_its_deviation_and_falls_off_with_distance():
    near = {**PLAIN, "near_radios": 40}
    seeds = range(6)
    place = drawn([0]).observed["survey.position_m"][0]
    none, some = (drawn(seeds, **{**near, "shadowing_db": s}).observed["survey.rss_dbm"] for s in (0.0, 5.0))
    shadow = (some - none).transpose(1, 0, 2).reshape(67, -1)
    # Bilinear interpolation takes off some of the variance between nodes.
    assert 4.2 < shadow.std() < 5.2
    correlation, distance = np.corrcoef(shadow), pairwise_distance_m(place, place)
    for low, high in ((1.5, 2.0), (2.9, 3.6), (4.5, 5.5), (12.0, 40.0)):
        pairs = (distance > low) & (distance < high)
        assert correlation[pairs].mean() == pytest.approx(np.exp(-distance[pairs] / 3).mean(), abs=0.1)


def test_the_map_lies_along_the_track_and_is_the_mean_of_what_its_scans_heard():
    observed = drawn().observed
    place = observed["survey.position_m"]
    np.testing.assert_array_equal(place, np.broadcast_to(place[0], place.shape))
    course = rounded_course(SETTINGS["track_m"], corner_radius_m=1.0)
    line = course.position_at(np.linspace(0, 110.5, 20001))
    # The distance to the track's own part, since the track meets itself.
    part_m = (np.arange(67) + 0.5)[:, None] * 110.5 / 67 + np.linspace(-1, 1, 401)
    apart = np.hypot(*np.moveaxis(course.position_at(part_m) - place[0][:, None], -1, 0)).min(axis=1)
    # In turn left of the track, on it, right of it.
    np.testing.assert_allclose(apart[1::3], 0, atol=0.01)
    np.testing.assert_allclose(apart[np.arange(67) % 3 != 1], 0.5, atol=0.01)
    # The first lies to the left of a robot on its way south, which is east.
    assert place[0, 0, 0] == 15.5
    assert pairwise_distance_m(line[::100], place[0]).min(axis=1).max() < 1.2
    single = drawn(map_scans=1).observed["survey.rss_dbm"]
    heard = single[np.isfinite(single)]
    np.testing.assert_array_equal(heard, np.rint(heard))
    assert heard.min() >= -92
    many = observed["survey.rss_dbm"]
    np.testing.assert_allclose(many * 2520, np.rint(many * 2520), atol=1e-6)
    assert not np.array_equal(np.rint(many), many, equal_nan=True)
    assert np.nanmin(many) >= -92
    mean = drawn(fading_db=0.0, floor_dbm=-300.0).observed["survey.rss_dbm"]
    strong = mean > -70
    assert (many - mean)[strong].std() == pytest.approx(5 / np.sqrt(10), rel=0.1)


def test_the_readings_at_one_place_are_those_of_the_strongest_access_point_at_the_start():
    observed = drawn(fading_db=0.0).observed
    # The start is an epoch of the drive, and nothing has aged.
    strongest = np.nanmax(observed["recording.rss_dbm"][:, 0], axis=-1)
    np.testing.assert_array_equal(observed["static.rss_dbm"], np.repeat(strongest[:, None], 200, axis=1))
    faded = drawn(fading_db=4.0).observed["static.rss_dbm"] - strongest[:, None]
    assert faded.std() == pytest.approx(4.0, rel=0.1)
    np.testing.assert_array_equal(observed["static.time_s"][0], np.arange(200.0))


def test_a_world_depends_on_its_seed_alone():
    whole = drawn(range(5))
    assert changed(whole, drawn(range(5))) == set()
    parts = [drawn([3]), drawn([4, 3])]
    for name, values in together(whole).items():
        for part, index in ((parts[0], 0), (parts[1], 1)):
            np.testing.assert_array_equal(together(part)[name][index], values[3], err_msg=name)
    different = ("survey.rss_dbm", "recording.rss_dbm", "recording.time_s", *MOTION[1:], "static.rss_dbm")
    for name in different:
        assert not np.array_equal(whole.observed[name][0], whole.observed[name][1], equal_nan=True)


def test_another_scan_rate_leaves_all_but_the_epochs_alone():
    base, rarer = drawn(), drawn(scan_period_s=2.0)
    epochs = {"recording.time_s", "recording.rss_dbm"}
    assert changed(base, rarer) == epochs | {"truth.position_m", "truth.path_m", "truth.heading_rad"}
    for before, after in zip(drives(base), drives(rarer), strict=True):
        np.testing.assert_allclose(before[0], after[0])
        np.testing.assert_allclose(before[1], after[1])
    # The radio field is one of the place, not of the scan.
    plain = {**PLAIN, "shadowing_db": 5.0}
    base, rarer = (drawn([0], scan_period_s=s, **plain).observed for s in (1.0, 2.0))
    at = [
        result["recording.rss_dbm"][0][np.isfinite(result["recording.rss_dbm"][0]).any(axis=-1)]
        for result in (base, rarer)
    ]
    np.testing.assert_array_equal(at[0][::2], at[1])


def test_truth_stays_out_of_what_is_observed(worlds):
    assert not any(name.startswith("truth") for name in worlds.observed)
    assert "site.access_point_m" not in worlds.observed
    path = worlds.truth["truth.path_m"]
    moving = np.isfinite(path[..., 0]) & (np.hypot(*(path - path[:, :1]).transpose(2, 0, 1)) > 0.1)
    hidden = path[moving]
    # Coordinates of straight corridors are those of the walls' plan; the other one is the robot's own.
    hidden = hidden[np.abs(hidden - np.rint(hidden)).min(axis=-1) > 1e-6]
    for name, seen in worlds.observed.items():
        assert not np.isin(hidden, seen).any(), name
    # A size that is no multiple of the gyroscope's resolution.
    worlds = drawn(residual_bias_deg_per_s=0.1234)
    bias = worlds.truth["truth.gyro_bias_rad_per_s"]
    assert not any(np.isin(bias, seen).any() for seen in worlds.observed.values())


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_every_setting_is_needed_and_named_when_missing(name):
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size_m", [30.0]),
        ("size_m", [0.0, 30.0]),
        ("track_m", [[1.0, 1.0]]),
        ("track_m", [[1.0, 1.0], [1.0, 1.0], [9.0, 9.0]]),
        ("track_m", [[1.0, 1.0], [29.0, 1.0]]),
        ("track_m", [[1.0, 1.0], [29.0, 1.0], [1.0, 1.0]]),
        ("track_m", [[1.0, 1.0], [29.0, 31.0]]),
        ("track_m", [[0.3, 1.0], [29.0, 1.0], [29.0, 29.0], [1.0, 29.0], [1.0, 3.0]]),
        ("wall_m", [[1.0, 2.0, 3.0]]),
        ("wall_m", 3.0),
        ("corner_radius_m", 0.0),
        ("corner_radius_m", 9.0),
        ("track_length_m", 120.0),
        ("track_length_m", 0.0),
        ("odometer_length_m", -1.0),
        ("waypoint_spacing_m", [6.01, 6.05]),
        ("waypoint_spacing_m", 0.0),
        ("waypoint_spacing_m", [7.0, 5.0]),
        ("speed_m_per_s", [0.0, 1.0]),
        ("speed_m_per_s", [1.0, 0.4]),
        ("acceleration_m_per_s2", 0.1),
        ("acceleration_m_per_s2", 0.0),
        ("stops", 18),
        ("stops", 2.5),
        ("stops", -1),
        ("first_rest_s", -1.0),
        ("stop_s", [0.0, 4.0]),
        ("duration_most_s", 200.0),
        ("duration_most_s", 0.0),
        ("motion_rate_hz", 0.0),
        ("encoder_step_m", 0.0),
        ("turn_on_bias_deg_per_s", -1.0),
        ("in_run_bias_deg_per_s", -1.0),
        ("in_run_correlation_s", 0.0),
        ("angle_random_walk_deg_per_sqrt_h", -0.1),
        ("gyro_step_deg_per_s", -0.1),
        ("latitude_deg", 91.0),
        ("residual_bias_deg_per_s", -0.1),
        ("residual_bias_deg_per_s", float("nan")),
        ("points", 1),
        ("map_offset_m", -0.5),
        ("map_scans", 0),
        ("access_points", 39),
        ("radios", 133),
        ("radios", 9),
        ("near_radios", -1),
        ("reference_dbm", float("inf")),
        ("path_loss_exponent", -2.0),
        ("wall_loss_db", -1.0),
        ("far_distance_m", [-1.0, 5.0]),
        ("far_height_m", -1.0),
        ("far_level_dbm", [-60.0, -90.0]),
        ("virtual_power_db", -1.0),
        ("shadowing_db", True),
        ("shadowing_correlation_m", 0.0),
        ("grid_m", 0.7),
        ("grid_m", 0.25),
        ("grid_m", 60.0),
        ("fading_db", "5"),
        ("fading_db", -1.0),
        ("fading_common_share", 1.1),
        ("floor_dbm", float("nan")),
        ("scan_period_s", 0.0),
        ("static_readings", 0),
        ("static_period_s", 0.0),
        ("gone_share", 1.5),
        ("moved_share", -0.1),
        ("moved_m", -1.0),
        ("repowered_db", -1.0),
    ],
)
def test_senseless_settings_are_named(name, value):
    # Where two settings do not fit each other, one of them is named.
    named = {("access_points", "39"): "radios", ("track_length_m", "120.0"): "track_m"}.get(
        (name, str(value)), name
    )
    with pytest.raises(InputError, match=rf"setting {named}(\[\d\])?: "):
        simulate({**SETTINGS, name: value}, rngs([0]))


def test_no_generator_is_an_error_and_other_settings_are_left_alone():
    with pytest.raises(InputError, match="rngs"):
        simulate(SETTINGS, [])
    assert changed(drawn([0]), drawn([0], particles=500)) == set()


CHAIN = [[0.0, 0.0], [6.0, 0.0], [6.0, 5.0], [9.0, 9.0], [3.0, 9.0]]


def test_a_course_is_smooth_and_as_long_as_its_chain_less_the_corners():
    radius = 0.8
    course = rounded_course(CHAIN, corner_radius_m=radius)
    along = np.diff(CHAIN, axis=0)
    turn = np.diff(np.unwrap(np.arctan2(along[:, 1], along[:, 0])))
    saved = 2 * radius * np.tan(np.abs(turn) / 2) - radius * np.abs(turn)
    assert course.length_m == pytest.approx(np.hypot(*along.T).sum() - saved.sum())
    distance = np.linspace(0, course.length_m, 4001)
    place, heading = course.position_at(distance), course.heading_at(distance)
    np.testing.assert_allclose(place[[0, -1]], [CHAIN[0], CHAIN[-1]], atol=1e-9)
    assert heading[-1] - heading[0] == pytest.approx(turn.sum())
    assert np.abs(np.diff(heading)).max() <= distance[1] / radius * (1 + 1e-9)
    # The place is the integral of the direction.
    for end in (1.0, 5.7, 9.3, 14.0, course.length_m):
        marks = course.start_m[course.start_m < end]
        x, y = (
            quad(lambda s, f=f: f(course.heading_at(s)), 0, end, points=marks, limit=200)[0]
            for f in (np.cos, np.sin)
        )
        np.testing.assert_allclose(course.position_at(end), [x, y], atol=1e-7)
    # Beyond the ends a course stays where it ends.
    np.testing.assert_array_equal(
        course.position_at([-1.0, 99.0]), course.position_at([0.0, course.length_m])
    )


def test_a_course_may_go_straight_or_use_up_a_piece_and_may_not_turn_back():
    straight = rounded_course([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]], corner_radius_m=1.0)
    np.testing.assert_allclose(
        straight.position_at([0.5, 1.0, 2.5]), [[0.5, 0], [1, 0], [2.5, 0]], atol=1e-12
    )
    tight = rounded_course([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]], corner_radius_m=1.0)
    assert tight.length_m == pytest.approx(np.pi)
    np.testing.assert_allclose(tight.position_at(np.pi / 2), [1, 1], atol=1e-12)
    for vertices, radius, thing in (
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], 0.1, "vertex_m"),
        ([[0.0, 0.0], [0.0, 0.0]], 0.1, "vertex_m"),
        ([[0.0, 0.0]], 0.1, "vertex_m"),
        ([[0.0, 0.0], [np.nan, 1.0]], 0.1, "vertex_m"),
        (CHAIN, 3.0, "corner_radius_m"),
        (CHAIN, -1.0, "corner_radius_m"),
    ):
        with pytest.raises(InputError, match=thing):
            rounded_course(vertices, corner_radius_m=radius)


@settings(max_examples=40, deadline=None)
@given(
    legs=st.lists(st.tuples(st.floats(2, 9), st.floats(0.2, 1.0)), min_size=1, max_size=6),
    stop=st.lists(st.booleans(), min_size=7, max_size=7),
)
def test_a_schedule_keeps_to_its_speeds_and_stops(legs, stop):
    length, cruise = map(np.array, zip(*legs, strict=True))
    waypoint = np.insert(np.cumsum(length), 0, 0.0)
    rest = np.where(stop[: len(waypoint)], 3.0, 0.0)
    plan = schedule(waypoint, cruise, rest, acceleration_m_per_s2=0.5)
    np.testing.assert_allclose(plan.distance_at(plan.passage_s), waypoint, atol=1e-9)
    np.testing.assert_allclose(plan.departure_s - plan.passage_s, rest / 2, atol=1e-9)
    time_s = np.linspace(0, plan.end_s, 3001)
    distance = plan.distance_at(time_s)
    speed = np.diff(distance) / time_s[1]
    assert speed.min() >= -1e-9
    assert speed.max() <= cruise.max() + 1e-9
    assert np.abs(np.diff(speed)).max() / time_s[1] <= 0.5 + 1e-6
    assert distance[-1] == pytest.approx(waypoint[-1])
    assert plan.distance_at([-1.0, plan.end_s + 5])[1] == pytest.approx(waypoint[-1])
    # Closed form where all legs begin and end at rest.
    still = schedule(waypoint, cruise, np.full(len(waypoint), 1.0), acceleration_m_per_s2=0.5)
    assert still.end_s == pytest.approx(len(waypoint) + np.sum(length / cruise + cruise / 0.5))


def test_a_leg_just_long_enough_can_be_driven_wherever_it_begins():
    begin = 6.7742120816457225
    assert begin + 2.0 - begin < 2.0  # as it is stored, and two metres are needed
    plan = schedule([0.0, begin, begin + 2.0], [1.0, 1.0], [1.0, 1.0, 1.0], acceleration_m_per_s2=0.5)
    assert plan.end_s == pytest.approx(3 + begin + 2 + 2.0 + 2.0)
    assert (np.diff(plan.time_s) >= 0).all()
    with pytest.raises(InputError, match="acceleration_m_per_s2"):
        schedule([0.0, begin, begin + 2 - 1e-9], [1.0, 1.0], [1.0, 1.0, 1.0], acceleration_m_per_s2=0.5)


def test_a_schedule_refuses_what_cannot_be_driven():
    for cruise, rest, acceleration in ((-1.0, 0.0, 0.5), (1.0, -1.0, 0.5), (1.0, 0.0, 0.0), (1.0, 0.0, 0.1)):
        with pytest.raises(InputError, match="acceleration_m_per_s2"):
            schedule([0.0, 3.0], [cruise], [rest, 0.0], acceleration_m_per_s2=acceleration)
