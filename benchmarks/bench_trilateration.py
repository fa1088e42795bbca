"""Triplets a second of every trilateration algorithm, on one core.

20,000 triplets of a room of 6 x 8 m with the three beacons of Fig. 4 of Raghavan et al.; iterations run to
the printed stop rule. Run with ``OMP_NUM_THREADS=1 pytest benchmarks/bench_trilateration.py``; with
``--benchmark-json``, ``extra_info`` of the file holds the triplets a second.
"""

import importlib
import pkgutil
from typing import Any

import numpy as np
import pytest

import algorithms.trilateration
from positioning.model import Array
from positioning.registry import class_name

NAMES = sorted(module.name for module in pkgutil.iter_modules(algorithms.trilateration.__path__))
BEACON_M = np.array([(1.72, 0.35), (1.79, 5.63), (3.05, 2.61)])
TRIPLETS, ERROR_M, SHORTEST_M = 20_000, 0.948, 0.5
# One by one: some hundred are enough to time it.
SLOW = {"least_squares": 1_000}


def triplets(count: int) -> Array:
    """Return distances, [count, 3], metres, whose mean absolute error is near that of Table I."""
    rng = np.random.default_rng(7)
    place_m = rng.uniform((0.0, 0.0), (6.0, 8.0), (count, 2))
    exact_m = np.linalg.norm(place_m[:, None] - BEACON_M, axis=-1)
    noise_m = rng.normal(0.0, ERROR_M * np.sqrt(np.pi / 2.0), exact_m.shape)
    return np.maximum(exact_m + noise_m, SHORTEST_M)


@pytest.mark.parametrize("name", NAMES)
def test_solve(benchmark: Any, name: str) -> None:
    """Solve all triplets in one call."""
    cls = getattr(importlib.import_module(f"algorithms.trilateration.{name}"), class_name(name))
    count = SLOW.get(name, TRIPLETS)
    range_m, solver = triplets(count), cls()
    benchmark.pedantic(lambda: solver.solve(BEACON_M, range_m), rounds=3, warmup_rounds=1)
    iterations = getattr(solver, "iterations_", np.zeros(count))
    benchmark.extra_info["triplets_per_second"] = round(count / benchmark.stats.stats.min)
    benchmark.extra_info["mean_iterations"] = float(np.mean(iterations[iterations >= 0]))
    benchmark.extra_info["not_converged_part"] = float(np.mean(iterations < 0))
