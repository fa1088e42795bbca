"""Time of the RISS mechanisation and of the Kalman filter on 40 recordings of 20,000 readings, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_riss.py``.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from algorithms.tracking.riss import Riss
from algorithms.tracking.riss_kalman_filter import RissKalmanFilter
from positioning.inertial.riss import increments, mechanise
from positioning.inertial.riss_readings import downsample, readings
from positioning.model import Array, Recording, Site, Survey

RECORDINGS, READINGS, EPOCHS = 40, 20_000, 250


class Echo(BaseEstimator):  # type: ignore[misc]
    """Fingerprinting of scans that hold the fix itself: all time is the filter's."""

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> "Echo":
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        return np.asarray(rss_dbm, dtype=float)


def world() -> tuple[Recording, Survey, Site]:
    """Return drives of 200 seconds that rest for the first 20."""
    rng = np.random.default_rng(1)
    time_s = np.arange(READINGS) * 0.01
    shape = (RECORDINGS, READINGS)
    recording = Recording(
        time_s=np.tile(np.linspace(0.0, 199.0, EPOCHS), (RECORDINGS, 1)),
        rss_dbm=rng.uniform(0, 30, (RECORDINGS, EPOCHS, 2)),
        motion_time_s=np.tile(time_s, (RECORDINGS, 1)),
        gyro_rad_per_s=rng.normal(0.0, 0.1, shape),
        odometer_m_per_s=np.broadcast_to(np.where(time_s < 20, 0.0, 0.6), shape).copy(),
        start_heading_rad=np.zeros(RECORDINGS),
        start_position_m=np.zeros((RECORDINGS, 2)),
    )
    survey = Survey(rss_dbm=np.zeros((RECORDINGS, 2, 2)), position_m=np.zeros((RECORDINGS, 2, 2)))
    return recording, survey, Site(corner_m=np.tile([[0.0, 0.0], [30.0, 30.0]], (RECORDINGS, 1, 1)))


@pytest.mark.parametrize("part", ["downsample", "increments", "mechanise"])
def test_mechanisation(benchmark: Any, part: str) -> None:
    """Integrate 40 recordings of 20,000 readings; below half a second."""
    recording, _, _ = world()
    read = readings(recording)
    parts = {
        "downsample": lambda: downsample(recording),
        "increments": lambda: increments(recording),
        "mechanise": lambda: mechanise(
            read.edge_s, read.gyro_rad_per_s, read.speed_m_per_s, azimuth_rad=0.0, latitude_rad=0.77
        ),
    }
    benchmark.pedantic(parts[part], rounds=5, warmup_rounds=1)
    assert benchmark.stats.stats.median < 0.5


@pytest.mark.parametrize("name", ["riss", "kalman_3", "kalman_5"])
def test_track_stack(benchmark: Any, name: str) -> None:
    """Track 40 recordings of 250 epochs, from the readings on."""
    given = world()
    algorithm: Any = (
        Riss() if name == "riss" else RissKalmanFilter(states=int(name[-1]), fingerprinting=Echo())
    )
    found = benchmark.pedantic(lambda: algorithm.track_stack(*given, []), rounds=5, warmup_rounds=1)
    assert np.isfinite(found.position_m).all()
