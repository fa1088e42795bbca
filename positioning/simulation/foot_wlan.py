"""The synthetic worlds of the study foot_wlan: a ring corridor, a foot with sensors, a WLAN.

See Frank et al., section 5. The paper reports four laps, eleven access points, seventeen marks, the places
and scans of the calibration; all the rest is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.inertial.strapdown import attitude_of, readings
from positioning.model import Array, Recording, Site, Survey, Truth, Worlds
from positioning.radio import interpolate, path_loss_dbm, receive
from positioning.simulation.floorplan import rectangle_walls
from positioning.simulation.gait import Gait, GaitDraws, Stances, Walk, draw_gait, foot_motion, stances, walk
from positioning.simulation.imu import (
    Triad,
    TriadDraws,
    draw_triad,
    earth_field_ut,
    gauss_markov,
    read_triad,
    smooth_field,
)
from positioning.simulation.settings import number, numbers, span, whole
from positioning.simulation.wheeled import Course, rounded_course

MERGE_S = 0.001
"""A scan this close to the passage of a mark, or closer, shares its epoch."""

LEAST_HEARD = 3
"""Access points that are recorded at every calibration point, section 5.1."""

# Distance between the places of the course around which nodes of the shadowing's grid are kept.
_COURSE_STEP_M = 0.25

# The factorisation of the shadowing's correlation takes memory with the square of this number.
_MOST_NODES = 2000

# Relative to the variance: keeps the factorisation going, and is far below what a receiver resolves.
_JITTER = 1e-9

# Plane waves of which the magnetic disturbance is the sum.
_WAVES = 64

# Worlds whose inertial readings are made at a time: enough for NumPy, and little memory.
_CHUNK = 4


class Field(NamedTuple):
    """What does not differ between worlds: the corridor, and the grid of the shadowing.

    Attributes
    ----------
    course
        The line of all laps.
    wall_m
        [wall, 2, 2], metres.
    point_along_m
        Calibration points along the ring, [point], metres.
    node
        Columns and rows of the nodes at which shadowing is drawn, [node, 2].
    factor
        What turns standard normals at the nodes into shadowing of unit deviation, [node, node].
    """

    course: Course
    wall_m: Array
    point_along_m: Array
    node: NDArray[np.int64]
    factor: Array


class Epochs(NamedTuple):
    """Epochs of the recordings, NaN or -1 after the end.

    Attributes
    ----------
    time_s, path_m, heading_rad
        [world, n], [world, n, 2], [world, n].
    scan
        Number of the scan, [world, n]; -1 for none.
    marked, on_point
        Whether a mark is passed, and whether the calibration point next to one, [world, n].
    """

    time_s: Array
    path_m: Array
    heading_rad: Array
    scan: NDArray[np.int64]
    marked: NDArray[np.bool_]
    on_point: NDArray[np.bool_]


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Frank et al., section 5. A pedestrian walks the ring corridor ``laps`` times counter-clockwise,
    with a rest at both ends, pauses, and legs of different speeds. A sensor on one foot reports specific
    force, angular rate and magnetic field; its frame is turned against the walking direction by an angle of
    each world. The earth is flat and does not turn: its 0.004 degrees a second are far below the bias.

    The marks are spread evenly over the ring, moved to the nearest place of a lattice on which the
    calibration points lie, and then off that place, uniformly within half of the lattice's spacing to both
    sides. Of all passages ``passages`` are kept, each choice of them alike: the others were not noted. Each
    kept one has a twin, the passage of the place on the lattice, in the same lap.

    An access point stands in each of equal parts of the ring, in a random room beside it. Mean level:
    log-distance path loss, less a loss for each wall on the straight line, less what the body takes from
    behind, plus shadowing, which is correlated over space, drawn at the nodes of a grid and bilinear between
    them; the world is defined so. Who calibrates faces one random direction at each point and moves a little
    about it; walls and body count as at the point itself. The noise of a scan has a part that lasts for
    seconds, in the survey and on the walk alike. Readings are whole dBm.

    Everything is drawn as standard numbers and scaled afterwards, and walk, radio, survey, scans and inertial
    sensors have a stream each: worlds of equal seeds share all but what a setting scales. So
    ``scan_noise_db`` changes received strengths alone, ``imu: false`` leaves the inertial readings out and
    changes nothing else, and calibration points at places common to two spacings
    have the same scans.

    Parameters
    ----------
    settings
        As in ``data/papers/foot_wlan.yaml``, all of them. Other keys are left alone.
    rngs
        One generator for each world; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.wall_m`` [world, wall, 2, 2],
        ``site.magnetic_north_rad`` [world]; ``survey.rss_dbm`` [world, p, ap] and ``survey.position_m``
        [world, p, 2], every single scan, those of a point in a row; ``recording.time_s`` [world, n], every
        scan and every kept passage; ``recording.rss_dbm`` [world, n, ap], all NaN without a scan;
        ``recording.imu_time_s`` [world, i], ``recording.specific_force_m_per_s2``,
        ``.angular_rate_rad_per_s`` and ``.magnetic_field_ut`` [world, i, 3] in single precision;
        ``recording.start_heading_rad`` [world], ``recording.start_position_m`` [world, 2]. NaN follows
        the end.

        Truth ``truth.position_m`` [world, n, 2], the body at marks and else NaN; ``truth.path_m`` [world, n,
        2] and ``truth.heading_rad`` [world, n] of the body at all epochs, not wrapped;
        ``truth.stance_time_s`` [world, s, 2] and ``truth.stance_m`` [world, s, 3] of the sensor, without its
        wobble; ``plan.access_point_m`` [world, ap, 2], ``plan.mark_m`` [world, mark, 2] and
        ``plan.misalignment_rad`` [world].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, no generator, a walk that does not end within
        ``duration_most_s``, or a calibration point that hears fewer than three access points.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    field = _field(values)
    streams = [rng.spawn(5) for rng in rngs]
    draws = [_draw_walk(values, walking) for walking, *_ in streams]
    count = len(draws)
    gait, gait_draws = values["gait"], GaitDraws.stack([draw["gait"] for draw in draws])

    def each(name: str) -> Array:
        return np.stack([draw[name] for draw in draws])

    first, last, pause = (
        low + (high - low) * each(name)
        for name, (low, high) in (
            ("first_rest", values["first_rest_s"]),
            ("last_rest", values["last_rest_s"]),
            ("pause", values["pause_s"]),
        )
    )
    way = walk(
        gait,
        gait_draws,
        length_m=field.course.length_m,
        first_rest_s=first,
        last_rest_s=last,
        pause_s=pause,
    )
    if way.end_s.max() > values["duration_most_s"]:
        raise InputError(
            "setting duration_most_s",
            f"a walk takes {way.end_s.max():.1f} s, and {values['duration_most_s']} s are the most",
            "Give more time, or shorter rests or higher speeds",
        )
    misalignment = np.deg2rad(values["misalignment_deg"]) * each("misalignment")
    standing = stances(way, field.course, gait, gait_draws, misalignment_rad=misalignment)
    point_along_m, mark_along_m = _marks(values, each("mark"))
    epochs = _epochs(values, field, way, (mark_along_m, point_along_m), each("noted"))

    access_point_m, shadow_db = _radio(values, field, [plan for _, plan, *_ in streams])
    survey = _survey(values, field, access_point_m, shadow_db, [survey for _, _, survey, *_ in streams])
    rss_dbm = _scans(values, field, epochs, access_point_m, shadow_db, [scan for *_, scan, _ in streams])
    north = np.full(count, np.deg2rad(values["magnetic_north_deg"]))
    motion: dict[str, Any] = {}
    if values["imu"]:
        motion = _inertial(values, way, standing, gait_draws, north, [imu for *_, imu in streams])

    site = Site(
        corner_m=_each(count, [[0.0, 0.0], values["size_m"]]),
        wall_m=_each(count, field.wall_m),
        magnetic_north_rad=north,
    )
    recording = Recording(
        time_s=epochs.time_s,
        rss_dbm=rss_dbm,
        start_heading_rad=epochs.heading_rad[:, 0]
        + np.deg2rad(values["start_heading_deg"]) * each("start_heading"),
        start_position_m=epochs.path_m[:, 0].copy(),
        **motion,
    )
    truth = Truth(
        position_m=np.where(epochs.marked[..., None], epochs.path_m, np.nan),
        path_m=epochs.path_m,
        on_point_m=np.where(epochs.on_point[..., None], epochs.path_m, np.nan),
        heading_rad=epochs.heading_rad,
        stance_time_s=way.stance_time_s,
        stance_m=standing.sensor_m,
    )
    plan: dict[str, Array] = {
        "plan.access_point_m": access_point_m,
        "plan.mark_m": field.course.position_at(mark_along_m),
        "plan.misalignment_rad": misalignment,
    }
    return Worlds(
        observed={**site.to_arrays(), **survey.to_arrays(), **recording.to_arrays()},
        truth={**truth.to_arrays(), **plan},
    )


def _field(values: Mapping[str, Any]) -> Field:
    """Return what all worlds share."""
    course, lap_m, grid_m = values["course"], values["lap_m"], values["grid_m"]
    along_m = np.arange(values["points"]) * lap_m / values["points"]
    # A place is at most a cell's diagonal away from the nodes that it lies between.
    columns_rows = np.stack(np.meshgrid(*map(np.arange, values["nodes"]), indexing="ij"), axis=-1)
    steps = np.arange(0.0, lap_m + _COURSE_STEP_M, _COURSE_STEP_M)
    reach_m = np.sqrt(2) * grid_m + values["survey_reach_m"] + _COURSE_STEP_M
    every = columns_rows.reshape(-1, 2)
    node = every[pairwise_distance_m(every * grid_m, course.position_at(steps)).min(axis=-1) <= reach_m]
    _require(
        len(node) <= _MOST_NODES,
        "grid_m",
        f"{grid_m} m gives {len(node)} nodes along the corridor, and {_MOST_NODES} are the most",
        "Give a coarser grid",
    )
    distance_m = pairwise_distance_m(node * grid_m, node * grid_m)
    correlation = np.exp(-distance_m / values["shadowing_correlation_m"])
    factor = np.linalg.cholesky(correlation + _JITTER * np.eye(len(node)))
    return Field(course, values["wall_m"], along_m, node, factor)


def _walls(size: Array, corner: Array, width_m: float, room_m: float) -> Array:
    """Return the walls: outline, both sides of the corridor, partitions between rooms, a wall in the core."""
    outer = np.stack([corner[0] - width_m / 2, corner[1] + width_m / 2])
    inner = np.stack([corner[0] + width_m / 2, corner[1] - width_m / 2])
    walls = [*rectangle_walls(np.stack([[np.zeros(2), size], outer, inner])).reshape(-1, 2, 2)]
    middle = inner[:, 1].mean()
    walls.append(np.array([[inner[0, 0], middle], [inner[1, 0], middle]]))
    for axis in (0, 1):
        rooms = max(round((outer[1, axis] - outer[0, axis]) / room_m), 1)
        for at in np.linspace(outer[0, axis], outer[1, axis], rooms + 1):
            for begin, end in ((0.0, outer[0, 1 - axis]), (outer[1, 1 - axis], size[1 - axis])):
                line = np.array([[at, begin], [at, end]])
                walls.append(line if axis == 0 else line[:, ::-1])
    rooms = max(round((inner[1, 0] - inner[0, 0]) / room_m), 1)
    for at in np.linspace(inner[0, 0], inner[1, 0], rooms + 1)[1:-1]:
        walls.append(np.array([[at, inner[0, 1]], [at, inner[1, 1]]]))
    return np.stack(walls)


def _marks(values: Mapping[str, Any], uniform: Array) -> tuple[Array, Array]:
    """Return lattice places next to the marks, and the marks, along the ring, [world, mark], metres."""
    count, places, lap_m = values["mark_count"], values["mark_places"], values["lap_m"]
    nearest = np.floor((np.arange(count) + 0.5) * places / count + 0.5) + np.zeros(uniform.shape)
    return nearest * lap_m / places, (nearest + uniform - 0.5) * lap_m / places


def _epochs(
    values: Mapping[str, Any], field: Field, way: Walk, passed: tuple[Array, Array], noted: Array
) -> Epochs:
    """Return scans and kept passages, of marks and of their twins on the lattice, in the order of time."""
    lap_m, most, count = values["lap_m"], values["epochs_most"], len(noted)
    # The first of a random order are noted.
    rank = np.argsort(np.argsort(noted, axis=-1), axis=-1)
    kept = []
    for along_m in passed:
        passed_m = (lap_m * np.arange(values["laps"])[:, None] + along_m[:, None, :]).reshape(count, -1)
        kept.append(passed_m[rank < values["passages"]].reshape(count, -1))
    passage_s = way.passage_s(np.concatenate(kept, axis=1))

    time_s = np.full((count, most), np.nan)
    scan = np.full(time_s.shape, -1)
    marked, on_point = np.zeros((2, *time_s.shape), dtype=bool)
    scan_s = np.arange(values["scans_most"]) * values["scan_period_s"]
    for world, (end_s, passages) in enumerate(zip(way.end_s, passage_s, strict=True)):
        apart = np.abs(scan_s[:, None] - passages)
        alone = (apart.min(axis=1) > MERGE_S) & (scan_s <= end_s)
        shared = np.where(apart.min(axis=0) <= MERGE_S, apart.argmin(axis=0), -1)
        times = np.concatenate([scan_s[alone], passages])
        order = np.argsort(times)
        here = slice(len(times))
        time_s[world, here] = times[order]
        scan[world, here] = np.concatenate([np.flatnonzero(alone), shared])[order]
        passage = order - alone.sum()
        marked[world, here] = (passage >= 0) & (passage < values["passages"])
        on_point[world, here] = passage >= values["passages"]
    distance_m = way.distance_at(time_s)
    going = np.isfinite(time_s)
    path_m = np.where(going[..., None], field.course.position_at(np.nan_to_num(distance_m)), np.nan)
    heading = np.where(going, field.course.heading_at(np.nan_to_num(distance_m)), np.nan)
    return Epochs(time_s, path_m, heading, scan, marked, on_point)


def _radio(
    values: Mapping[str, Any], field: Field, rngs: Sequence[np.random.Generator]
) -> tuple[Array, Array]:
    """Return places of the access points, and shadowing at the nodes of the grid."""
    count, points = len(rngs), values["access_points"]
    uniform = np.empty((count, points, 3))
    shadow = np.zeros((count, *values["nodes"], points))
    columns, rows = field.node.T
    for world, rng in enumerate(rngs):
        uniform[world] = rng.random((points, 3))
        normal = rng.standard_normal((len(field.node), points))
        shadow[world, columns, rows] = values["shadowing_db"] * (field.factor @ normal)
    along_m = (np.arange(points) + uniform[..., 0]) * values["lap_m"] / points
    near, far = values["access_point_offset_m"]
    aside_m = np.where(uniform[..., 1] < 0.5, -1.0, 1.0) * (near + (far - near) * uniform[..., 2])
    way = field.course.heading_at(along_m)
    left = np.stack([-np.sin(way), np.cos(way)], axis=-1)
    place = field.course.position_at(along_m) + aside_m[..., None] * left
    return np.clip(place, 0.0, values["size_m"]), shadow


def _level_dbm(
    values: Mapping[str, Any], field: Field, place_m: Array, heading_rad: Array, access_point_m: Array
) -> Array:
    """Return the mean levels at places without shadowing, [world, n, ap]."""
    level = path_loss_dbm(
        pairwise_distance_m(place_m, access_point_m),
        reference_dbm=values["reference_dbm"],
        path_loss_exponent=values["path_loss_exponent"],
    )
    # World by world: the lines of one stay in the cache, those of all do not, by a factor of ten in time.
    for own, world_m, points_m in zip(level, place_m, access_point_m, strict=True):
        own -= values["wall_loss_db"] * wall_crossings(world_m, points_m, field.wall_m)
    towards = access_point_m[:, None] - place_m[:, :, None]
    bearing = np.arctan2(towards[..., 1], towards[..., 0])
    # All of the loss from behind, none from ahead.
    level -= values["body_loss_db"] * 0.5 * (1 - np.cos(bearing - heading_rad[..., None]))
    return level


def _noise(values: Mapping[str, Any], slow: Array, white: Array, period_s: float) -> Array:
    """Return the noise of scans of unit deviation, [..., scan, ap]: one part of it lasts."""
    correlation = values["noise_correlation_s"] / period_s
    lasting = np.swapaxes(gauss_markov(np.swapaxes(slow, -1, -2), correlation=correlation), -1, -2)
    share = values["noise_slow_share"]
    return np.asarray(np.sqrt(share) * lasting + np.sqrt(1 - share) * white)


def _survey(
    values: Mapping[str, Any],
    field: Field,
    access_point_m: Array,
    shadow_db: Array,
    rngs: Sequence[np.random.Generator],
) -> Survey:
    """Return every scan of the calibration."""
    count, points, scans, columns = (
        len(rngs),
        values["points"],
        values["calibration_scans"],
        values["access_points"],
    )
    facing = np.empty((count, points))
    moved = np.empty((count, points, 2, scans))
    slow, white = np.empty((2, count, points, scans, columns))
    for world, rng in enumerate(rngs):
        seed = int(rng.integers(2**63))
        for point, along_m in enumerate(field.point_along_m):
            # A stream for each place, so that surveys of other densities share what they have in common.
            own = np.random.default_rng([seed, round(1000 * along_m)])
            facing[world, point] = 2 * np.pi * own.random()
            moved[world, point] = own.standard_normal((2, scans))
            slow[world, point], white[world, point] = own.standard_normal((2, scans, columns))
    period_s = values["calibration_period_s"]
    moves = gauss_markov(moved, correlation=values["survey_motion_correlation_s"] / period_s)
    place_m = _each(count, field.course.position_at(field.point_along_m))
    level_dbm = _level_dbm(values, field, place_m, facing, access_point_m)[:, :, None]
    scanned_m = place_m[:, :, None] + (values["survey_motion_m"] * moves.clip(-3, 3)).swapaxes(-1, -2)
    rss_dbm = receive(
        level_dbm + interpolate(shadow_db, scanned_m, values["grid_m"]),
        noise_db=values["scan_noise_db"],
        floor_dbm=values["floor_dbm"],
        fading=_noise(values, slow, white, period_s),
    )
    heard = np.isfinite(rss_dbm).any(axis=2).sum(axis=-1)
    _require(
        bool(heard.min() >= min(LEAST_HEARD, columns)),
        "floor_dbm",
        f"a calibration point hears {heard.min()} access points, and section 5.1 has {LEAST_HEARD} at least",
        "Give a lower floor, more access points or smaller losses",
    )
    return Survey(rss_dbm=rss_dbm.reshape(count, -1, columns), position_m=np.repeat(place_m, scans, axis=1))


def _scans(
    values: Mapping[str, Any],
    field: Field,
    epochs: Epochs,
    access_point_m: Array,
    shadow_db: Array,
    rngs: Sequence[np.random.Generator],
) -> Array:
    """Return the scans of the walk, [world, n, ap]; NaN at epochs without one."""
    shape = (values["scans_most"], values["access_points"])
    slow, white = np.stack([rng.standard_normal((2, *shape)) for rng in rngs], axis=1)
    noise = _noise(values, slow, white, values["scan_period_s"])
    # After the end any place will do.
    going = np.isfinite(epochs.time_s)
    place_m = np.where(going[..., None], epochs.path_m, epochs.path_m[:, :1])
    level_dbm = _level_dbm(values, field, place_m, np.where(going, epochs.heading_rad, 0.0), access_point_m)
    level_dbm += interpolate(shadow_db, place_m[:, None], values["grid_m"])[:, 0]
    scanned = epochs.scan >= 0
    rss_dbm = receive(
        level_dbm,
        noise_db=values["scan_noise_db"],
        floor_dbm=values["floor_dbm"],
        fading=np.take_along_axis(noise, np.where(scanned, epochs.scan, 0)[..., None], axis=1),
    )
    return np.where(scanned[..., None], rss_dbm, np.nan)


def _inertial(
    values: Mapping[str, Any],
    way: Walk,
    standing: Stances,
    gait_draws: GaitDraws,
    north_rad: Array,
    rngs: Sequence[np.random.Generator],
) -> dict[str, Any]:
    """Return the readings of the inertial and magnetic sensors."""
    rate_hz, most, count = values["imu_rate_hz"], values["samples_most"], len(rngs)
    samples = np.floor(way.end_s * rate_hz + 1e-9).astype(np.int64)
    found = {
        name: np.full((count, most, 3), np.nan, dtype=np.float32)
        for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s", "magnetic_field_ut")
    }
    nodes = np.stack(np.meshgrid(*map(np.arange, values["nodes"]), indexing="ij"), axis=-1)
    node_m = nodes.reshape(-1, 2) * values["grid_m"]
    earth_ut = earth_field_ut(values["earth_field_ut"], np.deg2rad(values["inclination_deg"]), north_rad)

    for begin in range(0, count, _CHUNK):
        part = slice(begin, begin + _CHUNK)
        longest = int(samples[part].max())
        drawn = [_draw_inertial(values, rng) for rng in rngs[part]]
        tilt = np.deg2rad(values["mounting_tilt_deg"]) * np.stack([draw["tilt"] for draw in drawn])
        motion = foot_motion(
            np.arange(longest + 1) / rate_hz,
            way.at(part),
            Stances(*(values_of[part] for values_of in standing)),
            values["gait"],
            GaitDraws(*(values_of[part] for values_of in gait_draws)),
            mounting=attitude_of(tilt[:, 0], tilt[:, 1], np.zeros(len(tilt))),
        )
        force, turn_rate = readings(
            motion.velocity_m_per_s, motion.attitude, 1 / rate_hz, values["gravity_m_per_s2"]
        )
        waves = np.stack([draw["wave"] for draw in drawn])
        phases = 2 * np.pi * np.stack([draw["wave_phase"] for draw in drawn])
        disturbance = values["disturbance_ut"] * smooth_field(
            waves, phases, node_m, correlation_m=values["disturbance_correlation_m"]
        )
        grid = disturbance.reshape(len(drawn), *values["nodes"], 3)
        place_m = np.clip(motion.position_m[:, None, :, :2], 0.0, values["size_m"])
        field_ut = interpolate(grid, place_m, values["grid_m"])[:, 0] + earth_ut[part, None]
        felt_ut = np.einsum("...ij,...i->...j", motion.attitude, field_ut)
        ideal = {
            "specific_force_m_per_s2": force,
            "angular_rate_rad_per_s": turn_rate,
            # The mean of both ends stands for that of the interval.
            "magnetic_field_ut": 0.5 * (felt_ut[:, 1:] + felt_ut[:, :-1]),
        }
        going = (np.arange(longest) < samples[part, None])[..., None]
        for name, true in ideal.items():
            draws = TriadDraws(*(np.stack(p) for p in zip(*(draw[name] for draw in drawn), strict=True)))
            reading = read_triad(true, draws, values["triads"][name], sample_rate_hz=rate_hz)
            found[name][part, :longest] = np.where(going, reading, np.nan)
    index = np.arange(most)
    time_s = np.where(index < samples[:, None], (index + 1) / rate_hz, np.nan)
    return {"imu_time_s": time_s, **found}


def _draw_walk(values: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return the random numbers of one walk."""
    # The order of the draws is part of the world.
    marks = values["mark_count"]
    length_m, pauses = values["course"].length_m, values["pauses"]
    return {
        "first_rest": rng.random(),
        "last_rest": rng.random(),
        "misalignment": rng.standard_normal(),
        "start_heading": rng.standard_normal(),
        "pause": rng.random(pauses),
        "mark": rng.random(marks),
        "noted": rng.random(marks * values["laps"]),
        "gait": draw_gait(rng, values["gait"], length_m=length_m, pauses=pauses),
    }


def _draw_inertial(values: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return the random numbers of the sensors of one world."""
    return {
        "tilt": rng.standard_normal(2),
        "wave": rng.standard_normal((_WAVES, 2)),
        "wave_phase": rng.random((_WAVES, 3)),
        **{
            name: draw_triad(rng, values["samples_most"], sample_rate_hz=values["imu_rate_hz"])
            for name in values["triads"]
        },
    }


def _each(count: int, value: ArrayLike) -> Array:
    """Repeat what is the same in all worlds."""
    array = np.asarray(value, dtype=np.float64)
    return np.repeat(array[None], count, axis=0)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work, with what follows from them."""
    values: dict[str, Any] = {
        "size_m": numbers(settings, "size_m", 2, least=0),
        "ring_m": numbers(settings, "ring_m", 4, least=0),
        "laps": whole(settings, "laps", least=1),
        "mark_count": whole(settings, "mark_count", least=1),
        "passages": whole(settings, "passages", least=1),
        "imu": _switch(settings, "imu"),
        "pauses": whole(settings, "pauses", least=0),
        "first_rest_s": span(settings, "first_rest_s", least=0),
        "last_rest_s": span(settings, "last_rest_s", least=0),
        "pause_s": span(settings, "pause_s", least=0),
        "calibration_scans": whole(settings, "calibration_scans", least=1),
        "access_points": whole(settings, "access_points", least=1),
        "access_point_offset_m": span(settings, "access_point_offset_m", least=0),
        "reference_dbm": number(settings, "reference_dbm"),
        "floor_dbm": number(settings, "floor_dbm"),
        "noise_slow_share": number(settings, "noise_slow_share", least=0, most=1),
        "magnetic_north_deg": number(settings, "magnetic_north_deg"),
        "inclination_deg": number(settings, "inclination_deg", least=-90, most=90),
    }
    positive = [
        *("corner_radius_m", "corridor_width_m", "room_m", "duration_most_s", "mark_lattice_m"),
        *("calibration_spacing_m", "calibration_period_s", "survey_motion_correlation_s", "scan_period_s"),
        *("shadowing_correlation_m", "grid_m", "noise_correlation_s", "imu_rate_hz", "gravity_m_per_s2"),
        *("earth_field_ut", "disturbance_correlation_m"),
    ]
    not_negative = [
        *("misalignment_deg", "start_heading_deg", "mounting_tilt_deg", "survey_motion_m", "wall_loss_db"),
        *("path_loss_exponent", "body_loss_db", "shadowing_db", "scan_noise_db", "disturbance_ut"),
    ]
    values |= {name: number(settings, name, above=0) for name in positive}
    values |= {name: number(settings, name, least=0) for name in not_negative}
    values["gait"] = _gait(settings)
    values["triads"] = _triads(settings)

    size, corner = np.asarray(values["size_m"]), np.asarray(values["ring_m"]).reshape(2, 2)
    _require(bool(size.min() > 0), "size_m", f"{size} m has no area", "Give two positive lengths")
    side_m, width_m, radius_m = corner[1] - corner[0], values["corridor_width_m"], values["corner_radius_m"]
    _require(
        bool((side_m > max(width_m, 2 * radius_m)).all()),
        "ring_m",
        f"sides of {side_m} m leave no core inside a corridor of {width_m} m with corners of {radius_m} m",
        "Give lower left and upper right corner, farther apart",
    )
    _require(
        bool((corner[0] >= width_m / 2).all() and (corner[1] <= size - width_m / 2).all()),
        "ring_m",
        "the corridor leaves the floor",
        "Give a ring within size_m",
    )
    (left, bottom), (right, top) = corner
    middle = [0.5 * (left + right), bottom]
    lap = [[right, bottom], [right, top], [left, top], [left, bottom]]
    course = rounded_course([middle, *lap * values["laps"], middle], corner_radius_m=radius_m)
    lap_m = course.length_m / values["laps"]

    points, places = (round(lap_m / values[name]) for name in ("calibration_spacing_m", "mark_lattice_m"))
    _require(
        points >= 2, "calibration_spacing_m", f"a lap of {lap_m:.1f} m has {points} point(s)", "Give less"
    )
    marks, laps = values["mark_count"], values["laps"]
    _require(
        places >= 2 * marks,
        "mark_lattice_m",
        f"the ring has {places} places for {marks} marks, fewer than two each",
        "Give a finer lattice or fewer marks",
    )
    _require(
        values["passages"] <= marks * laps,
        "passages",
        f"{marks} marks are passed {marks * laps} times in {laps} laps",
        "Give at most as many",
    )
    for name in ("first_rest_s", "last_rest_s"):
        _require(values[name][0] > 0, name, "the walk may have no rest there", "Give times above zero")
    strides = course.length_m / values["gait"].stride_m
    _require(
        strides >= 30 * (values["pauses"] + 1),
        "pauses",
        f"some {strides:.0f} strides leave fewer than 30 for each pause",
        "Give fewer pauses or more laps",
    )
    reach_m = 3 * values["survey_motion_m"]
    _require(
        bool((corner[0] >= reach_m).all() and (corner[1] <= size - reach_m).all()),
        "survey_motion_m",
        "who calibrates may leave the floor",
        "Give a smaller motion",
    )
    nodes = np.rint(size / values["grid_m"]).astype(np.int64) + 1
    _require(
        bool(np.allclose((nodes - 1) * values["grid_m"], size) and nodes.min() >= 2),
        "grid_m",
        f"{values['grid_m']} m does not divide both sides of the floor",
        "Give a divisor of both sides of size_m",
    )
    scans_most = int(values["duration_most_s"] / values["scan_period_s"] + 1e-9) + 1
    return {
        **values,
        "course": course,
        "lap_m": lap_m,
        "points": points,
        "mark_places": places,
        "nodes": tuple(nodes.tolist()),
        "wall_m": _walls(size, corner, width_m, values["room_m"]),
        "survey_reach_m": reach_m,
        "scans_most": scans_most,
        "epochs_most": scans_most + 2 * values["passages"],
        "samples_most": int(values["duration_most_s"] * values["imu_rate_hz"] + 1e-9),
    }


def _gait(settings: Mapping[str, Any]) -> Gait:
    """Return the gait that the settings describe."""
    plain = [
        *("stride_m", "stride_s", "length_deviation", "duration_deviation", "end_share", "side_m"),
        *("side_deviation_m", "clearance_m", "landing_m", "swing_out_m", "shape_deviation", "strike_m"),
        *("strike_hz", "wobble_m", "rest_wobble_share"),
    ]
    degrees = ("yaw_deviation", "toe_off", "heel_strike", "wobble")
    spans = ("speed_m_per_s", "stance_share", "wobble_hz")
    legs = numbers(settings, "leg_strides", 2, least=1, integer=True)
    parts: dict[str, Any] = {name: number(settings, name) for name in plain}
    parts |= {f"{name}_rad": float(np.deg2rad(number(settings, f"{name}_deg"))) for name in degrees}
    parts |= {name: span(settings, name) for name in spans}
    parts["leg_strides"] = (int(legs[0]), int(legs[1]))
    parts["sensor_m"] = numbers(settings, "sensor_m", 2)
    gait: Gait = _named(Gait, parts, {f"{name}_rad": f"{name}_deg" for name in degrees})
    return gait


def _triads(settings: Mapping[str, Any]) -> dict[str, Triad]:
    """Return the errors of accelerometers, gyroscopes and magnetometers."""
    parts = ("turn_on_bias", "in_run_bias", "noise_density", "limit", "step")
    units = {
        "specific_force_m_per_s2": ("accelerometer", "m_per_s2", "m_per_s2_sqrt_hz", 1.0),
        "angular_rate_rad_per_s": ("gyro", "deg_per_s", "deg_per_s_sqrt_hz", float(np.deg2rad(1.0))),
        "magnetic_field_ut": ("magnetometer", "ut", "ut_sqrt_hz", 1.0),
    }
    found = {}
    for reading, (sensor, unit, density, scale) in units.items():
        named = {part: f"{sensor}_{part}_{density if part == 'noise_density' else unit}" for part in parts}
        errors = {part: scale * number(settings, name, least=0) for part, name in named.items()}
        named["scale_deviation"] = f"{sensor}_scale_deviation"
        errors["scale_deviation"] = number(settings, named["scale_deviation"], least=0)
        correlation_s = number(settings, "in_run_correlation_s", above=0)
        found[reading] = _named(Triad, {**errors, "in_run_correlation_s": correlation_s}, named)
    return found


def _named(kind: Any, parts: Mapping[str, Any], names: Mapping[str, str]) -> Any:
    """Make a part of the world, whose complaints shall name the setting."""
    try:
        return kind(**parts)
    except InputError as error:
        part = error.thing.split(", ")[-1]
        raise InputError(f"setting {names.get(part, part)}", error.limit, error.cure) from error


def _switch(settings: Mapping[str, Any], name: str) -> bool:
    """Return a setting that is on or off, true or false."""
    # Asked for as a number, a setting that is missing is named like any other.
    found = settings[name] if name in settings else number(settings, name)
    states = {"on": True, "off": False}
    if isinstance(found, bool):
        return found
    if not (isinstance(found, str) and found in states):
        raise InputError(f"setting {name}", f"{found!r} is neither on nor off", "Give on or off")
    return states[found]


def _require(fits: bool, name: str, limit: str, cure: str) -> None:
    if not fits:
        raise InputError(f"setting {name}", limit, cure)
