"""Algorithms that align walks: what they find, what they leave alone, and what they refuse."""

import inspect
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from algorithms.alignment.aligned_graph_slam import AlignedGraphSlam
from algorithms.alignment.control_true_neighbours import ControlTrueNeighbours
from algorithms.alignment.graph_slam import GraphSlam
from algorithms.alignment.gtsam_graph_slam import GtsamGraphSlam, gtsam_minimum
from algorithms.alignment.ransac_alignment import RansacAlignment
from positioning.errors import InputError
from positioning.geometry import rigid_fit, rotated
from positioning.model import Truth, Walks
from positioning.posegraph.costs import NearCost
from positioning.posegraph.optimiser import FRAMES, Frame, optimise
from positioning.walk_alignment import Placed, motion_graph, moved, place_walks, poses_of, wifi_pairs

CLASSES = (GraphSlam, RansacAlignment, AlignedGraphSlam, GtsamGraphSlam, ControlTrueNeighbours)
ALIGNED = (RansacAlignment, AlignedGraphSlam)
FIRST = np.array([0.3, 2.5, -1.4, 3.0])


def world(
    seed: int = 0,
    *,
    walks: int = 4,
    poses: int = 120,
    drift_rad: float = 0.0,
    noise_db: float = 0.0,
    first_rad: np.ndarray = FIRST,
) -> tuple[Walks, Truth]:
    """Walks over the streets of one quarter: each turns at random, and hears thirty access points."""
    rng = np.random.default_rng(seed)
    block_m, across = 20.0, 5
    paths = []
    for _ in range(walks):
        place, way, before = np.array([2, 2]), [np.array([2, 2])], None
        for _ in range(poses * 2 // 20 + 2):
            free = [step for step in ((1, 0), (-1, 0), (0, 1), (0, -1)) if before is None or step != before]
            free = [step for step in free if (place + step >= 0).all() and (place + step < across).all()]
            step = free[rng.integers(len(free))]
            before, place = (-step[0], -step[1]), place + step
            way.append(place)
        corner_m = block_m * np.array(way)
        along_m = 2.0 * np.arange(poses)
        corner_at_m = block_m * np.arange(len(way))
        paths.append(
            np.stack([np.interp(along_m, corner_at_m, corner_m[:, axis]) for axis in (0, 1)], axis=-1)
        )
    path_m = np.array(paths)
    step_m = np.diff(path_m, axis=1, append=2 * path_m[:, -1:] - path_m[:, -2:-1])
    heading_rad = np.unwrap(np.arctan2(step_m[..., 1], step_m[..., 0]), axis=-1)
    access_point_m = rng.uniform(-10, 90, (30, 2))
    distance_m = np.linalg.norm(path_m[:, :, None] - access_point_m, axis=-1)
    rss_dbm = -35 - 25 * np.log10(1 + distance_m) + rng.normal(0, 1, distance_m.shape) * noise_db
    rss_dbm[rss_dbm < -85] = np.nan
    turn = first_rad[:walks, None] - heading_rad[:, :1]
    turn = turn + np.cumsum(rng.normal(0, 1, heading_rad.shape) * (np.arange(poses) > 0), axis=1) * drift_rad
    # Each step in the frame of a heading that is off by a wandering angle.
    own_m = np.zeros_like(path_m)
    own_m[:, 1:] = np.cumsum(rotated(np.diff(path_m, axis=1), turn[:, :-1]), axis=1)
    time_s = np.tile(2.0 * np.arange(poses), (walks, 1))
    return (
        Walks(time_s=time_s, position_m=own_m, heading_rad=heading_rad + turn, rss_dbm=rss_dbm),
        Truth(position_m=path_m, path_m=path_m, heading_rad=heading_rad),
    )


def error_m(aligned, truth: Truth, of=slice(None)) -> np.ndarray:
    """Distance to the truth after the best rigid tie of all chosen poses."""
    found, true = aligned.position_m[of].reshape(-1, 2), truth.path_m[of].reshape(-1, 2)
    known = np.isfinite(found).all(axis=-1)
    angle, shift = rigid_fit(found[known], true[known])
    return np.linalg.norm(rotated(found[known], angle) + shift - true[known], axis=-1)


def exact(make) -> dict:
    """Settings under which only scans of the same place match, and have edges."""
    if make is RansacAlignment:
        return {"inlier_m": 0.5}
    own = {"alignment": RansacAlignment(inlier_m=0.5)} if make is AlignedGraphSlam else {}
    return {"threshold": 0.05, **own}


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


# What is known


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("make", ALIGNED)
def test_walks_without_noise_come_back_whatever_their_first_headings(make, seed: int) -> None:
    walks, truth = world(seed, first_rad=np.random.default_rng(seed).uniform(-np.pi, np.pi, 4))
    aligned = make(**exact(make)).align(walks, rng())
    assert error_m(aligned, truth).max() < 1e-3
    assert aligned.extra["aligned"].all()
    np.testing.assert_allclose(aligned.position_m[0, 0], 0, atol=1e-12)
    assert aligned.heading_rad[0, 0] == pytest.approx(0, abs=1e-12)


def test_the_graph_takes_drift_away() -> None:
    walks, truth = world(5, drift_rad=0.05, noise_db=1.0)
    rigid = error_m(RansacAlignment().align(walks, rng()), truth).mean()
    graph = error_m(AlignedGraphSlam(cost="linear").align(walks, rng()), truth).mean()
    control = error_m(ControlTrueNeighbours(truth=truth).align(walks, rng()), truth).mean()
    assert graph < 0.5 * rigid
    assert control < 0.1 * rigid


def test_the_printed_start_fails_where_walks_are_aligned_first() -> None:
    """Walks laid wrongly upon each other: eq. 10 is flat for most of their pairs, and least squares stops."""
    walks, truth = world(1, poses=200, first_rad=np.array([0.0, 3.1, 1.6, -1.5]))
    options = {"exclude_m": 0.0, "d_max_m": 15.0}
    printed = GraphSlam(**options).align(walks, rng())
    aligned = AlignedGraphSlam(**options).align(walks, rng())
    assert error_m(printed, truth).mean() > 10
    assert error_m(aligned, truth).mean() < 2


def test_without_wifi_edges_nothing_moves() -> None:
    walks, _ = world(drift_rad=0.02)
    aligned = GraphSlam(wifi_edges=False).align(walks, rng())
    np.testing.assert_allclose(aligned.position_m, rotated(walks.position_m, -FIRST[0]), atol=1e-9)
    np.testing.assert_array_equal(aligned.extra["connected"], [True, False, False, False])
    assert not aligned.extra["edges"].any()


@pytest.mark.parametrize("frame", FRAMES)
def test_the_minimum_is_that_of_the_graph_by_hand(frame: Frame) -> None:
    walks, _ = world(2, drift_rad=0.02, noise_db=1.0)
    poses = poses_of(walks)
    near_from, near_to = wifi_pairs(poses, window=10, exclude_s=30.0, exclude_m=2.0)
    graph = replace(motion_graph(poses), near_from=near_from, near_to=near_to)
    # Eq. 5 sums over both orders of a pair.
    found = optimise(graph.tied(), near=NearCost(weight=0.02), frame=frame, iterations=50)
    aligned = GraphSlam(wifi_weight=0.01, frame=frame).align(walks, rng())
    turn = aligned.heading_rad[0, 0] - found.pose[0, 2]
    expected = rotated(found.pose[:, :2] - found.pose[0, :2], turn)
    np.testing.assert_allclose(aligned.position_m.reshape(-1, 2), expected, atol=1e-9)
    np.testing.assert_allclose(aligned.extra["cost"], found.cost)
    assert aligned.extra["edges"].sum() == 2 * len(near_from)


def test_the_first_pose_is_held_as_printed_and_free_for_walks_that_are_aligned() -> None:
    walks, _ = world(5, drift_rad=0.05, noise_db=1.0)
    start, held, free = (
        make.align(walks, rng())
        for make in (RansacAlignment(), AlignedGraphSlam(frame="held"), AlignedGraphSlam())
    )
    assert (GraphSlam().frame, AlignedGraphSlam().frame) == ("held", "free")
    np.testing.assert_allclose(free.extra["cost"], held.extra["cost"], rtol=1e-3)
    assert (free.extra["iterations"] != held.extra["iterations"]).all()
    assert np.abs(free.position_m - start.position_m).max() > 1
    for make in (GraphSlam, AlignedGraphSlam):
        with pytest.raises(InputError, match=r"frame='loose'.*held, free"):
            make(frame="loose").align(walks, rng())


# Invariance


@pytest.mark.parametrize("make", ALIGNED)
def test_the_order_of_the_walks_but_the_first_does_not_matter(make) -> None:
    walks, _ = world(4, drift_rad=0.01, noise_db=1.0)
    order = np.array([0, 3, 1, 2])
    other = Walks(**{name: getattr(walks, name)[order] for name in vars(walks)})
    found = make().align(walks, rng()).position_m[order]
    np.testing.assert_allclose(make().align(other, rng()).position_m, found, atol=0.1)


def test_pairs_do_not_depend_on_the_order_of_the_walks() -> None:
    walks, _ = world(4, noise_db=2.0)
    order = np.array([2, 0, 3, 1])
    other = Walks(**{name: getattr(walks, name)[order] for name in vars(walks)})
    sets = []
    for shuffled, place in ((walks, np.arange(4)), (other, order)):
        pairs = np.array(wifi_pairs(poses_of(shuffled), window=10, exclude_s=30.0, exclude_m=2.0))
        walk, pose = np.divmod(pairs, 120)
        sets.append({frozenset(pair) for pair in (place[walk] * 120 + pose).T.tolist()})
    assert sets[0] == sets[1]


def test_an_aligned_start_does_not_depend_on_the_frames() -> None:
    walks, _ = world(5, drift_rad=0.01, noise_db=1.0)
    turn = np.array([[1.0], [-2.0], [0.5], [3.0]])
    turned = replace(walks, position_m=rotated(walks.position_m, turn), heading_rad=walks.heading_rad + turn)
    found = RansacAlignment().align(walks, rng())
    other = RansacAlignment().align(turned, rng())
    np.testing.assert_allclose(other.position_m, found.position_m, atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * other.heading_rad), np.exp(1j * found.heading_rad), atol=1e-9)


# What goes wrong


def test_scans_that_lie_do_not_move_the_walks_much() -> None:
    """Every tenth scan is that of another place."""
    walks, truth = world(6, poses=160)
    draw = np.random.default_rng(0)
    rss_dbm = walks.rss_dbm.copy()
    flat = rss_dbm.reshape(-1, rss_dbm.shape[-1])
    wrong = draw.choice(len(flat), len(flat) // 10, replace=False)
    flat[wrong] = flat[draw.permutation(wrong)]
    lying = replace(walks, rss_dbm=rss_dbm)
    placed = RansacAlignment().align(lying, rng())
    assert placed.extra["aligned"].all()
    assert error_m(placed, truth).max() < 0.5
    square = error_m(AlignedGraphSlam().align(lying, rng()), truth).mean()
    robust = error_m(AlignedGraphSlam(loss="cauchy").align(lying, rng()), truth).mean()
    assert robust < 0.2 * square
    assert robust < 1


def without_common_access_points(walks: Walks, apart: list[int]) -> Walks:
    """The chosen walks hear access points of their own."""
    rss_dbm = np.full((*walks.rss_dbm.shape[:-1], 60), np.nan)
    for walk in range(len(rss_dbm)):
        low = 30 if walk in apart else 0
        rss_dbm[walk, :, low : low + 30] = walks.rss_dbm[walk]
    return replace(walks, rss_dbm=rss_dbm)


def test_walks_without_a_common_access_point_stay_and_are_told() -> None:
    walks, truth = world(7)
    apart = without_common_access_points(walks, [2, 3])
    for make in ALIGNED:
        aligned = make(**exact(make)).align(apart, rng())
        np.testing.assert_array_equal(aligned.extra["aligned"], [True, True, False, False])
        assert error_m(aligned, truth, slice(0, 2)).max() < 1e-3
        # The other two are joined to each other, in the frame of the third walk.
        assert error_m(aligned, truth, slice(2, 4)).max() < 1e-3
        np.testing.assert_allclose(aligned.position_m[2, 0], 0, atol=1e-9)
        assert aligned.heading_rad[2, 0] == pytest.approx(FIRST[2] - FIRST[0])
        joined = ["", "", "joined to walk 3, which is not", "joined to walk 2, which is not"]
        for text, words in zip(aligned.extra["reason"], joined, strict=True):
            assert text.startswith(words)
            assert bool(text) == bool(words)
    np.testing.assert_array_equal(aligned.extra["connected"], [True, True, False, False])


@pytest.mark.parametrize("make", [GraphSlam, *ALIGNED])
def test_a_walk_without_scans_stays_and_is_told(make) -> None:
    walks, truth = world(8)
    walks.rss_dbm[0] = np.nan
    aligned = make(**exact(make)).align(walks, rng())
    # The second walk is the reference now.
    np.testing.assert_allclose(aligned.position_m[1, 0], 0, atol=1e-12)
    np.testing.assert_allclose(aligned.position_m[0], rotated(walks.position_m[0], -FIRST[1]), atol=1e-9)
    told = aligned.extra["connected" if make is GraphSlam else "aligned"]
    np.testing.assert_array_equal(told, [False, True, True, True])
    if make is not GraphSlam:
        assert aligned.extra["reason"].tolist() == ["no scan hears an access point", "", "", ""]
    if make is RansacAlignment:
        assert error_m(aligned, truth, slice(1, 4)).max() < 1e-3


def test_too_few_matches_are_told_with_what_is_needed() -> None:
    walks, _ = world(6, noise_db=1.0)
    extra = RansacAlignment(least_matches=500).align(walks, rng()).extra
    assert extra["reason"][0] == ""
    for text in extra["reason"][1:]:
        assert re.fullmatch(r"\d+ of \d+ matched scans agree with walk \d, 500 are needed", text)
    # What the third walk hears, no other walk hears.
    alone = without_common_access_points(walks, [2])
    extra = RansacAlignment().align(alone, rng()).extra
    assert extra["reason"][2] == "no scan matches one of another walk"


@pytest.mark.parametrize("make", [GraphSlam, *ALIGNED])
def test_without_any_scan_all_stays(make) -> None:
    walks, _ = world()
    walks.rss_dbm[:] = np.nan
    aligned = make().align(walks, rng())
    np.testing.assert_allclose(aligned.position_m, rotated(walks.position_m, -FIRST[0]), atol=1e-9)
    told = aligned.extra["connected" if make is GraphSlam else "aligned"]
    np.testing.assert_array_equal(told, [True, False, False, False])


@pytest.mark.parametrize("make", [GraphSlam, *ALIGNED])
def test_one_walk_only(make) -> None:
    walks, truth = world(9, walks=1)
    aligned = make(**exact(make)).align(walks, rng())
    assert error_m(aligned, truth).max() < 1e-3


@pytest.mark.parametrize("make", [GraphSlam, *ALIGNED])
def test_a_walk_that_goes_nowhere_stays_and_is_told(make) -> None:
    walks, truth = world(10)
    # One pose, and one person who stands.
    for values in (walks.time_s, walks.position_m, walks.heading_rad, walks.rss_dbm):
        values[2, 1:] = np.nan
    walks.position_m[3] = 0
    walks.rss_dbm[3] = walks.rss_dbm[3, 0]
    aligned = make(**exact(make)).align(walks, rng())
    assert np.isfinite(aligned.position_m[2, 0]).all()
    assert np.isnan(aligned.position_m[2, 1:]).all()
    assert np.isfinite(aligned.position_m[3]).all()
    if make is not GraphSlam:
        np.testing.assert_array_equal(aligned.extra["aligned"], [True, True, False, False])
        assert error_m(aligned, truth, slice(0, 2)).max() < 1e-3


def test_a_long_walk_that_bends_is_placed_by_its_parts() -> None:
    """A walk that turns by forty degrees in the end: most of it lies where it was."""
    walks, truth = world(11, poses=200)
    bend_rad = np.where(np.arange(200) > 150, 0.7, 0.0)
    step_m = np.diff(walks.position_m[1], axis=0)
    walks.position_m[1, 1:] = np.cumsum(rotated(step_m, bend_rad[:-1]), axis=0)
    walks.heading_rad[1] += bend_rad
    aligned = RansacAlignment(segment_s=100.0).align(walks, rng())
    assert aligned.extra["aligned"].all()
    straight = aligned._replace(position_m=aligned.position_m[:, :150])
    assert error_m(straight, SimpleNamespace(path_m=truth.path_m[:, :150])).max() < 1.0
    # The graph bends it back.
    graph = AlignedGraphSlam(threshold=0.5, wifi_weight=1.0).align(walks, rng())
    assert error_m(graph, truth).max() < error_m(aligned, truth).max() / 3


# Settings


@pytest.mark.parametrize("make", CLASSES)
def test_parameters_are_keywords_documented_and_stored_unchanged(make) -> None:
    parameters = inspect.signature(make).parameters.values()
    truth = world()[1]
    algorithm = make(truth=truth) if make is ControlTrueNeighbours else make()
    for parameter in parameters:
        assert parameter.kind is parameter.KEYWORD_ONLY
        assert parameter.name in make.__doc__
        if parameter.default is not parameter.empty:
            assert getattr(algorithm, parameter.name) is parameter.default


@pytest.mark.parametrize(
    ("make", "options", "words"),
    [
        (GraphSlam, {"window": 1}, ["window=1", "whole number from 2"]),
        (GraphSlam, {"window": 4.5}, ["window", "whole number"]),
        (GraphSlam, {"threshold": "mean"}, ["threshold='mean'", "median"]),
        (GraphSlam, {"threshold": -1.0}, ["threshold=-1.0"]),
        (GraphSlam, {"decides": "first"}, ["decides='first'"]),
        (GraphSlam, {"exclude_s": -1.0}, ["exclude_s=-1.0"]),
        (GraphSlam, {"exclude_m": np.nan}, ["exclude_m=nan"]),
        (GraphSlam, {"wifi_weight": -1.0}, ["wifi_weight=-1.0", "from zero"]),
        (GraphSlam, {"wifi_weight": "1e-4"}, ["wifi_weight='1e-4'", "it is text", "without quotes"]),
        (GraphSlam, {"threshold": "12"}, ["threshold='12'", "neither 'median' nor a number"]),
        (GraphSlam, {"d_max_m": "30"}, ["d_max_m='30'", "it is text"]),
        (GraphSlam, {"e_max": None}, ["e_max=None", "above zero"]),
        (GraphSlam, {"wifi_edges": "nope"}, ["wifi_edges='nope'", "True or False"]),
        (GraphSlam, {"exclude_s": "30"}, ["exclude_s='30'"]),
        (GraphSlam, {"iterations": np.nan}, ["iterations=nan", "whole number from 1"]),
        (GraphSlam, {"iterations": None}, ["iterations=None", "whole number from 1"]),
        (GraphSlam, {"iterations": "a"}, ["iterations='a'", "whole number from 1"]),
        (GraphSlam, {"iterations": np.inf}, ["iterations=inf", "whole number from 1"]),
        (RansacAlignment, {"inlier_m": "5"}, ["inlier_m='5'", "it is text"]),
        (RansacAlignment, {"least_share": "0.2"}, ["least_share='0.2'", "it is text"]),
        (
            AlignedGraphSlam,
            {"alignment": "ransac_alignment"},
            ["'ransac_alignment'", "placed", "RansacAlignment()"],
        ),
        (AlignedGraphSlam, {"alignment": RansacAlignment}, ["no method placed", "RansacAlignment()"]),
        (AlignedGraphSlam, {"alignment": GraphSlam()}, ["no method placed"]),
        (
            AlignedGraphSlam,
            {"alignment": SimpleNamespace(placed=lambda poses, rng: None)},
            ["NoneType", "Placed"],
        ),
        (
            AlignedGraphSlam,
            {"alignment": SimpleNamespace(placed=lambda poses, rng: Placed(*np.zeros((4, 4))))},
            ["shift_m", "the shape is (4,), (4, 2) is needed"],
        ),
        (ControlTrueNeighbours, {"exclude_s": None}, ["exclude_s=None"]),
        (GraphSlam, {"d_min_m": 40.0}, ["d_min_m=40.0"]),
        (GraphSlam, {"cost": "cubic"}, ["cost='cubic'"]),
        (GraphSlam, {"loss": "cauchy", "cost": "linear"}, ["loss='cauchy'"]),
        (GraphSlam, {"iterations": 0}, ["iterations=0"]),
        (RansacAlignment, {"inlier_m": 0.0}, ["inlier_m=0.0"]),
        (RansacAlignment, {"segment_s": np.inf}, ["segment_s=inf"]),
        (RansacAlignment, {"hypotheses": 0}, ["hypotheses=0"]),
        (RansacAlignment, {"hypotheses": 10.5}, ["hypotheses", "whole number"]),
        (RansacAlignment, {"least_matches": 1}, ["least_matches=1"]),
        (RansacAlignment, {"least_share": 1.5}, ["least_share=1.5"]),
        (RansacAlignment, {"window": 0}, ["window=0"]),
        (AlignedGraphSlam, {"alignment": RansacAlignment(inlier_m=-1.0)}, ["inlier_m=-1.0"]),
        (ControlTrueNeighbours, {"near_m": -1.0}, ["near_m=-1.0"]),
    ],
)
def test_settings_outside_their_range_are_refused(make, options, words) -> None:
    walks, truth = world()
    more = {"truth": truth} if make is ControlTrueNeighbours else {}
    with pytest.raises(InputError) as error:
        make(**options, **more).align(walks, rng())
    assert all(word in str(error.value) for word in words)


def test_a_truth_without_headings_is_refused() -> None:
    walks, truth = world()
    with pytest.raises(InputError, match="heading_rad"):
        ControlTrueNeighbours(truth=replace(truth, heading_rad=None)).align(walks, rng())


# The peer


def test_without_gtsam_the_row_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    walks, _ = world()
    monkeypatch.setattr("algorithms.alignment.gtsam_graph_slam.find_spec", lambda name: None)
    assert GtsamGraphSlam().skip(walks) == "gtsam is not installed"
    with pytest.raises(InputError, match="Install the optional group peers"):
        GtsamGraphSlam().align(walks, rng())


def test_gtsam_finds_the_same_minimum() -> None:
    pytest.importorskip("gtsam")
    walks, truth = world(3, drift_rad=0.02, noise_db=1.0)
    algorithm = GtsamGraphSlam(most_edges=500)
    aligned = algorithm.align(walks, rng())
    assert error_m(aligned, truth).mean() < error_m(RansacAlignment().align(walks, rng()), truth).mean()
    assert aligned.extra["edges"].sum() == 2 * 500
    poses = poses_of(walks)
    placed = RansacAlignment().placed(poses, rng())
    start = moved(poses, placed.turn_rad, placed.shift_m)
    graph = algorithm._graph(poses, start).tied()
    near = NearCost(weight=0.002)
    ours = optimise(graph, near=near, iterations=500, tolerance=1e-9)
    theirs = gtsam_minimum(graph, near, 500)
    assert theirs.cost_start == pytest.approx(ours.cost_start, rel=1e-6)
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-3)
    with pytest.raises(InputError, match="only the square"):
        gtsam_minimum(graph, NearCost(weight=1.0, cost="linear"), 10)


# Placing


def test_a_rotation_is_told_from_noise() -> None:
    """Scans of different places that are alike by chance join nothing."""
    walks, _ = world(12)
    shuffled = walks.rss_dbm.copy()
    draw = np.random.default_rng(0)
    for walk in (1, 2, 3):
        shuffled[walk] = shuffled[walk, draw.permutation(shuffled.shape[1])]
    poses = poses_of(replace(walks, rss_dbm=shuffled))
    placed = place_walks(
        poses,
        rng(),
        window=10,
        inlier_m=3.0,
        segment_s=300.0,
        hypotheses=500,
        least_matches=8,
        least_share=0.3,
    )
    np.testing.assert_array_equal(placed.part, [0, 1, 2, 3])
    assert not placed.turn_rad.any()
    assert not placed.shift_m.any()
    assert not placed.matches.any()
