"""The runner of the fingerprinting task and the making of algorithms from configuration lines."""

from typing import Any

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin

from positioning.errors import InputError
from positioning.model import Query, Site, Survey, Truth, Worlds
from positioning.registry import class_name, factory
from positioning.seeds import stream
from positioning.tasks import fingerprinting as task

COUNT = 9


def worlds(seed: int = 0, count: int = 2, query: bool = False) -> Worlds:
    rng = np.random.default_rng(seed)
    position = rng.uniform(0, 10, (count, COUNT, 2))
    rss = -40 - 3 * position @ rng.normal(size=(2, 4))
    site = Site(corner_m=np.tile([[0.0, 0.0], [10.0, 10.0]], (count, 1, 1)))
    observed = {**site.to_arrays(), **Survey(rss_dbm=rss, position_m=position).to_arrays()}
    if query:
        observed |= Query(rss_dbm=rss[:, :3] + 0.01).to_arrays()
    return Worlds(observed, Truth(position_m=position[:, :3] if query else position).to_arrays())


def run(make: Any, stack: Worlds, truth: Any = None, **options: Any) -> np.ndarray:
    generators = [stream(i, "test") for i in range(len(stack.observed["survey.rss_dbm"]))]
    return task.run(make, stack.observed, truth, options, generators).estimates["position_m"]


NEAREST = factory("knn", "fingerprinting", {"k": 1})


def test_leave_one_out_never_returns_the_point_itself_and_resubstitution_does() -> None:
    stack = worlds()
    truth = stack.truth["truth.position_m"]
    left_out = run(NEAREST, stack)
    assert (np.linalg.norm(left_out - truth, axis=-1) > 0).all()
    np.testing.assert_array_equal(run(NEAREST, stack, protocol="resubstitution"), truth)


def test_holdout_trains_on_the_other_half_only() -> None:
    stack = worlds()
    estimate, position = run(NEAREST, stack, protocol="holdout"), stack.truth["truth.position_m"]
    for w in range(2):
        for i in range(COUNT):
            other = position[w, (i + 1) % 2 :: 2]
            assert (estimate[w, i] == other).all(axis=-1).any()


def test_a_query_is_located_with_the_whole_survey() -> None:
    stack = worlds(query=True)
    np.testing.assert_array_equal(run(NEAREST, stack), stack.truth["truth.position_m"])
    with pytest.raises(InputError, match="no query"):
        run(NEAREST, worlds(), protocol="survey_to_query")


@pytest.mark.parametrize("use", ["wknn", "sklearn.linear_model.Ridge"])
def test_explicit_refits_and_shortcuts_obey_the_same_protocol(use: str) -> None:
    """The held-out label does not touch its own estimate, whichever way the runner goes."""
    stack = worlds()
    moved = {**stack.observed, "survey.position_m": stack.observed["survey.position_m"].copy()}
    moved["survey.position_m"][0, 4] += 3.0
    make = factory(use, "fingerprinting", {})
    before, after = run(make, stack), run(make, Worlds(moved, stack.truth))
    np.testing.assert_array_equal(before[0, 4], after[0, 4])
    assert (before[0] != after[0]).any()
    np.testing.assert_array_equal(before[1], after[1])


def test_duplicate_places_are_left_out_together() -> None:
    stack = worlds()
    for arrays, name in ((stack.observed, "survey.position_m"), (stack.truth, "truth.position_m")):
        arrays[name][:, 1] = arrays[name][:, 0]
    stack.observed["survey.rss_dbm"][:, 1] = stack.observed["survey.rss_dbm"][:, 0]
    errors = np.linalg.norm(run(NEAREST, stack) - stack.truth["truth.position_m"], axis=-1)
    assert (errors[:, :2] > 0).all()


def test_results_do_not_depend_on_the_stack() -> None:
    stack = worlds(count=3)
    make = factory("mlp", "fingerprinting", {"iterations": 5})
    together = task.run(make, stack.observed, None, {}, [stream(i, "t") for i in range(3)]).estimates[
        "position_m"
    ]
    alone = {name: values[2:] for name, values in stack.observed.items()}
    single = task.run(make, alone, None, {}, [stream(2, "t")]).estimates["position_m"]
    np.testing.assert_array_equal(together[2], single[0])


class Wrong(RegressorMixin, BaseEstimator):
    answer: Any = None

    def fit(self, rss_dbm: Any, position_m: Any) -> "Wrong":
        return self

    def predict(self, rss_dbm: Any) -> Any:
        return np.asarray(self.answer)


@pytest.mark.parametrize("answer", [[[np.nan, 0.0]], [[1.0, 2.0, 3.0]]])
def test_a_wrong_answer_is_refused(answer: Any) -> None:
    Wrong.answer = answer

    def make(**context: Any) -> Wrong:
        return Wrong()

    make.algorithm_class = Wrong  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="finite"):
        run(make, worlds())


def test_one_point_alone_is_refused() -> None:
    stack = worlds()
    one = {name: v[:, :1] if name.startswith("survey") else v for name, v in stack.observed.items()}
    with pytest.raises(InputError, match="1 different position"):
        run(NEAREST, Worlds(one, stack.truth))


@pytest.mark.parametrize(("name", "value"), [("survey.rss_dbm", np.inf), ("survey.position_m", np.nan)])
def test_values_that_are_no_numbers_are_refused(name: str, value: float) -> None:
    stack = worlds()
    stack.observed[name][1, 2, 0] = value
    with pytest.raises(InputError, match=r"\[2, 0\].*finite"):
        run(NEAREST, stack)


def test_silence_is_allowed_and_answered() -> None:
    stack = worlds()
    stack.observed["survey.rss_dbm"][:, 3] = np.nan
    stack.observed["survey.rss_dbm"][:, :, 1] = np.nan
    for use in ("wknn", "sklearn.neighbors.KNeighborsRegressor", "sklearn.svm.SVR"):
        assert np.isfinite(run(factory(use, "fingerprinting", {}), stack)).all()


def test_k_larger_than_the_survey_is_a_row_with_the_reason() -> None:
    make = factory("wknn", "fingerprinting", {"k": 50})
    outcome = task.run(make, worlds().observed, None, {}, [stream(0, "t")])
    assert outcome.skipped == "k = 50 needs 50 training fingerprints, this survey leaves 8"


def test_errors_are_distances() -> None:
    columns = task.score(
        {"position_m": np.array([[[3.0, 4.0]]])}, {"truth.position_m": np.array([[[0.0, 0.0]]])}
    )
    assert (columns["error_m"][0, 0], columns["error_x_m"][0, 0], columns["error_y_m"][0, 0]) == (5, 3, 4)


def test_a_skipped_algorithm_gives_its_reason() -> None:
    outcome = task.run(
        factory("bayes_average", "fingerprinting", {}), worlds().observed, None, {}, [stream(0, "t")]
    )
    assert "access point" in outcome.skipped
    assert not outcome.estimates


def test_only_a_control_is_shown_the_truth() -> None:
    stack = worlds()
    shown = []
    inner = factory("control_centre", "fingerprinting", {})

    def make(**context: Any) -> Any:
        shown.append(context["truth"])
        return inner(**context)

    make.algorithm_class = inner.algorithm_class  # type: ignore[attr-defined]
    run(make, stack)
    assert shown == [None, None]
    run(make, stack, truth=stack.truth)
    assert isinstance(shown[-1], Truth)


def test_names_of_classes_follow_names_of_files() -> None:
    assert class_name("bayes_maximum_likelihood") == "BayesMaximumLikelihood"


@pytest.mark.parametrize(
    ("use", "parameters", "said"),
    [
        ("knn", {"kk": 1}, "parameter kk"),
        ("sklearn.svm.SVRR", {}, "cannot be imported"),
        ("nolibrary.Thing", {}, "cannot be imported"),
        ("numpy.linalg.norm", {}, "no class"),
        ("pathlib.Path", {}, "no regressor"),
    ],
)
def test_lines_that_make_no_algorithm(use: str, parameters: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        factory(use, "fingerprinting", parameters)


def test_a_setting_may_be_a_library_s_object() -> None:
    kernel = {"use": "sklearn.gaussian_process.kernels.RBF", "length_scale": 2.5}
    make = factory("sklearn.gaussian_process.GaussianProcessRegressor", "fingerprinting", {"kernel": kernel})
    regressor = make().steps[-1][1].regressor
    assert regressor.kernel.length_scale == 2.5


def test_streams_are_fresh_and_told_apart() -> None:
    assert stream(1, "a").random() == stream(1, "a").random()
    draws = {stream(seed, *names).random() for seed in (1, 2) for names in ((), ("a",), ("b",), ("a", "b"))}
    assert len(draws) == 8
