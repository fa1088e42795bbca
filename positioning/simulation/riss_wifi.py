"""The synthetic worlds of the study riss_wifi: a floor, a drive with odometer and gyroscope, a radio map.

See Atia et al., sections 2, 3 and 6. The paper reports lengths, way-points, the gyroscope of its Table 1
and a map of 67 places by 132 MAC addresses; all the rest is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.model import Array, Recording, Site, Survey, Truth, Worlds
from positioning.radio import interpolate, path_loss_dbm, receive
from positioning.simulation.imu import (
    Gyro,
    GyroDraws,
    draw_gyro,
    read_encoder,
    read_gyro,
    vertical_earth_rate,
)
from positioning.simulation.settings import number, numbers, rows, span, whole
from positioning.simulation.wheeled import Course, Schedule, rounded_course, schedule

MERGE_S = 0.001
"""A scan this close to the passage of a way-point, or closer, shares its epoch."""

# Distance between the places of the course around which nodes of the shadowing's grid are kept.
_COURSE_STEP_M = 0.25

# The factorisation of the shadowing's correlation takes memory with the square of this number.
_MOST_NODES = 2000

# Relative to the variance: keeps the factorisation going, and is far below what a receiver resolves.
_JITTER = 1e-9


class Field(NamedTuple):
    """What does not differ between worlds: where the drive leads, and the grid of the shadowing.

    Attributes
    ----------
    course
        The line that all drives follow.
    map_m
        Places of the radio map, [point, 2], metres.
    node
        Columns and rows of the nodes at which shadowing is drawn, [node, 2].
    factor
        What turns standard normals at the nodes into shadowing of unit deviation, [node, node].
    """

    course: Course
    map_m: Array
    node: NDArray[np.int64]
    factor: Array


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Atia et al., sections 2, 3 and 6. In all worlds a robot drives the same ``track_length_m`` along a
    chain of corridors with round corners. Way-points, speeds and stops differ: it rests at the first
    way-point, at some between, and at the last; each leg has a speed of its own, of which all worlds have an
    equal mix. Gyroscope and encoder report at ``motion_rate_hz`` what happened since the reading before. The
    gyroscope has the errors of Table 1 and feels the earth turn; from the end of the first rest on it has
    a residual bias besides, of a fixed size and a random sign, which a calibration in that rest cannot find.

    A radio serves several access points (MAC addresses) from one place with nearly one power. Near radios
    stand on the floor: log-distance path loss, less a loss for each corridor wall on the straight line. Far
    ones are in other storeys and buildings; the strongest mean level that the map has of one is drawn, since
    an access point on the map was heard. Shadowing is correlated over space, drawn at the nodes of a grid and
    bilinear between them; the world is defined so. A scan adds fading, of which a part is common to the
    access points of a radio, and is reported in whole dBm. A place of the map is the mean of those of its
    scans that heard the access point.

    Between survey and drive a share of the radios may go, move, or change power. The readings at one place
    (Fig. 5) are those of the strongest access point at the start of the drive, taken with the survey.

    Everything is drawn as standard numbers and scaled afterwards: worlds of equal seeds share all but what a
    setting scales. So a changed ``residual_bias_deg_per_s`` changes gyroscope readings alone; a changed
    ``fading_db`` changes received strengths alone; and ageing changes those of the drive alone.

    Parameters
    ----------
    settings
        All of: ``size_m`` [x, y], ``track_m`` [vertex, 2], ``wall_m`` [wall, 4] (x and y of both ends),
        ``corner_radius_m``, ``track_length_m``, ``odometer_length_m``, ``waypoint_spacing_m`` [least, most],
        ``speed_m_per_s`` [least, most], ``acceleration_m_per_s2``, ``stops`` (between the ends),
        ``first_rest_s`` and ``stop_s`` [least, most], ``duration_most_s``, ``motion_rate_hz``,
        ``encoder_step_m``, ``turn_on_bias_deg_per_s``, ``in_run_bias_deg_per_s``, ``in_run_correlation_s``,
        ``angle_random_walk_deg_per_sqrt_h``, ``gyro_step_deg_per_s``, ``latitude_deg``,
        ``start_heading_deg``, ``residual_bias_deg_per_s``, ``points``, ``map_offset_m``, ``map_scans``,
        ``access_points``,
        ``radios``, ``near_radios``, ``reference_dbm`` (at 1 m), ``path_loss_exponent``, ``wall_loss_db``,
        ``far_distance_m`` [least, most], ``far_height_m``, ``far_level_dbm`` [least, most],
        ``virtual_power_db``, ``shadowing_db``, ``shadowing_correlation_m``, ``grid_m``, ``fading_db``,
        ``fading_common_share``, ``floor_dbm``, ``scan_period_s``, ``static_readings``, ``static_period_s``,
        ``gone_share``, ``moved_share``, ``moved_m``, ``repowered_db``. Other keys are left alone.
    rngs
        One generator for each world; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.wall_m`` [world, wall, 2, 2], ``survey.rss_dbm``
        [world, point, ap], ``survey.position_m`` [world, point, 2]; ``recording.time_s`` [world, epoch],
        every scan and every passage of a way-point, the middle of a stop; ``recording.rss_dbm`` [world,
        epoch, ap], all NaN without a scan; ``recording.motion_time_s``, ``.gyro_rad_per_s``,
        ``.odometer_m_per_s`` [world, sample], means over the interval that ends at the time;
        ``recording.start_heading_rad`` [world], ``recording.start_position_m`` [world, 2];
        ``static.time_s`` and ``static.rss_dbm`` [world, reading]. NaN follows the end of a drive.

        Truth ``truth.position_m`` [world, epoch, 2] at way-points and else NaN, ``truth.path_m`` [world,
        epoch, 2] and ``truth.heading_rad`` [world, epoch] (not wrapped) at all epochs,
        ``truth.gyro_bias_rad_per_s`` and ``truth.odometer_scale`` [world].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, no generator, or a drive that does not end within
        ``duration_most_s``.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    field = _field(values)
    drawn = [_draw(values, len(field.node), rng) for rng in rngs]
    count = len(drawn)
    plan = _plan(values, drawn)
    odometer_scale = np.full(count, values["odometer_length_m"] / values["track_length_m"])
    residual = np.deg2rad(values["residual_bias_deg_per_s"]) * np.array([draws["sign"] for draws in drawn])
    motion = _motion(values, field.course, plan, drawn, odometer_scale, residual)

    worlds = [_world(values, field, plan.at(index), draws) for index, draws in enumerate(drawn)]
    stacked = {name: np.stack([world[name] for world in worlds]) for name in worlds[0]}
    site = Site(
        corner_m=_each(count, [[0.0, 0.0], values["size_m"]]),
        wall_m=_each(count, values["wall_m"]),
    )
    survey = Survey(rss_dbm=stacked["map_dbm"], position_m=_each(count, field.map_m))
    recording = Recording(
        time_s=stacked["time_s"],
        rss_dbm=stacked["rss_dbm"],
        start_heading_rad=stacked["heading_rad"][:, 0]
        + np.deg2rad(values["start_heading_deg"]) * np.array([draws["heading"] for draws in drawn]),
        start_position_m=stacked["path_m"][:, 0],
        **motion,
    )
    truth = Truth(
        position_m=stacked["position_m"],
        path_m=stacked["path_m"],
        heading_rad=stacked["heading_rad"],
        gyro_bias_rad_per_s=residual,
        odometer_scale=odometer_scale,
    )
    static = {
        "static.time_s": _each(count, values["static_period_s"] * np.arange(values["static_readings"])),
        "static.rss_dbm": stacked["static_dbm"],
    }
    return Worlds(
        observed={**site.to_arrays(), **survey.to_arrays(), **recording.to_arrays(), **static},
        truth=truth.to_arrays(),
    )


def _field(values: Mapping[str, Any]) -> Field:
    """Return what all worlds share."""
    course, offset_m, grid_m = values["course"], values["map_offset_m"], values["grid_m"]
    # Middles of equal parts of the track, in turn to its left, on it and to its right.
    part = np.arange(values["points"])
    along_m = (part + 0.5) * values["track_length_m"] / len(part)
    heading = course.heading_at(along_m)
    to_left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    map_m = course.position_at(along_m) + offset_m * (1 - part % 3)[:, None] * to_left

    # A place is at most a cell's diagonal away from the nodes that it lies between.
    columns_rows = np.stack(np.meshgrid(*map(np.arange, values["nodes"]), indexing="ij"), axis=-1)
    steps = np.arange(0.0, course.length_m + _COURSE_STEP_M, _COURSE_STEP_M)
    reach_m = np.sqrt(2) * grid_m + offset_m + _COURSE_STEP_M
    every = columns_rows.reshape(-1, 2)
    near = pairwise_distance_m(every * grid_m, course.position_at(steps)).min(axis=-1) <= reach_m
    node = every[near]
    if len(node) > _MOST_NODES:
        raise InputError(
            "setting grid_m",
            f"{grid_m} m gives {len(node)} nodes along the track, and {_MOST_NODES} are the most",
            "Give a coarser grid",
        )
    distance_m = pairwise_distance_m(node * grid_m, node * grid_m)
    correlation = np.exp(-distance_m / values["shadowing_correlation_m"])
    factor = np.linalg.cholesky(correlation + _JITTER * np.eye(len(node)))
    return Field(course, map_m, node, factor)


def _plan(values: Mapping[str, Any], drawn: Sequence[Mapping[str, Any]]) -> Schedule:
    """Return the drives: way-points, speeds and rests, [world, ...]."""
    legs = values["legs"]
    spacing, jitter, rest = (
        np.stack([draws[name] for draws in drawn]) for name in ("spacing", "jitter", "rest")
    )
    shortest, longest = values["waypoint_spacing_m"]
    mean_m = values["track_length_m"] / legs
    # Random lengths with the sum that is asked for: as wide about their mean as the limits allow.
    about = spacing - spacing.mean(axis=-1, keepdims=True)
    low, high = about.min(axis=-1, keepdims=True), about.max(axis=-1, keepdims=True)
    width_m = np.minimum((mean_m - shortest) / -low, (longest - mean_m) / high) if legs > 1 else 0.0
    leg_m = mean_m + about * np.minimum(width_m, longest - shortest)
    waypoint_m = np.insert(np.cumsum(leg_m, axis=-1), 0, 0.0, axis=-1)
    waypoint_m[:, -1] = values["track_length_m"]

    slowest, fastest = values["speed_m_per_s"]
    rank = np.stack([draws["rank"] for draws in drawn])
    cruise = slowest + (fastest - slowest) * (rank + jitter) / legs

    stops = np.stack([np.isin(np.arange(legs + 1), draws["stops"][: values["stops"]] + 1) for draws in drawn])
    stops[:, -1] = True
    first, later = (low + (high - low) * rest for low, high in (values["first_rest_s"], values["stop_s"]))
    rest_s = np.where(stops, later, 0.0)
    rest_s[:, 0] = first[:, 0]
    plan = schedule(waypoint_m, cruise, rest_s, acceleration_m_per_s2=values["acceleration_m_per_s2"])
    if plan.end_s.max() > values["duration_most_s"]:
        raise InputError(
            "setting duration_most_s",
            f"a drive takes {plan.end_s.max():.1f} s, and {values['duration_most_s']} s are the most",
            "Give more time, or shorter rests or higher speeds",
        )
    return plan


def _motion(
    values: Mapping[str, Any],
    course: Course,
    plan: Schedule,
    drawn: Sequence[Mapping[str, Any]],
    odometer_scale: Array,
    residual: Array,
) -> dict[str, Any]:
    """Return the readings of gyroscope and encoder, [world, sample]."""
    rate_hz = values["motion_rate_hz"]
    time_s = np.arange(values["samples"]) / rate_hz
    distance_m = plan.distance_at(time_s)
    heading = course.heading_at(distance_m)
    ideal = np.diff(heading, axis=-1, prepend=heading[:, :1]) * rate_hz
    ideal += vertical_earth_rate(np.deg2rad(values["latitude_deg"]))
    ideal += residual[:, None] * (time_s > plan.departure_s[:, :1])
    draws = GyroDraws(*(np.stack(parts) for parts in zip(*(draws["gyro"] for draws in drawn), strict=True)))
    speed = read_encoder(
        distance_m,
        scale=odometer_scale,
        step_m=values["encoder_step_m"],
        phase=np.array([draws["phase"] for draws in drawn]),
        sample_rate_hz=rate_hz,
    )
    going = time_s <= plan.end_s[:, None]
    return {
        # A reading is the mean over the interval that ends with it; its time is the middle.
        "motion_time_s": np.where(going, time_s - 0.5 / rate_hz, np.nan),
        "gyro_rad_per_s": np.where(
            going, read_gyro(ideal, draws, values["gyro"], sample_rate_hz=rate_hz), np.nan
        ),
        "odometer_m_per_s": np.where(going, speed, np.nan),
    }


def _world(
    values: Mapping[str, Any], field: Field, plan: Schedule, draws: Mapping[str, Any]
) -> dict[str, Array]:
    """Return epochs, radio map and scans of one world."""
    course, most = field.course, values["epochs_most"]
    scan_s = np.arange(values["scans_most"]) * values["scan_period_s"]
    scan_s = scan_s[scan_s <= plan.end_s]
    passage_s = plan.passage_s
    # Each epoch has the number of its scan and of its way-point, or -1.
    apart = np.abs(scan_s[:, None] - passage_s)
    alone = apart.min(axis=1) > MERGE_S
    shared = np.where(apart.min(axis=0) <= MERGE_S, apart.argmin(axis=0), -1)
    time_s = np.concatenate([scan_s[alone], passage_s])
    scan = np.concatenate([np.flatnonzero(alone), shared])
    waypoint = np.concatenate([np.full(alone.sum(), -1), np.arange(len(passage_s))])
    order = np.argsort(time_s)
    time_s, scan, waypoint = time_s[order], scan[order], waypoint[order]

    distance_m = plan.distance_at(time_s)
    path_m, heading = course.position_at(distance_m), course.heading_at(distance_m)
    scans = np.flatnonzero(scan >= 0)
    radio = _radio(values, field, path_m[scans], scan[scans], draws)

    rss_dbm = np.full((most, values["access_points"]), np.nan)
    rss_dbm[scans] = radio.pop("scan_dbm")
    filled = {
        "time_s": time_s,
        "path_m": path_m,
        "heading_rad": heading,
        "position_m": np.where(waypoint[:, None] >= 0, path_m, np.nan),
    }
    for name, known in filled.items():
        filled[name] = np.full((most, *known.shape[1:]), np.nan)
        filled[name][: len(known)] = known
    return {**filled, **radio, "rss_dbm": rss_dbm}


def _radio(
    values: Mapping[str, Any], field: Field, place_m: Array, scan: NDArray[np.int64], draws: Mapping[str, Any]
) -> dict[str, Array]:
    """Return map, scans and readings at the start of one world."""
    points, near, radios = len(field.map_m), values["near_radios"], values["radios"]
    size, reach = np.asarray(values["size_m"]), values["far_distance_m"]
    bearing = 2 * np.pi * draws["far"][:, 0]
    away_m = reach[0] + (reach[1] - reach[0]) * draws["far"][:, 1]
    far_m = size / 2 + away_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    radio_m = np.concatenate([draws["near"] * size, far_m])
    shadow = np.zeros((1, *values["nodes"], 2 * radios))
    normal = np.concatenate([draws["shadow"], draws["shadow_moved"]], axis=-1)
    shadow[0, field.node[:, 0], field.node[:, 1]] = values["shadowing_db"] * (field.factor @ normal)
    at_m = np.concatenate([field.map_m, field.course.position_at([0.0]), place_m])
    before_db, new_db = np.split(interpolate(shadow, at_m[None, None], values["grid_m"])[0, 0], 2, axis=-1)

    surveyed = slice(0, points + 1)
    level_dbm = _loss_dbm(values, at_m[surveyed], radio_m) + before_db[surveyed]
    lowest, highest = values["far_level_dbm"]
    gain_db = np.zeros(radios)
    gain_db[near:] = lowest + (highest - lowest) * draws["level"] - level_dbm[:points, near:].max(axis=0)
    level_dbm += gain_db

    # The first in a random order: with a higher share the same radios are among them.
    gone, moved = (
        np.isin(np.arange(radios), draws[f"{what}_order"][: round(values[f"{what}_share"] * radios)])
        for what in ("gone", "moved")
    )
    way = 2 * np.pi * draws["moved_bearing"]
    step_m = np.where(moved, values["moved_m"], 0.0)
    aged_m = radio_m + step_m[:, None] * np.stack([np.cos(way), np.sin(way)], axis=-1)
    # What obstacles do to a radio that moved is as much as before as two places so far apart have in common.
    alike = np.exp(-step_m / values["shadowing_correlation_m"])
    driven = slice(points + 1, None)
    shadow_db = alike * before_db[driven] + np.sqrt(1 - alike**2) * new_db[driven]
    driven_dbm = _loss_dbm(values, at_m[driven], aged_m) + shadow_db + gain_db
    driven_dbm += values["repowered_db"] * draws["power"]
    driven_dbm[:, gone] = -np.inf

    radio_of, virtual_db = draws["radio_of"], values["virtual_power_db"] * draws["virtual"]

    def hear(mean_dbm: Array, own: Array, common: Array) -> Array:
        share = values["fading_common_share"]
        fading = np.sqrt(share) * common[..., radio_of] + np.sqrt(1 - share) * own
        return receive(
            mean_dbm[:, radio_of] + virtual_db,
            noise_db=values["fading_db"],
            floor_dbm=values["floor_dbm"],
            fading=fading,
        )

    scans_dbm = hear(level_dbm[:points], draws["map_own"], draws["map_common"])
    heard = np.isfinite(scans_dbm).sum(axis=0)
    total = np.nansum(scans_dbm, axis=0)
    strongest = np.max(level_dbm[points][radio_of] + virtual_db)
    return {
        "map_dbm": np.divide(total, heard, out=np.full(total.shape, np.nan), where=heard > 0),
        "scan_dbm": hear(driven_dbm, draws["scan_own"][scan], draws["scan_common"][scan]),
        "static_dbm": receive(
            strongest, noise_db=values["fading_db"], floor_dbm=values["floor_dbm"], fading=draws["static"]
        ),
    }


def _loss_dbm(values: Mapping[str, Any], place_m: Array, radio_m: Array) -> Array:
    """Return the mean strength of radios at places without shadowing, [place, radio]."""
    near = values["near_radios"]
    distance_m = pairwise_distance_m(place_m, radio_m)
    distance_m[:, near:] = np.hypot(distance_m[:, near:], values["far_height_m"])
    level = path_loss_dbm(
        distance_m, reference_dbm=values["reference_dbm"], path_loss_exponent=values["path_loss_exponent"]
    )
    level[:, :near] -= values["wall_loss_db"] * wall_crossings(place_m, radio_m[:near], values["wall_m"])
    return level


def _draw(values: Mapping[str, Any], nodes: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return the random numbers of one world, standard ones."""
    # The order of the draws is part of the world, and no number of draws depends on another draw. Those
    # of the scans come last: another scan rate leaves all else alone.
    legs, columns, radios = values["legs"], values["access_points"], values["radios"]
    points, scans, near = values["points"], values["map_scans"], values["near_radios"]
    return {
        "spacing": rng.random(legs),
        "rank": rng.permutation(legs),
        "jitter": rng.random(legs),
        "stops": rng.permutation(legs - 1),
        "rest": rng.random(legs + 1),
        "sign": 2.0 * rng.integers(2) - 1.0,
        "phase": rng.random(),
        "heading": rng.standard_normal(),
        "gyro": draw_gyro(rng, values["samples"]),
        "near": rng.random((near, 2)),
        "far": rng.random((radios - near, 2)),
        "level": rng.random(radios - near),
        "radio_of": rng.permutation(columns) % radios,
        "virtual": rng.standard_normal(columns),
        "gone_order": rng.permutation(radios),
        "moved_order": rng.permutation(radios),
        "moved_bearing": rng.random(radios),
        "power": rng.standard_normal(radios),
        "shadow": rng.standard_normal((nodes, radios)),
        "shadow_moved": rng.standard_normal((nodes, radios)),
        "static": rng.standard_normal(values["static_readings"]),
        "map_own": rng.standard_normal((scans, points, columns)),
        "map_common": rng.standard_normal((scans, points, radios)),
        "scan_own": rng.standard_normal((values["scans_most"], columns)),
        "scan_common": rng.standard_normal((values["scans_most"], radios)),
    }


def _each(count: int, value: ArrayLike) -> Array:
    """Repeat what is the same in all worlds."""
    array = np.asarray(value, dtype=np.float64)
    return np.repeat(array[None], count, axis=0)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work, with what follows from them."""
    values: dict[str, Any] = {
        "size_m": numbers(settings, "size_m", 2, least=0),
        "track_m": rows(settings, "track_m", 2, least=2),
        "wall_m": rows(settings, "wall_m", 4, least=0).reshape(-1, 2, 2),
        "waypoint_spacing_m": span(settings, "waypoint_spacing_m", least=0),
        "speed_m_per_s": span(settings, "speed_m_per_s", least=0),
        "stops": whole(settings, "stops", least=0),
        "first_rest_s": span(settings, "first_rest_s", least=0),
        "stop_s": span(settings, "stop_s", least=0),
        "points": whole(settings, "points", least=2),
        "map_offset_m": number(settings, "map_offset_m", least=0),
        "map_scans": whole(settings, "map_scans", least=1),
        "access_points": whole(settings, "access_points", least=1),
        "radios": whole(settings, "radios", least=1),
        "near_radios": whole(settings, "near_radios", least=0),
        "reference_dbm": number(settings, "reference_dbm"),
        "far_distance_m": span(settings, "far_distance_m", least=0),
        "far_level_dbm": span(settings, "far_level_dbm"),
        "fading_common_share": number(settings, "fading_common_share", least=0, most=1),
        "floor_dbm": number(settings, "floor_dbm"),
        "static_readings": whole(settings, "static_readings", least=1),
        "gone_share": number(settings, "gone_share", least=0, most=1),
        "moved_share": number(settings, "moved_share", least=0, most=1),
        "latitude_deg": number(settings, "latitude_deg", least=-90, most=90),
        "start_heading_deg": number(settings, "start_heading_deg", least=0),
    }
    positive = [
        *("corner_radius_m", "track_length_m", "odometer_length_m", "acceleration_m_per_s2"),
        *("duration_most_s", "motion_rate_hz", "encoder_step_m", "in_run_correlation_s"),
        *("shadowing_correlation_m", "grid_m", "scan_period_s", "static_period_s"),
    ]
    not_negative = [
        *("turn_on_bias_deg_per_s", "in_run_bias_deg_per_s", "angle_random_walk_deg_per_sqrt_h"),
        *("gyro_step_deg_per_s", "residual_bias_deg_per_s", "path_loss_exponent", "wall_loss_db"),
        *("far_height_m", "virtual_power_db", "shadowing_db", "fading_db", "moved_m", "repowered_db"),
    ]
    values |= {name: number(settings, name, above=0) for name in positive}
    values |= {name: number(settings, name, least=0) for name in not_negative}

    size, track_m, length_m = np.asarray(values["size_m"]), values["track_m"], values["track_length_m"]
    offset_m = values["map_offset_m"]
    _require(bool(size.min() > 0), "size_m", f"{size} m has no area", "Give two positive lengths")
    _require(
        bool(((track_m >= offset_m) & (track_m <= size - offset_m)).all()),
        "track_m",
        f"a place is nearer than map_offset_m, {offset_m} m, to the edge of the floor, or outside",
        "Give places within size_m",
    )
    try:
        course = rounded_course(track_m, corner_radius_m=values["corner_radius_m"])
    except InputError as error:
        named = {"vertex_m": "track_m"}.get(error.thing, error.thing)
        raise InputError(f"setting {named}", error.limit, error.cure) from error
    _require(
        course.length_m >= length_m,
        "track_m",
        f"with round corners it is {course.length_m:.2f} m long, and track_length_m is {length_m}",
        "Give a longer chain of places",
    )
    shortest, longest = values["waypoint_spacing_m"]
    legs = round(2 * length_m / (shortest + longest)) if longest > 0 else 0
    _require(
        legs >= 1 and shortest * legs <= length_m <= longest * legs,
        "waypoint_spacing_m",
        f"legs of {shortest} to {longest} m do not add up to {length_m} m",
        "Give limits between which a whole number of legs fits",
    )
    slowest, fastest = values["speed_m_per_s"]
    _require(slowest > 0, "speed_m_per_s", "the robot stands still", "Give speeds above zero")
    _require(
        fastest**2 < shortest * values["acceleration_m_per_s2"],
        "acceleration_m_per_s2",
        f"a leg of {shortest} m is too short to drive {fastest} m/s between two stops",
        "Give a higher acceleration",
    )
    _require(values["stop_s"][0] > 0, "stop_s", "a stop may last no time", "Give rests above zero")
    _require(
        values["stops"] <= legs - 1,
        "stops",
        f"there are {legs - 1} way-points between the ends",
        "Give at most as many",
    )
    _require(
        values["near_radios"] <= values["radios"] <= values["access_points"],
        "radios",
        f"{values['radios']} is not between near_radios, {values['near_radios']}, and access_points,"
        f" {values['access_points']}",
        "Give each radio one access point or more",
    )
    nodes = np.rint(size / values["grid_m"]).astype(np.int64) + 1
    _require(
        bool(np.allclose((nodes - 1) * values["grid_m"], size) and nodes.min() >= 2),
        "grid_m",
        f"{values['grid_m']} m does not divide both sides of the floor",
        "Give a divisor of both sides of size_m",
    )
    degrees = {
        "turn_on_bias_rad_per_s": values["turn_on_bias_deg_per_s"],
        "in_run_bias_rad_per_s": values["in_run_bias_deg_per_s"],
        # An hour has 3600 s, and its root 60 of the root of a second.
        "angle_random_walk_rad_per_sqrt_s": values["angle_random_walk_deg_per_sqrt_h"] / 60,
        "step_rad_per_s": values["gyro_step_deg_per_s"],
    }
    gyro = Gyro(
        in_run_correlation_s=values["in_run_correlation_s"],
        **{name: float(np.deg2rad(value)) for name, value in degrees.items()},
    )
    scans_most = int(values["duration_most_s"] / values["scan_period_s"]) + 1
    return {
        **values,
        "course": course,
        "gyro": gyro,
        "legs": legs,
        "nodes": tuple(nodes.tolist()),
        "samples": int(values["duration_most_s"] * values["motion_rate_hz"]) + 1,
        "scans_most": scans_most,
        "epochs_most": scans_most + legs + 1,
    }


def _require(fits: bool, name: str, limit: str, cure: str) -> None:
    if not fits:
        raise InputError(f"setting {name}", limit, cure)
