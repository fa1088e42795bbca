"""The trackers of a flight against known answers, each other, and their contract."""

import importlib
import inspect
import os
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.tracking.control_true_map import ControlTrueMap
from algorithms.tracking.flight_gps_inertial import FlightGpsInertial
from algorithms.tracking.flight_inertial import FlightInertial
from algorithms.tracking.flight_slam import FlightSlam
from algorithms.tracking.flight_wlpf import FlightWlpf
from positioning.errors import InputError
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.geodetic import attitude_of, position_scale_m, roll_pitch_yaw, to_local
from positioning.inertial.geodetic_strapdown import readings, travelled
from positioning.inertial.gps import antenna
from positioning.inertial.landmarks import from_sensor_m, sighting_of
from positioning.model import Array, Recording, Site, Track, Truth
from positioning.recordings import gps_ins_rover
from positioning.registry import class_name
from positioning.tasks import tracking

CHECKOUT = Path(__file__).resolve().parents[1]
ROVER = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata")) / "gps_ins_rover"

NAMES = ("flight_inertial", "flight_gps_inertial", "flight_slam", "flight_wlpf", "control_true_map")
RUNS, RATE_HZ, LASTS_S, LAP_S, RADIUS_M = 3, 50, 40.0, 16.0, 12.0
END_S = (40.0, 40.0, 33.0)
OUTAGE_S = (20.0, 34.0)
ORIGIN = np.array([np.radians(35.7), np.radians(51.4), 1200.0])
GPS_LEVER_M, SIGHT_LEVER_M = np.array([0.2, -0.1, -0.15]), np.array([0.1, 0.05, 0.1])
LANDMARK_M = np.array(
    [[30.0 * np.cos(a), 30.0 * np.sin(a), 6.0 + 3 * (n % 3)] for n, a in enumerate(np.arange(8) * np.pi / 4)]
)
FORCE_NOISE, RATE_NOISE = 0.002, 0.0003
FIX_SIGMA_M, RANGE_M, ANGLE_RAD = 2.074, 0.2, 0.01


def motion() -> tuple[Array, Array, Array, Array]:
    """Return times, places, velocities and attitudes of laps in coordinated turns, [r, i + 1, ...]."""
    time_s = np.arange(int(LASTS_S * RATE_HZ) + 1) / RATE_HZ
    rate = 2 * np.pi / LAP_S * np.array([1.0, 1.1, -0.9])[:, None]
    phase = np.array([0.3, 2.0, 4.0])[:, None] + rate * time_s
    north, east = -RADIUS_M * rate * np.sin(phase), RADIUS_M * rate * np.cos(phase)
    velocity = np.stack([north, east, 0.1 * np.sin(0.5 * time_s) * np.ones_like(phase)], axis=-1)
    roll = np.arctan(RADIUS_M * rate * np.abs(rate) / 9.8) * np.ones_like(phase)
    attitude = attitude_of(
        np.stack([roll, 0.02 * np.sin(time_s) * np.ones_like(phase), np.arctan2(east, north)], axis=-1)
    )
    start = ORIGIN + np.stack(
        [RADIUS_M * np.cos(phase[:, 0]), RADIUS_M * np.sin(phase[:, 0]), np.full(RUNS, -9.144)], axis=-1
    ) / position_scale_m(ORIGIN)
    return time_s, travelled(start, velocity, 1 / RATE_HZ), velocity, attitude


@cache
def make_stack(noise: float = 1.0, bias: float = 0.0) -> tuple[Recording, Site, Truth]:
    """Return flights, the last of which ends early, with all sensors."""
    rng = np.random.default_rng(12)
    time_s, geodetic, velocity, attitude = motion()
    force, rate = readings(geodetic, velocity, attitude, 1 / RATE_HZ)
    body_rate = np.concatenate([rate, rate[:, -1:]], axis=1)

    def state_at(moments: Array) -> list[Array]:
        """Return place, velocity, attitude and angular rate, between the samples by the next two."""
        place = moments * RATE_HZ
        low = np.minimum(place.astype(int), len(time_s) - 2)
        share = (place - low)[:, None]
        found = [v[:, low] + share * (v[:, low + 1] - v[:, low]) for v in (geodetic, velocity)]
        mixed = attitude[:, low] + share[..., None] * (attitude[:, low + 1] - attitude[:, low])
        return [*found, mixed, body_rate[:, low]]

    gps_s = np.arange(0.37, LASTS_S, 1.0)
    place, speed, turned, spin = state_at(gps_s)
    antenna_place, antenna_speed = antenna(place, speed, turned, spin, GPS_LEVER_M)
    sigma_m = noise * np.array([1.5, 1.5, 3.0])
    antenna_place = antenna_place + sigma_m * rng.standard_normal(place.shape) / position_scale_m(ORIGIN)
    antenna_speed = antenna_speed + noise * np.array([0.1, 0.1, 0.15]) * rng.standard_normal(place.shape)

    sight_s = np.repeat(np.arange(0.1, LASTS_S, 0.5), 2)
    place, _, turned, _ = state_at(sight_s)
    local = to_local(place, ORIGIN)
    ned, marks = local[..., [1, 0, 2]] * [1, 1, -1], LANDMARK_M[:, [1, 0, 2]] * [1, 1, -1]
    away = np.linalg.norm(marks - ned[:, :, None], axis=-1)
    # The nearest landmark, and the one after it.
    landmark = np.where(np.arange(len(sight_s)) % 2 == 0, np.argsort(away, axis=-1)[..., 0], 0)
    landmark = np.where(np.arange(len(sight_s)) % 2 == 0, landmark, np.argsort(away, axis=-1)[..., 2])
    seen = sighting_of(from_sensor_m(marks[landmark], ned, turned, SIGHT_LEVER_M))
    seen = seen + noise * np.array([RANGE_M, ANGLE_RAD, ANGLE_RAD]) * rng.standard_normal(seen.shape)
    sight_s = np.tile(sight_s, (RUNS, 1))

    epoch_s = np.arange(0.5, LASTS_S + 0.1, 0.5)
    place, speed, turned, _ = state_at(epoch_s)
    local = to_local(place, ORIGIN)
    fix_m = local[..., :2] + noise * FIX_SIGMA_M * rng.standard_normal(local[..., :2].shape)
    fix_m[:, ::2] = np.nan

    force = force + noise * FORCE_NOISE * RATE_HZ**0.5 * rng.standard_normal(force.shape) + bias * 0.02
    rate = rate + noise * RATE_NOISE * RATE_HZ**0.5 * rng.standard_normal(rate.shape) + bias * 0.001
    start_error = noise * rng.standard_normal((3, RUNS, 3))
    start_m = geodetic[:, 0] + start_error[0] * [1.5, 1.5, 3.0] / position_scale_m(ORIGIN)
    start_rad = roll_pitch_yaw(attitude[:, 0]) + start_error[2] * [0.01, 0.01, 0.03]

    arrays: dict[str, Any] = {
        "time_s": np.tile(epoch_s, (RUNS, 1)),
        "imu_time_s": np.tile(time_s[1:], (RUNS, 1)),
        "specific_force_m_per_s2": force,
        "angular_rate_rad_per_s": rate,
        "gps_time_s": np.tile(gps_s, (RUNS, 1)),
        "gps_geodetic": antenna_place,
        "gps_velocity_m_per_s": antenna_speed,
        "sighting_time_s": sight_s,
        "sighting": seen,
        "fix_m": fix_m[:, :, None],
    }
    truth: dict[str, Any] = {
        "position_m": local[..., :2].copy(),
        "height_m": local[..., 2].copy(),
        "velocity_m_per_s": speed.copy(),
        "attitude_rad": roll_pitch_yaw(turned),
        "landmark_m": np.tile(LANDMARK_M, (RUNS, 1, 1)),
    }
    for clock in ("time_s", "imu_time_s", "gps_time_s", "sighting_time_s"):
        ended = arrays[clock] > np.array(END_S)[:, None] + 1e-9
        length = arrays[clock].shape[1]
        for parts in (arrays, truth):
            for name, values in parts.items():
                if name != clock and values.shape[1] == length and not name.endswith("time_s"):
                    values[ended] = np.nan
        arrays[clock] = np.where(ended, np.nan, arrays[clock])
    landmark = np.where(np.isnan(arrays["sighting_time_s"]), -1, landmark)
    recording = Recording(
        **arrays,
        sighting_landmark=landmark,
        gps_lever_arm_m=np.tile(GPS_LEVER_M, (RUNS, 1)),
        sighting_lever_arm_m=np.tile(SIGHT_LEVER_M, (RUNS, 1)),
        gps_outage_s=np.tile(OUTAGE_S, (RUNS, 1)),
        start_geodetic=start_m,
        start_velocity_m_per_s=velocity[:, 0] + 0.1 * start_error[1],
        start_attitude_rad=start_rad,
    )
    site = Site(
        corner_m=np.tile([[-20.0, -20.0], [20.0, 20.0]], (RUNS, 1, 1)),
        origin_geodetic=np.tile(ORIGIN, (RUNS, 1)),
    )
    return recording, site, Truth(**truth)


def rngs(count: int = RUNS) -> list[np.random.Generator]:
    """Return fresh generators."""
    return [np.random.default_rng([8, n]) for n in range(count)]


def make(name: str, **changes: Any) -> Any:
    """Return a tracker, a control with its truth."""
    cls = getattr(importlib.import_module(f"algorithms.tracking.{name}"), class_name(name))
    known = {"truth": make_stack()[2]} if name.startswith("control_") else {}
    return cls(**known | changes)


def track(algorithm: Any, recording: Recording | None = None, site: Site | None = None) -> Track:
    """Track a stack."""
    given, place, _ = make_stack()
    recording = given if recording is None else recording
    return algorithm.track_stack(  # type: ignore[no-any-return]
        recording, None, place if site is None else site, rngs(len(recording.time_s))
    )


@cache
def shipped(name: str) -> Track:
    """Return the track of a tracker with its own settings."""
    return track(make(name))


def error_m(found: Track, truth: Truth | None = None) -> Array:
    """Return horizontal errors, [r, n]."""
    return np.linalg.norm(found.position_m - (truth or make_stack()[2]).position_m, axis=-1)


def in_outage() -> Any:
    """Mark the epochs of the outage but for its first seconds."""
    time_s = make_stack()[0].time_s
    return (time_s > OUTAGE_S[0] + 4) & (time_s <= OUTAGE_S[1])


# The contract


@pytest.mark.parametrize("name", NAMES)
def test_settings_are_those_of_the_filter(name: str) -> None:
    algorithm = make(name)
    own = {field.name: field.default for field in fields(FlightFilter)}
    for parameter in inspect.signature(type(algorithm)).parameters.values():
        if parameter.name in own and parameter.name not in ("slam", "fixes"):
            assert parameter.default == own[parameter.name], parameter.name
    found = algorithm.settings()
    assert (found.gps, found.fixes, found.slam) == {
        "flight_inertial": (False, False, False),
        "flight_gps_inertial": (True, False, False),
        "flight_slam": (True, False, True),
        "flight_wlpf": (True, True, True),
        "control_true_map": (True, False, True),
    }[name]
    changed = make(name, noise_factor=7.0, states=15).settings()
    assert (changed.noise_factor, changed.states) == (7.0, 15)


@pytest.mark.parametrize("name", NAMES)
def test_a_stack_gives_exactly_what_each_recording_gives(name: str) -> None:
    together = shipped(name)
    recording, site, truth = make_stack()
    for run in range(RUNS):
        changes = {"truth": truth.at(run)} if name.startswith("control_") else {}
        alone = make(name, **changes).track(recording.at(run), None, site.at(run), rngs()[run])
        np.testing.assert_array_equal(alone.position_m, together.position_m[run])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[run])
        assert set(alone.extra) == set(together.extra)
        for key, values in alone.extra.items():
            np.testing.assert_array_equal(values, together.extra[key][run], err_msg=key)


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_finite_until_the_end_and_covariances_are_some(name: str) -> None:
    found, time_s = shipped(name), make_stack()[0].time_s
    ended = np.isnan(time_s)
    assert ended.any()
    np.testing.assert_array_equal(found.time_s, time_s)
    per_epoch = ("height_m", "velocity_m_per_s", "attitude_rad", "covariance_9")
    for values in (found.position_m, found.covariance_m2, *(found.extra[key] for key in per_epoch)):
        assert np.isfinite(values[~ended]).all()
        assert np.isnan(values[ended]).all()
    covariance = found.covariance_m2[~ended]
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert found.extra["covariance_9"].shape == (*time_s.shape, 9, 9)


@pytest.mark.parametrize("name", NAMES)
def test_the_task_takes_the_answer(name: str) -> None:
    recording, site, truth = make_stack()
    observed = {**recording.to_arrays(), **site.to_arrays()}
    seen = truth.to_arrays() if name.startswith("control_") else None
    cls = type(make(name))
    outcome = tracking.run(lambda **given: cls(**given), observed, seen, {}, rngs())
    assert not outcome.skipped
    np.testing.assert_array_equal(outcome.estimates["position_m"], shipped(name).position_m)
    assert outcome.estimates["extra_attitude_rad"].shape == (*recording.time_s.shape, 3)
    scores = tracking.score(outcome.estimates, truth.to_arrays())
    np.testing.assert_allclose(scores["error_m"], error_m(shipped(name)), rtol=1e-12)


def test_the_global_random_state_is_left_alone() -> None:
    state = np.random.get_state()[1].copy()  # type: ignore[index]  # noqa: NPY002
    track(make("flight_wlpf"))
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # type: ignore[index]  # noqa: NPY002


# Known answers


@pytest.mark.parametrize("name", NAMES)
def test_without_noise_every_tracker_returns_the_path(name: str) -> None:
    recording, site, truth = make_stack(noise=0.0)
    found = track(make(name, **({"truth": truth} if name.startswith("control_") else {})), recording, site)
    there = ~np.isnan(recording.time_s)
    # What GPS and sightings are compared with lies on a line between two readings, off the arc by 0.5 mm.
    close_m = 1e-3 if name == "flight_inertial" else 5e-3
    assert error_m(found, truth)[there].max() < close_m
    for key in ("height_m", "velocity_m_per_s", "attitude_rad"):
        off = found.extra[key] - getattr(truth, key)
        if key == "attitude_rad":
            off = np.remainder(off + np.pi, 2 * np.pi) - np.pi
        assert np.abs(off[there]).max() < (
            1e-6 if name == "flight_inertial" and key[0] == "a" else close_m
        ), key
    if "landmark_m" in found.extra:
        np.testing.assert_allclose(found.extra["landmark_m"], truth.landmark_m, atol=0.02)


def test_the_covariance_is_that_of_east_and_north() -> None:
    found = track(FlightInertial(start_sigma_m=(5.0, 1.0, 2.0)))
    np.testing.assert_allclose(
        found.covariance_m2[:, 0], np.tile(np.diag([1.0, 25.0]), (RUNS, 1, 1)), atol=0.05
    )
    np.testing.assert_array_equal(found.covariance_m2[..., 0, 0], found.extra["covariance_9"][..., 1, 1])


def test_each_sensor_bounds_the_error_of_the_outage() -> None:
    outage = in_outage()
    mean = {name: error_m(shipped(name))[outage].mean() for name in NAMES}
    assert mean["flight_gps_inertial"] < mean["flight_inertial"]
    assert mean["flight_slam"] < mean["flight_gps_inertial"]
    assert mean["control_true_map"] < mean["flight_slam"]
    assert mean["control_true_map"] < 0.25
    fixes = track(FlightWlpf(slam=False))
    smaller = shipped("flight_gps_inertial").covariance_m2[outage] - fixes.covariance_m2[outage]
    assert np.linalg.eigvalsh(smaller).min() > 0
    assert error_m(fixes)[outage].mean() < 2


def test_what_is_not_told_counts_as_the_model_says() -> None:
    # White noise of the sizes that the filter is told: innovations and errors are as large as it says.
    found = shipped("flight_wlpf")
    for sensor, least in (("gps", 100), ("fix", 30), ("sighting", 200)):
        assert (found.extra[f"degrees_{sensor}"] >= least).all()
        assert 0.7 < found.extra[f"nis_{sensor}"].mean() < 1.3
    off = found.position_m - make_stack()[2].position_m
    there = np.isfinite(off).all(axis=-1)
    nees = np.einsum("ni,nij,nj->n", off[there], np.linalg.inv(found.covariance_m2[there]), off[there])
    assert 0.3 < nees.mean() < 5


def test_fifteen_states_find_a_bias() -> None:
    recording, site, truth = make_stack(bias=1.0)
    nine = track(FlightGpsInertial(), recording, site)
    found = track(FlightGpsInertial(states=15), recording, site)
    assert "bias" not in nine.extra
    # A flight of 40 s finds about half of it, from the zero that it starts with.
    assert 0.0003 < found.extra["bias"][:, 3:].mean() < 0.0015
    outage = in_outage()
    assert error_m(found, truth)[outage].mean() < error_m(nine, truth)[outage].mean()


# What counts, and what does not


def test_no_tracker_uses_gps_of_the_outage() -> None:
    recording, _, _ = make_stack()
    assert recording.gps_time_s is not None
    assert recording.gps_geodetic is not None
    hidden = (recording.gps_time_s >= OUTAGE_S[0]) & (recording.gps_time_s < OUTAGE_S[1])
    moved = replace(recording, gps_geodetic=np.where(hidden[..., None], ORIGIN, recording.gps_geodetic))
    for name in NAMES:
        np.testing.assert_array_equal(track(make(name), moved).position_m, shipped(name).position_m)
    free = track(FlightGpsInertial(outage_s=0.0), moved)
    assert error_m(free)[in_outage()].mean() > 2


def test_the_outage_is_lengthened_from_its_begin() -> None:
    recording, _, _ = make_stack()
    lasts_s = OUTAGE_S[1] - OUTAGE_S[0]
    same = track(FlightGpsInertial(outage_s=lasts_s))
    np.testing.assert_array_equal(same.position_m, shipped("flight_gps_inertial").position_m)
    none = track(FlightGpsInertial(outage_s=0.0))
    without = track(FlightGpsInertial(), replace(recording, gps_outage_s=None))
    np.testing.assert_array_equal(none.position_m, without.position_m)
    mean = [
        error_m(found)[in_outage()].mean() for found in (none, track(FlightGpsInertial(outage_s=8.0)), same)
    ]
    assert mean[0] < mean[1] < mean[2]


def test_slam_without_a_sighting_is_gps_and_inertial_navigation() -> None:
    recording, _, _ = make_stack()
    assert recording.sighting_landmark is not None
    blind = replace(recording, sighting_landmark=np.full_like(recording.sighting_landmark, -1))
    np.testing.assert_array_equal(
        track(FlightSlam(), blind).position_m, shipped("flight_gps_inertial").position_m
    )
    np.testing.assert_array_equal(
        track(FlightSlam(gps=False), blind).position_m, shipped("flight_inertial").position_m
    )


def test_on_new_ground_no_earlier_sighting_counts() -> None:
    recording, _, _ = make_stack()
    assert recording.sighting_time_s is not None
    assert recording.sighting is not None
    early = recording.sighting_time_s < OUTAGE_S[0]
    moved = replace(recording, sighting=np.where(early[..., None], 1.0, recording.sighting))
    new = track(FlightSlam(new_ground=True))
    np.testing.assert_array_equal(track(FlightSlam(new_ground=True), moved).position_m, new.position_m)
    assert not np.array_equal(track(FlightSlam(), moved).position_m, shipped("flight_slam").position_m)
    time_s = recording.time_s
    before = time_s < OUTAGE_S[0]
    np.testing.assert_array_equal(new.position_m[before], shipped("flight_gps_inertial").position_m[before])
    assert (new.extra["degrees_sighting"] < shipped("flight_slam").extra["degrees_sighting"]).all()


def test_fixes_count_as_their_sigma_says() -> None:
    idle = track(FlightWlpf(slam=False, fix_sigma_m=1e6))
    np.testing.assert_allclose(idle.position_m, shipped("flight_gps_inertial").position_m, atol=1e-4)
    # Better than it says, so that no fix asks for a jump of the velocity.
    recording, site, _ = make_stack(noise=0.05)
    sure = track(FlightWlpf(slam=False, gps=False, fix_sigma_m=0.01, noise_factor=1e4), recording, site)
    assert recording.fix_m is not None
    loose = track(FlightWlpf(slam=False, gps=False), recording, site)
    off_m = [np.abs(found.position_m - recording.fix_m[:, :, 0]) for found in (sure, loose)]
    assert np.nanmedian(off_m[0]) < 0.02
    assert np.nanmedian(off_m[1]) > 0.05


def test_both_models_interpolations_and_units_agree_at_walking_pace() -> None:
    base = shipped("flight_gps_inertial").position_m
    there = np.isfinite(base).all(axis=-1)
    for changes, close_m in (
        ({"interpolation": "lagrange", "interpolation_order": 2}, 0.02),
        ({"units": "radians"}, 1e-4),
        ({"model": "flat"}, 0.2),
        ({"closed_loop": False}, 0.5),
    ):
        found = track(FlightGpsInertial(**changes)).position_m  # type: ignore[arg-type]
        assert 0 < np.abs(found - base)[there].max() < close_m, changes
    condition = [
        track(FlightGpsInertial(units=units)).extra["innovation_condition"] for units in ("metres", "radians")
    ]
    assert (condition[1] > 1e6 * condition[0]).all()


# The control


def test_the_control_keeps_the_true_map() -> None:
    found = shipped("control_true_map")
    np.testing.assert_allclose(
        found.extra["landmark_m"], np.tile(LANDMARK_M, (RUNS, 1, 1)), rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(found.extra["landmark_covariance_m2"], 0)
    assert 0.7 < found.extra["nis_sighting"].mean() < 1.3


def test_the_control_needs_the_landmarks_that_are_seen() -> None:
    recording, site, truth = make_stack()
    assert "synthetic" in ControlTrueMap().skip(recording, None, site)
    with pytest.raises(InputError, match="synthetic"):
        track(ControlTrueMap())
    assert truth.landmark_m is not None
    for landmark_m in (truth.landmark_m[:, :3], truth.landmark_m[:2], truth.landmark_m[0]):
        with pytest.raises(InputError, match="landmark_m"):
            track(ControlTrueMap(truth=replace(truth, landmark_m=landmark_m)))
    holes = truth.landmark_m.copy()
    holes[1, 2] = np.nan
    with pytest.raises(InputError, match="does not hold"):
        track(ControlTrueMap(truth=replace(truth, landmark_m=holes)))
    more = np.concatenate([truth.landmark_m, np.full((RUNS, 2, 3), np.nan)], axis=1)
    filled = track(ControlTrueMap(truth=replace(truth, landmark_m=more)))
    np.testing.assert_array_equal(filled.position_m, shipped("control_true_map").position_m)
    # Landmarks that nobody sees change nothing, whatever their numbers.
    more[:, -2:] = 1e3
    filled = track(ControlTrueMap(truth=replace(truth, landmark_m=more)))
    np.testing.assert_array_equal(filled.position_m, shipped("control_true_map").position_m)


# Refusals


@pytest.mark.parametrize(
    ("name", "missing", "reason"),
    [
        ("flight_inertial", "imu_time_s", "inertial"),
        ("flight_inertial", "start_attitude_rad", "start"),
        ("flight_gps_inertial", "gps_geodetic", "GPS"),
        ("flight_slam", "sighting", "sightings"),
        ("flight_wlpf", "fix_m", "fixes"),
        ("control_true_map", "sighting_time_s", "sightings"),
    ],
)
def test_skip_names_what_is_missing(name: str, missing: str, reason: str) -> None:
    recording, site, _ = make_stack()
    algorithm = make(name)
    assert algorithm.skip(recording, None, site) == ""
    lacking = replace(recording, **{missing: None})  # type: ignore[arg-type]
    assert reason in algorithm.skip(lacking, None, site)
    with pytest.raises(InputError, match=reason) as refused:
        track(algorithm, lacking)
    assert missing in str(refused.value)
    values = np.full_like(getattr(recording, missing), np.nan)
    assert reason in algorithm.skip(replace(recording, **{missing: values}), None, site)  # type: ignore[arg-type]
    assert "earth" in algorithm.skip(recording, None, replace(site, origin_geodetic=None))


def test_new_ground_needs_an_outage() -> None:
    recording, site, _ = make_stack()
    for outage in (None, np.full((RUNS, 2), np.nan)):
        lacking = replace(recording, gps_outage_s=outage)
        assert "outage" in FlightSlam(new_ground=True).skip(lacking, None, site)
        assert FlightSlam().skip(lacking, None, site) == ""
        with pytest.raises(InputError, match="outage"):
            track(FlightSlam(new_ground=True), lacking)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "changes", [{"states": 12}, {"model": "round"}, {"noise_factor": -1.0}, {"covariance_hz": 0.0}]
)
def test_senseless_settings_are_refused(name: str, changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(changes))):
        track(make(name, **changes))


# Real data


@pytest.mark.skipif(not ROVER.is_dir(), reason=f"no recordings in {ROVER} (REPOSITION_REALDATA)")
def test_a_rover_is_followed_and_lost_in_an_outage() -> None:
    whole, truth = gps_ins_rover.load(ROVER)
    cut, _ = gps_ins_rover.load(ROVER, outage_from_s=80.0)
    observed = {name: np.concatenate([values, cut[name]]) for name, values in whole.items()}
    recording, site = Recording.from_arrays(observed), Site.from_arrays(observed)
    assert recording is not None
    assert site is not None
    assert FlightSlam().skip(recording, None, site)
    found = track(FlightGpsInertial(states=15), recording, site)
    error = np.linalg.norm(found.position_m - truth["truth.position_m"], axis=-1)
    time_s = recording.time_s[0]
    assert np.nanmean(error[0]) < 1.6
    outage = (time_s > 110) & (time_s < 120)
    assert error[1, outage].mean() > 4 * error[0, outage].mean()
    before = time_s < 80
    np.testing.assert_array_equal(found.position_m[1, before], found.position_m[0, before])


def test_the_example_of_the_guide_flies_north_and_uses_no_gps_of_the_outage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    guide = (CHECKOUT / "docs/add-an-algorithm.md").read_text(encoding="utf-8")
    part = guide.partition("\n## A tracker with GPS and an inertial unit\n")[2].partition("\n## ")[0]
    example = part.partition("```python\n")[2].partition("```")[0]
    names: dict[str, Any] = {}
    exec(compile(example, "docs/add-an-algorithm.md", "exec"), names)
    north_m = 5.0 * np.arange(0.0, 30.5, 5.0)
    np.testing.assert_allclose(names["track"].position_m, np.c_[0 * north_m, north_m], atol=0.01)
    printed = [[float(cell) for cell in line.split()] for line in capsys.readouterr().out.splitlines()]
    np.testing.assert_allclose(printed, np.c_[north_m / 5, 0 * north_m, north_m], atol=0.011)
    # Of 30 readings those at 10, 11, ... 19 s do not count.
    gps_north_m = 5.0 * np.r_[np.arange(1, 10), np.arange(20, 31)]
    np.testing.assert_allclose(names["gps_m"][:, 1], gps_north_m, atol=1e-3)
