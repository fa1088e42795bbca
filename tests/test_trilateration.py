"""Trilateration against the printed scenario, a plain loop, SciPy, and its own invariances."""

import importlib
import inspect
import math
import pkgutil
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime

import algorithms.trilateration
from algorithms.trilateration.iterative_absolute import IterativeAbsolute
from algorithms.trilateration.iterative_fractional import IterativeFractional
from algorithms.trilateration.iterative_fractional_printed import IterativeFractionalPrinted
from algorithms.trilateration.least_squares import LeastSquares
from algorithms.trilateration.pseudo_inverse import PseudoInverse
from algorithms.trilateration.template import Template
from positioning import trilateration
from positioning.errors import InputError
from positioning.model import Array
from positioning.registry import class_name
from positioning.trilateration import (
    WEIGHTINGS,
    check_beacons,
    check_ranges,
    enough_ranges,
    iterate,
    iterate_from_pseudo_inverse,
    objective_weight,
    pseudo_inverse,
    weighted_error,
    weighted_error_jacobian,
)

# Raghavan et al., Fig. 4.
BEACON_M = np.array([(1.72, 0.35), (1.79, 5.63), (3.05, 2.61)])
RANGE_M = np.array([0.752835, 4.4, 3.07207])
ITERATIVE = {
    "absolute": IterativeAbsolute,
    "printed": IterativeFractionalPrinted,
    "fractional": IterativeFractional,
}
FIG4_M = {"absolute": (0.9014, 0.9410), "printed": (1.0306, 0.7756), "fractional": (1.0372, 0.6931)}
FOUR_BEACONS_M = np.array([(0.2, 0.1), (5.8, 0.5), (5.5, 7.7), (0.4, 7.2)])
EXACT = [PseudoInverse, *ITERATIVE.values(), LeastSquares]


def algorithm_classes() -> list[type[Any]]:
    return [
        getattr(importlib.import_module(f"algorithms.trilateration.{module.name}"), class_name(module.name))
        for module in pkgutil.iter_modules(algorithms.trilateration.__path__)
        if not module.name.startswith("control_")
    ]


ALL = algorithm_classes()


def distances_m(position_m: Array, beacon_m: Array) -> Array:
    return np.asarray(np.linalg.norm(position_m[..., None, :] - beacon_m, axis=-1))


def triplets(count: int, beacon_m: Array = BEACON_M, seed: int = 0, noise_m: float = 0.6) -> Array:
    """Return noisy distances to places of a room of 6 x 8 m, none below 0.5 m."""
    rng = np.random.default_rng(seed)
    exact_m = distances_m(rng.uniform((0.0, 0.0), (6.0, 8.0), (count, 2)), beacon_m)
    return np.maximum(exact_m + rng.normal(0.0, noise_m, exact_m.shape), 0.5)


def plain_loop(
    beacon_m: Array, range_m: Array, start_m: Array, weighting: str, step: float = 0.05, most: int = 5000
) -> tuple[Array, int]:
    """Iterate one triplet as the paper writes it, with the sign that converges."""
    ranged = ~np.isnan(range_m)
    beacon_m, range_m = beacon_m[ranged], range_m[ranged]
    estimate = np.array(start_m)
    for iteration in range(1, most + 1):
        offset = beacon_m - estimate
        distance_m = np.hypot(*offset.T)
        matrix = offset / np.where(distance_m > 0, distance_m, 1.0)[:, None]
        error = range_m - distance_m
        if weighting != "absolute":
            error = error / range_m
        if weighting == "fractional":
            matrix = matrix / range_m[:, None]
        delta = -np.linalg.pinv(matrix.T @ matrix, rcond=1e-11, hermitian=True) @ matrix.T @ error
        estimate = estimate + step * delta
        if np.hypot(*delta) < 1e-6:
            return estimate, iteration
    return estimate, -1


def test_fig4_pseudo_inverse() -> None:
    position_m = PseudoInverse().solve(BEACON_M, RANGE_M)
    np.testing.assert_array_equal(np.round(position_m, 4), (-0.5435, 1.2408))
    matrix = np.column_stack([np.ones(3), -2.0 * BEACON_M])
    side = RANGE_M**2 - np.sum(BEACON_M**2, axis=1)
    np.testing.assert_allclose(position_m, (np.linalg.pinv(matrix) @ side)[1:], rtol=1e-12)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_fig4_iterative(weighting: str) -> None:
    solver = ITERATIVE[weighting]()
    position_m = solver.solve(BEACON_M, RANGE_M)
    np.testing.assert_array_equal(np.round(position_m, 4), FIG4_M[weighting])
    assert solver.iterations_.shape == ()
    assert solver.iterations_ > 0
    np.testing.assert_allclose(
        position_m, LeastSquares(weighting=weighting).solve(BEACON_M, RANGE_M), atol=5e-6
    )


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_printed_plus_sign_diverges_on_fig4(weighting: str) -> None:
    position_m, iterations = iterate_from_pseudo_inverse(
        BEACON_M, RANGE_M, weighting=weighting, step=-0.05, most_iterations=100_000
    )
    assert iterations == -1
    assert np.isfinite(position_m).all()
    assert np.linalg.norm(position_m) > 1e6


def test_step_above_twice_the_shortest_distance_does_not_converge() -> None:
    # An exact scenario has no curvature at its solution: the limit is sharp. All unit vectors but the
    # first are orthogonal to it, so that 1 / 0.5 m is an eigenvalue of the correction's matrix.
    beacon_m = np.array([(0.5, 0.0), (0.0, 3.0), (0.0, -4.0)])
    range_m = np.array([0.5, 3.0, 4.0])
    cases = {
        "printed": ((0.05, True), (0.98, True), (1.02, False), (1.3, False)),
        "absolute": ((0.05, True), (1.95, True), (2.05, False)),
        "fractional": ((0.05, True), (1.95, True), (2.05, False)),
    }
    last = {}
    for weighting, steps in cases.items():
        for step, converges in steps:
            position_m, last[weighting] = iterate(
                beacon_m, range_m, start_m=(1e-3, 1e-3), weighting=weighting, step=step
            )
            assert np.isfinite(position_m).all()
            assert (last[weighting] > 0 and np.linalg.norm(position_m) < 1e-5) == converges
    # Just above its limit the printed one may be thrown to a rest elsewhere; further up it finds none.
    assert last == dict.fromkeys(cases, -1)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("beacon_m", [BEACON_M, FOUR_BEACONS_M], ids=["three", "four"])
def test_equals_the_plain_loop(weighting: str, beacon_m: Array) -> None:
    range_m = triplets(12, beacon_m)
    if len(beacon_m) == 4:
        range_m[::2, 1] = np.nan
    start_m = pseudo_inverse(beacon_m, range_m)
    position_m, iterations = iterate(
        beacon_m, range_m, start_m=start_m, weighting=weighting, most_iterations=4000
    )
    for index in range(len(range_m)):
        expected_m, expected = plain_loop(beacon_m, range_m[index], start_m[index], weighting, most=4000)
        if expected > 0:
            assert abs(iterations[index] - expected) <= 1
            np.testing.assert_allclose(position_m[index], expected_m, atol=2e-7)
        else:
            assert iterations[index] == -1
    assert (iterations > 0).sum() >= 10


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_fixed_points_are_those_of_least_squares(weighting: str) -> None:
    range_m = triplets(60, FOUR_BEACONS_M, noise_m=0.4)
    solver = ITERATIVE[weighting](tolerance_m=1e-9, most_iterations=20_000)
    position_m, reference_m = (
        solve(FOUR_BEACONS_M, range_m) for solve in (solver.solve, LeastSquares(weighting=weighting).solve)
    )
    assert (solver.iterations_ > 0).all()
    # The reference stops where the sum no longer changes, and that is flat at its least value.
    np.testing.assert_allclose(position_m, reference_m, atol=1e-5)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_gradient_of_the_named_sum_is_zero_at_rest(weighting: str) -> None:
    power = {"absolute": 0, "printed": 1, "fractional": 2}[weighting]
    range_m = triplets(20, FOUR_BEACONS_M)
    position_m, iterations = iterate_from_pseudo_inverse(
        FOUR_BEACONS_M, range_m, weighting=weighting, tolerance_m=1e-9, most_iterations=20_000
    )
    for place_m, ranges_m in zip(position_m[iterations > 0], range_m[iterations > 0], strict=True):

        def objective(place: Array, measured: Array = ranges_m) -> float:
            return float(np.sum((distances_m(place, FOUR_BEACONS_M) - measured) ** 2 / measured**power))

        np.testing.assert_allclose(approx_fprime(place_m, objective, 1e-7), 0.0, atol=2e-5)


@pytest.mark.parametrize("cls", EXACT)
@settings(max_examples=25, deadline=None)
@given(x_m=st.floats(0.2, 5.8), y_m=st.floats(0.2, 7.8), beacons=st.sampled_from([BEACON_M, FOUR_BEACONS_M]))
def test_exact_ranges_give_the_exact_place(cls: Any, x_m: float, y_m: float, beacons: Array) -> None:
    place_m = np.array([x_m, y_m])
    range_m = distances_m(place_m, beacons)
    if range_m.min() < 1e-3:
        return
    np.testing.assert_allclose(cls().solve(beacons, range_m), place_m, atol=1e-6)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@settings(max_examples=15, deadline=None)
@given(x_m=st.floats(0.5, 5.5), y_m=st.floats(0.5, 7.5), away_m=st.floats(0.05, 0.3))
def test_iteration_finds_the_exact_place_from_elsewhere(
    weighting: str, x_m: float, y_m: float, away_m: float
) -> None:
    place_m = np.array([x_m, y_m])
    position_m, iterations = iterate(
        FOUR_BEACONS_M,
        distances_m(place_m, FOUR_BEACONS_M),
        start_m=place_m + away_m,
        weighting=weighting,
        tolerance_m=1e-8,
        most_iterations=20_000,
    )
    assert iterations > 1
    np.testing.assert_allclose(position_m, place_m, atol=1e-6)


@pytest.mark.parametrize("cls", ALL)
@settings(max_examples=10, deadline=None)
@given(angle_rad=st.floats(-math.pi, math.pi), x_m=st.floats(-50, 50), y_m=st.floats(-50, 50))
def test_turned_and_moved_beacons_turn_and_move_the_position(
    cls: Any, angle_rad: float, x_m: float, y_m: float
) -> None:
    rotation = np.array(
        [[math.cos(angle_rad), -math.sin(angle_rad)], [math.sin(angle_rad), math.cos(angle_rad)]]
    )
    range_m = np.vstack([RANGE_M, triplets(2, noise_m=0.2)])
    before_m = cls().solve(BEACON_M, range_m)
    after_m = cls().solve(BEACON_M @ rotation.T + (x_m, y_m), range_m)
    np.testing.assert_allclose(after_m, before_m @ rotation.T + (x_m, y_m), atol=1e-6)


@pytest.mark.parametrize("cls", ALL)
def test_far_origin_costs_no_convergence(cls: Any) -> None:
    far_m = np.array([4.5e5, 5.4e6])
    np.testing.assert_allclose(
        cls().solve(BEACON_M + far_m, RANGE_M) - far_m, cls().solve(BEACON_M, RANGE_M), atol=1e-6
    )


@pytest.mark.parametrize("cls", ALL)
def test_order_of_the_beacons_does_not_matter(cls: Any) -> None:
    range_m = triplets(10, FOUR_BEACONS_M)
    range_m[3, 2] = np.nan
    order = [2, 0, 3, 1]
    np.testing.assert_allclose(
        cls().solve(FOUR_BEACONS_M[order], range_m[:, order]),
        cls().solve(FOUR_BEACONS_M, range_m),
        atol=2e-7,
    )


@pytest.mark.parametrize("cls", ALL)
@pytest.mark.parametrize("scale", [0.01, 3.28084, 1000.0])
def test_other_units_scale_the_position(cls: Any, scale: float) -> None:
    parameters = inspect.signature(cls).parameters
    # The printed f, and so its correction, has no unit: there the step is the length.
    lengths = {"step": 0.05} if cls is IterativeFractionalPrinted else {"tolerance_m": 1e-6}
    scaled = {name: scale * value for name, value in lengths.items() if name in parameters}
    np.testing.assert_allclose(
        cls(**scaled).solve(scale * BEACON_M, scale * RANGE_M),
        scale * cls().solve(BEACON_M, RANGE_M),
        rtol=1e-8,
    )


@pytest.mark.parametrize("cls", ALL)
@pytest.mark.parametrize("beacon_m", [BEACON_M, FOUR_BEACONS_M], ids=["three", "four"])
def test_batched_equals_one_by_one(cls: Any, beacon_m: Array) -> None:
    range_m = triplets(12, beacon_m).reshape(2, 3, 2, -1)
    range_m[0, 0, :2, 1] = np.nan
    solver = cls()
    together_m = solver.solve(beacon_m, range_m)
    iterations = np.array(getattr(solver, "iterations_", np.zeros((2, 3, 2))))
    assert together_m.shape == (2, 3, 2, 2)
    assert iterations.shape == (2, 3, 2)
    for index in np.ndindex(2, 3, 2):
        np.testing.assert_array_equal(solver.solve(beacon_m, range_m[index]), together_m[index])
        assert getattr(solver, "iterations_", 0) == iterations[index]


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_small_batches_change_no_bit(weighting: str, monkeypatch: pytest.MonkeyPatch) -> None:
    range_m = triplets(150, seed=3, noise_m=1.0)
    range_m[7] = (np.nan, 2.0, 3.0)
    whole = iterate_from_pseudo_inverse(BEACON_M, range_m, weighting=weighting, most_iterations=1200)
    assert {-1, 0} < set(whole[1].tolist()) or weighting == "absolute"
    for batch in (1, 7, 64):
        monkeypatch.setattr(trilateration, "_BATCH", batch)
        # Small batches take many iterations: the smallest has the longest check.
        few = slice(0, 12 if batch == 1 else None)
        parts = iterate_from_pseudo_inverse(BEACON_M, range_m[few], weighting=weighting, most_iterations=1200)
        np.testing.assert_array_equal(parts[0], whole[0][few])
        np.testing.assert_array_equal(parts[1], whole[1][few])


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_sums_over_many_beacons_do_not_depend_on_the_batch(weighting: str) -> None:
    beacon_m = np.random.default_rng(6).uniform((0.0, 0.0), (6.0, 8.0), (19, 2))
    range_m = triplets(9, beacon_m)
    # A whole step shows the last bits of a correction, which small ones round away.
    kwargs: dict[str, Any] = {"weighting": weighting, "step": 1.0, "most_iterations": 1}
    together_m, _ = iterate(beacon_m, range_m, start_m=(2.0, 3.0), **kwargs)
    for measured_m, found_m in zip(range_m, together_m, strict=True):
        alone_m, _ = iterate(beacon_m, measured_m, start_m=(2.0, 3.0), **kwargs)
        np.testing.assert_array_equal(alone_m, found_m)


@pytest.mark.parametrize("cls", ALL)
def test_every_world_may_have_its_own_beacons(cls: Any) -> None:
    beacon_m = np.stack([BEACON_M, FOUR_BEACONS_M[:3], BEACON_M[::-1] + 1.0])[:, None]
    range_m = np.stack([triplets(5, beacons[0], seed) for seed, beacons in enumerate(beacon_m)])
    together_m = cls().solve(beacon_m, range_m)
    assert together_m.shape == (3, 5, 2)
    for world in range(3):
        np.testing.assert_array_equal(cls().solve(beacon_m[world, 0], range_m[world]), together_m[world])
    # One set of distances may also be read with the beacons of several worlds.
    shared_m = cls().solve(beacon_m[:, 0], RANGE_M)
    np.testing.assert_array_equal(shared_m[1], cls().solve(beacon_m[1, 0], RANGE_M))


@pytest.mark.parametrize("cls", ALL)
def test_a_beacon_without_a_range_is_left_out(cls: Any) -> None:
    range_m = triplets(6, FOUR_BEACONS_M)
    for absent in range(4):
        some_m = range_m.copy()
        some_m[:, absent] = np.nan
        others = [i for i in range(4) if i != absent]
        np.testing.assert_allclose(
            cls().solve(FOUR_BEACONS_M, some_m),
            cls().solve(FOUR_BEACONS_M[others], range_m[:, others]),
            atol=1e-6,
        )


@pytest.mark.parametrize("cls", ALL)
def test_fewer_than_three_ranges_give_no_position(cls: Any) -> None:
    range_m = np.tile(distances_m(np.array([2.0, 3.0]), FOUR_BEACONS_M), (3, 1))
    range_m[0, :2] = np.nan
    range_m[1] = np.nan
    solver = cls()
    position_m = solver.solve(FOUR_BEACONS_M, range_m)
    assert np.isnan(position_m[:2]).all()
    assert np.isfinite(position_m[2]).all()
    if hasattr(solver, "iterations_"):
        assert solver.iterations_[:2].tolist() == [0, 0]
        assert solver.iterations_[2] > 0
    assert np.isnan(cls().solve(FOUR_BEACONS_M, range_m[1])).all()
    np.testing.assert_array_equal(enough_ranges(range_m), [False, False, True])


@pytest.mark.parametrize("cls", ALL)
def test_nothing_to_solve(cls: Any) -> None:
    assert cls().solve(BEACON_M, np.empty((0, 3))).shape == (0, 2)
    assert cls().solve(BEACON_M, np.empty((4, 0, 3))).shape == (4, 0, 2)


def test_ranged_beacons_on_one_line_give_the_point_between_the_mirror_images() -> None:
    beacon_m = np.array([(1.0, 1.0), (2.0, 2.0), (4.0, 4.0), (0.0, 3.0)])
    place_m = np.array([3.0, 1.0])
    range_m = distances_m(place_m, beacon_m)
    range_m[3] = np.nan
    np.testing.assert_allclose(pseudo_inverse(beacon_m, range_m), (2.0, 2.0), atol=1e-12)
    away_m = np.array([0.5, 7.0])
    np.testing.assert_allclose(pseudo_inverse(beacon_m + away_m, range_m), away_m + 2.0, atol=1e-12)
    for cls in (*ITERATIVE.values(), LeastSquares):
        assert np.isfinite(cls().solve(beacon_m + away_m, range_m)).all()


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_estimate_on_a_beacon_is_moved_by_the_others(weighting: str) -> None:
    for beacon in range(3):
        position_m, iterations = iterate(BEACON_M, RANGE_M, start_m=BEACON_M[beacon], weighting=weighting)
        expected_m, expected = plain_loop(BEACON_M, RANGE_M, BEACON_M[beacon], weighting)
        assert abs(iterations - expected) <= 1
        np.testing.assert_allclose(position_m, expected_m, atol=1e-6)
    first_m, _ = iterate(
        BEACON_M, RANGE_M, start_m=BEACON_M[0], weighting=weighting, step=1.0, most_iterations=1
    )
    offset = BEACON_M[1:] - BEACON_M[0]
    distance_m = np.hypot(*offset.T)
    power = {"absolute": 0, "printed": 1, "fractional": 1}[weighting]
    # Two circles are left, and two unknowns: the weights of the consistent readings drop out.
    error = (RANGE_M[1:] - distance_m) / (RANGE_M[1:] ** power if weighting == "printed" else 1.0)
    expected_m = BEACON_M[0] - np.linalg.solve(offset / distance_m[:, None], error)
    np.testing.assert_allclose(first_m, expected_m, rtol=1e-9)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_estimate_where_the_others_fit_stays_on_its_beacon(weighting: str) -> None:
    range_m = distances_m(BEACON_M[0], BEACON_M)
    range_m[0] = 1.0
    position_m, iterations = iterate(BEACON_M, range_m, start_m=BEACON_M[0], weighting=weighting)
    np.testing.assert_allclose(position_m, BEACON_M[0], atol=1e-12)
    assert iterations == 1


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_estimate_on_a_beacon_that_was_not_ranged(weighting: str) -> None:
    range_m = distances_m(np.array([2.0, 3.0]), FOUR_BEACONS_M)
    range_m[3] = np.nan
    position_m, iterations = iterate(
        FOUR_BEACONS_M, range_m, start_m=FOUR_BEACONS_M[3], weighting=weighting, most_iterations=20_000
    )
    assert iterations > 0
    np.testing.assert_allclose(position_m, (2.0, 3.0), atol=1e-5)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_estimate_on_one_line_with_the_ranged_beacons_stays_on_it(weighting: str) -> None:
    beacon_m = np.array([(0.0, 0.0), (3.0, 0.0), (7.0, 0.0), (0.0, 5.0)])
    range_m = np.array([3.0, 2.0, 4.0, np.nan])
    position_m, iterations = iterate(
        beacon_m, range_m, start_m=(4.2, 0.0), weighting=weighting, most_iterations=20_000
    )
    expected_m, expected = plain_loop(beacon_m, range_m, np.array([4.2, 0.0]), weighting, most=20_000)
    assert iterations > 0
    assert abs(iterations - expected) <= 1
    np.testing.assert_allclose(position_m, expected_m, atol=1e-7)
    assert abs(position_m[1]) < 1e-12


def test_limit_of_iterations_keeps_the_last_position() -> None:
    position_m, iterations = iterate(
        BEACON_M, RANGE_M, start_m=(1.0, 1.0), weighting="printed", most_iterations=10
    )
    expected_m, _ = plain_loop(BEACON_M, RANGE_M, np.array([1.0, 1.0]), "printed", most=10)
    assert iterations == -1
    np.testing.assert_allclose(position_m, expected_m, rtol=1e-12)
    needed = int(iterate(BEACON_M, RANGE_M, start_m=(1.0, 1.0), weighting="printed")[1])
    for most, expected in ((needed - 1, -1), (needed, needed)):
        assert (
            iterate(BEACON_M, RANGE_M, start_m=(1.0, 1.0), weighting="printed", most_iterations=most)[1]
            == expected
        )
    solver = LeastSquares(most_evaluations=2)
    assert np.isfinite(solver.solve(BEACON_M, RANGE_M)).all()
    assert solver.iterations_ == -1


@pytest.mark.parametrize("cls", ALL)
@pytest.mark.parametrize("range_m", [(1e-200, 4.4, 3.0), (1e200, 1e-3, 2.0), (1e-9, 1e-9, 1e-9)])
def test_absurd_ranges_give_finite_positions_or_say_so(cls: Any, range_m: tuple[float, ...]) -> None:
    solver = cls()
    with np.errstate(all="ignore"):
        position_m = solver.solve(BEACON_M, range_m)
    assert np.isfinite(position_m).all() or cls is PseudoInverse


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_jacobian_is_that_of_finite_differences(weighting: str) -> None:
    range_m = np.array([2.0, np.nan, 4.0, 5.0])
    weight = objective_weight(range_m, weighting)
    for place_m in np.random.default_rng(4).uniform(0.0, 8.0, (5, 2)):
        np.testing.assert_allclose(
            weighted_error_jacobian(place_m, FOUR_BEACONS_M, weight),
            approx_fprime(place_m, lambda at: weighted_error(at, FOUR_BEACONS_M, range_m, weight), 1e-7),
            atol=1e-6,
        )
    on_beacon = weighted_error_jacobian(FOUR_BEACONS_M[0], FOUR_BEACONS_M, weight)
    np.testing.assert_array_equal(on_beacon[0], 0.0)
    assert np.isfinite(on_beacon).all()


def test_weights_by_name() -> None:
    range_m = np.array([0.5, np.nan, 4.0])
    np.testing.assert_allclose(objective_weight(range_m, "absolute"), (1.0, 0.0, 1.0))
    np.testing.assert_allclose(objective_weight(range_m, "printed"), (2.0, 0.0, 0.25))
    np.testing.assert_allclose(objective_weight(range_m, "fractional"), (4.0, 0.0, 0.0625))
    with pytest.raises(InputError, match=r"weighting='relative'.*absolute, printed, fractional"):
        objective_weight(range_m, "relative")
    with pytest.raises(InputError, match="weighting='relative'"):
        LeastSquares(weighting="relative").solve(BEACON_M, RANGE_M)


def test_pseudo_inverse_of_many_beacons_is_that_of_the_linear_system() -> None:
    rng = np.random.default_rng(8)
    beacon_m = rng.uniform((190.0, -90.0), (210.0, -70.0), (7, 2))
    range_m = rng.uniform(1.0, 15.0, (20, 7))
    range_m[rng.uniform(size=range_m.shape) < 0.3] = np.nan
    position_m = pseudo_inverse(beacon_m, range_m)
    for measured_m, found_m in zip(range_m, position_m, strict=True):
        ranged = ~np.isnan(measured_m)
        matrix = np.column_stack([np.ones(ranged.sum()), -2.0 * beacon_m[ranged]])
        side = measured_m[ranged] ** 2 - np.sum(beacon_m[ranged] ** 2, axis=1)
        np.testing.assert_allclose(found_m, np.linalg.lstsq(matrix, side)[0][1:], rtol=1e-7)


@pytest.mark.parametrize("cls", ALL)
@pytest.mark.parametrize(
    ("beacon_m", "message"),
    [
        (BEACON_M[:2], "at least 3"),
        (BEACON_M[0], r"\[\.\.\., b, 2\]"),
        (np.ones((4, 3)), r"\[\.\.\., b, 2\]"),
        (np.array([(0.0, 0.0), (1.0, 1.0), (3.0, 3.0)]), "one line"),
        (np.array([(0.1, 0.7), (0.1, 1.3), (0.1, 3.0)]), "one line"),
        (np.array([(1.0, 2.0), (0.0, 0.0), (1.0, 2.0), (4.0, 0.0)]), "beacons 0 and 2"),
        (np.full((3, 2), 5.0), "beacons 0 and 1"),
        (np.array([(0.0, 0.0), (np.nan, 1.0), (3.0, 0.0)]), r"beacon_m\[1, 0\] = nan"),
        (np.array([(0.0, 0.0), (1.0, np.inf), (3.0, 0.0)]), r"beacon_m\[1, 1\] = inf"),
    ],
)
def test_beacons_that_give_no_position_are_refused(cls: Any, beacon_m: Array, message: str) -> None:
    with pytest.raises(InputError, match=message):
        cls().solve(beacon_m, np.ones(max(1, len(beacon_m))))


def test_one_bad_world_among_many_is_named() -> None:
    beacon_m = np.tile(BEACON_M, (4, 1, 1))
    beacon_m[2] = [(0.0, 0.0), (1.0, 0.5), (4.0, 2.0)]
    with pytest.raises(InputError, match=r"beacon_m\[2\]: all beacons stand on one line"):
        check_beacons(beacon_m)
    beacon_m[1, 2] = beacon_m[1, 0]
    with pytest.raises(InputError, match=r"beacon_m\[1\]: beacons 0 and 2"):
        check_beacons(beacon_m)


@pytest.mark.parametrize("cls", ALL)
@pytest.mark.parametrize(
    ("range_m", "message"),
    [
        ((1.0, 2.0), "does not fit"),
        ((1.0, 2.0, 3.0, 4.0), "does not fit"),
        (1.0, "does not fit"),
        ((1.0, 0.0, 3.0), r"range_m\[1\] = 0"),
        ((1.0, 2.0, -3.0), r"range_m\[2\] = -3"),
        ((np.inf, 2.0, 3.0), r"range_m\[0\] = inf"),
        ([(1.0, 2.0, 3.0), (1.0, -np.inf, 3.0)], r"range_m\[1, 1\] = -inf"),
    ],
)
def test_ranges_that_are_none_are_refused(cls: Any, range_m: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        cls().solve(BEACON_M, range_m)


def test_leading_axes_must_fit() -> None:
    with pytest.raises(InputError, match="does not fit"):
        check_ranges(np.ones((3, 3)), np.tile(BEACON_M, (2, 1, 1)))
    with pytest.raises(InputError, match="start_m"):
        iterate(BEACON_M, np.ones((5, 3)), start_m=np.zeros((4, 2)), weighting="absolute")
    with pytest.raises(InputError, match=r"start_m\[1, 0\] = nan"):
        iterate(BEACON_M, np.ones((2, 3)), start_m=[(0.0, 0.0), (np.nan, 0.0)], weighting="absolute")


@pytest.mark.parametrize("cls", list(ITERATIVE.values()))
@pytest.mark.parametrize(
    "setting",
    [{"step": 0.0}, {"step": math.nan}, {"tolerance_m": 0.0}, {"tolerance_m": -1e-6}, {"most_iterations": 0}],
)
def test_senseless_settings_are_refused(cls: Any, setting: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(setting))}="):
        cls(**setting).solve(BEACON_M, RANGE_M)


@pytest.mark.parametrize("setting", [{"tolerance": 0.0}, {"most_evaluations": 0}])
def test_senseless_settings_of_least_squares_are_refused(setting: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(setting))}="):
        LeastSquares(**setting).solve(BEACON_M, RANGE_M)


def test_template_is_a_weighted_centroid() -> None:
    weight = 1.0 / RANGE_M
    np.testing.assert_allclose(Template().solve(BEACON_M, RANGE_M), weight @ BEACON_M / weight.sum())
    np.testing.assert_allclose(Template(exponent=0.0).solve(BEACON_M, RANGE_M), BEACON_M.mean(axis=0))
    with pytest.raises(InputError, match="exponent=-1"):
        Template(exponent=-1.0).solve(BEACON_M, RANGE_M)


@pytest.mark.parametrize("cls", ALL)
def test_constructors_take_keywords_and_store_them(cls: Any) -> None:
    for name, parameter in inspect.signature(cls).parameters.items():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        marker = object()
        assert getattr(cls(**{name: marker}), name) is marker


@pytest.mark.parametrize("cls", ALL)
def test_inputs_are_left_as_they_are(cls: Any) -> None:
    beacon_m, range_m = BEACON_M.copy(), np.array([RANGE_M, (np.nan, 1.0, 2.0)])
    before = range_m.copy()
    cls().solve(beacon_m, range_m)
    np.testing.assert_array_equal(beacon_m, BEACON_M)
    np.testing.assert_array_equal(range_m, before)
