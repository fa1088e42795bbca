"""Foot navigation and its steps against known walks, invariances, and one by one against stacked."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.inertial.foot import FootNavigation, Start, foot_navigation
from positioning.inertial.foot_alignment import late_alignment, rests
from positioning.inertial.foot_checks import check_imu, imu_missing, sample_rate_hz
from positioning.inertial.foot_plan import Fixes
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.foot_steps import Steps, aligned, misalignment_rad, steps
from positioning.inertial.strapdown import GRAVITY_M_PER_S2, attitude_of, readings
from positioning.model import Array, Recording, Site

RATE_HZ, STRIDE_M, STRIDES, REST_S = 100.0, 1.3, 12, 4.0
FIELD_UT = 48.0
FORCE_NOISE = 0.002
"""Of an accelerometer on its data sheet, m/s^2/sqrt(Hz); the filter assumes ten times that on purpose."""
SITE = Site(corner_m=np.tile([[-50.0, -50.0], [50.0, 50.0]], (1, 1, 1)), magnetic_north_rad=np.array([0.5]))


def path(
    turn_rad: float, mount_rad: float, heading_rad: float, strides: int = STRIDES
) -> tuple[Array, Array, Array, Array]:
    """Return position, velocity, attitude and rest of a foot: a rest, strides, and a rest."""
    time_s = np.arange(0, 2 * REST_S + 1.2 * strides + 1e-9, 1 / RATE_HZ)
    walked = np.clip(time_s - REST_S, 0, 1.2 * strides)
    number, within = np.floor(walked / 1.2), np.minimum(walked % 1.2, 0.7) / 0.7
    last = number >= strides
    number[last], within[last] = strides - 1, 1.0
    share = within - np.sin(2 * np.pi * within) / (2 * np.pi)
    swinging = (within > 0) & (within < 1)
    speed = np.where(swinging, STRIDE_M / 0.7 * (1 - np.cos(2 * np.pi * within)), 0.0)
    climb = np.where(swinging, 0.8 * np.sin(2 * np.pi * within) * (1 - np.cos(2 * np.pi * within)), 0.0)
    # Straight within a stride; the heading of a foot turns with it.
    way = heading_rad + turn_rad * number
    velocity = np.stack([speed * np.cos(way), speed * np.sin(way), climb], axis=-1)
    turned = heading_rad + turn_rad * (number + np.where(number < strides - 1, share, 0.0))
    lift = 0.7 * np.sin(2 * np.pi * within) * (1 - np.cos(2 * np.pi * within)) / 2
    attitude = attitude_of(0.05, 0.3 + lift, turned - mount_rad)
    middle = 0.5 * (velocity[1:] + velocity[:-1]) / RATE_HZ
    place = np.concatenate([np.zeros((1, 3)), np.cumsum(middle, axis=0)])
    return place, velocity, attitude, ~swinging


def walk(
    turn_rad: float = 0.0,
    mount_rad: float = 0.0,
    heading_rad: float = 0.3,
    noise: float = 0.0,
    rate_bias: Any = 0.0,
    seed: int = 1,
) -> tuple[Recording, Array, Array]:
    """Return a stack of one recording, the true places [i, 3], and the true rests [i]."""
    place, velocity, attitude, rest = path(turn_rad, mount_rad, heading_rad)
    force, rate = readings(velocity, attitude, 1 / RATE_HZ)
    rng = np.random.default_rng(seed)
    field = np.array([0.4 * np.cos(0.5), 0.4 * np.sin(0.5), -np.sqrt(0.84)]) * FIELD_UT
    magnetic = (attitude[1:].swapaxes(1, 2) @ field[:, None])[..., 0]
    time_s = 10.0 + np.arange(1, len(place)) / RATE_HZ
    recording = Recording(
        time_s=np.arange(10.0, time_s[-1])[None],
        imu_time_s=time_s[None],
        specific_force_m_per_s2=(force + 0.3 * noise * rng.normal(size=force.shape))[None],
        angular_rate_rad_per_s=(rate + rate_bias + 0.05 * noise * rng.normal(size=rate.shape))[None],
        magnetic_field_ut=(magnetic + 3 * noise * rng.normal(size=force.shape))[None],
    )
    return recording, place[1:], rest[1:]


def stack(*recordings: Recording) -> Recording:
    """Join recordings of one; the shorter are filled up with NaN."""
    joined = {}
    for name in (
        "time_s",
        "imu_time_s",
        "specific_force_m_per_s2",
        "angular_rate_rad_per_s",
        "magnetic_field_ut",
    ):
        parts = [getattr(one, name)[0] for one in recordings]
        most = max(len(part) for part in parts)
        filled = [
            np.concatenate([part, np.full((most - len(part), *part.shape[1:]), np.nan)]) for part in parts
        ]
        joined[name] = np.stack(filled)
    return Recording(**joined)


def shortened(recording: Recording, count: int) -> Recording:
    names = ("imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s", "magnetic_field_ut")
    return replace(recording, **{name: getattr(recording, name)[:, :count] for name in names})


def many(site: Site, count: int) -> Site:
    return Site(**{k: None if v is None else np.repeat(v, count, axis=0) for k, v in vars(site).items()})


@pytest.mark.parametrize("states", [9, 15])
@pytest.mark.parametrize("magnetometer", [True, False])
def test_a_walk_without_noise_is_found_again(states: int, magnetometer: bool) -> None:
    recording, place, rest = walk(turn_rad=0.15, heading_rad=0.7)
    found = foot_navigation(
        recording, SITE, FootFilter(states=states, magnetometer=magnetometer), rest=rest[None]
    )
    # Without a magnetometer the frame is that of the first heading.
    turn = 0.0 if magnetometer else -0.7
    east, north = np.cos(turn), np.sin(turn)
    expected = place[:, :2] @ [[east, north], [-north, east]]
    np.testing.assert_allclose(found.position_m[0, :, :2], expected, atol=0.01)
    assert np.ptp(found.position_m[0, rest, 2]) < 0.01
    assert found.heading_rad[0, 0] == pytest.approx(0.7 + turn, abs=1e-3)
    made = steps(found)
    assert made.time_s.shape == (1, STRIDES)
    np.testing.assert_allclose(made.forward_m[0, 1:-1], STRIDE_M, atol=0.01)
    np.testing.assert_allclose(made.turn_rad[0, :-1], 0.15, atol=5e-3)


@pytest.mark.parametrize("detector", ["acceleration_magnitude", "shoe", "angular_rate_energy"])
def test_detectors_count_the_strides_of_a_clean_walk(detector: str) -> None:
    recording, place, rest = walk(noise=0.05)
    found = foot_navigation(recording, SITE, FootFilter(detector=detector))
    assert np.count_nonzero(~np.isnan(steps(found).time_s)) == STRIDES
    # The band tells of a rest after a fifth of a second.
    assert np.mean(found.rest[0] == rest) > 0.85
    np.testing.assert_array_equal(found.rest, rests(recording, FootFilter(detector=detector)))
    assert np.linalg.norm(found.position_m[0, -1, :2] - place[-1, :2]) < 0.5


def test_zero_velocity_updates_are_what_keeps_the_error_small() -> None:
    recording, place, rest = walk(noise=0.2, rate_bias=0.02)
    errors = {}
    for name, choice in {"with": {}, "without": {"zero_velocity": False}}.items():
        found = foot_navigation(recording, SITE, FootFilter(**choice), rest=rest[None])
        errors[name] = np.linalg.norm(found.position_m[0, -1, :2] - place[-1, :2])
    assert errors["with"] < 0.4
    assert errors["without"] > 5 * errors["with"]


@pytest.mark.parametrize("states", [9, 15])
def test_the_first_rest_takes_off_the_bias_of_the_gyroscope(states: int) -> None:
    clean, _place, rest = walk()
    biased, *_ = walk(rate_bias=np.array([0.03, -0.02, 0.04]))
    options = FootFilter(states=states, magnetometer=False)
    expected = foot_navigation(clean, SITE, options, rest=rest[None])
    found = foot_navigation(biased, SITE, options, rest=rest[None])
    np.testing.assert_allclose(found.position_m, expected.position_m, atol=1e-6)
    untold = foot_navigation(biased, SITE, replace(options, bias_rest_s=1e9), rest=rest[None])
    assert np.abs(untold.position_m - expected.position_m).max() > 0.1


def test_the_heading_comes_from_the_magnetometer_and_turns_everything() -> None:
    recording, _place, rest = walk(turn_rad=0.1, noise=0.1)
    base = foot_navigation(recording, SITE, FootFilter(), rest=rest[None])
    for off in (
        foot_navigation(
            recording, replace(SITE, magnetic_north_rad=np.array([1.7])), FootFilter(), rest=rest[None]
        ),
        foot_navigation(recording, SITE, FootFilter(heading_offset_rad=1.2), rest=rest[None]),
    ):
        turned = base.position_m[0, :, 0] + 1j * base.position_m[0, :, 1]
        turned = turned * np.exp(1.2j)
        np.testing.assert_allclose(off.position_m[0, :, 0], turned.real, atol=1e-8)
        np.testing.assert_allclose(off.position_m[0, :, 1], turned.imag, atol=1e-8)
        away = np.angle(np.exp(1j * (off.heading_rad - base.heading_rad - 1.2)))
        np.testing.assert_allclose(away, 0.0, atol=1e-8)


def test_the_magnetometer_stops_the_drift_of_the_heading_unless_gated() -> None:
    recording, _place, rest = walk()
    drifting = replace(recording, angular_rate_rad_per_s=recording.angular_rate_rad_per_s.copy())
    drifting.angular_rate_rad_per_s[0, 400:, 2] += 0.02
    strong = {"magnetic_heading_noise_rad": 0.01, "rate_noise_rad_per_s_per_rt_hz": 0.01}
    error = {}
    for name, choice in {"with": {}, "without": {"magnetometer": False}}.items():
        found = foot_navigation(
            drifting, SITE, FootFilter(**strong, **choice), rest=rest[None], start=Start(heading_rad=[0.3])
        )
        error[name] = abs(found.heading_rad[0, -1] - 0.3)
    assert error["without"] > 0.25
    assert error["with"] < 0.06
    assert (
        foot_navigation(drifting, SITE, FootFilter(**strong), rest=rest[None]).heading_variance_rad2[0, -1]
        < 4e-4
    )
    # A field of another magnitude after the alignment does not count.
    disturbed = replace(drifting, magnetic_field_ut=drifting.magnetic_field_ut.copy())
    disturbed.magnetic_field_ut[0, 400:] = 1.3 * np.roll(disturbed.magnetic_field_ut[0, 400:], 1, axis=-1)
    gated = foot_navigation(
        disturbed,
        SITE,
        FootFilter(**strong),
        rest=rest[None],
        start=Start(heading_rad=[0.3], heading_error_rad=[0.001]),
    )
    without = foot_navigation(
        drifting,
        SITE,
        FootFilter(magnetometer=False, rate_noise_rad_per_s_per_rt_hz=0.01),
        rest=rest[None],
        start=Start(heading_rad=[0.3]),
    )
    np.testing.assert_allclose(gated.position_m, without.position_m, atol=1e-8)


def test_gaps_in_the_magnetic_field_do_no_harm() -> None:
    recording, place, rest = walk(noise=0.05)
    recording.magnetic_field_ut[0, ::3] = np.nan
    found = foot_navigation(recording, SITE, FootFilter(), rest=rest[None])
    np.testing.assert_allclose(found.position_m[0, -1, :2], place[-1, :2], atol=0.5)
    recording.magnetic_field_ut[...] = np.nan
    without = foot_navigation(recording, SITE, FootFilter(), rest=rest[None])
    expected = foot_navigation(recording, SITE, FootFilter(magnetometer=False), rest=rest[None])
    np.testing.assert_array_equal(without.position_m, expected.position_m)


@settings(max_examples=10, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-0.6, 0.6), st.floats(0.0, 0.1))
def test_steps_do_not_depend_on_where_the_walk_leads(heading: float, mount: float, turn: float) -> None:
    recording, _place, rest = walk(turn_rad=turn, mount_rad=mount, heading_rad=heading)
    made = steps(foot_navigation(recording, SITE, FootFilter(magnetometer=False), rest=rest[None]))
    other, *_ = walk(turn_rad=turn, mount_rad=mount, heading_rad=0.0)
    expected = steps(foot_navigation(other, SITE, FootFilter(magnetometer=False), rest=rest[None]))
    for one, two in zip(made, expected, strict=True):
        np.testing.assert_allclose(one, two, atol=1e-6)
    # The walk leads along the mounting angle, in the frame of the sensor (a foot turns within its steps).
    assert misalignment_rad(made)[0] == pytest.approx(mount, abs=0.01)
    straight = aligned(made, misalignment_rad(made))
    np.testing.assert_allclose(straight.left_m[0, :5], 0.0, atol=0.03)
    np.testing.assert_allclose(
        np.hypot(straight.forward_m, straight.left_m), np.hypot(made.forward_m, made.left_m), atol=1e-12
    )


def test_misalignment_by_hand() -> None:
    made = Steps(
        time_s=np.array([[1.0, 2.0, 3.0, 4.0]]),
        forward_m=np.array([[0.1, 1.0, 1.0, -9.0]]),
        left_m=np.array([[-0.1, 1.0, 1.0, 9.0]]),
        turn_rad=np.array([[0.0, 0.0, 0.9, 0.0]]),
    )
    assert misalignment_rad(made, count=1)[0] == pytest.approx(np.pi / 4)
    assert misalignment_rad(made, count=2)[0] == pytest.approx(np.arctan2(10.0, -8.0))
    turned = aligned(made, [np.pi / 4])
    np.testing.assert_allclose([turned.forward_m[0, 1], turned.left_m[0, 1]], [np.sqrt(2), 0.0], atol=1e-12)
    none = Steps(*(np.zeros((2, 0)) for _ in range(4)))
    np.testing.assert_array_equal(misalignment_rad(none), [0.0, 0.0])


def test_a_stack_gives_what_one_gives() -> None:
    made = [walk(turn_rad=0.02 * n, noise=0.1, seed=n) for n in range(3)]
    short = shortened(made[1][0], 1500)
    joined = stack(made[0][0], short, made[2][0])
    fix_m = np.full((*joined.time_s.shape, 2), np.nan)
    fix_m[:, 5::7] = 1.0
    fixes = Fixes(fix_m, np.tile(4 * np.eye(2), (*joined.time_s.shape, 1, 1)))
    for states in (9, 15):
        options = FootFilter(states=states)
        found = foot_navigation(joined, many(SITE, 3), options, fixes=fixes)
        asked = found.at(joined.time_s)
        for row, recording in enumerate((made[0][0], short, made[2][0])):
            own = Fixes(fixes.position_m[row : row + 1], fixes.covariance_m2[row : row + 1])
            alone = foot_navigation(recording, SITE, options, fixes=own)
            count = alone.time_s.shape[1]
            for name in (
                "position_m",
                "heading_rad",
                "rest",
                "position_covariance_m2",
                "heading_variance_rad2",
            ):
                one, stacked = getattr(alone, name)[0], getattr(found, name)[row]
                np.testing.assert_array_equal(one, stacked[:count], err_msg=name)
                if stacked.dtype != bool:
                    assert np.isnan(stacked[count:]).all()
            np.testing.assert_array_equal(alone.at(recording.time_s).position_m[0], asked.position_m[row])


def test_fixes_pull_the_navigation_and_its_covariance() -> None:
    recording, place, rest = walk()
    epochs = recording.time_s.shape
    fix_m, spread = np.full((*epochs, 2), np.nan), np.tile(0.25 * np.eye(2), (*epochs, 1, 1))
    fix_m[0, 1] = 3.0, -1.0
    start = Start(position_m=[[1.0, 1.0]], covariance_m2=[0.75 * np.eye(2)])
    found = foot_navigation(
        recording, SITE, FootFilter(), rest=rest[None], fixes=Fixes(fix_m, spread), start=start
    )
    # In the rest before anything moves: three quarters of the way, and a quarter of the variance left.
    np.testing.assert_allclose(found.position_m[0, 120, :2], [2.5, -0.5], atol=1e-9)
    np.testing.assert_allclose(found.position_covariance_m2[0, 120], 0.1875 * np.eye(2), atol=1e-9)
    before, after = found.at([[9.0, 10.99, 11.0, np.nan]]).position_m[0, :, 0][[1, 2]]
    assert (before, after) == (pytest.approx(1.0), pytest.approx(2.5))
    np.testing.assert_allclose(found.position_m[0, -1, :2] - place[-1, :2], [2.5, -0.5], atol=0.05)


def test_an_uncertain_heading_is_found_by_fixes() -> None:
    recording, place, rest = walk()
    epochs = recording.time_s
    at = np.searchsorted(recording.imu_time_s[0], epochs[0], side="right") - 1
    fix_m = np.where((at < 0)[:, None], 0.0, place[np.maximum(at, 0), :2])[None]
    fixes = Fixes(fix_m, np.tile(0.04 * np.eye(2), (*epochs.shape, 1, 1)))
    start = Start(heading_rad=[0.0], heading_error_rad=[0.5])
    options = FootFilter(magnetometer=False)
    found = foot_navigation(recording, SITE, options, rest=rest[None], fixes=fixes, start=start)
    assert found.heading_rad[0, -1] == pytest.approx(0.3, abs=0.05)
    assert found.heading_variance_rad2[0, -1] < 0.05**2


def test_two_fixes_between_two_readings_both_count() -> None:
    recording, _place, rest = walk()
    early = replace(recording, time_s=np.array([[11.001, 11.002]]))
    fixes = Fixes(np.full((1, 2, 2), 4.0), np.tile(np.eye(2), (1, 2, 1, 1)))
    start = Start(covariance_m2=[np.eye(2)])
    found = foot_navigation(early, SITE, FootFilter(), rest=rest[None], fixes=fixes, start=start)
    np.testing.assert_allclose(found.position_m[0, 150, :2], 4.0 * 2 / 3, atol=1e-9)


def test_at_holds_the_last_state_and_never_reads_a_later_one() -> None:
    recording, _place, rest = walk()
    found = foot_navigation(
        recording, SITE, FootFilter(), rest=rest[None], start=Start(position_m=[[7.0, 8.0]])
    )
    time_s = found.time_s[0]
    state = found.at([[time_s[0] - 1.0, time_s[700], time_s[700] + 0.004, time_s[-1] + 9.0, np.nan]])
    expected = [[7.0, 8.0, 0.0], found.position_m[0, 700], found.position_m[0, 700], found.position_m[0, -1]]
    np.testing.assert_array_equal(state.position_m[0, :4], expected)
    assert np.isnan(state.position_m[0, 4]).all()
    assert np.isnan(state.heading_rad[0, 4])
    assert state.position_covariance_m2.shape == (1, 5, 2, 2)


def test_steps_are_stored_at_the_first_sample_of_a_rest() -> None:
    rest = np.array([[1, 1, 0, 0, 1, 1, 0, 1], [1, 1, 1, 1, 0, 0, 0, 0]], dtype=bool)
    place = np.stack([np.stack([np.arange(8.0) ** 2, np.zeros(8), np.zeros(8)], axis=-1)] * 2)
    heading = np.zeros((2, 8))
    heading[0, 4:], heading[0, 7] = np.pi / 2, -3.0
    found = steps(
        FootNavigation(
            time_s=np.tile(np.arange(8.0), (2, 1)),
            position_m=place,
            heading_rad=heading,
            rest=rest,
            position_covariance_m2=np.zeros((2, 8, 2, 2)),
            heading_variance_rad2=np.zeros((2, 8)),
            start=None,  # type: ignore[arg-type]
            alignment_end_s=np.zeros(2),
        )
    )
    np.testing.assert_array_equal(found.time_s, [[4.0, 7.0], [np.nan, np.nan]])
    np.testing.assert_allclose(found.forward_m[0], [16.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.left_m[0], [0.0, -33.0], atol=1e-12)
    np.testing.assert_allclose(found.turn_rad[0], [np.pi / 2, 2 * np.pi - 3.0 - np.pi / 2], atol=1e-12)


@pytest.mark.parametrize("shift_s", [-1000.0, 1000.0])
def test_clocks_that_do_not_overlap_are_refused(shift_s: float) -> None:
    recording, *_ = walk()
    with pytest.raises(InputError, match=r"time_s\[0\]: the epochs are from .* readings from 10"):
        foot_navigation(replace(recording, time_s=recording.time_s + shift_s), SITE, FootFilter())


@pytest.mark.parametrize("north", [np.inf, 70.0])
def test_magnetic_north_in_degrees_is_refused(north: float) -> None:
    recording, *_ = walk()
    with pytest.raises(InputError, match=r"magnetic_north_rad: .*degrees"):
        foot_navigation(recording, replace(SITE, magnetic_north_rad=np.array([north])), FootFilter())


def test_the_end_of_the_alignment_is_told_and_a_late_one_named() -> None:
    recording, _, rest = walk()
    first = np.argmin(rest)
    found = foot_navigation(recording, SITE, FootFilter(), rest=rest[None])
    assert recording.imu_time_s is not None
    np.testing.assert_array_equal(found.alignment_end_s, recording.imu_time_s[:, first - 1])
    assert late_alignment(recording, FootFilter()) == ""
    # A whole walk behind it, and the last rest is the only long one.
    force = np.array(recording.specific_force_m_per_s2)
    force[0, : rest.size - 300, 0] += 30.0 * (np.arange(rest.size - 300) % 2)
    reason = late_alignment(replace(recording, specific_force_m_per_s2=force), FootFilter())
    assert reason.startswith("recording[0]: the first rest of 1 s begins at")
    assert late_alignment(replace(recording, specific_force_m_per_s2=0 * force), FootFilter()) == ""


def changed(name: str, where: Any, value: Any) -> Recording:
    recording, *_ = walk(noise=0.05)
    values = getattr(recording, name).copy()
    values[where] = value
    return replace(recording, **{name: values})


@pytest.mark.parametrize(
    ("name", "where", "value", "message"),
    [
        ("imu_time_s", (0, 50), np.nan, "imu_time_s.*a time before is missing"),
        ("imu_time_s", (0, 50), np.inf, "infinite"),
        ("imu_time_s", (0, 50), 10.1, "does not increase"),
        ("imu_time_s", (0, slice(900, None)), 1e3 + 0.01 * np.arange(1340), "no reading for more than"),
        ("specific_force_m_per_s2", (0, 50, 1), np.nan, r"specific_force_m_per_s2\[0, 50, 1\].*finite"),
        ("angular_rate_rad_per_s", (0, 50, 1), np.inf, r"angular_rate_rad_per_s\[0, 50, 1\].*finite"),
        ("specific_force_m_per_s2", (0, slice(500, 508), 0), -60.0, r"\[0, 500, 0\].*at its limit"),
        ("angular_rate_rad_per_s", (0, slice(500, 508), 0), 20.0, r"\[0, 500, 0\].*at its limit"),
        ("angular_rate_rad_per_s", (0, 700, 1), 300.0, "degrees"),
        ("magnetic_field_ut", (0, 5, 1), np.inf, "magnetic_field_ut.*infinite"),
    ],
)
def test_readings_that_cannot_be_used_are_refused(name: str, where: Any, value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        foot_navigation(changed(name, where, value), SITE, FootFilter())


def test_good_readings_are_not_refused() -> None:
    recording, *_ = walk(noise=0.05)
    assert recording.imu_time_s is not None
    np.testing.assert_array_equal(check_imu(recording), [recording.imu_time_s.shape[1]])
    np.testing.assert_allclose(sample_rate_hz(recording), RATE_HZ)
    assert imu_missing(recording) == ""
    # A short touch of the limit is no reason, and equal readings of a unit at rest are none.
    check_imu(changed("specific_force_m_per_s2", (0, slice(500, 503), 0), -60.0))
    check_imu(changed("specific_force_m_per_s2", (0, slice(0, 300), 2), GRAVITY_M_PER_S2))


@pytest.mark.parametrize(
    ("name", "level"),
    [("angular_rate_rad_per_s", 1.5), ("specific_force_m_per_s2", 5.0), ("specific_force_m_per_s2", 8.0)],
)
@pytest.mark.parametrize("side", ["both", "above", "below"])
def test_clipping_is_refused_at_any_level_and_on_either_side(name: str, level: float, side: str) -> None:
    recording, *_ = walk(noise=0.05)
    values = getattr(recording, name)
    middle = np.median(values, axis=(0, 1))
    axis = int(np.argmax(np.ptp(values[0], axis=0)))
    span = {"both": (-level, level), "above": (-np.inf, level), "below": (-level, np.inf)}[side]
    clipped = values.copy()
    clipped[0, :, axis] = middle[axis] + np.clip(values[0, :, axis] - middle[axis], *span)
    with pytest.raises(InputError, match=rf"{name}\[0, \d+, {axis}\].*at its limit"):
        check_imu(replace(recording, **{name: clipped}))


def test_equal_readings_that_are_no_limit_are_not_refused() -> None:
    # One flat run at a low extreme; an axis that rests again and again at what is its extreme; and a side
    # on which the axis hardly leaves its rest.
    recording, *_ = walk(noise=0.05)
    rate = recording.angular_rate_rad_per_s.copy()
    once = rate.copy()
    once[0, 500:510, 0] = 1.01 * np.abs(rate[..., 0]).max()
    resting = rate.copy()
    resting[0, :, 2] = np.where(rate[0, :, 1] > 0.5, 3.0 * rate[0, :, 1], 0.0)
    assert resting[0, :, 2].min() == 0
    for values in (once, resting):
        check_imu(replace(recording, angular_rate_rad_per_s=values))
    still, *_ = walk()
    check_imu(still)


def test_a_force_without_gravity_gets_the_cure() -> None:
    recording, *_ = walk(noise=0.05)
    _, _, attitude, _ = path(0.0, 0.0, 0.3)
    up = attitude[1:, 2] * GRAVITY_M_PER_S2
    moved = recording.specific_force_m_per_s2 - up
    # In m/s^2, in g, and where the median, or what is left in a stance, is that of gravity in g.
    usual = np.median(np.linalg.norm(moved, axis=-1))
    for scale in (1.0, 1 / GRAVITY_M_PER_S2, 1 / usual, 1.5 / usual):
        wrong = replace(recording, specific_force_m_per_s2=scale * moved)
        with pytest.raises(InputError, match="gravity has been taken off") as caught:
            foot_navigation(wrong, SITE, FootFilter())
        assert "with gravity in it" in caught.value.cure


def far(seed: int, worlds: int, wandering: bool, strides: int = 60) -> tuple[Recording, Array, Array]:
    """Return a stack with the noise of the data sheet, true places [i, 3] and rests [i]."""
    rng, own = np.random.default_rng(seed), FootFilter()
    place, velocity, attitude, rest = path(0.1, 0.0, 0.0, strides)
    force, rate = readings(velocity, attitude, 1 / RATE_HZ)
    time_s = np.arange(1, len(place)) / RATE_HZ
    shape = (worlds, *force.shape)
    bias = np.zeros(shape)
    if wandering:
        walk_ = own.rate_bias_walk_rad_per_s_per_rt_s / np.sqrt(RATE_HZ) * rng.normal(size=shape)
        apart = own.rate_bias_rad_per_s * rng.normal(size=(worlds, 1, 3))
        bias = np.cumsum(walk_, axis=1) + np.where((time_s > REST_S)[:, None], apart, 0.0)
        bias += own.rate_turn_on_bias_rad_per_s * rng.normal(size=(worlds, 1, 3))
    read = np.sqrt(RATE_HZ) * rng.normal(size=(2, *shape))
    recording = Recording(
        time_s=np.tile(time_s[::100], (worlds, 1)),
        imu_time_s=np.tile(time_s, (worlds, 1)),
        specific_force_m_per_s2=force + FORCE_NOISE * read[0],
        angular_rate_rad_per_s=rate + own.rate_noise_rad_per_s_per_rt_hz * read[1] + bias,
    )
    return recording, place[1:], rest[1:]


def test_the_variance_of_the_heading_tells_its_error_after_a_longer_walk() -> None:
    worlds = 60
    limit = 3.5 * np.sqrt(2 / worlds)

    def squared(wandering: bool, **choice: Any) -> tuple[float, float]:
        recording, place, rest = far(5, worlds, wandering)
        flags = np.tile(rest, (worlds, 1))
        found = foot_navigation(recording, many(SITE, worlds), FootFilter(**choice), rest=flags)
        true_rad = 0.1 * 59
        error_rad = np.angle(np.exp(1j * (found.heading_rad[:, -1] - true_rad)))
        error_m = found.position_m[:, -1, :2] - place[-1, :2]
        spread = found.position_covariance_m2[:, -1]
        whitened = np.einsum("wi,wij,wj->w", error_m, np.linalg.inv(spread), error_m)
        return float(np.mean(error_rad**2 / found.heading_variance_rad2[:, -1])), float(whitened.mean())

    # Noise alone is what 9 states know of; 15 also know the bias that the first rest leaves.
    for wandering, choice in ((False, {"bias_rest_s": 1e9}), (True, {"states": 15})):
        heading, place = squared(wandering, **choice)
        assert heading == pytest.approx(1, abs=limit), choice
        # The velocity at rest is better than the filter takes it to be.
        assert place < 2 * (1 + limit)
    # With 9 states that bias is missing, unless a random walk that grows as far stands for it.
    assert squared(True)[0] > 5
    own, counted_s = FootFilter(), 0.8 * REST_S
    left = np.hypot(own.rate_bias_rad_per_s, own.rate_noise_rad_per_s_per_rt_hz / np.sqrt(counted_s))
    as_far = float(left * np.sqrt(60 * 1.2 + REST_S))
    assert squared(True, heading_noise_rad_per_rt_s=as_far)[0] == pytest.approx(1, abs=limit)


@pytest.mark.parametrize(
    ("scale", "message"), [(1 / GRAVITY_M_PER_S2, "in g"), (1000 / GRAVITY_M_PER_S2, "in mg")]
)
def test_units_of_gravity_are_recognised(scale: float, message: str) -> None:
    recording, *_ = walk(noise=0.05)
    wrong = replace(recording, specific_force_m_per_s2=scale * recording.specific_force_m_per_s2)  # type: ignore[operator]
    with pytest.raises(InputError, match=message) as caught:
        foot_navigation(wrong, SITE, FootFilter())
    cure = float(caught.value.cure.split()[-1])
    assert cure * scale == pytest.approx(1.0)


def test_missing_parts_and_rests_are_refused() -> None:
    recording, _place, rest = walk(noise=0.05)
    lacking = replace(recording, angular_rate_rad_per_s=None)
    assert "angular_rate_rad_per_s" in imu_missing(lacking)
    with pytest.raises(InputError, match="angular_rate_rad_per_s"):
        check_imu(lacking)
    with pytest.raises(InputError, match=r"no rest of 100.0 s.*the longest is [34]"):
        foot_navigation(recording, SITE, FootFilter(alignment_s=100.0))
    with pytest.raises(InputError, match=r"the longest is 0.00 s"):
        foot_navigation(recording, SITE, FootFilter(), rest=np.zeros_like(rest)[None])
    with pytest.raises(InputError, match="rest"):
        foot_navigation(recording, SITE, FootFilter(), rest=rest[None, 1:])
    with pytest.raises(InputError, match="its shape"):
        check_imu(replace(recording, specific_force_m_per_s2=recording.specific_force_m_per_s2[:, 1:]))  # type: ignore[index]
    fixes = Fixes(np.zeros((1, 3, 2)), np.zeros((1, 3, 2, 2)))
    with pytest.raises(InputError, match="fixes"):
        foot_navigation(recording, SITE, FootFilter(), fixes=fixes)
    epochs = recording.time_s.shape
    with pytest.raises(InputError, match="not positive definite"):
        foot_navigation(
            recording, SITE, FootFilter(), fixes=Fixes(np.zeros((*epochs, 2)), np.zeros((*epochs, 2, 2)))
        )
    with pytest.raises(InputError, match=r"start\.position_m"):
        foot_navigation(recording, SITE, FootFilter(), start=Start(position_m=[[np.nan, 0.0]]))
    with pytest.raises(InputError, match="magnetic_north_rad"):
        foot_navigation(recording, many(SITE, 2), FootFilter())


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"states": 12}, "states=12"),
        ({"detector": "none"}, "detector 'none'"),
        ({"zero_velocity_noise_m_per_s": 0.0}, "zero_velocity_noise_m_per_s=0.0"),
        ({"rate_noise_rad_per_s_per_rt_hz": -1.0}, "below zero"),
        ({"heading_noise_rad_per_rt_s": -1.0}, "heading_noise_rad_per_rt_s=-1.0"),
        ({"rate_turn_on_bias_rad_per_s": float("inf")}, "rate_turn_on_bias_rad_per_s=inf"),
        ({"magnetic_gate": float("nan")}, "magnetic_gate=nan"),
        ({"gravity_m_per_s2": 1.0}, "between 9.7 and 9.9"),
        ({"heading_offset_rad": float("inf")}, "heading_offset_rad=inf"),
        ({"detector_settings": {"width": 1}}, "width"),
    ],
)
def test_senseless_settings_are_refused(choice: Any, message: str) -> None:
    recording, *_ = walk()
    with pytest.raises(InputError, match=message):
        foot_navigation(recording, SITE, FootFilter(**choice))
