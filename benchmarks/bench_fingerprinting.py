"""Time of a leave-one-out of every fingerprinting algorithm on one world of 257 points and 6 access points.

Run with ``pytest benchmarks/bench_fingerprinting.py``.
"""

import pkgutil
from typing import Any

import numpy as np
import pytest

import algorithms.fingerprinting
from positioning.model import Site, Survey, Truth
from positioning.registry import factory
from positioning.tasks.fingerprinting import leave_one_out

ALGORITHMS = sorted(module.name for module in pkgutil.iter_modules(algorithms.fingerprinting.__path__))
POINTS, ACCESS_POINTS, SIZE_M, GRID_M, FLOOR_DBM, NOISE_DB = 257, 6, (30.0, 25.0), 1.5, -93.0, 4.5


def world() -> tuple[Survey, Site, Truth]:
    """Return a log-distance world with parallel walls."""
    rng = np.random.default_rng(20)
    axes = [np.arange(GRID_M / 2, size_m, GRID_M) for size_m in SIZE_M]
    place_m = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    position_m = place_m[np.sort(rng.choice(len(place_m), POINTS, replace=False))]
    access_point_m = rng.uniform((0.0, 0.0), SIZE_M, (ACCESS_POINTS, 2))
    wall_x_m = np.linspace(1.1, SIZE_M[0] - 1.1, 40)
    wall_m = np.stack([np.stack([[x, 0.0], [x, SIZE_M[1] * rng.uniform()]]) for x in wall_x_m])
    distance_m = np.linalg.norm(position_m[:, None] - access_point_m, axis=-1)
    field_dbm = -35.0 - 33.0 * np.log10(np.maximum(distance_m, 0.5)) + rng.normal(0.0, 4.0, distance_m.shape)
    rss_dbm = np.round(field_dbm + rng.normal(0.0, NOISE_DB, field_dbm.shape))
    rss_dbm = np.where(rss_dbm < FLOOR_DBM, np.nan, rss_dbm)
    site = Site(corner_m=np.array([(0.0, 0.0), SIZE_M]), access_point_m=access_point_m, wall_m=wall_m)
    truth = Truth(
        position_m=position_m,
        field_dbm=field_dbm,
        noise_db=np.array(NOISE_DB),
        floor_dbm=np.array(FLOOR_DBM),
    )
    return Survey(rss_dbm=rss_dbm, position_m=position_m), site, truth


@pytest.mark.parametrize("name", ALGORITHMS)
def test_leave_one_out(benchmark: Any, name: str) -> None:
    """Locate every point of the world with the others."""
    survey, site, truth = world()
    make = factory(name, "fingerprinting", {})
    benchmark.pedantic(
        lambda: leave_one_out(make(site=site, truth=truth, random_state=1), survey, None),
        rounds=3,
        warmup_rounds=1,
    )
