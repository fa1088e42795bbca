"""Particle updates a second, and the bank of Kalman filters on the same recordings, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_particle_filter.py -s``; it prints
the rates.
"""

from typing import Any

import numpy as np
import pytest

from algorithms.tracking.extended_kalman_filter import ExtendedKalmanFilter
from algorithms.tracking.particle_filter import ParticleFilter
from positioning.filters.particle_filter import gaussian_mixture_log_likelihood
from positioning.model import Array, Calibration, Recording, Site

RECORDINGS, EPOCHS, PARTICLES, FIXES, SIZE_M = 100, 20, 500, 20, (6.0, 8.0)


class Lookup:
    """Ranging and trilateration that cost nothing: all time is the filter's."""

    def __init__(self, fix_m: Array) -> None:
        self.fix_m = fix_m

    def fit(self, distance_m: Array, rss_dbm: Array) -> "Lookup":
        return self

    def distances(self, rss_dbm: Array) -> Array:
        """Return the number of the fix as the first beacon's candidates, and one for the others."""
        range_m = np.full((*rss_dbm.shape, FIXES), np.nan)
        range_m[..., 0] = 1.0
        range_m[..., 0, :] = rss_dbm[..., :1] + np.arange(FIXES)
        return range_m

    def solve(self, beacon_m: Array, range_m: Array) -> Array:
        return self.fix_m[np.rint(range_m[..., 0]).astype(int) - 1]


def world() -> tuple[Recording, Calibration, Site, Lookup]:
    """Return recordings with 20 fixes in every epoch, one of them near a straight drive."""
    rng = np.random.default_rng(1)
    fix_m = rng.uniform((0.0, 0.0), SIZE_M, (RECORDINGS, EPOCHS, FIXES, 2))
    path_m = np.stack([np.linspace(1.0, 5.0, EPOCHS), np.linspace(1.0, 7.0, EPOCHS)], axis=-1)
    fix_m[..., 0, :] = path_m + 0.5 * rng.standard_normal((RECORDINGS, EPOCHS, 2))
    number = 1.0 + FIXES * np.arange(RECORDINGS * EPOCHS).reshape(RECORDINGS, EPOCHS)
    advance_m = np.full((RECORDINGS, EPOCHS), np.linalg.norm(path_m[1] - path_m[0]))
    advance_m[:, 0] = 0.0
    still = np.zeros((RECORDINGS, EPOCHS))
    recording = Recording(
        time_s=np.tile(np.arange(float(EPOCHS)), (RECORDINGS, 1)),
        rss_dbm=np.repeat(number[..., None], 3, axis=-1),
        turn_before_rad=still,
        advance_m=advance_m,
        turn_after_rad=still,
    )
    site = Site(
        corner_m=np.tile([(0.0, 0.0), SIZE_M], (RECORDINGS, 1, 1)),
        access_point_m=np.tile([(1.72, 0.35), (1.79, 5.63), (3.05, 2.61)], (RECORDINGS, 1, 1)),
    )
    calibration = Calibration(distance_m=np.ones((RECORDINGS, 2)), rss_dbm=np.ones((RECORDINGS, 2)))
    return recording, calibration, site, Lookup(fix_m.reshape(-1, 2))


@pytest.mark.parametrize("name", ["particle_filter", "extended_kalman_filter"])
def test_track_stack(benchmark: Any, name: str) -> None:
    """Track 100 recordings of 20 epochs with 20 fixes each."""
    recording, calibration, site, lookup = world()
    algorithm: Any = (
        ParticleFilter(particles=PARTICLES, ranging=lookup, trilateration=lookup)
        if name == "particle_filter"
        else ExtendedKalmanFilter(ranging=lookup, trilateration=lookup)
    )

    def run() -> Any:
        rngs = [np.random.default_rng(n) for n in range(RECORDINGS)]
        return algorithm.track_stack(recording, calibration, site, rngs)

    found = benchmark.pedantic(run, rounds=5, warmup_rounds=1)
    assert (found.extra["fixes"] == FIXES).all()
    states = PARTICLES if name == "particle_filter" else algorithm.headings
    seconds = benchmark.stats.stats.median
    updates = RECORDINGS * EPOCHS * states / seconds
    print(
        f"\n{name}: {seconds:.3f} s, {updates:,.0f} {'particle' if states > 8 else 'filter'} updates a second"
    )


def test_log_likelihood(benchmark: Any) -> None:
    """Weigh 100 x 500 particles by the sum of 20 fixes."""
    rng = np.random.default_rng(2)
    position_m = rng.uniform((0.0, 0.0), SIZE_M, (RECORDINGS, PARTICLES, 2))
    fix_m = rng.uniform((0.0, 0.0), SIZE_M, (RECORDINGS, FIXES, 2))
    benchmark.pedantic(
        gaussian_mixture_log_likelihood, args=(position_m, fix_m, 1.0), rounds=20, warmup_rounds=2
    )
    rate = RECORDINGS * PARTICLES / benchmark.stats.stats.median
    print(f"\nlog-likelihood: {rate:,.0f} particles a second")
