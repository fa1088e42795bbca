"""Every fingerprinting algorithm against its contract, and each against known answers."""

import importlib
import inspect
import pkgutil
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.distance import cdist
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

import algorithms.fingerprinting
from algorithms.fingerprinting import mlp
from algorithms.fingerprinting.bayes_average import BayesAverage
from algorithms.fingerprinting.bayes_maximum_likelihood import BayesMaximumLikelihood
from algorithms.fingerprinting.control_centre import ControlCentre
from algorithms.fingerprinting.control_oracle import ControlOracle, log_probability_between
from algorithms.fingerprinting.knn import Knn
from algorithms.fingerprinting.mlp import Mlp
from algorithms.fingerprinting.rbf_network import RbfNetwork
from algorithms.fingerprinting.rbf_network_nearest import RbfNetworkNearest
from algorithms.fingerprinting.svm import Svm
from algorithms.fingerprinting.template import Template
from algorithms.fingerprinting.wknn import Wknn
from positioning import fingerprints
from positioning.errors import InputError
from positioning.fingerprints import (
    FillNotHeard,
    fill_not_heard,
    nearest_members,
    signal_distance_db,
    standardisation,
    training_members,
)
from positioning.model import Array, Site, Survey, Truth
from positioning.registry import class_name

NAMES = sorted(module.name for module in pkgutil.iter_modules(algorithms.fingerprinting.__path__))
CORNER_M = np.array([[0.0, 0.0], [15.0, 12.0]])
FLOOR_DBM, NOISE_DB = -73.0, 3.0
# Smaller than by default, so that they fit the small survey of these tests.
SMALL: dict[str, dict[str, Any]] = {
    "rbf_network": {"neurons": 12},
    "rbf_network_nearest": {"nearest": 30, "neurons": 6},
    "mlp": {"iterations": 15},
    "bayes_average": {"grid_step_m": 1.0},
    "bayes_maximum_likelihood": {"grid_step_m": 1.0},
}


def make_world(seed: int = 5) -> tuple[Survey, Site, Truth]:
    """Return a small world with every nuisance: NaN, silence, an access point never heard, a double point."""
    rng = np.random.default_rng(seed)
    x_m, y_m = np.meshgrid(np.arange(0.7, 15, 1.5), np.arange(0.9, 12, 1.7))
    position_m = np.column_stack([x_m.ravel(), y_m.ravel()])
    position_m[40] = position_m[41]
    access_point_m = rng.uniform(CORNER_M[0], CORNER_M[1], (5, 2))
    distance_m = np.linalg.norm(position_m[:, None] - access_point_m, axis=-1)
    field_dbm = -38.0 - 35.0 * np.log10(np.maximum(distance_m, 0.5))
    field_dbm[:, 4] = -200.0
    rss_dbm = np.round(field_dbm + NOISE_DB * rng.standard_normal(field_dbm.shape))
    rss_dbm = np.where(rss_dbm < FLOOR_DBM, np.nan, rss_dbm)
    rss_dbm[12] = np.nan
    wall_m = np.array([[[4.03, 0.0], [4.03, 9.0]], [[9.11, 3.0], [9.11, 12.0]], [[np.nan] * 2] * 2])
    return (
        Survey(rss_dbm=rss_dbm, position_m=position_m),
        Site(corner_m=CORNER_M, access_point_m=access_point_m, wall_m=wall_m),
        Truth(
            position_m=position_m,
            field_dbm=field_dbm,
            noise_db=np.array(NOISE_DB),
            floor_dbm=np.array(FLOOR_DBM),
        ),
    )


SURVEY, SITE, TRUTH = make_world()
RSS, POSITION = SURVEY.rss_dbm, SURVEY.position_m
COUNT = len(RSS)


def algorithm_class(name: str) -> Any:
    """Return the class of an algorithm's file."""
    return getattr(importlib.import_module(f"algorithms.fingerprinting.{name}"), class_name(name))


def make(name: str, **changes: Any) -> Any:
    """Return an algorithm as the runner would make it, but smaller."""
    cls = algorithm_class(name)
    context = {"site": SITE, "truth": TRUTH, "random_state": 7}
    known = inspect.signature(cls).parameters
    return cls(**{k: v for k, v in context.items() if k in known} | SMALL.get(name, {}) | changes)


def refit(algorithm: Any, rss_dbm: Array, position_m: Array, tested: Any) -> Array:
    """Locate points by explicit refits without their reference points."""
    member = training_members(position_m)
    return np.concatenate(
        [
            clone(algorithm).fit(rss_dbm[member[i]], position_m[member[i]]).predict(rss_dbm[i : i + 1])
            for i in tested
        ]
    )


def leave_one_out(algorithm: Any, rss_dbm: Array, position_m: Array, point: int) -> Array:
    """Locate one point of a leave-one-out."""
    if hasattr(algorithm, "leave_one_out"):
        return np.asarray(algorithm.leave_one_out(rss_dbm, position_m)[point])
    return np.asarray(refit(algorithm, rss_dbm, position_m, [point])[0])


def test_all_algorithms_of_the_study_are_found() -> None:
    assert set(NAMES) >= {
        *("bayes_average", "bayes_maximum_likelihood", "control_centre", "control_oracle", "knn", "mlp"),
        *("rbf_network", "rbf_network_nearest", "svm", "template", "wknn"),
    }


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_keywords_documented_and_stored_unchanged(name: str) -> None:
    cls = algorithm_class(name)
    text = inspect.getdoc(cls) or ""
    for parameter in inspect.signature(cls).parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert parameter.default is not inspect.Parameter.empty
        assert f"\n{parameter.name}\n    " in text, parameter.name
    algorithm = make(name)
    before = algorithm.get_params(deep=False)
    copy = clone(algorithm).get_params(deep=False)
    algorithm.fit(RSS, POSITION).predict(RSS)
    after = algorithm.get_params(deep=False)
    for key, value in before.items():
        assert after[key] is value
        assert type(copy[key]) is type(value)
        assert isinstance(value, Site | Truth) or copy[key] == value


@pytest.mark.parametrize("name", NAMES)
def test_truth_is_for_controls_only(name: str) -> None:
    assert name.startswith("control_") or "truth" not in inspect.signature(algorithm_class(name)).parameters


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_finite_repeatable_and_leave_global_random_state_alone(name: str) -> None:
    state = np.random.get_state()  # noqa: NPY002
    first = make(name).fit(RSS, POSITION).predict(RSS)
    second = make(name).fit(RSS, POSITION).predict(RSS)
    assert first.shape == (COUNT, 2)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, second)
    for old, new in zip(state, np.random.get_state(), strict=True):  # noqa: NPY002
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("name", NAMES)
def test_inputs_are_left_unchanged(name: str) -> None:
    rss, position = RSS.copy(), POSITION.copy()
    make(name).fit(rss, position).predict(rss)
    if hasattr(algorithm_class(name), "leave_one_out"):
        make(name).leave_one_out(rss, position)
    np.testing.assert_array_equal(rss, RSS)
    np.testing.assert_array_equal(position, POSITION)


@pytest.mark.parametrize("name", NAMES)
def test_silence_everywhere_gives_finite_positions(name: str) -> None:
    silent = np.full((3, RSS.shape[1]), np.nan)
    assert np.isfinite(make(name).fit(RSS, POSITION).predict(silent)).all()
    assert np.isfinite(make(name).fit(np.full_like(RSS, np.nan), POSITION).predict(RSS[:3])).all()
    if hasattr(algorithm_class(name), "leave_one_out"):
        assert np.isfinite(make(name).leave_one_out(np.full_like(RSS, np.nan), POSITION)).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_row_is_located_alone_as_among_others(name: str) -> None:
    algorithm = make(name).fit(RSS, POSITION)
    together = algorithm.predict(RSS[:6])
    alone = np.concatenate([algorithm.predict(RSS[i : i + 1]) for i in range(6)])
    np.testing.assert_allclose(alone, together, atol=1e-8)


@pytest.mark.parametrize("name", [n for n in NAMES if hasattr(algorithm_class(n), "leave_one_out")])
def test_leave_one_out_equals_explicit_refits(name: str) -> None:
    shortcut = make(name).leave_one_out(RSS, POSITION)
    assert shortcut.shape == (COUNT, 2)
    np.testing.assert_allclose(shortcut, refit(make(name), RSS, POSITION, range(COUNT)), atol=1e-8, rtol=0)


@pytest.mark.parametrize("name", [n for n in NAMES if hasattr(algorithm_class(n), "leave_one_out")])
def test_leave_one_out_leaves_what_was_learned(name: str) -> None:
    algorithm = make(name)
    algorithm.leave_one_out(RSS, POSITION)
    with pytest.raises(NotFittedError, match="not fitted yet"):
        algorithm.predict(RSS)
    before = algorithm.fit(RSS, POSITION).predict(RSS)
    learned = dict(vars(algorithm))
    # Another survey, of fewer places.
    algorithm.leave_one_out(RSS[:40], POSITION[:40])
    np.testing.assert_array_equal(algorithm.predict(RSS), before)
    assert vars(algorithm).keys() == learned.keys()
    assert all(vars(algorithm)[key] is value for key, value in learned.items())


@pytest.mark.parametrize("name", ["expected_deviation", "knn", "mlp", "rbf_network", "svm", "wknn"])
def test_leave_one_out_of_fewer_access_points_leaves_what_was_learned(name: str) -> None:
    algorithm = make(name)
    before = algorithm.fit(RSS, POSITION).predict(RSS)
    algorithm.leave_one_out(RSS[:30, :3], POSITION[:30])
    np.testing.assert_array_equal(algorithm.predict(RSS), before)
    with pytest.raises(InputError, match="one column for each access point"):
        algorithm.predict(RSS[:, :3])


def test_leave_one_out_equals_explicit_refits_with_a_reduced_training_set() -> None:
    algorithm = make("rbf_network", training_samples=35)
    shortcut = algorithm.leave_one_out(RSS, POSITION)
    np.testing.assert_allclose(shortcut, refit(algorithm, RSS, POSITION, range(COUNT)), atol=1e-8, rtol=0)
    assert np.abs(shortcut - make("rbf_network").leave_one_out(RSS, POSITION)).max() > 0.1


@pytest.mark.parametrize("name", ["bayes_average", "bayes_maximum_likelihood"])
def test_leave_one_out_equals_explicit_refits_with_a_floor(name: str) -> None:
    algorithm = make(name, floor_dbm=FLOOR_DBM)
    tested = np.flatnonzero(np.isnan(RSS[:, :4]).any(axis=1))[:12]
    assert len(tested) == 12
    shortcut = algorithm.leave_one_out(RSS, POSITION)
    np.testing.assert_allclose(shortcut[tested], refit(algorithm, RSS, POSITION, tested), atol=1e-8, rtol=0)
    assert (shortcut != make(name).leave_one_out(RSS, POSITION)).any()


@pytest.mark.parametrize("name", NAMES)
def test_the_held_out_label_leaves_no_trace(name: str) -> None:
    for point in (0, 12, 33, COUNT - 1):
        before = leave_one_out(make(name), RSS, POSITION, point)
        for label in ((7.123, 11.456), (-3.1e5, 2.7e4)):
            changed = POSITION.copy()
            changed[point] = label
            np.testing.assert_array_equal(leave_one_out(make(name), RSS, changed, point), before)


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith("control_")])
def test_the_labels_that_train_do_leave_a_trace(name: str) -> None:
    moved = POSITION + np.random.default_rng(0).uniform(-3, 3, POSITION.shape)
    moved[41] = moved[40]
    changes = [
        leave_one_out(make(name), RSS, POSITION, i) != leave_one_out(make(name), RSS, moved, i)
        for i in (0, 33)
    ]
    assert np.any(changes)


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith("control_")])
def test_errors_are_below_those_of_the_centre(name: str) -> None:
    located = np.array(refit(make(name), RSS, POSITION, range(0, COUNT, 4)))
    centre = CORNER_M.mean(axis=0)
    error_m = np.linalg.norm(located - POSITION[::4], axis=1).mean()
    assert error_m < 0.75 * np.linalg.norm(centre - POSITION[::4], axis=1).mean()


@pytest.mark.parametrize("name", NAMES)
def test_fingerprints_that_do_not_fit_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="do not fit"):
        make(name).fit(RSS, POSITION[:-1])
    with pytest.raises(InputError, match="one column for each access point"):
        make(name).fit(RSS, POSITION).predict(RSS[:, :3])


@pytest.mark.parametrize("name", NAMES)
def test_skip_gives_no_reason_here(name: str) -> None:
    skip = getattr(make(name), "skip", None)
    shown = (SURVEY, SITE, TRUTH) if name == "control_oracle" else (SURVEY, SITE)
    assert skip is None or skip(*shown) is None


def test_skip_names_what_is_missing() -> None:
    assert "access points" in str(BayesAverage.skip(SURVEY, None))
    assert "access points" in str(BayesMaximumLikelihood.skip(SURVEY, Site(corner_m=CORNER_M)))
    many = Survey(rss_dbm=np.zeros((9000, 1)), position_m=np.zeros((9000, 2)))
    for cls in (RbfNetwork, RbfNetworkNearest, Template):
        assert "9000 fingerprints" in str(cls().skip(many, None))
    few = Survey(rss_dbm=np.zeros((5, 1)), position_m=np.arange(10.0).reshape(5, 2))
    assert Knn(k=4).skip(few, None) is None
    for algorithm in (Knn(k=5), Wknn(k=6), RbfNetwork(neurons=4), RbfNetworkNearest(nearest=5)):
        assert "this survey leaves 4" in str(algorithm.skip(few, None))
    assert "synthetic" in str(ControlOracle.skip(SURVEY, SITE, Truth(position_m=POSITION)))


# Perceptron and support vectors against scikit-learn's


def standardised() -> tuple[Array, Array, StandardScaler]:
    """Return readings and coordinates as scikit-learn's scaler has them, and the scaler of the latter."""
    scaler = StandardScaler().fit(POSITION)
    reading = StandardScaler().fit_transform(fill_not_heard(RSS, -100.0))
    return reading, scaler.transform(POSITION), scaler


@pytest.mark.parametrize("weight_decay", [1e-4, 0.3])
def test_perceptron_equals_that_of_scikit_learn(weight_decay: float) -> None:
    reading, coordinate, scaler = standardised()
    settings = {"hidden_layer_sizes": (8,), "activation": "tanh", "solver": "lbfgs", "random_state": 3}
    reference = MLPRegressor(alpha=weight_decay, max_iter=15, **settings)
    with pytest.warns(ConvergenceWarning):
        reference.fit(reading, coordinate)
    ours = Mlp(weight_decay=weight_decay, iterations=15, random_state=3).fit(RSS, POSITION)
    expected = scaler.inverse_transform(reference.predict(reading))
    np.testing.assert_allclose(ours.predict(RSS), expected, atol=1e-8)


def test_perceptrons_of_folds_in_parts_are_those_of_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    together = make("mlp").leave_one_out(RSS, POSITION)
    monkeypatch.setattr(mlp, "_INPUT_BYTES", 7 * 8 * 6 * COUNT)
    monkeypatch.setattr(mlp, "_NETWORKS_AT_ONCE", 3)
    np.testing.assert_array_equal(make("mlp").leave_one_out(RSS, POSITION), together)


def test_support_vectors_equal_those_of_scikit_learn() -> None:
    reading, coordinate, scaler = standardised()
    machines = [
        SVR(C=1.0, epsilon=0.75 / scaler.scale_[axis], gamma=0.2).fit(reading, coordinate[:, axis])
        for axis in range(2)
    ]
    expected = scaler.inverse_transform(np.stack([m.predict(reading) for m in machines], axis=1))
    np.testing.assert_allclose(Svm().fit(RSS, POSITION).predict(RSS), expected, atol=1e-9)


def test_standardisation_equals_that_of_scikit_learn() -> None:
    values = np.column_stack([RSS.copy(), np.full(COUNT, 0.1), np.full(COUNT, -100.0)])
    values = fill_not_heard(values, -100.0)
    member = np.random.default_rng(4).random((6, COUNT)) < 0.5
    mean, deviation = standardisation(values, member)
    for fold, chosen in enumerate(member):
        reference = StandardScaler().fit(values[chosen])
        np.testing.assert_allclose(mean[fold], reference.mean_, rtol=1e-13)
        np.testing.assert_allclose(deviation[fold], reference.scale_, rtol=1e-12)


@pytest.mark.parametrize("limit", [0, 10**9])
def test_signal_distances_equal_those_of_scipy(monkeypatch: pytest.MonkeyPatch, limit: int) -> None:
    monkeypatch.setattr(fingerprints, "_MANY_DIFFERENCES", limit)
    rng = np.random.default_rng(6)
    first, second = rng.normal(-60, 9, (21, 7)), rng.normal(-60, 9, (13, 7))
    distance_db = signal_distance_db(first, second)
    np.testing.assert_allclose(distance_db, cdist(first, second), rtol=1e-14)
    assert signal_distance_db(first[:0], second).shape == (0, 13)
    twice = signal_distance_db(first, np.vstack([second, second]))
    np.testing.assert_array_equal(twice[:, :13], twice[:, 13:])
    with pytest.raises(ValueError, match=r"shorter|number of columns|must have"):
        signal_distance_db(first, second[:, :6])


# Nearest neighbours


def test_wknn_by_hand() -> None:
    rss = np.array([[-50.0, -60.0], [-53.0, -64.0], [-50.0, -50.0], [-90.0, -90.0]])
    position = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 8.0], [50.0, 50.0]])
    located = Wknn(k=3, distance_offset_db=1.0).fit(rss, position).predict([[-50.0, -60.0]])
    weights = np.array([1.0, 1 / 6, 1 / 11])
    np.testing.assert_allclose(located, [[4 / 6 / weights.sum(), 8 / 11 / weights.sum()]], rtol=1e-14)


def test_knn_takes_the_first_of_equally_near_ones() -> None:
    rss = np.array([[-60.0], [-50.0], [-60.0], [-40.0], [-50.0]])
    position = np.arange(10.0).reshape(5, 2)
    np.testing.assert_array_equal(Knn(k=1).fit(rss, position).predict([[-55.0]]), position[[0]])
    np.testing.assert_array_equal(Knn(k=3).fit(rss, position).predict([[-55.0]]), [position[:3].mean(axis=0)])


def test_many_equally_near_ones_are_taken_by_index() -> None:
    distance_db = np.tile([3.0, 1.0, 2.0], 100)[None]
    np.testing.assert_array_equal(nearest_members(distance_db, 90), [np.arange(1, 271, 3)])


def test_not_heard_counts_as_weak() -> None:
    rss = np.array([[np.nan, -50.0], [-70.0, -50.0]])
    located = (
        Knn(k=1, not_heard_dbm=-100.0)
        .fit(rss, [[0.0, 0.0], [1.0, 1.0]])
        .predict([[-84.0, -50], [-86.0, -50]])
    )
    np.testing.assert_array_equal(located, [[1.0, 1.0], [0.0, 0.0]])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_nearest_neighbours_equal_those_of_scikit_learn(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    rss, position, tested = (
        rng.normal(-60, 10, (30, 4)),
        rng.uniform(0, 20, (30, 2)),
        rng.normal(-60, 10, (9, 4)),
    )
    reference = KNeighborsRegressor(k, algorithm="brute").fit(rss, position)
    np.testing.assert_allclose(
        Knn(k=k).fit(rss, position).predict(tested), reference.predict(tested), rtol=1e-9
    )
    weighted = KNeighborsRegressor(k, weights=lambda distance: 1 / (distance + 0.01), algorithm="brute")
    expected = weighted.fit(rss, position).predict(tested)
    np.testing.assert_allclose(Wknn(k=k).fit(rss, position).predict(tested), expected, rtol=1e-9)


def test_one_neighbour_weighted_or_not_is_the_nearest() -> None:
    nearest = np.argmin(
        np.where(training_members(POSITION), signal_distance_db(*[fill_not_heard(RSS, -100)] * 2), 1e9), 1
    )
    for algorithm in (Knn(k=1), Wknn(k=1)):
        np.testing.assert_allclose(algorithm.leave_one_out(RSS, POSITION), POSITION[nearest], rtol=1e-14)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(-50, 50), st.floats(-20, 20))
def test_neighbours_follow_a_moved_site_and_ignore_a_common_gain(
    seed: int, shift_m: float, gain_db: float
) -> None:
    rng = np.random.default_rng(seed)
    rss, position, tested = (
        rng.normal(-60, 10, (20, 3)),
        rng.uniform(0, 20, (20, 2)),
        rng.normal(-60, 10, (5, 3)),
    )
    for algorithm in (Knn(), Wknn(), Template()):
        located = algorithm.fit(rss, position).predict(tested)
        moved = algorithm.fit(rss + gain_db, position + shift_m).predict(tested + gain_db)
        np.testing.assert_allclose(moved, located + shift_m, atol=1e-8)


@pytest.mark.parametrize("algorithm", [Knn(k=6), Wknn(k=6), RbfNetworkNearest(nearest=6)])
def test_more_neighbours_than_training_fingerprints_are_refused(algorithm: Any) -> None:
    rss, position = np.arange(5.0)[:, None] - 60, np.arange(10.0).reshape(5, 2)
    with pytest.raises(
        InputError, match="=6: it must lie between 1 and the number of training fingerprints, 5"
    ):
        algorithm.fit(rss, position).predict(rss)
    with pytest.raises(InputError, match="4"):
        algorithm.leave_one_out(rss, position)


def test_senseless_settings_are_refused() -> None:
    with pytest.raises(InputError, match="k=0"):
        Knn(k=0).fit(RSS, POSITION).predict(RSS)
    with pytest.raises(InputError, match="distance_offset_db=0"):
        Wknn(distance_offset_db=0.0).fit(RSS, POSITION)
    with pytest.raises(InputError, match="training_samples=1000"):
        RbfNetwork(training_samples=1000).fit(RSS, POSITION)
    with pytest.raises(InputError, match="needs a site"):
        BayesAverage().fit(RSS, POSITION)
    with pytest.raises(InputError, match="5 access points, but fingerprints of 3"):
        BayesAverage(site=SITE).fit(RSS[:, :3], POSITION)
    with pytest.raises(InputError, match="synthetic worlds only"):
        ControlOracle(truth=Truth(position_m=POSITION)).fit(RSS, POSITION)
    with pytest.raises(InputError, match="access points of the true world"):
        ControlOracle(truth=TRUTH).fit(RSS[:, :3], POSITION)


# Networks


def test_the_nearest_network_of_all_fingerprints_is_the_global_one() -> None:
    everywhere = RbfNetworkNearest(nearest=COUNT, neurons=12, spread_db=45.0).fit(RSS, POSITION).predict(RSS)
    whole = RbfNetwork(neurons=12).fit(RSS, POSITION).predict(RSS)
    np.testing.assert_allclose(everywhere, whole, atol=1e-7)


def test_newrb_is_the_paper_kernel_with_a_wider_spread() -> None:
    newrb = RbfNetwork(neurons=12, kernel="newrb", spread_db=30.0).leave_one_out(RSS, POSITION)
    paper = RbfNetwork(neurons=12, spread_db=30.0 / np.log(2.0) ** 0.5).leave_one_out(RSS, POSITION)
    np.testing.assert_allclose(newrb, paper, atol=1e-7)


def test_random_state_draws_the_reduced_training_set() -> None:
    first, second = (
        RbfNetwork(neurons=8, training_samples=30, random_state=seed).fit(RSS, POSITION).rss_dbm_
        for seed in (1, 2)
    )
    assert first.shape == (30, 5)
    assert (first != second).any()


# Bayes and controls


def test_bayes_finds_places_in_a_world_that_follows_the_model() -> None:
    rng = np.random.default_rng(3)
    position = rng.uniform(CORNER_M[0], CORNER_M[1], (80, 2))
    corners = np.array([[0.3, 0.2], [14.6, 0.4], [0.5, 11.7], [14.2, 11.5]])
    site = Site(corner_m=CORNER_M, access_point_m=corners)
    distance_m = np.linalg.norm(position[:, None] - corners, axis=-1)
    rss = -40 - 15 * np.log(np.maximum(distance_m, 0.5))
    for cls in (BayesAverage, BayesMaximumLikelihood):
        located = cls(site=site, grid_step_m=0.25).leave_one_out(rss, position)
        error_m = np.linalg.norm(located - position, axis=1)
        # Half the diagonal of a cell, and more only where the posterior is cut off by the site's edge.
        assert np.quantile(error_m, 0.9) < 0.18
        assert error_m.max() < 0.5


def test_bayes_stays_inside_the_site() -> None:
    for cls in (BayesAverage, BayesMaximumLikelihood):
        located = (
            cls(site=SITE).fit(RSS, POSITION).predict(np.random.default_rng(0).uniform(-95, -30, (50, 5)))
        )
        assert (located >= CORNER_M[0]).all()
        assert (located <= CORNER_M[1]).all()


def test_bayes_without_any_reading_is_the_centre() -> None:
    for cls in (BayesAverage, BayesMaximumLikelihood):
        located = cls(site=SITE).fit(RSS, POSITION).predict(np.full((1, 5), np.nan))
        np.testing.assert_allclose(located, [[7.5, 6.0]], rtol=1e-12)


def test_centre() -> None:
    np.testing.assert_array_equal(
        ControlCentre(site=SITE).fit(RSS, POSITION).predict(RSS[:2]), [[7.5, 6.0]] * 2
    )
    located = ControlCentre().fit(np.zeros((3, 1)), [[0.0, 0.0], [1.0, 0.0], [4.0, 2.0]]).predict([[0.0]])
    np.testing.assert_array_equal(located, [[2.0, 1.0]])


def oracle_world(noise_db: float) -> tuple[Truth, Array]:
    """Return a truth without silent points, and readings from it."""
    rng = np.random.default_rng(8)
    field = rng.uniform(-70, -40, (60, 4))
    truth = Truth(
        position_m=rng.uniform(0, 20, (60, 2)),
        field_dbm=field,
        noise_db=np.array(noise_db),
        floor_dbm=np.array(-65.0),
    )
    rss = np.round(field + noise_db * rng.standard_normal(field.shape))
    return truth, np.where(rss < -65.0, np.nan, rss)


@pytest.mark.parametrize("noise_db", [0.0, 1e-6, 0.05])
def test_oracle_with_tiny_noise_finds_the_point(noise_db: float) -> None:
    truth, rss = oracle_world(noise_db)
    located = ControlOracle(truth=truth).leave_one_out(rss, truth.position_m)
    np.testing.assert_allclose(located, truth.position_m, atol=1e-6)


def test_oracle_with_huge_noise_knows_the_mean_only() -> None:
    truth, rss = oracle_world(2.0)
    blind = Truth(
        position_m=truth.position_m,
        field_dbm=truth.field_dbm,
        noise_db=np.array(1e7),
        floor_dbm=np.array(-65.0),
    )
    located = ControlOracle(truth=blind).leave_one_out(rss, truth.position_m)
    np.testing.assert_allclose(located, np.tile(truth.position_m.mean(axis=0), (60, 1)), atol=1e-3)


def test_oracle_equals_the_posterior_by_hand() -> None:
    truth, rss = oracle_world(4.0)
    assert truth.field_dbm is not None
    located = ControlOracle(truth=truth).leave_one_out(rss, truth.position_m)
    cell = stats.norm(truth.field_dbm, 4.0)
    for point in range(60):
        heard = ~np.isnan(rss[point])
        probability = np.where(
            heard, cell.cdf(rss[point] + 0.5) - cell.cdf(rss[point] - 0.5), cell.cdf(-65.5)
        )
        posterior = probability.prod(axis=1)
        np.testing.assert_allclose(located[point], posterior @ truth.position_m / posterior.sum(), atol=1e-8)


def test_oracle_knows_how_unlikely_a_reading_is() -> None:
    lower, upper = np.array([-10.5, 10.0, -0.2, 3.0]), np.array([-10.0, 10.5, 0.3, 3.0001])
    normal = stats.norm
    expected = np.log([normal.sf(10) - normal.sf(10.5)] * 2 + [normal.cdf(0.3) - normal.cdf(-0.2)])
    np.testing.assert_allclose(log_probability_between(lower, upper)[:3], expected, rtol=1e-12)
    # A narrow cell: density times width.
    narrow = normal.logpdf(3.00005) + np.log(1e-4)
    np.testing.assert_allclose(log_probability_between(lower, upper)[3], narrow, rtol=1e-7)
    # Where the upper tail is below the smallest number, it still mirrors the lower one.
    far = log_probability_between(np.array([50.0, -50.5]), np.array([50.5, -50.0]))
    np.testing.assert_allclose(far, normal.logsf(50.0), rtol=1e-9)
    # So far out that the two ends cannot be told apart any more.
    assert np.isfinite(log_probability_between(np.array([-1e18]), np.array([-1e18]))).all()


def test_oracle_beats_every_row() -> None:
    worlds = [make_world(seed) for seed in range(4)]
    squared: dict[str, list[float]] = {}
    for survey, site, truth in worlds:
        known: dict[str, Any] = {
            "oracle": ControlOracle(truth=truth),
            "wknn": Wknn(),
            "template": Template(),
            "bayes": BayesAverage(site=site, grid_step_m=1.0),
            "rbf": RbfNetwork(neurons=12),
        }
        for name, algorithm in known.items():
            located = algorithm.leave_one_out(survey.rss_dbm, survey.position_m)
            squared.setdefault(name, []).append(float(np.mean((located - survey.position_m) ** 2)))
    for name in ("wknn", "template", "bayes", "rbf"):
        assert np.mean(squared["oracle"]) < np.mean(squared[name])


# Common parts


def test_training_members_leave_out_the_whole_reference_point() -> None:
    member = training_members([[0.0, 1.0], [0.0, 1.0], [0.0, 2.0], [1.0, 1.0]])
    np.testing.assert_array_equal(member[0], [False, False, True, True])
    np.testing.assert_array_equal(member[2], [True, True, False, True])
    np.testing.assert_array_equal(member, member.T)


def test_signal_distance_by_hand() -> None:
    np.testing.assert_allclose(signal_distance_db([[-50, -60]], [[-53, -64], [-50, -60]]), [[5.0, 0.0]])


def test_nearest_members_skip_those_that_do_not_train() -> None:
    distance_db = np.array([[1.0, 2.0, 0.5, 2.0]])
    np.testing.assert_array_equal(nearest_members(distance_db, 3), [[2, 0, 1]])
    member = np.array([[True, True, False, True]])
    np.testing.assert_array_equal(nearest_members(distance_db, 3, member), [[0, 1, 3]])


def test_fill_not_heard_learns_from_the_training() -> None:
    training, tested = np.array([[-50.0, np.nan], [-81.0, -60.0]]), np.array([[np.nan, -99.0]])
    np.testing.assert_array_equal(FillNotHeard().fit(training).transform(tested), [[-82.0, -99.0]])
    np.testing.assert_array_equal(
        FillNotHeard(value_dbm=-110.0).fit(training).transform(tested), [[-110.0, -99.0]]
    )
    assert np.isfinite(FillNotHeard().fit(np.full((2, 2), np.nan)).transform(tested)).all()
    assert np.isnan(training).sum() == 1
