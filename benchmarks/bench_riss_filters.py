"""Milliseconds that the particle filters need for an epoch of a world, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_riss_filters.py -s``; it prints
the times and the weights that were computed. The fixes are there already: all time is the filter's.
"""

from typing import Any

import numpy as np
import pytest

from positioning.filters.mixture import Drive, Mixture, SystemNoise, filter_drive, median_cut, start_at_rest

WORLDS, EPOCHS, PARTICLES, LIMIT_MS = 20, 100, 1000, 1.0
KINDS = {
    "plain": Mixture(),
    "mixture": Mixture(from_wifi=0.2, fix_sigma_m=2.0),
    "fast mixture": Mixture(from_wifi=0.2, fix_sigma_m=2.0, clusters=200),
}


def drives() -> Drive:
    """Return drives in a circle with a fix at every epoch."""
    rng = np.random.default_rng(1)
    turn_rad, forward_m = np.full((WORLDS, EPOCHS), 0.06), np.full((WORLDS, EPOCHS), 0.7)
    heading_rad = np.cumsum(turn_rad, axis=1)
    path_m = np.cumsum(
        forward_m[..., None] * np.stack([np.cos(heading_rad), np.sin(heading_rad)], -1), axis=1
    )
    fix_m = path_m + 2.0 * rng.standard_normal(path_m.shape)
    time_s = np.tile(np.arange(float(EPOCHS)), (WORLDS, 1))
    start = start_at_rest(
        time_s,
        np.ones((WORLDS, EPOCHS), dtype=bool),
        fix_m,
        path_m,
        heading_rad=np.zeros(WORLDS),
        sigma_m=2.0,
        heading_sigma_rad=0.05,
    )
    return Drive(time_s, turn_rad, forward_m, np.zeros((WORLDS, EPOCHS)), fix_m, start)


@pytest.mark.parametrize("kind", KINDS)
def test_epoch(benchmark: Any, kind: str) -> None:
    """Filter 20 worlds of 100 epochs with 1,000 samples in lock-step."""
    drive = drives()

    def run() -> Any:
        return filter_drive(
            drive,
            [np.random.default_rng(number) for number in range(WORLDS)],
            particles=PARTICLES,
            scale_m=1.0,
            noise=SystemNoise(0.01, 0.1),
            mixture=KINDS[kind],
        )

    found = benchmark.pedantic(run, rounds=5, warmup_rounds=1)
    epoch_ms = 1e3 * benchmark.stats.stats.median / (WORLDS * EPOCHS)
    evaluations = found.extra["weight_evaluations"][0, -1]
    print(f"\n{kind}: {epoch_ms:.3f} ms an epoch and world, {evaluations:.0f} weights an epoch")
    assert epoch_ms < LIMIT_MS


def test_median_cut(benchmark: Any) -> None:
    """Divide 1,000 samples of 20 worlds into 200 clusters."""
    position_m = np.random.default_rng(2).normal(0, 2, (WORLDS, 2, PARTICLES))
    benchmark.pedantic(median_cut, args=(position_m, 200), rounds=20, warmup_rounds=2)
    print(f"\nmedian cut: {1e3 * benchmark.stats.stats.median / WORLDS:.3f} ms a world")
