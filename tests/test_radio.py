"""Path loss, shadowing and receiver against closed forms and scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import cholesky
from scipy.spatial.distance import cdist
from scipy.stats import chi2

from positioning.errors import InputError
from positioning.radio import correlated_shadowing_db, path_loss_dbm, receive


def test_path_loss_falls_by_ten_exponents_a_decade_and_stops_at_one_metre():
    level = path_loss_dbm([0.0, 0.5, 1.0, 10.0, 100.0], reference_dbm=-30.0, path_loss_exponent=2.5)
    np.testing.assert_allclose(level, [-30, -30, -30, -55, -80], rtol=1e-14)


def test_path_loss_broadcasts_over_worlds():
    distance_m = np.full((3, 4, 2), 10.0)
    level = path_loss_dbm(
        distance_m,
        reference_dbm=np.array([-30.0, -40.0]),
        path_loss_exponent=np.array([1, 2, 3]).reshape(3, 1, 1),
    )
    np.testing.assert_allclose(level[:, 0], [[-40, -50], [-50, -60], [-60, -70]])


def test_shadowing_is_the_cholesky_factor_times_the_draws():
    position_m = np.random.default_rng(1).uniform(0, 20, (30, 2))
    shadowing_db = correlated_shadowing_db(
        position_m, deviation_db=3.0, correlation_length_m=4.0, count=6, rng=np.random.default_rng(2)
    )
    factor = cholesky(np.exp(-cdist(position_m, position_m) / 4.0), lower=True)
    expected = 3.0 * factor @ np.random.default_rng(2).standard_normal((30, 6))
    np.testing.assert_allclose(shadowing_db, expected, atol=1e-6)


def test_shadowing_has_the_covariance_of_the_model():
    position_m = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 3.0], [8.0, 8.0]])
    draws = 40000
    sample = correlated_shadowing_db(
        position_m, deviation_db=4.0, correlation_length_m=3.0, count=draws, rng=np.random.default_rng(3)
    )
    covariance = 16.0 * np.exp(-cdist(position_m, position_m) / 3.0)
    # Standard error of a sample covariance of normals: sqrt((c_ij^2 + c_ii c_jj) / draws).
    error = np.sqrt((covariance**2 + 16.0**2) / draws)
    assert (np.abs(sample @ sample.T / draws - covariance) < 4 * error).all()
    assert (np.abs(sample.mean(axis=1)) < 4 * 4.0 / np.sqrt(draws)).all()
    # Whitened by the model, the whole sample is chi-squared.
    squared = float(np.sum(sample * np.linalg.solve(covariance, sample)))
    assert chi2.ppf(1e-4, 4 * draws) < squared < chi2.ppf(1 - 1e-4, 4 * draws)


def test_access_points_are_shadowed_independently():
    position_m = np.random.default_rng(4).uniform(0, 300, (4000, 2))[:600]
    sample = correlated_shadowing_db(
        position_m, deviation_db=1.0, correlation_length_m=0.5, count=3, rng=np.random.default_rng(5)
    )
    correlation = np.corrcoef(sample.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 4 / np.sqrt(600)


def test_shadowing_of_coinciding_places_is_the_same():
    shadowing_db = correlated_shadowing_db(
        [[1.0, 2.0], [1.0, 2.0]],
        deviation_db=3.0,
        correlation_length_m=2.0,
        count=5,
        rng=np.random.default_rng(6),
    )
    np.testing.assert_allclose(shadowing_db[0], shadowing_db[1], atol=1e-3)
    assert np.abs(shadowing_db[0]).max() > 0.1


def test_shadowing_broadcasts_over_worlds():
    position_m = np.random.default_rng(7).uniform(0, 20, (3, 9, 2))
    shadowing_db = correlated_shadowing_db(
        position_m,
        deviation_db=np.array([0.0, 1.0, 2.0]).reshape(3, 1, 1),
        correlation_length_m=np.array([1.0, 2.0, 3.0]).reshape(3, 1, 1),
        count=2,
        rng=np.random.default_rng(8),
    )
    assert shadowing_db.shape == (3, 9, 2)
    normal = np.random.default_rng(8).standard_normal((3, 9, 2))
    factor = cholesky(np.exp(-cdist(position_m[2], position_m[2]) / 3.0), lower=True)
    np.testing.assert_allclose(shadowing_db[2], 2.0 * factor @ normal[2], atol=1e-6)
    assert (shadowing_db[0] == 0).all()


def test_senseless_parameters_are_named():
    places = np.zeros((2, 2))
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="deviation_db"):
        correlated_shadowing_db(places, deviation_db=-1.0, correlation_length_m=1.0, count=1, rng=rng)
    with pytest.raises(InputError, match="correlation_length_m"):
        correlated_shadowing_db(places, deviation_db=1.0, correlation_length_m=0.0, count=1, rng=rng)
    with pytest.raises(InputError, match="noise_db"):
        receive(places, noise_db=np.nan, floor_dbm=-93.0, fading=rng)


def test_receiver_rounds_and_loses_what_is_below_its_floor():
    field_dbm = [[-50.4, -50.6, -92.6, -93.4, -93.6, -120.0, np.nan]]
    rss_dbm = receive(field_dbm, noise_db=0.0, floor_dbm=-93.0, fading=np.random.default_rng(1))
    np.testing.assert_array_equal(rss_dbm, [[-50, -51, -93, -93, np.nan, np.nan, np.nan]])


def test_generator_and_its_normals_give_the_same_readings():
    field_dbm = np.full((2, 5, 3), -60.0)
    normal = np.random.default_rng(9).standard_normal(field_dbm.shape)
    drawn = receive(field_dbm, noise_db=4.0, floor_dbm=-93.0, fading=np.random.default_rng(9))
    np.testing.assert_array_equal(drawn, receive(field_dbm, noise_db=4.0, floor_dbm=-93.0, fading=normal))
    np.testing.assert_array_equal(drawn, np.rint(-60.0 + 4.0 * normal))


@settings(deadline=None, max_examples=50)
@given(low=st.floats(0, 6), high=st.floats(0, 6), seed=st.integers(0, 1000))
def test_readings_move_further_from_the_field_with_more_noise(low, high, seed):
    low, high = sorted((low, high))
    normal = np.random.default_rng(seed).standard_normal((20, 4))
    calm, rough = (
        receive(np.full((20, 4), -60.0), noise_db=noise, floor_dbm=-1000.0, fading=normal)
        for noise in (low, high)
    )
    assert (np.abs(rough + 60.0) >= np.abs(calm + 60.0)).all()


def test_spread_of_many_scans_is_noise_and_rounding():
    rss_dbm = receive(
        np.full((1, 2), -60.3),
        noise_db=4.0,
        floor_dbm=-1000.0,
        fading=np.random.default_rng(10).normal(size=(50000, 1, 2)),
    )
    assert rss_dbm.shape == (50000, 1, 2)
    np.testing.assert_allclose(rss_dbm.var(), 16.0 + 1 / 12, rtol=0.03)
    np.testing.assert_allclose(rss_dbm.mean(), -60.3, atol=0.06)
