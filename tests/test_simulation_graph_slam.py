"""The worlds of the study graph_slam: building, walks, dead reckoning, radio, what is paired and hidden."""

from inspect import signature
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from algorithms.alignment.graph_slam import GraphSlam
from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.model import Truth, Walks
from positioning.posegraph.residuals import MOTION_INFORMATION
from positioning.posegraph.similarity import NOT_HEARD_DBM
from positioning.seeds import stream
from positioning.simulation import graph_slam, graph_slam_imu
from positioning.simulation.dead_reckoning import FootDraws, FootErrors, dead_reckon, draw_foot
from positioning.simulation.graph_slam import crossings, simulate
from positioning.simulation.pedestrian import Walk, network

PAPER = yaml.safe_load((Path(__file__).parents[1] / "data/papers/graph_slam.yaml").read_text("utf-8"))
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["graph_slam"].items()}
# Facts of the paper from which other settings follow, or that algorithms and not worlds have.
PRINTED = (
    *("walks", "duration_s", "total_m", "landmarks", "landmark_samples"),
    *("heading_information", "d_min_m", "d_max_m", "not_heard_dbm"),
)
CHAIN = {name: setting["value"] for name, setting in PAPER["settings"]["graph_slam_imu"].items()}
WORLDS, WALKS, POSES, LINE_POSES = 6, 5, 855, 30
PERFECT = {"heading_noise_deg": 0.0, "drift_deg_per_s": 0.0, "scale_deviation": 0.0, "position_noise_m": 0.0}
PLAIN = {"fading_db": 0.0, "shadowing_db": 0.0, "body_loss_db": 0.0, "carry_db": 0.0, "floor_dbm": -400.0}
SPEED = 1.18
RECKONED = {"walks.position_m", "walks.heading_rad"}
RSS = {"walks.rss_dbm", "survey.rss_dbm", "query.rss_dbm", "pairs.dense_rss_dbm", "pairs.sparse_rss_dbm"}
RADIO_FREE = {"site.corner_m", "site.wall_m", "survey.position_m", "survey.sparse"}


def rngs(seeds):
    return [stream(seed, "graph_slam") for seed in seeds]


def drawn(seeds=range(1), **changes):
    return simulate({**SETTINGS, **changes}, rngs(seeds))


def together(worlds):
    return {**worlds.observed, **worlds.truth}


def same(first, second):
    return first.shape == second.shape and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")


def changed(first, second):
    first, second = together(first), together(second)
    assert first.keys() == second.keys()
    return {name for name in first if not same(first[name], second[name])}


def plans(seeds=range(WORLDS), **changes):
    """Building and walks as the simulation itself plans them, to be sampled finely."""
    values = graph_slam._read({**SETTINGS, **changes})
    for rng in rngs(seeds):
        names = graph_slam._CHILDREN
        streams = dict(zip(names, rng.spawn(len(names)), strict=True))
        building = graph_slam._building(values, streams["building"])
        yield building, graph_slam._walks(values, building, streams)


@pytest.fixture(scope="module")
def worlds():
    return drawn(range(WORLDS))


@pytest.fixture(scope="module")
def lines():
    return drawn(range(WORLDS), scene="lines")


@pytest.fixture(scope="module")
def one():
    return drawn()


def shapes(arrays):
    return {name: values.shape[1:] for name, values in arrays.items()}


def expected_shapes(walks, poses):
    observed = {
        "site.corner_m": (2, 2),
        "site.wall_m": (39, 2, 2),
        "walks.time_s": (walks, poses),
        "walks.position_m": (walks, poses, 2),
        "walks.heading_rad": (walks, poses),
        "walks.rss_dbm": (walks, poses, 70),
        "survey.rss_dbm": (900, 70),
        "survey.position_m": (900, 2),
        "survey.sparse": (900,),
        "query.rss_dbm": (351, 70),
        "pairs.dense_position_m": (91, 2),
        "pairs.dense_rss_dbm": (91, 70),
        "pairs.sparse_position_m": (91, 2),
        "pairs.sparse_rss_dbm": (91, 70),
    }
    truth = {
        "truth.position_m": (walks, poses, 2),
        "truth.landmark": (walks, poses),
        "truth.path_m": (walks, poses, 2),
        "truth.heading_rad": (walks, poses),
        "truth.query_m": (351, 2),
    }
    return observed, truth


def test_shapes_are_fixed_and_twelve_worlds_are_small(worlds, lines):
    for found, (observed, truth) in (
        (worlds, expected_shapes(WALKS, POSES)),
        (lines, expected_shapes(12, LINE_POSES)),
    ):
        assert shapes(found.observed) == observed
        assert shapes(found.truth) == truth
        assert found.observed["survey.sparse"].dtype == bool
        assert found.truth["truth.landmark"].dtype.kind == "i"
        assert Walks.from_arrays(found.observed) is not None
        assert Truth.from_arrays(found.truth) is not None
    assert sum(v.nbytes for v in together(worlds).values()) / WORLDS * 12 < 100e6


def test_walks_have_the_reported_durations_and_length():
    for _, plan in plans(range(12)):
        assert plan.end_s == [540, 780, 1020, 1320, 1680]
        assert all(walk.end_s >= end for walk, end in zip(plan.walks, plan.end_s, strict=True))
        length = sum(
            walk.schedule.distance_at([end])[0] for walk, end in zip(plan.walks, plan.end_s, strict=True)
        )
        assert length == pytest.approx(5600, rel=0.02)


def test_five_walks_make_43_visits_and_each_sees_every_landmark(worlds):
    mark = worlds.truth["truth.landmark"]
    assert ((mark >= 0).sum(axis=2) == [4, 6, 8, 11, 14]).all()
    assert ((mark >= 0).sum(axis=(1, 2)) == 43).all()
    place = np.asarray(SETTINGS["landmark_m"])
    for index in range(4):
        assert (mark == index).any(axis=2).all()
        at = worlds.truth["truth.position_m"][mark == index]
        np.testing.assert_allclose(at, np.broadcast_to(place[index], at.shape), atol=1e-9)
    for row in mark.reshape(-1, POSES):
        visited = row[row >= 0]
        assert (np.diff(visited) != 0).all()
        for block in np.split(visited, range(4, len(visited), 4)):
            assert len(set(block.tolist())) == len(block)


def test_a_pose_is_at_every_scan_and_every_visit_and_nan_follows_the_end(worlds, lines):
    for found in (worlds, lines):
        time_s, mark = found.observed["walks.time_s"], found.truth["truth.landmark"]
        there = np.isfinite(time_s)
        for name in ("walks.position_m", "walks.heading_rad"):
            assert (
                np.isfinite(found.observed[name]) == there.reshape(there.shape + (1,) * (name[-1] == "m"))
            ).all()
        for name in ("truth.path_m", "truth.heading_rad"):
            known = np.isfinite(found.truth[name])
            assert (known == (there[..., None] if known.ndim == 4 else there)).all()
        assert (np.isfinite(found.truth["truth.position_m"]) == (mark >= 0)[..., None]).all()
        assert np.isnan(found.observed["walks.rss_dbm"][(mark >= 0) | ~there]).all()
        for times, marks in zip(
            time_s.reshape(-1, time_s.shape[-1]), mark.reshape(-1, mark.shape[-1]), strict=True
        ):
            kept = np.isfinite(times)
            assert not kept[np.argmin(kept) :].any() or kept.all()
            assert (np.diff(times[kept]) > 0).all()
            scans = times[kept & (marks < 0)]
            np.testing.assert_allclose(scans, 2.0 * np.arange(len(scans)), atol=1e-9)


def test_the_person_stands_at_a_visit_and_notes_it_in_the_middle(worlds):
    for _, plan in plans(range(2)):
        for walk, mark in zip(plan.walks, plan.landmark, strict=True):
            visit = walk.schedule.passage_s[mark >= 0]
            for away in (-2.49, 2.49):
                moved = walk.at(visit + away)[0] - walk.at(visit)[0]
                assert np.abs(moved).max() < 1e-9
            assert (np.hypot(*(walk.at(visit + 4)[0] - walk.at(visit)[0]).T) > 0.3).all()


def test_nobody_walks_through_a_wall_but_rooms_and_outdoors_are_visited():
    for building, plan in plans():
        for walk, end_s in [*zip(plan.walks, plan.end_s, strict=True), (plan.query, 700), (plan.dense, 180)]:
            place, _ = walk.at(np.arange(0, end_s, 0.2))
            # Lines from each place to the next alone: the diagonal of blocks.
            for first in range(0, len(place) - 1, 60):
                chain = place[first : first + 61]
                crossed = wall_crossings(chain[:-1], chain[1:], building.wall_m)
                assert not np.diagonal(crossed).any()
        place = np.concatenate(
            [walk.at(np.arange(0, end, 1.0))[0] for walk, end in zip(plan.walks, plan.end_s, strict=True)]
        )
        inside = ((place > 0) & (place < [72, 36])).all(axis=1)
        assert 0.3 < inside.mean() < 0.8
        toured = [
            (
                (place[:, 0] > room.left_m)
                & (place[:, 0] < room.right_m)
                & ((place[:, 1] - room.front_m) * room.inward > 1)
                & ((place[:, 1] - room.front_m) * room.inward < room.depth_m)
            ).any()
            for room in building.rooms
        ]
        assert len(building.rooms) == 14
        assert sum(toured) >= 6


def test_a_wall_would_be_noticed():
    _, plan = next(iter(plans(range(1))))
    place, _ = plan.walks[4].at(np.arange(0, 1680, 0.2))
    # Closed doors: front walls without gaps.
    closed = np.array([[[0.0, 8.0], [72.0, 8.0]], [[3.0, 11.0], [69.0, 11.0]], [[0.0, 28.0], [72.0, 28.0]]])
    met = [
        np.diagonal(wall_crossings(place[i : i + 60], place[i + 1 : i + 61], closed)).any()
        for i in range(0, 8300, 60)
    ]
    assert any(met)


def test_walks_are_smooth_and_their_heading_is_where_they_go():
    for _, plan in plans(range(2)):
        for walk, end_s in zip(plan.walks, plan.end_s, strict=True):
            time_s = np.arange(0, end_s, 0.02)
            place, heading = walk.at(time_s)
            step = np.diff(place, axis=0)
            speed = np.hypot(*step.T) / 0.02
            assert speed.max() < SPEED + 1e-6
            assert np.abs(np.diff(speed)).max() / 0.02 < 1.5
            # A corner of 0.4 m radius at the highest speed, or half a turn within two seconds.
            assert np.abs(np.diff(heading)).max() < 0.02 * max(SPEED / 0.4, 1.5 * np.pi / 2) + 1e-6
            going = speed > 0.5
            way = np.arctan2(step[:, 1], step[:, 0])
            off = np.angle(np.exp(1j * (way - (heading[1:] + heading[:-1]) / 2)))
            assert np.abs(off[going]).max() < 0.01
            assert (speed[time_s[1:] < 10] == 0).all()


def test_without_errors_dead_reckoning_is_the_truth_in_a_frame_of_its_own():
    for scene in ("walks", "lines"):
        found = drawn(range(2), scene=scene, **PERFECT)
        position, heading = found.observed["walks.position_m"], found.observed["walks.heading_rad"]
        path, facing = found.truth["truth.path_m"], found.truth["truth.heading_rad"]
        turn = (facing - heading)[..., :1]
        np.testing.assert_allclose(facing - heading, np.where(np.isnan(heading), np.nan, turn), atol=1e-9)
        (x, y) = np.moveaxis(position, -1, 0)
        turned = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=-1)
        np.testing.assert_allclose(turned + path[:, :, :1], path, atol=1e-9)


def test_dead_reckoning_starts_at_the_origin_with_a_heading_within_the_range(worlds, lines):
    for found in (worlds, lines):
        start = np.rad2deg(found.observed["walks.heading_rad"][..., 0])
        assert (found.observed["walks.position_m"][:, :, 0] == 0).all()
        assert np.abs(start).max() <= 30
        assert np.ptp(start) > 30


def test_raw_errors_grow_to_what_foot_mounted_systems_without_a_compass_have(worlds):
    position, heading = worlds.observed["walks.position_m"], worlds.observed["walks.heading_rad"]
    path, facing = worlds.truth["truth.path_m"], worlds.truth["truth.heading_rad"]
    turn = (facing - heading)[..., :1]
    (x, y) = np.moveaxis(position, -1, 0)
    turned = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=-1)
    error = np.linalg.norm(turned + path[:, :, :1] - path, axis=-1)
    assert np.nanmax(error[:, :, :30]) < 6
    assert 10 < np.median(np.nanmax(error, axis=(1, 2))) < 80


def foot(**changes):
    values = {
        "stride_s": 1.0,
        "stride_m": 1.0,
        "heading_noise_rad": 0.0,
        "drift_rad_per_s": 0.0,
        "drift_correlation_s": 100.0,
        "scale_deviation": 0.0,
        "position_noise_m": 0.0,
    }
    return FootErrors(**{**values, **changes})


def straight(strides, speed=1.0):
    time = np.arange(strides + 1.0)
    return np.stack([speed * time, np.zeros(strides + 1)], axis=-1), time


def zero_draws(strides):
    return FootDraws(np.zeros(()), np.zeros(strides), np.zeros(strides), np.zeros((strides, 2)))


def test_a_constant_drift_bends_a_straight_walk_to_an_arc():
    place, time = straight(200)
    rate = 0.01
    draws = zero_draws(200)._replace(drift=np.r_[1.0, np.zeros(199)])
    # So slow a process is a constant.
    errors = foot(drift_rad_per_s=rate, drift_correlation_s=1e12)
    found = dead_reckon(place, time, place, np.zeros(201), 0.0, draws, errors)
    radius = 1.0 / rate
    arc = np.stack([radius * np.sin(rate * time), radius * (1 - np.cos(rate * time))], axis=-1)
    np.testing.assert_allclose(found.heading_rad, rate * time, atol=1e-9)
    np.testing.assert_allclose(found.position_m, arc, atol=2e-3)


def test_scale_and_white_noises_have_the_variances_that_are_stated():
    place, time = straight(400)
    draws = zero_draws(400)._replace(scale=np.array(2.0))
    found = dead_reckon(place, time, place, np.zeros(401), 0.0, draws, foot(scale_deviation=0.01))
    assert found.position_m[-1, 0] == pytest.approx(400 * 1.02)
    many = [draw_foot(np.random.default_rng(seed), 400) for seed in range(400)]
    stacked = FootDraws(*map(np.stack, zip(*many, strict=True)))
    shape = np.broadcast_to(place, (400, 401, 2))
    times = np.broadcast_to(time, (400, 401))
    # At half the speed a stride has half the length, and noise of half the variance.
    for speed in (1.0, 0.5):
        turned = dead_reckon(
            speed * shape,
            times,
            speed * shape,
            np.zeros((400, 401)),
            np.zeros(400),
            stacked,
            foot(heading_noise_rad=0.01),
        )
        assert turned.heading_rad[:, -1].std() == pytest.approx(0.01 * np.sqrt(400 * speed), rel=0.15)
    blurred = dead_reckon(
        shape, times, shape, np.zeros((400, 401)), np.zeros(400), stacked, foot(position_noise_m=0.02)
    )
    assert blurred.position_m[:, -1, 1].std() == pytest.approx(0.02 * 20, rel=0.15)
    standing = dead_reckon(
        0 * shape,
        times,
        0 * shape,
        np.zeros((400, 401)),
        np.zeros(400),
        stacked,
        foot(position_noise_m=0.02, heading_noise_rad=0.01),
    )
    assert (standing.position_m == 0).all()
    assert (standing.heading_rad == 0).all()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    turn=st.floats(-3, 3),
    start=st.floats(-3, 3),
    shift=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
)
def test_dead_reckoning_does_not_know_where_north_is(seed, turn, start, shift):
    rng = np.random.default_rng(seed)
    place = np.cumsum(rng.normal(size=(30, 2)), axis=0)
    heading = rng.normal(size=40)
    time = np.sort(np.r_[0.0, rng.uniform(0, 29, 39)])
    pose = np.stack([np.interp(time, np.arange(30), column) for column in place.T], axis=-1)
    errors = foot(heading_noise_rad=0.02, drift_rad_per_s=0.01, scale_deviation=0.02, position_noise_m=0.0)
    draws = draw_foot(rng, 29)
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    first = dead_reckon(place, time, pose, heading, start, draws, errors)
    other = dead_reckon(
        place @ matrix + shift, time, pose @ matrix + shift, heading + turn, start, draws, errors
    )
    np.testing.assert_allclose(other.position_m, first.position_m, atol=1e-9)
    np.testing.assert_allclose(other.heading_rad, first.heading_rad, atol=1e-9)
    assert first.heading_rad[0] == pytest.approx(start)


def test_dead_reckoning_refuses_poses_without_strides_and_senseless_errors():
    place, time = straight(10)
    with pytest.raises(InputError, match="time_s"):
        dead_reckon(place, 2 * time, place, np.zeros(11), 0.0, zero_draws(10), foot())
    for name, value in (("stride_s", 0.0), ("heading_noise_rad", -1.0), ("drift_correlation_s", np.inf)):
        with pytest.raises(InputError, match=name):
            foot(**{name: value})


def fitted_error_m(found):
    """Distance of each pose from the truth after the best rigid motion of its walk, [walk, pose]."""
    errors = []
    for track, path in zip(
        found.observed["walks.position_m"][0], found.truth["truth.path_m"][0], strict=True
    ):
        there = np.isfinite(path[:, 0])
        own, true = (places[there] @ [1, 1j] for places in (track, path))
        own, true = own - own.mean(), true - true.mean()
        turn = np.vdot(own, true)
        errors.append(np.abs(turn / np.abs(turn) * own - true).max())
    return np.array(errors)


def test_faultless_inertial_readings_lead_back_to_the_walk_and_differ_in_dead_reckoning_alone():
    perfect = {"turn_on_bias": 0.0, "in_run_bias": 0.0, "in_run_correlation_s": 100.0, "noise_density": 0.0}
    short = {"walk_s": [150.0], "visits": [1]}
    found = graph_slam_imu.simulate({**CHAIN, **short, "accelerometer": perfect, "gyro": perfect}, rngs([0]))
    assert fitted_error_m(found).max() < 1.5
    assert (found.observed["walks.position_m"][:, :, 0] == 0).all()
    assert changed(found, drawn(**short)) == RECKONED
    # The readings matter: with their errors the track is another.
    noisy = graph_slam_imu.simulate({**CHAIN, **short}, rngs([0]))
    assert changed(found, noisy) == RECKONED
    assert (fitted_error_m(noisy) < 20).all()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gait", None),
        ("gait", {"stride_m": 1.3}),
        ("gyro", {"noise": 1.0}),
        ("accelerometer", "good"),
        ("foot_filter", {"sates": 9}),
        ("imu_rate_hz", 0.0),
    ],
)
def test_a_senseless_foot_is_named(name, value):
    with pytest.raises(InputError, match=name):
        graph_slam_imu.simulate({**CHAIN, name: value}, rngs([0]))


def test_lines_lead_from_end_to_end_in_one_direction(lines):
    mark, place = lines.truth["truth.landmark"], lines.truth["truth.position_m"]
    ends = np.asarray(SETTINGS["line_m"])
    for index in range(2):
        assert ((mark == index).sum(axis=-1) == 1).all()
        np.testing.assert_allclose(
            place[mark == index], np.broadcast_to(ends[index], (WORLDS * 12, 2)), atol=1e-9
        )
    assert np.nanmax(np.abs(lines.truth["truth.heading_rad"])) < 1e-12
    # The walk noted at both ends turns little on its way; the range of first headings is what differs.
    heading = lines.observed["walks.heading_rad"]
    assert np.nanmax(np.abs(heading - heading[..., :1])) < np.deg2rad(15)


def test_lines_and_walks_share_building_radio_and_survey(worlds, lines):
    both = together(worlds).keys()
    shared = {name for name in both if same(together(worlds)[name], together(lines)[name])}
    assert shared == both - {
        *("walks.time_s", "walks.position_m", "walks.heading_rad", "walks.rss_dbm"),
        *("truth.position_m", "truth.landmark", "truth.path_m", "truth.heading_rad"),
    }


def test_settings_of_one_part_leave_the_others_alone(one):
    assert changed(one, drawn(drift_deg_per_s=0.05)) == RECKONED
    assert changed(one, drawn(start_heading_deg=10.0)) == RECKONED
    assert changed(one, drawn(position_noise_m=0.1)) == {"walks.position_m"}
    assert changed(one, drawn(fading_db=2.0)) == RSS
    assert changed(one, drawn(outer_wall_loss_db=5.0)) == RSS
    assert changed(one, drawn(survey_scans=2)) == {"survey.rss_dbm"}
    assert changed(one, drawn(survey_sparse_m=7.0)) == {"survey.sparse"}
    assert changed(one, drawn(query_s=100.0)) == {"query.rss_dbm", "truth.query_m"}


def test_fewer_access_points_are_the_first_ones(one):
    few = drawn(access_points=20)
    for name in RSS:
        np.testing.assert_array_equal(few.observed[name], one.observed[name][..., :20])
    assert changed(one, few) == RSS


def test_a_world_depends_on_its_own_generator_alone(worlds):
    again = drawn([4])
    for name, values in together(again).items():
        assert same(values[0], together(worlds)[name][4]), name
    assert len({together(worlds)["walks.rss_dbm"][w].tobytes() for w in range(WORLDS)}) == WORLDS


def test_the_survey_covers_the_site_in_two_densities(worlds):
    place, sparse = worlds.observed["survey.position_m"][0], worlds.observed["survey.sparse"][0]
    apart = pairwise_distance_m(place, place) + 1e9 * np.eye(len(place))
    assert apart.min() > 1
    thin = pairwise_distance_m(place[sparse], place[sparse]) + 1e9 * np.eye(sparse.sum())
    assert thin.min() >= 5
    assert (pairwise_distance_m(place, place[sparse]).min(axis=1) < 5).all()
    path = worlds.truth["truth.path_m"]
    away = pairwise_distance_m(path[np.isfinite(path).all(axis=-1)][::7], place).min(axis=1)
    assert away.max() < 4
    # Every place is clear of all walls.
    for wall in worlds.observed["site.wall_m"][0]:
        first, along = wall[0], wall[1] - wall[0]
        share = np.clip((place - first) @ along / (along @ along), 0, 1)
        assert np.linalg.norm(place - first - share[:, None] * along, axis=1).min() >= 0.49


def test_outdoors_few_access_points_are_heard(worlds):
    heard = np.isfinite(worlds.observed["walks.rss_dbm"]).sum(axis=-1)
    path, mark = worlds.truth["truth.path_m"], worlds.truth["truth.landmark"]
    scan = np.isfinite(worlds.observed["walks.time_s"]) & (mark < 0)
    inside = ((path > 0) & (path < [72, 36])).all(axis=-1)
    assert heard[scan & inside].mean() > 25
    assert heard[scan & ~inside].mean() < 15
    dense, sparse = (
        np.isfinite(worlds.observed[f"pairs.{kind}_rss_dbm"]).sum(-1) for kind in ("dense", "sparse")
    )
    assert dense.mean() > 3 * sparse.mean()
    readings = worlds.observed["walks.rss_dbm"]
    readings = readings[np.isfinite(readings)]
    assert (readings == np.rint(readings)).all()
    assert readings.min() >= SETTINGS["floor_dbm"]
    assert readings.max() < -20


def test_the_mean_field_is_path_loss_walls_and_ceilings():
    found = drawn(**PLAIN)
    values = graph_slam._read({**SETTINGS, **PLAIN})
    streams = dict(zip(graph_slam._CHILDREN, rngs([0])[0].spawn(len(graph_slam._CHILDREN)), strict=True))
    radio = graph_slam._radio(values, streams["place"], streams["shadow"])
    wall, place = found.observed["site.wall_m"][0], found.observed["survey.position_m"][0]
    assert ((radio.storey == 1).sum(), (radio.storey == -1).sum(), radio.outside.sum()) == (20, 20, 10)
    inner = wall_crossings(place[::9], radio.position_m, wall[6:])
    outer = wall_crossings(place[::9], radio.position_m, wall[:6])
    distance = np.hypot(pairwise_distance_m(place[::9], radio.position_m), 4.0 * np.abs(radio.storey))
    expected = -40 - 25 * np.log10(np.maximum(distance, 1)) - 10 * (outer + radio.outside)
    expected -= np.where(radio.storey == 0, 4 * inner, 15)
    np.testing.assert_array_equal(found.observed["survey.rss_dbm"][0, ::9], np.rint(expected))


def test_the_body_hides_what_is_behind():
    values = {"body_loss_db": 6.0}
    radio = graph_slam.Radio(
        np.array([[10.0, 0.0], [-10.0, 0.0], [0.0, 5.0]]), np.zeros(3), np.zeros(3), np.zeros(0)
    )
    loss = graph_slam._body_loss_db(values, radio, np.zeros((2, 2)), np.array([0.0, np.pi]))
    np.testing.assert_allclose(loss, [[0, 6, 3], [6, 0, 3]], atol=1e-12)


def test_shadowing_is_correlated_as_stated():
    values = graph_slam._read(SETTINGS)
    shadow = np.concatenate(
        [
            graph_slam._radio(values, np.random.default_rng(1), np.random.default_rng(s)).shadow_db
            for s in range(3)
        ],
        axis=-1,
    )
    assert shadow.std() == pytest.approx(5, rel=0.02)
    for lag in (1, 5):
        for moved in (shadow[lag:] * shadow[:-lag], shadow[:, lag:] * shadow[:, :-lag]):
            assert moved.mean() / 25 == pytest.approx(np.exp(-lag / 5), abs=0.03)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_crossings_of_walls_along_axes_are_those_of_the_exact_count(seed):
    rng = np.random.default_rng(seed)
    place, other = rng.uniform(0, 10, (5, 2)), rng.uniform(0, 10, (4, 2))
    wall = rng.integers(0, 11, (6, 2, 2)).astype(float)
    axis = rng.integers(0, 2, 6)
    wall[np.arange(6), 1, axis] = wall[np.arange(6), 0, axis]
    wall = wall[(wall[:, 0] != wall[:, 1]).any(axis=1)]
    np.testing.assert_array_equal(crossings(place, other, wall), wall_crossings(place, other, wall))


def test_routes_along_a_network_are_shortest_and_turn_only_where_it_does():
    # A square with a bar across its middle.
    ways = [[[0, 0], [4, 0]], [[4, 0], [4, 4]], [[4, 4], [0, 4]], [[0, 4], [0, 0]], [[0, 2], [4, 2]]]
    net = network(np.array(ways, dtype=float), [[1.0, 0.0], [3.0, 2.0]])
    first, last = net.node([1.0, 0.0]), net.node([3.0, 2.0])
    assert net.distance_m[first, last] == 6
    assert net.node_m[net.route(first, net.node([4.0, 4.0]))].tolist() in (
        [[1, 0], [4, 0], [4, 4]],
        [[1, 0], [0, 0], [0, 2], [4, 2], [4, 4]],
    )
    assert net.route(first, first) == [first]
    with pytest.raises(InputError, match="on no way"):
        network(np.array(ways, dtype=float), [[1.0, 1.0]])
    with pytest.raises(InputError, match="cannot be reached"):
        network(np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]]], dtype=float), [])
    with pytest.raises(InputError, match="no node"):
        net.node([9.0, 9.0])


def test_a_walk_turns_on_the_spot_where_its_way_leads_back():
    walk = Walk.along(
        [[0.0, 0.0], [10.0, 0.0], [0.0, 0.1]],
        [0.0, 0.0, 1.0],
        [1.0] * 3,
        turn_back_s=2.0,
        corner_radius_m=0.4,
        acceleration_m_per_s2=1.0,
    )
    arrival = 11.0
    _, heading = walk.at([arrival - 0.01, arrival + 1, arrival + 2.01, walk.end_s + 5])
    end = np.arctan2(0.1, -10.0)
    np.testing.assert_allclose(np.abs(heading), [0, end / 2, end, end], atol=1e-6)
    place, _ = walk.at([arrival, arrival + 1, arrival + 2, walk.end_s])
    np.testing.assert_allclose(place, [[10, 0], [10, 0], [10, 0], [0, 0.1]], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("scene", "maze"),
        ("dead_reckoning", "wheels"),
        ("size_m", [72.5, 36]),
        ("room_width_m", [24, 12]),
        ("room_width_m", [4, 24]),
        ("outer_rooms", 9),
        ("inner_rooms", 1),
        ("room_depth_m", 14),
        ("corridor_width_m", 1),
        ("door_width_m", 3.0),
        ("sway_m", [1.0, 1.5]),
        ("path_m", 2.0),
        ("landmark_m", [[17.0, 9.5], [5.0, 5.0]]),
        ("landmark_m", [[16.0, 9.5], [53.0, 26.5]]),
        ("landmark_m", [[17.0, 9.5], [17.0, 9.5]]),
        ("landmark_m", [[17.0, 9.5]]),
        ("visits", [4, 6]),
        ("walk_s", [100, 100, 100, 100, 100]),
        ("walk_s", []),
        ("visits", [4, 6, 8, 11, 14.5]),
        ("speed_m_per_s", [0.0, 1.0]),
        ("speed_m_per_s", [1.2, 1.0]),
        ("corner_radius_m", 1.0),
        ("line_m", [[10.0, 9.5], [100.0, 9.5]]),
        ("line_m", [[10.0, 9.5], [11.0, 9.5]]),
        ("pair_s", 1000.0),
        ("grid_m", 0.7),
        ("grid_m", 0.1),
        ("access_points", 0),
        ("fading_db", -1.0),
        ("outing_share", 1.5),
        ("start_heading_deg", 200.0),
        ("scan_period_s", 0.0),
        ("stride_s", 0.0),
        ("floor_dbm", float("nan")),
    ],
)
def test_senseless_settings_are_named(name, value):
    with pytest.raises(InputError, match=name):
        drawn(**{name: value})


def test_what_is_printed_is_what_worlds_and_algorithms_use():
    printed = {name: SETTINGS[name] for name in PRINTED}
    walk_s, visits = SETTINGS["walk_s"], SETTINGS["visits"]
    defaults = {
        name: parameter.default for name, parameter in signature(GraphSlam.__init__).parameters.items()
    }
    assert printed == {
        "walks": len(walk_s),
        "duration_s": [min(walk_s), max(walk_s)],
        "landmarks": len(SETTINGS["landmark_m"]),
        "landmark_samples": sum(visits),
        "heading_information": MOTION_INFORMATION[2, 2],
        "d_min_m": defaults["d_min_m"],
        "d_max_m": defaults["d_max_m"],
        "not_heard_dbm": NOT_HEARD_DBM,
        "total_m": pytest.approx(sum(walk_s) * np.mean(SETTINGS["speed_m_per_s"]), rel=0.1),
    }
    assert len(visits) == len(walk_s)
    for name in printed:
        assert "where" in PAPER["settings"]["graph_slam"][name], name


@pytest.mark.parametrize("name", sorted(set(SETTINGS) - set(PRINTED)))
def test_no_default_hides_in_the_code(name):
    with pytest.raises(InputError, match=name):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


def test_no_world_is_refused():
    with pytest.raises(InputError, match="rngs"):
        simulate(SETTINGS, [])
