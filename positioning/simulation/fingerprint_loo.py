"""The synthetic worlds of the study fingerprint_loo: one floor, six access points, one survey.

See Mirzababaei & Akbari, section 6. The paper reports a floor with walls, six IEEE 802.11b access points
and 257 places with two coordinates; all the rest is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.model import Site, Survey, Truth, Worlds
from positioning.radio import correlated_shadowing_db, path_loss_dbm, receive
from positioning.simulation.floorplan import corridor_building, stratified_points, survey_places
from positioning.simulation.settings import Span, number, numbers, span, whole


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Mirzababaei & Akbari, section 6. In each world the mean received signal strength of an access point
    is log-distance path loss, less a loss for each wall on the straight line, plus shadowing that is
    correlated over space; a scan adds independent fading and is reported in whole dBm.

    The fading is drawn as standard normals and scaled by ``noise_db`` afterwards: worlds of equal
    seeds share it at every noise, and share everything else.

    Parameters
    ----------
    settings
        All of: ``points``, ``access_points``, ``access_point_cells`` [columns, rows], ``size_m``
        [x, y], ``grid_m``, ``corridors``, ``corridor_width_m``, ``room_m`` [least, most],
        ``door_width_m``, ``furniture_share``, ``furniture_m``, ``wall_slots``, ``reference_dbm`` (at
        1 m), ``path_loss_exponent``, ``wall_loss_db``, ``shadowing_db``, ``shadowing_correlation_m``,
        ``noise_db``, ``floor_dbm``. Exponent and wall loss are a number, or [low, high] of which each
        world draws its own uniformly. Other keys are left alone.
    rngs
        One generator for each world; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.access_point_m`` [world, ap, 2],
        ``site.wall_m`` [world, wall_slots, 2, 2], ``survey.rss_dbm`` [world, points, ap],
        ``survey.position_m`` [world, points, 2]; truth ``truth.position_m`` [world, points, 2],
        ``truth.field_dbm`` [world, points, ap], ``truth.noise_db`` and ``truth.floor_dbm`` [world].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, or no generator.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    worlds = [_world(values, rng) for rng in rngs]
    observed, truth = (
        {name: np.stack([world[part][name] for world in worlds]) for name in worlds[0][part]}
        for part in (0, 1)
    )
    return Worlds(observed=observed, truth=truth)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work."""
    values: dict[str, Any] = {
        "points": whole(settings, "points", least=2),
        "access_points": whole(settings, "access_points", least=1),
        "access_point_cells": [
            int(n) for n in numbers(settings, "access_point_cells", 2, least=1, integer=True)
        ],
        "size_m": numbers(settings, "size_m", 2, least=0),
        "grid_m": number(settings, "grid_m", above=0),
        "corridors": whole(settings, "corridors", least=1),
        "corridor_width_m": number(settings, "corridor_width_m", above=0),
        "room_m": span(settings, "room_m", least=0),
        "door_width_m": number(settings, "door_width_m", least=0),
        "furniture_share": number(settings, "furniture_share", least=0, most=1),
        "furniture_m": number(settings, "furniture_m", above=0),
        "wall_slots": whole(settings, "wall_slots", least=1),
        "reference_dbm": number(settings, "reference_dbm"),
        "path_loss_exponent": span(settings, "path_loss_exponent", least=0),
        "wall_loss_db": span(settings, "wall_loss_db", least=0),
        "shadowing_db": number(settings, "shadowing_db", least=0),
        "shadowing_correlation_m": number(settings, "shadowing_correlation_m", above=0),
        "noise_db": number(settings, "noise_db", least=0),
        "floor_dbm": number(settings, "floor_dbm"),
    }
    columns, rows = values["access_point_cells"]
    if columns * rows != values["access_points"]:
        raise InputError(
            "setting access_point_cells",
            f"{columns} x {rows} cells do not hold {values['access_points']} access points, one each",
            "Give columns and rows whose product is access_points",
        )
    return values


def _world(values: Mapping[str, Any], rng: np.random.Generator) -> tuple[dict[str, NDArray[np.generic]], ...]:
    # The order of the draws is part of the world: what later settings change must not move earlier draws.
    exponent, wall_loss_db = (_draw(values[name], rng) for name in ("path_loss_exponent", "wall_loss_db"))
    access_point_m = stratified_points([[0.0, 0.0], values["size_m"]], values["access_point_cells"], rng)
    plan = corridor_building(
        values["size_m"],
        cell_m=values["grid_m"],
        corridors=values["corridors"],
        corridor_width_m=values["corridor_width_m"],
        room_m=values["room_m"],
        door_width_m=values["door_width_m"],
        rng=rng,
    )
    position_m, _ = survey_places(
        plan,
        points=values["points"],
        grid_m=values["grid_m"],
        furniture_share=values["furniture_share"],
        furniture_m=values["furniture_m"],
        rng=rng,
    )
    if len(plan.wall_m) > values["wall_slots"]:
        raise InputError(
            "setting wall_slots",
            f"a plan has {len(plan.wall_m)} walls and there are {values['wall_slots']} slots",
            "Give more slots",
        )
    wall_m = np.full((values["wall_slots"], 2, 2), np.nan)
    wall_m[: len(plan.wall_m)] = plan.wall_m

    field_dbm = (
        path_loss_dbm(
            pairwise_distance_m(position_m, access_point_m),
            reference_dbm=values["reference_dbm"],
            path_loss_exponent=exponent,
        )
        - wall_loss_db * wall_crossings(position_m, access_point_m, plan.wall_m)
        + correlated_shadowing_db(
            position_m,
            deviation_db=values["shadowing_db"],
            correlation_length_m=values["shadowing_correlation_m"],
            count=len(access_point_m),
            rng=rng,
        )
    )
    rss_dbm = receive(field_dbm, noise_db=values["noise_db"], floor_dbm=values["floor_dbm"], fading=rng)
    site = Site(corner_m=plan.corner_m, access_point_m=access_point_m, wall_m=wall_m)
    survey = Survey(rss_dbm=rss_dbm, position_m=position_m)
    truth = Truth(
        position_m=position_m,
        field_dbm=field_dbm,
        noise_db=np.array(values["noise_db"]),
        floor_dbm=np.array(values["floor_dbm"]),
    )
    return {**site.to_arrays(), **survey.to_arrays()}, truth.to_arrays()


def _draw(limits: Span, rng: np.random.Generator) -> float:
    # One draw even for a fixed value, so that fixing it leaves the rest of the world alone.
    low, high = limits
    return low + (high - low) * float(rng.random())
