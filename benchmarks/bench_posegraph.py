"""Time of all-pairs distances, of one world's optimisation, and of a published graph, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_posegraph.py``; ``-s`` shows the
costs. Where gtsam can be imported (it is no dependency), its Levenberg-Marquardt runs on the published graph
in the same process; its error is the logarithm of the contradiction, so that only small residuals compare.
"""

import os
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from positioning.model import Array
from positioning.posegraph.costs import COSTS, Cost, NearCost
from positioning.posegraph.g2o import read, write
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.optimiser import optimise
from positioning.posegraph.residuals import MOTION_INFORMATION, move, relative_pose
from positioning.posegraph.similarity import rss_distance_db

CHECKOUT = Path(__file__).parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
MANHATTAN = REALDATA / "pose_graphs" / "M3500.txt"
SCANS, ACCESS_POINTS = 2_700, 70
WALKS, POSES, STEP_M, BLOCK_M, PAIR_M = 5, 880, 1.27, 35.0, 8.0
HEADING_NOISE_RAD, HEADING_DRIFT_RAD, STEP_NOISE_M = 0.01, 1e-4, 0.02
MOST_DISTANCE_S, MOST_BYTES, MOST_OPTIMISE_S, MOST_TIMES_GTSAM = 1.5, 500e6, 4.0, 3.0


def corridor_walk(rng: np.random.Generator) -> Array:
    """Return poses of a walk through the corridors of a building of 4 x 2 blocks, [POSES, 3]."""
    turns = ((1, 0), (-1, 0), (0, 1), (0, -1))
    crossings = [np.array([rng.integers(5), rng.integers(3)])]
    while len(crossings) < POSES * STEP_M / BLOCK_M + 2:
        ahead = [crossings[-1] + turn for turn in turns]
        ahead = [c for c in ahead if 0 <= c[0] < 5 and 0 <= c[1] < 3 and (c != crossings[-2:][0]).any()]
        crossings.append(ahead[rng.integers(len(ahead))])
    corner_m = np.array(crossings) * BLOCK_M
    along_m = np.arange(POSES) * STEP_M
    place_m = np.stack([np.interp(along_m, np.arange(len(corner_m)) * BLOCK_M, c) for c in corner_m.T], -1)
    place_m += rng.normal(0.0, 0.2, place_m.shape)
    offset_m = np.diff(place_m, axis=0, append=2 * place_m[-1:] - place_m[-2:-1])
    return np.column_stack([place_m, np.unwrap(np.arctan2(offset_m[:, 1], offset_m[:, 0]))])


def world(pairs: int) -> tuple[PoseGraph, Array]:
    """Return five walks of dead reckoning with proximity edges, and the true poses."""
    rng = np.random.default_rng(7)
    truth = np.concatenate([corridor_walk(rng) for _ in range(WALKS)])
    number = np.arange(len(truth))
    end = number[number % POSES > 0]
    motion = relative_pose(truth[end - 1], truth[end])
    motion[:, :2] += rng.normal(0.0, STEP_NOISE_M, (len(end), 2))
    motion[:, 2] += HEADING_DRIFT_RAD + rng.normal(0.0, HEADING_NOISE_RAD, len(end))
    start = truth.copy()
    for k, step in zip(end, motion, strict=True):
        start[k] = move(start[k - 1], step)
    near = cKDTree(truth[:, :2]).query_pairs(PAIR_M, output_type="ndarray")
    near = near[(near[:, 1] - near[:, 0] > 40) | (near[:, 0] // POSES != near[:, 1] // POSES)]
    near = near[rng.choice(len(near), min(pairs, len(near)), replace=False)]
    graph = PoseGraph(
        pose=start,
        motion_from=end - 1,
        motion_to=end,
        motion=motion,
        motion_information=np.broadcast_to(MOTION_INFORMATION, (len(end), 3, 3)),
        near_from=near[:, 0],
        near_to=near[:, 1],
        fixed=number == 0,
    )
    return graph, truth


def scans() -> Array:
    rng = np.random.default_rng(1)
    rss = np.round(rng.uniform(-100, -40, (SCANS, ACCESS_POINTS)))
    return np.where(rng.random(rss.shape) < 0.6, np.nan, rss)


def test_all_pairs(benchmark: Any) -> None:
    """Compute the distance of all pairs of 2,700 scans of 70 access points."""
    rss = scans()
    benchmark.pedantic(lambda: rss_distance_db(rss), rounds=3, warmup_rounds=1)
    tracemalloc.start()
    rss_distance_db(rss)
    benchmark.extra_info["bytes"] = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert benchmark.extra_info["bytes"] < MOST_BYTES
    assert benchmark.stats.stats.min < MOST_DISTANCE_S


@pytest.mark.parametrize("weight", [1e-4, 1e-2, 1.0])
@pytest.mark.parametrize("cost", COSTS)
@pytest.mark.parametrize("pairs", [64_000, 96_000])
def test_one_world(benchmark: Any, pairs: int, cost: Cost, weight: float) -> None:
    """Optimise 4,400 poses."""
    graph, truth = world(pairs)
    assert len(graph.near_from) == pairs
    near = NearCost(weight=weight, cost=cost)
    found = benchmark.pedantic(lambda: optimise(graph, near=near), rounds=2)
    error_m = np.linalg.norm((found.pose - truth)[:, :2], axis=-1)
    benchmark.extra_info |= {"iterations": found.iterations, "reason": found.reason}
    print(f"\n{found[1:]}, mean error {error_m.mean():.2f} m")
    assert benchmark.stats.stats.min < MOST_OPTIMISE_S


@pytest.mark.skipif(not MANHATTAN.is_file(), reason=f"no {MANHATTAN} (REPOSITION_REALDATA)")
def test_manhattan_world(benchmark: Any, tmp_path: Path) -> None:
    """Optimise a graph of 3,500 poses and 5,453 edges from its own start, and compare with gtsam."""
    graph = read(MANHATTAN)
    found = benchmark.pedantic(lambda: optimise(graph), rounds=5, warmup_rounds=1)
    print(f"\n{found[1:]}")
    try:
        import gtsam
    except ImportError:
        pytest.skip("gtsam cannot be imported: nothing to compare with")
    write(tmp_path / "graph.g2o", graph)
    factors, start = gtsam.readG2o(str(tmp_path / "graph.g2o"), False)
    held = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
    factors.add(gtsam.PriorFactorPose2(0, start.atPose2(0), held))
    seconds = []
    for _ in range(5):
        begin = time.perf_counter()
        optimiser = gtsam.LevenbergMarquardtOptimizer(factors, start, gtsam.LevenbergMarquardtParams())
        values = optimiser.optimize()
        seconds.append(time.perf_counter() - begin)
    peer = 2.0 * factors.error(values)
    print(f"gtsam: cost {peer}, {optimiser.iterations()} iterations, {min(seconds):.3f} s")
    benchmark.extra_info["gtsam_seconds"] = min(seconds)
    assert found.cost == pytest.approx(peer, rel=1e-3)
    assert benchmark.stats.stats.min < MOST_TIMES_GTSAM * min(seconds)
