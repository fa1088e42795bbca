"""Fast orthogonal search against explicit Gram-Schmidt, least squares and its own invariances."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.model import Array
from positioning.orthogonal_search import check_readings, orthogonal_search

SEEDS = range(12)


def heard_map(seed: int, rows: int = 30, columns: int = 14) -> Array:
    """Return strengths of a log-distance world, NaN where too weak to be heard."""
    rng = np.random.default_rng(seed)
    place_m, radio_m = rng.uniform(0, 30, (rows, 2)), rng.uniform(-20, 50, (columns, 2))
    distance_m = np.linalg.norm(place_m[:, None] - radio_m, axis=-1)
    rss = np.round(-35 - 30 * np.log10(np.maximum(distance_m, 1)) + rng.normal(0, 4, distance_m.shape))
    return np.where(rss < -82, np.nan, rss)


def make_map(seed: int, rows: int = 30, columns: int = 14) -> Array:
    """Return a map for the search: Gaussian for even seeds, filled strengths for odd ones."""
    if seed % 2:
        return np.nan_to_num(heard_map(seed, rows, columns), nan=-100.0)
    rng = np.random.default_rng(seed)
    mixed: Array = rng.normal(size=(rows, 5)) @ rng.normal(size=(5, columns))
    return mixed + rng.normal(0.0, 0.5, (rows, columns)) + rng.normal(0.0, 50.0, columns)


def total_error(matrix: Array, chosen: Any) -> float:
    """Return the mean square error of all columns by least squares on the chosen ones and a constant."""
    basis = np.column_stack([np.ones(len(matrix)), matrix[:, list(chosen)]])
    left = matrix - basis @ np.linalg.lstsq(basis, matrix, rcond=None)[0]
    return float(np.mean(left**2, axis=0).sum())


def gram_schmidt(matrix: Array, columns: int) -> tuple[list[int], list[float]]:
    """Choose with explicit orthogonal functions, eqs. 10 to 13, one column of data after the other."""
    functions = [np.ones(len(matrix))]
    selected: list[int] = []
    reduction: list[float] = []
    for _ in range(columns):
        best, best_reduction, best_function = -1, -1.0, functions[0]
        for candidate in range(matrix.shape[1]):
            if candidate in selected:
                continue
            function = matrix[:, candidate].copy()
            # Twice, so that rounding of the first time is taken off as well.
            for _ in range(2):
                for earlier in functions:
                    function = function - np.mean(function * earlier) / np.mean(earlier**2) * earlier
            power = np.mean(function**2)
            gains = [np.mean(data * function) ** 2 / power for data in matrix.T]
            if sum(gains) > best_reduction:
                best, best_reduction, best_function = candidate, float(sum(gains)), function
        selected.append(best)
        reduction.append(best_reduction)
        functions.append(best_function)
    return selected, reduction


@pytest.mark.parametrize("seed", SEEDS)
def test_equals_explicit_gram_schmidt(seed: int) -> None:
    matrix = make_map(seed)
    found = orthogonal_search(matrix, 6)
    selected, reduction = gram_schmidt(matrix, 6)
    np.testing.assert_array_equal(found.selected, selected)
    np.testing.assert_allclose(found.reduction, reduction, rtol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_equals_brute_force_least_squares(seed: int) -> None:
    matrix = make_map(seed)
    found = orthogonal_search(matrix, 5)
    chosen: list[int] = []
    before = total_error(matrix, chosen)
    for column, reduction in zip(found.selected, found.reduction, strict=True):
        error = [
            np.inf if candidate in chosen else total_error(matrix, [*chosen, candidate])
            for candidate in range(matrix.shape[1])
        ]
        assert column == np.argmin(error)
        np.testing.assert_allclose(reduction, before - min(error), rtol=1e-7)
        chosen, before = [*chosen, int(column)], min(error)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10_000), st.integers(2, 25), st.integers(1, 12), st.sampled_from(["total", "threshold"])
)
def test_the_residual_never_rises_and_is_that_of_least_squares(
    seed: int, rows: int, columns: int, method: str
) -> None:
    matrix = make_map(seed, rows, columns)
    found = orthogonal_search(matrix, columns, method=method)
    assert sorted(found.selected) == list(range(columns))
    assert (found.reduction >= 0).all()
    left = matrix.var(axis=0).sum() - np.cumsum(found.reduction)
    expected = [total_error(matrix, found.selected[: step + 1]) for step in range(columns)]
    np.testing.assert_allclose(left, expected, atol=1e-7 * (1 + matrix.var(axis=0).sum()))


def test_known_answer_by_hand() -> None:
    # Zero means; columns 0 and 2 are orthogonal, 1 is their sum, 3 is small and orthogonal to all.
    first, third = np.array([2.0, 2, -2, -2]), np.array([1.0, -1, 1, -1])
    matrix = np.column_stack([first, first + third, third, 0.5 * np.array([1.0, -1, -1, 1])]) + 7.0
    found = orthogonal_search(matrix, 4)
    # Variances 4, 5, 1, 0.25. Column 1 explains 16/5 of column 0, itself, and 1/5 of column 2; column 0
    # explains 4 + 4. Then 0 leaves 4 - 16/5 of itself and as much of column 2, which are one thing.
    np.testing.assert_array_equal(found.selected, [1, 0, 3, 2])
    np.testing.assert_allclose(found.reduction, [5 + 16 / 5 + 1 / 5, 0.8 + 0.8, 0.25, 0.0], atol=1e-12)


def test_the_constant_comes_first() -> None:
    # Heard once, at the floor else: without a constant term it stands for the level of all columns.
    matrix = make_map(1)
    hardly = np.full(len(matrix), -100.0)
    hardly[3] = -99.0
    found = orthogonal_search(np.column_stack([hardly, matrix]), 14)
    assert 0 not in found.selected[:8]
    without = np.column_stack([hardly, matrix])
    explained = (without.T @ without) ** 2 / np.square(without).sum(axis=0)[:, None]
    assert explained.sum(axis=1)[0] > 0.9 * explained.sum(axis=1).max()


@pytest.mark.parametrize("method", ["total", "threshold"])
@pytest.mark.parametrize("shift", [1.0, -73.3])
def test_duplicates_and_combinations_come_after_all_else_and_constants_last(
    method: str, shift: float
) -> None:
    matrix = make_map(2, 40, 6)
    constant, zero = np.full(40, shift / 3), np.zeros(40)
    parts = [constant, *matrix.T, zero, matrix[:, 1], matrix[:, 4] * 0.3 + shift, matrix[:, 0] + matrix[:, 2]]
    found = orthogonal_search(np.column_stack(parts), len(parts), method=method)
    independent, rest = found.selected[:6], found.selected[6:]
    assert np.linalg.matrix_rank(np.column_stack(parts)[:, independent] - shift) == 6
    assert {2, 9} - set(independent)
    assert {5, 10} - set(independent)
    assert (found.reduction[:6] > 0).all()
    np.testing.assert_array_equal(found.reduction[6:], 0.0)
    np.testing.assert_array_equal(rest[3:], [0, 7])
    np.testing.assert_array_equal(rest[:3], sorted(rest[:3]))


@pytest.mark.parametrize("seed", range(6))
def test_a_tie_goes_to_the_lowest_number(seed: int) -> None:
    # Duplicates far apart: kernels add them up in different orders, so that they are equal but for rounding.
    matrix = make_map(seed, 67, 37)
    doubled = np.column_stack([matrix, matrix, matrix * -1.0])
    alone, found = orthogonal_search(matrix, 6), orthogonal_search(doubled, 6)
    assert (found.selected < 37).all()
    weighted = np.column_stack([matrix] * 3)
    np.testing.assert_array_equal(orthogonal_search(weighted, 6).selected, alone.selected)
    np.testing.assert_allclose(found.reduction, 3 * alone.reduction, rtol=1e-9)


def test_all_columns_constant() -> None:
    for method in ("total", "threshold"):
        found = orthogonal_search(np.full((5, 4), -100.0), 3, method=method)
        np.testing.assert_array_equal(found.selected, [0, 1, 2])
        np.testing.assert_array_equal(found.reduction, 0.0)
        np.testing.assert_array_equal(orthogonal_search([[3.0, 1.0, 2.0]], 2, method=method).selected, [0, 1])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.01, 100.0), st.floats(-200.0, 200.0))
def test_order_of_rows_level_unit_and_order_of_columns_do_not_matter(
    seed: int, unit: float, level: float
) -> None:
    matrix, rng = make_map(2 * seed, 25, 9), np.random.default_rng(seed)
    found = orthogonal_search(matrix, 4)
    rows, columns = rng.permutation(25), rng.permutation(9)
    moved = orthogonal_search((matrix[rows] * unit + level)[:, columns], 4)
    np.testing.assert_array_equal(columns[moved.selected], found.selected)
    np.testing.assert_allclose(moved.reduction, found.reduction * unit**2, rtol=1e-6)


@pytest.mark.parametrize("method", ["total", "threshold"])
def test_leading_axes(method: str) -> None:
    worlds = np.array([[make_map(2 * w + s, 20, 8) for s in range(2)] for w in range(3)])
    kept = worlds.copy()
    found = orthogonal_search(worlds, 3, method=method)
    np.testing.assert_array_equal(worlds, kept)
    assert found.selected.shape == found.reduction.shape == (3, 2, 3)
    for index in np.ndindex(3, 2):
        alone = orthogonal_search(worlds[index], 3, method=method)
        np.testing.assert_array_equal(found.selected[index], alone.selected)
        np.testing.assert_allclose(found.reduction[index], alone.reduction, rtol=1e-12)


# The pass with a threshold


def kept_by(matrix: Array, threshold: float) -> list[int]:
    """Pass over the columns once, by least squares, and keep those that reduce more than a threshold."""
    chosen: list[int] = []
    for column in range(matrix.shape[1]):
        if total_error(matrix, chosen) - total_error(matrix, [*chosen, column]) > threshold:
            chosen.append(column)
    return chosen


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("columns", [1, 3])
def test_a_threshold_keeps_exactly_these_columns_and_no_larger_one_as_many(seed: int, columns: int) -> None:
    matrix = make_map(seed, 20, 8)
    found = orthogonal_search(matrix, columns, method="threshold")
    assert list(found.selected) == sorted(found.selected)
    least = float(found.reduction.min())
    assert kept_by(matrix, least * (1 - 1e-6)) == list(found.selected)
    most = total_error(matrix, []) * 1.01
    for threshold in np.linspace(least * (1 + 1e-6), most, 25):
        assert len(kept_by(matrix, threshold)) != columns


def test_the_threshold_variant_depends_on_the_order_of_the_columns() -> None:
    differ = 0
    for seed in range(6):
        matrix = make_map(seed, 30, 20)
        backwards = matrix[:, ::-1]
        total, turned = (orthogonal_search(m, 4).selected for m in (matrix, backwards))
        assert set(total) == set(19 - turned)
        one, two = (orthogonal_search(m, 4, method="threshold").selected for m in (matrix, backwards))
        differ += set(one) != set(19 - two)
    assert differ >= 4


def test_where_no_threshold_keeps_the_number_the_first_of_more_are_kept() -> None:
    # The first two reduce the error by equal amounts, each of its own: a threshold keeps both or none.
    matrix = np.column_stack([[1.0, 1, -1, -1], [1.0, -1, 1, -1]])
    np.testing.assert_array_equal(orthogonal_search(matrix, 1, method="threshold").selected, [0])
    assert len(kept_by(matrix, 0.999)) == 2
    assert len(kept_by(matrix, 1.001)) == 0


# Input that cannot be used


@pytest.mark.parametrize(
    ("matrix", "columns", "method", "message"),
    [
        (np.zeros((3, 4)), 5, "total", "columns=5: it must lie between 1 and 4"),
        (np.zeros((3, 4)), 0, "threshold", "columns=0"),
        (np.zeros((0, 4)), 2, "total", "no rows"),
        (np.zeros(4), 2, "total", "no rows"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), 1, "total", r"matrix\[1, 0\]"),
        (np.array([[0.0, np.inf]]), 1, "total", r"matrix\[0, 1\]"),
        (np.zeros((3, 4)), 2, "pivoted", "method='pivoted'"),
    ],
)
def test_matrices_that_cannot_be_searched_are_refused(
    matrix: Array, columns: int, method: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        orthogonal_search(matrix, columns, method=method)


def test_readings_that_cannot_be_used_are_refused() -> None:
    with pytest.raises(InputError, match=r"\[n, 3\]"):
        check_readings(np.zeros((2, 4)), 3)
    with pytest.raises(InputError, match="n from 1"):
        check_readings(np.zeros((0, 4)))
    with pytest.raises(InputError, match=r"rss_dbm\[0, 1\]"):
        check_readings([[np.nan, -np.inf]])
    assert check_readings(np.zeros((0, 4)), 4).shape == (0, 4)
