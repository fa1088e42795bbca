"""The runners of ranging, trilateration and tracking, and what they share: stacks and fixes."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from positioning.errors import InputError
from positioning.fixes import locate, of_outputs
from positioning.model import Calibration, Recording, Site, Survey, Track, Truth, Worlds
from positioning.ranging import TooManyCombinations
from positioning.registry import build, factory
from positioning.seeds import stream
from positioning.stacks import stack
from positioning.tasks import ranging, tracking, trilateration

BEACON_M = np.array([[0.0, 0.0], [6.0, 0.0], [0.0, 8.0]])
WORLDS, RUNS, EPOCHS = 3, 2, 5


def worlds(count: int = WORLDS, runs: int = RUNS, distances: bool = False) -> Worlds:
    """Exact worlds: level = -distance in dBm, so that every distance is known; run 1 ends early."""
    rng = np.random.default_rng(4)
    position_m = rng.uniform(0.5, 5.5, (WORLDS, RUNS, EPOCHS, 2))[:count, :runs]
    position_m[:, 1:, 3:] = np.nan
    distance_m = np.linalg.norm(position_m[..., None, :] - BEACON_M, axis=-1)
    time_s = np.where(np.isnan(position_m[..., 0]), np.nan, np.arange(EPOCHS, dtype=float))
    site = Site(
        corner_m=np.tile([[0.0, 0.0], [6.0, 8.0]], (count, 1, 1)),
        access_point_m=np.tile(BEACON_M, (count, 1, 1)),
    )
    recording = Recording(
        time_s=time_s,
        rss_dbm=None if distances else -distance_m,
        range_m=distance_m if distances else None,
        start_heading_rad=np.zeros((count, runs)),
    )
    curve_m = np.tile(np.linspace(0.1, 12, 20), (count, 1))
    calibration = Calibration(distance_m=curve_m, rss_dbm=-curve_m)
    observed = {**site.to_arrays(), **recording.to_arrays()}
    truth = Truth(position_m=position_m).to_arrays() | {"truth.distance_m": distance_m}
    return Worlds(observed | ({} if distances else calibration.to_arrays()), truth)


def generators(count: int = WORLDS) -> list[np.random.Generator]:
    return [stream(i, "test") for i in range(count)]


class Twice:
    """Ranging that offers the right distance and one that is 1 m longer; nothing beyond 7 m."""

    def fit(self, distance_m: Any, rss_dbm: Any) -> "Twice":
        return self

    def distances(self, rss_dbm: Any) -> Any:
        right = np.where(-rss_dbm > 7, np.nan, -rss_dbm)
        return np.stack([right, right + 1], axis=-1)


class Far:
    """A solver that says the sum of the distances and that every third one does not converge."""

    def solve(self, beacon_m: Any, range_m: Any) -> Any:
        self.iterations_ = np.where(np.arange(len(range_m)) % 3 == 2, -1, 7)
        return np.stack([np.nansum(range_m, axis=-1), np.full(len(range_m), 1.0)], axis=-1)


# Stacks


def test_a_stack_has_a_recording_for_each_world_and_run() -> None:
    data = worlds()
    stacked = stack(data.observed, data.truth, generators())
    assert stacked.recording.time_s.shape == (WORLDS * RUNS, EPOCHS)
    for index, (world, run) in enumerate(product(range(WORLDS), range(RUNS))):
        assert stacked.recording.rss_dbm is not None
        assert stacked.truth is not None
        np.testing.assert_array_equal(
            stacked.recording.rss_dbm[index], data.observed["recording.rss_dbm"][world, run]
        )
        np.testing.assert_array_equal(
            stacked.truth.position_m[index], data.truth["truth.position_m"][world, run]
        )
        assert isinstance(stacked.survey, Calibration)
        np.testing.assert_array_equal(
            stacked.survey.rss_dbm[index], data.observed["calibration.rss_dbm"][world]
        )
    values = np.arange(WORLDS * RUNS * 2).reshape(WORLDS * RUNS, 2)
    np.testing.assert_array_equal(stacked.unstacked(values)[1, 0], values[RUNS])


def test_generators_of_a_stack_are_children_of_their_world_s_and_all_differ() -> None:
    data = worlds()
    several = stack(data.observed, None, generators()).generators
    draws = [rng.random() for rng in several]
    assert len(set(draws)) == WORLDS * RUNS
    again = stack(worlds(count=2).observed, None, generators(2)).generators
    assert [rng.random() for rng in again] == draws[: 2 * RUNS]
    flat = {
        name: value[:, 0] if name.startswith("recording") else value for name, value in data.observed.items()
    }
    alone = stack(flat, None, generators())
    assert alone.shape == (WORLDS,)
    assert [rng.random() for rng in alone.generators] == [rng.random() for rng in generators()]


def test_a_stack_needs_a_recording_and_a_site() -> None:
    for part in ("recording", "site"):
        observed = {n: v for n, v in worlds().observed.items() if not n.startswith(part)}
        with pytest.raises(InputError, match=f"no {part}"):
            stack(observed, None, generators())


# Fixes


def located(ranger: Any, solver: Any, data: Worlds) -> Any:
    stacked = stack(data.observed, None, generators())
    survey = stacked.survey
    assert survey is None or isinstance(survey, Calibration)
    return locate(ranger, solver, survey, stacked.recording, stacked.site)


def test_every_combination_of_distances_is_a_fix_in_its_epoch() -> None:
    data = worlds()
    fixes = located(Twice(), build({"use": "pseudo_inverse", "task": "trilateration"}), data)
    distance_m = data.truth["truth.distance_m"].reshape(WORLDS * RUNS, EPOCHS, 3)
    with np.errstate(invalid="ignore"):
        expected = np.where((distance_m <= 7).all(axis=-1), 8, 0)
    np.testing.assert_array_equal(fixes.count, expected)
    assert {0, 8} == set(fixes.count.ravel())
    best = fixes.least_residual()
    true_m = data.truth["truth.position_m"].reshape(WORLDS * RUNS, EPOCHS, 2)
    np.testing.assert_allclose(best[expected > 0], true_m[expected > 0], atol=1e-9)
    assert np.isnan(best[expected == 0]).all()
    np.testing.assert_allclose(np.nanmin(fixes.residual_m[expected > 0], axis=-1), 0, atol=1e-9)


def test_solutions_come_back_to_the_combination_they_belong_to() -> None:
    data = worlds(distances=True)
    fixes = located(None, Far(), data)
    distance_m = data.truth["truth.distance_m"].reshape(WORLDS * RUNS, EPOCHS, 3)
    heard = ~np.isnan(distance_m).any(axis=-1)
    np.testing.assert_allclose(fixes.nearest_m[heard, 0], distance_m[heard].min(axis=-1))
    assert np.isnan(fixes.nearest_m[~heard]).all()
    converged = fixes.iterations[..., 0] == 7
    np.testing.assert_allclose(fixes.position_m[converged, 0, 0], distance_m[converged].sum(axis=-1))
    failed = fixes.iterations[..., 0] == -1
    assert 0 < failed.sum() < heard.sum()
    assert np.isnan(fixes.position_m[failed]).all()
    np.testing.assert_array_equal(converged | failed, heard)


def test_beacons_may_differ_from_world_to_world() -> None:
    data = worlds(distances=True)
    shift = np.arange(WORLDS, dtype=float)[:, None, None] * [1.0, -2.0]
    moved = {**data.observed, "site.access_point_m": data.observed["site.access_point_m"] + shift}
    solver = build({"use": "pseudo_inverse", "task": "trilateration"})
    before = located(None, solver, data).least_residual()
    after = located(None, solver, Worlds(moved, data.truth)).least_residual()
    np.testing.assert_allclose(after, before + np.repeat(shift, RUNS, axis=0), atol=1e-9)


def test_fixes_need_beacons_and_something_to_range_with() -> None:
    data = worlds()
    for without, said in (("site.access_point_m", "beacons"), ("calibration", "calibration")):
        observed = {n: v for n, v in data.observed.items() if not n.startswith(without)}
        with pytest.raises(InputError, match=said):
            located(Twice(), Far(), Worlds(observed, data.truth))


@pytest.mark.parametrize("flat", [True, False])
def test_the_outputs_of_a_row_are_the_fixes_that_a_tracker_would_find_itself(flat: bool) -> None:
    observed = worlds().observed
    if flat:
        observed = {n: v[:, 0] if n.startswith("recording") else v for n, v in observed.items()}
    line = {"use": "curve_crossings", "task": "ranging"}
    make = factory("pseudo_inverse", "trilateration", {})
    row = trilateration.run(make, observed, None, {"ranging": line}, generators())
    given = {**observed, **of_outputs(row.estimates, observed["recording.time_s"])}
    for use in ("trilateration_alone", "particle_filter", "extended_kalman_filter"):
        tracker = factory(
            use, "tracking", {"trilateration": {"use": "pseudo_inverse", "task": "trilateration"}}
        )
        own = tracking.run(tracker, observed, None, {}, generators())
        built = tracking.run(factory(use, "tracking", {}), given, None, {}, generators())
        assert np.isfinite(own.estimates["position_m"]).any()
        for name, values in own.estimates.items():
            np.testing.assert_array_equal(values, built.estimates[name], err_msg=f"{use} {name}")


def test_outputs_that_did_not_converge_are_no_fixes() -> None:
    data = worlds(distances=True)
    row = trilateration.run(lambda **_: Far(), data.observed, None, {}, generators())
    fixes = of_outputs(row.estimates, data.observed["recording.time_s"])
    failed = np.count_nonzero(row.estimates["output_iterations"] == -1)
    assert failed > 0
    heard = np.count_nonzero(~np.isnan(data.observed["recording.time_s"]))
    assert np.count_nonzero(~np.isnan(fixes["recording.fix_residual_m"])) == heard - failed


# Ranging


def test_ranging_is_scored_by_every_candidate() -> None:
    data = worlds()
    outcome = ranging.run(lambda **_: Twice(), data.observed, None, {}, generators())
    errors = ranging.score(outcome.estimates, data.truth)
    assert errors["error_m"].shape == (WORLDS, RUNS * EPOCHS * 3 * 2)
    found = errors["error_m"].reshape(-1, 2)
    given = ~np.isnan(found[:, 0])
    np.testing.assert_allclose(found[given], np.tile([0.0, 1.0], (given.sum(), 1)), atol=1e-12)
    np.testing.assert_allclose(np.nanmax(errors["error_distance_m"]), 1.0)


def test_a_wrong_answer_of_ranging_is_refused_and_no_calibration_is_a_reason() -> None:
    class Flat(Twice):
        def distances(self, rss_dbm: Any) -> Any:
            return -rss_dbm

    with pytest.raises(InputError, match="its answer"):
        ranging.run(lambda **_: Flat(), worlds().observed, None, {}, generators())
    assert (
        "calibration"
        in ranging.run(lambda **_: Twice(), worlds(distances=True).observed, None, {}, generators()).skipped
    )


# Trilateration


@pytest.mark.parametrize("distances", [True, False])
def test_exact_distances_give_exact_places(distances: bool) -> None:
    data = worlds(distances=distances)
    make = factory("pseudo_inverse", "trilateration", {})
    outcome = trilateration.run(make, data.observed, None, {}, generators())
    errors = trilateration.score(outcome.estimates, data.truth)
    asked = ~np.isnan(data.truth["truth.position_m"][..., 0]).reshape(WORLDS, -1)
    np.testing.assert_array_equal(~np.isnan(errors["error_m"]), asked)
    np.testing.assert_allclose(errors["error_m"][asked], 0, atol=1e-9)
    np.testing.assert_allclose(errors["error_outputs_m"][asked], 0, atol=1e-9)


def test_the_score_tells_the_best_output_from_the_mean_of_all() -> None:
    data = worlds()
    outcome = trilateration.run(
        factory("pseudo_inverse", "trilateration", {}),
        data.observed,
        None,
        {"ranging": {"use": "curve_crossings", "task": "ranging"}},
        generators(),
    )
    # Two more outputs for the first epoch of the first world: 3 m and 6 m off.
    estimates = {name: np.asarray(v).copy() for name, v in outcome.estimates.items()}
    true_m = data.truth["truth.position_m"][0, 0, 0]
    for off_m in (3.0, 6.0):
        for name, value in (("output_m", true_m + np.array([off_m, 0.0])), ("output_sample", 0)):
            estimates[name] = np.concatenate([estimates[name], estimates[name][:, -1:]], axis=1)
            estimates[name][:, -1] = np.nan if name == "output_m" else -1
            estimates[name][0, -1] = value
    errors = trilateration.score(estimates, data.truth)
    assert errors["error_m"][0, 0] == pytest.approx(0, abs=1e-9)
    assert errors["error_outputs_m"][0, 0] == pytest.approx(3.0)
    assert errors["error_outputs_m"][0, 1] == pytest.approx(0, abs=1e-9)


def test_iterations_that_do_not_converge_are_kept_as_such_and_have_no_output() -> None:
    data = worlds(distances=True)
    outcome = trilateration.run(lambda **_: Far(), data.observed, None, {}, generators())
    failed = outcome.estimates["output_iterations"] == -1
    assert failed.any()
    assert np.isnan(outcome.estimates["output_m"][failed]).all()
    assert np.isfinite(outcome.estimates["output_nearest_m"][failed]).all()
    errors = trilateration.score(outcome.estimates, data.truth)["error_m"]
    assert np.isnan(errors).sum() == failed.sum() + np.isnan(data.truth["truth.position_m"][..., 0]).sum()


def test_too_many_combinations_are_a_reason_and_no_failure() -> None:
    class Many(Twice):
        def distances(self, rss_dbm: Any) -> Any:
            return -np.asarray(rss_dbm)[..., None] + np.arange(30) / 10

    data = worlds()
    monkey = {"use": "many", "task": "ranging"}
    solver = build({"use": "pseudo_inverse", "task": "trilateration"})
    with pytest.raises(TooManyCombinations, match="27000 combinations"):
        located(Many(), solver, data)
    tracker = factory("trilateration_alone", "tracking", {})(ranging=Many(), trilateration=solver)
    skipped = tracking.run(lambda **_: tracker, data.observed, None, {}, generators()).skipped
    assert "path_loss" in skipped
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trilateration, "build", lambda line: Many() if line == monkey else None)
        made = trilateration.run(lambda **_: solver, data.observed, None, {"ranging": monkey}, generators())
    assert made.skipped == skipped


def test_wrong_answers_of_parts_are_laid_at_their_door() -> None:
    class Negative(Twice):
        def distances(self, rss_dbm: Any) -> Any:
            return np.asarray(rss_dbm)[..., None]

    class Flat(Far):
        def solve(self, beacon_m: Any, range_m: Any) -> Any:
            return np.zeros(len(range_m))

    data = worlds()
    with pytest.raises(InputError, match="ranging Negative"):
        located(Negative(), Far(), data)
    with pytest.raises(InputError, match="trilateration Flat"):
        located(Twice(), Flat(), data)


def test_fixes_without_residuals_fit_equally_well() -> None:
    fix_m = np.array([[[[1.0, 2.0], [np.nan, np.nan]]]])
    recording = Recording(time_s=np.zeros((1, 1)), fix_m=fix_m)
    fixes = locate(None, None, None, recording, Site(corner_m=np.zeros((1, 2, 2))))
    np.testing.assert_array_equal(fixes.least_residual(), [[[1.0, 2.0]]])
    assert fixes.count.tolist() == [[1]]


def test_ranging_without_true_distances_says_what_is_missing() -> None:
    with pytest.raises(InputError, match=r"truth.distance_m"):
        ranging.score({"range_m": np.zeros((1, 1, 1, 1))}, {"truth.position_m": np.zeros((1, 1, 2))})


# Tracking


class Walker:
    """Answers with a noisy line and tells what it was given; one recording at a time."""

    def __init__(self, *, truth: Any = None) -> None:
        self.truth = truth

    def track(self, recording: Any, survey: Any, site: Any, rng: Any) -> Track:
        assert not np.isnan(recording.time_s).any()
        assert recording.rss_dbm.shape == (len(recording.time_s), 3)
        assert site.access_point_m.shape == (3, 2)
        position_m = rng.normal(size=(len(recording.time_s), 2))
        covariance_m2 = np.tile(np.eye(2), (len(position_m), 1, 1))
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"length": np.full(len(position_m), len(position_m))},
        )


def test_an_algorithm_for_one_recording_gets_each_as_long_as_it_is() -> None:
    data = worlds()
    outcome = tracking.run(lambda **_: Walker(), data.observed, None, {}, generators())
    assert outcome.estimates["position_m"].shape == (WORLDS, RUNS, EPOCHS, 2)
    np.testing.assert_array_equal(outcome.estimates["extra_length"][:, 0], float(EPOCHS))
    np.testing.assert_array_equal(outcome.estimates["extra_length"][:, 1, :3], 3.0)
    assert np.isnan(outcome.estimates["position_m"][:, 1, 3:]).all()
    errors = tracking.score(outcome.estimates, data.truth)
    expected = outcome.estimates["position_m"] - data.truth["truth.position_m"]
    np.testing.assert_allclose(
        errors["error_m"], np.linalg.norm(expected, axis=-1).reshape(WORLDS, -1), equal_nan=True
    )
    np.testing.assert_allclose(errors["nees"], np.square(errors["error_m"]), equal_nan=True)


def test_the_normalised_error_is_two_on_average_where_the_covariance_is_right() -> None:
    rng = np.random.default_rng(1)
    factor = np.array([[2.0, 0.0], [1.0, 0.5]])
    true_m = rng.normal(size=(1, 20000, 2))
    estimates = {
        "position_m": true_m + rng.normal(size=(1, 20000, 2)) @ factor.T,
        "covariance_m2": np.tile(factor @ factor.T, (1, 20000, 1, 1)),
    }
    nees = tracking.score(estimates, {"truth.position_m": true_m})["nees"]
    assert nees.mean() == pytest.approx(2, abs=0.06)


def test_tracks_do_not_depend_on_the_stack() -> None:
    def positions(count: int) -> Any:
        data = worlds(count=count)
        return tracking.run(lambda **_: Walker(), data.observed, None, {}, generators(count)).estimates[
            "position_m"
        ]

    np.testing.assert_array_equal(positions(2), positions(3)[:2])


def test_only_a_control_gets_the_truth_and_it_is_stacked() -> None:
    data, seen = worlds(), []

    def make(**context: Any) -> Walker:
        seen.append(context)
        return Walker(**context)

    tracking.run(make, data.observed, None, {}, generators())
    tracking.run(make, data.observed, data.truth, {}, generators())
    assert seen[0] == {}
    assert seen[1]["truth"].position_m.shape == (WORLDS * RUNS, EPOCHS, 2)


def test_static_places_have_no_track_but_for_those_that_need_no_order() -> None:
    data = worlds()
    static = {
        **data.observed,
        "recording.time_s": np.where(np.isnan(data.observed["recording.time_s"]), np.nan, 0.0),
    }
    assert "order" in tracking.run(lambda **_: Walker(), static, None, {}, generators()).skipped

    class Places(Walker):
        needs_order = False

    assert not tracking.run(lambda **_: Places(), static, None, {}, generators()).skipped


def test_a_skip_is_asked_before_and_its_reason_kept() -> None:
    class Shy(Walker):
        def skip(self, recording: Any, survey: Any, site: Any) -> str:
            return "no floor plan" if site.wall_m is None else ""

    assert (
        tracking.run(lambda **_: Shy(), worlds().observed, None, {}, generators()).skipped == "no floor plan"
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: {"position_m": t.position_m[:, :1]}, "position_m"),
        (lambda t: {"position_m": t.position_m * np.nan}, "not finite"),
        (lambda t: {"covariance_m2": np.full_like(t.covariance_m2, np.inf)}, "covariance_m2"),
        (lambda t: {"position_m": t.position_m[:2]}, "epochs"),
        (lambda t: {"covariance_m2": -t.covariance_m2}, "negative variance"),
        (lambda t: {"time_s": t.time_s[:2]}, "epochs"),
        (lambda t: {"time_s": t.time_s + 1}, "time_s: it differs"),
    ],
)
def test_a_wrong_track_is_refused(change: Any, said: str) -> None:
    class Wrong(Walker):
        def track(self, *given: Any) -> Track:
            right = super().track(*given)
            values = {"time_s": right.time_s, "position_m": right.position_m}
            values |= {"covariance_m2": right.covariance_m2}
            return Track(**values | change(right))

    with pytest.raises(InputError, match=said):
        tracking.run(lambda **_: Wrong(), worlds().observed, None, {}, generators())


def test_an_answer_that_is_no_track_says_what_is_wanted() -> None:
    class Bare(Walker):
        def track(self, *given: Any) -> Any:
            return super().track(*given).position_m

    class Stacked(Bare):
        def track_stack(self, *given: Any) -> Any:
            return None

    for cls, name in ((Bare, "ndarray"), (Stacked, "NoneType")):
        with pytest.raises(InputError, match=rf"a {name}, not a Track\. Return positioning.model.Track"):
            tracking.run(lambda cls=cls, **_: cls(), worlds().observed, None, {}, generators())


# Recordings and lines of the configuration


def test_the_first_epochs_of_a_recording() -> None:
    recording = stack(worlds().observed, None, generators()).recording
    short = recording.until(3)
    assert short.rss_dbm is not None
    assert recording.rss_dbm is not None
    np.testing.assert_array_equal(short.rss_dbm, recording.rss_dbm[:, :3])
    np.testing.assert_array_equal(recording.at(1).until(2).time_s, recording.time_s[1, :2])
    assert recording.at(1).until(2).start_heading_rad == recording.at(1).start_heading_rad


def test_a_survey_goes_first_where_a_world_has_both() -> None:
    data = worlds()
    survey = Survey(rss_dbm=np.zeros((WORLDS, 4, 3)), position_m=np.zeros((WORLDS, 4, 2)))
    both = stack({**data.observed, **survey.to_arrays()}, None, generators())
    assert isinstance(both.survey, Survey)
    assert both.calibration is not None
    np.testing.assert_array_equal(both.calibration.rss_dbm[0], data.observed["calibration.rss_dbm"][0])


def test_data_without_a_recording_are_skipped_with_a_reason() -> None:
    observed = {n: v for n, v in worlds().observed.items() if not n.startswith("recording")}
    for task in (tracking, trilateration):
        assert task.run(lambda **_: Walker(), observed, None, {}, generators()).skipped


def test_a_setting_may_be_an_algorithm() -> None:
    line = {"use": "path_loss", "task": "ranging"}
    made = factory("trilateration_alone", "tracking", {"ranging": line})()
    assert type(made.ranging).__name__ == "PathLoss"
    with pytest.raises(InputError, match="task"):
        build({"use": "path_loss"})
    with pytest.raises(InputError, match="slope"):
        build({**line, "slope": 2})
