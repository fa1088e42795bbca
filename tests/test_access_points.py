"""Every choice of access points against its contract, and the regressors of the reduced map."""

import importlib
import inspect
import pkgutil
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.ensemble import RandomForestRegressor
from sklearn.pipeline import make_pipeline

import algorithms.access_points
from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from algorithms.access_points.principal_components import PrincipalComponents
from algorithms.access_points.random_choice import RandomChoice
from algorithms.access_points.strongest import Strongest
from algorithms.access_points.template import Template
from algorithms.fingerprinting.knn import Knn
from algorithms.fingerprinting.knn_softmax import KnnSoftmax, softmax_weights
from algorithms.fingerprinting.reduced import Reduced
from algorithms.fingerprinting.wknn import Wknn
from positioning.errors import InputError
from positioning.fingerprints import signal_distance_db
from positioning.model import Array, Site, Survey
from positioning.orthogonal_search import orthogonal_search
from positioning.registry import class_name, factory

NAMES = sorted(module.name for module in pkgutil.iter_modules(algorithms.access_points.__path__))
SELECTIONS = [name for name in NAMES if name != "principal_components"]
SITE = Site(corner_m=np.array([[0.0, 0.0], [30.0, 30.0]]))


def make_map(seed: int = 3, places: int = 40, columns: int = 12) -> tuple[Array, Array]:
    """Return strengths with NaN, a column that is never heard, one heard once, and a silent place."""
    rng = np.random.default_rng(seed)
    position_m, radio_m = rng.uniform(0, 30, (places, 2)), rng.uniform(-10, 40, (columns, 2))
    distance_m = np.linalg.norm(position_m[:, None] - radio_m, axis=-1)
    rss = np.round(-35 - 30 * np.log10(np.maximum(distance_m, 1)) + rng.normal(0, 2, distance_m.shape))
    rss = np.where(rss < -80, np.nan, rss)
    rss[:, 5] = np.nan
    rss[:, 7] = np.nan
    rss[9, 7] = -30.0
    rss[12] = np.nan
    return rss, position_m


RSS, POSITION = make_map()


def algorithm_class(name: str) -> Any:
    """Return the class of a file."""
    return getattr(importlib.import_module(f"algorithms.access_points.{name}"), class_name(name))


# The contract


def test_all_of_the_study_are_found() -> None:
    assert set(NAMES) >= {
        *("fast_orthogonal_search", "principal_components", "random_choice", "strongest", "template"),
    }


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_keywords_documented_and_stored_unchanged(name: str) -> None:
    cls = algorithm_class(name)
    parameters = inspect.signature(cls).parameters
    text = inspect.getdoc(cls) or ""
    for parameter in parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert f"\n{parameter.name}\n    " in text, parameter.name
    assert parameters["columns"].default == 4
    assert parameters["not_heard_dbm"].default == -100.0
    transformer = cls(columns=3, not_heard_dbm=-95.0)
    before = transformer.get_params()
    assert before["columns"] == 3
    transformer.fit(RSS).transform(RSS)
    assert transformer.get_params() == before == clone(transformer).get_params()
    assert not hasattr(clone(transformer), "n_features_in_")
    assert transformer.set_params(columns=2).fit(RSS).transform(RSS).shape == (len(RSS), 2)


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_repeatable_and_leave_inputs_and_global_random_state_alone(name: str) -> None:
    state, rss, position = np.random.get_state(), RSS.copy(), POSITION.copy()  # noqa: NPY002
    first, second = (algorithm_class(name)().fit(rss, position).transform(rss) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, algorithm_class(name)().fit_transform(rss))
    np.testing.assert_array_equal(rss, RSS)
    np.testing.assert_array_equal(position, POSITION)
    for old, new in zip(state, np.random.get_state(), strict=True):  # noqa: NPY002
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("name", SELECTIONS)
def test_selections_keep_columns_as_they_are(name: str) -> None:
    transformer = algorithm_class(name)(columns=12).fit(RSS)
    assert sorted(transformer.selected_) == list(range(12))
    few = algorithm_class(name)(columns=5).fit(RSS)
    np.testing.assert_array_equal(few.selected_, transformer.selected_[:5])
    np.testing.assert_array_equal(few.transform(RSS), RSS[:, few.selected_])
    assert np.isnan(few.transform(np.full((2, 12), np.nan))).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_row_is_transformed_alone_as_among_others(name: str) -> None:
    transformer = algorithm_class(name)().fit(RSS)
    alone = np.concatenate([transformer.transform(RSS[i : i + 1]) for i in range(len(RSS))])
    np.testing.assert_array_equal(alone, transformer.transform(RSS))


@pytest.mark.parametrize("name", NAMES)
def test_input_that_cannot_be_used_is_refused(name: str) -> None:
    cls = algorithm_class(name)
    with pytest.raises(InputError, match="columns=13: it must lie between 1 and 12"):
        cls(columns=13).fit(RSS)
    with pytest.raises(InputError, match="columns=0"):
        cls(columns=0).fit(RSS)
    for columns in ("four", 2.0, None):
        with pytest.raises(InputError, match=r"columns=.*not a whole number"):
            cls(columns=columns).fit(RSS)
    with pytest.raises(InputError, match="n from 1"):
        cls().fit(RSS[:0])
    with pytest.raises(InputError, match=r"rss_dbm\[0, 2\]"):
        cls(columns=1).fit([[-50.0, np.nan, np.inf]])
    with pytest.raises(InputError, match=r"\[n, 12\] is needed"):
        cls().fit(RSS).transform(RSS[:, :5])
    with pytest.raises(ValueError, match="not fitted"):
        cls().transform(RSS)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("regressor", [Wknn(k=6), KnnSoftmax(), Knn(k=3)])
def test_they_stand_in_front_of_a_regressor_in_a_pipeline(name: str, regressor: Any) -> None:
    pipeline = make_pipeline(algorithm_class(name)(columns=3), regressor)
    located = clone(pipeline).fit(RSS, POSITION).predict(RSS)
    assert located.shape == POSITION.shape
    assert np.isfinite(located).all()
    reduced = Reduced(access_points=algorithm_class(name)(columns=3), regressor=regressor)
    np.testing.assert_array_equal(reduced.fit(RSS, POSITION).predict(RSS), located)
    step = name.replace("_", "")
    pipeline.set_params(**{f"{step}__columns": 5})
    assert pipeline.get_params()[f"{step}__columns"] == 5
    assert np.abs(pipeline.fit(RSS, POSITION).predict(RSS) - located).max() > 0


@pytest.mark.parametrize("name", NAMES)
def test_maps_that_tell_nothing_give_finite_places(name: str) -> None:
    silent = np.full((6, 5), np.nan)
    for rss in (silent, np.full((6, 5), -60.0)):
        reduced = Reduced(access_points=algorithm_class(name)()).fit(rss, POSITION[:6])
        assert np.isfinite(reduced.predict(np.vstack([silent, RSS[:4, :5]]))).all()


# Each by itself


def test_fast_orthogonal_search_fills_what_was_not_heard() -> None:
    for method in ("total", "threshold"):
        found = FastOrthogonalSearch(columns=5, method=method, not_heard_dbm=-90.0).fit(RSS)
        expected = orthogonal_search(np.nan_to_num(RSS, nan=-90.0), 5, method=method)
        np.testing.assert_array_equal(found.selected_, expected.selected)
        np.testing.assert_array_equal(found.reduction_, expected.reduction)
    assert FastOrthogonalSearch(columns=12).fit(RSS).selected_[-1] == 5
    with pytest.raises(InputError, match="method='best'"):
        FastOrthogonalSearch(method="best").fit(RSS)


def test_strongest_by_hand() -> None:
    # Means with -100 for not heard: -60, -65, -65, and -77.5, though the last is the strongest where heard.
    rss = np.array([[-60.0, -50.0, -65.0, -55.0], [-60.0, -80.0, -65.0, np.nan]])
    np.testing.assert_array_equal(Strongest(columns=3).fit(rss).selected_, [0, 1, 2])
    np.testing.assert_array_equal(Strongest(columns=2, not_heard_dbm=-56.0).fit(rss).selected_, [3, 0])


def test_template_takes_the_largest_variance() -> None:
    rss = np.array([[-60.0, -50.0, np.nan], [-61.0, -70.0, -99.0]])
    np.testing.assert_array_equal(Template(columns=2).fit(rss).selected_, [1, 0])


def test_random_choice_draws_every_column_equally_often() -> None:
    rss = np.zeros((1, 6))
    drawn = [RandomChoice(columns=2, random_state=seed).fit(rss).selected_ for seed in range(600)]
    count = np.bincount(np.concatenate(drawn), minlength=6)
    # Binomial with mean 200 and deviation 11.5.
    assert np.abs(count - 200).max() < 55
    assert all(len(set(columns)) == 2 for columns in drawn)


def test_principal_components_are_those_of_scikit_learn() -> None:
    filled = np.nan_to_num(RSS, nan=-90.0)
    reference = PCA(4, svd_solver="full").fit(filled)
    found = PrincipalComponents(not_heard_dbm=-90.0).fit(RSS)
    np.testing.assert_allclose(found.transform(RSS), reference.transform(filled), atol=1e-10)
    whole = PrincipalComponents(columns=12).fit(RSS).transform(RSS)
    filled = np.nan_to_num(RSS, nan=-100.0)
    np.testing.assert_allclose(
        signal_distance_db(whole, whole), signal_distance_db(filled, filled), atol=1e-6
    )
    with pytest.raises(InputError, match="between 1 and 3"):
        PrincipalComponents(columns=4).fit(RSS[:3])


# Nearest neighbours with a softmax


def test_softmax_weights_equal_the_literal_formula_where_that_is_finite() -> None:
    distance_db = np.random.default_rng(0).uniform(0.0, 12.0, (50, 4))
    literal = np.exp(-(distance_db**2))
    expected = literal / literal.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(softmax_weights(distance_db), expected, rtol=1e-12)
    literal = np.exp(-(distance_db**2) / 49.0)
    expected = literal / literal.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(softmax_weights(distance_db, 7.0), expected, rtol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.0, 1000.0), min_size=1, max_size=8), st.floats(1e-6, 1e6))
def test_softmax_weights_are_finite_and_sum_to_one(distance_db: list[float], scale_db: float) -> None:
    weight = softmax_weights(distance_db, scale_db)
    assert np.isfinite(weight).all()
    assert weight[np.argmin(distance_db)] == weight.max()
    assert (np.diff(weight[np.argsort(distance_db)]) <= 0).all()
    np.testing.assert_allclose(weight.sum(), 1.0, rtol=1e-12)


def test_softmax_weights_by_hand() -> None:
    weight = softmax_weights([1000.0, np.sqrt(1e6 + np.log(3.0)), 1e5])
    np.testing.assert_allclose(weight, [0.75, 0.25, 0.0], rtol=1e-8)


def test_knn_softmax_by_hand() -> None:
    rss = np.array([[-50.0, -60.0], [-53.0, -64.0], [-50.0, -55.0], [-90.0, -90.0]])
    position = np.array([[1.0, 0.0], [4.0, 0.0], [0.0, 8.0], [50.0, 50.0]])
    located = KnnSoftmax(k=3, scale_db=5.0).fit(rss, position).predict([[-50.0, -60.0]])
    np.testing.assert_allclose(located, [np.array([np.e + 4, 8.0]) / (np.e + 2)], rtol=1e-12)
    # As printed, with 1 dB, it is the nearest one; with a very large scale it is the mean of the nearest.
    located = KnnSoftmax(k=3).fit(rss, position).predict([[-50.0, -60.0]])
    np.testing.assert_allclose(located, [[1.0, 0.0]], atol=1e-9)
    located = KnnSoftmax(k=3, scale_db=1e6).fit(rss, position).predict([[-50.0, -60.0]])
    np.testing.assert_allclose(located, [[5 / 3, 8 / 3]], rtol=1e-9)


def test_with_one_decibel_k_hardly_matters() -> None:
    tested = RSS + np.random.default_rng(1).normal(0, 3, RSS.shape)
    nearest = KnnSoftmax(k=1).fit(RSS, POSITION).predict(tested)
    four = KnnSoftmax(k=4).fit(RSS, POSITION).predict(tested)
    assert np.mean(np.linalg.norm(four - nearest, axis=1) < 0.01) > 0.9
    soft = KnnSoftmax(k=4, scale_db=15.0).fit(RSS, POSITION).predict(tested)
    assert np.mean(np.linalg.norm(soft - nearest, axis=1) < 0.01) < 0.2


@pytest.mark.parametrize("scale_db", [0.0, -1.0, np.nan, np.inf])
def test_senseless_scales_are_refused(scale_db: float) -> None:
    with pytest.raises(InputError, match="scale_db="):
        KnnSoftmax(scale_db=scale_db).fit(RSS, POSITION)


def test_more_neighbours_than_fingerprints_are_refused() -> None:
    with pytest.raises(InputError, match="k=6: it must lie between 1"):
        KnnSoftmax(k=6).fit(RSS[:5], POSITION[:5]).predict(RSS)
    few = Survey(rss_dbm=RSS[:5], position_m=POSITION[:5])
    for k in ("four", 2.5):
        with pytest.raises(InputError, match=r"k=.*not a whole number"):
            KnnSoftmax(k=k).skip(few, None)  # type: ignore[arg-type]
    assert KnnSoftmax(k=4).skip(few, None) is None
    assert "this survey leaves 4" in str(KnnSoftmax(k=5).skip(few, None))


# The reduced map


def test_reduced_learns_choice_and_regressor_from_the_survey() -> None:
    reduced = Reduced().fit(RSS, POSITION)
    columns = FastOrthogonalSearch(columns=4).fit(RSS).selected_
    expected = KnnSoftmax().fit(RSS[:, columns], POSITION).predict(RSS[:, columns])
    np.testing.assert_array_equal(reduced.predict(RSS), expected)
    np.testing.assert_array_equal(reduced.access_points_.selected_, columns)
    choice, regressor = Strongest(columns=5), Wknn(k=2)
    Reduced(access_points=choice, regressor=regressor).fit(RSS, POSITION)
    assert not hasattr(choice, "selected_")
    assert not hasattr(regressor, "position_m_")


def test_reduced_works_with_a_regressor_of_a_library() -> None:
    forest = RandomForestRegressor(n_estimators=20, random_state=0)
    reduced = Reduced(access_points=FastOrthogonalSearch(columns=6), regressor=forest).fit(RSS, POSITION)
    error_m = np.linalg.norm(reduced.predict(RSS) - POSITION, axis=1)
    assert np.median(error_m) < 4.0
    survey = Survey(rss_dbm=RSS, position_m=POSITION)
    assert reduced.skip(survey, SITE) is None


def test_reduced_reads_from_a_line_of_the_configuration() -> None:
    line = {
        "access_points": {"use": "fast_orthogonal_search", "task": "access_points", "columns": 3},
        "regressor": {"use": "wknn", "task": "fingerprinting", "k": 6},
    }
    built = factory("reduced", "fingerprinting", line)(site=SITE, random_state=3)
    expected = make_pipeline(FastOrthogonalSearch(columns=3), Wknn(k=6)).fit(RSS, POSITION).predict(RSS)
    np.testing.assert_array_equal(built.fit(RSS, POSITION).predict(RSS), expected)


def test_reduced_skips_maps_that_are_too_small() -> None:
    survey = Survey(rss_dbm=RSS[:, :3], position_m=POSITION)
    assert "columns = 4 are asked of a map of 3" in str(Reduced().skip(survey, SITE))
    assert Reduced(access_points=FastOrthogonalSearch(columns=3)).skip(survey, SITE) is None
    few = Survey(rss_dbm=RSS[:4], position_m=POSITION[:4])
    assert "k = 4 needs 4" in str(Reduced().skip(few, SITE))
    with pytest.raises(InputError, match="columns=4"):
        Reduced().fit(RSS[:, :3], POSITION)
