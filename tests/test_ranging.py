"""From received strength to distance: every crossing, every combination, one fitted law."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from algorithms.ranging.curve_crossings import CurveCrossings
from algorithms.ranging.path_loss import PathLoss
from algorithms.ranging.template import Template
from positioning.errors import InputError
from positioning.ranging import combinations, crossings

NAN = np.nan


@st.composite
def curves(draw):
    levels = draw(st.lists(st.integers(-60, -50), min_size=2, max_size=12))
    steps = draw(st.lists(st.integers(1, 8), min_size=len(levels), max_size=len(levels)))
    return np.cumsum(steps) / 4, np.array(levels, dtype=float)


def test_crossings_of_a_sine_are_where_its_arcs_are():
    distance = np.linspace(0.0, 2.0, 20001)
    level = np.sin(2 * np.pi * distance)
    found = crossings(distance, level, [0.5, -0.5, np.sin(0.3), 1.5])
    expected = [
        [1 / 12, 5 / 12, 13 / 12, 17 / 12],
        [7 / 12, 11 / 12, 19 / 12, 23 / 12],
        np.array([0.3, np.pi - 0.3, 0.3 + 2 * np.pi, 3 * np.pi - 0.3]) / (2 * np.pi),
        [NAN] * 4,
    ]
    np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize(
    ("levels", "level", "expected"),
    [
        ([-50, -60, -70, -80], -65.0, [2.5]),
        ([-50, -60, -70, -80], -60.0, [2.0]),  # a knot that is passed
        ([-50, -60, -50, -70], -60.0, [2.0, 3.5]),  # a knot that is touched
        ([-50, -60, -60, -70], -60.0, [2.5]),  # a flat piece
        ([-60, -60, -60, -70], -60.0, [2.0]),  # two flat pieces are one
        ([-60, -60, -60, -60], -60.0, [2.5]),  # nothing but flat
        ([-50, -60, -60, -50], -55.0, [1.5, 3.5]),  # a flat piece elsewhere
        ([-50, -60, -50, -60], -50.0, [1.0, 3.0]),
        ([-50, -60, -50, -60], -60.0, [2.0, 4.0]),
        ([-50, -60, -70, -80], -50.0, [1.0]),  # the ends belong to the curve
        ([-50, -60, -70, -80], -80.0, [4.0]),
        ([-50, -60, -70, -80], -49.9, [NAN]),
        ([-50, -60, -70, -80], -80.1, [NAN]),
        ([-50, -60, -70, -80], NAN, [NAN]),
    ],
)
def test_knots_flat_pieces_and_levels_off_the_curve(levels, level, expected):
    np.testing.assert_allclose(crossings([1.0, 2.0, 3.0, 4.0], levels, level), expected, rtol=1e-15)


@given(curves(), st.lists(st.integers(-250, -196), min_size=1, max_size=6))
def test_every_crossing_maps_back_to_its_level_and_none_is_missed(curve, quarters):
    distance, level = curve
    rss = np.array(quarters) / 4
    found = crossings(distance, level, rss)
    assert found.shape[0] == len(rss)
    assert found.shape[1] >= 1
    for wanted, candidates in zip(rss, found, strict=True):
        real = candidates[~np.isnan(candidates)]
        assert np.isnan(candidates[len(real) :]).all()
        assert (np.diff(real) > 0).all()
        np.testing.assert_allclose(np.interp(real, distance, level), wanted, atol=1e-9)
        side = np.sign(level - wanted)
        # A run of knots at the level is one distance; besides, each change of sign is one.
        at_level = sum(1 for is_zero, _ in itertools.groupby(side == 0) if is_zero)
        assert len(real) == at_level + np.count_nonzero(side[:-1] * side[1:] < 0)


@given(curves(), st.integers(-250, -196))
def test_a_curve_run_backwards_has_the_mirrored_crossings(curve, quarter):
    distance, level = curve
    forward = crossings(distance, level, quarter / 4)
    backward = crossings(-distance[::-1], level[::-1], quarter / 4)
    np.testing.assert_allclose(np.sort(-backward), forward, atol=1e-12)


def test_leading_axes_are_kept_and_each_level_stands_alone():
    distance, level = np.arange(1.0, 9.0), np.array([-50.0, -58, -54, -62, -57, -66, -63, -70])
    rss = np.round(np.random.default_rng(0).uniform(-72, -48, (4, 5, 3)), 1)
    together = crossings(distance, level, rss)
    assert together.shape[:3] == (4, 5, 3)
    for index in np.ndindex(rss.shape):
        alone = crossings(distance, level, rss[index])
        np.testing.assert_array_equal(together[index][: len(alone)], alone)
        assert np.isnan(together[index][len(alone) :]).all()
    assert crossings(distance, level, np.empty((0, 3))).shape == (0, 3, 1)


@pytest.mark.parametrize(
    ("distance", "level"),
    [
        ([1.0], [-50.0]),
        ([1.0, 2.0], [-50.0]),
        ([[1.0, 2.0]], [[-50.0, -60.0]]),
        ([2.0, 1.0], [-50.0, -60.0]),
        ([1.0, 1.0], [-50.0, -60.0]),
        ([1.0, NAN], [-50.0, -60.0]),
        ([1.0, 2.0], [-50.0, NAN]),
        ([1.0, 2.0], [-50.0, np.inf]),
    ],
)
def test_a_curve_that_is_none_is_refused(distance, level):
    with pytest.raises(InputError, match="curve_distance_m, curve_dbm"):
        crossings(distance, level, -55.0)


def test_an_infinite_level_is_refused():
    with pytest.raises(InputError, match="rss_dbm"):
        crossings([1.0, 2.0], [-50.0, -60.0], [-55.0, -np.inf])


def product(candidates):
    """All combinations of one sample, by the standard library."""
    lists = [[value for value in row if not np.isnan(value)] for row in candidates]
    if sum(map(bool, lists)) < 3:
        return []
    return list(itertools.product(*[values or [NAN] for values in lists]))


@given(st.integers(0, 5), st.integers(1, 5), st.integers(0, 3), st.randoms(use_true_random=False))
def test_combinations_are_those_of_the_standard_library(samples, beacons, candidates, random):
    range_m = np.array(
        [random.choice([NAN, 1.0, 2.5, 4.0]) for _ in range(samples * beacons * candidates)]
    ).reshape(samples, beacons, candidates)
    chosen, sample = combinations(range_m)
    expected = [(number, row) for number in range(samples) for row in product(range_m[number])]
    assert chosen.shape == (len(expected), beacons)
    np.testing.assert_array_equal(sample, [number for number, _ in expected])
    np.testing.assert_array_equal(chosen, np.array([row for _, row in expected]).reshape(-1, beacons))


def test_a_beacon_without_candidates_stays_out_and_two_beacons_are_too_few():
    range_m = [
        [[1.0, 2.0], [3.0, NAN], [NAN, NAN], [NAN, 5.0]],
        [[1.0, 2.0], [3.0, 4.0], [NAN, NAN], [NAN, NAN]],
    ]
    chosen, sample = combinations(range_m)
    np.testing.assert_array_equal(chosen, [[1.0, 3.0, NAN, 5.0], [2.0, 3.0, NAN, 5.0]])
    np.testing.assert_array_equal(sample, [0, 0])


def test_too_many_combinations_are_an_error_that_names_the_cure():
    crowded = np.ones((2, 3, 22))
    assert len(combinations(crowded[:, :, :21])[0]) == 2 * 21**3
    with pytest.raises(InputError, match=r"10648 combinations.*10000.*path_loss"):
        combinations(crowded)
    assert len(combinations(crowded, limit=22**3)[0]) == 2 * 22**3
    # So many that a whole number of 64 bits overflows.
    with pytest.raises(InputError, match=r"at least 10\^21 combinations"):
        combinations(np.ones((1, 70, 2)))


@pytest.mark.parametrize("range_m", [np.ones((3, 2)), np.full((1, 3, 1), np.inf)])
def test_combinations_refuse_what_is_no_stack_of_distances(range_m):
    with pytest.raises(InputError, match="range_m"):
        combinations(range_m)


def test_curve_crossings_averages_sorts_and_ignores_what_was_not_heard():
    ranging = CurveCrossings().fit([3.0, 1.0, 2.0, 1.0, NAN, 4.0], [-70.0, -50.0, -60.0, -54.0, -40.0, NAN])
    np.testing.assert_array_equal(ranging.distance_m_, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(ranging.curve_dbm_, [-52.0, -60.0, -70.0])
    found = ranging.distances([[-65.0, -56.0, NAN], [-52.0, -71.0, -51.0]])
    np.testing.assert_allclose(found[..., 0], [[2.5, 1.5, NAN], [1.0, NAN, NAN]])
    assert found.shape == (2, 3, 1)


def test_curve_crossings_keeps_every_candidate():
    ranging = CurveCrossings().fit([1.0, 2.0, 3.0, 4.0], [-50.0, -60.0, -56.0, -70.0])
    np.testing.assert_allclose(
        ranging.distances([-58.0, -65.0]), [[1.8, 2.5, 3 + 1 / 7], [3 + 9 / 14, NAN, NAN]]
    )


@given(
    st.floats(-70, -30),
    st.floats(0.5, 5.0),
    st.lists(st.floats(0.2, 20.0), min_size=3, max_size=20, unique=True),
)
def test_path_loss_finds_the_law_and_turns_it_round(reference_dbm, exponent, distances):
    distance = np.array(distances)
    if np.ptp(np.log10(distance)) < 0.05:
        distance = np.append(distance, 20 * distance.max())
    rss = reference_dbm - 10 * exponent * np.log10(distance)
    ranging = PathLoss(farthest_m=None).fit(distance, rss)
    np.testing.assert_allclose(ranging.reference_dbm_, reference_dbm, atol=1e-8)
    np.testing.assert_allclose(ranging.path_loss_exponent_, exponent, rtol=1e-8)
    np.testing.assert_allclose(ranging.distances(rss), distance[:, None], rtol=1e-7)


def test_path_loss_is_the_least_squares_of_numpy():
    rng = np.random.default_rng(1)
    distance = rng.uniform(0.3, 8.0, 40)
    rss = -50 - 22 * np.log10(distance) + rng.normal(0, 4, 40)
    slope, level = np.polyfit(np.log10(distance), rss, 1)
    ranging = PathLoss().fit(np.append(distance, [2.0, NAN]), np.append(rss, [NAN, -10.0]))
    np.testing.assert_allclose([ranging.reference_dbm_, ranging.path_loss_exponent_], [level, -slope / 10])


def test_path_loss_stays_within_its_limits():
    ranging = PathLoss(nearest_m=0.5, farthest_m=12.0).fit([1.0, 10.0], [-50.0, -70.0])
    found = ranging.distances([[-20.0, -50.0, -60.0], [-70.0, -1e9, NAN]])
    assert found.shape == (2, 3, 1)
    np.testing.assert_allclose(found[..., 0], [[0.5, 1.0, 10**0.5], [10.0, 12.0, NAN]])


@pytest.mark.parametrize("rss_dbm", [[-70.0, -60.0, -50.0], [-60.2, -60.2, -60.2]])
def test_path_loss_refuses_strengths_that_do_not_fall(rss_dbm):
    with pytest.raises(InputError, match="does not fall"):
        PathLoss().fit([1.0, 2.0, 3.1], rss_dbm)


@pytest.mark.parametrize("limits", [(0.0, 30.0), (-1.0, None), (5.0, 5.0), (NAN, 30.0)])
def test_path_loss_refuses_senseless_limits(limits):
    with pytest.raises(InputError, match="nearest_m and farthest_m"):
        PathLoss(nearest_m=limits[0], farthest_m=limits[1]).fit([1.0, 2.0], [-50.0, -56.0])


@pytest.mark.parametrize("ranging", [CurveCrossings, PathLoss, Template])
@pytest.mark.parametrize(
    ("distance_m", "rss_dbm"),
    [
        ([1.0, 2.0], [-50.0]),
        ([[1.0, 2.0]], [[-50.0, -60.0]]),
        ([], []),
        ([2.0, 2.0, NAN], [-50.0, -60.0, -70.0]),
        ([1.0, 2.0], [-50.0, NAN]),
        ([0.0, 2.0], [-50.0, -60.0]),
        ([-1.0, 2.0], [-50.0, -60.0]),
        ([1.0, np.inf], [-50.0, -60.0]),
        ([1.0, 2.0], [-50.0, -np.inf]),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(ranging, distance_m, rss_dbm):
    with pytest.raises(InputError, match="calibration"):
        ranging().fit(distance_m, rss_dbm)


@pytest.mark.parametrize("ranging", [CurveCrossings, PathLoss])
def test_an_infinite_strength_is_refused(ranging):
    with pytest.raises(InputError, match="rss_dbm"):
        ranging().fit([1.0, 2.0], [-50.0, -60.0]).distances([np.inf])


@pytest.mark.parametrize("ranging", [CurveCrossings(), PathLoss(), Template()])
@hypothesis_settings(max_examples=30)
@given(rss=st.lists(st.one_of(st.just(NAN), st.floats(-100, -20)), min_size=3, max_size=12))
def test_the_contract_of_ranging(ranging, rss):
    assert ranging.fit([0.5, 1.0, 2.0, 4.0, 6.0], [-45.0, -52.0, -50.0, -62.0, -64.0]) is ranging
    levels = np.array(rss)
    found = ranging.distances(levels)
    assert found.shape[:-1] == levels.shape
    assert found.shape[-1] >= 1
    assert np.isnan(found[np.isnan(levels)]).all()
    assert (found[~np.isnan(found)] > 0).all()
    np.testing.assert_array_equal(found, np.sort(found, axis=-1))
    np.testing.assert_array_equal(ranging.distances(levels.reshape(1, -1, 1))[0, :, 0], found)


def test_the_template_knows_the_nearest_reading():
    ranging = Template(tolerance_db=3.0).fit([1.0, 2.0], [-50.0, -60.0])
    np.testing.assert_array_equal(ranging.distances([-52.0, -57.5, -63.1, NAN]), [[1.0], [2.0], [NAN], [NAN]])
