"""The propagation model against closed forms and least squares fold by fold."""

import numpy as np
import pytest
from scipy import stats

from positioning.errors import InputError
from positioning.fingerprints import training_members
from positioning.model import Array, Site
from positioning.propagation import fit_propagation, grid_m, log_likelihood, propagation_terms

CORNER_M = np.array([[0.0, 0.0], [12.0, 9.0]])
ACCESS_POINT_M = np.array([[1.0, 1.0], [11.0, 2.0], [6.0, 8.0]])
WALL_M = np.array([[[4.1, -1.0], [4.1, 6.2]], [[8.3, 2.9], [8.3, 10.0]], [[-1.0, 4.7], [5.6, 4.7]]])
SITE = Site(corner_m=CORNER_M, access_point_m=ACCESS_POINT_M, wall_m=WALL_M)
COEFFICIENT = np.array([[-30.0, -14.0, -3.0], [-35.0, -12.0, -5.0], [-28.0, -16.0, -1.0]])


def survey(noise_db: float = 0.0, samples: int = 40) -> tuple[Array, Array]:
    """Return positions and readings that follow the model."""
    rng = np.random.default_rng(1)
    position_m = rng.uniform(CORNER_M[0], CORNER_M[1], (samples, 2))
    expected = np.einsum("nat,at->na", propagation_terms(position_m, SITE), COEFFICIENT)
    return position_m, expected + noise_db * rng.standard_normal(expected.shape)


def test_terms_by_hand() -> None:
    terms = propagation_terms([[6.0, 1.0], [1.0, 1.0]], SITE)
    np.testing.assert_allclose(terms[0, 0], [1.0, np.log(5.0), 1.0])
    # At the access point itself: clipped at half a metre.
    np.testing.assert_allclose(terms[1, 0], [1.0, np.log(0.5), 0.0])
    no_walls = propagation_terms([[6.0, 1.0]], Site(corner_m=CORNER_M, access_point_m=ACCESS_POINT_M))
    assert no_walls.shape == (1, 3, 2)


def test_fit_finds_the_coefficients_of_a_noiseless_world() -> None:
    position, rss = survey()
    model = fit_propagation(propagation_terms(position, SITE), rss, np.ones((1, 40), dtype=bool))
    np.testing.assert_allclose(model.coefficient[0], COEFFICIENT, atol=1e-8)
    np.testing.assert_allclose(model.deviation_db, 12**-0.5)
    assert model.used.all()


def test_fit_equals_least_squares_fold_by_fold() -> None:
    position, rss = survey(noise_db=4.0)
    rss[::7, 1] = np.nan
    rss[5, 0] = np.nan
    terms, member = propagation_terms(position, SITE), training_members(position)
    model = fit_propagation(terms, rss, member)
    for fold in range(40):
        for access_point in range(3):
            rows = member[fold] & ~np.isnan(rss[:, access_point])
            regressor, reading = terms[rows, access_point], rss[rows, access_point]
            solution = np.linalg.lstsq(regressor, reading)[0]
            np.testing.assert_allclose(model.coefficient[fold, access_point], solution, rtol=1e-8)
            deviation_db = np.sqrt(np.sum((reading - regressor @ solution) ** 2) / (rows.sum() - 3))
            np.testing.assert_allclose(model.deviation_db[fold, access_point], deviation_db, rtol=1e-9)


def test_fit_without_a_crossed_wall_has_no_wall_loss() -> None:
    position, rss = survey(noise_db=2.0)
    far_wall = Site(
        corner_m=CORNER_M, access_point_m=ACCESS_POINT_M, wall_m=np.array([[[50.0, 0.0], [50.0, 9.0]]])
    )
    no_wall = Site(corner_m=CORNER_M, access_point_m=ACCESS_POINT_M)
    member = training_members(position)
    with_term = fit_propagation(propagation_terms(position, far_wall), rss, member)
    without = fit_propagation(propagation_terms(position, no_wall), rss, member)
    np.testing.assert_allclose(with_term.coefficient[..., :2], without.coefficient, rtol=1e-8)
    np.testing.assert_allclose(with_term.coefficient[..., 2], 0.0, atol=1e-9)


def test_access_points_heard_too_seldom_are_ignored() -> None:
    position, rss = survey(noise_db=2.0)
    rss[4:, 0] = np.nan
    rss[:, 1] = np.nan
    terms = propagation_terms(position, SITE)
    model = fit_propagation(terms, rss, training_members(position))
    # Four readings of the first one: those folds that test one of them have three left.
    np.testing.assert_array_equal(model.used[:, 0], np.arange(40) >= 4)
    assert not model.used[:, 1].any()
    assert model.used[:, 2].all()
    assert np.isfinite(model.coefficient).all()
    reading = np.full((40, 3), -50.0)
    reading[:, 2] = np.nan
    likelihood = log_likelihood(model, propagation_terms(grid_m(CORNER_M, 1.0), SITE), reading)
    assert (likelihood[:4] == 0).all()
    assert (likelihood[4:] != 0).any()


def test_likelihood_is_gaussian() -> None:
    position, rss = survey(noise_db=4.0)
    terms = propagation_terms(position, SITE)
    model = fit_propagation(terms, rss, np.ones((1, 40), dtype=bool))
    tested = np.array([[-40.0, np.nan, -60.0], [np.nan, np.nan, np.nan]])
    places = propagation_terms([[2.0, 3.0], [10.0, 7.0]], SITE)
    expected = np.einsum("gat,at->ga", places, model.coefficient[0])
    terms_of_density = stats.norm.logpdf(tested[:1], expected, model.deviation_db[0])
    density = np.nansum(terms_of_density, axis=1)
    likelihood = log_likelihood(model, places, tested)
    np.testing.assert_allclose(likelihood[0, 1] - likelihood[0, 0], density[1] - density[0], rtol=1e-10)
    np.testing.assert_array_equal(likelihood[1], 0.0)

    silent = stats.norm.logcdf(-70.0, expected, model.deviation_db[0])
    likelihood = log_likelihood(model, places, tested, floor_dbm=-70.0)
    density += silent[:, 1]
    np.testing.assert_allclose(likelihood[0, 1] - likelihood[0, 0], density[1] - density[0], rtol=1e-10)
    np.testing.assert_allclose(likelihood[1], silent.sum(axis=1), rtol=1e-10)


def test_grid_covers_the_site_evenly() -> None:
    grid = grid_m([[1.0, 2.0], [4.0, 3.1]], 0.5)
    assert grid.shape == (6 * 3, 2)
    np.testing.assert_allclose(grid.mean(axis=0), [2.5, 2.55])
    np.testing.assert_allclose(grid.min(axis=0), [1.25, 2.0 + 1.1 / 6])
    assert len(grid_m([[0.0, 0.0], [0.3, 0.0]], 0.5)) == 1


@pytest.mark.parametrize(
    ("corner_m", "step_m", "message"),
    [([[0, 0], [1, 1]], 0.0, "grid_step_m=0.0"), ([[5, 0], [1, 1]], 0.5, "enclose no area")],
)
def test_senseless_grids_are_refused(corner_m: list[list[float]], step_m: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        grid_m(corner_m, step_m)


def test_unknown_access_points_are_refused() -> None:
    lost = ACCESS_POINT_M.copy()
    lost[1] = np.nan
    for access_point_m in (None, lost):
        with pytest.raises(InputError, match="position of every access point"):
            propagation_terms([[1.0, 1.0]], Site(corner_m=CORNER_M, access_point_m=access_point_m))
