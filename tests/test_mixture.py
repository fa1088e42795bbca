"""Weights, clusters, ramps and samples of the mixture filters against direct sums and closed forms."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from positioning.errors import InputError
from positioning.filters import mixture
from positioning.filters.mixture import (
    Drive,
    Mixture,
    SystemNoise,
    draw,
    exponential_weights,
    filter_drive,
    median_cut,
    motion_weights,
    predict,
    representative_distance,
    start_at_rest,
)
from positioning.filters.resampling import linear_time
from positioning.model import Array, Track

NO_NOISE, SOME_NOISE = SystemNoise(0.0, 0.0), SystemNoise(0.02, 0.1)


def rngs(count: int) -> list[np.random.Generator]:
    """Return fresh generators."""
    return [np.random.default_rng([4, number]) for number in range(count)]


def drive(
    fix_m: Array,
    *,
    forward_m: float = 0.5,
    turn_rad: float = 0.0,
    rest: int = 2,
    sigma_m: float = 1.0,
    heading_rad: float = 0.0,
) -> Drive:
    """Return a drive straight on, or in a circle, with these fixes [r, n, 2] and a rest at first."""
    runs, epochs = fix_m.shape[:2]
    time_s = np.tile(np.arange(float(epochs)), (runs, 1))
    moving = np.tile(np.arange(epochs) >= rest, (runs, 1))
    start = start_at_rest(
        time_s,
        moving,
        fix_m,
        np.tile([[0.0, 0.0], [10.0, 20.0]], (runs, 1, 1)),
        heading_rad=np.full(runs, heading_rad),
        sigma_m=sigma_m,
        heading_sigma_rad=0.1,
    )
    return Drive(
        time_s, turn_rad * moving, forward_m * moving, np.zeros((runs, epochs)), np.asarray(fix_m), start
    )


def run(
    given_drive: Drive,
    generators: Sequence[np.random.Generator] | None = None,
    *,
    particles: int = 300,
    scale_m: float = 1.0,
    noise: SystemNoise = SOME_NOISE,
    **parts: object,
) -> Track:
    """Run a filter."""
    return filter_drive(
        given_drive,
        generators or rngs(len(given_drive.time_s)),
        particles=particles,
        scale_m=scale_m,
        noise=noise,
        mixture=Mixture(**parts),  # type: ignore[arg-type]
    )


def fixes(runs: int = 3, epochs: int = 12, seed: int = 0) -> Array:
    """Return noisy fixes of a drive along x, of which a few are missing."""
    rng = np.random.default_rng(seed)
    x_m = 0.5 * np.maximum(np.arange(epochs) - 1, 0)
    fix_m = np.stack([np.tile(x_m, (runs, 1)), np.zeros((runs, epochs))], axis=-1)
    fix_m += rng.standard_normal(fix_m.shape)
    fix_m[0, 5] = fix_m[-1, 7] = np.nan
    return fix_m


# Weights


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 5.0))
def test_weights_equal_the_literal_formula_where_it_is_finite(seed: int, scale_m: float) -> None:
    rng = np.random.default_rng(seed)
    distance_m, factor = rng.uniform(0, 40, (3, 20)), rng.uniform(0.1, 2, (3, 20))
    literal = factor * np.exp(-distance_m / scale_m)
    expected = literal / literal.sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(exponential_weights(distance_m, factor, scale_m), expected, rtol=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=30))
def test_weights_are_numbers_at_any_squared_distance(squared_m2: list[float]) -> None:
    weight = exponential_weights(np.sqrt(squared_m2))
    assert np.isfinite(weight).all()
    assert weight.sum() == pytest.approx(1.0)
    # The literal formula is 0 / 0 where all are far.
    far = exponential_weights(np.array([1000.0, 1001.0]))
    np.testing.assert_allclose(far, np.array([1.0, np.exp(-1.0)]) / (1 + np.exp(-1.0)), rtol=1e-12)


def test_weights_fall_with_the_distance_not_with_its_square() -> None:
    weight = exponential_weights(np.array([0.0, 1.0, 2.0, 3.0]))
    np.testing.assert_allclose(np.diff(np.log(weight)), -1.0, rtol=1e-12)


def test_factors_share_out_the_weight() -> None:
    weight = exponential_weights(np.zeros(4), np.array([0.8, 0.8, 0.2, 0.2]))
    np.testing.assert_allclose(weight, [0.4, 0.4, 0.1, 0.1], rtol=1e-14)
    np.testing.assert_array_equal(exponential_weights(np.zeros(2), np.array([0.0, 3.0])), [0.0, 1.0])
    # Nothing has a weight: nothing is known.
    np.testing.assert_array_equal(exponential_weights(np.zeros(2), np.zeros(2)), [0.5, 0.5])


# Resampling


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_as_many_as_there_are_is_linear_time(seed: int, samples: int) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.full(samples, 0.2), 3)
    uniform = rng.random((3, samples + 1))
    np.testing.assert_array_equal(draw(weight, uniform), linear_time(weight, uniform))


@pytest.mark.parametrize("kept", [1, 7, 60])
def test_expected_copies_are_proportional_to_the_weight(kept: int) -> None:
    weight = np.tile([0.5, 0.0, 0.2, 0.3, 0.0], (4000, 1))
    index = draw(weight, np.random.default_rng(1).random((4000, kept + 1)))
    assert index.shape == (4000, kept)
    assert (np.diff(index, axis=-1) >= 0).all()
    share = np.bincount(index.ravel(), minlength=5) / index.size
    np.testing.assert_allclose(share, weight[0], atol=5 * 0.5 / np.sqrt(index.size))
    assert share[1] == share[4] == 0


def test_draws_at_the_ends_take_a_sample_with_weight() -> None:
    weight = np.array([[0.0, 0.4, 0.6, 0.0]])
    for uniform in (np.zeros((1, 4)), np.full((1, 4), 1 - 1e-16), np.array([[0.0, 0.0, 0.0, 1 - 1e-16]])):
        assert np.isin(draw(weight, uniform), (1, 2)).all()
    # What the last position is divided by may round to nothing more than itself.
    assert (draw(weight, np.array([[0.9, 0.9, 0.9, 0.0]])) == [1, 2, 2]).all()


# Clusters


def boxes(position_m: Array, clusters: int) -> list[Array]:
    """Return the samples [2, size] of each cluster."""
    found = median_cut(position_m, clusters)
    parts = np.split(found.order, found.first[1:])
    np.testing.assert_array_equal(found.sizes(), [len(part) for part in parts])
    return [position_m[:, part] for part in parts]


def disjoint(parts: list[Array]) -> bool:
    """Tell whether between any two sets of samples there is a line along one of the axes."""
    low, high = (np.array([limit(part, axis=1) for part in parts]) for limit in (np.min, np.max))
    apart = (high[:, None] < low[None]) | (high[None] < low[:, None])
    return bool((apart.any(axis=-1) | np.eye(len(parts), dtype=bool)).all())


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 90), st.data())
def test_clusters_have_equal_numbers_and_lie_in_disjoint_boxes(
    seed: int, samples: int, data: st.DataObject
) -> None:
    clusters = data.draw(st.integers(1, samples))
    position_m = np.random.default_rng(seed).normal(0, (3.0, 1.0), (samples, 2)).T
    found = median_cut(position_m, clusters)
    np.testing.assert_array_equal(np.sort(found.order), np.arange(samples))
    sizes = found.sizes()
    assert sizes.sum() == samples
    assert sizes.max() - sizes.min() <= 1
    low, high = (
        np.array([f(part, axis=1) for part in boxes(position_m, clusters)]) for f in (np.min, np.max)
    )
    apart = (high[:, None] < low[None]) | (high[None] < low[:, None])
    assert (apart.any(axis=-1) | np.eye(clusters, dtype=bool)).all()


def plain_median_cut(position_m: Array, members: Array, first: Array) -> list[frozenset[int]]:
    """Return the clusters that begin at ``first`` by sorting one box after the other."""
    if len(first) == 2:
        return [frozenset(members.tolist())]
    side_m = position_m[int(np.argmax(np.ptp(position_m[:, members], axis=1)))]
    middle = (len(first) - 1) // 2
    inside = members[np.argsort(side_m[members])]
    cut = first[middle] - first[0]
    low = plain_median_cut(position_m, inside[:cut], first[: middle + 1])
    return low + plain_median_cut(position_m, inside[cut:], first[middle:])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 300), st.data())
def test_clusters_of_a_stack_are_those_of_one_cut_after_the_other(
    seed: int, samples: int, data: st.DataObject
) -> None:
    clusters = data.draw(st.integers(1, samples))
    position_m = np.random.default_rng(seed).normal(0, ((2.0,), (1.0,)), (3, 2, samples))
    cut = median_cut(position_m, clusters)
    limits = np.arange(clusters + 1) * samples // clusters
    np.testing.assert_array_equal(cut.first, limits[:-1])
    for place, order in zip(position_m, cut.order, strict=True):
        parts = [frozenset(part.tolist()) for part in np.split(order, cut.first[1:])]
        assert parts == plain_median_cut(place, np.arange(samples), limits)


@pytest.mark.parametrize(("samples", "clusters"), [(1000, 200), (1000, 50), (999, 37), (1201, 600)])
def test_many_samples_lie_in_disjoint_boxes_too(samples: int, clusters: int) -> None:
    position_m = np.random.default_rng(samples).normal(0, (3.0, 1.0), (samples, 2)).T
    found = median_cut(position_m, clusters)
    np.testing.assert_array_equal(np.sort(found.order), np.arange(samples))
    low, high = (
        np.array([f(part, axis=1) for part in boxes(position_m, clusters)]) for f in (np.min, np.max)
    )
    apart = (high[:, None] < low[None]) | (high[None] < low[:, None])
    assert (apart.any(axis=-1) | np.eye(clusters, dtype=bool)).all()


def test_the_first_cut_goes_through_the_median_of_the_longer_side() -> None:
    position_m = np.random.default_rng(3).uniform((0, 0), (1, 5), (101, 2)).T
    below, above = boxes(position_m, 2)
    assert below[1].max() < above[1].min()
    assert below.shape[1] == 50
    assert above[1].min() == np.median(position_m[1])
    # The longer side is that of the box, wherever it lies.
    left, right = boxes(np.stack([position_m[1] + 1000, position_m[0]]), 2)
    np.testing.assert_array_equal(np.sort(left[0]), np.sort(below[1] + 1000))
    assert left[0].max() < right[0].min()


def test_a_grid_is_cut_into_its_blocks() -> None:
    x_m, y_m = np.meshgrid(np.arange(8.0), 0.9 * np.arange(8.0))
    place = np.stack([x_m.ravel(), y_m.ravel()])
    for block in boxes(place + 1e-6 * np.random.default_rng(0).random(place.shape), 16):
        # Blocks of two by two.
        assert np.ptp(block[0]) < 1.1
        assert np.ptp(block[1]) < 1.0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_clusters_do_not_depend_on_order_place_scale_or_axes(seed: int, clusters: int) -> None:
    rng = np.random.default_rng(seed)
    position_m, shuffle = rng.normal(0, 2, (2, 60)), rng.permutation(60)

    def groups(place: Array, names: Array) -> set[frozenset[int]]:
        found = median_cut(place, clusters)
        return {frozenset(names[part].tolist()) for part in np.split(found.order, found.first[1:])}

    names = np.arange(60)
    expected = groups(position_m, names)
    assert groups(position_m[:, shuffle], shuffle) == expected
    assert groups(4 * position_m[::-1] + 8, names) == expected


def test_stacked_sets_are_cut_like_each_alone() -> None:
    position_m = np.random.default_rng(2).normal(0, 2, (3, 4, 2, 57))
    together = median_cut(position_m, 13)
    for index in np.ndindex(3, 4):
        np.testing.assert_array_equal(median_cut(position_m[index], 13).order, together.order[index])


@pytest.mark.parametrize("clusters", [0, 11])
def test_another_number_of_clusters_is_refused(clusters: int) -> None:
    with pytest.raises(InputError, match="clusters"):
        median_cut(np.zeros((2, 10)), clusters)


def test_equal_places_can_be_cut() -> None:
    found = median_cut(np.zeros((2, 10)), 4)
    np.testing.assert_array_equal(found.order, np.arange(10))
    np.testing.assert_array_equal(np.sort(found.order), np.arange(10))
    np.testing.assert_array_equal(found.sizes(), [2, 3, 2, 3])


def test_one_cluster_a_sample_is_every_sample_bit_for_bit() -> None:
    rng = np.random.default_rng(5)
    position_m, fix_m = rng.normal(0, 3, (4, 2, 77)), rng.normal(0, 3, (4, 2))
    exact, evaluations = representative_distance(position_m, fix_m, None)
    clustered, of_clusters = representative_distance(position_m, fix_m, 77)
    np.testing.assert_array_equal(clustered, exact)
    np.testing.assert_allclose(exact, np.linalg.norm(position_m - fix_m[..., None], axis=1), rtol=1e-14)
    assert evaluations == of_clusters == 77


def test_members_have_the_distance_of_their_mean() -> None:
    rng = np.random.default_rng(6)
    position_m, fix_m = rng.normal(0, 3, (1, 2, 53)), np.array([[1.0, 2.0]])
    distance_m, evaluations = representative_distance(position_m, fix_m, 10)
    assert evaluations == 10
    found = median_cut(position_m[0], 10)
    for part in np.split(found.order, found.first[1:]):
        expected = np.linalg.norm(position_m[0][:, part].mean(axis=1) - fix_m[0])
        np.testing.assert_allclose(distance_m[0, part], expected, rtol=1e-12)


@pytest.mark.parametrize("clusters", [2, 4, 8, 16])
def test_clusters_of_a_symmetric_cloud_have_no_bias(clusters: int) -> None:
    half = np.random.default_rng(7).normal(0, (3.0, 1.0), (32, 2)).T
    place = np.concatenate([half, -half], axis=1)[None]
    distance_m, _ = representative_distance(place, np.zeros((1, 2)), clusters)
    weight = exponential_weights(distance_m)
    np.testing.assert_allclose((place[0] * weight).sum(axis=1), 0.0, atol=1e-12)
    # Not because all weights are alike: but for two clusters, they are not.
    assert clusters == 2 or np.ptp(weight) > 1e-3


def test_more_clusters_come_nearer_to_the_exact_weights() -> None:
    place = np.random.default_rng(8).normal(0, 2, (5, 2, 1000))
    fix_m = np.full((5, 2), 1.0)
    exact = exponential_weights(representative_distance(place, fix_m, None)[0])

    def mean_m(weight: Array) -> Array:
        return np.asarray((place * weight[:, None]).sum(axis=-1))

    off = [
        np.abs(mean_m(exponential_weights(representative_distance(place, fix_m, k)[0])) - mean_m(exact)).max()
        for k in (2, 20, 200)
    ]
    assert all(more > 3 * less for more, less in pairwise(off))
    assert off[-1] < 0.02


# Factors over time


def test_factors_ramp_after_the_start_and_after_each_stop() -> None:
    time_s = np.arange(0.0, 40.0)
    moving = (time_s > 2) & ~((time_s >= 20) & (time_s <= 24))
    prediction, wifi = motion_weights(
        time_s[None], moving[None], near=(0.8, 0.2), far=(0.3, 0.7), hold_s=3.0, ramp_s=5.0
    )
    # Seconds since the last epoch without motion, which are 2 and then 24.
    since_s = np.where(time_s < 20, time_s - 2, time_s - 24)
    share = np.clip((since_s - 3) / 5, 0, 1)
    np.testing.assert_allclose(prediction[0], 0.8 - 0.5 * share, atol=1e-14)
    np.testing.assert_allclose(wifi[0], 0.2 + 0.5 * share, atol=1e-14)
    assert prediction[0, 5] > wifi[0, 5]
    assert prediction[0, 19] < wifi[0, 19]
    assert prediction[0, 20] == 0.8
    assert prediction[0, 39] == pytest.approx(0.3)


def test_without_a_rest_the_ramp_begins_at_the_first_epoch() -> None:
    time_s = np.array([[10.0, 12.0, 14.0, np.nan]])
    moving = np.array([[True, True, True, False]])
    prediction, _ = motion_weights(time_s, moving, near=(1.0, 0.0), far=(0.0, 1.0), hold_s=1.0, ramp_s=4.0)
    np.testing.assert_allclose(prediction, [[1.0, 0.75, 0.25, np.nan]])
    assert moving[0, 0]


@pytest.mark.parametrize(
    ("name", "value"),
    [("near", (0.1, -0.2)), ("far", (0.1,)), ("hold_s", -1.0), ("ramp_s", 0.0), ("near", (0.5, np.nan))],
)
def test_senseless_factors_are_refused(name: str, value: object) -> None:
    good = {"near": (0.8, 0.2), "far": (0.3, 0.7), "hold_s": 1.0, "ramp_s": 5.0}
    with pytest.raises(InputError, match=name):
        motion_weights(np.zeros((1, 2)), np.zeros((1, 2), bool), **(good | {name: value}))  # type: ignore[arg-type]


# Start and prediction


def test_the_start_is_the_mean_of_the_fixes_so_far() -> None:
    fix_m = np.array([[[np.nan, np.nan], [2.0, 4.0], [np.nan, np.nan], [4.0, 8.0], [90.0, 90.0]]])
    start = start_at_rest(
        np.arange(5.0)[None],
        np.array([[True, False, False, False, True]]),
        fix_m,
        np.array([[[0.0, 0.0], [10.0, 20.0]]]),
        heading_rad=np.zeros(1),
        sigma_m=2.0,
        heading_sigma_rad=0.1,
    )
    # What the first epoch says of a motion before it does not count.
    np.testing.assert_array_equal(start.resting, [[True, True, True, True, False]])
    np.testing.assert_array_equal(start.position_m[0, :4], [[5, 10], [2, 4], [2, 4], [3, 6]])
    np.testing.assert_array_equal(start.sigma_m[0, :4], [[5, 10], [2, 2], [2, 2], [2, 2]])


def test_samples_start_about_it_with_the_noted_heading() -> None:
    fix_m = np.full((2, 2, 2), np.nan)
    fix_m[:, 0] = 3.0
    straight = drive(fix_m, rest=1, forward_m=2.0, sigma_m=0.5, heading_rad=np.pi / 3)
    found = run(straight, particles=60_000, noise=NO_NOISE)
    np.testing.assert_allclose(found.position_m[:, 0], 3.0, atol=0.01)
    np.testing.assert_allclose(found.covariance_m2[:, 0], np.tile(0.25 * np.eye(2), (2, 1, 1)), atol=0.01)
    # A mean of cos(heading) is shorter by exp(-sigma^2 / 2).
    ahead_m = 2.0 * np.exp(-(0.1**2) / 2) * np.array([np.cos(np.pi / 3), np.sin(np.pi / 3)])
    np.testing.assert_allclose(found.position_m[:, 1] - 3.0, [ahead_m, ahead_m], atol=0.01)


def test_a_heading_that_nobody_noted_may_be_any() -> None:
    fix_m = np.full((1, 2, 2), np.nan)
    fix_m[:, 0] = 3.0
    found = run(drive(fix_m, rest=1, forward_m=2.0, heading_rad=np.nan, sigma_m=1e-3), particles=60_000)
    np.testing.assert_allclose(found.position_m[0, 1], 3.0, atol=0.03)
    # Places on a circle about the start, a tenth of whose radius is noise.
    np.testing.assert_allclose(found.covariance_m2[0, 1], 2.0 * 1.01 * np.eye(2), atol=0.05)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_prediction_without_noise_is_a_rigid_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sample = rng.normal(0, 3, (4, 3, 9))
    before, (turn_rad, forward_m, left_m) = sample.copy(), rng.normal(0, 1, (3, 4))
    predict(sample, turn_rad, forward_m, left_m, np.ones(4), 0.3, np.zeros((4, 2, 9)))
    for row in range(4):
        for number in range(9):
            heading = before[row, 2, number]
            turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
            expected = before[row, :2, number] + turn @ [forward_m[row], left_m[row]]
            np.testing.assert_allclose(sample[row, :2, number], expected, atol=1e-12)
            assert sample[row, 2, number] == pytest.approx(heading + turn_rad[row])


def test_noise_of_the_prediction_has_its_deviations() -> None:
    sample = np.zeros((1, 3, 200_000))
    draws = np.random.default_rng(0).standard_normal((1, 2, 200_000))
    predict(sample, np.array([0.2]), np.array([3.0]), np.array([0.0]), np.array([0.1]), 0.2, draws)
    x_m, y_m, heading_rad = sample[0]
    assert heading_rad.mean() == pytest.approx(0.2, abs=0.002)
    assert heading_rad.std() == pytest.approx(0.1, rel=0.02)
    assert x_m.std() == pytest.approx(0.6, rel=0.02)
    # Half of the error of the turn leads astray.
    assert y_m.std() == pytest.approx(3.0 * 0.05 * np.sqrt(1.04), rel=0.02)
    assert np.corrcoef(heading_rad, y_m)[0, 1] > 0.9


def test_noise_of_the_turn_grows_with_the_root_of_time() -> None:
    straight = drive(np.full((1, 2, 2), np.nan), rest=1, forward_m=2.0)
    still = straight.start._replace(sigma_m=np.zeros((1, 2, 2)), heading_sigma_rad=0.0)
    for elapsed_s in (1.0, 9.0):
        given_drive = straight._replace(time_s=elapsed_s * straight.time_s, start=still)
        found = run(given_drive, particles=40_000, noise=SystemNoise(0.05, 0.0))
        deviation_m = np.sqrt(found.covariance_m2[0, 1, 1, 1])
        assert deviation_m == pytest.approx(2.0 * 0.5 * 0.05 * np.sqrt(elapsed_s), rel=0.03)


# The filter


def test_the_first_update_is_the_integral_over_the_prior() -> None:
    # Start N(0, 1) in both coordinates, no motion, one fix: posterior ~ prior * exp(-distance / scale).
    fix_m = np.array([[[0.0, 0.0], [1.5, 0.5]]])
    still = drive(fix_m, rest=1, forward_m=0.0)
    grid = np.linspace(-6, 6, 601)
    x_m, y_m = np.meshgrid(grid, grid, indexing="ij")
    density = norm.pdf(x_m) * norm.pdf(y_m) * np.exp(-np.hypot(x_m - 1.5, y_m - 0.5) / 0.7)
    density /= density.sum()
    mean_m = np.array([(density * x_m).sum(), (density * y_m).sum()])
    variance_m2 = (density * (x_m - mean_m[0]) ** 2).sum()
    for parts in ({}, {"clusters": 12_000}):
        found = run(still, particles=60_000, scale_m=0.7, noise=NO_NOISE, **parts)
        np.testing.assert_allclose(found.position_m[0, 1], mean_m, atol=0.015)
        assert found.covariance_m2[0, 1, 0, 0] == pytest.approx(variance_m2, abs=0.015)


def test_the_first_mixture_is_the_sum_of_both_integrals() -> None:
    fix_m = np.array([[[0.0, 0.0], [4.0, 0.0]]])
    still, wide = drive(fix_m, rest=1, forward_m=0.0), 1.5
    grid = np.linspace(-9, 13, 1101)
    x_m, y_m = np.meshgrid(grid, grid, indexing="ij")
    predicted = 0.6 * norm.pdf(x_m) * norm.pdf(y_m) * np.exp(-np.hypot(x_m - 4.0, y_m))
    from_wifi = norm.pdf(x_m, 4.0, wide) * norm.pdf(y_m, 0.0, wide) * np.exp(-np.hypot(x_m, y_m))
    density = predicted + 0.5 * 0.4 * from_wifi
    density /= density.sum()
    found = run(
        still,
        particles=60_000,
        noise=NO_NOISE,
        from_wifi=0.5,
        fix_sigma_m=wide,
        weight_prediction=0.6,
        weight_wifi=0.4,
    )
    np.testing.assert_allclose(found.position_m[0, 1], [(density * x_m).sum(), 0.0], atol=0.03)
    assert found.extra["weight_evaluations"][0].tolist() == [0, 90_000]


def test_weights_without_any_spread_leave_every_sample() -> None:
    fix_m = np.full((1, 3, 2), 5.0)
    found = run(drive(fix_m, sigma_m=0.0, forward_m=0.0, rest=1), noise=NO_NOISE)
    np.testing.assert_allclose(found.position_m[0], 5.0)
    np.testing.assert_allclose(found.extra["effective_sample_size"], 300)
    np.testing.assert_allclose(found.covariance_m2[0, 2], 1e-6 * np.eye(2), atol=1e-15)


def test_the_effective_sample_size_is_taken_before_resampling() -> None:
    fix_m = np.array([[[0.0, 0.0], [3.0, 0.0]]])
    still = drive(fix_m, rest=1, forward_m=0.0)
    found = run(still, particles=50, noise=NO_NOISE)
    place = rngs(1)[0].standard_normal((3, 50))[:2]
    literal = np.exp(-np.hypot(place[0] - 3, place[1]))
    expected = literal.sum() ** 2 / (literal**2).sum()
    np.testing.assert_allclose(found.extra["effective_sample_size"][0], [50, expected], rtol=1e-12)
    np.testing.assert_allclose(found.position_m[0, 1], place @ (literal / literal.sum()), rtol=1e-12)


def test_without_samples_from_the_fix_all_is_the_plain_filter() -> None:
    plain = run(drive(fixes()))
    mixed = run(drive(fixes()), from_wifi=0.0, fix_sigma_m=9.0, weight_wifi=3.0)
    np.testing.assert_array_equal(mixed.position_m, plain.position_m)
    np.testing.assert_array_equal(mixed.covariance_m2, plain.covariance_m2)
    other = run(drive(fixes()), from_wifi=0.1)
    assert np.abs(other.position_m - plain.position_m).max() > 1e-3


def test_as_many_clusters_as_samples_are_the_exact_mixture() -> None:
    exact = run(drive(fixes()), from_wifi=0.2)
    clustered = run(drive(fixes()), from_wifi=0.2, clusters=300)
    np.testing.assert_array_equal(clustered.position_m, exact.position_m)
    np.testing.assert_array_equal(clustered.covariance_m2, exact.covariance_m2)
    fewer = run(drive(fixes()), from_wifi=0.2, clusters=60)
    assert np.abs(fewer.position_m - exact.position_m).max() > 1e-3
    told = np.isfinite(fixes()).all(axis=-1) & (np.arange(12) >= 2)
    np.testing.assert_array_equal(fewer.extra["weight_evaluations"], np.where(told, 120, 0))
    np.testing.assert_array_equal(exact.extra["weight_evaluations"], np.where(told, 360, 0))


@pytest.mark.parametrize("parts", [{}, {"from_wifi": 0.2}, {"from_wifi": 0.3, "clusters": 37}])
@pytest.mark.parametrize("block", [1, 1 << 14])
def test_a_stack_gives_exactly_what_each_gives(
    parts: dict[str, object], block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fix_m = fixes(5)
    together = run(drive(fix_m), **parts)
    monkeypatch.setattr(mixture, "_BLOCK", block)
    np.testing.assert_array_equal(run(drive(fix_m), **parts).position_m, together.position_m)
    for row in range(5):
        alone = run(drive(fix_m[row : row + 1]), rngs(5)[row : row + 1], **parts)
        np.testing.assert_array_equal(alone.position_m[0], together.position_m[row])
        np.testing.assert_array_equal(alone.covariance_m2[0], together.covariance_m2[row])
        for name, values in alone.extra.items():
            np.testing.assert_array_equal(values[0], together.extra[name][row])


@pytest.mark.parametrize("parts", [{}, {"from_wifi": 0.2}, {"from_wifi": 0.2, "clusters": 60}])
def test_a_track_moves_with_the_map(parts: dict[str, object]) -> None:
    near = run(drive(fixes()), **parts)
    far = run(drive(fixes() + 1024.0), **parts)
    np.testing.assert_allclose(far.position_m - 1024.0, near.position_m, atol=1e-6)


def test_samples_from_the_fix_bring_a_lost_filter_back() -> None:
    fix_m = np.tile([20.0, 0.0], (4, 30, 1))
    fix_m[:, :2] = 0.0
    plain, mixed = (
        run(drive(fix_m, forward_m=0.01), from_wifi=share, scale_m=5.0, fix_sigma_m=2.0)
        for share in (0.0, 0.3)
    )
    assert np.linalg.norm(plain.position_m[:, -1] - [20, 0], axis=-1).min() > 10
    assert np.linalg.norm(mixed.position_m[:, -1] - [20, 0], axis=-1).max() < 3


def test_samples_from_the_fix_have_the_headings_of_all_predicted_ones() -> None:
    fix_m = np.full((1, 3, 2), np.nan)
    fix_m[:, :2] = 5.0
    lost = drive(fix_m, rest=1, forward_m=2.0, heading_rad=np.nan)
    found = run(
        lost,
        particles=20_000,
        noise=NO_NOISE,
        from_wifi=0.5,
        fix_sigma_m=0.01,
        weight_prediction=0.0,
        scale_m=1e6,
    )
    # All are from the fix after the first metres; then they go everywhere.
    np.testing.assert_allclose(found.covariance_m2[0, 1], 1e-4 * np.eye(2), atol=1e-5)
    np.testing.assert_allclose(found.position_m[0, 2], 5.0, atol=0.1)
    np.testing.assert_allclose(found.covariance_m2[0, 2], 2.0 * np.eye(2), atol=0.1)


def test_fixes_at_rest_are_taken_once() -> None:
    fix_m = fixes()
    found = run(drive(fix_m, rest=6))
    assert (found.extra["weight_evaluations"][:, :6] == 0).all()
    mean_m = np.nanmean(fix_m[:, :5], axis=1)
    np.testing.assert_allclose(found.position_m[:, 4], mean_m, atol=0.25)


@pytest.mark.parametrize("parts", [{}, {"from_wifi": 0.2, "clusters": 1}])
@pytest.mark.parametrize("particles", [1, 2, 50])
def test_no_fix_one_sample_one_epoch(parts: dict[str, object], particles: int) -> None:
    none = run(drive(np.full((2, 4, 2), np.nan)), particles=particles, **parts)
    assert np.isfinite(none.position_m).all()
    assert (none.extra["weight_evaluations"] == 0).all()
    one = run(drive(np.zeros((2, 1, 2)), rest=1), particles=particles, **parts)
    assert one.position_m.shape == (2, 1, 2)
    assert np.isfinite(run(drive(fixes() + 1e6), particles=particles, **parts).position_m).all()


@pytest.mark.parametrize(
    ("name", "settings_"),
    [
        ("particles", {"particles": 0}),
        ("scale_m", {"scale_m": 0.0}),
        ("turn_noise", {"noise": SystemNoise(-1.0, 0.0)}),
        ("distance_noise", {"noise": SystemNoise(0.0, np.nan)}),
        ("from_wifi", {"from_wifi": -0.1}),
        ("fix_sigma_m", {"fix_sigma_m": -1.0}),
        ("weight_wifi", {"weight_wifi": -1.0}),
        ("weight_prediction", {"weight_prediction": np.nan}),
        ("clusters", {"clusters": 0}),
        ("clusters", {"clusters": 301}),
        ("rngs", {"generators": rngs(1)}),
    ],
)
def test_senseless_settings_are_refused(name: str, settings_: dict[str, object]) -> None:
    with pytest.raises(InputError, match=name):
        run(drive(fixes()), **settings_)  # type: ignore[arg-type]
