"""Many minimisations side by side against SciPy's, one by one."""

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from positioning.errors import InputError
from positioning.fingerprints import Index
from positioning.model import Array
from positioning.quasi_newton import Minima, minimise_together

START = np.random.default_rng(0).normal(0, 2, (30, 6))


class Counted:
    """Rosenbrock's valley, and how many values each problem asked for."""

    def __init__(self) -> None:
        self.calls = np.zeros(len(START), dtype=int)

    def __call__(self, problem: Index, point: Array) -> tuple[Array, Array]:
        """Return values and gradients."""
        self.calls[problem] += 1
        return np.array([rosen(x) for x in point]), np.array([rosen_der(x) for x in point])


@pytest.mark.parametrize("iterations", [1, 2, 5, 12, 20, 500])
def test_steps_are_those_of_scipy(iterations: int) -> None:
    counted = Counted()
    found = minimise_together(counted, START, iterations=iterations)
    for problem, start in enumerate(START):
        expected = minimize(rosen, start, jac=rosen_der, method="L-BFGS-B", options={"maxiter": iterations})
        assert found.iterations[problem] == expected.nit
        assert counted.calls[problem] == expected.nfev
        # The valley is narrow: differences in the last digit grow by a factor of ten in every few steps.
        np.testing.assert_allclose(found.point[problem], expected.x, atol=1e-6)
        np.testing.assert_allclose(found.value[problem], expected.fun, atol=1e-8)


@pytest.mark.parametrize(("depth", "memory"), [(1.0, 5), (2.0, 3), (2.0, 5)])
def test_a_step_without_curvature_is_skipped_as_in_scipy(depth: float, memory: int) -> None:
    """Across the ridges of a bowl with teeth some steps have a negative curvature; older ones are kept."""
    steepness = np.arange(1.0, 7.0)

    def teeth(point: Array) -> tuple[Array, Array]:
        saw = np.mod(point, 1.0) - 0.5
        value = np.sum(steepness * point**2 / 2 - depth * np.abs(saw), axis=-1)
        return value, steepness * point - depth * np.sign(saw)

    found = minimise_together(lambda _, point: teeth(point), START, iterations=40, memory=memory)
    options = {"maxiter": 40, "maxcor": memory}
    for problem, start in enumerate(START):
        expected = minimize(teeth, start, jac=True, method="L-BFGS-B", options=options)
        assert found.iterations[problem] == expected.nit
        np.testing.assert_allclose(found.point[problem], expected.x, atol=1e-6)


@pytest.mark.parametrize("setting", ["gtol", "ftol", "maxcor"])
def test_settings_mean_what_they_mean_in_scipy(setting: str) -> None:
    value = {"gtol": 5.0, "ftol": 1e-2, "maxcor": 2}[setting]
    name = {"gtol": "gradient_tolerance", "ftol": "value_tolerance", "maxcor": "memory"}[setting]
    found = minimise_together(Counted(), START, iterations=30, **{name: value})  # type: ignore[arg-type]
    usual = minimise_together(Counted(), START, iterations=30)
    assert np.abs(found.point - usual.point).max() > 1e-3
    for problem, start in enumerate(START):
        options = {"maxiter": 30, setting: value}
        expected = minimize(rosen, start, jac=rosen_der, method="L-BFGS-B", options=options)
        assert found.iterations[problem] == expected.nit
        np.testing.assert_allclose(found.point[problem], expected.x, atol=1e-6)


def test_problems_do_not_touch_each_other() -> None:
    together = minimise_together(Counted(), START, iterations=25)
    alone = [minimise_together(Counted(), START[i : i + 1], iterations=25) for i in range(5)]
    for problem, one in enumerate(alone):
        np.testing.assert_array_equal(one.point[0], together.point[problem])
        assert one.iterations[0] == together.iterations[problem]


def test_what_is_a_minimum_already_stays_and_start_is_left_alone() -> None:
    start = np.vstack([np.ones(6), START[0]])
    before = start.copy()
    found = minimise_together(Counted(), start, iterations=500)
    np.testing.assert_array_equal(start, before)
    assert found.iterations[0] == 0
    np.testing.assert_array_equal(found.point[0], np.ones(6))
    np.testing.assert_allclose(found.point[1], np.ones(6), atol=1e-4)


def test_a_gradient_that_points_uphill_ends() -> None:
    """The search finds no point, forgets its curvature, and gives up: as SciPy's."""

    def wrong(problem: Index, point: Array) -> tuple[Array, Array]:
        return np.sum(point**2, axis=1), -2.0 * point

    found = minimise_together(wrong, START[:3], iterations=50)
    assert isinstance(found, Minima)
    for problem, start in enumerate(START[:3]):
        expected = minimize(lambda x: np.sum(x**2), start, jac=lambda x: -2.0 * x, method="L-BFGS-B")
        assert found.iterations[problem] == expected.nit == 0
        np.testing.assert_array_equal(found.point[problem], expected.x)


@pytest.mark.parametrize("name", ["iterations", "memory"])
def test_senseless_settings_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"{name}=0: it must be at least 1"):
        minimise_together(Counted(), START, **{"iterations": 5, name: 0})  # type: ignore[arg-type]
