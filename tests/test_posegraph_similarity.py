"""Distances in signal space and the pairs that they make, against hand computation and plain loops."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.model import Array
from positioning.posegraph import similarity
from positioning.posegraph.similarity import near_pairs, rss_distance_db, window_threshold_db


def scans(seed: int, count: int = 12, access_points: int = 7) -> Array:
    rng = np.random.default_rng(seed)
    rss = np.round(rng.uniform(-100, -40, (count, access_points)))
    return np.where(rng.random(rss.shape) < 0.4, np.nan, rss)


def by_definition(one: Array, two: Array) -> float:
    """Return eq. 9 of one pair, as it is read."""
    union = ~np.isnan(one) | ~np.isnan(two)
    if np.isnan(one).all() or np.isnan(two).all():
        return np.nan
    difference = np.where(np.isnan(one), -110, one) - np.where(np.isnan(two), -110, two)
    return float(np.sqrt(np.mean(difference[union] ** 2)))


def test_an_access_point_missing_on_one_side_by_hand() -> None:
    # Differences 3 and (-70 + 110) = 40; nobody hears the third: M = 2.
    rss = np.array([[-60.0, -70.0, np.nan], [-63.0, np.nan, np.nan]])
    expected = np.sqrt((9 + 1600) / 2)
    np.testing.assert_allclose(rss_distance_db(rss), [[0, expected], [expected, 0]], rtol=1e-12)


def test_no_common_access_point_by_hand() -> None:
    rss = np.array([[-60.0, np.nan], [np.nan, -90.0]])
    assert rss_distance_db(rss)[0, 1] == pytest.approx(np.sqrt((50**2 + 20**2) / 2), rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_all_pairs_equal_the_definition(seed: int) -> None:
    rss = scans(seed)
    found = rss_distance_db(rss)
    expected = [[by_definition(one, two) for two in rss] for one in rss]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found, found.T)
    heard = ~np.isnan(rss).all(axis=-1)
    assert (np.diagonal(found)[heard] == 0).all()


def test_a_second_set_and_leading_axes() -> None:
    one, two = scans(1), scans(2, count=5)
    both = rss_distance_db(np.concatenate([one, two]))
    np.testing.assert_allclose(rss_distance_db(one, two), both[:12, 12:], rtol=1e-12)
    stacked = rss_distance_db(np.stack([one, scans(3)]))
    np.testing.assert_array_equal(stacked[0], rss_distance_db(one))


def test_rows_that_are_taken_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    rss, other = np.stack([scans(8, count=13), scans(9, count=13)]), scans(10, count=4)
    rss[0, 7], other[2] = np.nan, np.nan
    own, across = rss_distance_db(rss), rss_distance_db(rss, other)
    # Two blocks and a rest.
    monkeypatch.setattr(similarity, "_ROWS", 5)
    np.testing.assert_allclose(rss_distance_db(rss), own, rtol=1e-12)
    np.testing.assert_allclose(rss_distance_db(rss, other), across, rtol=1e-12)
    assert own[1, 12, 6] == pytest.approx(by_definition(rss[1, 12], rss[1, 6]), rel=1e-12)
    assert np.isnan(own[0, 7]).all()
    assert np.isfinite(own[1]).all()


def test_readings_that_are_no_whole_numbers() -> None:
    rng = np.random.default_rng(4)
    rss = rng.uniform(-100, -40, (30, 70))
    expected = [[by_definition(one, two) for two in rss] for one in rss]
    np.testing.assert_allclose(rss_distance_db(rss), expected, atol=1e-5)
    again = np.concatenate([rss, rss])
    assert rss_distance_db(again).max() == pytest.approx(np.max(expected))
    assert (rss_distance_db(again)[:30, 30:].diagonal() < 1e-4).all()


def test_a_scan_that_hears_nothing_has_no_distance() -> None:
    rss = scans(5)
    rss[3] = np.nan
    found = rss_distance_db(rss)
    assert np.isnan(found[3]).all()
    assert np.isnan(found[:, 3]).all()
    assert np.isfinite(np.delete(np.delete(found, 3, 0), 3, 1)).all()


def test_the_order_of_access_points_does_not_matter() -> None:
    rss = scans(6)
    np.testing.assert_array_equal(rss_distance_db(rss), rss_distance_db(rss[:, ::-1]))


def test_thresholds_of_a_window_by_hand() -> None:
    # One access point: distances are differences. Window 4: two scans before and two after.
    level = np.array([-50.0, -51.0, -53.0, -56.0, -90.0, -60.0])
    distance = rss_distance_db(level[:, None])
    walk = np.array([0, 0, 0, 0, 1, 1])
    # First scan: distances 1, 3. Second: 1, 2, 5. Third: 3, 2, 3. Fourth: 5, 3. Second walk: 30.
    np.testing.assert_allclose(window_threshold_db(distance, walk, 4), [2, 2, 3, 4, 30, 30])


def test_thresholds_are_medians_of_loops() -> None:
    rss, walk = scans(7, count=40), np.repeat([0, 1], 20)
    distance = rss_distance_db(rss)
    found = window_threshold_db(distance, walk, 7)
    for k in range(40):
        others = [q for q in range(k - 3, k + 4) if 0 <= q < 40 and q != k and walk[q] == walk[k]]
        assert found[k] == np.nanmedian(distance[k, others])


def test_a_window_beyond_the_walk_is_the_whole_walk_and_takes_no_longer() -> None:
    distance_db = np.abs(np.subtract.outer(np.arange(40.0), np.arange(40.0)) ** 2)
    walk = np.repeat([0, 1], 20)
    whole = window_threshold_db(distance_db, walk, 38)
    np.testing.assert_array_equal(window_threshold_db(distance_db, walk, 10**9), whole)
    for window in (1, 4.5, "10", None, np.nan):
        with pytest.raises(InputError, match=r"window=.* whole number from 2"):
            window_threshold_db(distance_db, walk, window)  # type: ignore[arg-type]


def test_a_walk_of_one_scan_has_no_threshold() -> None:
    found = window_threshold_db(np.zeros((3, 3)), [0, 0, 1], 2)
    assert np.isfinite(found[:2]).all()
    assert np.isnan(found[2])


LEVEL = np.array([-50.0, -60.0, -70.0, -61.0, -50.5, -60.5])
WALK = np.array([0, 0, 0, 0, 1, 1])
TIME_S = np.array([0.0, 2.0, 4.0, 6.0, 0.0, 2.0])


def pairs(**setting: object) -> set[tuple[int, int]]:
    arguments: dict[str, object] = {"window": 2, "exclude_s": 0.0, **setting}
    start, end = near_pairs(WALK, TIME_S, LEVEL[:, None], **arguments)  # type: ignore[arg-type]
    assert (start < end).all()
    return set(zip(start.tolist(), end.tolist(), strict=True))


def test_pairs_of_a_fixed_threshold_by_hand() -> None:
    assert pairs(threshold=2.0) == {(0, 4), (1, 3), (1, 5), (3, 5)}
    assert pairs(threshold=1.0) == {(0, 4), (1, 5), (3, 5)}


def test_pairs_of_the_adaptive_threshold_by_hand() -> None:
    # Thresholds: 10, 10, 9.5, 9, 10, 10. The later scan decides; 2-3 and 4-5 are no nearer than these.
    within = {(0, 4), (1, 3), (1, 4), (1, 5), (2, 5), (3, 5)}
    assert pairs() == within
    # 2-5 differ by 9.5, which is not below the 9.5 of scan 2.
    assert pairs(decides="both") == within - {(2, 5)}
    # 2-3 differ by 9, below the 9.5 of scan 2.
    assert pairs(decides="either") == within | {(2, 3)}


def test_poses_of_one_walk_close_in_time_or_place_make_no_pair() -> None:
    assert pairs(threshold=2.0, exclude_s=5.0) == {(0, 4), (1, 5), (3, 5)}
    # Exactly as far apart as asked for is far enough.
    assert (1, 3) in pairs(threshold=2.0, exclude_s=4.0)
    place = np.array([[0.0, 0], [3, 0], [6, 0], [9, 0], [0, 0], [3, 0]])
    assert (1, 3) in pairs(threshold=2.0, position_m=place, exclude_m=6.0)
    assert pairs(threshold=2.0, position_m=place, exclude_m=7.0) == {(0, 4), (1, 5), (3, 5)}


@pytest.mark.parametrize("decides", ["later", "either", "both"])
def test_pairs_that_are_taken_some_rows_at_a_time(
    decides: Literal["later", "either", "both"], monkeypatch: pytest.MonkeyPatch
) -> None:
    rss, walk, time = scans(11, count=40), np.repeat([0, 1, 2], [13, 20, 7]), np.arange(40.0)
    rss[:, 0] = -50
    place = np.random.default_rng(11).normal(size=(40, 2))
    monkeypatch.setattr(similarity, "_ROWS", 9)
    found = near_pairs(
        walk, time, rss, window=6, exclude_s=3.0, position_m=place, exclude_m=1.0, decides=decides
    )
    distance = rss_distance_db(rss)
    limit = window_threshold_db(distance, walk, 6)
    holds = {"later": lambda a, b: b, "either": lambda a, b: a or b, "both": lambda a, b: a and b}[decides]
    expected = [
        (i, j)
        for i in range(40)
        for j in range(i + 1, 40)
        if holds(distance[i, j] < limit[i], distance[i, j] < limit[j])
        and not (walk[i] == walk[j] and (j - i < 3 or np.linalg.norm(place[i] - place[j]) < 1))
    ]
    assert len(expected) > 20
    assert list(zip(*(ends.tolist() for ends in found), strict=True)) == expected


def test_poses_without_a_scan_do_not_change_the_pairs() -> None:
    keep = np.array([0, 2, 3, 5, 6, 7])
    rss = np.full((9, 1), np.nan)
    rss[keep, 0] = LEVEL
    walk, time = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1]), np.full(9, np.nan)
    walk[keep], time[keep] = WALK, TIME_S
    start, end = near_pairs(walk, time, rss, window=2, exclude_s=0.0)
    found = {
        (int(np.searchsorted(keep, i)), int(np.searchsorted(keep, j)))
        for i, j in zip(start, end, strict=True)
    }
    assert set(start.tolist()) | set(end.tolist()) <= set(keep.tolist())
    assert found == pairs()


def test_what_cannot_be_used_is_refused() -> None:
    rss = LEVEL[:, None]
    with pytest.raises(InputError, match="no pose hears"):
        near_pairs(WALK, TIME_S, np.full((6, 3), np.nan), window=2, exclude_s=0)
    with pytest.raises(InputError, match="window=1"):
        near_pairs(WALK, TIME_S, rss, window=1, exclude_s=0)
    with pytest.raises(InputError, match="infinite"):
        rss_distance_db([[np.inf, -50.0]])
    with pytest.raises(InputError, match="2 and 3 access points"):
        rss_distance_db(np.zeros((4, 2)), np.zeros((4, 3)))
    with pytest.raises(InputError, match="not \\[m\\], \\[m\\] and \\[m, ap\\]"):
        near_pairs(WALK[:3], TIME_S, rss, window=2, exclude_s=0)
    with pytest.raises(InputError, match="decides"):
        near_pairs(WALK, TIME_S, rss, window=2, exclude_s=0, decides="never")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="mean"):
        near_pairs(WALK, TIME_S, rss, window=2, exclude_s=0, threshold="mean")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="position_m"):
        near_pairs(WALK, TIME_S, rss, window=2, exclude_s=0, exclude_m=3.0)


def test_one_walk_of_one_scan_makes_no_pair() -> None:
    start, end = near_pairs([0], [0.0], [[-50.0]], window=2, exclude_s=0)
    assert len(start) == len(end) == 0
