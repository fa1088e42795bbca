"""IMU samples a second through the whole foot filter, 40 worlds in lock-step, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_foot_filter.py -s``; it prints the
rates.
"""

from typing import Any

import numpy as np
import pytest

from positioning.inertial.foot import foot_navigation
from positioning.inertial.foot_alignment import rests
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.strapdown import attitude_of, readings
from positioning.model import Recording, Site

WORLDS, RATE_HZ, STRIDES, STRIDE_S, REST_S = 40, 100.0, 60, 1.1, 2.0


def world() -> tuple[Recording, Site]:
    """Return feet that walk straight ahead, each with its own phase and noise."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, REST_S + STRIDES * STRIDE_S, 1 / RATE_HZ)
    since = np.maximum(time_s - REST_S - rng.uniform(0, STRIDE_S, (WORLDS, 1)), 0.0) % STRIDE_S
    phase = 2 * np.pi * np.minimum(since / 0.7, 1.0)
    zero = np.zeros_like(phase)
    velocity = np.stack([2.0 * (1 - np.cos(phase)), zero, np.sin(phase) * (1 - np.cos(phase))], axis=-1)
    attitude = attitude_of(zero, 0.8 * np.sin(phase) * (1 - np.cos(phase)) / 2, zero)
    force, rate = readings(velocity, attitude, 1 / RATE_HZ)
    field = (attitude[:, 1:].swapaxes(-1, -2) @ np.array([[20.0], [0.0], [-43.0]]))[..., 0]
    recording = Recording(
        time_s=np.tile(time_s[1::100], (WORLDS, 1)),
        imu_time_s=np.tile(time_s[1:], (WORLDS, 1)),
        specific_force_m_per_s2=(force + 0.02 * rng.standard_normal(force.shape)).astype(np.float32),
        angular_rate_rad_per_s=(rate + 0.01 * rng.standard_normal(force.shape)).astype(np.float32),
        magnetic_field_ut=(field + 0.5 * rng.standard_normal(force.shape)).astype(np.float32),
    )
    site = Site(corner_m=np.zeros((WORLDS, 2, 2)), magnetic_north_rad=np.zeros(WORLDS))
    return recording, site


@pytest.mark.parametrize(("states", "every_reading"), [(9, False), (9, True), (15, True)])
def test_foot_navigation(benchmark: Any, states: int, every_reading: bool) -> None:
    """Run detector, strapdown navigation, covariance, zero-velocity and heading updates.

    The rows of the studies ask for the answer where something is measured, not at every reading.
    """
    recording, site = world()
    found = benchmark.pedantic(
        foot_navigation,
        args=(recording, site, FootFilter(states=states)),
        kwargs={"every_reading": every_reading},
        rounds=3,
        warmup_rounds=1,
    )
    # Nearly all that is left where nothing else is asked for.
    assert 0.2 < found.rest.mean() < (0.8 if every_reading else 1.0)
    seconds, samples = benchmark.stats.stats.min, np.size(recording.imu_time_s)
    print(
        f"\n{states} states{', every reading' if every_reading else ''}: {seconds:.2f} s,"
        f" {samples / seconds:,.0f} samples a second,"
        f" {1e6 * seconds * WORLDS / samples:.0f} us a reading of {WORLDS} worlds"
    )


def test_detector(benchmark: Any) -> None:
    """Run the detector alone."""
    recording, _ = world()
    found = benchmark.pedantic(rests, args=(recording, FootFilter()), rounds=3, warmup_rounds=1)
    print(f"\ndetector: {found.size / benchmark.stats.stats.min:,.0f} samples a second")
