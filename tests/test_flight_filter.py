"""The flight filter: consistency in worlds of white noise, finite differences, equivalences, bad input."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import pytest

from positioning.errors import InputError
from positioning.inertial import flight_filter, flight_plan
from positioning.inertial.flight_checks import check_flight
from positioning.inertial.flight_filter import FlightNavigation, navigate_flight
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.geodetic import attitude_of, position_scale_m, roll_pitch_yaw, to_geodetic, to_local
from positioning.inertial.geodetic_error_state import flat_transition
from positioning.inertial.geodetic_strapdown import readings, travelled
from positioning.inertial.gps import antenna, observation_matrix
from positioning.inertial.landmarks import from_sensor_m, sighting_of
from positioning.inertial.strapdown import rotation, rotation_vector
from positioning.model import Recording, Site

RATE_HZ = 100
ORIGIN = np.array([0.6, 0.9, 120.0])
DOWN = np.array([1.0, 1.0, -1.0])


class True_(NamedTuple):
    geodetic: Any
    velocity_m_per_s: Any
    attitude: Any
    landmark_m: Any


def world(
    settings: FlightFilter,
    *,
    worlds: int = 24,
    seconds: float = 40.0,
    noise: float = 1.0,
    seed: int = 0,
    marks: int = 12,
    bias: float = 0.0,
) -> tuple[Recording, Site, True_]:
    """Return flights whose noise is exactly what the settings say."""
    rng, step_s = np.random.default_rng(seed), 1 / RATE_HZ
    time_s = np.arange(round(seconds * RATE_HZ) + 1) * step_s
    phase = rng.uniform(0, 2 * np.pi, (worlds, 1))
    yaw = 2 * np.pi * time_s / 80 + phase + 0.2 * np.sin(0.7 * time_s)
    speed = 4.8 + 0.8 * np.sin(0.3 * time_s + phase)
    climb = 0.3 * np.sin(0.4 * time_s + phase)
    velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), climb], axis=-1)
    roll, pitch = 0.15 * np.sin(time_s + phase), 0.1 * np.cos(1.3 * time_s + phase)
    attitude = attitude_of(np.stack([roll, pitch, yaw], axis=-1))
    begin = np.concatenate([60 * np.sin(phase), -60 * np.cos(phase), 9 + 0 * phase], axis=1)
    place = travelled(to_geodetic(begin, ORIGIN), velocity, step_s)
    force, rate = readings(place, velocity, attitude, step_s)

    def noisy(values: Any, sigma: Any) -> Any:
        return values + noise * rng.standard_normal(values.shape) * np.asarray(sigma)

    steady = bias * rng.standard_normal((worlds, 1, 6))
    shaken = noisy(force, settings.force_noise_m_per_s2_per_rt_hz / np.sqrt(step_s))
    shaken += settings.force_bias_m_per_s2 * steady[..., :3]
    turning = noisy(rate, settings.rate_noise_rad_per_s_per_rt_hz / np.sqrt(step_s))
    turning += settings.rate_bias_rad_per_s * steady[..., 3:]

    each = np.arange(worlds)[:, None]
    gps_s = np.arange(int(seconds) - 1) + rng.uniform(0.1, 0.9, (worlds, 1))
    last = np.floor(gps_s * RATE_HZ).astype(int)
    share = (gps_s * RATE_HZ - last)[..., None]

    def between(values: Any) -> Any:
        part = share if values.ndim == 3 else share[..., None]
        return (1 - part) * values[each, last] + part * values[each, last + 1]

    lever, sensor = np.tile([0.3, -0.1, -0.2], (worlds, 1)), np.tile([0.4, 0.0, 0.1], (worlds, 1))
    gps, gps_speed = antenna(
        between(place), between(velocity), between(attitude), rate[each, last], lever[:, None]
    )
    local = to_local(place, ORIGIN)
    ned = local[..., [1, 0, 2]] * DOWN
    seen_s = np.arange(0.2, seconds - 0.1, 0.2)
    at = np.round(seen_s * RATE_HZ).astype(int)
    mark = rng.uniform([-110, -110, -20], [110, 110, 0], (worlds, marks, 3))
    seen = sighting_of(
        from_sensor_m(mark[:, None], ned[:, at, None], attitude[:, at, None], sensor[:, None, None])
    )
    shape = (worlds, len(at), marks)
    number = np.where(seen[..., 0] < 60.0, np.arange(marks), -1).reshape(worlds, -1)
    sigma = [settings.range_sigma_m, settings.bearing_sigma_rad, settings.elevation_sigma_rad]
    epochs = slice(0, None, RATE_HZ // 2)
    fix = noisy(local[:, epochs, :2], settings.fix_sigma_m)
    fix[:, ::2] = np.nan
    scale = position_scale_m(place[:, 0])
    tilt = rotation(noisy(np.zeros((worlds, 3)), settings.start_attitude_sigma_rad))
    recording = Recording(
        time_s=np.tile(time_s[epochs], (worlds, 1)),
        imu_time_s=np.tile(time_s[1:], (worlds, 1)),
        specific_force_m_per_s2=shaken,
        angular_rate_rad_per_s=turning,
        gps_time_s=gps_s,
        gps_geodetic=noisy(gps, settings.gps_sigma_m / position_scale_m(gps)),
        gps_velocity_m_per_s=noisy(gps_speed, settings.gps_velocity_sigma_m_per_s),
        gps_lever_arm_m=lever,
        gps_outage_s=np.tile([0.6 * seconds, 0.6 * seconds + 10.0], (worlds, 1)),
        start_geodetic=noisy(place[:, 0], settings.start_sigma_m / scale),
        start_velocity_m_per_s=noisy(velocity[:, 0], settings.start_velocity_sigma_m_per_s),
        start_attitude_rad=roll_pitch_yaw(tilt @ attitude[:, 0]),
        sighting_time_s=np.broadcast_to(seen_s[:, None], shape).reshape(worlds, -1),
        sighting_landmark=number,
        sighting=noisy(seen.reshape(worlds, -1, 3), sigma),
        sighting_lever_arm_m=sensor,
        fix_m=fix[:, :, None],
    )
    site = Site(corner_m=np.zeros((worlds, 2, 2)), origin_geodetic=np.tile(ORIGIN, (worlds, 1)))
    return recording, site, True_(place[:, epochs], velocity[:, epochs], attitude[:, epochs], mark)


def errors(found: FlightNavigation, truth: True_) -> Any:
    """Return navigation less truth, in the nine states of the filter."""
    moved = (found.geodetic - truth.geodetic) * position_scale_m(truth.geodetic)
    turned = -rotation_vector(attitude_of(found.attitude_rad) @ truth.attitude.swapaxes(-1, -2))
    return np.concatenate([moved, found.velocity_m_per_s - truth.velocity_m_per_s, turned], axis=-1)


def normalised(error: Any, covariance: Any) -> Any:
    return np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], axis=-1)


def one(parts: Any, number: int) -> Any:
    taken = {
        field.name: value[number : number + 1]
        for field in dataclasses.fields(parts)
        if (value := getattr(parts, field.name)) is not None
    }
    return dataclasses.replace(parts, **taken)


OPTIONS: list[dict[str, Any]] = [
    {},
    {"slam": True},
    {"fixes": True, "gps": False},
    {"slam": True, "fixes": True, "states": 15},
    {"model": "flat", "interpolation": "lagrange"},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_the_filter_is_consistent(options: dict[str, Any]) -> None:
    settings = FlightFilter(**options, rate_bias_rad_per_s=0.001)
    recording, site, truth = world(settings, bias=float(settings.states == 15), worlds=40, seed=3)
    found = navigate_flight(recording, site, settings)
    error = errors(found, truth)
    # 40 worlds of chi-square with 9 degrees of freedom, correlated in time: 0.67 for one epoch.
    assert 7.5 < normalised(error, found.covariance)[:, 1:].mean() < 11.0
    for name, wanted in (("gps", settings.gps), ("fix", settings.fixes), ("sighting", settings.slam)):
        count = found.degrees_of_freedom[name]
        if not wanted:
            assert not count.any()
            assert np.isnan(found.normalised_innovation_squared[name]).all()
            continue
        pooled = np.sum(found.normalised_innovation_squared[name] * count) / np.sum(count)
        assert abs(pooled - 1.0) < max(0.07, 4 * np.sqrt(2 / count.sum()))
    if settings.slam:
        wrong = found.landmark_m - truth.landmark_m[:, :, [1, 0, 2]] * DOWN
        there = np.isfinite(wrong).all(axis=-1)
        assert there.mean() > 0.3
        pooled = normalised(wrong[there], found.landmark_covariance_m2[there]).mean()
        assert 2.0 < pooled < 4.2


def test_without_noise_the_filter_returns_the_truth() -> None:
    settings = FlightFilter(gps=False)
    recording, site, truth = world(settings, worlds=2, seconds=120.0, noise=0.0)
    found = navigate_flight(recording, site, settings)
    error = errors(found, truth)
    assert np.abs(error[..., :3]).max() < 1e-3
    assert np.abs(error[..., 6:]).max() < 1e-7
    local = to_local(truth.geodetic, ORIGIN)
    np.testing.assert_allclose(found.position_m, local[..., :2], atol=1e-3)
    np.testing.assert_allclose(found.height_m, local[..., 2], atol=1e-3)


def test_faultless_sensors_leave_the_truth_as_it_is() -> None:
    settings = FlightFilter(slam=True, fixes=True, states=15)
    recording, site, truth = world(settings, worlds=2, noise=0.0)
    found = navigate_flight(recording, site, settings)
    # GPS lies between two readings: its place is that of the mean, off by the bend of the way.
    assert np.abs(errors(found, truth)[..., :3]).max() < 2e-3
    for name in ("gps", "fix", "sighting"):
        assert found.normalised_innovation_squared[name].max() < 1e-3
    wrong = found.landmark_m - truth.landmark_m[:, : found.landmark_m.shape[1], [1, 0, 2]] * DOWN
    assert np.nanmax(np.abs(wrong)) < 5e-3


def test_the_covariance_moves_as_the_navigation_does() -> None:
    # Fast, so that the terms of the rotating ellipsoid count; the noise is off.
    settings = FlightFilter(gps=False, force_noise_m_per_s2_per_rt_hz=0.0, rate_noise_rad_per_s_per_rt_hz=0.0)
    recording, _, _ = world(settings, worlds=1, seconds=30.0, noise=0.0)
    steps = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3])
    shifts = np.concatenate([np.diag(steps), -np.diag(steps), np.zeros((1, 9))])
    count = len(shifts)

    def many(values: Any) -> Any:
        return np.repeat(values, count, axis=0)

    assert recording.start_geodetic is not None
    assert recording.start_attitude_rad is not None
    east = np.array([20.0, 60.0, 0.0])
    scale = position_scale_m(recording.start_geodetic)
    wide = Recording(
        time_s=many(recording.time_s),
        imu_time_s=many(recording.imu_time_s),
        specific_force_m_per_s2=many(recording.specific_force_m_per_s2),
        angular_rate_rad_per_s=many(recording.angular_rate_rad_per_s),
        start_geodetic=recording.start_geodetic + shifts[:, :3] / scale,
        start_velocity_m_per_s=east + shifts[:, 3:6],
        start_attitude_rad=roll_pitch_yaw(
            rotation(-shifts[:, 6:]) @ attitude_of(recording.start_attitude_rad)
        ),
    )
    own = FlightFilter(
        gps=False,
        force_noise_m_per_s2_per_rt_hz=0.0,
        rate_noise_rad_per_s_per_rt_hz=0.0,
        start_sigma_m=(1.0, 2.0, 3.0),
        start_velocity_sigma_m_per_s=(0.1, 0.2, 0.3),
        start_attitude_sigma_rad=(0.01, 0.02, 0.03),
    )
    there = Site(corner_m=np.zeros((count, 2, 2)), origin_geodetic=many(ORIGIN[None]))
    found = navigate_flight(wide, there, own)
    last = True_(found.geodetic[-1:], found.velocity_m_per_s[-1:], attitude_of(found.attitude_rad[-1:]), None)
    away = errors(found, last)[:, -1]
    change = ((away[:9] - away[9:18]) / (2 * steps[:, None])).T
    sigmas = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    wanted = change @ np.diag(sigmas**2) @ change.T
    spread = np.sqrt(np.diag(wanted))
    got = found.covariance[-1, -1]
    assert np.abs((got - wanted) / (spread[:, None] * spread)).max() < 2e-3
    # The flat model leaves the terms of the earth out, and differs by more.
    flat = navigate_flight(wide, there, dataclasses.replace(own, model="flat"))
    assert np.abs((flat.covariance[-1, -1] - wanted) / (spread[:, None] * spread)).max() > 2e-3


@pytest.mark.parametrize(
    "options", [{"slam": True, "fixes": True, "states": 15}, {"closed_loop": False}], ids=str
)
def test_a_stack_is_its_recordings_one_by_one(options: dict[str, Any]) -> None:
    settings = FlightFilter(**options)
    recording, site, _ = world(settings, worlds=3, seconds=20.0)
    found = navigate_flight(recording, site, settings)
    alone = navigate_flight(one(recording, 1), one(site, 1), settings)
    for name in ("geodetic", "velocity_m_per_s", "attitude_rad", "covariance"):
        np.testing.assert_array_equal(getattr(found, name)[1], getattr(alone, name)[0])
    np.testing.assert_array_equal(found.landmark_m[1, : alone.landmark_m.shape[1]], alone.landmark_m[0])


@pytest.mark.parametrize("options", [{"states": 15, "fixes": True}, {"closed_loop": False}], ids=str)
def test_shortcuts_change_nothing_but_the_rounding(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]
) -> None:
    settings = FlightFilter(slam=True, **options)
    recording, site, _ = world(settings, worlds=2, seconds=30.0, marks=20)
    rough = navigate_flight(recording, site, settings)
    # The earth looked at in every step.
    monkeypatch.setattr(flight_filter, "_EARTH_S", 0.0)
    found = navigate_flight(recording, site, settings)
    np.testing.assert_allclose(rough.position_m, found.position_m, atol=2e-5)
    np.testing.assert_allclose(rough.height_m, found.height_m, atol=2e-4)
    # Readings and sightings one after the other, and shared covariances moved in every step.
    propagate = flight_filter.FlightRun._propagate

    def at_once(self: Any, *arguments: Any) -> None:
        propagate(self, *arguments)
        self._settle(np.arange(self.worlds))

    for module in (flight_plan, flight_filter):
        monkeypatch.setattr(module, "SIGHTINGS_TOGETHER", 1)
    monkeypatch.setattr(flight_filter, "_AT_ONCE", 1)
    monkeypatch.setattr(flight_filter.FlightRun, "_propagate", at_once)
    plain = navigate_flight(recording, site, settings)
    assert found.degrees_of_freedom["sighting"].min() > 300
    np.testing.assert_array_equal(found.degrees_of_freedom["sighting"], plain.degrees_of_freedom["sighting"])
    np.testing.assert_allclose(found.position_m, plain.position_m, atol=2e-6)
    np.testing.assert_allclose(found.landmark_m, plain.landmark_m, atol=2e-6)
    np.testing.assert_allclose(found.bias, plain.bias, atol=1e-7)
    spread = np.sqrt(np.einsum("rnii->rni", plain.covariance))
    off = (found.covariance - plain.covariance) / (spread[..., None] * spread[..., None, :])
    assert np.abs(off).max() < 1e-5
    np.testing.assert_allclose(found.landmark_covariance_m2, plain.landmark_covariance_m2, atol=1e-6)
    for name, nis in plain.normalised_innovation_squared.items():
        np.testing.assert_allclose(found.normalised_innovation_squared[name], nis, rtol=1e-4)


def seen_by(monkeypatch: pytest.MonkeyPatch, recording: Recording, site: Site, settings: FlightFilter) -> Any:
    """Return the matrices and the innovations of the GPS readings, [k, r, ...], of the filter itself."""
    seen: list[tuple[Any, Any]] = []
    take = flight_filter.FlightRun._take

    def taken(self: Any, kind: str, world: Any, observed: Any, innovation: Any, variance: Any) -> Any:
        seen.append((np.array(observed), np.array(innovation)))
        return take(self, kind, world, observed, innovation, variance)

    with monkeypatch.context() as patch:
        patch.setattr(flight_filter.FlightRun, "_take", taken)
        navigate_flight(recording, site, settings)
    return tuple(np.array(part) for part in zip(*seen, strict=True))


def shifted_starts(recording: Recording, shifts: Any) -> Recording:
    """Return the first flight from starts that are off by errors [k, 9]."""
    count = len(shifts)
    taken = {
        field.name: np.repeat(value[:1], count, axis=0)
        for field in dataclasses.fields(recording)
        if (value := getattr(recording, field.name)) is not None
    }
    place, attitude = taken["start_geodetic"], attitude_of(taken["start_attitude_rad"])
    taken["start_geodetic"] = place + shifts[:, :3] / position_scale_m(place)
    taken["start_velocity_m_per_s"] = taken["start_velocity_m_per_s"] + shifts[:, 3:6]
    taken["start_attitude_rad"] = roll_pitch_yaw(rotation(-shifts[:, 6:]) @ attitude)
    return dataclasses.replace(recording, **taken)


def test_what_the_filter_observes_is_the_derivative_of_its_innovation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # GPS is at the end of the first step of the covariance.
    recording, _, _ = world(FlightFilter(), worlds=1, seconds=2.0, noise=0.0)
    assert recording.gps_geodetic is not None
    assert recording.gps_velocity_m_per_s is not None
    recording = dataclasses.replace(
        recording,
        time_s=np.array([[0.05]]),
        fix_m=None,
        gps_time_s=np.array([[0.05]]),
        gps_geodetic=recording.gps_geodetic[:, :1],
        gps_velocity_m_per_s=recording.gps_velocity_m_per_s[:, :1],
        gps_lever_arm_m=np.array([[1.0, -2.0, 3.0]]),
        gps_outage_s=None,
    )
    steps = np.repeat([1.0, 0.1, 1e-3], 3)
    shifts = np.concatenate([np.diag(steps), -np.diag(steps), np.zeros((1, 9))])
    many = shifted_starts(recording, shifts)
    site = Site(corner_m=np.zeros((19, 2, 2)), origin_geodetic=np.tile(ORIGIN, (19, 1)))
    observed, innovation = seen_by(monkeypatch, many, site, FlightFilter())
    numeric = ((innovation[0, :9] - innovation[0, 9:18]) / (2 * steps[:, None])).T
    force = attitude_of(many.start_attitude_rad)[-1] @ np.mean(many.specific_force_m_per_s2[-1, :5], axis=0)
    change = flat_transition(force, 0.05)
    # The earth and the turn within the step.
    np.testing.assert_allclose(observed[0, -1] @ change, numeric, atol=5e-3)
    assert np.abs(numeric[:, 6:]).max() > 1.0

    # The library's matrix has rows and columns in radians, with the height up.
    there = navigate_flight(many, site, FlightFilter(gps=False))
    place, attitude = there.geodetic[-1, 0], attitude_of(there.attitude_rad[-1, 0])
    scale = position_scale_m(place)
    down = np.array([1, 1, -1, 1, 1, 1])
    for units in ("metres", "radians"):
        own, _ = seen_by(monkeypatch, many, site, FlightFilter(units=units))
        wanted = observation_matrix(
            place, attitude, many.angular_rate_rad_per_s[-1, 4], many.gps_lever_arm_m[-1], units=units
        )
        wanted[:, :3] /= scale
        wanted *= down[:, None]
        # In radians the rows of the position are small. The frame turns by 7e-5 rad/s, the arm has 3.7 m.
        rows = np.abs(wanted).max(axis=1, keepdims=True)
        np.testing.assert_allclose(own[0, -1] / rows, wanted / rows, atol=3e-4)


def test_the_flat_model_of_the_filter_is_that_of_the_library() -> None:
    sigmas = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    settings = FlightFilter(
        gps=False,
        model="flat",
        force_noise_m_per_s2_per_rt_hz=0.0,
        rate_noise_rad_per_s_per_rt_hz=0.0,
        covariance_hz=12.5,
        start_sigma_m=(1.0, 2.0, 3.0),
        start_velocity_sigma_m_per_s=(0.1, 0.2, 0.3),
        start_attitude_sigma_rad=(0.01, 0.02, 0.03),
    )
    level = attitude_of([0.2, -0.1, 2.0])
    force = np.array([3.0, -15.0, 5.0])
    recording = Recording(
        time_s=np.array([[0.0, 0.08]]),
        imu_time_s=np.array([[0.04, 0.08]]),
        specific_force_m_per_s2=np.tile(level.T @ force, (1, 2, 1)),
        angular_rate_rad_per_s=np.zeros((1, 2, 3)),
        start_geodetic=ORIGIN[None],
        start_velocity_m_per_s=np.zeros((1, 3)),
        start_attitude_rad=np.array([[0.2, -0.1, 2.0]]),
    )
    site = Site(corner_m=np.zeros((1, 2, 2)), origin_geodetic=ORIGIN[None])
    change = flat_transition(force, 0.08)
    wanted = change @ np.diag(sigmas**2) @ change.T
    found = navigate_flight(recording, site, settings).covariance[0, -1]
    spread = np.sqrt(np.diag(wanted))
    # The navigation frame turns by 6e-6 rad on the way.
    np.testing.assert_allclose(found / np.outer(spread, spread), wanted / np.outer(spread, spread), atol=1e-5)


def test_lagrange_meets_a_reading_between_samples_and_a_line_cuts_the_bend(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # To and fro along the meridian; samples 80 ms apart, GPS halfway, and of no weight.
    step_s, turn_rad_per_s, most_m_per_s = 0.08, np.pi, 5.0
    time_s = np.arange(126) * step_s

    def speed(at_s: Any) -> Any:
        sine = most_m_per_s * np.sin(turn_rad_per_s * at_s)
        return np.stack([sine, 0 * sine, 0 * sine], axis=-1)

    velocity = speed(time_s)
    attitude = np.tile(np.eye(3), (len(time_s), 1, 1))
    place = travelled(ORIGIN, velocity, step_s)
    force, rate = readings(place, velocity, attitude, step_s)
    gps_s = time_s[20:100] + 0.5 * step_s
    recording = Recording(
        time_s=time_s[None, ::10],
        imu_time_s=time_s[None, 1:],
        specific_force_m_per_s2=force[None],
        angular_rate_rad_per_s=rate[None],
        start_geodetic=place[None, 0],
        start_velocity_m_per_s=velocity[None, 0],
        start_attitude_rad=np.zeros((1, 3)),
        gps_time_s=gps_s[None],
        gps_geodetic=place[None, 20:100],
        gps_velocity_m_per_s=speed(gps_s)[None],
    )
    site = Site(corner_m=np.zeros((1, 2, 2)), origin_geodetic=ORIGIN[None])
    weak = FlightFilter(gps_sigma_m=(1e9, 1e9, 1e9), gps_velocity_sigma_m_per_s=(1e9, 1e9, 1e9))
    most = []
    for order in (None, 1, 2):
        settings = weak
        if order is not None:
            settings = dataclasses.replace(weak, interpolation="lagrange", interpolation_order=order)
        _, innovation = seen_by(monkeypatch, recording, site, settings)
        most.append(np.abs(innovation[:, 0, 3]).max())
    # Errors of interpolation halfway, by the next derivative: h^2 / 8, 3 h^4 / 128, 5 h^6 / 1024.
    bend = turn_rad_per_s * step_s
    wanted = most_m_per_s * np.array([bend**2 / 8, 3 * bend**4 / 128, 5 * bend**6 / 1024])
    np.testing.assert_allclose(most, wanted, rtol=0.05)


def test_units_change_the_condition_but_hardly_the_navigation() -> None:
    settings = FlightFilter()
    recording, site, _ = world(settings, worlds=2, seconds=20.0)
    metres = navigate_flight(recording, site, settings)
    radians = navigate_flight(recording, site, FlightFilter(units="radians"))
    np.testing.assert_allclose(radians.position_m, metres.position_m, atol=1e-4)
    assert (metres.innovation_condition < 1e5).all()
    assert (radians.innovation_condition > 1e12).all()


def test_the_outage_is_an_outage() -> None:
    settings = FlightFilter()
    recording, site, truth = world(settings, worlds=20, seconds=40.0)
    through = navigate_flight(recording, site, FlightFilter(outage_s=0.0))
    out = navigate_flight(recording, site, settings)
    before = through.time_s[0] < 24.0
    np.testing.assert_array_equal(through.position_m[:, before], out.position_m[:, before])
    end = np.searchsorted(through.time_s[0], 33.5)
    spread = [
        np.trace(found.covariance[:, end, :2, :2], axis1=-2, axis2=-1).mean() for found in (through, out)
    ]
    assert spread[1] > 3 * spread[0]
    # What stands in the recording during the outage is not looked at.
    assert recording.gps_geodetic is not None
    assert recording.gps_time_s is not None
    wrong = recording.gps_geodetic.copy()
    wrong[(recording.gps_time_s >= 24.0) & (recording.gps_time_s < 34.0)] += 0.01
    blind = navigate_flight(dataclasses.replace(recording, gps_geodetic=wrong), site, settings)
    np.testing.assert_array_equal(blind.position_m, out.position_m)
    # Landmarks mapped before bound the error in the outage.
    mapped = navigate_flight(recording, site, FlightFilter(slam=True))
    miss = [np.linalg.norm(errors(found, truth)[:, end, :2], axis=-1).mean() for found in (out, mapped)]
    assert miss[1] < miss[0]


def test_bias_feedback_finds_the_biases() -> None:
    settings = FlightFilter(states=15, force_bias_m_per_s2=0.2, rate_bias_rad_per_s=0.01)
    recording, site, _ = world(settings, worlds=6, noise=0.0, bias=1.0)
    found = navigate_flight(recording, site, dataclasses.replace(settings, outage_s=0.0))
    steady = np.random.default_rng(0)
    steady.uniform(0, 2 * np.pi, (6, 1))
    wanted = steady.standard_normal((6, 1, 6))[:, 0] * np.repeat([0.2, 0.01], 3)
    np.testing.assert_allclose(found.bias[:, 3:], wanted[:, 3:], atol=0.004)
    np.testing.assert_allclose(found.bias[:, 2], wanted[:, 2], atol=0.03)


def test_a_shorter_recording_is_filled_up() -> None:
    settings = FlightFilter(slam=True)
    recording, site, _ = world(settings, worlds=2, seconds=20.0)
    parts: dict[str, Any] = {}
    for times in ("imu_time_s", "time_s", "gps_time_s", "sighting_time_s"):
        values = getattr(recording, times).copy()
        values[1, values[1] > 14.0 + 1e-9] = np.nan
        parts[times] = values
    force = np.array(recording.specific_force_m_per_s2)
    force[1, 1400:] = np.nan
    found = navigate_flight(
        dataclasses.replace(recording, **parts, specific_force_m_per_s2=force), site, settings
    )
    whole = navigate_flight(recording, site, settings)
    np.testing.assert_array_equal(found.position_m[0], whole.position_m[0])
    np.testing.assert_allclose(found.position_m[1, :27], whole.position_m[1, :27], atol=1e-9)
    assert np.isnan(found.position_m[1, 29:]).all()
    assert np.isfinite(found.position_m[1, :29]).all()


def test_landmarks_without_a_direction_are_skipped_and_counted() -> None:
    settings = FlightFilter(slam=True)
    recording, site, truth = world(settings, worlds=2, seconds=10.0)
    seen, number = np.array(recording.sighting), np.array(recording.sighting_landmark)
    first = np.flatnonzero(number[0] >= 0)[:2]
    seen[0, first[0], 0] = 0.0
    seen[0, first[1], 2] = np.pi / 2
    found = navigate_flight(dataclasses.replace(recording, sighting=seen), site, settings)
    np.testing.assert_array_equal(found.skipped_sightings, [2, 0])
    assert np.isfinite(found.position_m).all()
    assert np.abs(errors(found, truth)[..., :3]).max() < 20


def spoiled(name: str, number: Any, value: Any) -> Any:
    def spoil(recording: Recording) -> Recording:
        values = np.array(getattr(recording, name))
        values[number] = value
        return dataclasses.replace(recording, **{name: values})

    return spoil


def early(times: str, name: str, value: float) -> Any:
    """Put the first reading of the second flight before its start."""

    def spoil(recording: Recording) -> Recording:
        return spoiled(name, (1, 0), value)(spoiled(times, (1, 0), -0.01)(recording))

    return spoil


def moved(name: str, number: Any, by_s: float) -> Any:
    """Let the clock of a sensor be ahead."""
    return lambda recording: spoiled(name, number, np.array(getattr(recording, name))[number] + by_s)(
        recording
    )


def scaled(name: str, factor: float) -> Any:
    return lambda recording: spoiled(name, slice(None), factor * np.array(getattr(recording, name)))(
        recording
    )


def slowed(recording: Recording, world: int, factor: float) -> Recording:
    """Let the inertial readings of one flight come at another rate."""
    time_s = np.array(recording.imu_time_s)
    time_s[world] *= factor
    return dataclasses.replace(recording, imu_time_s=time_s)


def cut(recording: Recording, count: int) -> Recording:
    """Let the second flight end after so many readings."""
    time_s = np.array(recording.imu_time_s)
    time_s[1, count:] = np.nan
    return dataclasses.replace(recording, imu_time_s=time_s, gps_outage_s=None)


def test_what_does_not_count_may_stand_before_the_start() -> None:
    settings = FlightFilter(slam=True, fixes=True)
    recording, site, _ = world(settings, worlds=2, seconds=12.0)
    none = early("sighting_time_s", "sighting_landmark", -1)(early("time_s", "fix_m", np.nan)(recording))
    check_flight(none, site, settings)
    # Nor does a refused one matter to a filter that does not look at it.
    both = early("sighting_time_s", "sighting_landmark", 3)(early("time_s", "fix_m", 0.0)(recording))
    check_flight(both, site, FlightFilter())


def test_flights_of_a_slower_unit_are_navigated_alone() -> None:
    recording, site, _ = world(FlightFilter(), worlds=2, seconds=12.0)
    slow = slowed(recording, 1, 2.0)
    check_flight(one(slow, 1), one(site, 1), FlightFilter())
    # A little jitter is no other rate.
    check_flight(slowed(recording, 1, 1.01), site, FlightFilter())


@pytest.mark.parametrize(
    ("spoil", "options", "message"),
    [
        (spoiled("gps_time_s", (0, 0), -3.0), {}, "before the first inertial reading"),
        (spoiled("gps_time_s", (0, 2), 0.5), {}, "does not increase"),
        (spoiled("gps_outage_s", (0, 1), 900.0), {}, "longer than the flight"),
        (spoiled("gps_outage_s", (0, 1), 0.0), {}, "ends before it begins"),
        (lambda recording: recording, {"outage_s": 500.0}, "longer than the flight"),
        (spoiled("start_geodetic", (0, 0), np.pi / 2), {}, "equator"),
        (spoiled("start_attitude_rad", (1, 2), np.nan), {}, "not a finite number"),
        (spoiled("specific_force_m_per_s2", (0, 5, 1), np.nan), {}, "not a finite number"),
        (spoiled("angular_rate_rad_per_s", (0, 5, 1), np.inf), {}, "not a finite number"),
        (spoiled("imu_time_s", (0, 5), 0.01), {}, "does not increase"),
        (spoiled("imu_time_s", (0, slice(50, None)), 3.0), {}, "0.1 s|increase"),
        (spoiled("imu_time_s", (0, 5), np.nan), {}, "missing or infinite"),
        (spoiled("fix_m", (0, 5), np.inf), {"fixes": True}, "infinite"),
        (spoiled("sighting", (0, 5), np.inf), {"slam": True}, "infinite"),
        (early("time_s", "fix_m", 0.0), {"fixes": True}, r"fix_m\[1, 0\].* before the first inertial"),
        (
            early("sighting_time_s", "sighting_landmark", 3),
            {"slam": True},
            "sighting_time_s.* before the",
        ),
        (lambda r: slowed(r, 1, 2.0), {}, "one by one"),
        (
            lambda r: cut(r, 5),
            {"interpolation": "lagrange", "interpolation_order": 3},
            "fewer readings than the 7",
        ),
        (lambda r: dataclasses.replace(r, gps_geodetic=None), {}, "gps_geodetic"),
        (lambda r: dataclasses.replace(r, fix_m=None), {"fixes": True}, "fix_m"),
        (lambda r: dataclasses.replace(r, sighting=None), {"slam": True}, "sighting"),
        (lambda r: dataclasses.replace(r, gps_lever_arm_m=np.zeros(3)), {}, "gps_lever_arm_m"),
        (lambda r: dataclasses.replace(r, gps_geodetic=np.zeros((2, 3, 3))), {}, "gps_geodetic"),
        (lambda recording: recording, {"states": 12}, "9 or 15"),
        (lambda recording: recording, {"model": "round"}, "model"),
        (lambda recording: recording, {"units": "feet"}, "units"),
        (lambda recording: recording, {"interpolation": "cubic"}, "interpolation"),
        (lambda recording: recording, {"interpolation_order": -1}, "interpolation_order"),
        (lambda recording: recording, {"gps_sigma_m": (1.0, 0.0, 1.0)}, "gps_sigma_m"),
        (lambda recording: recording, {"noise_factor": -1.0}, "noise_factor"),
        (lambda recording: recording, {"covariance_hz": "20"}, "covariance_hz='20'.*not a number"),
        (lambda recording: recording, {"covariance_hz": 0.5}, "covariance_hz=0.5.*below 1"),
        (lambda recording: recording, {"outage_s": "40"}, "outage_s='40'.*not a number"),
        (lambda recording: recording, {"interpolation_order": 1.5}, "interpolation_order=1.5.*whole"),
        (lambda recording: recording, {"gps_sigma_m": (1, 2)}, r"gps_sigma_m=\(1, 2\).*three numbers"),
        (lambda recording: recording, {"start_sigma_m": ("1", 1, 1)}, "start_sigma_m.*three numbers"),
        (lambda recording: recording, {"states": "15"}, "states='15'.*whole"),
        (lambda recording: recording, {"states": 9.0}, "states=9.0.*whole"),
        (lambda recording: recording, {"closed_loop": "no"}, "closed_loop='no'.*true nor false"),
        (lambda recording: recording, {"noise_factor": True}, "noise_factor=True.*not a number"),
        (spoiled("start_geodetic", (1, 0), 35.7), {}, r"start_geodetic\[1\] = \[35.7, .*latitude"),
        (spoiled("start_geodetic", (1, 1), 0.6), {}, r"start_geodetic\[1\] = .*100 km.*Check radians"),
        (spoiled("gps_geodetic", (1, 3, 0), 35.7), {}, r"gps_geodetic\[1, 3\] = \[35.7, .*latitude"),
        (spoiled("gps_geodetic", (1, 3, 1), 0.6), {}, r"gps_geodetic\[1, 3\] = .*100 km.*the order"),
        (moved("gps_time_s", 1, 500.0), {}, r"gps_time_s\[1\].* from 500.* flight from 0 to 12 s"),
        (moved("gps_time_s", slice(None), 500.0), {}, r"gps_time_s\[0\].* from 500.* flight from 0 to 12"),
        (moved("time_s", 1, 500.0), {"fixes": True}, r"time_s of fix_m\[1\].* flight from 0 to 12 s"),
        (
            lambda r: dataclasses.replace(r, sighting_time_s=1000 * np.array(r.sighting_time_s)),
            {"slam": True},
            r"sighting_time_s\[0\].* from 200 to .* flight from 0 to 12 s.*in seconds",
        ),
        (spoiled("sighting", (0, slice(None), 0), -1.0), {"slam": True}, "range.*units"),
        (spoiled("sighting", (0, slice(None), 1), 30.0), {"slam": True}, "bearing.*units"),
        (spoiled("sighting", (0, slice(None), 2), -1.6), {"slam": True}, "elevation.*units"),
        (spoiled("start_attitude_rad", (1, 2), -90.0), {}, r"start_attitude_rad\[1, 2\].*units"),
        (scaled("specific_force_m_per_s2", 1 / 9.81), {}, r"specific_force_m_per_s2\[0\].*units"),
        (scaled("specific_force_m_per_s2", 1000.0), {}, r"specific_force_m_per_s2\[0\].*units"),
    ],
)
def test_bad_input_is_refused(spoil: Any, options: dict[str, Any], message: str) -> None:
    recording, site, _ = world(FlightFilter(), worlds=2, seconds=12.0)
    check_flight(recording, site, FlightFilter(slam=True, fixes=True))
    with pytest.raises(InputError, match=message):
        navigate_flight(spoil(recording), site, FlightFilter(**options))


@pytest.mark.parametrize("origin", [(np.nan, 0.9, 0.0), (35.7, 51.4, 1200.0), (np.pi / 2, 0.9, 0.0)])
def test_an_origin_at_no_place_is_refused(origin: tuple[float, float, float]) -> None:
    recording, site, _ = world(FlightFilter(), worlds=2, seconds=12.0)
    moved_site = dataclasses.replace(site, origin_geodetic=np.tile(origin, (2, 1)))
    with pytest.raises(InputError, match=r"site.origin_geodetic\[0\] = .*Check radians"):
        navigate_flight(recording, moved_site, FlightFilter())


def test_gps_that_the_outage_leaves_only_behind_the_flight_counts_for_nothing() -> None:
    settings = FlightFilter()
    recording, site, _ = world(settings, worlds=2, seconds=12.0)
    gps_s = np.array(recording.gps_time_s)
    gps_s[:, 5:] += 100.0
    late = dataclasses.replace(recording, gps_time_s=gps_s, gps_outage_s=np.tile([0.0, 11.0], (2, 1)))
    found = navigate_flight(late, site, settings)
    assert (found.degrees_of_freedom["gps"] == 0).all()
    np.testing.assert_array_equal(
        found.position_m, navigate_flight(recording, site, FlightFilter(gps=False)).position_m
    )


def test_a_site_without_an_origin_is_refused() -> None:
    recording, _, _ = world(FlightFilter(), worlds=2, seconds=12.0)
    with pytest.raises(InputError, match="origin_geodetic"):
        navigate_flight(recording, Site(corner_m=np.zeros((2, 2, 2))), FlightFilter())


def test_readings_count_at_their_own_time() -> None:
    # The place is known, the velocity is 5 m/s off: the first GPS tells it, if both times are the same.
    settings = FlightFilter(
        gps_sigma_m=(1e-3, 1e-3, 1e-3),
        start_sigma_m=(1e-3, 1e-3, 1e-3),
        start_velocity_sigma_m_per_s=(10.0, 10.0, 10.0),
        start_attitude_sigma_rad=(1e-6, 1e-6, 1e-6),
        force_noise_m_per_s2_per_rt_hz=1e-5,
    )
    recording, site, truth = world(settings, worlds=8, seconds=12.0, noise=0.0)
    assert recording.start_velocity_m_per_s is not None
    off = dataclasses.replace(
        recording,
        gps_velocity_m_per_s=None,
        gps_outage_s=None,
        start_velocity_m_per_s=recording.start_velocity_m_per_s + 5.0,
    )
    found = navigate_flight(off, site, settings)
    assert found.time_s[0, 2] == 1.0
    assert np.abs(errors(found, truth)[:, 2, 3:6]).max() < 0.03
