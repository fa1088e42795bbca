"""The adapter of published pose graphs: facts of the files, integrated odometry, defects, refusals."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.posegraph.residuals import move, relative_pose
from positioning.recordings import pose_graphs
from positioning.recordings.pose_graphs import LOG, NAMES, TRUTH, integrated, load
from positioning.recordings.register import find_file, read_register
from positioning.tasks.pose_graph import graph_of

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
GRAPHS = REALDATA / "pose_graphs"
needs_graphs = pytest.mark.skipif(not GRAPHS.is_dir(), reason=f"no {GRAPHS} (REPOSITION_REALDATA)")


def one(name: str, **options: float):
    worlds = load(GRAPHS, name=name, **options)
    return graph_of({key: v[0] for key, v in worlds.observed.items()}), worlds


# Files


@needs_graphs
@pytest.mark.parametrize(
    ("name", "poses", "motions", "loops", "pairs"),
    [("intel", 1228, 1483, 256, 0), ("m3500", 3500, 5453, 1954, 0), ("corridor", 872, 871, 0, 10019)],
)
def test_sizes_are_those_of_the_files(name: str, poses: int, motions: int, loops: int, pairs: int) -> None:
    graph, worlds = one(name)
    assert graph.pose.shape == (poses, 3)
    assert len(graph.motion) == motions
    assert graph.loop.sum() == loops
    assert len(graph.near_from) == pairs
    assert graph.fixed.nonzero()[0].tolist() == [0]
    true_m = worlds.truth["truth.position_m"]
    assert true_m.shape == (1, poses, 2)
    assert np.isfinite(true_m).all(axis=-1).sum() == (871 if name == "corridor" else 0)
    assert all(len(values) == 1 for values in (*worlds.observed.values(), *worlds.truth.values()))


@needs_graphs
def test_the_register_has_the_files_that_are_read_and_no_other(monkeypatch) -> None:
    read = set()

    def noted(where, file):
        read.add(file)
        return find_file(where, file)

    monkeypatch.setattr(pose_graphs, "find_file", noted)
    for name in NAMES:
        load(GRAPHS, name=name)
    records = [record for record in read_register() if record.source == "pose_graphs"]
    assert read == {record.file for record in records}
    assert {r.file: r.kind for r in records}["M3500.txt"] == "synthetic"


@needs_graphs
def test_the_corridor_is_what_its_description_says() -> None:
    graph, worlds = one("corridor")
    true_m = worlds.truth["truth.position_m"][0]
    apart_m = np.linalg.norm(true_m[graph.near_from] - true_m[graph.near_to], axis=-1)
    known = np.isfinite(apart_m)
    near = apart_m[known] < 1
    score = graph.near_weight[known]
    assert near.mean() == pytest.approx(0.22, abs=0.01)
    assert near[score >= 0.1].mean() == pytest.approx(0.43, abs=0.01)
    assert near[score >= 0.5].mean() == pytest.approx(0.72, abs=0.01)
    # Poses are dead reckoning, so that the motions lead from each to the next.
    np.testing.assert_allclose(move(graph.pose[:-1], graph.motion), graph.pose[1:], atol=1e-9)
    # Short pieces of it agree with the truth; the whole does not.
    step_m = np.linalg.norm(np.diff(true_m[:-1], axis=0), axis=-1)
    assert np.hypot(*graph.motion[:-1, :2].T).sum() == pytest.approx(step_m.sum(), rel=0.05)
    interval_s = np.diff(worlds.observed["graph.time_s"][0])
    assert 1.5 < interval_s.min() < np.median(interval_s) < 2.5
    # A standstill has the noise of its readings alone: 0.05 m/s each tenth of a second.
    still = np.argmin(np.abs(graph.motion).sum(axis=1))
    deviation = np.sqrt(np.diagonal(np.linalg.inv(graph.motion_information[still])))
    np.testing.assert_allclose(
        deviation, np.sqrt(interval_s[still] / 0.1) * np.array([5e-3, 5e-3, 1e-3]), rtol=1e-3
    )


@needs_graphs
def test_a_higher_score_keeps_fewer_pairs_and_the_same_poses() -> None:
    (everything, _), (some, _) = one("corridor"), one("corridor", least_score=0.5)
    np.testing.assert_array_equal(everything.pose, some.pose)
    assert len(some.near_from) == 798
    assert some.near_weight.min() >= 0.5
    kept = everything.near_weight >= 0.5
    np.testing.assert_array_equal(everything.near_to[kept], some.near_to)


# Integration


def steps(count: int):
    return st.lists(
        st.tuples(st.floats(0.05, 0.5), st.floats(-1, 1), st.floats(-0.3, 0.3), st.floats(-1, 1)),
        min_size=count,
        max_size=count,
    )


@settings(max_examples=50, deadline=None)
@given(readings=steps(12), share=st.floats(0.05, 0.95))
def test_key_poses_between_readings_change_no_way(readings, share: float) -> None:
    values = np.array(readings)
    time_s = np.concatenate([[0.0], np.cumsum(values[:-1, 0])])
    rate, variance = values[:, 1:], np.full((12, 3), 1e-4)
    # Straight pieces: a key pose in the middle of a turn would change the chord.
    rate[:, 2] = 0.0
    ends_s = np.array([0.0, time_s[-1] + 0.3])
    middle_s = share * ends_s[1]
    whole = integrated(ends_s, time_s, rate, variance)
    parts = integrated(np.array([0.0, middle_s, ends_s[1]]), time_s, rate, variance)
    np.testing.assert_allclose(parts.motion.sum(axis=0), whole.motion[0], atol=1e-12)
    # Errors of both parts together, the turn of the first one with the lever of the second.
    lever = np.eye(3)
    lever[0, 2], lever[1, 2] = -parts.motion[1, 1], parts.motion[1, 0]
    joined = lever @ parts.covariance[0] @ lever.T + parts.covariance[1]
    # The turn error of the piece that is cut acts from its beginning: a little farther away.
    np.testing.assert_allclose(joined, whole.covariance[0], atol=2e-4)


def test_a_quarter_circle_by_hand() -> None:
    # One metre a second for one second, while turning a quarter: chord along the mean heading.
    found = integrated(
        np.array([0.0, 1.0]),
        np.array([0.0, 1.0]),
        np.array([[1.0, 0.0, np.pi / 2], [9.0, 9.0, 9.0]]),
        np.full((2, 3), 1e-6),
    )
    np.testing.assert_allclose(found.motion, [[np.sqrt(0.5), np.sqrt(0.5), np.pi / 2]], atol=1e-12)


def test_the_covariance_is_that_of_many_drives() -> None:
    rng = np.random.default_rng(0)
    time_s = 0.1 * np.arange(40)
    rate = np.stack([np.full(40, 1.0), np.full(40, 0.1), 0.5 * np.sin(time_s)], axis=-1)
    variance = np.tile([0.04, 0.01, 0.02], (40, 1))
    key_s = np.array([0.0, 1.5, 4.0])
    expected = integrated(key_s, time_s, rate, variance)
    drives = np.stack(
        [
            integrated(key_s, time_s, rate + rng.normal(0, np.sqrt(variance)), variance).motion
            for _ in range(3000)
        ]
    )
    offset = drives - expected.motion
    for edge in range(2):
        covariance = np.cov(offset[:, edge].T)
        np.testing.assert_allclose(covariance, expected.covariance[edge], atol=0.1 * covariance.max())


# Defects and refusals

GOOD_LOG = ["odom2 0 1 0 0 0.01 0.01 0.01", "odom2 1 1 0 0 0.01 0.01 0.01", "odom2 2 1 0 0 0.01 0.01 0.01"]
GOOD_LOG += ["loop 2 0.5 0.25", "loop 3 0.5 0.75"]
GOOD_TRUTH = ["point2 0 0 0 0 0 0 0", "point2 2 2 0 0 0 0 0", "angle 0 0 0", "angle 2 0 0"]


def written(folder: Path, log: list[str], truth: list[str]) -> Path:
    (folder / LOG).write_text("\n".join(log) + "\n")
    (folder / TRUTH).write_text("\n".join(truth) + "\n")
    return folder


def test_a_small_log_by_hand(tmp_path: Path) -> None:
    worlds = load(written(tmp_path, GOOD_LOG, GOOD_TRUTH), name="corridor")
    observed = {name: values[0] for name, values in worlds.observed.items()}
    np.testing.assert_array_equal(observed["graph.time_s"], [0.5, 2, 3])
    np.testing.assert_allclose(observed["graph.position_m"], [[0, 0], [1.5, 0], [2.5, 0]], atol=1e-12)
    np.testing.assert_allclose(observed["graph.motion"], [[1.5, 0, 0], [1.0, 0, 0]], atol=1e-12)
    pairs = np.stack([observed["graph.near_from"], observed["graph.near_to"]], axis=-1)
    np.testing.assert_array_equal(pairs, [[0, 1], [0, 2]])
    np.testing.assert_array_equal(observed["graph.near_weight"], [0.25, 0.75])
    np.testing.assert_allclose(worlds.truth["truth.position_m"][0], [[0.5, 0], [2, 0], [np.nan, np.nan]])
    start, end = (np.append(observed["graph.position_m"][i], 0.0) for i in (0, 1))
    np.testing.assert_allclose(relative_pose(start, end), observed["graph.motion"][0], atol=1e-12)


@pytest.mark.parametrize(
    ("log", "truth", "words"),
    [
        ([*GOOD_LOG, "loop 3 x 1"], GOOD_TRUTH, [LOG, "line 6", "'x'"]),
        ([*GOOD_LOG, "loop 3 1"], GOOD_TRUTH, [LOG, "line 6", "2 values, not 3"]),
        ([*GOOD_LOG, "imu 3 1"], GOOD_TRUTH, ["line 6", "imu is none of odom2, loop"]),
        ([*GOOD_LOG, "loop 4 nan 1"], GOOD_TRUTH, ["line 6", "not finite"]),
        (GOOD_LOG[:3], GOOD_TRUTH, [LOG, "no line loop"]),
        ([GOOD_LOG[1], GOOD_LOG[0], *GOOD_LOG[3:]], GOOD_TRUTH, ["lines odom2 does not increase"]),
        (
            GOOD_LOG,
            [GOOD_TRUTH[0], GOOD_TRUTH[0], *GOOD_TRUTH[2:]],
            [TRUTH, "lines point2 does not increase"],
        ),
    ],
)
def test_broken_files_are_named_with_their_line(tmp_path: Path, log, truth, words) -> None:
    with pytest.raises(InputError) as error:
        load(written(tmp_path, log, truth), name="corridor")
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"name": "kitti"}, ["option name", "'kitti'", "intel, m3500, corridor"]),
        ({"name": "intel", "least_score": 0.5}, ["least_score", "intel has no scores"]),
        ({"name": "corridor", "least_score": 1.5}, ["least_score", "1.5 is no score"]),
        ({"name": "corridor", "least_score": float("nan")}, ["least_score", "nan is no score"]),
        ({}, ["intel.g2o", "no such file"]),
        ({"name": "corridor"}, [LOG, "no such file"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path: Path, options, words) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, **options)
    assert all(word in str(error.value) for word in words)


def test_a_score_that_nothing_reaches_is_refused(tmp_path: Path) -> None:
    folder = written(tmp_path, GOOD_LOG, GOOD_TRUTH)
    assert load(folder, name="corridor", least_score=0.5).observed["graph.near_from"].shape == (1, 1)
    with pytest.raises(InputError, match=r"no candidate has a score of 0\.9"):
        load(folder, name="corridor", least_score=0.9)
