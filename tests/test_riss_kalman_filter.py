"""The Kalman filter for RISS and WiFi: consistent in its own world, batch least squares on a line."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.stats import chi2
from sklearn.base import BaseEstimator

from algorithms.tracking.fingerprint_alone import FingerprintAlone
from algorithms.tracking.riss_kalman_filter import RissKalmanFilter
from positioning.errors import InputError
from positioning.inertial.riss import increments, move
from positioning.model import Array, Calibration, Recording, Site, Survey, Track

REST_S, STEP_S, SIZE_M = 10, 0.1, 30.0
FIX_M, TURN, SHARE, BIAS, SCALE, HEADING = 3.0, 0.01, 0.1, 0.004, 0.1, 0.05


class Echo(BaseEstimator):  # type: ignore[misc]
    """Fingerprinting of scans that hold the fix itself."""

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> "Echo":
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        return np.asarray(rss_dbm, dtype=float)[:, :2]


def make(**changes: Any) -> RissKalmanFilter:
    """Return a filter whose settings are those of the worlds below."""
    known: dict[str, Any] = {
        "fingerprinting": Echo(),
        "fix_sigma_m": FIX_M,
        "turn_noise_rad_per_sqrt_s": TURN,
        "speed_noise": SHARE,
        "bias_sigma_rad_per_s": BIAS,
        "scale_sigma": SCALE,
        "start_heading_sigma_rad": HEADING,
        "downsampling": 1,
    }
    return RissKalmanFilter(**known | changes)


def surroundings(runs: int) -> tuple[Survey, Site]:
    """Return a map and a site that say nothing."""
    places = np.array([[0.0, 0.0], [SIZE_M, 0.0], [0.0, SIZE_M], [SIZE_M, SIZE_M]])
    return (
        Survey(rss_dbm=np.tile(places, (runs, 1, 1)), position_m=np.tile(places, (runs, 1, 1))),
        Site(corner_m=np.tile([[0.0, 0.0], [SIZE_M, SIZE_M]], (runs, 1, 1))),
    )


def worlds(seed: int, runs: int, states: int = 5, seconds: int = 60) -> tuple[Recording, Array]:
    """Return recordings and true states [r, n, 5] that follow the filter's own model."""
    rng = np.random.default_rng(seed)
    count = round((REST_S + seconds) / STEP_S)
    time_s = (np.arange(count) + 0.5) * STEP_S
    drives = time_s > REST_S
    speed = np.where(drives, 0.8 + 0.2 * np.sin(time_s), 0.0)
    phase = rng.uniform(0, 6, (runs, 1))
    gyro = np.where(drives, 0.3 * np.sin(0.2 * time_s + phase), 0.0)
    recording = Recording(
        time_s=np.tile(np.arange(REST_S, REST_S + seconds + 1.0), (runs, 1)),
        motion_time_s=np.tile(time_s, (runs, 1)),
        gyro_rad_per_s=gyro,
        odometer_m_per_s=np.tile(speed, (runs, 1)),
        start_heading_rad=rng.uniform(-3, 3, runs),
    )
    steps = increments(recording)
    assert recording.start_heading_rad is not None
    state = np.zeros((runs, 5))
    state[:, :2] = rng.uniform(0, SIZE_M, (runs, 2))
    state[:, 2] = recording.start_heading_rad + HEADING * rng.standard_normal(runs)
    state[:, 4] = 1.0
    if states == 5:
        state[:, 3] = BIAS * rng.standard_normal(runs)
        state[:, 4] += SCALE * np.clip(rng.standard_normal(runs), -3, 3)
    truth = np.empty((*recording.time_s.shape, 5))
    for epoch in range(truth.shape[1]):
        if epoch:
            turned, longer = TURN * rng.standard_normal(runs), SHARE * rng.standard_normal(runs)
            ahead, aside = np.cos(turned / 2), np.sin(turned / 2)
            forward = (1 + longer) * steps.forward_m[:, epoch]
            left = (1 + longer) * steps.left_m[:, epoch]
            state = move(
                state,
                steps.turn_rad[:, epoch] + turned,
                ahead * forward - aside * left,
                aside * forward + ahead * left,
                1.0,
            ).state
        truth[:, epoch] = state
    fix_m = truth[..., :2] + FIX_M * rng.standard_normal((*truth.shape[:2], 2))
    return replace(recording, rss_dbm=fix_m), truth


def run(recording: Recording, algorithm: Any = None, survey: Survey | None = None) -> Track:
    """Track a stack."""
    known, site = surroundings(len(recording.time_s))
    tracker = make() if algorithm is None else algorithm
    rngs = [np.random.default_rng(n) for n in range(len(recording.time_s))]
    return tracker.track_stack(recording, known if survey is None else survey, site, rngs)  # type: ignore[no-any-return]


def nees(found: Track, truth: Array) -> Array:
    """Return the normalised error squared of each epoch, [r, n]."""
    offset = found.position_m - truth[..., :2]
    solved = np.linalg.solve(found.covariance_m2, offset[..., None])
    return np.asarray((offset[..., None, :] @ solved)[..., 0, 0])


@pytest.mark.parametrize("states", [3, 5])
def test_errors_are_as_large_as_the_covariance_says(states: int) -> None:
    runs = 400
    recording, truth = worlds(6, runs, states)
    found = nees(run(recording, make(states=states)), truth)
    low, high = chi2(2 * runs).ppf([1e-3, 1 - 1e-3]) / runs
    # Independent runs, at epochs far from each other.
    for epoch in (1, 10, 30, 60):
        assert low < found[:, epoch].mean() < high, epoch
    # And it would show: noise that is half or twice as large.
    for wrong in (FIX_M / 1.5, FIX_M * 1.5):
        other = nees(run(recording, make(states=states, fix_sigma_m=wrong)), truth)
        assert not low < other[:, 60].mean() < high


def test_bias_and_scale_are_learnt() -> None:
    recording, truth = worlds(7, 200, seconds=150)
    found = run(recording)
    for name, part, sigma in (("gyro_bias_rad_per_s", 3, BIAS), ("odometer_scale", 4, SCALE)):
        error = found.extra[name][:, -1] - truth[:, -1, part]
        assert np.sqrt(np.mean(error**2)) < 0.6 * sigma
        np.testing.assert_array_equal(found.extra[name][:, 0], 0.0 if part == 3 else 1.0)
    error_m = [
        np.sqrt(np.mean((run(recording, make(states=states)).position_m - truth[..., :2]) ** 2))
        for states in (3, 5)
    ]
    assert error_m[1] < 0.9 * error_m[0]


def test_on_a_line_it_equals_batch_least_squares() -> None:
    rng = np.random.default_rng(3)
    epochs, step_m = 9, 0.7
    recording = Recording(
        time_s=np.arange(epochs, dtype=float)[None],
        motion_time_s=(np.arange(80) * STEP_S)[None] + STEP_S / 2,
        gyro_rad_per_s=np.zeros((1, 80)),
        odometer_m_per_s=np.full((1, 80), step_m),
        start_heading_rad=np.zeros(1),
        rss_dbm=np.stack([step_m * np.arange(epochs), np.full(epochs, 4.0)], -1)[None]
        + rng.normal(0, FIX_M, (1, epochs, 2)),
    )
    fix_m = recording.rss_dbm
    assert fix_m is not None
    track = run(recording, make(states=3, turn_noise_rad_per_sqrt_s=0.0, start_heading_sigma_rad=0.0))
    # All places along the line are jointly Gaussian; the first fix is the start.
    walk = (SHARE * step_m) ** 2
    prior = FIX_M**2 + walk * np.minimum.outer(np.arange(1, epochs), np.arange(1, epochs))
    seen = prior + FIX_M**2 * np.eye(epochs - 1)
    expected = fix_m[0, 0, 0] + step_m * np.arange(1, epochs)
    gain = prior[-1] @ np.linalg.inv(seen)
    assert track.position_m[0, -1, 0] == pytest.approx(expected[-1] + gain @ (fix_m[0, 1:, 0] - expected))
    assert track.covariance_m2[0, -1, 0, 0] == pytest.approx(prior[-1, -1] - gain @ prior[-1])
    # Aside there is no noise: the mean of all fixes.
    np.testing.assert_allclose(
        track.position_m[0, :, 1], np.cumsum(fix_m[0, :, 1]) / np.arange(1, epochs + 1)
    )
    np.testing.assert_allclose(track.covariance_m2[0, :, 1, 1], FIX_M**2 / np.arange(1, epochs + 1))


def test_five_states_without_doubt_are_three() -> None:
    recording, _ = worlds(8, 5)
    three = run(recording, make(states=3))
    five = run(recording, make(states=5, bias_sigma_rad_per_s=0.0, scale_sigma=0.0))
    np.testing.assert_allclose(five.position_m, three.position_m, atol=1e-9)
    np.testing.assert_allclose(five.covariance_m2, three.covariance_m2, atol=1e-9)
    assert set(three.extra) == {"heading_rad"}


@settings(max_examples=10, deadline=None)
@given(st.floats(-3, 3), st.floats(-20, 20), st.floats(-20, 20))
def test_turning_and_shifting_the_world_turns_and_shifts_the_track(angle: float, x: float, y: float) -> None:
    recording, _ = worlds(9, 2, seconds=20)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    assert recording.rss_dbm is not None
    assert recording.start_heading_rad is not None
    other = replace(
        recording,
        rss_dbm=recording.rss_dbm @ turn + [x, y],
        start_heading_rad=recording.start_heading_rad + angle,
    )
    first, second = run(recording), run(other)
    np.testing.assert_allclose(second.position_m, first.position_m @ turn + [x, y], atol=1e-8)
    np.testing.assert_allclose(second.covariance_m2, turn.T @ first.covariance_m2 @ turn, atol=1e-8)


def resting(fix_m: list[Any], **more: Any) -> Recording:
    """Return a stack of one that rests for two of its five epochs and then drives east, a metre each."""
    speed = np.repeat([0.0, 1.0], [10, 30])
    known: dict[str, Any] = {
        "time_s": np.arange(5.0)[None],
        "motion_time_s": (np.arange(40) * STEP_S)[None] + STEP_S / 2,
        "gyro_rad_per_s": np.zeros((1, 40)),
        "odometer_m_per_s": speed[None],
        "start_heading_rad": np.zeros(1),
        "rss_dbm": np.array([[(np.nan, np.nan) if fix is None else fix for fix in fix_m]], dtype=float),
    }
    return Recording(**known | more)


def test_it_starts_at_the_mean_of_the_fixes_before_it_moves() -> None:
    found = run(resting([(1, 2), (3, 4), None, None, None]))
    np.testing.assert_allclose(found.position_m[0], [[1, 2], [2, 3], [3, 3], [4, 3], [5, 3]], atol=1e-9)
    # As sure as one fix while it stands, and less afterwards.
    variance = found.covariance_m2[0, :, 0, 0]
    np.testing.assert_allclose(variance[:2], FIX_M**2)
    assert (np.diff(variance[1:]) > 0).all()


def test_no_fix_is_refused() -> None:
    found = run(resting([(0, 0), (0, 0), (500, 0), None, None])).position_m[0, 2, 0]
    # A Kalman gain of one half, nearly.
    assert 240 < found < 260


def test_without_any_fix_it_reckons_from_the_middle_of_the_map() -> None:
    found = run(resting([None] * 5))
    np.testing.assert_allclose(
        found.position_m[0], SIZE_M / 2 + np.array([[0, 0], [0, 0], [1, 0], [2, 0], [3, 0]]), atol=1e-9
    )
    assert (found.covariance_m2[0, :, 0, 0] >= SIZE_M**2 / 4).all()


def test_the_first_fix_may_come_late() -> None:
    found = run(resting([None, None, None, (7, 8), None]))
    np.testing.assert_allclose(found.position_m[0, 3], [7, 8], atol=0.5)
    assert found.covariance_m2[0, 3, 0, 0] == pytest.approx(FIX_M**2, rel=0.05)


def test_a_gyroscope_that_is_biased_at_rest_changes_nothing() -> None:
    plain, biased = resting([(1, 2)] * 5), resting([(1, 2)] * 5, gyro_rad_per_s=np.full((1, 40), 0.2))
    np.testing.assert_allclose(run(biased).position_m, run(plain).position_m, atol=1e-9)


STACK, _ = worlds(10, 4, seconds=30)


def ragged() -> tuple[Recording, tuple[int, ...]]:
    """Return runs of different length, one with silent epochs."""
    assert STACK.rss_dbm is not None
    lengths = (31, 12, 31, 1)
    time_s, rss_dbm = STACK.time_s.copy(), STACK.rss_dbm.copy()
    for row, length in enumerate(lengths):
        time_s[row, length:], rss_dbm[row, length:] = np.nan, np.nan
    rss_dbm[2, ::3] = np.nan
    return replace(STACK, time_s=time_s, rss_dbm=rss_dbm), lengths


@pytest.mark.parametrize("states", [3, 5])
def test_a_stack_gives_what_each_recording_gives(states: int) -> None:
    recording, lengths = ragged()
    survey, site = surroundings(4)
    tracker = make(states=states)
    together = run(recording, tracker)
    for row, length in enumerate(lengths):
        alone = tracker.track(
            recording.at(row).until(length), survey.at(row), site.at(row), np.random.default_rng(0)
        )
        np.testing.assert_array_equal(alone.position_m, together.position_m[row, :length])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[row, :length])
        np.testing.assert_array_equal(alone.covariance_m2, np.swapaxes(alone.covariance_m2, -1, -2))
        assert np.linalg.eigvalsh(alone.covariance_m2).min() > 0
        for name, values in together.extra.items():
            np.testing.assert_array_equal(alone.extra[name], values[row, :length])
            assert np.isfinite(values[row, :length]).all()
            assert np.isnan(values[row, length:]).all()
        assert np.isnan(together.position_m[row, length:]).all()
        assert np.isnan(together.covariance_m2[row, length:]).all()


def test_later_scans_leave_no_trace_and_inputs_stay() -> None:
    assert STACK.rss_dbm is not None
    rss_dbm, kept = STACK.rss_dbm.copy(), STACK.rss_dbm.copy()
    rss_dbm[:, 15:] = np.nan
    first, second = run(STACK), run(replace(STACK, rss_dbm=rss_dbm))
    np.testing.assert_array_equal(first.position_m[:, :15], second.position_m[:, :15])
    assert (first.position_m[:, 15] != second.position_m[:, 15]).all()
    np.testing.assert_array_equal(STACK.rss_dbm, kept)


def test_the_noted_place_is_not_used() -> None:
    noted = replace(STACK, start_position_m=np.full((4, 2), 1e3))
    np.testing.assert_array_equal(run(noted).position_m, run(STACK).position_m)


def radio_world(seed: int) -> tuple[Recording, Survey, Array]:
    """Return one drive through a field of access points, its map, and its true places."""
    rng = np.random.default_rng(seed)
    access_point_m = rng.uniform(0, SIZE_M, (12, 2))

    def strength_dbm(position_m: Array) -> Array:
        distance_m = np.linalg.norm(position_m[..., None, :] - access_point_m, axis=-1)
        return -40 - 30 * np.log10(np.maximum(distance_m, 1.0))

    recording, truth = worlds(seed, 1, seconds=40)
    place_m = truth[..., :2] - truth[:, :1, :2] + SIZE_M / 2
    grid_m = np.stack(np.meshgrid(*2 * (np.arange(-15.0, 46.0, 3.0),)), -1).reshape(-1, 2)
    survey = Survey(rss_dbm=strength_dbm(grid_m)[None], position_m=grid_m[None])
    scan_dbm = strength_dbm(place_m) + rng.normal(0, 4, (*place_m.shape[:2], 12))
    return replace(recording, rss_dbm=np.round(scan_dbm)), survey, place_m


def test_with_its_own_fingerprinting_it_is_better_than_the_fixes() -> None:
    errors = []
    for seed in range(5):
        recording, survey, place_m = radio_world(seed)
        for tracker in (RissKalmanFilter(), RissKalmanFilter(states=3), FingerprintAlone()):
            offset_m = run(recording, tracker, survey).position_m - place_m
            errors.append(np.sqrt(np.mean(offset_m**2)))
    five, three, alone = np.reshape(errors, (5, 3)).mean(axis=0)
    assert max(five, three) < 0.8 * alone


def test_it_says_what_it_lacks() -> None:
    survey, site = surroundings(4)
    tracker = make()
    assert tracker.skip(STACK, survey, site) == ""
    assert tracker.skip(STACK.at(0), survey.at(0), site.at(0)) == ""
    for missing, reason in (
        ("start_heading_rad", "start heading"),
        ("gyro_rad_per_s", "gyro_rad_per_s"),
        ("rss_dbm", "received strengths"),
    ):
        lacking = replace(STACK, **{missing: None})
        assert reason in tracker.skip(lacking, survey, site)
        with pytest.raises(InputError, match=reason):
            run(lacking)
    assert "received strengths" in tracker.skip(replace(STACK, rss_dbm=None).at(0), survey.at(0), site.at(0))
    calibration = Calibration(distance_m=np.ones((4, 3)), rss_dbm=np.ones((4, 3)))
    for other in (None, calibration):
        assert "survey" in tracker.skip(STACK, other, site)
    # Four columns are asked of a map that has two.
    assert "4" in RissKalmanFilter().skip(STACK, survey, site)


def test_bad_input_is_refused() -> None:
    time_s = STACK.time_s.copy()
    time_s[0, 3] = time_s[0, 2]
    with pytest.raises(InputError, match="does not increase"):
        run(replace(STACK, time_s=time_s))
    for setting in (
        {"states": 4},
        {"fix_sigma_m": 0.0},
        {"turn_noise_rad_per_sqrt_s": -1.0},
        {"speed_noise": np.nan},
        {"bias_sigma_rad_per_s": -1.0},
        {"scale_sigma": 0.6},
        {"start_heading_sigma_rad": -0.1},
        {"downsampling": 0},
    ):
        with pytest.raises(InputError, match=next(iter(setting))):
            run(STACK, make(**setting))
