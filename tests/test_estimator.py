"""The estimators of this project in the hands of scikit-learn."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import sklearn.base
from sklearn.ensemble import RandomForestRegressor
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils import get_tags

from algorithms.access_points.strongest import Strongest
from algorithms.fingerprinting.reduced import Reduced
from algorithms.fingerprinting.wknn import Wknn
from positioning.estimator import clone
from positioning.fingerprints import FillNotHeard
from positioning.model import Site

RNG = np.random.default_rng(2)
RSS, POSITION = RNG.normal(-60, 9, (40, 5)), RNG.uniform(0, 20, (40, 2))


@pytest.mark.parametrize("copy", [clone, sklearn.base.clone])
def test_copies_have_the_settings_and_nothing_learned(copy: Any) -> None:
    original = Reduced(access_points=Strongest(columns=3), regressor=RandomForestRegressor(7, random_state=1))
    copied = copy(original.fit(RSS, POSITION))
    assert not hasattr(copied, "regressor_")
    assert copied.regressor is not original.regressor
    assert copied.access_points is not original.access_points
    assert (copied.access_points.columns, copied.regressor.n_estimators) == (3, 7)
    np.testing.assert_array_equal(copied.fit(RSS, POSITION).predict(RSS), original.predict(RSS))


def test_settings_that_are_no_estimators_are_copied_deeply() -> None:
    class Placed(Wknn):
        def __init__(self, *, site: Site | None = None) -> None:
            super().__init__()
            self.site = site

    site = Site(corner_m=np.zeros((2, 2)))
    copied = clone(Placed(site=site))
    assert copied.site is not site
    np.testing.assert_array_equal(copied.site.corner_m, site.corner_m)


def test_settings_are_reached_by_name_and_wrong_names_refused() -> None:
    reduced = Reduced(access_points=Strongest(columns=3), regressor=Wknn(k=2))
    assert reduced.get_params()["regressor__k"] == 2
    assert "regressor__k" not in reduced.get_params(deep=False)
    reduced.set_params(regressor__k=5, regressor=Wknn(k=4), access_points__columns=2)
    assert (reduced.regressor.k, reduced.access_points.columns) == (5, 2)
    with pytest.raises(ValueError, match="Invalid parameter 'neighbours'"):
        reduced.set_params(neighbours=3)
    assert "k=5" in repr(reduced.regressor)


def test_tags_tell_regressors_from_transformers() -> None:
    assert sklearn.base.is_regressor(Wknn())
    assert get_tags(Wknn()).target_tags.required
    assert get_tags(FillNotHeard()).transformer_tags is not None
    assert not sklearn.base.is_regressor(FillNotHeard())


def test_searches_and_scores_work() -> None:
    pipeline = make_pipeline(FillNotHeard(), StandardScaler(), Wknn())
    search = GridSearchCV(pipeline, {"wknn__k": [1, 3]}, cv=3).fit(RSS, POSITION)
    assert search.best_params_["wknn__k"] in (1, 3)
    scores = cross_val_score(Wknn(k=3), RSS, POSITION, cv=3)
    fitted = Wknn(k=3).fit(RSS[14:], POSITION[14:])
    residual = np.sum((POSITION[:14] - fitted.predict(RSS[:14])) ** 2, axis=0)
    spread = np.sum((POSITION[:14] - POSITION[:14].mean(axis=0)) ** 2, axis=0)
    assert scores[0] == pytest.approx(np.mean(1 - residual / spread))


def test_what_is_not_fitted_says_so() -> None:
    for ask in (lambda: Wknn().predict(RSS), lambda: FillNotHeard().transform(RSS)):
        with pytest.raises(sklearn.exceptions.NotFittedError, match="not fitted"):
            ask()


def test_a_row_does_not_wait_for_scikit_learn() -> None:
    code = (
        "import sys, numpy as np\n"
        "from positioning.registry import factory\n"
        "from positioning.tasks.fingerprinting import PROTOCOLS\n"
        "from positioning.model import Survey\n"
        "rng = np.random.default_rng(1)\n"
        "survey = Survey(rss_dbm=rng.normal(-60, 9, (30, 4)), position_m=rng.uniform(0, 9, (30, 2)))\n"
        "for use in ('wknn', 'knn', 'rbf_network', 'mlp'):\n"
        "    line = {'neurons': 5} if use == 'rbf_network' else {}\n"
        "    for protocol in ('leave_one_out', 'holdout'):\n"
        "        PROTOCOLS[protocol](factory(use, 'fingerprinting', line)(), survey, None)\n"
        "heavy = ('sklearn', 'pandas', 'scipy.spatial', 'scipy.stats')\n"
        "print(sorted(name for name in heavy if name in sys.modules))\n"
    )
    answer = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert answer.stdout.strip() == "[]"
