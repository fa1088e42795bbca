"""Radial basis functions against explicit Gram-Schmidt, fold by fold."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning import radial_basis
from positioning.errors import InputError
from positioning.fingerprints import Mask, signal_distance_db, training_members
from positioning.model import Array
from positioning.radial_basis import estimate, fit_network, gaussian_kernel, orthogonal_least_squares


def survey(samples: int, access_points: int, seed: int = 0) -> tuple[Array, Array]:
    """Return readings of a log-distance world, not rounded, and positions."""
    rng = np.random.default_rng(seed)
    position_m = rng.uniform((0.0, 0.0), (30.0, 25.0), (samples, 2))
    access_point_m = rng.uniform((0.0, 0.0), (30.0, 25.0), (access_points, 2))
    distance_m = np.linalg.norm(position_m[:, None] - access_point_m, axis=-1)
    return -35 - 33 * np.log10(distance_m) + rng.normal(0, 4, distance_m.shape), position_m


def explicit_selection(kernel: Array, target: Array, neurons: int) -> list[int]:
    """Choose centres with every residual formed anew from a QR decomposition of the chosen columns."""
    centres: list[int] = []
    available = np.linalg.norm(kernel, axis=0) > 0
    for _ in range(min(neurons, len(kernel))):
        basis = np.linalg.qr(kernel[:, centres])[0] if centres else np.zeros((len(kernel), 0))
        residual = kernel - basis @ (basis.T @ kernel)
        residual -= basis @ (basis.T @ residual)
        norm = np.sum(residual**2, axis=0)
        available &= norm > 1e-12 * np.sum(kernel**2, axis=0)
        available[centres] = False
        with np.errstate(invalid="ignore", divide="ignore"):
            score = np.sum((residual.T @ target) ** 2 / np.sum(target**2, axis=0), axis=1) / norm
        score = np.where(available, score, -1.0)
        if score.max() <= 1e-20:
            break
        centres.append(int(np.argmax(score >= score.max() * (1 - 1e-10))))
    return centres


def assert_selection_is_explicit(kernel: Array, target: Array, member: Mask, neurons: int) -> None:
    """Compare every fold with the explicit selection on its members only.

    Columns are compared, not indices: of equal fingerprints any one may be the centre.
    """
    centre = orthogonal_least_squares(kernel, target, member, neurons)
    for fold, chosen in enumerate(member):
        index = np.flatnonzero(chosen)
        expected = explicit_selection(kernel[np.ix_(index, index)], target[index], neurons)
        np.testing.assert_array_equal(kernel[:, centre[fold, : len(expected)]], kernel[:, index[expected]])
        assert (centre[fold, len(expected) :] == -1).all()


@pytest.mark.parametrize("access_points", [1, 2, 6])
@pytest.mark.parametrize("spread_db", [4.0, 45.0, 200.0])
def test_selection_equals_explicit_gram_schmidt(access_points: int, spread_db: float) -> None:
    rss, position = survey(60, access_points)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), spread_db)
    assert_selection_is_explicit(kernel, position, training_members(position), 12)


def test_selection_equals_explicit_gram_schmidt_on_the_size_of_the_paper() -> None:
    rss, position = survey(257, 6, seed=3)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 45.0)
    assert_selection_is_explicit(kernel, position, training_members(position)[:8], 30)


def test_selection_with_duplicate_fingerprints_and_positions() -> None:
    rss, position = survey(40, 3)
    rss[5], rss[17], position[30] = rss[2], rss[2], position[31]
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 60.0)
    member = training_members(position)
    assert member[30].sum() == 38
    centre = orthogonal_least_squares(kernel, position, member, 25)
    assert_selection_is_explicit(kernel, position, member, 25)
    for fold in range(40):
        assert len({2, 5, 17} & set(centre[fold].tolist())) <= 1


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([3.0, 20.0, 120.0]), st.integers(1, 9))
def test_selection_on_random_subsets(seed: int, spread_db: float, neurons: int) -> None:
    rng = np.random.default_rng(seed)
    rss, position = survey(18, 2, seed)
    member = rng.random((5, 18)) < 0.7
    member[:, 0] = True
    kernel = gaussian_kernel(signal_distance_db(rss, rss), spread_db)
    assert_selection_is_explicit(kernel, position, member, neurons)


def test_norms_are_recomputed_where_down_dating_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    rss, position = survey(60, 1)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 200.0)
    member = training_members(position)
    right = orthogonal_least_squares(kernel, position, member, 12)
    monkeypatch.setattr(radial_basis, "_TRUSTED", 1e-30)
    assert (orthogonal_least_squares(kernel, position, member, 12) != right).any()


@pytest.mark.parametrize(("access_points", "spread_db"), [(6, 45.0), (6, 12.0), (2, 30.0)])
def test_weights_equal_least_squares(access_points: int, spread_db: float) -> None:
    rss, position = survey(50, access_points)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), spread_db)
    member = training_members(position)
    network = fit_network(kernel, position, member, 9)
    located = estimate(network, kernel)
    for fold, chosen in enumerate(member):
        regressor = np.column_stack([kernel[:, network.centre[fold]], np.ones(50)])
        solution = np.linalg.lstsq(regressor[chosen], position[chosen])[0]
        np.testing.assert_allclose(located[fold], regressor[fold] @ solution, atol=1e-7)
        residual = position - kernel[:, network.centre[fold]] @ network.weight[fold] - network.bias[fold]
        np.testing.assert_allclose(regressor[chosen].T @ residual[chosen], 0.0, atol=1e-6)


def test_what_does_not_train_leaves_no_trace() -> None:
    rss, position = survey(40, 4)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 45.0)
    member = training_members(position)
    before = fit_network(kernel, position, member, 10)
    for fold in range(40):
        changed = position.copy()
        changed[fold] = (-1e7 / 3, 1e9 / 7)
        after = fit_network(kernel, changed, member, 10)
        for old, new in zip(before, after, strict=True):
            np.testing.assert_array_equal(old[fold], new[fold])


def test_what_does_not_train_leaves_no_trace_where_norms_are_recomputed() -> None:
    rss, position = survey(40, 1)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 150.0)
    member = training_members(position)
    before = fit_network(kernel, position, member, 10)
    for fold in range(0, 40, 3):
        changed = position.copy()
        changed[fold] += 1234.567
        after = fit_network(kernel, changed, member, 10)
        np.testing.assert_array_equal(before.centre[fold], after.centre[fold])
        np.testing.assert_array_equal(before.weight[fold], after.weight[fold])


def test_as_many_neurons_as_samples_interpolate() -> None:
    rss, position = survey(20, 6)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 8.0)
    network = fit_network(kernel, position, np.ones((1, 20), dtype=bool), 20)
    np.testing.assert_allclose(estimate(network, kernel), position, atol=1e-6)


def test_equal_fingerprints_give_one_centre_and_the_mean_position() -> None:
    _, position = survey(12, 1)
    kernel = np.ones((12, 12))
    network = fit_network(kernel, position, training_members(position), 5)
    assert (network.centre[:, 0] >= 0).all()
    assert (network.centre[:, 1:] == -1).all()
    expected = (position.sum(axis=0) - position) / 11
    np.testing.assert_allclose(estimate(network, kernel), expected, rtol=1e-12)


def test_more_neurons_than_samples_stop_early() -> None:
    rss, position = survey(6, 6)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 5.0)
    centre = orthogonal_least_squares(kernel, position, training_members(position), 30)
    assert centre.shape == (6, 30)
    for fold in range(6):
        assert sorted(centre[fold, :5]) == [i for i in range(6) if i != fold]
    assert (centre[:, 5:] == -1).all()


def test_parts_of_the_folds_give_the_same_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    rss, position = survey(50, 6)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 45.0)
    member = training_members(position)
    whole = estimate(fit_network(kernel, position, member, 10), kernel)
    monkeypatch.setattr(radial_basis, "_CHUNK_BYTES", 7 * 8 * 50 * 10)
    np.testing.assert_allclose(estimate(fit_network(kernel, position, member, 10), kernel), whole, atol=1e-8)


def test_scaled_targets_scale_the_weights() -> None:
    rss, position = survey(40, 4)
    kernel = gaussian_kernel(signal_distance_db(rss, rss), 30.0)
    member = training_members(position)
    metres, feet = (fit_network(kernel, scale * position, member, 8) for scale in (1.0, 3.28084))
    np.testing.assert_array_equal(metres.centre, feet.centre)
    np.testing.assert_allclose(3.28084 * metres.weight, feet.weight, rtol=1e-9)


def test_kernels_at_the_spread() -> None:
    distance_db = np.array([0.0, 12.0, 24.0])
    np.testing.assert_allclose(gaussian_kernel(distance_db, 12.0), np.exp([0.0, -1.0, -4.0]), rtol=1e-15)
    np.testing.assert_allclose(gaussian_kernel(distance_db, 12.0, "newrb"), [1.0, 0.5, 1 / 16], rtol=1e-15)


def test_senseless_parameters_are_refused() -> None:
    with pytest.raises(InputError, match=r"kernel='multiquadric'.*paper, newrb"):
        gaussian_kernel(np.ones(1), 1.0, "multiquadric")
    with pytest.raises(InputError, match="spread_db=0"):
        gaussian_kernel(np.ones(1), 0.0)
    with pytest.raises(InputError, match="neurons=0"):
        orthogonal_least_squares(np.ones((2, 2)), np.ones((2, 2)), np.ones((1, 2), dtype=bool), 0)
