"""The synthetic worlds of the study sar_flight: laps around a city block with GPS, landmarks and radio fixes.

See Mirzababaei & Akbari, sections 1 to 5. The paper prints the height of the flight and the error of the
fixes; all the rest is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.geodetic import MOST_LATITUDE_RAD, position_scale_m, to_local
from positioning.inertial.geodetic_strapdown import readings
from positioning.inertial.strapdown import GRAVITY_M_PER_S2
from positioning.model import Array, Recording, Site, Truth, Worlds
from positioning.simulation.flight import (
    Eye,
    FlightDraws,
    Lap,
    Motion,
    Pilot,
    antenna_at,
    block_walls,
    draw_flight,
    fly,
    look,
    on_facades,
)
from positioning.simulation.imu import Triad, TriadDraws, draw_triad, gauss_markov, read_triad, smooth_field
from positioning.simulation.settings import number, numbers, span, whole

FIX_ERRORS = ("white", "place")
"""Errors of the fixes: one by one, or a fixed function of the place."""

# Plane waves of which an error that hangs on the place is the sum.
_WAVES = 128

# Worlds whose motion is made at a time: enough for NumPy, and little memory.
_CHUNK = 4

_FORCE, _RATE = "specific_force_m_per_s2", "angular_rate_rad_per_s"


class Block(NamedTuple):
    """The place.

    Attributes
    ----------
    half_m
        Half of the sides of the block, along x and y, [world, 2], metres.
    wall_m
        [world, wall, 2, 2], metres.
    landmark_m
        East, north, up, [world, l, 3], metres.
    lap
        The course in the middle of the streets.
    """

    half_m: Array
    wall_m: Array
    landmark_m: Array
    lap: Lap


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Mirzababaei & Akbari, sections 1 to 5. A robot flies around a block, in the middle of the streets, in
    one of both directions and from anywhere on the course. It is in flight from the first to the last
    instant. The block is one building; others stand across the streets. Landmarks are points just off the
    facades, evenly spread with one in each of equal parts of the block's outline, in turn on the block and
    across the street.

    Readings of the inertial measurement unit are the constant specific force and angular rate that lead
    exactly from one sample to the next, with the errors of ordinary data sheets. GPS has a clock of its own
    and its antenna a lever arm; its position errors are a white part and one that wanders. The start is noted
    with the errors of GPS, and with those of a levelling by the same accelerometers: what their bias turns
    the plumb line by, and a rest. The readings of GPS in the outage stand in the recording.

    The sensor of landmarks tells which one it sees. Fixes of the radio system have Gaussian errors along both
    axes, so that their size is a Rayleigh variable, either one by one, or as a fixed smooth function of the
    place: then a second lap meets the errors of the first.

    Everything is drawn as standard numbers and scaled afterwards, and path, inertial sensors, GPS, landmarks
    and fixes have a stream each: worlds of equal seeds share all but what a setting scales. ``noise``
    multiplies every error; with 0, the readings lead from the start back to the path.

    Parameters
    ----------
    settings
        As in ``data/papers/robo_sar.yaml``, those of ``sar_flight``, all of them. Other keys are left alone.
    rngs
        One generator for each world; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.wall_m`` [world, 8, 2, 2],
        ``site.origin_geodetic`` [world, 3]; ``recording.time_s`` [world, n]; ``recording.imu_time_s``
        [world, i], ``.specific_force_m_per_s2`` and ``.angular_rate_rad_per_s`` [world, i, 3], in single
        precision unless ``noise`` is 0; ``recording.gps_time_s`` [world, g], ``.gps_geodetic`` and
        ``.gps_velocity_m_per_s`` [world, g, 3], ``.gps_lever_arm_m`` [world, 3], ``.gps_outage_s``
        [world, 2]; ``recording.start_geodetic``, ``.start_velocity_m_per_s``, ``.start_attitude_rad``
        [world, 3]; ``recording.sighting_time_s`` and ``.sighting_landmark`` [world, o], ``.sighting``
        [world, o, 3], in the order of time, NaN and -1 after the last; ``.sighting_lever_arm_m`` [world, 3];
        ``recording.fix_m`` [world, n, 1, 2], NaN at epochs without a fix.

        Truth ``truth.position_m`` and ``truth.path_m`` [world, n, 2], ``truth.height_m`` [world, n],
        ``truth.velocity_m_per_s`` and ``truth.attitude_rad`` [world, n, 3] of the inertial measurement unit;
        ``truth.landmark_m`` [world, l, 3].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, no generator, or a first lap that the outage cuts.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    count = len(rngs)
    streams = [rng.spawn(5) for rng in rngs]
    paths = [_draw_path(path) for path, *_ in streams]
    fixes = [_draw_fixes(values, fix) for *_, fix in streams]
    # The noise of the sightings follows from the same stream, below.
    lands = [landmark.random((2, values["landmarks"])) for *_, landmark, _ in streams]
    place = _block(values, np.stack([path["block"] for path in paths]), np.stack(lands))
    origin = np.array([*np.deg2rad(values["origin_deg"]), values["origin_height_m"]])

    made: list[dict[str, Any]] = []
    for begin in range(0, count, _CHUNK):
        part = slice(begin, begin + _CHUNK)
        draws = FlightDraws(*map(np.stack, zip(*(path["flight"] for path in paths[part]), strict=True)))
        lap = Lap(side_m=place.lap.side_m[part], corner_radius_m=place.lap.corner_radius_m)
        motion = fly(values["sample_s"], lap, values["pilot"], draws, origin_geodetic=origin)
        _check_first_lap(values, lap, motion)
        drawn = _draws([_draw_sensors(values, imu, gps) for _, imu, gps, *_ in streams[part]])
        found = _inertial_and_gps(values, motion, drawn)
        found |= _truth(values, motion, origin)
        local_m = to_local(motion.at(values["sighting_sample"]).geodetic, origin)
        attitude = motion.at(values["sighting_sample"]).attitude
        seen = [
            _sightings(
                values,
                place.landmark_m[world],
                place.wall_m[world],
                local_m[world - begin],
                attitude[world - begin],
                streams[world][3],
            )
            for world in range(count)[part]
        ]
        found |= _draws(seen)
        made.append(found)
    all_of = {name: np.concatenate([found[name] for found in made]) for name in made[0]}
    truth = Truth(
        path_m=all_of["position_m"],
        landmark_m=place.landmark_m,
        **{name: all_of[name] for name in ("position_m", "height_m", "velocity_m_per_s", "attitude_rad")},
    )
    error_m = _fix_errors(values, truth.position_m, _draws(fixes))
    fixed = np.isfinite(values["fix_at"])[:, None]
    begin_s, lasts_s = values["outage_begin_s"], values["outage_s"]
    facade_m = place.half_m + values["street_m"]
    site = Site(
        corner_m=np.stack([-facade_m, facade_m], axis=-2),
        wall_m=place.wall_m,
        origin_geodetic=_each(count, origin),
    )
    recording = Recording(
        time_s=_each(count, values["epoch_s"]),
        imu_time_s=_each(count, values["sample_s"][1:]),
        gps_time_s=_each(count, values["gps_s"]),
        gps_lever_arm_m=_each(count, values["gps_lever_arm_m"]),
        gps_outage_s=_each(count, [begin_s, begin_s + lasts_s]),
        sighting_landmark=all_of["sighting_landmark"].astype(np.int64),
        sighting_lever_arm_m=_each(count, values["eye"].lever_arm_m),
        fix_m=np.where(fixed, truth.position_m + error_m, np.nan)[:, :, None],
        **{name: all_of[name] for name in _RECORDED},
    )
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())


_RECORDED: tuple[str, ...] = (_FORCE, _RATE, "gps_geodetic", "gps_velocity_m_per_s", "start_geodetic")
_RECORDED += ("start_velocity_m_per_s", "start_attitude_rad", "sighting_time_s", "sighting")


def _block(values: Mapping[str, Any], uniform: Array, landmark: Array) -> Block:
    """Return the places of all worlds from uniform numbers, [world, 2] and [world, 2, l]."""
    limits = np.array([values["block_length_m"], values["block_width_m"]])
    half_m = 0.5 * (limits[:, 0] + (limits[:, 1] - limits[:, 0]) * uniform)
    street_m, number_of = values["street_m"], values["landmarks"]
    share = (np.arange(number_of) + landmark[:, 0]) / number_of
    low, high = values["landmark_height_m"]
    level_m = on_facades(half_m, street_m, share, off_m=values["landmark_off_m"])
    height_m = low + (high - low) * landmark[:, 1]
    return Block(
        half_m,
        block_walls(half_m, street_m),
        np.concatenate([level_m, height_m[..., None]], axis=-1),
        Lap(side_m=2 * half_m + street_m, corner_radius_m=values["corner_radius_m"]),
    )


def _inertial_and_gps(values: Mapping[str, Any], motion: Motion, draws: Mapping[str, Any]) -> dict[str, Any]:
    """Return what inertial sensors and GPS read, and the start as it is noted."""
    rate_hz, noise = values["imu_rate_hz"], values["noise"]
    ideal = dict(
        zip(
            (_FORCE, _RATE),
            readings(motion.geodetic, motion.velocity_m_per_s, motion.attitude, 1 / rate_hz),
            strict=True,
        )
    )
    single = np.float32 if noise > 0 else np.float64
    found: dict[str, Any] = {
        name: read_triad(true, draws[name], values["triads"][name], sample_rate_hz=rate_hz).astype(single)
        for name, true in ideal.items()
    }
    antenna_geodetic, antenna_velocity = antenna_at(
        motion,
        ideal[_FORCE],
        ideal[_RATE],
        values["gps_s"],
        sample_rate_hz=rate_hz,
        lever_arm_m=values["gps_lever_arm_m"],
    )
    steps = values["gps_correlation_s"] * values["gps_rate_hz"]
    wandering = np.moveaxis(gauss_markov(draws["gps_wandering"], correlation=steps), -1, -2)
    wandering = noise * np.asarray(values["gps_correlated_m"]) * wandering
    white_m = noise * np.asarray(values["gps_white_m"])
    error_m = wandering + white_m * draws["gps_white"]
    # North, east, down on the scale of geodetic positions, whose height grows upwards.
    found["gps_geodetic"] = antenna_geodetic + error_m / position_scale_m(antenna_geodetic)
    deviation = noise * np.asarray(values["gps_velocity_m_per_s"])
    found["gps_velocity_m_per_s"] = antenna_velocity + deviation * draws["gps_velocity"]

    start = motion.at(np.zeros(1, dtype=np.int64))
    start_m = wandering[:, 0] + white_m * draws["start_position"]
    found["start_geodetic"] = start.geodetic[:, 0] + start_m / position_scale_m(start.geodetic[:, 0])
    found["start_velocity_m_per_s"] = (
        start.velocity_m_per_s[:, 0] + noise * values["start_velocity_m_per_s"] * draws["start_velocity"]
    )
    angles = noise * np.deg2rad(
        [values["start_level_deg"], values["start_level_deg"], values["start_heading_deg"]]
    )
    error = angles * draws["start_attitude"]
    # At rest a level unit reads -g down. A bias to the right looks like a left side that is down, one to the
    # front like a nose that is up.
    triad, own = values["triads"][_FORCE], draws[_FORCE]
    bias = triad.turn_on_bias * own.turn_on + triad.in_run_bias * own.in_run[..., 0]
    error[:, 0] -= bias[:, 1] / GRAVITY_M_PER_S2
    error[:, 1] += bias[:, 0] / GRAVITY_M_PER_S2
    noted = start.roll_pitch_yaw_rad[:, 0] + error
    found["start_attitude_rad"] = _wrapped(noted)
    return found


def _sightings(
    values: Mapping[str, Any],
    landmark_m: Array,
    wall_m: Array,
    place_m: Array,
    attitude: Array,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the sightings of one world, filled up; the sensor's own noise comes from the generator."""
    sighting, seen = look(landmark_m, place_m, attitude, wall_m, values["eye"])
    deviation = np.array([values["sighting_range_m"], *[values["sighting_angle_rad"]] * 2])
    sighting += values["noise"] * deviation * rng.standard_normal(sighting.shape)
    sighting[..., 1] = _wrapped(sighting[..., 1])
    time, landmark = np.nonzero(seen)
    most = len(values["sighting_s"]) * values["eye"].at_once
    found = {
        "sighting_time_s": np.full(most, np.nan),
        "sighting_landmark": np.full(most, -1.0),
        "sighting": np.full((most, 3), np.nan),
    }
    found["sighting_time_s"][: len(time)] = values["sighting_s"][time]
    found["sighting_landmark"][: len(time)] = landmark
    found["sighting"][: len(time)] = sighting[time, landmark]
    return found


def _truth(values: Mapping[str, Any], motion: Motion, origin: Array) -> dict[str, Array]:
    """Return the motion at the epochs."""
    epochs = motion.at(values["epoch_sample"])
    local_m = to_local(epochs.geodetic, origin)
    return {
        "position_m": local_m[..., :2],
        "height_m": local_m[..., 2],
        "velocity_m_per_s": epochs.velocity_m_per_s,
        "attitude_rad": epochs.roll_pitch_yaw_rad,
    }


def _fix_errors(values: Mapping[str, Any], position_m: Array, draws: Mapping[str, Array]) -> Array:
    """Return the error of a fix at each epoch, [world, n, 2], metres."""
    if values["fix_errors"] == "white":
        number_of = np.nan_to_num(values["fix_at"]).astype(np.int64)
        unit = draws["white"][:, number_of]
    else:
        unit = np.stack(
            [
                smooth_field(wave, 2 * np.pi * phase, place, correlation_m=values["fix_correlation_m"])
                for wave, phase, place in zip(draws["wave"], draws["wave_phase"], position_m, strict=True)
            ]
        )
    return np.asarray(values["noise"] * values["fix_error_m"] * unit)


def _check_first_lap(values: Mapping[str, Any], lap: Lap, motion: Motion) -> None:
    before = motion.along_m[:, int(values["outage_begin_s"] * values["imu_rate_hz"])]
    if values["outage_s"] > 0 and (before < lap.length_m).any():
        raise InputError(
            "setting outage_begin_s",
            f"after {values['outage_begin_s']} s a robot has flown {before.min():.0f} m, and a lap is"
            f" {lap.length_m[np.argmin(before - lap.length_m)]:.0f} m long",
            "Give a later begin, so that the first lap is flown with GPS",
        )


def _draw_path(rng: np.random.Generator) -> dict[str, Any]:
    """Return the random numbers of block and flight of one world."""
    # The order of the draws is part of the world, here and below.
    return {"block": rng.random(2), "flight": draw_flight(rng)}


def _draw_sensors(
    values: Mapping[str, Any], imu: np.random.Generator, gps: np.random.Generator
) -> dict[str, Any]:
    """Return the random numbers of inertial sensors and GPS of one world."""
    count, samples = len(values["gps_s"]), len(values["sample_s"]) - 1
    return {
        "start_attitude": imu.standard_normal(3),
        **{name: draw_triad(imu, samples, sample_rate_hz=values["imu_rate_hz"]) for name in (_FORCE, _RATE)},
        "start_position": gps.standard_normal(3),
        "start_velocity": gps.standard_normal(3),
        "gps_white": gps.standard_normal((count, 3)),
        "gps_velocity": gps.standard_normal((count, 3)),
        "gps_wandering": gps.standard_normal((3, count)),
    }


def _draw_fixes(values: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Array]:
    """Return the random numbers of the fixes of one world, for both kinds of errors."""
    return {
        "wave": rng.standard_normal((_WAVES, 2)),
        "wave_phase": rng.random((_WAVES, 2)),
        "white": rng.standard_normal((values["fixes"], 2)),
    }


def _draws(worlds: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Stack the random numbers, or the arrays, of worlds."""
    return {
        name: TriadDraws(*map(np.stack, zip(*(world[name] for world in worlds), strict=True)))
        if isinstance(first, TriadDraws)
        else np.stack([world[name] for world in worlds])
        for name, first in worlds[0].items()
    }


def _wrapped(angle_rad: Array) -> Array:
    """Return angles from -pi to pi."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2 * np.pi) - np.pi)


def _each(count: int, value: ArrayLike) -> Array:
    """Repeat what is the same in all worlds."""
    array = np.asarray(value, dtype=np.float64)
    return np.repeat(array[None], count, axis=0)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work, with what follows from them."""
    values: dict[str, Any] = {
        "origin_deg": numbers(settings, "origin_deg", 2),
        "origin_height_m": number(settings, "origin_height_m"),
        "block_length_m": span(settings, "block_length_m", least=0),
        "block_width_m": span(settings, "block_width_m", least=0),
        "gps_lever_arm_m": numbers(settings, "gps_lever_arm_m", 3),
        "gps_offset_s": number(settings, "gps_offset_s", least=0),
        "landmarks": whole(settings, "landmarks", least=1),
        "landmark_height_m": span(settings, "landmark_height_m"),
        "fix_errors": _choice(settings, "fix_errors", FIX_ERRORS),
        "pilot": _pilot(settings),
        "eye": _eye(settings),
    }
    positive = [
        *("street_m", "corner_radius_m", "duration_s", "epoch_rate_hz", "imu_rate_hz", "gps_rate_hz"),
        *("gps_correlation_s", "sighting_rate_hz", "fix_rate_hz", "fix_correlation_m"),
    ]
    not_negative = [
        *("noise", "start_velocity_m_per_s", "start_level_deg", "start_heading_deg", "landmark_off_m"),
        *("outage_begin_s", "outage_s", "sighting_range_m", "sighting_angle_rad", "fix_error_m"),
    ]
    values |= {name: number(settings, name, above=0) for name in positive}
    values |= {name: number(settings, name, least=0) for name in not_negative}
    for name in ("gps_white_m", "gps_correlated_m", "gps_velocity_m_per_s"):
        values[name] = numbers(settings, name, 3, least=0)
    values["triads"] = _triads(settings, values["noise"])

    most_deg = np.rad2deg(MOST_LATITUDE_RAD)
    _require(
        abs(values["origin_deg"][0]) < most_deg,
        "origin_deg",
        f"the latitude is not within {most_deg:.1f} degrees of the equator",
        "Give latitude and longitude, away from the poles",
    )
    side = values["block_length_m"][0], values["block_width_m"][0]
    for name, shortest in zip(("block_length_m", "block_width_m"), side, strict=True):
        _require(shortest > 0, name, "the block may have no size", "Give lengths above zero")
    street_m = values["street_m"]
    lap = Lap(side_m=np.array(side) + street_m, corner_radius_m=values["corner_radius_m"])
    _require(
        bool(lap.straight_m.min() >= 0),
        "corner_radius_m",
        f"corners of {values['corner_radius_m']} m do not fit a side of {lap.side_m.min():.1f} m",
        "Give a smaller radius",
    )
    # In its middle a corner is nearest to that of the block.
    middle_m = lap.place_m(0.5 * lap.straight_m[0] + 0.5 * lap.corner_m)
    _require(
        bool(middle_m[0] > 0.5 * side[0] and middle_m[1] < -0.5 * side[1]),
        "corner_radius_m",
        f"corners of {values['corner_radius_m']} m cut through the block beside a street of {street_m} m",
        "Give a smaller radius or a wider street",
    )
    _require(
        values["landmark_off_m"] < street_m,
        "landmark_off_m",
        f"{values['landmark_off_m']} m is not within a street of {street_m} m",
        "Give less",
    )
    rate_hz, lasts_s = values["imu_rate_hz"], values["duration_s"]
    samples = round(lasts_s * rate_hz)
    for name in ("epoch_rate_hz", "sighting_rate_hz"):
        _divides(name, rate_hz / values[name], f"imu_rate_hz, {rate_hz}")
    _divides("fix_rate_hz", values["epoch_rate_hz"] / values["fix_rate_hz"], "epoch_rate_hz")
    _require(
        samples >= 2 and abs(samples - lasts_s * rate_hz) < 1e-6,
        "duration_s",
        f"{lasts_s} s are no whole number of samples at {rate_hz} Hz, or fewer than two",
        "Give whole samples",
    )
    _require(
        values["outage_begin_s"] + values["outage_s"] <= lasts_s,
        "outage_s",
        f"from {values['outage_begin_s']} s on, it ends after a flight of {lasts_s} s",
        "Give a shorter outage or a longer flight",
    )
    _require(
        values["gps_offset_s"] < lasts_s,
        "gps_offset_s",
        f"the flight of {lasts_s} s ends before the first reading",
        "Give less",
    )
    sample_s = np.arange(samples + 1) / rate_hz
    epoch_sample = np.arange(0, samples + 1, round(rate_hz / values["epoch_rate_hz"]))
    # Neither sightings nor fixes at the start itself, where nothing has moved yet.
    stride = round(rate_hz / values["sighting_rate_hz"])
    sighting_sample = np.arange(stride, samples + 1, stride)
    every = round(values["epoch_rate_hz"] / values["fix_rate_hz"])
    epoch = np.arange(len(epoch_sample))
    fix_at = np.where((epoch % every == 0) & (epoch > 0), epoch // every - 1.0, np.nan)
    readings_of_gps = int(np.ceil((lasts_s - values["gps_offset_s"]) * values["gps_rate_hz"] - 1e-9))
    return {
        **values,
        "sample_s": sample_s,
        "epoch_sample": epoch_sample,
        "epoch_s": sample_s[epoch_sample],
        "sighting_sample": sighting_sample,
        "sighting_s": sample_s[sighting_sample],
        "gps_s": values["gps_offset_s"] + np.arange(readings_of_gps) / values["gps_rate_hz"],
        "fix_at": fix_at,
        "fixes": int(np.isfinite(fix_at).sum()),
    }


def _pilot(settings: Mapping[str, Any]) -> Pilot:
    """Return how the course is flown."""
    spans = {}
    for name in ("speed_m_per_s", "speed_change_m", "height_period_s", "wobble_hz"):
        spans[name] = span(settings, name, least=0)
        _require(spans[name][0] > 0, name, "it may be zero", "Give numbers above zero")
    return Pilot(
        speed_m_per_s=spans["speed_m_per_s"],
        speed_change_m=spans["speed_change_m"],
        height_m=number(settings, "height_m"),
        height_change_m=number(settings, "height_change_m", least=0),
        height_period_s=spans["height_period_s"],
        wobble_rad=float(np.deg2rad(number(settings, "wobble_deg", least=0))),
        wobble_hz=spans["wobble_hz"],
    )


def _eye(settings: Mapping[str, Any]) -> Eye:
    """Return the sensor of landmarks."""
    return Eye(
        reach_m=number(settings, "sighting_reach_m", above=0),
        bearing_rad=float(np.deg2rad(number(settings, "sighting_bearing_deg", above=0, most=180))),
        elevation_rad=float(np.deg2rad(number(settings, "sighting_elevation_deg", above=0, most=89))),
        at_once=whole(settings, "sightings_at_once", least=1),
        lever_arm_m=numbers(settings, "sighting_lever_arm_m", 3),
    )


def _triads(settings: Mapping[str, Any], noise: float) -> dict[str, Triad]:
    """Return the errors of accelerometers and gyroscopes."""
    correlation_s = number(settings, "in_run_correlation_s", above=0)
    units = {
        _FORCE: ("accelerometer", "m_per_s2", "m_per_s2_sqrt_hz", 1.0),
        _RATE: ("gyro", "deg_per_s", "deg_per_s_sqrt_hz", float(np.deg2rad(1.0))),
    }
    found = {}
    for reading, (sensor, unit, density, scale) in units.items():
        turn_on, in_run, white, share = (
            noise * number(settings, f"{sensor}_{name}", least=0)
            for name in (
                f"turn_on_bias_{unit}",
                f"in_run_bias_{unit}",
                f"noise_density_{density}",
                "scale_deviation",
            )
        )
        found[reading] = Triad(
            turn_on_bias=scale * turn_on,
            in_run_bias=scale * in_run,
            in_run_correlation_s=correlation_s,
            noise_density=scale * white,
            scale_deviation=share,
        )
    return found


def _choice(settings: Mapping[str, Any], name: str, choices: Sequence[str]) -> str:
    # Asked for as a number, a setting that is missing is named like any other.
    found = settings[name] if name in settings else number(settings, name)
    if found not in choices:
        raise InputError(f"setting {name}", f"{found!r} is none of {', '.join(choices)}", "Give one of them")
    return str(found)


def _divides(name: str, ratio: float, of: str) -> None:
    _require(
        round(ratio) >= 1 and abs(ratio - round(ratio)) < 1e-9,
        name,
        f"it is no whole part of {of}",
        "Give a rate that divides it",
    )


def _require(fits: bool, name: str, limit: str, cure: str) -> None:
    if not fits:
        raise InputError(f"setting {name}", limit, cure)
