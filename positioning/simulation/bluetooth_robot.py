"""The synthetic worlds of the study bluetooth_robot: one arena, three beacons, six drives, one calibration.

See Raghavan et al., sections II.B and V. The paper reports the arena, the beacons of Fig. 4, the kind of
drive and five inquiries an epoch; all the rest is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.model import Array, Calibration, Recording, Site, Worlds
from positioning.radio import interpolate
from positioning.simulation.robot import DriveDraws, draw_drive, meets_rectangle, random_drive
from positioning.simulation.settings import number, numbers, rows, span, whole

NEAREST_M = 0.1
"""Nearer than this, about a wavelength at 2.4 GHz, the radio law stays at its level."""

LAW_STEP_M = 0.01
"""Distance between the values at which the truth tabulates the radio law."""

# The factorisation of the field's correlation takes memory with the square of this number.
_MOST_NODES = 4000

# Relative to the variance: keeps the factorisation going, and is far below what a receiver resolves.
_JITTER = 1e-9


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Raghavan et al., sections II.B and V. The mean received signal strength of a beacon is a law of
    distance that all beacons share, log-distance path loss with an interference fringe, plus an offset of
    its own at each place: shadowing that is correlated over space, less a loss for each edge of furniture
    on the straight line. The offset is drawn at the nodes of a grid and bilinear between them; the world is
    defined so. An inquiry adds independent noise and is reported in whole dBm; an epoch is the mean of
    its inquiries. The calibration drive leads straight away from a beacon over open floor elsewhere: it has
    the same law and shadowing of its own, because a curve taken from the very field that is tested
    would know it.

    Shadowing, fringe and noise are drawn as standard normals and scaled afterwards: worlds of equal seeds
    share them, and their drives, at every value of ``shadowing_db``, ``fringe_db``, ``furniture_loss_db``
    and ``inquiry_noise_db``.

    Parameters
    ----------
    settings
        All of: ``size_m`` [x, y], ``beacons_m`` [beacon, 2], ``start_m`` [run, 2], ``furniture_m``
        [piece, 4] (x and y of the lower left, then of the upper right corner), ``advance_m`` [least,
        most], ``margin_m``, ``iterations_least``, ``iterations_most``, ``inquiries``, ``reference_dbm`` (at
        1 m), ``path_loss_exponent``, ``fringe_db`` (amplitude), ``fringe_period_m``, ``shadowing_db``,
        ``shadowing_correlation_m``, ``furniture_loss_db`` (an edge), ``inquiry_noise_db``,
        ``calibration_nearest_m``, ``calibration_farthest_m``, ``calibration_step_m``,
        ``static_distance_m``, ``static_inquiries``, ``inquiry_s``, ``turn_noise_rad``,
        ``advance_noise_m``, ``drift_noise_rad_per_m``, ``grid_m``. Other keys are left alone.
    rngs
        One generator for each world; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.access_point_m`` [world, beacon, 2];
        ``calibration.distance_m`` and ``calibration.rss_dbm`` [world, stop], the mean of the inquiries
        of a stop; ``recording.time_s``, ``.turn_before_rad``, ``.advance_m``, ``.turn_after_rad``
        [world, run, epoch], ``recording.rss_dbm`` [world, run, epoch, beacon] and
        ``recording.start_heading_rad`` [world, run]; ``static.time_s`` and ``static.rss_dbm`` [world,
        inquiry]. An iteration of the paper is an epoch, the start included. Time counts inquiries only,
        since no speed is printed. NaN follows the end of a run.

        Truth ``truth.position_m`` [world, run, epoch, 2], ``truth.heading_rad`` [world, run, epoch] (not
        wrapped), ``truth.distance_m`` [world, run, epoch, beacon]; the law as ``truth.law_distance_m`` and
        ``truth.law_dbm`` [world, g]; the offsets as ``truth.offset_dbm`` [world, x, y, beacon] at
        the nodes of a grid from corner to corner with steps of ``truth.grid_m`` [world];
        ``truth.deviation_db`` [world], standard deviation of the strength of an epoch about its mean,
        rounding included; ``truth.furniture_m`` [world, piece, 2, 2], lower left and upper right corner;
        ``truth.turn_noise_rad``, ``truth.advance_noise_m``, ``truth.drift_noise_rad_per_m`` [world].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, or no generator.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    count, drawn = len(rngs), [_draw(values, rng) for rng in rngs]
    normal = {name: np.stack([normals[name] for normals, _ in drawn]) for name in drawn[0][0]}
    drive_draws = DriveDraws(*map(np.stack, zip(*(draws for _, draws in drawn), strict=True)))
    phase_rad = normal["phase_rad"]

    offset_dbm = _offset_dbm(values, normal["offset"])
    drive = random_drive(
        values["start_m"],
        drive_draws,
        size_m=values["size_m"],
        margin_m=values["margin_m"],
        furniture_m=values["furniture_m"],
        advance_m=values["advance_m"],
        epochs_least=values["iterations_least"],
        turn_noise_rad=values["turn_noise_rad"],
        advance_noise_m=values["advance_noise_m"],
        drift_noise_rad_per_m=values["drift_noise_rad_per_m"],
    )
    distance_m = pairwise_distance_m(drive.position_m, values["beacons_m"])
    field_dbm = law_dbm(values, distance_m, phase_rad[:, None, None, None])
    field_dbm += interpolate(offset_dbm, drive.position_m, values["grid_m"])
    rss_dbm = _inquire(values, field_dbm[..., None], normal["inquiry"]).mean(axis=-1)

    stop_m = values["stop_m"]
    line_factor = _factor(np.stack([stop_m, np.zeros_like(stop_m)], axis=-1), values)
    line_shadowing_db = values["shadowing_db"] * (line_factor @ normal["line"][..., None])[..., 0]
    line_dbm = law_dbm(values, stop_m, phase_rad[:, None]) + line_shadowing_db
    static_dbm = law_dbm(values, values["static_distance_m"], phase_rad)
    static_dbm += values["shadowing_db"] * normal["static"]

    epoch_s = values["inquiries"] * values["inquiry_s"]
    time_s = np.where(
        np.isnan(drive.heading_rad), np.nan, epoch_s * np.arange(values["iterations_most"], dtype=np.float64)
    )
    site = Site(
        corner_m=_each(count, [[0.0, 0.0], values["size_m"]]),
        access_point_m=_each(count, values["beacons_m"]),
    )
    calibration = Calibration(
        distance_m=_each(count, stop_m),
        rss_dbm=_inquire(values, line_dbm[..., None], normal["line_inquiry"]).mean(axis=-1),
    )
    recording = Recording(
        time_s=time_s,
        rss_dbm=rss_dbm,
        turn_before_rad=drive.turn_before_rad,
        advance_m=drive.advance_m,
        turn_after_rad=drive.turn_after_rad,
        start_heading_rad=drive.heading_rad[..., 0],
    )
    static = {
        "static.time_s": _each(count, values["inquiry_s"] * np.arange(values["static_inquiries"])),
        "static.rss_dbm": _inquire(values, static_dbm[:, None], normal["static_inquiry"]),
    }
    law_distance_m = np.arange(round(float(np.hypot(*values["size_m"])) / LAW_STEP_M) + 2) * LAW_STEP_M
    # Rounding to whole dBm adds the variance of a uniform distribution one dB wide.
    deviation_db = np.sqrt((values["inquiry_noise_db"] ** 2 + 1 / 12) / values["inquiries"])
    truth: dict[str, NDArray[np.generic]] = {
        "truth.position_m": drive.position_m,
        "truth.heading_rad": drive.heading_rad,
        "truth.distance_m": distance_m,
        "truth.law_distance_m": _each(count, law_distance_m),
        "truth.law_dbm": law_dbm(values, law_distance_m, phase_rad[:, None]),
        "truth.offset_dbm": offset_dbm,
        "truth.grid_m": _each(count, values["grid_m"]),
        "truth.deviation_db": _each(count, deviation_db),
        "truth.furniture_m": _each(count, values["furniture_m"]),
        **{
            f"truth.{name}": _each(count, values[name])
            for name in ("turn_noise_rad", "advance_noise_m", "drift_noise_rad_per_m")
        },
    }
    return Worlds(
        observed={**site.to_arrays(), **calibration.to_arrays(), **recording.to_arrays(), **static},
        truth=truth,
    )


def law_dbm(values: Mapping[str, Any], distance_m: ArrayLike, phase_rad: ArrayLike) -> Array:
    """Return the mean strength that all beacons share at a distance: path loss and an interference fringe.

    See Raghavan et al., Fig. 3, whose strength rises and falls on its way down.

    Parameters
    ----------
    values
        Settings ``reference_dbm``, ``path_loss_exponent``, ``fringe_db`` and ``fringe_period_m``.
    distance_m
        Distances, [...], metres.
    phase_rad
        Phase of the fringe; broadcasts against the distances.
    """
    distance = np.maximum(np.asarray(distance_m, dtype=np.float64), NEAREST_M)
    fringe = np.sin(2 * np.pi * distance / values["fringe_period_m"] + phase_rad)
    level: Array = (
        values["reference_dbm"]
        - 10.0 * values["path_loss_exponent"] * np.log10(distance)
        + values["fringe_db"] * fringe
    )
    return level


def _offset_dbm(values: Mapping[str, Any], normal: Array) -> Array:
    """Return what places and beacons add to the law, [world, x, y, beacon], at the nodes of the grid."""
    nodes = values["nodes"]
    axes = [np.arange(count) * values["grid_m"] for count in nodes]
    node_m = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    (x, y) = np.moveaxis(values["furniture_m"], -1, 0)
    corner_m = np.stack([x[:, [0, 1, 1, 0]], y[:, [0, 0, 1, 1]]], axis=-1)
    edge_m = np.stack([corner_m, np.roll(corner_m, -1, axis=1)], axis=-2).reshape(-1, 2, 2)
    crossed = wall_crossings(node_m, values["beacons_m"], edge_m)
    # One product a world: what a world is does not depend on how many are drawn at once.
    shadowing_db = values["shadowing_db"] * (_factor(node_m, values) @ normal)
    offset: Array = (shadowing_db - values["furniture_loss_db"] * crossed).reshape(len(normal), *nodes, -1)
    return offset


def _factor(position_m: Array, values: Mapping[str, Any]) -> Array:
    """Return what turns standard normals at places [n, 2] into shadowing of unit deviation, [n, n].

    The correlation of `positioning.radio.correlated_shadowing_db`, which factors it for each world anew.
    """
    correlation = np.exp(-pairwise_distance_m(position_m, position_m) / values["shadowing_correlation_m"])
    factor: Array = np.linalg.cholesky(correlation + _JITTER * np.eye(len(position_m)))
    return factor


def _inquire(values: Mapping[str, Any], mean_dbm: Array, normal: Array) -> Array:
    """Return what single inquiries report: the mean with noise, in whole dBm."""
    reading: Array = np.rint(mean_dbm + values["inquiry_noise_db"] * normal)
    return reading


def _draw(values: Mapping[str, Any], rng: np.random.Generator) -> tuple[dict[str, Array], DriveDraws]:
    """Return the random numbers of one world: the fringe's phase and standard normals, and its drives'."""
    # The order of the draws is part of the world, and no number of draws depends on another draw.
    runs, epochs, beacons = len(values["start_m"]), values["iterations_most"], len(values["beacons_m"])
    stops, inquiries = len(values["stop_m"]), values["inquiries"]
    drawn = {
        "phase_rad": np.asarray(rng.uniform(0.0, 2 * np.pi)),
        "offset": rng.standard_normal((int(np.prod(values["nodes"])), beacons)),
        "line": rng.standard_normal(stops),
        "line_inquiry": rng.standard_normal((stops, inquiries)),
        "static": np.asarray(rng.standard_normal()),
        "static_inquiry": rng.standard_normal(values["static_inquiries"]),
        "inquiry": rng.standard_normal((runs, epochs, beacons, inquiries)),
    }
    return drawn, draw_drive(rng, runs=runs, epochs=epochs)


def _each(count: int, value: ArrayLike) -> Array:
    """Repeat what is the same in all worlds."""
    array = np.asarray(value, dtype=np.float64)
    return np.repeat(array[None], count, axis=0)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work, with the grid and the stops that follow from them."""
    values: dict[str, Any] = {
        "size_m": numbers(settings, "size_m", 2, least=0),
        "beacons_m": rows(settings, "beacons_m", 2, least=3),
        "start_m": rows(settings, "start_m", 2, least=1),
        "furniture_m": rows(settings, "furniture_m", 4, least=0).reshape(-1, 2, 2),
        "advance_m": span(settings, "advance_m", least=0),
        "margin_m": number(settings, "margin_m", least=0),
        "iterations_least": whole(settings, "iterations_least", least=1),
        "iterations_most": whole(settings, "iterations_most", least=1),
        "inquiries": whole(settings, "inquiries", least=1),
        "reference_dbm": number(settings, "reference_dbm"),
        "path_loss_exponent": number(settings, "path_loss_exponent", least=0),
        "fringe_db": number(settings, "fringe_db", least=0),
        "fringe_period_m": number(settings, "fringe_period_m", above=0),
        "shadowing_db": number(settings, "shadowing_db", least=0),
        "shadowing_correlation_m": number(settings, "shadowing_correlation_m", above=0),
        "furniture_loss_db": number(settings, "furniture_loss_db", least=0),
        "inquiry_noise_db": number(settings, "inquiry_noise_db", least=0),
        "calibration_nearest_m": number(settings, "calibration_nearest_m", above=0),
        "calibration_farthest_m": number(settings, "calibration_farthest_m", above=0),
        "calibration_step_m": number(settings, "calibration_step_m", above=0),
        "static_distance_m": number(settings, "static_distance_m", above=0),
        "static_inquiries": whole(settings, "static_inquiries", least=1),
        "inquiry_s": number(settings, "inquiry_s", above=0),
        "turn_noise_rad": number(settings, "turn_noise_rad", least=0),
        "advance_noise_m": number(settings, "advance_noise_m", least=0),
        "drift_noise_rad_per_m": number(settings, "drift_noise_rad_per_m", least=0),
        "grid_m": number(settings, "grid_m", above=0),
    }
    size, furniture = np.asarray(values["size_m"]), values["furniture_m"]
    _require(bool(size.min() > 0), "size_m", f"{size} m has no area", "Give two positive lengths")
    _require(values["advance_m"][1] > 0, "advance_m", "the robot never moves", "Give a longest translation")
    _require(
        values["margin_m"] < size.min() / 2,
        "margin_m",
        f"{values['margin_m']} m leaves nothing of an arena of {size[0]} x {size[1]} m",
        "Give a margin below half of the arena's width",
    )
    _require(
        values["iterations_most"] >= values["iterations_least"],
        "iterations_most",
        f"{values['iterations_most']} is below iterations_least, {values['iterations_least']}",
        "Give at least as many",
    )
    _require(
        len(np.unique(values["beacons_m"], axis=0)) == len(values["beacons_m"]),
        "beacons_m",
        "two beacons share a place",
        "Give each beacon a place of its own",
    )
    _require(
        bool(
            (furniture[:, 0] < furniture[:, 1]).all() and (furniture >= 0).all() and (furniture <= size).all()
        ),
        "furniture_m",
        "a piece has no area, or is not inside the arena",
        "Give the lower left, then the upper right corner of each piece",
    )
    start = values["start_m"]
    inside = ((start >= values["margin_m"]) & (start <= size - values["margin_m"])).all(axis=-1)
    _require(
        bool((inside & ~meets_rectangle(start, start, furniture)).all()),
        "start_m",
        "a start is outside of the arena's margin, or in furniture",
        "Give places where the robot can stand",
    )
    nodes = np.rint(size / values["grid_m"]).astype(np.int64) + 1
    _require(
        np.allclose((nodes - 1) * values["grid_m"], size) and 4 <= nodes.prod() <= _MOST_NODES,
        "grid_m",
        f"{values['grid_m']} m does not divide the arena into at most {_MOST_NODES} nodes",
        "Give a divisor of both sides of size_m, not too fine",
    )
    first, last, step = (values[f"calibration_{name}_m"] for name in ("nearest", "farthest", "step"))
    steps = round((last - first) / step)
    _require(
        steps >= 1 and bool(np.isclose(first + steps * step, last)),
        "calibration_farthest_m",
        f"{last} m is not one or more steps of {step} m beyond {first} m",
        "Give calibration_nearest_m plus a multiple of calibration_step_m",
    )
    return {**values, "nodes": tuple(nodes.tolist()), "stop_m": first + np.arange(steps + 1) * step}


def _require(fits: bool, name: str, limit: str, cure: str) -> None:
    if not fits:
        raise InputError(f"setting {name}", limit, cure)
