"""Gait: strides and pauses of a walk, kinematics of the foot, and strapdown navigation that leads back."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.inertial.strapdown import attitude_of, navigate, readings, roll_pitch_heading
from positioning.simulation.gait import Gait, GaitDraws, draw_gait, foot_motion, stances, walk
from positioning.simulation.wheeled import rounded_course

GAIT = Gait(
    stride_m=1.35,
    stride_s=1.1,
    speed_m_per_s=(0.9, 1.3),
    leg_strides=(15, 45),
    length_deviation=0.06,
    duration_deviation=0.03,
    end_share=0.55,
    stance_share=(0.3, 0.42),
    side_m=0.1,
    side_deviation_m=0.02,
    yaw_deviation_rad=0.03,
    sensor_m=(-0.1, 0.08),
    toe_off_rad=1.0,
    heel_strike_rad=0.35,
    clearance_m=0.04,
    landing_m=0.06,
    swing_out_m=0.02,
    shape_deviation=0.08,
    strike_m=0.002,
    strike_hz=15.0,
    wobble_m=0.001,
    wobble_rad=0.01,
    wobble_hz=(0.7, 3.0),
    rest_wobble_share=0.05,
)
STILL = replace(GAIT, wobble_m=0.0, wobble_rad=0.0)
RING = rounded_course(
    [[20, 0], *[[40, 0], [40, 19], [0, 19], [0, 0]] * 4, [20, 0]],
    corner_radius_m=2.0,
)
WORLDS = 6
PAUSES = 4
PAUSE_S = 5.0


def drawn(gait=GAIT, worlds=WORLDS, length_m=RING.length_m, pauses=PAUSES):
    return GaitDraws.stack(
        [draw_gait(np.random.default_rng(k), gait, length_m=length_m, pauses=pauses) for k in range(worlds)]
    )


def walked(gait=GAIT, draws=None, length_m=RING.length_m, pause_s=PAUSE_S):
    draws = drawn(gait) if draws is None else draws
    pause = np.full(draws.pause.shape, pause_s)
    return walk(gait, draws, length_m=length_m, first_rest_s=12.0, last_rest_s=4.0, pause_s=pause)


@pytest.fixture(scope="module")
def plan():
    return walked()


def one(draws, index):
    return GaitDraws(*(values[index] for values in draws))


def foot(time_s, gait=GAIT, index=0, **keys):
    draws = drawn(gait)
    plan = walked(gait, draws).at(index)
    draws = one(draws, index)
    standing = stances(plan, RING, gait, draws, misalignment_rad=0.2)
    return plan, standing, foot_motion(time_s, plan, standing, gait, draws, **keys)


def test_a_walk_has_its_length_its_rests_and_its_pauses(plan):
    for index in range(WORLDS):
        row = plan.at(index)
        there = np.isfinite(row.distance_m)
        distance, time_s = row.distance_m[there], row.stance_time_s[there]
        assert distance[0] == 0
        assert distance[-1] == pytest.approx(RING.length_m, abs=1e-9)
        assert (np.diff(distance) > 0.5).all()
        assert time_s[0, 0] == 0
        assert time_s[-1, 1] == plan.end_s[index]
        # Stances and swings follow each other without a gap or an overlap.
        assert (np.diff(time_s.reshape(-1)) > 0).all()
        lasts = np.diff(time_s, axis=-1)[:, 0]
        assert lasts[0] == pytest.approx(12)
        assert lasts[-1] == pytest.approx(4)
        resting = row.resting[there]
        assert resting.sum() == PAUSES + 2
        assert (lasts[resting][1:-1] > PAUSE_S).all()
        assert (lasts[~resting] < 0.42 * 1.1 / np.sqrt(0.9 / (1.35 / 1.1)) * 1.1).all()
        assert not row.resting[~there].any()
        assert (np.diff(np.flatnonzero(resting)) > 5).all()


def test_walks_differ_and_do_not_depend_on_their_neighbours(plan):
    assert len(np.unique(plan.end_s)) == WORLDS
    alone = walked(draws=GaitDraws(*(values[2:3] for values in drawn())))
    np.testing.assert_array_equal(alone.stance_time_s[0], plan.stance_time_s[2])
    np.testing.assert_array_equal(alone.distance_m[0], plan.distance_m[2])


def test_strides_vary_as_the_settings_say():
    gait = replace(GAIT, speed_m_per_s=(1.0, 1.0))
    draws = drawn(gait, worlds=12)
    plan = walked(gait, draws)
    lengths, durations, shares = [], [], []
    for index in range(12):
        row = plan.at(index)
        there = np.isfinite(row.distance_m)
        rest = row.resting[there]
        plain = ~rest[:-1] & ~rest[1:]
        time_s = row.stance_time_s[there]
        lengths.append(np.diff(row.distance_m[there])[plain])
        swing_s = (time_s[1:, 0] - time_s[:-1, 1])[plain]
        stance_s = (time_s[:-1, 1] - time_s[:-1, 0])[plain]
        durations.append(swing_s + stance_s)
        shares.append(stance_s / durations[-1])
    lengths, durations, shares = map(np.concatenate, (lengths, durations, shares))
    root = np.sqrt(1.0 / (1.35 / 1.1))
    assert lengths.mean() == pytest.approx(1.35 * root, rel=0.01)
    assert lengths.std() / lengths.mean() == pytest.approx(0.06, rel=0.08)
    assert durations.mean() == pytest.approx(1.1 / root, rel=0.01)
    assert durations.std() / durations.mean() == pytest.approx(0.03, rel=0.08)
    assert 0.3 <= shares.min() < 0.31
    assert 0.41 < shares.max() <= 0.42 + 1e-12


def test_speeds_change_within_their_limits(plan):
    gait = replace(GAIT, length_deviation=0.0, duration_deviation=0.0)
    row = walked(gait, drawn(gait)).at(0)
    there = np.isfinite(row.distance_m)
    rest = row.resting[there]
    plain = ~rest[:-1] & ~rest[1:]
    end = row.stance_time_s[there, 1]
    swing = row.stance_time_s[there, 0][1:] - end[:-1]
    stance = np.diff(row.stance_time_s[there], axis=-1)[:-1, 0]
    speed = (np.diff(row.distance_m[there]) / (swing + stance))[plain]
    # One factor near one stretches all strides.
    assert 0.9 * 0.99 < speed.min() < speed.max() < 1.3 * 1.01
    assert speed.std() > 0.03
    assert np.abs(np.diff(speed)).max() <= 0.5 * 0.4 * 1.05 + 0.05


def test_the_body_is_above_the_foot_in_the_middle_of_a_stance_and_rests_in_pauses(plan):
    for index in range(2):
        row = plan.at(index)
        there = np.isfinite(row.distance_m)
        inner = there & ~row.resting
        middle = row.stance_time_s[inner].mean(axis=-1)
        np.testing.assert_allclose(row.distance_at(middle), row.distance_m[inner], atol=1e-9)
        time_s = np.arange(0, row.end_s, 0.02)
        distance = row.distance_at(time_s)
        speed = np.diff(distance) / 0.02
        assert speed.min() >= -1e-9
        assert speed.max() < 2.2
        assert np.abs(np.diff(speed)).max() < 0.4
        for begin, end in row.stance_time_s[there & row.resting]:
            still = (time_s[:-1] > begin + 0.5) & (time_s[1:] < end - 0.5)
            assert np.abs(speed[still]).max() < 1e-12
    ends = plan.distance_at(np.array([-3.0, 0.0, 1e4, np.nan]))
    np.testing.assert_allclose(ends[:, :3], np.tile([0, 0, RING.length_m], (WORLDS, 1)), atol=1e-9)
    assert np.isnan(ends[:, 3]).all()


@settings(max_examples=30, deadline=None)
@given(share=st.floats(0, 1))
def test_a_passage_is_when_the_body_first_is_there(share):
    row = WALK
    distance = share * RING.length_m
    when = row.passage_s(np.array([distance]))
    assert row.distance_at(when)[0] == pytest.approx(distance, abs=1e-9)
    assert row.distance_at(when - 1e-3)[0] <= distance
    if share == 0:
        assert when[0] == pytest.approx(0, abs=1e-9)


WALK = walked().at(0)


def test_a_place_off_the_walk_is_never_passed(plan):
    with pytest.raises(InputError, match="off the walk"):
        plan.passage_s(np.array([RING.length_m + 1]))


def test_strapdown_navigation_of_faultless_readings_returns_the_path_of_four_laps():
    time_s = np.arange(0, WALK.end_s, 0.01)
    mounting = attitude_of(0.05, -0.3, 0.1)
    _, _, motion = foot(time_s, mounting=mounting)
    assert len(time_s) > 40_000
    force, rate = readings(motion.velocity_m_per_s, motion.attitude, 0.01)
    found = navigate(
        force,
        rate,
        0.01,
        position_m=motion.position_m[0],
        velocity_m_per_s=motion.velocity_m_per_s[0],
        attitude=motion.attitude[0],
    )
    assert np.abs(found.position_m - motion.position_m).max() < 1e-3
    # The way is not a trivial one.
    assert np.ptp(motion.position_m, axis=0)[:2] == pytest.approx([40, 19], abs=0.7)


def test_velocity_is_the_derivative_of_place_and_the_attitude_a_rotation():
    step = 1e-4
    time_s = 60 + np.arange(0, 6, 0.007)
    both = np.stack([time_s - step, time_s, time_s + step], axis=-1).reshape(-1)
    _, _, motion = foot(both)
    place = motion.position_m.reshape(-1, 3, 3)
    slope = (place[:, 2] - place[:, 0]) / (2 * step)
    np.testing.assert_allclose(motion.velocity_m_per_s.reshape(-1, 3, 3)[:, 1], slope, atol=2e-4)
    product = motion.attitude @ np.swapaxes(motion.attitude, -1, -2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(motion.attitude), 1)


def test_acceleration_and_turn_rate_are_continuous():
    jumps = []
    for step in (2e-3, 1e-3):
        _, _, motion = foot(np.arange(60, 80, step))
        force, rate = readings(motion.velocity_m_per_s, motion.attitude, step)
        jumps.append([np.abs(np.diff(values, axis=0)).max() for values in (force, rate)])
    # A jump would stay as it is with half the step.
    np.testing.assert_array_less(jumps[1], 0.6 * np.array(jumps[0]))
    assert jumps[0][0] < 12
    assert jumps[0][1] < 0.5


def test_without_wobble_a_standing_foot_is_at_rest():
    time_s = np.arange(0, WALK.end_s, 0.01)
    plan, standing, motion = foot(time_s, gait=STILL)
    stance = np.searchsorted(plan.stance_time_s[:, 0], time_s, side="right") - 1
    rest = time_s <= plan.stance_time_s[stance, 1]
    np.testing.assert_allclose(motion.position_m[rest], standing.sensor_m[stance[rest]], atol=1e-12)
    np.testing.assert_allclose(motion.velocity_m_per_s[rest], 0, atol=1e-12)
    roll, pitch, heading = roll_pitch_heading(motion.attitude[rest])
    np.testing.assert_allclose([roll, pitch], 0, atol=1e-12)
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (heading - standing.yaw_rad[stance[rest]]))), 0, atol=1e-12
    )
    assert 0.3 < rest.mean() < 0.5
    # It moves in all that is not a stance, and far.
    speed = np.linalg.norm(motion.velocity_m_per_s, axis=-1)
    assert (speed[~rest] > 0).mean() > 0.99
    assert 3.5 < speed.max() < 8


def test_the_wobble_is_as_large_as_its_settings_and_small_in_rests():
    time_s = np.arange(0, WALK.end_s, 0.01)
    plan, standing, motion = foot(time_s)
    _, _, still = foot(time_s, gait=STILL)
    stance = np.searchsorted(plan.stance_time_s[:, 0], time_s, side="right") - 1
    rest = time_s <= plan.stance_time_s[stance, 1]
    walking = rest & ~plan.resting[stance]
    pausing = rest & plan.resting[stance]
    turned = np.swapaxes(still.attitude, -1, -2) @ motion.attitude
    angle = np.stack(roll_pitch_heading(turned), axis=-1)
    # Each stance has half to one and a half times the usual size; some of the walk's tones fall together.
    assert angle[walking].std() == pytest.approx(0.01, rel=0.25)
    assert angle[pausing].std() < 0.1 * angle[walking].std()
    shift = np.linalg.norm((motion.position_m - standing.sensor_m[stance])[rest], axis=-1)
    assert shift.max() < 0.012
    assert shift[pausing[rest]].max() < 0.001


def test_the_foot_rolls_over_its_ball_lifts_and_lands_with_the_toes_up():
    time_s = np.arange(60, 120, 0.005)
    plan, standing, motion = foot(time_s, gait=replace(STILL, shape_deviation=0.0))
    stance = np.searchsorted(plan.stance_time_s[:, 0], time_s, side="right") - 1
    swing_s = plan.stance_time_s[1:, 0] - plan.stance_time_s[:-1, 1]
    share = (time_s - plan.stance_time_s[stance, 1]) / swing_s[stance]
    _, pitch, _ = roll_pitch_heading(motion.attitude)
    down, up = pitch.argmax(), pitch.argmin()
    assert pitch[down] == pytest.approx(1.0, abs=0.03)
    assert share[down] == pytest.approx(1 / 3, abs=0.03)
    assert pitch[up] == pytest.approx(-0.35, abs=0.03)
    assert share[up] == pytest.approx(14 / 18, abs=0.03)
    assert (pitch[share <= 0] == 0).all()
    assert 0.1 < motion.position_m[:, 2].max() < 0.25
    assert motion.position_m[:, 2].min() > 0.05
    # The ball hardly leaves its place while the heel rises.
    lever = np.einsum("nij,j->ni", motion.attitude, [-0.1, 0, 0.08])
    ball = (motion.position_m - lever)[:, :2]
    early = (share > 0) & (share < 0.15)
    assert np.linalg.norm(ball - standing.ball_m[stance], axis=-1)[early].max() < 0.03


def test_the_foot_stands_right_of_the_body_and_points_off_the_walking_direction():
    gait = replace(GAIT, side_deviation_m=0.0, yaw_deviation_rad=0.0)
    plan, standing, _ = foot(np.array([0.0]), gait=gait)
    there = np.isfinite(plan.distance_m)
    way = RING.heading_at(plan.distance_m[there])
    right = np.stack([np.sin(way), -np.cos(way)], axis=-1)
    body = RING.position_at(plan.distance_m[there])
    np.testing.assert_allclose(standing.ball_m[there], body + 0.1 * right, atol=1e-12)
    np.testing.assert_allclose(standing.yaw_rad[there], way + 0.2, atol=1e-12)
    for values in standing:
        assert np.isnan(values[~there]).all()
    spread = stances(
        walked(), RING, GAIT, drawn(), misalignment_rad=np.zeros(WORLDS)
    ).yaw_rad - RING.heading_at(np.nan_to_num(walked().distance_m))
    assert np.nanstd(spread) == pytest.approx(0.03, rel=0.1)


def test_leading_axes_are_worlds_by_themselves(plan):
    time_s = np.arange(10, 40, 0.05)
    draws = drawn()
    misalignment = np.linspace(-0.2, 0.2, WORLDS)
    standing = stances(plan, RING, GAIT, draws, misalignment_rad=misalignment)
    mounting = attitude_of(misalignment, 0.1, 0.0)
    together = foot_motion(time_s, plan, standing, GAIT, draws, mounting=mounting)
    for index in (0, WORLDS - 1):
        row, draw = plan.at(index), one(draws, index)
        stood = stances(row, RING, GAIT, draw, misalignment_rad=misalignment[index])
        alone = foot_motion(time_s, row, stood, GAIT, draw, mounting=mounting[index])
        for first, second in zip(alone, together, strict=True):
            np.testing.assert_array_equal(first, second[index])


@pytest.mark.parametrize(
    ("change", "thing"),
    [
        ({"stride_m": 0.0}, "stride_m"),
        ({"stride_s": -1.0}, "stride_s"),
        ({"speed_m_per_s": (1.0, 0.5)}, "speed_m_per_s"),
        ({"speed_m_per_s": (0.0, 0.5)}, "speed_m_per_s"),
        ({"leg_strides": (0, 3)}, "leg_strides"),
        ({"length_deviation": 0.5}, "length_deviation"),
        ({"duration_deviation": -0.1}, "duration_deviation"),
        ({"shape_deviation": np.nan}, "shape_deviation"),
        ({"end_share": 1.5}, "end_share"),
        ({"stance_share": (0.3, 1.0)}, "stance_share"),
        ({"wobble_m": -1.0}, "wobble_m"),
        ({"rest_wobble_share": 2.0}, "rest_wobble_share"),
        ({"sensor_m": (np.inf, 0.0)}, "sensor_m"),
    ],
)
def test_a_gait_that_nobody_has_is_refused_by_name(change, thing):
    with pytest.raises(InputError, match=thing):
        replace(GAIT, **change)


def test_a_walk_that_cannot_be_is_refused():
    draws = drawn(length_m=20.0)
    with pytest.raises(InputError, match="length_m"):
        walked(draws=draws, length_m=20.0)
    with pytest.raises(InputError, match="first_rest_s"):
        walk(GAIT, drawn(), length_m=400.0, first_rest_s=0.0, last_rest_s=1.0, pause_s=np.zeros((WORLDS, 4)))
    with pytest.raises(InputError, match="pause_s"):
        walked(pause_s=-1.0)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    slow=st.floats(0.5, 1.2),
    deviation=st.floats(0, 0.29),
    pauses=st.integers(0, 3),
    share=st.floats(0.3, 1.0),
)
def test_any_gait_walks_the_whole_way_in_order(seed, slow, deviation, pauses, share):
    gait = replace(GAIT, speed_m_per_s=(slow, 1.3), length_deviation=deviation, end_share=share)
    draws = draw_gait(np.random.default_rng(seed), gait, length_m=200.0, pauses=pauses)
    plan = walk(gait, draws, length_m=200.0, first_rest_s=3.0, last_rest_s=2.0, pause_s=np.full(pauses, 4.0))
    there = np.isfinite(plan.distance_m)
    assert plan.distance_m[there][-1] == pytest.approx(200, abs=1e-9)
    assert (np.diff(plan.distance_m[there]) > 0).all()
    assert (np.diff(plan.stance_time_s[there].reshape(-1)) > 0).all()
    assert plan.resting.sum() == pauses + 2
    assert np.flatnonzero(there)[-1] == there.sum() - 1
