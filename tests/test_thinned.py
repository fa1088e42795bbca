"""A survey with fewer places or scans: what stays, and that the regressor sees nothing else."""

import numpy as np
import pytest

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation
from algorithms.fingerprinting.knn import Knn
from algorithms.fingerprinting.thinned import Thinned
from positioning.errors import InputError
from positioning.model import Site, Survey

PLACES_M = np.array([[9.0, 0.0], [0.0, 0.0], [5.0, 5.0], [1.0, 8.0], [4.0, 4.0]])
# Five places in the order in which they were surveyed, three scans each.
POSITION = np.repeat(PLACES_M, 3, axis=0)
RSS = -50.0 - np.random.default_rng(1).uniform(0, 30, (15, 4))


@pytest.mark.parametrize(
    ("every", "scans", "kept"),
    [
        (1, None, range(15)),
        (2, None, [0, 1, 2, 6, 7, 8, 12, 13, 14]),
        (3, None, [0, 1, 2, 9, 10, 11]),
        (1, 1, [0, 3, 6, 9, 12]),
        (2, 2, [0, 1, 6, 7, 12, 13]),
        (9, 9, [0, 1, 2]),
    ],
)
def test_places_and_scans_are_taken_in_the_order_of_the_survey(every, scans, kept) -> None:
    kept = list(kept)
    query = RSS + 1.5
    thinned = Thinned(every=every, scans=scans).fit(RSS, POSITION)
    expected = ExpectedDeviation().fit(RSS[kept], POSITION[kept]).predict(query)
    np.testing.assert_array_equal(thinned.predict(query), expected)


def test_scans_of_a_place_need_not_stand_side_by_side() -> None:
    order = np.array([0, 3, 1, 4, 2, 5])
    found = Thinned(every=1, scans=1, regressor=Knn(k=1)).fit(RSS[order], POSITION[order])
    np.testing.assert_array_equal(found.predict(RSS[[0, 3]]), POSITION[[0, 3]])
    # The second scan of the first place was not learned, so the nearest of what stays answers.
    gap = np.linalg.norm(RSS[1] - RSS[[0, 3]], axis=1)
    np.testing.assert_array_equal(found.predict(RSS[[1]]), POSITION[[[0, 3][gap.argmin()]]])


def test_what_is_left_may_be_too_little() -> None:
    site = Site(corner_m=np.array([[0.0, 0.0], [10.0, 10.0]]))
    survey = Survey(rss_dbm=RSS, position_m=POSITION)
    assert Thinned(every=1, regressor=Knn(k=4)).skip(survey, site) is None
    assert "k = 4" in (Thinned(every=2, scans=1, regressor=Knn(k=4)).skip(survey, site) or "")


@pytest.mark.parametrize("setting", [{"every": 0}, {"every": 1.5}, {"scans": 0}])
def test_senseless_settings_are_refused(setting) -> None:
    with pytest.raises(InputError, match=next(iter(setting))):
        Thinned(**setting).fit(RSS, POSITION)
