"""Expected deviation and the trackers with a foot-mounted unit against their contract and known answers."""

import importlib
import inspect
import itertools
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import BaseEstimator

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation
from algorithms.tracking.control_known_stances import ControlKnownStances, standing
from algorithms.tracking.fingerprint_alone import FingerprintAlone
from algorithms.tracking.foot_cascaded_filter import FootCascadedFilter
from algorithms.tracking.foot_inertial import FootInertial
from algorithms.tracking.foot_joint_filter import FootJointFilter
from positioning.errors import InputError
from positioning.fingerprint_fixes import best_of_three, fingerprint_fixes
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.foot_steps import Steps
from positioning.inertial.strapdown import attitude_of, readings
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth
from positioning.registry import class_name
from positioning.steps import of_extra, of_recording

# Expected deviation


def brute_force_db(
    rss_dbm: Array, position_m: Array, scan_dbm: Array, fill_dbm: float, literal: bool
) -> Array:
    """Return D_p of equation 1 by its sums, [m, p], points in the order of the survey."""
    places = list(dict.fromkeys(map(tuple, position_m.tolist())))
    filled, scans = (
        np.where(np.isnan(rss_dbm), fill_dbm, rss_dbm),
        np.where(np.isnan(scan_dbm), fill_dbm, scan_dbm),
    )
    total = np.zeros((len(scans), len(places)))
    for (m, scan), (p, place), ap in itertools.product(
        enumerate(scans), enumerate(places), range(scans.shape[1])
    ):
        values = filled[(position_m == place).all(axis=1), ap].tolist()
        histogram = {value: values.count(value) / len(values) for value in values}
        for value in values if literal else histogram:
            total[m, p] += abs(scan[ap] - value) * histogram[value]
    return total


def make_survey(seed: int, whole: bool = True) -> tuple[Array, Array, Array]:
    """Return a survey of points with different numbers of scans in any order, and scans to be located."""
    rng = np.random.default_rng(seed)
    point = rng.permutation(np.repeat(np.arange(6), (5, 1, 7, 3, 8, 2)))
    place_m = rng.uniform(0, 20, (6, 2))
    mean_dbm = rng.uniform(-90, -50, (6, 3))
    rss_dbm = mean_dbm[point] + 3 * rng.standard_normal((len(point), 3))
    scan_dbm = mean_dbm[[0, 2, 4, 5]] + 4 * rng.standard_normal((4, 3))
    if whole:
        rss_dbm, scan_dbm = np.round(rss_dbm), np.round(scan_dbm)
    rss_dbm[rng.random(rss_dbm.shape) < 0.2] = np.nan
    scan_dbm[0, 1] = np.nan
    return rss_dbm, place_m[point], scan_dbm


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.booleans(), st.booleans())
def test_deviations_equal_the_sums_of_equation_1(seed: int, literal: bool, whole: bool) -> None:
    rss_dbm, position_m, scan_dbm = make_survey(seed, whole)
    algorithm = ExpectedDeviation(literal=literal, not_heard_dbm=-97.0).fit(rss_dbm, position_m)
    expected = brute_force_db(rss_dbm, position_m, scan_dbm, -97.0, literal)
    np.testing.assert_allclose(algorithm.deviation_db(scan_dbm), expected, rtol=1e-12)
    places = np.array(list(dict.fromkeys(map(tuple, position_m.tolist()))))
    best = np.sort(expected, axis=1)
    clear = best[:, 1] - best[:, 0] > 1e-9
    np.testing.assert_array_equal(
        algorithm.predict(scan_dbm)[clear], places[np.argmin(expected, axis=1)][clear]
    )


def test_both_readings_of_the_index_by_hand() -> None:
    # At the first point half of the scans read -50, the others -60, -70 and -80; at the second all -58.
    rss_dbm = np.array([-50.0, -50, -50, -60, -70, -80, -58, -58])[:, None]
    position_m = np.array([[0.0, 0.0]] * 6 + [[5.0, 0.0]] * 2)
    expected = ExpectedDeviation().fit(rss_dbm, position_m).deviation_db([[-55.0]])
    np.testing.assert_allclose(expected, [[(3 * 5 + 5 + 15 + 25) / 6, 3.0]])
    literal = ExpectedDeviation(literal=True).fit(rss_dbm, position_m).deviation_db([[-55.0]])
    np.testing.assert_allclose(literal, [[3 * 5 / 2 + (5 + 15 + 25) / 6, 6.0]])


def test_the_reading_of_the_index_can_change_the_place() -> None:
    # Spread bins have small frequencies, which count twice in the literal reading.
    spread, narrow = [-42.0, -48.0, -54.0, -60.0], [-44.0, -44.0, -44.0, -44.0]
    rss_dbm, position_m = np.array([spread + narrow]).T, np.repeat([[0.0, 0.0], [9.0, 0.0]], 4, axis=0)
    scan_dbm = np.array([[-49.0]])
    np.testing.assert_array_equal(
        ExpectedDeviation().fit(rss_dbm, position_m).predict(scan_dbm), [[9.0, 0.0]]
    )
    literal = ExpectedDeviation(literal=True).fit(rss_dbm, position_m)
    np.testing.assert_array_equal(literal.predict(scan_dbm), [[0.0, 0.0]])


def test_the_first_of_equally_good_places_is_taken_and_scans_may_stand_in_any_order() -> None:
    rss_dbm, position_m = (
        np.array([[-60.0], [-50.0], [-60.0]]),
        np.array([[9.0, 9.0], [5.0, 5.0], [1.0, 1.0]]),
    )
    located = ExpectedDeviation().fit(rss_dbm, position_m).predict([[-60.0], [-55.0]])
    np.testing.assert_array_equal(located, [[9.0, 9.0], [9.0, 9.0]])
    rss_dbm, position_m, scan_dbm = make_survey(4)
    order = np.argsort(position_m[:, 0], kind="stable")
    np.testing.assert_array_equal(
        ExpectedDeviation().fit(rss_dbm[order], position_m[order]).predict(scan_dbm),
        ExpectedDeviation().fit(rss_dbm, position_m).predict(scan_dbm),
    )


def test_a_survey_of_single_scans_is_the_nearest_neighbour_in_absolute_difference() -> None:
    rng = np.random.default_rng(2)
    rss_dbm, position_m, scan_dbm = (
        rng.normal(-60, 9, (30, 4)),
        rng.uniform(0, 9, (30, 2)),
        rng.normal(-60, 9, (9, 4)),
    )
    nearest = np.argmin(np.abs(scan_dbm[:, None] - rss_dbm).sum(axis=-1), axis=1)
    for literal in (False, True):
        located = ExpectedDeviation(literal=literal).fit(rss_dbm, position_m).predict(scan_dbm)
        np.testing.assert_array_equal(located, position_m[nearest])


def test_a_common_gain_changes_nothing_where_all_is_heard() -> None:
    rng = np.random.default_rng(3)
    rss_dbm, position_m = np.round(rng.normal(-60, 9, (40, 4))), rng.integers(0, 5, (40, 2)).astype(float)
    scan_dbm = np.round(rng.normal(-60, 9, (20, 4)))
    first = ExpectedDeviation().fit(rss_dbm, position_m).predict(scan_dbm)
    np.testing.assert_array_equal(
        ExpectedDeviation().fit(rss_dbm + 7, position_m).predict(scan_dbm + 7), first
    )


def test_what_the_fingerprinting_refuses() -> None:
    rss_dbm, position_m, _ = make_survey(1)
    with pytest.raises(InputError, match="not_heard_dbm=nan"):
        ExpectedDeviation(not_heard_dbm=float("nan")).fit(rss_dbm, position_m)
    with pytest.raises(InputError, match="single place"):
        ExpectedDeviation().leave_one_out(rss_dbm, np.zeros((len(rss_dbm), 2)))


# Best of three


def voted(fixes: list[float | None]) -> list[float | None]:
    """Return the best of three by the rule itself."""
    said: list[float] = []
    result: list[float | None] = []
    for fix in fixes:
        if fix is None:
            result.append(None)
            continue
        said.append(fix)
        last = said[-3:]
        double = [value for value in last if last.count(value) > 1]
        result.append(double[0] if double else fix)
    return result


def as_fixes(values: list[float | None]) -> Array:
    """Return fixes of one recording, [1, n, 2], with these values in both coordinates."""
    return np.array(
        [[[np.nan if v is None else v, np.nan if v is None else 10 + v] for v in values]]
    ).reshape(1, -1, 2)


def test_best_of_three_by_hand() -> None:
    given_m = as_fixes([1, 2, 2, 1, 3, None, 3, 4, 5, 6, None, None, 5])
    expected = as_fixes([1, 2, 2, 2, 3, None, 3, 3, 5, 6, None, None, 5])
    np.testing.assert_array_equal(best_of_three(given_m), expected)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.one_of(st.none(), st.integers(0, 2).map(float)), max_size=12))
def test_best_of_three_is_the_rule(fixes: list[float | None]) -> None:
    np.testing.assert_array_equal(best_of_three(as_fixes(fixes)), as_fixes(voted(fixes)))


def test_best_of_three_goes_recording_by_recording_and_compares_both_coordinates() -> None:
    one, other = as_fixes([1, 1, 2, None]), as_fixes([2, None, 2, 1])
    together = best_of_three(np.concatenate([one, other]))
    np.testing.assert_array_equal(together, np.concatenate([best_of_three(one), best_of_three(other)]))
    near = np.array([[[1.0, 5.0], [1.0, 6.0], [2.0, 7.0]]])
    np.testing.assert_array_equal(best_of_three(near), near)
    with pytest.raises(InputError, match="shape"):
        best_of_three(near[0])


# Joining steps and fixes


RUNS, EPOCHS, LENGTHS = 3, 26, (26, 19, 24)
TRACKERS = ("foot_cascaded_filter", "foot_particle_filter")


class Walked:
    """An inertial filter whose steps stand in the readings: forward, left and turn."""

    def navigation(self, recording: Recording, site: Site) -> Recording:
        """Return the recording, for `steps`."""
        return recording

    def steps(self, navigation: Recording) -> Steps:
        """Return the steps that stand there."""
        assert navigation.imu_time_s is not None
        assert navigation.specific_force_m_per_s2 is not None
        return Steps(navigation.imu_time_s, *np.moveaxis(navigation.specific_force_m_per_s2, -1, 0))


class Coordinates(BaseEstimator):  # type: ignore[misc]
    """A fingerprinting whose first two readings are the place itself, in metres less 100."""

    def fit(self, rss_dbm: Array, position_m: Array) -> "Coordinates":
        """Learn nothing."""
        return self

    def predict(self, rss_dbm: Array) -> Array:
        """Return the place."""
        return np.asarray(rss_dbm[:, :2] + 100.0)


def make_stack(seed: int = 5, fix_sigma_m: float = 1.0) -> tuple[Recording, Survey, Site, Array]:
    """Return recordings of steps with marks between scans, and the true place of each epoch."""
    rng = np.random.default_rng(seed)
    count = 18
    step = np.zeros((RUNS, count, 3))
    step[..., 0], step[..., 1] = 1.3, rng.normal(0.0, 0.05, (RUNS, count))
    step[..., 2] = np.where(np.arange(count) % 7 == 5, 0.8, 0.0) + rng.normal(0, 0.02, (RUNS, count))
    step_time_s = 2.4 + 1.1 * np.arange(count) + rng.uniform(-0.2, 0.2, (RUNS, count))
    step[1, 13:], step_time_s[1, 13:] = np.nan, np.nan
    start_heading = np.array([0.3, -1.5, 2.6])
    heading = start_heading[:, None] + np.cumsum(step[..., 2], axis=1) - step[..., 2]
    moved = np.stack(
        [
            np.cos(heading) * step[..., 0] - np.sin(heading) * step[..., 1],
            np.sin(heading) * step[..., 0] + np.cos(heading) * step[..., 1],
        ],
        axis=-1,
    )
    way_m = np.concatenate([np.zeros((RUNS, 1, 2)), np.cumsum(moved, axis=1)], axis=1)
    time_s = np.tile(0.5 + np.arange(EPOCHS), (RUNS, 1))
    time_s[:, 9::5] -= 0.37
    # A step that ends with a scan.
    step_time_s[0, 4] = time_s[0, 7]
    for run, length in enumerate(LENGTHS):
        time_s[run, length:] = np.nan
    done = np.array([[np.sum(step_time_s[r] <= t) for t in time_s[r]] for r in range(RUNS)])
    true_m = 3.0 + way_m[np.arange(RUNS)[:, None], done]
    rss_dbm = np.full((RUNS, EPOCHS, 3), -60.0)
    rss_dbm[..., :2] = true_m + fix_sigma_m * rng.standard_normal(true_m.shape) - 100
    rss_dbm[:, 9::5] = np.nan
    rss_dbm[0, :3], rss_dbm[1, 0], rss_dbm[2, :5] = np.nan, np.nan, np.nan
    rss_dbm[np.isnan(time_s)] = np.nan
    true_m[np.isnan(time_s)] = np.nan
    places_m = np.stack(np.meshgrid(np.arange(-20.0, 25, 9), np.arange(-20.0, 25, 9)), axis=-1).reshape(-1, 2)
    survey_dbm = np.column_stack([places_m - 100, np.full(len(places_m), -60.0)])
    return (
        Recording(
            time_s=time_s,
            rss_dbm=rss_dbm,
            start_heading_rad=start_heading,
            start_position_m=np.full((RUNS, 2), 3.0),
            imu_time_s=step_time_s,
            specific_force_m_per_s2=step,
            angular_rate_rad_per_s=np.zeros_like(step),
        ),
        Survey(rss_dbm=np.tile(survey_dbm, (RUNS, 1, 1)), position_m=np.tile(places_m, (RUNS, 1, 1))),
        Site(corner_m=np.tile([[-25.0, -25.0], [25.0, 25.0]], (RUNS, 1, 1))),
        true_m,
    )


RECORDING, SURVEY, SITE, TRUE_M = make_stack()
ENDED = np.isnan(RECORDING.time_s)


def rngs(count: int = RUNS) -> list[np.random.Generator]:
    """Return fresh generators."""
    return [np.random.default_rng([8, n]) for n in range(count)]


def algorithm_class(name: str) -> Any:
    """Return the class of a tracker's file."""
    return getattr(importlib.import_module(f"algorithms.tracking.{name}"), class_name(name))


def make_fusion(name: str, **changes: Any) -> Any:
    """Return a tracker of given steps and given fixes."""
    given_parts = {"inertial": Walked(), "fingerprinting": Coordinates()}
    small = {"particles": 300} if name == "foot_particle_filter" else {}
    return algorithm_class(name)(**given_parts | small | changes)


def track(algorithm: Any, recording: Recording = RECORDING, survey: Any = SURVEY, site: Site = SITE) -> Track:
    """Track a stack."""
    return algorithm.track_stack(recording, survey, site, rngs(len(recording.time_s)))  # type: ignore[no-any-return]


def by_the_equations(run: int, algorithm: FootCascadedFilter, fix_m: Array) -> tuple[Array, Array]:
    """Return states and covariances of one recording at its epochs by equations 8 to 23, event by event."""
    assert RECORDING.imu_time_s is not None
    assert RECORDING.specific_force_m_per_s2 is not None
    assert RECORDING.start_heading_rad is not None
    assert algorithm.sigma_wlan_m is not None
    events = [(t, 0, k) for k, t in enumerate(RECORDING.imu_time_s[run]) if np.isfinite(t)]
    events += [(t, 1, n) for n, t in enumerate(RECORDING.time_s[run]) if np.isfinite(t)]
    places_m = SURVEY.position_m[run]
    state = np.array([*places_m.mean(axis=0), RECORDING.start_heading_rad[run]])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.cov(places_m.T, bias=True) + 0.01 * np.eye(2)
    covariance[2, 2] = algorithm.start_heading_sigma_rad**2
    process = np.diag([algorithm.sigma_step_m, algorithm.sigma_step_m, algorithm.sigma_heading_rad]) ** 2
    noise = algorithm.sigma_wlan_m**2 * np.eye(2)
    started, states, covariances = False, [], []
    observe = np.array([[1.0, 0, 0], [0, 1, 0]])
    for _, kind, number in sorted(events):
        if kind == 0:
            forward, left, turn = RECORDING.specific_force_m_per_s2[run, number]
            if not started:
                state[2] += turn
                covariance[2, 2] += algorithm.sigma_heading_rad**2
                continue
            c, s = np.cos(state[2]), np.sin(state[2])
            rotation, derivative = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
            jacobian = np.eye(3)
            jacobian[:2, 2] = derivative @ [forward, left]
            state = np.concatenate([state[:2] + rotation @ [forward, left], [state[2] + turn]])
            covariance = jacobian @ covariance @ jacobian.T + process
            continue
        if np.isfinite(fix_m[number, 0]):
            if started:
                gain = covariance @ observe.T @ np.linalg.inv(observe @ covariance @ observe.T + noise)
                state = state + gain @ (fix_m[number] - state[:2])
                covariance = (np.eye(3) - gain @ observe) @ covariance
            else:
                state[:2], covariance[:2, :2], started = fix_m[number], noise, True
        states.append(state.copy())
        covariances.append(covariance[:2, :2].copy())
    return np.array(states), np.array(covariances)


@pytest.mark.parametrize("vote", [False, True])
def test_the_cascaded_filter_is_that_of_the_equations(vote: bool) -> None:
    filter_ = make_fusion("foot_cascaded_filter", best_of_three=vote, sigma_wlan_m=1.5)
    found = track(filter_)
    fix_m = fingerprint_fixes(Coordinates(), SURVEY, RECORDING)
    fix_m = best_of_three(fix_m) if vote else fix_m
    for run, length in enumerate(LENGTHS):
        states, covariances = by_the_equations(run, filter_, fix_m[run])
        np.testing.assert_allclose(found.position_m[run, :length], states[:, :2], rtol=1e-10)
        np.testing.assert_allclose(found.extra["heading_rad"][run, :length], states[:, 2], rtol=1e-10)
        np.testing.assert_allclose(found.covariance_m2[run, :length], covariances, rtol=1e-9, atol=1e-12)


def test_the_vote_takes_part_in_the_filter() -> None:
    # A constant place but for one scan: the vote takes it off.
    rss_dbm = np.where(np.isnan(RECORDING.rss_dbm), np.nan, np.array([-97.0, -97.0, -60.0]))
    rss_dbm[:, 12, :2] = -80.0
    still = replace(RECORDING, rss_dbm=rss_dbm, specific_force_m_per_s2=np.zeros((RUNS, 18, 3)))
    with_vote, without = (
        track(make_fusion("foot_cascaded_filter", best_of_three=v), still) for v in (True, False)
    )
    np.testing.assert_allclose(with_vote.position_m[:, 6:18], 3.0)
    assert (without.position_m[:, 12:18] > 3.5).all()


@pytest.mark.parametrize("name", TRACKERS)
def test_before_the_first_fix_the_answer_is_the_start_and_never_a_later_state(name: str) -> None:
    found = track(make_fusion(name))
    centre_m = SURVEY.position_m[0].mean(axis=0)
    for run, first in enumerate((3, 1, 5)):
        np.testing.assert_array_equal(found.position_m[run, :first], np.tile(centre_m, (first, 1)))
        spread_m2 = np.cov(SURVEY.position_m[0].T, bias=True) + 0.01 * np.eye(2)
        np.testing.assert_allclose(found.covariance_m2[run, :first], np.tile(spread_m2, (first, 1, 1)))
        assert np.linalg.norm(found.position_m[run, first] - TRUE_M[run, first]) < 4.0
    np.testing.assert_array_equal(found.extra["steps"][:, 0], 0.0)


def test_fixes_alone_take_the_vote_where_they_are_asked_to() -> None:
    repeated = replace(RECORDING, rss_dbm=np.round(RECORDING.rss_dbm, -1))  # type: ignore[arg-type]
    fix_m = fingerprint_fixes(Coordinates(), SURVEY, repeated)
    with_vote = track(FingerprintAlone(fingerprinting=Coordinates(), best_of_three=True), repeated)
    np.testing.assert_array_equal(with_vote.extra["fix_m"], best_of_three(fix_m))
    without = track(FingerprintAlone(fingerprinting=Coordinates()), repeated)
    np.testing.assert_array_equal(without.extra["fix_m"], fix_m)
    assert (with_vote.position_m != without.position_m)[~ENDED].any()


@pytest.mark.parametrize("name", TRACKERS)
def test_silence_leaves_the_start(name: str) -> None:
    silent = replace(RECORDING, rss_dbm=np.full((RUNS, EPOCHS, 3), np.nan))
    found = track(make_fusion(name), silent)
    centre_m = np.broadcast_to(SURVEY.position_m[0].mean(axis=0), (RUNS, EPOCHS, 2))
    np.testing.assert_array_equal(found.position_m[~ENDED], centre_m[~ENDED])


@pytest.mark.parametrize("name", TRACKERS)
def test_the_way_is_found_better_than_by_fixes_alone(name: str) -> None:
    recording, survey, site, true_m = make_stack(seed=9, fix_sigma_m=2.0)
    together = track(
        make_fusion(name, sigma_wlan_m=2.0, start_heading_sigma_rad=0.1), recording, survey, site
    )
    alone = track(FingerprintAlone(fingerprinting=Coordinates()), recording, survey, site)
    error_m = [
        np.nanmean(np.linalg.norm((t.position_m - true_m)[:, 10:], axis=-1)) for t in (together, alone)
    ]
    assert error_m[0] < 0.6 * error_m[1]


@pytest.mark.parametrize("name", TRACKERS)
def test_a_wrong_start_heading_is_unlearnt_where_it_may_be_wrong(name: str) -> None:
    recording, survey, site, true_m = make_stack(seed=2, fix_sigma_m=0.1)
    ends_m = []
    for sigma_rad in (0.5, 1e-6):
        wrong = make_fusion(
            name,
            sigma_wlan_m=0.3,
            start_heading_error_rad=0.7,
            start_heading_sigma_rad=sigma_rad,
            sigma_heading_rad=1e-6,
            sigma_step_m=0.02,
        )
        found = track(wrong, recording, survey, site)
        ends_m.append(np.linalg.norm(found.position_m - true_m, axis=-1)[[0, 1, 2], [25, 18, 23]].mean())
    assert ends_m[0] < 0.25
    assert ends_m[1] > 2 * ends_m[0]


def test_samples_agree_with_the_gaussian_where_all_is_linear() -> None:
    settings_ = {
        "start_heading_sigma_rad": 0.0,
        "sigma_heading_rad": 0.0,
        "sigma_step_m": 0.4,
        "sigma_wlan_m": 1.5,
    }
    exact = track(make_fusion("foot_cascaded_filter", **settings_))
    samples = track(make_fusion("foot_particle_filter", particles=40_000, **settings_))
    np.testing.assert_allclose(samples.position_m, exact.position_m, atol=0.06)
    np.testing.assert_allclose(samples.covariance_m2, exact.covariance_m2, rtol=0.1, atol=0.06)
    np.testing.assert_array_equal(samples.extra["steps"], exact.extra["steps"])
    np.testing.assert_allclose(samples.extra["heading_rad"], exact.extra["heading_rad"], atol=1e-12)


def test_samples_weigh_fixes_by_the_whole_covariance() -> None:
    survey = replace(SURVEY, position_m=SURVEY.position_m @ np.array([[1.1, 0.1], [0.0, 1.1]]))
    settings_ = {
        "start_heading_sigma_rad": 0.0,
        "sigma_heading_rad": 0.0,
        "sigma_step_m": 1.0,
        "sigma_wlan_m": None,
    }
    exact = track(make_fusion("foot_cascaded_filter", **settings_), survey=survey)
    samples = track(make_fusion("foot_particle_filter", particles=40_000, **settings_), survey=survey)
    assert (np.abs(exact.covariance_m2[:, 8, 0, 1]) > 0.5).all()
    np.testing.assert_allclose(samples.position_m[:, 6:], exact.position_m[:, 6:], atol=0.1)


@pytest.mark.parametrize("name", TRACKERS)
def test_a_survey_may_tell_how_far_fixes_are_off(name: str) -> None:
    told = track(make_fusion(name, sigma_wlan_m=None))
    assumed = track(make_fusion(name))
    assert np.isfinite(told.position_m[~ENDED]).all()
    assert (told.position_m != assumed.position_m)[~ENDED].any()


def test_a_turned_world_turns_the_track() -> None:
    angle = 0.83
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert RECORDING.rss_dbm is not None
    assert RECORDING.start_heading_rad is not None
    rss_dbm = RECORDING.rss_dbm.copy()
    rss_dbm[..., :2] = (rss_dbm[..., :2] + 100) @ turn.T - 100
    turned = replace(RECORDING, rss_dbm=rss_dbm, start_heading_rad=RECORDING.start_heading_rad + angle)
    survey = replace(SURVEY, position_m=SURVEY.position_m @ turn.T)
    first, second = (
        track(make_fusion("foot_cascaded_filter")),
        track(make_fusion("foot_cascaded_filter"), turned, survey),
    )
    np.testing.assert_allclose(second.position_m, first.position_m @ turn.T, atol=1e-9)
    np.testing.assert_allclose(second.covariance_m2, turn @ first.covariance_m2 @ turn.T, atol=1e-9)


@pytest.mark.parametrize("name", TRACKERS)
def test_later_scans_and_steps_leave_no_trace(name: str) -> None:
    assert RECORDING.rss_dbm is not None
    assert RECORDING.specific_force_m_per_s2 is not None
    assert RECORDING.imu_time_s is not None
    rss_dbm, step = RECORDING.rss_dbm.copy(), RECORDING.specific_force_m_per_s2.copy()
    rss_dbm[:, 12:] = np.nan
    step[RECORDING.imu_time_s > 12.0] *= 0.5
    first = track(make_fusion(name))
    second = track(make_fusion(name), replace(RECORDING, rss_dbm=rss_dbm, specific_force_m_per_s2=step))
    np.testing.assert_array_equal(first.position_m[:, :12], second.position_m[:, :12])
    assert (first.position_m != second.position_m)[:, 12:19].any(axis=(1, 2)).all()


# The whole way from inertial readings


NAMES = (*TRACKERS, "foot_inertial", "foot_joint_filter", "control_known_stances")
FUSED = tuple(name for name in NAMES if name != "foot_inertial")
RATE_HZ, REST_S, STRIDE_S, SWING_S, STRIDES = 100, 2.5, 1.1, 0.5, 14
MISALIGNMENT_RAD = np.array([0.2, -0.4, 0.1])
WALKED_S = (22.0, 17.0, 19.5)


class Walk(NamedTuple):
    """A stack, and the true stances."""

    recording: Recording
    survey: Survey
    site: Site
    truth: Truth
    stance_m: Array
    swing_end_s: Array


def make_walk(fix_sigma_m: float = 0.5, seed: int = 4) -> Walk:
    """Return faultless readings of feet that stand, swing and turn, and fixes with noise."""
    rng = np.random.default_rng(seed)
    turn = np.zeros((RUNS, STRIDES))
    turn[:, 6:8], turn[:, 10] = np.array([[0.8, 0.7], [-0.6, -0.7], [0.3, 0.2]]), 0.4
    start_rad, swing = np.array([0.3, -2.0, 1.7]), np.arange(STRIDES)
    heading = start_rad[:, None] + np.cumsum(turn, axis=1) - turn
    stance_m = np.concatenate(
        [
            np.zeros((RUNS, 1, 2)),
            np.cumsum(1.3 * np.stack([np.cos(heading), np.sin(heading)], axis=-1), axis=1),
        ],
        axis=1,
    ) + np.array([4.0, -3.0])
    imu_s = np.arange(int(max(WALKED_S) * RATE_HZ) + 1) / RATE_HZ
    # Share of each swing that is over, smooth at both ends, and its derivative.
    share = np.clip((imu_s[:, None] - REST_S - STRIDE_S * swing) / SWING_S, 0, 1)
    over = share**3 * (10 - 15 * share + 6 * share**2)
    speed = 30 * share**2 * (1 - share) ** 2 / SWING_S
    lift = 16 * share**2 * (1 - share) ** 2
    lift_speed = 32 * share * (1 - share) * (1 - 2 * share) / SWING_S
    velocity = np.zeros((RUNS, len(imu_s), 3))
    velocity[..., :2] = np.einsum("ik,rkx->rix", speed, np.diff(stance_m, axis=1))
    velocity[..., 2] = 0.1 * lift_speed.sum(axis=1)
    sensor_rad = (start_rad - MISALIGNMENT_RAD)[:, None] + turn @ over.T
    pitch_rad = np.tile(0.4 * lift.sum(axis=1), (RUNS, 1))
    force, rate = readings(velocity, attitude_of(0.05, pitch_rad - 0.1, sensor_rad), 1 / RATE_HZ)
    imu_time_s = np.tile(imu_s[1:], (RUNS, 1))
    force, rate = force.astype(np.float32), rate.astype(np.float32)
    time_s = np.tile(0.43 + np.arange(21), (RUNS, 1))
    time_s[:, 5::4] -= 0.2
    swing_end_s = REST_S + STRIDE_S * swing + SWING_S
    begin_s = np.concatenate([[0.0], swing_end_s])
    end_s = np.concatenate([REST_S + STRIDE_S * swing, [1e3]])
    done = np.sum(swing_end_s <= time_s[..., None], axis=-1)
    true_m = stance_m[np.arange(RUNS)[:, None], done]
    rss_dbm = np.full((*time_s.shape, 3), -60.0)
    rss_dbm[..., :2] = true_m + fix_sigma_m * rng.standard_normal(true_m.shape) - 100
    rss_dbm[:, 5::4], rss_dbm[2, :4] = np.nan, np.nan
    for run, last_s in enumerate(WALKED_S):
        rss_dbm[run, time_s[run] > last_s], true_m[run, time_s[run] > last_s] = np.nan, np.nan
        time_s[run, time_s[run] > last_s] = np.nan
        behind = imu_time_s[run] > last_s
        for values in (imu_time_s, force, rate):
            values[run, behind] = np.nan
    return Walk(
        Recording(
            time_s=time_s,
            rss_dbm=rss_dbm,
            start_heading_rad=start_rad,
            start_position_m=stance_m[:, 0].copy(),
            imu_time_s=imu_time_s,
            specific_force_m_per_s2=force,
            angular_rate_rad_per_s=rate,
        ),
        SURVEY,
        SITE,
        Truth(
            position_m=true_m,
            stance_time_s=np.tile(np.stack([begin_s, end_s], axis=-1), (RUNS, 1, 1)),
        ),
        stance_m,
        swing_end_s,
    )


WALK = make_walk()
OVER = np.isnan(WALK.recording.time_s)


def make(name: str, **changes: Any) -> Any:
    """Return a tracker of inertial readings with fixes that stand in the scans."""
    cls = algorithm_class(name)
    known = inspect.signature(cls).parameters
    given_parts = {
        "truth": WALK.truth,
        "fingerprinting": Coordinates(),
        "particles": 200,
        "sigma_wlan_m": 1.0,
    }
    return cls(**{k: v for k, v in given_parts.items() if k in known} | changes)


def walk(algorithm: Any, **changes: Any) -> Track:
    """Track the stack of walks."""
    recording = replace(WALK.recording, **changes)
    return algorithm.track_stack(recording, WALK.survey, WALK.site, rngs())  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def tracks() -> dict[str, Track]:
    """Return what each tracker says of the walks."""
    return {name: walk(make(name)) for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_keywords_documented_and_stored_unchanged(name: str) -> None:
    cls = algorithm_class(name)
    lines = (inspect.getdoc(cls) or "").splitlines()
    documented = {word for line in lines if line[:1].isalpha() for word in line.split(", ")}
    algorithm = make(name)
    for parameter in inspect.signature(cls).parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert parameter.default is not inspect.Parameter.empty
        assert parameter.name in documented
        assert hasattr(algorithm, parameter.name)
    assert name.startswith("control_") == ("truth" in inspect.signature(cls).parameters)


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_finite_until_the_end_and_covariances_can_be_ones(
    name: str, tracks: dict[str, Track]
) -> None:
    found = tracks[name]
    np.testing.assert_array_equal(found.time_s, WALK.recording.time_s)
    assert found.position_m.shape == (*OVER.shape, 2)
    assert {"heading_rad", "steps"} <= set(found.extra)
    # Steps have an axis of their own, and the end of the alignment has none.
    extra = [
        values for key, values in found.extra.items() if not key.startswith(("step_", "alignment_end_s"))
    ]
    for values in (found.position_m, found.covariance_m2, *extra):
        assert np.isfinite(values[~OVER]).all()
        assert np.isnan(np.asarray(values, dtype=float)[OVER]).all()
    covariance = found.covariance_m2[~OVER]
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_a_stack_gives_exactly_what_each_recording_gives_and_changes_nothing(
    name: str, tracks: dict[str, Track]
) -> None:
    kept = make_walk()
    for run, length in enumerate(np.count_nonzero(~OVER, axis=1)):
        recording = WALK.recording.at(run).until(length)
        known = {"truth": WALK.truth.at(run)} if name.startswith("control_") else {}
        algorithm = make(name, **known)
        before = dict(vars(algorithm))
        alone = algorithm.track(recording, WALK.survey.at(run), WALK.site.at(run), rngs()[run])
        assert all(getattr(algorithm, key) is value for key, value in before.items())
        np.testing.assert_array_equal(alone.position_m, tracks[name].position_m[run, :length])
        np.testing.assert_array_equal(alone.covariance_m2, tracks[name].covariance_m2[run, :length])
        assert set(alone.extra) == set(tracks[name].extra)
        for key, values in alone.extra.items():
            whole = tracks[name].extra[key][run]
            if np.ndim(whole):
                whole = whole[: len(values) if key.startswith("step_") else length]
            np.testing.assert_array_equal(values, whole)
    for part, copy in zip(WALK[:4], kept[:4], strict=True):
        for field, values in part.to_arrays().items():
            np.testing.assert_array_equal(values, copy.to_arrays()[field])


@pytest.mark.parametrize("name", FUSED)
def test_later_scans_leave_no_trace_in_a_whole_walk(name: str, tracks: dict[str, Track]) -> None:
    assert WALK.recording.rss_dbm is not None
    rss_dbm = WALK.recording.rss_dbm.copy()
    rss_dbm[:, 10:] = np.nan
    earlier = walk(make(name), rss_dbm=rss_dbm)
    np.testing.assert_array_equal(earlier.position_m[:, :10], tracks[name].position_m[:, :10])
    assert (earlier.position_m != tracks[name].position_m)[:, 10:16].any()


def test_steps_of_faultless_readings_lead_to_the_stances(tracks: dict[str, Track]) -> None:
    found = tracks["foot_inertial"]
    number = found.extra["steps"][~OVER].astype(int)
    run = np.nonzero(~OVER)[0]
    np.testing.assert_allclose(found.position_m[~OVER], WALK.stance_m[run, number], atol=0.01)
    time_s = WALK.recording.time_s[~OVER]
    # The detector needs a tenth of a second to be sure.
    sure = np.abs(time_s[:, None] - WALK.swing_end_s - 0.05).min(axis=1) > 0.1
    assert np.count_nonzero(sure) > 30
    np.testing.assert_array_equal(number[sure], np.sum(WALK.swing_end_s <= time_s[sure, None], axis=-1))
    turned = found.extra["heading_rad"] - np.asarray(WALK.recording.start_heading_rad)[:, None]
    np.testing.assert_allclose(
        [turned[r, np.flatnonzero(~OVER[r])[-1]] for r in range(3)], [1.9, -0.9, 0.9], atol=2e-3
    )


def test_a_turned_misalignment_turns_the_way_about_the_start(tracks: dict[str, Track]) -> None:
    turned = walk(make("foot_inertial", misalignment_offset_rad=0.3))
    start_m = np.asarray(WALK.recording.start_position_m)[:, None]
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    expected = start_m + (tracks["foot_inertial"].position_m - start_m) @ turn.T
    np.testing.assert_allclose(turned.position_m, expected, atol=1e-9)


def test_a_noted_heading_turns_the_covariance_with_the_way(tracks: dict[str, Track]) -> None:
    heading_rad = np.asarray(WALK.recording.start_heading_rad) + np.pi / 2
    turned = walk(make("foot_inertial"), start_heading_rad=heading_rad)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    expected = turn @ tracks["foot_inertial"].covariance_m2 @ turn.T
    np.testing.assert_allclose(turned.covariance_m2, expected, atol=1e-12)
    assert np.abs(expected[0, 15, 0, 0] - expected[0, 15, 1, 1]) > 1e-6


def test_the_settings_are_those_of_the_inertial_filter() -> None:
    own = {"misalignment_offset_rad", "straight_steps", "straight_least_m", "straight_most_rad"}
    assert FootInertial().settings() == FootFilter()
    names = set(inspect.signature(FootInertial).parameters) - own
    assert names == set(inspect.signature(FootFilter).parameters)
    other = FootInertial(
        states=15, detector="shoe", detector_settings={"threshold": 1e5}, tilt_error_rad=0.01
    )
    expected = FootFilter(
        states=15, detector="shoe", detector_settings={"threshold": 1e5}, tilt_error_rad=0.01
    )
    assert other.settings() == expected


@pytest.mark.parametrize("name", FUSED)
def test_the_fused_way_is_near_the_true_one(name: str, tracks: dict[str, Track]) -> None:
    first = 4
    error_m = np.linalg.norm(tracks[name].position_m - WALK.truth.position_m, axis=-1)[:, first:]
    alone = np.linalg.norm(walk(make_alone()).position_m - WALK.truth.position_m, axis=-1)[:, first:]
    assert np.nanmean(error_m) < 0.75
    # Fixes are drawn about the stances, so that even they alone are good here.
    assert np.nanmean(error_m) < 1.3 * np.nanmean(alone)


@pytest.mark.parametrize("name", FUSED)
def test_silence_everywhere_leaves_the_centre_of_the_survey(name: str) -> None:
    found = walk(make(name), rss_dbm=np.full((*OVER.shape, 3), np.nan))
    centre_m = np.broadcast_to(SURVEY.position_m[0].mean(axis=0), found.position_m.shape)
    np.testing.assert_array_equal(found.position_m[~OVER], centre_m[~OVER])


@pytest.mark.parametrize("name", FUSED)
def test_parts_that_are_not_given_are_those_of_the_paper(name: str, tracks: dict[str, Track]) -> None:
    plain = walk(make(name, fingerprinting=None))
    same = walk(
        make(
            name,
            fingerprinting=ExpectedDeviation(),
            best_of_three=True,
            inertial=FootInertial(states=9, detector="acceleration_magnitude"),
        )
    )
    np.testing.assert_array_equal(plain.position_m, same.position_m)
    assert (plain.position_m != tracks[name].position_m)[~OVER].any()
    other = walk(make(name, inertial=FootInertial(states=15)))
    assert (other.position_m != tracks[name].position_m)[~OVER].any()


def make_alone() -> FingerprintAlone:
    """Return the fixes without a filter."""
    return FingerprintAlone(fingerprinting=Coordinates())


def test_the_joint_filter_starts_with_the_first_fix_and_may_unlearn_a_wrong_heading() -> None:
    exact = make_walk(fix_sigma_m=0.0)
    # The first scan comes before the first reading.
    time_s = exact.recording.time_s.copy()
    time_s[:, 0] = 0.0
    recording, survey, site = replace(exact.recording, time_s=time_s), exact.survey, exact.site

    def joint(**changes: Any) -> Track:
        filter_ = FootJointFilter(
            fingerprinting=Coordinates(), best_of_three=False, sigma_wlan_m=0.1, **changes
        )
        return filter_.track_stack(recording, survey, site, rngs())

    found = joint()
    np.testing.assert_allclose(found.position_m[:2, 0], exact.stance_m[:2, 0], atol=1e-6)
    np.testing.assert_allclose(found.covariance_m2[:2, 0], np.tile(0.01 * np.eye(2), (2, 1, 1)), atol=1e-5)
    centre_m = SURVEY.position_m[2].mean(axis=0)
    np.testing.assert_array_equal(found.position_m[2, :4], np.tile(centre_m, (4, 1)))
    true_m = exact.truth.position_m
    number = found.extra["steps"][~OVER].astype(int)
    standing_ = np.linalg.norm(exact.stance_m[np.nonzero(~OVER)[0], number] - true_m[~OVER], axis=-1) < 1e-9
    assert np.count_nonzero(standing_) > 40
    wrong = joint(start_heading_error_rad=0.4)
    never = joint(start_heading_error_rad=0.4, start_heading_sigma_rad=1e-6, heading_noise_rad_per_rt_s=0.0)
    # The walk of the heading lets it unlearn even what it took for sure.
    walked = joint(start_heading_error_rad=0.4, start_heading_sigma_rad=1e-6)
    last = [int(np.flatnonzero(~OVER[run])[-1]) for run in range(RUNS)]
    turned = [
        np.abs(t.extra["heading_rad"] - found.extra["heading_rad"])[np.arange(RUNS), last]
        for t in (wrong, never, walked)
    ]
    assert (turned[0] < 0.1).all()
    assert (turned[1] > 0.2).all()
    assert (turned[2] < 0.1).all()
    # With 15 states the bias is one of them, and the walk is left out.
    both = [
        joint(inertial=FootInertial(states=15), heading_noise_rad_per_rt_s=noise).position_m
        for noise in (0.0, 0.1)
    ]
    np.testing.assert_array_equal(*both)


def test_stances_are_found_in_the_readings() -> None:
    stance_s = np.array(
        [[[0.0, 0.02], [0.04, 0.05], [np.nan, np.nan]], [[0.03, 9.0], [np.nan] * 2, [np.nan] * 2]]
    )
    imu_s = np.tile([0.01, 0.02, 0.03, 0.04, 0.05, np.nan], (2, 1))
    expected = np.array([[1, 1, 0, 1, 1, 0], [0, 0, 1, 1, 1, 0]], dtype=bool)
    np.testing.assert_array_equal(standing(stance_s, imu_s), expected)
    assert not standing(np.full((2, 0, 2), np.nan), imu_s).any()
    with pytest.raises(InputError, match="recordings that it tracks"):
        standing(stance_s[:1], imu_s)
    with pytest.raises(InputError, match=r"\[0\].*not in order"):
        standing(stance_s[:, ::-1][:, [1, 2, 0]], imu_s)


def test_known_stances_are_used_with_and_without_a_survey() -> None:
    control = make("control_known_stances")
    alone = control.track_stack(WALK.recording, None, WALK.site, rngs())
    number = alone.extra["steps"][~OVER].astype(int)
    expected = np.sum(WALK.swing_end_s + 0.01 <= WALK.recording.time_s[~OVER][:, None], axis=-1)
    np.testing.assert_array_equal(number, expected)
    np.testing.assert_allclose(
        alone.position_m[~OVER], WALK.stance_m[np.nonzero(~OVER)[0], number], atol=0.01
    )
    # The detector is not asked.
    blind = FootInertial(detector="angular_rate_energy", detector_settings={"threshold_rad_per_s": 1e-9})
    told = ControlKnownStances(truth=WALK.truth, inertial=blind).track_stack(
        WALK.recording, None, WALK.site, rngs()
    )
    np.testing.assert_array_equal(told.extra["steps"], alone.extra["steps"])
    # With a survey it is the cascaded filter of the same steps.
    fused = walk(control)
    assert (fused.position_m != alone.position_m)[~OVER].all()
    np.testing.assert_array_equal(fused.extra["steps"], alone.extra["steps"])


def test_skip_names_what_is_missing() -> None:
    recording, survey, site = WALK[:3]
    calibration = Calibration(distance_m=np.ones((RUNS, 3)), rss_dbm=np.ones((RUNS, 3)))
    some = np.array([0.1, np.nan, 0.2])
    for name in NAMES:
        algorithm = make(name)
        assert algorithm.skip(recording, survey, site) == ""
        assert algorithm.skip(recording.at(0), survey.at(0), site.at(0)) == ""
        no_imu = replace(recording, specific_force_m_per_s2=None)
        assert "no inertial readings" in algorithm.skip(no_imu, survey, site)
        assert "start heading" in algorithm.skip(replace(recording, start_heading_rad=some), survey, site)
        with pytest.raises(InputError, match="no inertial readings"):
            algorithm.track_stack(no_imu, survey, site, rngs())
    for name in ("foot_cascaded_filter", "foot_joint_filter", "foot_particle_filter"):
        algorithm = make(name)
        for other in (None, calibration):
            assert "no survey" in algorithm.skip(recording, other, site)
            with pytest.raises(InputError, match="no survey"):
                algorithm.track_stack(recording, other, site, rngs())
        assert "no received strengths" in algorithm.skip(replace(recording, rss_dbm=None), survey, site)
        assert algorithm.skip(replace(recording, start_position_m=None), survey, site) == ""
    no_place = replace(recording, start_position_m=None)
    assert "start place" in make("foot_inertial").skip(no_place, survey, site)
    assert "start place" in make("control_known_stances").skip(no_place, None, site)
    assert make("control_known_stances").skip(no_place, survey, site) == ""
    assert "synthetic" in ControlKnownStances().skip(recording, survey, site)
    assert "synthetic" in ControlKnownStances(truth=Truth(position_m=TRUE_M)).skip(recording, survey, site)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("foot_cascaded_filter", {"sigma_step_m": -1.0}),
        ("foot_cascaded_filter", {"sigma_heading_rad": float("nan")}),
        ("foot_cascaded_filter", {"sigma_wlan_m": 0.0}),
        ("foot_cascaded_filter", {"start_heading_sigma_rad": -0.1}),
        ("foot_particle_filter", {"particles": 0}),
        ("foot_particle_filter", {"resample_below": 1.5}),
        ("foot_particle_filter", {"sigma_wlan_m": -3.0}),
        ("foot_joint_filter", {"start_heading_sigma_rad": -0.1}),
        ("foot_joint_filter", {"sigma_wlan_m": float("nan")}),
        ("foot_joint_filter", {"start_heading_error_rad": float("inf")}),
        ("control_known_stances", {"sigma_step_m": -1.0}),
        ("foot_inertial", {"states": 10}),
        ("foot_joint_filter", {"heading_noise_rad_per_rt_s": -1.0}),
        ("foot_inertial", {"detector": "magic"}),
        ("foot_inertial", {"misalignment_offset_rad": float("nan")}),
        ("foot_inertial", {"misalignment_offset_rad": 90.0}),
        ("foot_inertial", {"heading_offset_rad": -90.0}),
    ],
)
def test_senseless_settings_are_refused_by_name(name: str, changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(changes))):
        walk(make(name, **changes))


# Steps of another row


@pytest.mark.parametrize("name", ["foot_cascaded_filter", "foot_particle_filter"])
def test_steps_found_by_another_row_give_the_same_track(name: str, tracks: dict[str, Track]) -> None:
    handed = {f"extra_{key}": values for key, values in tracks["foot_inertial"].extra.items()}
    steps = {key.removeprefix("recording."): values for key, values in of_extra(handed).items()}
    built = make(name).track_stack(replace(WALK.recording, **steps), WALK.survey, WALK.site, rngs())
    np.testing.assert_array_equal(built.position_m, tracks[name].position_m)
    # And they are used: without turns the track is another one.
    steps["step_turn_rad"] = 0 * steps["step_turn_rad"]
    other = make(name).track_stack(replace(WALK.recording, **steps), WALK.survey, WALK.site, rngs())
    assert np.nanmax(np.abs(other.position_m - built.position_m)) > 0.1


@pytest.mark.parametrize(
    ("part", "where", "value", "message"),
    [
        ("step_time_s", (0, 0), 1e6, r"step_time_s\[0, 0\]: a step after it ends earlier"),
        ("step_time_s", (0, 1), np.nan, r"step_time_s\[0, 1\]: a time before is missing"),
        ("step_time_s", (0, 1), np.inf, r"step_time_s\[0, 1\]: the time is infinite"),
        ("step_left_m", (0, 1), np.nan, r"step_left_m\[0, 1\]: it is not a finite number"),
        ("step_turn_rad", None, None, "lack step_turn_rad"),
        ("step_forward_m", None, np.zeros((1, 2)), "the shapes of its steps"),
    ],
)
def test_steps_given_by_hand_are_checked(
    part: str, where: Any, value: Any, message: str, tracks: dict[str, Track]
) -> None:
    handed = {f"extra_{key}": values for key, values in tracks["foot_inertial"].extra.items()}
    steps = {key.removeprefix("recording."): values.copy() for key, values in of_extra(handed).items()}
    assert of_recording(replace(WALK.recording, **steps)) is not None
    if where is None:
        steps[part] = value
    else:
        steps[part][where] = value
    with pytest.raises(InputError, match=message):
        of_recording(replace(WALK.recording, **steps))


@pytest.mark.parametrize("name", ["foot_cascaded_filter", "foot_joint_filter"])
def test_a_survey_without_points_is_refused(name: str) -> None:
    survey = replace(
        WALK.survey, position_m=WALK.survey.position_m[:, :0], rss_dbm=WALK.survey.rss_dbm[:, :0]
    )
    with pytest.raises(InputError, match="the survey has no points"):
        make(name).track_stack(WALK.recording, survey, WALK.site, rngs())


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("start_heading_rad", 90.0, "start_heading_rad: 90 is more than a whole turn: it looks like degrees"),
        ("start_heading_rad", np.inf, "start_heading_rad: it is infinite"),
        ("start_position_m", np.inf, "start_position_m.*infinite"),
        ("start_position_m", None, "start_position_m: its shape"),
    ],
)
def test_a_start_without_sense_is_refused(part: str, value: Any, message: str) -> None:
    start = np.array(getattr(WALK.recording, part), dtype=float)
    changed = start[..., :1] if value is None else np.full_like(start, value)
    with pytest.raises(InputError, match=message):
        make("foot_inertial").track_stack(
            replace(WALK.recording, **{part: changed}), WALK.survey, WALK.site, rngs()
        )


def test_an_alignment_in_the_second_half_is_a_reason_to_skip(tracks: dict[str, Track]) -> None:
    given = WALK.recording, WALK.survey, WALK.site
    ends_s = tracks["foot_inertial"].extra["alignment_end_s"]
    first_s, last_s = WALK.recording.imu_time_s[:, 0], np.nanmax(WALK.recording.imu_time_s, axis=1)
    assert make("foot_inertial").skip(*given) == ""
    assert (ends_s < (first_s + last_s) / 2).all()
    # Without the rest at the start, only the one at the end is long enough.
    time_s = WALK.recording.imu_time_s[:1]
    force, rate = (
        getattr(WALK.recording, name)[:1].copy()
        for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s")
    )
    early = time_s[0] < 0.75 * last_s[0]
    force[:, early, 0] += 30.0 * (np.arange(early.sum()) % 2)
    restless = replace(
        WALK.recording.at(0),
        imu_time_s=time_s[0],
        specific_force_m_per_s2=force[0],
        angular_rate_rad_per_s=rate[0],
    )
    reason = make("foot_inertial", alignment_s=0.1).skip(restless, None, WALK.site.at(0))
    assert re.search(r"the first rest of 0.1 s begins at \d+\.\d s of \d+\.\d s", reason)
    assert "lower alignment_s, or take another detector" in reason
    # Nobody else's detector counts for who knows the stances.
    control = make("control_known_stances", truth=WALK.truth.at(0), inertial=FootInertial(alignment_s=0.1))
    assert control.skip(restless, None, WALK.site.at(0)) == ""
    assert control.skip(restless, WALK.survey.at(0), WALK.site.at(0)) == ""
    # Who finds the steps with a filter of its own starts as late, but not who takes those of another row.
    given = restless, WALK.survey.at(0), WALK.site.at(0)
    for name in ("foot_cascaded_filter", "foot_joint_filter", "foot_particle_filter"):
        algorithm = make(name, inertial=FootInertial(alignment_s=0.1))
        assert algorithm.skip(*given) == reason
        with pytest.raises(InputError, match=r"the first rest of 0\.1 s begins at"):
            algorithm.track(*given, rngs()[0])
    extra = tracks["foot_inertial"].extra
    found = replace(restless, **{name: extra[name][0] for name in extra if name.startswith("step_")})
    for name in ("foot_cascaded_filter", "foot_particle_filter"):
        algorithm = make(name, inertial=FootInertial(alignment_s=0.1))
        assert algorithm.skip(found, *given[1:]) == ""
        assert np.isfinite(algorithm.track(found, *given[1:], rngs()[0]).position_m).any()


def test_a_row_that_was_skipped_hands_no_steps_on() -> None:
    assert of_extra({}) == {}
    assert of_recording(WALK.recording) is None


# The guide


def test_the_guide_s_tracker_with_a_foot_mounted_unit_runs() -> None:
    guide = (Path(__file__).parents[1] / "docs/add-an-algorithm.md").read_text(encoding="utf-8")
    part = guide.partition("## A rest detector, or a tracker with a foot-mounted unit")[2]
    example = part.partition("```python\n")[2].partition("```")[0]
    names: dict[str, Any] = {}
    exec(compile(example, "docs/add-an-algorithm.md", "exec"), names)
    recording = WALK.recording.at(0).until(int(np.count_nonzero(~OVER[0])))
    track = names["MyFoot"]().track(recording, None, WALK.site.at(0), rngs()[0])
    off_m = np.linalg.norm(track.position_m - WALK.truth.position_m[0, : len(track.time_s)], axis=-1)
    assert off_m.mean() < 2.0
    assert np.linalg.eigvalsh(track.covariance_m2).min() > 0
