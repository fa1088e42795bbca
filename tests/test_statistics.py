"""Intervals and paired differences against theory and other libraries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from positioning.evaluation.metrics import figures_of_merit
from positioning.evaluation.statistics import (
    mean_interval,
    paired_difference,
    prediction_interval,
    share_interval,
    single_experiment_interval,
)


def test_39_worlds_span_their_extremes_and_promise_95_percent() -> None:
    values = np.random.default_rng(1).normal(size=39)
    interval = single_experiment_interval(values)
    assert interval[:2] == pytest.approx((values.min(), values.max()))
    assert interval.coverage == pytest.approx(0.95)


@pytest.mark.parametrize(("n", "promised"), [(4, 0.6), (9, 0.8), (39, 0.95), (40, 0.95), (200, 0.95)])
def test_a_new_world_falls_inside_as_often_as_promised(n: int, promised: float) -> None:
    draws = np.random.default_rng(n).exponential(size=(20_000, n + 1))
    ends = np.quantile(draws[:, :n], [0.025, 0.975], axis=1, method="weibull")
    inside = np.mean((draws[:, n] >= ends[0]) & (draws[:, n] <= ends[1]))
    assert inside == pytest.approx(promised, abs=0.012)
    assert single_experiment_interval(draws[0, :n]).coverage == pytest.approx(promised)
    assert single_experiment_interval(draws[0, :n])[:2] == pytest.approx(ends[:, 0])


def test_one_world_promises_nothing() -> None:
    assert single_experiment_interval(np.array([3.0])) == (3.0, 3.0, 0.0)


def test_shares_at_the_edges_are_the_closed_form() -> None:
    none, every = share_interval(0, 40), share_interval(40, 40)
    assert (none.low, every.high) == (0.0, 1.0)
    assert none.high == pytest.approx(1 - 0.025 ** (1 / 40))
    assert every.low == pytest.approx(0.025 ** (1 / 40))


@given(st.integers(1, 60), st.data())
@settings(max_examples=30, deadline=None)
def test_share_interval_is_beta_quantiles(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n))
    interval = share_interval(k, n)
    assert interval.low == pytest.approx(stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0, abs=1e-9)
    assert interval.high == pytest.approx(stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0, abs=1e-9)


def test_mean_interval_is_the_t_test_s() -> None:
    values = np.random.default_rng(2).normal(1.0, 2.0, 12)
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert mean_interval(values)[:2] == pytest.approx((expected.low, expected.high))
    assert np.isnan(mean_interval(values[:1]).low)


def test_pairing_removes_what_worlds_share() -> None:
    rng = np.random.default_rng(3)
    world = rng.normal(0, 5, 40)
    first, second = world + 0.1 + 0.01 * rng.normal(size=40), world
    result = paired_difference(first, second)
    assert result.low < 0.1 < result.high
    assert result.high - result.low < 0.02
    assert result.share_smaller == 0.0
    assert paired_difference(second, first).share_smaller == 1.0


def test_ties_count_half() -> None:
    assert paired_difference(np.array([1.0, 2.0]), np.array([1.0, 2.0])).share_smaller == 0.5


def test_figures_of_merit_by_hand() -> None:
    merits = figures_of_merit(np.array([[3.0, 4.0, 0.0, 1.0, 2.0]]))
    assert merits["mean_m"][0] == 2.0
    assert merits["rmse_m"][0] == pytest.approx(np.sqrt(6.0))
    assert merits["p50_m"][0] == 2.0
    assert merits["p75_m"][0] == 3.0
    assert merits["p95_m"][0] == pytest.approx(3.8)
    assert merits["max_m"][0] == 4.0
    assert merits["se_m"][0] == pytest.approx(np.sqrt(2.5) / np.sqrt(5))
    assert merits["n"][0] == 5


def test_a_nan_error_is_no_sample() -> None:
    merits = figures_of_merit(np.array([[1.0, np.nan, 3.0], [2.0, 4.0, np.nan]]))
    np.testing.assert_array_equal(merits["mean_m"], [2.0, 3.0])
    with pytest.raises(ValueError, match="same number"):
        figures_of_merit(np.array([[1.0, np.nan], [2.0, 4.0]]))


@given(st.lists(st.floats(0, 100), min_size=2, max_size=50))
def test_order_among_metrics(errors: list[float]) -> None:
    m = {name: float(value) for name, value in figures_of_merit(np.array(errors)).items()}
    assert m["p50_m"] <= m["p75_m"] <= m["p90_m"] <= m["p95_m"] <= m["max_m"]
    assert m["mean_m"] <= m["rmse_m"] + 1e-9 <= m["max_m"] + 1e-6


def test_a_prediction_interval_holds_the_next_normal_value() -> None:
    """The share of next values inside is 95 %, for few values as well."""
    drawn = np.random.default_rng(1).normal(3, 2, (4000, 13))
    inside = [
        interval.low <= values[-1] <= interval.high
        for values in drawn
        for interval in [prediction_interval(values[:-1])]
    ]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)
    assert np.isinf(prediction_interval(np.array([1.0])).low)
