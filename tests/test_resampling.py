"""Resampling against counts by hand, exact expectations, and one row after the other."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.filters.resampling import (
    effective_sample_size,
    linear_time,
    multinomial,
    residual,
    stratified,
    systematic,
)
from positioning.model import Array

SCHEMES: dict[str, tuple[Callable[..., Any], Callable[[int], tuple[int, ...]]]] = {
    "systematic": (systematic, lambda n: ()),
    "stratified": (stratified, lambda n: (n,)),
    "multinomial": (multinomial, lambda n: (n,)),
    "linear_time": (linear_time, lambda n: (n + 1,)),
    "residual": (residual, lambda n: (n,)),
}
NAMES = sorted(SCHEMES)


def resample(name: str, weight: Array, rng: np.random.Generator) -> Any:
    """Resample rows of weights [..., n]."""
    scheme, shape = SCHEMES[name]
    return scheme(weight, rng.random((*weight.shape[:-1], *shape(weight.shape[-1]))))


def copies(index: Any, count: int) -> Any:
    """Count the copies of each particle, [..., n]."""
    return (index[..., None] == np.arange(count)).sum(axis=-2)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "weight",
    [
        [0.45, 0.3, 0.15, 0.08, 0.02],
        [0.2, 0.2, 0.2, 0.2, 0.2],
        # Whole parts 1, 1, 0: a residual scheme that draws its rest with the weights themselves is off.
        [0.5, 0.35, 0.15],
        [0.0, 0.6, 0.0, 0.4],
    ],
)
def test_mean_copies_equal_the_weights(name: str, weight: list[float]) -> None:
    count, draws = len(weight), 40_000
    found = copies(resample(name, np.tile(weight, (draws, 1)), np.random.default_rng(len(name))), count)
    assert (found.sum(axis=1) == count).all()
    # Five standard errors of the noisiest scheme, which is binomial.
    error = 5 * np.sqrt(count * np.array(weight) * (1 - np.array(weight)) / draws) + 1e-12
    assert (np.abs(found.mean(axis=0) - count * np.array(weight)) <= error).all()


def test_a_residual_that_forgets_to_renormalise_would_be_seen() -> None:
    # The known bug draws the rest with the weights themselves: 0.5 + 0.5 copies instead of 0.5.
    weight = np.array([0.5, 0.35, 0.15])
    found = copies(resample("residual", np.tile(weight, (20_000, 1)), np.random.default_rng(3)), 3)
    wrong = np.floor(3 * weight) + weight
    assert np.abs(found.mean(axis=0) - wrong).max() > 0.1


@pytest.mark.parametrize("name", ["multinomial", "linear_time"])
def test_independent_draws_have_binomial_variance(name: str) -> None:
    weight = np.array([0.5, 0.3, 0.15, 0.05])
    found = copies(resample(name, np.tile(weight, (40_000, 1)), np.random.default_rng(4)), 4)
    np.testing.assert_allclose(found.var(axis=0), 4 * weight * (1 - weight), rtol=0.04)
    covariance = np.cov(found[:, 0], found[:, 1])[0, 1]
    assert covariance == pytest.approx(-4 * weight[0] * weight[1], rel=0.06)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.one_of(st.just(0.0), st.floats(1e-9, 1.0)), min_size=1, max_size=40).filter(
        lambda w: sum(w) > 0
    ),
    st.floats(0, 1, exclude_max=True),
)
def test_systematic_copies_are_floor_or_ceiling(weight: list[float], uniform: float) -> None:
    share = len(weight) * np.array(weight) / np.sum(weight)
    found = copies(systematic(weight, uniform), len(weight))
    assert found.sum() == len(weight)
    assert (found >= np.floor(share - 1e-9)).all()
    assert (found <= np.ceil(share + 1e-9)).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 30))
def test_residual_keeps_whole_parts(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.full(count, 0.3))
    assert (copies(resample("residual", weight, rng), count) >= np.floor(count * weight - 1e-9)).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 30), st.sampled_from(NAMES))
def test_only_weights_above_zero_are_drawn_and_in_order(seed: int, count: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.random((6, count)) * (rng.random((6, count)) < 0.5)
    weight[:, rng.integers(count)] += 0.1
    index = resample(name, weight, rng)
    assert index.shape == weight.shape
    assert (np.take_along_axis(weight, index, axis=-1) > 0).all()
    assert (np.diff(index, axis=-1) >= 0).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("heavy", [0, 3, 7])
def test_one_particle_with_all_weight_has_all_copies(name: str, heavy: int) -> None:
    weight = np.zeros(8)
    weight[heavy] = 1e-300
    for draw in (0.0, 0.3, np.nextafter(1, 0)):
        scheme, shape = SCHEMES[name]
        np.testing.assert_array_equal(scheme(weight, np.full(shape(8), draw)), np.full(8, heavy))


@pytest.mark.parametrize("name", NAMES)
def test_the_largest_draws_stay_within_the_particles(name: str) -> None:
    # Ten tenths sum to less than one; and the last weights are zero.
    weight = np.array([0.1] * 10 + [0.0] * 3)
    assert np.cumsum(weight)[-1] < 1.0
    scheme, shape = SCHEMES[name]
    index = scheme(weight, np.full(shape(13), np.nextafter(1, 0)))
    assert index.max() <= 9


@pytest.mark.parametrize("name", ["systematic", "stratified", "residual"])
@pytest.mark.parametrize("count", [3, 49, 500])
def test_equal_weights_copy_each_particle_once(name: str, count: int) -> None:
    index = resample(name, np.full(count, 1.0 / count), np.random.default_rng(1))
    np.testing.assert_array_equal(index, np.arange(count))


def test_linear_time_equals_a_search_for_its_sorted_draws() -> None:
    rng = np.random.default_rng(8)
    weight, draws = rng.dirichlet(np.ones(200)), rng.random(201)
    exponential = -np.log1p(-draws)
    position = np.cumsum(exponential)[:-1] / exponential.sum()
    expected = np.searchsorted(np.cumsum(weight), position, side="right")
    np.testing.assert_array_equal(linear_time(weight, draws), expected)


def test_linear_time_positions_are_distributed_like_sorted_uniform_draws() -> None:
    # With equal weights the index of the i-th of n sorted uniform draws has the mean n i / (n + 1) - 1/2.
    index = resample("linear_time", np.full((20_000, 9), 1 / 9), np.random.default_rng(2))
    expected = 9 * np.arange(1, 10) / 10 - 0.5
    np.testing.assert_allclose(index.mean(axis=0)[1:-1], expected[1:-1], atol=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_leading_axes_give_what_each_row_gives(name: str) -> None:
    rng = np.random.default_rng(11)
    weight = rng.dirichlet(np.full(17, 0.2), (3, 4))
    scheme, shape = SCHEMES[name]
    draws = rng.random((3, 4, *shape(17)))
    together = scheme(weight, draws)
    for row in np.ndindex(3, 4):
        np.testing.assert_array_equal(scheme(weight[row], draws[row]), together[row])


@pytest.mark.parametrize("name", NAMES)
def test_the_scale_of_the_weights_does_not_matter(name: str) -> None:
    rng = np.random.default_rng(12)
    weight = rng.dirichlet(np.ones(33), 20)
    scheme, shape = SCHEMES[name]
    draws = rng.random((20, *shape(33)))
    np.testing.assert_array_equal(scheme(4.0 * weight, draws), scheme(weight, draws))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 400))
def test_effective_sample_size_by_the_coefficient_of_variation(seed: int, count: int) -> None:
    weight = np.random.default_rng(seed).dirichlet(np.ones(count))
    variation = np.mean((count * weight - 1) ** 2)
    assert abs(effective_sample_size(weight) / (count / (1 + variation)) - 1) < 1e-12
    # As printed, without the square, it is zero for all weights.
    assert abs(np.mean(count * weight - 1)) < 1e-12


def test_effective_sample_size_by_hand() -> None:
    weight = np.array([[0.25, 0.25, 0.25, 0.25], [1, 0, 0, 0], [0.5, 0.5, 0, 0]])
    np.testing.assert_allclose(effective_sample_size(weight), [4, 1, 2], rtol=1e-15)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("weight", [[0.0, 0.0], [0.5, -0.1], [np.nan, 1.0], [np.inf, 1.0], []])
def test_senseless_weights_are_refused(name: str, weight: list[float]) -> None:
    scheme, shape = SCHEMES[name]
    with pytest.raises(InputError, match="weights"):
        scheme(weight, np.zeros(shape(len(weight))))


@pytest.mark.parametrize("name", NAMES)
def test_senseless_draws_are_refused(name: str) -> None:
    scheme, shape = SCHEMES[name]
    for bad in (1.0, -0.1, np.nan):
        with pytest.raises(InputError, match=r"outside \[0, 1\)"):
            scheme([0.5, 0.5], np.full(shape(2), bad))
    with pytest.raises(InputError, match="shape"):
        scheme([0.5, 0.5], np.zeros((*shape(2), 3)))
