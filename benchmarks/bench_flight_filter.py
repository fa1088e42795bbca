"""IMU samples a second through the flight filter, 24 worlds in lock-step and alone, on one core.

Run with ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 pytest benchmarks/bench_flight_filter.py -s``; it prints
the rates.
"""

from typing import Any

import numpy as np
import pytest

from positioning.inertial.flight_filter import navigate_flight
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.geodetic import attitude_of, position_scale_m, to_local
from positioning.inertial.geodetic_strapdown import readings, travelled
from positioning.inertial.landmarks import from_sensor_m, sighting_of
from positioning.model import Recording, Site

RATE_HZ, SECONDS, MARKS = 100, 80.0, 36
ORIGIN = np.array([0.6, 0.9, 120.0])


def world(worlds: int) -> tuple[Recording, Site]:
    """Return one lap about a block, each flight with a phase and a GPS clock of its own."""
    rng = np.random.default_rng(1)
    time_s = np.arange(int(SECONDS * RATE_HZ) + 1) / RATE_HZ
    phase = rng.uniform(0, 2 * np.pi, (worlds, 1))
    yaw = 2 * np.pi * time_s / SECONDS + phase
    zero = np.zeros_like(yaw)
    velocity = np.stack([4.8 * np.cos(yaw), 4.8 * np.sin(yaw), zero], axis=-1)
    attitude = attitude_of(np.stack([0.1 * np.sin(time_s) + zero, zero, yaw], axis=-1))
    place = travelled(np.tile(ORIGIN, (worlds, 1)), velocity, 1 / RATE_HZ)
    force, rate = readings(place, velocity, attitude, 1 / RATE_HZ)
    last = np.arange(50, int(SECONDS) * RATE_HZ, RATE_HZ) + rng.integers(-40, 40, (worlds, 1))
    each = np.arange(worlds)[:, None]
    gps = place[each, last] + 1.5 * rng.standard_normal((*last.shape, 3)) / position_scale_m(
        place[each, last]
    )
    local = to_local(place, ORIGIN)
    epochs = slice(0, None, RATE_HZ // 2)
    ned = local[..., [1, 0, 2]] * [1.0, 1.0, -1.0]
    angle = np.linspace(0, 2 * np.pi, MARKS, endpoint=False)
    middle = ned.mean(axis=1, keepdims=True)
    ring = np.stack([75 * np.cos(angle), 75 * np.sin(angle), 5 * np.sin(5 * angle)], axis=-1)
    at = np.arange(RATE_HZ // 5, len(time_s), RATE_HZ // 5)
    relative = from_sensor_m((middle + ring)[:, None], ned[:, at, None], attitude[:, at, None], np.zeros(3))
    seen = sighting_of(relative)
    number = np.where(seen[..., 0] < 35.0, np.arange(MARKS), -1)
    fix = local[:, epochs, :2] + 2.074 * rng.standard_normal((worlds, local[:, epochs].shape[1], 2))
    recording = Recording(
        time_s=np.tile(time_s[epochs], (worlds, 1)),
        imu_time_s=np.tile(time_s[1:], (worlds, 1)),
        specific_force_m_per_s2=(force + 0.02 * rng.standard_normal(force.shape)).astype(np.float32),
        angular_rate_rad_per_s=(rate + 0.003 * rng.standard_normal(rate.shape)).astype(np.float32),
        gps_time_s=time_s[last] + 0.003,
        gps_geodetic=gps,
        gps_velocity_m_per_s=velocity[each, last],
        gps_outage_s=np.tile([35.0, 75.0], (worlds, 1)),
        start_geodetic=place[:, 0],
        start_velocity_m_per_s=velocity[:, 0],
        start_attitude_rad=np.concatenate([np.zeros((worlds, 2)), phase], axis=1),
        sighting_time_s=np.broadcast_to(time_s[at][:, None], number.shape).reshape(worlds, -1),
        sighting_landmark=number.reshape(worlds, -1),
        sighting=seen.reshape(worlds, -1, 3),
        fix_m=fix[:, :, None],
    )
    site = Site(corner_m=np.zeros((worlds, 2, 2)), origin_geodetic=np.tile(ORIGIN, (worlds, 1)))
    return recording, site


@pytest.mark.parametrize("worlds", [1, 24])
@pytest.mark.parametrize(
    "options",
    [{"gps": False}, {}, {"states": 15, "fixes": True}, {"slam": True}],
    ids=["inertial", "gps", "gps-fixes-15", "gps-slam"],
)
def test_navigate_flight(benchmark: Any, options: dict[str, Any], worlds: int) -> None:
    """Run strapdown navigation, covariance at 20 Hz, and the updates."""
    recording, site = world(worlds)
    settings = FlightFilter(**options)
    found = benchmark.pedantic(navigate_flight, args=(recording, site, settings), rounds=2, warmup_rounds=1)
    assert np.isfinite(found.position_m).all()
    if settings.slam:
        assert np.isfinite(found.landmark_m).all(axis=-1).sum() == worlds * MARKS
    seconds = benchmark.stats.stats.min
    print(
        f"\n{options or 'gps'}, {worlds} worlds: {seconds:.2f} s,"
        f" {worlds * SECONDS * RATE_HZ / seconds:,.0f} samples a second,"
        f" {worlds * SECONDS / seconds:.0f} times real time in all, {SECONDS / seconds:.0f} in lock-step"
    )
