"""Pose graphs: runner, score, first guess, the search without damping, measures, and every algorithm."""

import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from algorithms.pose_graph.dead_reckoning import DeadReckoning
from algorithms.pose_graph.levenberg_marquardt import LevenbergMarquardt
from algorithms.pose_graph.levenberg_marquardt_robust import LevenbergMarquardtRobust
from positioning.errors import InputError
from positioning.evaluation.measures import MEASURES, NO_ANSWER, NO_TRUTH, paired, table
from positioning.evaluation.studies.posegraph_real import NEAR, measures
from positioning.geometry import rotated
from positioning.posegraph.costs import NearCost
from positioning.posegraph.graph import PoseGraph, Solved
from positioning.posegraph.optimiser import cost, optimise
from positioning.posegraph.residuals import motion_residual, move, relative_pose, wrap
from positioning.posegraph.rotations import rotations_first
from positioning.registry import class_name
from positioning.tasks import pose_graph

FOLDER = Path(__file__).parents[1] / "algorithms/pose_graph"
NAMES = sorted(path.stem for path in FOLDER.glob("[a-z]*.py"))
angles, lengths = st.floats(-3.1, 3.1), st.floats(-50, 50)


def drawn(
    seed: int = 0, rounds: int = 3, noise: float = 1.0, near: bool = True
) -> tuple[PoseGraph, np.ndarray]:
    """Rounds on a circle, dead reckoned, with loop closures between rounds and pairs of near places."""
    rng = np.random.default_rng(seed)
    each = 12
    angle = 2 * np.pi * np.arange(rounds * each) / each
    truth = np.stack([15 * np.sin(angle), 15 * (1 - np.cos(angle)), angle], axis=-1)
    number = np.arange(len(truth))
    start = np.concatenate([number[:-1], number[:-each:5]])
    end = np.concatenate([number[1:], number[each - 1 :: 5][: len(number[:-each:5])]])
    motion = relative_pose(truth[start], truth[end])
    motion[:, 2] = wrap(motion[:, 2])
    motion += noise * rng.normal(0, [0.1, 0.1, 0.02], motion.shape)
    pose = np.zeros((len(truth), 3))
    for k in number[1:]:
        pose[k] = move(pose[k - 1], motion[k - 1])
    graph = PoseGraph(
        pose=pose,
        motion_from=start,
        motion_to=end,
        motion=motion,
        motion_information=np.tile(np.diag([100.0, 100.0, 2500.0]), (len(start), 1, 1)),
        fixed=number == 0,
        loop=number.size - 1 <= np.arange(len(start)),
    )
    if near:
        pairs = {"near_from": number[:-each:4], "near_to": number[each::4]}
        graph = replace(graph, **pairs, near_weight=np.linspace(0.2, 1, len(pairs["near_to"])))
    return graph.check(), truth


def made(name: str):
    return getattr(importlib.import_module(f"algorithms.pose_graph.{name}"), class_name(name))()


# Every algorithm


@pytest.mark.parametrize("name", NAMES)
def test_the_contract_of_pose_graphs(name: str) -> None:
    graph, _ = drawn()
    algorithm = made(name)
    if hasattr(algorithm, "skip") and (reason := algorithm.skip(graph)):
        assert "install the group peers" in reason
        with pytest.raises(InputError, match="gtsam is not installed"):
            algorithm.solve(graph, np.random.default_rng(3))
        pytest.skip(reason)
    before, given_pose = np.random.get_state()[1].copy(), graph.pose.copy()  # noqa: NPY002
    first = algorithm.solve(graph, np.random.default_rng(3))
    again = made(name).solve(graph, np.random.default_rng(3))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.testing.assert_array_equal(graph.pose, given_pose)
    np.testing.assert_array_equal(first.pose, again.pose)
    assert first.pose.shape == graph.pose.shape
    assert np.isfinite(first.pose).all()
    np.testing.assert_allclose(first.pose[0], graph.pose[0], atol=1e-6)
    assert first.extra["iterations"] >= 0


@pytest.mark.parametrize("name", [n for n in NAMES if n != "dead_reckoning"])
def test_what_agrees_in_all_edges_is_found(name: str) -> None:
    graph, truth = drawn(noise=0.0)
    algorithm = made(name)
    if hasattr(algorithm, "skip") and algorithm.skip(graph):
        pytest.skip(algorithm.skip(graph))
    off = np.random.default_rng(1).normal(0, [0.5, 0.5, 0.1], truth.shape) * ~graph.fixed[:, None]
    found = algorithm.solve(replace(graph, pose=truth + off), np.random.default_rng(0))
    np.testing.assert_allclose(found.pose[:, :2], truth[:, :2], atol=2e-3)


@pytest.mark.parametrize("name", ["levenberg_marquardt", "gauss_newton", "gtsam_levenberg_marquardt"])
def test_searches_of_one_cost_agree_with_scipy(name: str) -> None:
    graph, _ = drawn(4)
    # Unequal along and across: what turns information into another frame is seen.
    stiff = np.tile(np.diag([20.0, 500.0, 2500.0]), (len(graph.motion), 1, 1))
    graph = replace(graph, motion_information=stiff)
    algorithm = made(name)
    if hasattr(algorithm, "skip") and algorithm.skip(graph):
        pytest.skip(algorithm.skip(graph))
    root = np.sqrt(np.diagonal(stiff, axis1=-2, axis2=-1))

    def residuals(free: np.ndarray) -> np.ndarray:
        pose = np.concatenate([graph.pose[:1], free.reshape(-1, 3)])
        motion = motion_residual(pose[graph.motion_from], pose[graph.motion_to], graph.motion)
        apart_m = np.linalg.norm((pose[graph.near_from] - pose[graph.near_to])[:, :2], axis=-1)
        near = np.sqrt(graph.near_weight) * np.clip(apart_m - 2.0, 0.0, 28.0)
        return np.concatenate([(root * motion).ravel(), near])

    expected = least_squares(residuals, graph.pose[1:].ravel(), xtol=1e-12, ftol=1e-12)
    found = algorithm.solve(graph, np.random.default_rng(0))
    value = sum(cost(replace(graph, pose=found.pose), near=NEAR))
    assert value == pytest.approx(2 * expected.cost, rel=2e-3)
    if not name.startswith("gtsam"):
        np.testing.assert_allclose(found.pose[1:, :2], expected.x.reshape(-1, 3)[:, :2], atol=2e-2)
        assert found.extra["own_cost"] == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 2, 7])
def test_wrong_pairs_harm_the_square_and_hardly_the_robust_loss(seed: int) -> None:
    graph, truth = drawn(seed)
    start, end = np.array([0, 3, 5, 9, 13, 20]), np.array([6, 21, 23, 15, 7, 26])
    assert np.linalg.norm((truth[start] - truth[end])[:, :2], axis=-1).min() > 15
    wrong = replace(
        graph,
        near_from=np.concatenate([graph.near_from, start]),
        near_to=np.concatenate([graph.near_to, end]),
        near_weight=np.concatenate([graph.near_weight, np.ones(6)]),
    )
    error_m = {
        name: [
            pose_graph.score(
                {"position_m": made(name).solve(each, np.random.default_rng(0)).pose[None, :, :2]},
                {"truth.position_m": truth[None, :, :2]},
            )["error_m"].mean()
            for each in (graph, wrong)
        ]
        for name in ("levenberg_marquardt", "levenberg_marquardt_robust")
    }
    assert error_m["levenberg_marquardt_robust"][1] < error_m["levenberg_marquardt_robust"][0] + 0.03
    assert error_m["levenberg_marquardt"][1] > error_m["levenberg_marquardt"][0] + 0.25


# First guess and search without damping


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), turn=angles, x=lengths, y=lengths)
def test_the_first_guess_needs_no_start_and_turns_with_the_frame(
    seed: int, turn: float, x: float, y: float
) -> None:
    graph, _ = drawn(seed, near=False)
    guess = rotations_first(graph)
    # Nothing of the start but the fixed pose counts, and that the frame is its own.
    rng = np.random.default_rng(seed)
    elsewhere = np.where(graph.fixed[:, None], graph.pose, rng.uniform(-30, 30, graph.pose.shape))
    other = rotations_first(replace(graph, pose=elsewhere))
    np.testing.assert_allclose(other[:, :2], guess[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap(other[:, 2] - guess[:, 2]), 0.0, atol=1e-8)
    assert np.abs(other[:, 2] - elsewhere[:, 2]).max() <= np.pi + 1e-9
    rigid = np.array([x, y, turn])
    moved = rotations_first(replace(graph, pose=move(rigid, graph.pose)))
    np.testing.assert_allclose(moved[:, :2], move(rigid, guess)[:, :2], atol=1e-6)
    best = optimise(graph, tolerance=1e-10).cost
    assert best <= sum(cost(replace(graph, pose=guess))) < 0.5 * sum(cost(graph))


def test_the_first_guess_shares_the_misclosure_of_a_straight_loop() -> None:
    # There and back along a line, one metre too short on the way back: three equal parts.
    pose = np.array([[0.0, 0, 0], [5, 3, 1], [10, 0, -2]])
    graph = PoseGraph(
        pose=pose,
        motion_from=np.array([0, 1, 2]),
        motion_to=np.array([1, 2, 0]),
        motion=np.array([[5.0, 0, 0], [5, 0, 0], [-9, 0, 0]]),
        motion_information=np.tile(np.eye(3), (3, 1, 1)),
        fixed=np.array([True, False, False]),
    )
    np.testing.assert_allclose(rotations_first(graph)[:, 0], [0, 5 - 1 / 3, 10 - 2 / 3], atol=1e-9)
    np.testing.assert_allclose(rotations_first(graph)[:, 1:], 0.0, atol=1e-9)


def test_parts_that_only_pairs_tie_keep_their_first_pose_in_the_guess() -> None:
    graph, _ = drawn(1)
    cut = (graph.motion_from < 20) == (graph.motion_to < 20)
    parts = replace(
        graph,
        motion_from=graph.motion_from[cut],
        motion_to=graph.motion_to[cut],
        motion=graph.motion[cut],
        motion_information=graph.motion_information[cut],
        loop=graph.loop[cut],
    )
    guess = rotations_first(parts)
    np.testing.assert_array_equal(guess[[0, 20]], graph.pose[[0, 20]])
    assert np.isfinite(guess).all()
    still = replace(graph, fixed=np.ones(len(graph.pose), bool))
    np.testing.assert_array_equal(rotations_first(still), graph.pose)


@pytest.mark.parametrize("begin", ["given", "rotations_first"])
@pytest.mark.parametrize("search", ["levenberg_marquardt", "gauss_newton"])
def test_starts_and_searches_meet_in_one_minimum(begin: str, search: str) -> None:
    graph, _ = drawn(6)
    plain = optimise(graph, near=NEAR, tolerance=1e-10)
    found = optimise(graph, near=NEAR, start=begin, search=search, tolerance=1e-10)  # type: ignore[arg-type]
    assert found.converged
    assert found.cost == pytest.approx(plain.cost, rel=1e-6)
    assert found.cost_start == plain.cost_start
    short = optimise(graph, near=NEAR, start=begin, search=search, iterations=1)  # type: ignore[arg-type]
    assert (short.iterations, short.converged) == (1, False)


def test_the_best_poses_are_kept_where_the_undamped_search_loses_its_way() -> None:
    graph, _ = drawn(3, near=False)
    rng = np.random.default_rng(5)
    wild = replace(graph, pose=np.where(graph.fixed[:, None], 0.0, rng.uniform(-3, 3, graph.pose.shape)))
    found = optimise(wild, search="gauss_newton", iterations=7)
    assert found.cost <= found.cost_start
    assert found.cost == pytest.approx(sum(cost(replace(wild, pose=found.pose))), rel=1e-12)


def test_unknown_starts_searches_and_distances_are_refused() -> None:
    graph, _ = drawn(near=False)
    for setting in ({"start": "random"}, {"search": "newton"}):
        with pytest.raises(InputError, match="is none of"):
            optimise(graph, **setting)  # type: ignore[arg-type]
    for sigma_m in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="sigma_m"):
            NearCost.of_distance(sigma_m)
    with pytest.raises(InputError, match="d_min_m"):
        NearCost.of_distance(1.0, d_min_m=5.0, d_max_m=5.0)


def test_a_distance_costs_its_square_in_standard_deviations() -> None:
    pose = np.array([[0.0, 0, 0], [7, 0, 0], [100, 0, 0]])
    graph = PoseGraph(
        pose=pose,
        motion_from=np.zeros(0, int),
        motion_to=np.zeros(0, int),
        motion=np.zeros((0, 3)),
        motion_information=np.zeros((0, 3, 3)),
        fixed=np.ones(3, bool),
        near_from=np.array([0]),
        near_to=np.array([1]),
        near_weight=np.array([0.5]),
    )
    assert cost(graph, near=NearCost.of_distance(2.0))[1] == pytest.approx(0.5 * (5 / 2) ** 2)
    flat = replace(graph, near_to=np.array([2]))
    assert cost(flat, near=NearCost.of_distance(2.0))[1] == pytest.approx(0.5 * (28 / 2) ** 2)
    cauchy = NearCost.of_distance(1.0, loss="cauchy", scale_m=2.0)
    assert cost(graph, near=cauchy)[1] == pytest.approx(0.5 * 4 * np.log1p(25 / 4))


# Runner and score


def observed(*graphs: PoseGraph) -> dict[str, np.ndarray]:
    parts = [pose_graph.arrays_of(graph) for graph in graphs]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_a_graph_survives_its_arrays() -> None:
    graph, _ = drawn()
    arrays = {name: values[0] for name, values in pose_graph.arrays_of(graph).items()}
    back = pose_graph.graph_of(arrays)
    for name in ("pose", "motion_from", "motion", "motion_information", "fixed", "loop", "near_weight"):
        np.testing.assert_array_equal(getattr(back, name), getattr(graph, name))
    del arrays["graph.motion"]
    with pytest.raises(InputError, match=r"graph\.motion: it is missing"):
        pose_graph.graph_of(arrays)


def test_the_runner_gives_every_world_its_own_answer() -> None:
    first, second = drawn(0)[0], drawn(1)[0]

    class Marked:
        def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
            draw = rng.uniform()
            return Solved(graph.pose + draw * ~graph.fixed[:, None], {"draw": np.array(draw)})

    generators = [np.random.default_rng(i) for i in range(2)]
    outcome = pose_graph.run(Marked, observed(first, second), None, {}, generators)
    for index, graph in enumerate((first, second)):
        draw = np.random.default_rng(index).uniform()
        assert outcome.estimates["extra_draw"][index] == draw
        np.testing.assert_array_equal(outcome.estimates["position_m"][index, 1:], graph.pose[1:, :2] + draw)
        np.testing.assert_array_equal(outcome.estimates["heading_rad"][index, 0], graph.pose[0, 2])
    assert outcome.seconds.shape == (2,)
    assert "no pose graph" in pose_graph.run(Marked, {}, None, {}, []).skipped

    class Absent(Marked):
        def skip(self, graph: PoseGraph) -> str:
            return "not here"

    assert pose_graph.run(Absent, observed(first), None, {}, generators[:1]).skipped == "not here"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda pose: pose[:-1], ["the shape is", "Correct the algorithm"]),
        (
            lambda pose: pose * np.where(np.arange(len(pose)) == 4, np.nan, 1)[:, None],
            ["pose[4]", "not finite"],
        ),
        (lambda pose: pose + 0.01, ["pose[0]", "fixed, and has moved"]),
    ],
)
def test_a_wrong_answer_is_refused(change, words) -> None:
    class Wrong:
        def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
            return Solved(change(graph.pose))

    with pytest.raises(InputError) as error:
        pose_graph.run(Wrong, observed(drawn()[0]), None, {}, [np.random.default_rng(0)])
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda pose: pose, ["gave a ndarray", "a Solved of", "Return Solved(pose)"]),
        (lambda pose: (pose, {}), ["gave a tuple"]),
        (lambda pose: None, ["gave a NoneType"]),
        (lambda pose: Solved([[1], [2, 3]]), ["pose", "no array"]),
        (lambda pose: Solved(pose, 7), ["extra", "int", "dict"]),
    ],
)
def test_an_answer_of_another_kind_is_told_what_is_needed(answer, words) -> None:
    class Wrong:
        def solve(self, graph: PoseGraph, rng: np.random.Generator):
            return answer(graph.pose)

    with pytest.raises(InputError) as error:
        pose_graph.run(Wrong, observed(drawn()[0]), None, {}, [np.random.default_rng(0)])
    assert all(word in str(error.value) for word in words)


BY_HAND = {
    "pose": [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
    "motion_from": [0, 1],
    "motion_to": [1, 2],
    "motion": [[1, 0, 0], [1, 0, 0]],
    "motion_information": [np.eye(3).tolist()] * 2,
    "fixed": [True, False, False],
}


def test_a_graph_may_be_given_as_lists() -> None:
    graph = PoseGraph(**BY_HAND).check()
    assert optimise(graph).cost == 0
    alone = {"pose": [[0, 0, 0]], "motion_from": [], "motion_to": [], "fixed": [1]}
    empty = {
        "motion": np.zeros((0, 3)),
        "motion_information": np.zeros((0, 3, 3)),
        "near_from": [],
        "near_to": [],
    }
    np.testing.assert_array_equal(optimise(PoseGraph(**alone, **empty)).pose, [[0, 0, 0]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pose": [[0, 0, 0], [1, 0], [2, 0, 0]]}, ["pose", "no array", "one length"]),
        ({"pose": [["a", 0, 0], [1, 0, 0], [2, 0, 0]]}, ["pose", "no numbers"]),
        ({"pose": [[None, 0, 0], [1, 0, 0], [2, 0, 0]]}, ["pose", "no numbers"]),
        ({"motion_from": [0.0, 1.0]}, ["motion_from", "integers"]),
        ({"motion_from": ["0", "1"]}, ["motion_from", "no numbers"]),
        ({"motion_to": [1, 3]}, ["edge 1", "poses 1 and 3"]),
        ({"fixed": [0.3, 0, 0]}, ["fixed[0]", "0.3 is neither true nor false"]),
        ({"fixed": [True, False, np.nan]}, ["fixed[2]", "not a finite number"]),
        ({"loop": [0, 2]}, ["loop[1]", "2 is neither"]),
        ({"fixed": True}, ["fixed", "its shape is ()"]),
    ],
)
def test_graphs_that_cannot_be_are_refused(change, words) -> None:
    with pytest.raises(InputError) as error:
        PoseGraph(**{**BY_HAND, **change}).check()
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize("call", [optimise, cost, DeadReckoning().solve, LevenbergMarquardt().solve])
def test_the_name_of_a_file_is_no_graph(call) -> None:
    more = () if call in (optimise, cost) else (np.random.default_rng(0),)
    with pytest.raises(InputError, match=r"it is a str, not a PoseGraph.*g2o\.read"):
        call("x.g2o", *more)


@pytest.mark.parametrize("iterations", [np.nan, None, "a", np.inf, 0, 2.5, True])
def test_iterations_are_a_whole_number(iterations) -> None:
    graph = PoseGraph(**BY_HAND)
    for call in (
        lambda: optimise(graph, iterations=iterations),
        lambda: LevenbergMarquardt(iterations=iterations).solve(graph, np.random.default_rng(0)),
    ):
        with pytest.raises(InputError, match=r"iterations=.* whole number from 1"):
            call()


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (LevenbergMarquardt, {"near_sigma_m": "1"}),
        (LevenbergMarquardt, {"near_sigma_m": 0.0}),
        (LevenbergMarquardt, {"d_min_m": "2"}),
        (LevenbergMarquardt, {"tolerance": None}),
        (LevenbergMarquardtRobust, {"near_scale_m": -1.0}),
        (LevenbergMarquardtRobust, {"loop_scale": np.nan}),
    ],
)
def test_settings_are_refused_under_their_own_names(make, options) -> None:
    ((name, value),) = options.items()
    with pytest.raises(InputError, match=re.escape(f"{name}={value!r}: ")):
        make(**options).solve(PoseGraph(**BY_HAND), np.random.default_rng(0))


@given(turn=angles, x=lengths, y=lengths)
def test_a_true_answer_in_any_frame_has_no_error_and_no_truth_gives_none(
    turn: float, x: float, y: float
) -> None:
    place_m = drawn()[1][:, :2]
    asked_m = np.where(np.arange(len(place_m))[:, None] % 3 == 0, place_m, np.nan)
    one_m = np.where(np.arange(len(place_m))[:, None] == 3, place_m, np.nan)
    estimate_m = rotated(place_m, turn) + np.array([x, y])
    columns = pose_graph.score(
        {"position_m": np.stack([estimate_m] * 3)},
        {"truth.position_m": np.stack([asked_m, np.full_like(asked_m, np.nan), one_m])},
    )
    error_m = columns["error_m"]
    np.testing.assert_array_equal(np.isfinite(error_m[0]), np.isfinite(asked_m[:, 0]))
    assert np.nanmax(error_m[0]) < 1e-9
    # One known place could be fitted without any error: it tells nothing.
    assert np.isnan(error_m[1:]).all()


def test_the_error_is_what_the_best_fit_leaves() -> None:
    true_m = np.array([[[0.0, 0], [2, 0], [4, 0], [6, 0]]])
    estimate_m = true_m + np.array([[0, 1.0], [0, -1], [0, -1], [0, 1]])
    columns = pose_graph.score({"position_m": estimate_m + 7}, {"truth.position_m": true_m})
    np.testing.assert_allclose(columns["error_m"], 1.0)
    np.testing.assert_allclose(columns["error_y_m"], [[1, -1, -1, 1]])


# Measures and table


def test_every_answer_is_measured_with_the_same_cost() -> None:
    graph, truth = drawn(5)
    observed_arrays = {"world": np.arange(1), **observed(graph)}
    worlds = {
        "d/00000/observed.npz": {"town": observed_arrays},
        "d/00000/truth.npz": {"town": {"world": np.arange(1), "truth.position_m": truth[None, :, :2]}},
    }
    trees = {}
    for row in ("dead_reckoning", "levenberg_marquardt", "levenberg_marquardt_robust"):
        outcome = pose_graph.run(
            lambda row=row: made(row), observed(graph), None, {}, [np.random.default_rng(0)]
        )
        step = {f"estimate.{name}": values for name, values in outcome.estimates.items()}
        step |= {"world": np.arange(1), "value": np.array(np.nan), "skipped": np.array("")}
        trees[f"estimates/{row}/00000.npz"] = {"town/0": step}
    found = measures(trees, worlds).pivot_table(index="algorithm", columns="metric", values="x")
    start = cost(graph, near=NEAR)
    np.testing.assert_allclose(found["cost_start"], sum(start))
    assert found.loc["dead_reckoning", "cost"] == pytest.approx(sum(start))
    assert found.loc["dead_reckoning", "cost_near"] == pytest.approx(start[1])
    assert found.loc["levenberg_marquardt", "cost"] == found["cost"].min()
    assert found.loc["levenberg_marquardt_robust", "cost"] > found["cost"].min()
    np.testing.assert_allclose(found["cost_motion"] + found["cost_near"], found["cost"])
    assert found.loc["levenberg_marquardt", "iterations"] > 0


def test_the_table_says_where_nobody_knows_the_truth() -> None:
    lines = [("blind", row, np.nan, 0, "cost", 3.0) for row in ("a", "b")]
    lines += [("seen", row, np.nan, 0, "cost", 3.0) for row in ("a", "b")]
    merits = ("n", "mean_m", "se_m", "rmse_m", "p50_m", "p75_m", "p90_m", "p95_m", "max_m")
    lines += [("seen", "a", np.nan, 0, metric, 1.0) for metric in merits]
    frame = pd.DataFrame(lines, columns=MEASURES)
    found = table(frame, ["a", "b", "c"], ["blind", "seen"], {("blind", "c"): "absent"}, {})
    notes = found.set_index(["family", "algorithm"])["note"]
    assert notes["blind", "a"] == notes["blind", "b"] == NO_TRUTH
    assert notes["blind", "c"] == "absent"
    assert notes["seen", "a"] == ""
    # With a truth at hand, a row without errors has no answer.
    assert notes["seen", "b"] == notes["seen", "c"] == NO_ANSWER
    assert found.loc[found["family"] == "blind", "mean_m"].isna().all()
    blind = table(frame[frame["family"] == "blind"], ["a"], ["blind"], {}, {})
    assert blind["note"].tolist() == [NO_TRUTH]
    errors = pd.DataFrame({"family": ["seen"] * 2, "world": 0, "sample": [0, 1], "error_m": [1.0, 2.0]})
    pairs = paired({"a": errors, "b": errors}, ["a", "b"], ["blind", "seen"])
    assert set(pairs["family"]) == {"seen"}
