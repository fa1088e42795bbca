"""Time of choosing four columns of a map, on one core, as rows and columns of the map grow.

The first size is that of Atia et al.; ``ns_per_product`` of ``--benchmark-json`` is the time divided by rows
times squared columns. Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest
benchmarks/bench_orthogonal_search.py``.
"""

from typing import Any

import numpy as np
import pytest

from algorithms.access_points.principal_components import PrincipalComponents
from positioning.model import Array
from positioning.orthogonal_search import orthogonal_search

SIZES = [(67, 132), (250, 132), (500, 250), (1000, 500), (2000, 500), (2000, 1000)]
COLUMNS, FLOOR_DBM, NOT_HEARD_DBM = 4, -88.0, -100.0


def world(places: int, access_points: int) -> Array:
    """Return the filled map of a log-distance world, [places, access points], dBm."""
    rng = np.random.default_rng(12)
    position_m, radio_m = rng.uniform(0, 30, (places, 2)), rng.uniform(-15, 45, (access_points, 2))
    distance_m = np.linalg.norm(position_m[:, None] - radio_m, axis=-1)
    rss_dbm = -35 - 32 * np.log10(np.maximum(distance_m, 1)) + rng.normal(0, 4, distance_m.shape)
    return np.where(rss_dbm < FLOOR_DBM, NOT_HEARD_DBM, np.round(rss_dbm))


def measure(benchmark: Any, rows: int, columns: int, choose: Any) -> None:
    """Time a choice, and note its time by multiplication of the correlations."""
    matrix = world(rows, columns)
    benchmark.pedantic(lambda: choose(matrix), rounds=7, warmup_rounds=1)
    # None where timing is switched off.
    if benchmark.stats is not None:
        products = rows * columns**2
        benchmark.extra_info["ns_per_product"] = 1e9 * benchmark.stats.stats.median / products


@pytest.mark.parametrize(("rows", "columns"), SIZES)
def test_total(benchmark: Any, rows: int, columns: int) -> None:
    """Choose by the largest reduction."""
    measure(benchmark, rows, columns, lambda matrix: orthogonal_search(matrix, COLUMNS))


@pytest.mark.parametrize(("rows", "columns"), SIZES[:1])
def test_threshold(benchmark: Any, rows: int, columns: int) -> None:
    """Choose in one pass, with the search for its threshold."""
    measure(benchmark, rows, columns, lambda matrix: orthogonal_search(matrix, COLUMNS, method="threshold"))


@pytest.mark.parametrize(("rows", "columns"), SIZES[::5])
def test_principal_components(benchmark: Any, rows: int, columns: int) -> None:
    """Find the principal components of the same map."""
    measure(benchmark, rows, columns, lambda matrix: PrincipalComponents(columns=COLUMNS).fit(matrix))
