"""What the navigation of a flight refuses: arrays, times, units and places that it cannot use."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.flight_plan import interpolation_window, readings_a_step
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.geodetic import MOST_LATITUDE_RAD, to_local
from positioning.inertial.gps import usable_gps
from positioning.model import Array, Recording, Site

MOST_GAP_S = 0.1
"""A longer gap between readings of the inertial measurement unit is refused; assumed."""
MOST_AWAY_M = 100_000.0
"""Starts and GPS readings farther from the origin are refused; the local frame holds to here."""
FORCE_M_PER_S2 = (5.0, 20.0)
"""Where the median specific force of a flight lies, about gravity; other units lie elsewhere; assumed."""


def check_flight(recording: Recording, site: Site, settings: FlightFilter) -> None:
    """Refuse recordings that `flight_filter.navigate_flight` cannot use.

    Parameters
    ----------
    recording
        Stack, one leading axis.
    site
        Stack, with ``origin_geodetic``.
    settings
        What is to count.

    Raises
    ------
    InputError
        For settings without sense; arrays that are missing or do not fit; inertial times that do not increase
        or leave a gap; flights of one stack with so different rates of inertial readings that their
        covariances would not step alike, or with fewer readings than an interpolation needs; readings that
        are not finite; GPS, fixes or sightings before the first inertial reading, or none of them within the
        flight; an outage longer than the flight; an origin, a start or GPS at a pole, or more than 100 km
        from the origin; fixes or sightings that are infinite; what other units would make of a start, a
        specific force or a sighting: a median force outside 5 to 20 m/s^2, an angle of the start or a bearing
        above two pi, an elevation above half of pi, a range below zero.
    """
    settings.check()
    needed = ["imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s", "start_geodetic"]
    needed += ["start_velocity_m_per_s", "start_attitude_rad"]
    if settings.gps:
        needed += ["gps_time_s", "gps_geodetic"]
    if settings.fixes:
        needed += ["fix_m"]
    if settings.slam:
        needed += ["sighting_time_s", "sighting_landmark", "sighting"]
    missing = [name for name in needed if getattr(recording, name) is None]
    if missing:
        raise InputError("recording", f"it has no {', '.join(missing)}", "Give them, or switch their use off")
    if site.origin_geodetic is None:
        raise InputError("site", "it has no origin_geodetic", "Give the origin of its local frame")
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.shape[1] < 2:
        raise InputError(
            "recording.imu_time_s", f"its shape is {time_s.shape}, not [r, i]", "Give two readings or more"
        )
    worlds = len(time_s)
    _check_shapes(recording, site, time_s.shape)
    there = np.isfinite(time_s)
    length = np.count_nonzero(there, axis=1)
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    _refuse("imu_time_s", (behind & there) | np.isinf(time_s), "a time is missing or infinite", "Fill it")
    _refuse("imu_time_s", length[:, None] < 2, "there are fewer than two readings", "Leave the flight out")
    with np.errstate(invalid="ignore"):
        step_s = np.diff(time_s, axis=1)
        _refuse("imu_time_s", step_s <= 0, "time does not increase after it", "Sort, and leave out repeats")
        _refuse(
            "imu_time_s",
            step_s > MOST_GAP_S,
            f"no reading for more than {MOST_GAP_S} s after it",
            "Cut the recording there, or fill the gap; check that times are in seconds",
        )
    least = interpolation_window(settings) - 1
    _refuse(
        "imu_time_s",
        length[:, None] < least,
        f"there are fewer readings than the {least} that the interpolation needs",
        "Lower interpolation_order, or leave the flight out",
    )
    strides = readings_a_step(time_s, settings.covariance_hz)
    if (strides != strides[0]).any():
        raise InputError(
            "recording.imu_time_s",
            f"a step of the covariance has {strides.min()} readings in one flight and {strides.max()} in"
            " another",
            "Navigate flights of different rates one by one",
        )
    for name in ("specific_force_m_per_s2", "angular_rate_rad_per_s"):
        bad = ~np.isfinite(getattr(recording, name)).all(axis=-1) & there
        _refuse(name, bad, "the reading is not a finite number", "Leave it out or fill it")
    for name in ("start_geodetic", "start_velocity_m_per_s", "start_attitude_rad"):
        bad = ~np.isfinite(getattr(recording, name))
        _refuse(name, bad, "it is not a finite number", "Give the whole start")
    _check_units(recording)
    origin = np.asarray(site.origin_geodetic, dtype=np.float64)
    _check_places("site.origin_geodetic", origin, np.ones(worlds, dtype=np.bool_))
    starts = np.asarray(recording.start_geodetic, dtype=np.float64)
    _check_places("recording.start_geodetic", starts, np.ones(worlds, dtype=np.bool_), origin)
    begin = time_s[:, 0]
    end = time_s[np.arange(worlds), length - 1]
    start = begin - (time_s[:, 1] - begin)
    flight = np.stack([start, end], axis=1)
    if settings.gps:
        usable = usable_gps(recording, settings.outage_s)
        places = np.asarray(recording.gps_geodetic, dtype=np.float64)
        _check_places("recording.gps_geodetic", places, usable, origin[:, None])
        gps_s = np.asarray(recording.gps_time_s, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            _refuse(
                "gps_time_s",
                gps_s < start[:, None] - 1e-9,
                "it is before the first inertial reading",
                "Leave such readings out, or check that both clocks are the same",
            )
            _refuse("gps_time_s", np.diff(gps_s, axis=1) <= 0, "time does not increase after it", "Sort it")
        _check_span("gps_time_s", gps_s, usable_gps(_without_outage(recording)), flight)
        if recording.gps_outage_s is not None:
            outage = np.asarray(recording.gps_outage_s, dtype=np.float64)
            lasts = outage[:, 1] - outage[:, 0]
            if settings.outage_s is not None:
                lasts = np.where(np.isnan(lasts), np.nan, settings.outage_s)
            with np.errstate(invalid="ignore"):
                _refuse("gps_outage_s", lasts[:, None] < 0, "it ends before it begins", "Correct it")
                _refuse(
                    "gps_outage_s",
                    (lasts > end - start)[:, None],
                    "the outage is longer than the flight",
                    "Shorten it, or switch gps off",
                )
    early, cure = "it is before the first inertial reading", "Leave it out, or check that clocks are the same"
    if settings.fixes:
        fix = np.asarray(recording.fix_m)
        _refuse("fix_m", np.isinf(fix), "the fix is infinite", "Use NaN for none")
        with np.errstate(invalid="ignore"):
            before = np.asarray(recording.time_s, dtype=np.float64) < start[:, None] - 1e-9
        given = np.isfinite(fix[:, :, 0]).all(axis=-1)
        _refuse("fix_m", before & given, early, cure)
        _check_span("time_s of fix_m", np.asarray(recording.time_s, dtype=np.float64), given, flight)
    if settings.slam:
        bad = np.isinf(np.asarray(recording.sighting))
        _refuse("sighting", bad, "the sighting is infinite", "Use NaN for none")
        with np.errstate(invalid="ignore"):
            before = np.asarray(recording.sighting_time_s, dtype=np.float64) < start[:, None] - 1e-9
        given = np.asarray(recording.sighting_landmark) >= 0
        _refuse("sighting_time_s", before & given, early, cure)
        given &= np.isfinite(np.asarray(recording.sighting)).all(axis=-1)
        _check_span("sighting_time_s", np.asarray(recording.sighting_time_s, np.float64), given, flight)
        range_m, bearing, elevation = np.moveaxis(np.asarray(recording.sighting, dtype=np.float64), -1, 0)
        for bad, what in (
            (range_m < 0, "its range is below zero"),
            # The filter wraps bearings, so that both usual circles of them are right.
            (np.abs(bearing) > 2 * np.pi, "its bearing is above 2 pi"),
            (np.abs(elevation) > np.pi / 2, "its elevation is above pi / 2"),
        ):
            _refuse("sighting", bad & given, what, "Check units and order: metres, radians, radians")


def _check_shapes(recording: Recording, site: Site, shape: tuple[int, ...]) -> None:
    """Refuse arrays that do not fit the times of a stack."""
    worlds = shape[0]
    epochs = np.shape(recording.time_s)
    wanted: dict[str, tuple[int | None, ...]] = {
        "time_s": (worlds, None),
        "specific_force_m_per_s2": (*shape, 3),
        "angular_rate_rad_per_s": (*shape, 3),
        "start_geodetic": (worlds, 3),
        "start_velocity_m_per_s": (worlds, 3),
        "start_attitude_rad": (worlds, 3),
        "gps_time_s": (worlds, None),
        "gps_lever_arm_m": (worlds, 3),
        "gps_outage_s": (worlds, 2),
        "fix_m": (worlds, epochs[1] if len(epochs) == 2 else None, 1, 2),
        "sighting_time_s": (worlds, None),
        "sighting_lever_arm_m": (worlds, 3),
    }
    if recording.gps_time_s is not None:
        own = (worlds, recording.gps_time_s.shape[-1], 3)
        wanted |= {"gps_geodetic": own, "gps_velocity_m_per_s": own}
    if recording.sighting_time_s is not None:
        own = (worlds, recording.sighting_time_s.shape[-1], 3)
        wanted |= {"sighting": own, "sighting_landmark": own[:2]}
    for name, fitting in wanted.items():
        values = getattr(recording, name)
        if values is None:
            continue
        got = np.shape(values)
        if len(got) != len(fitting) or any(b not in (None, a) for a, b in zip(got, fitting, strict=True)):
            raise InputError(
                f"recording.{name}",
                f"its shape is {got}, not {tuple('any' if size is None else size for size in fitting)}",
                "Give stacks with the same flights, one leading axis",
            )
    origin = np.asarray(site.origin_geodetic)
    if origin.shape != (worlds, 3):
        raise InputError(
            "site.origin_geodetic",
            f"its shape is {origin.shape}, not {(worlds, 3)}",
            "Give one a flight",
        )


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    if bad.any():
        where = tuple(int(number) for number in np.argwhere(bad)[0])
        raise InputError(f"recording.{name}{list(where)}", limit, cure)


def _check_units(recording: Recording) -> None:
    """Refuse angles of the start, and specific forces, that other units would make."""
    turned = np.abs(np.asarray(recording.start_attitude_rad, dtype=np.float64)) > 2 * np.pi
    _refuse("start_attitude_rad", turned, "it is above 2 pi", "Check units: radians")
    force = np.asarray(recording.specific_force_m_per_s2, dtype=np.float64)
    middle = np.nanmedian(np.linalg.norm(force, axis=-1), axis=1)
    low, high = FORCE_M_PER_S2
    for world in np.flatnonzero(~((middle >= low) & (middle <= high)))[:1]:
        raise InputError(
            f"recording.specific_force_m_per_s2[{world}]",
            f"its median is {middle[world]:.3g} m/s^2, not {low:g} to {high:g}",
            "Check units: m/s^2, with gravity in them",
        )


def _check_places(
    name: str, geodetic: Array, counts: NDArray[np.bool_], origin_geodetic: Array | None = None
) -> None:
    """Refuse places that are not finite, at a pole, or far from the origin, where they count."""
    cure = "Check radians and the order latitude, longitude, height"

    def refuse(bad: NDArray[np.bool_], limit: str) -> None:
        for where in np.argwhere(bad & counts)[:1]:
            number, value = tuple(int(part) for part in where), geodetic[tuple(where)]
            told = ", ".join(f"{part:g}" for part in value)
            raise InputError(f"{name}{list(number)} = [{told}]", limit, cure)

    refuse(np.asarray(~np.isfinite(geodetic).all(axis=-1)), "it is not a finite number")
    with np.errstate(invalid="ignore"):
        degrees = np.degrees(MOST_LATITUDE_RAD)
        polar = ~(np.abs(geodetic[..., 0]) <= MOST_LATITUDE_RAD)
        refuse(np.asarray(polar), f"its latitude is not within {degrees:.1f} degrees of the equator")
        if origin_geodetic is not None:
            away_m = np.linalg.norm(to_local(geodetic, origin_geodetic), axis=-1)
            refuse(away_m > MOST_AWAY_M, f"it is more than {MOST_AWAY_M / 1000:g} km from the origin")


def _check_span(name: str, time_s: Array, given: NDArray[np.bool_], flight_s: Array) -> None:
    """Refuse flights that have readings of a sensor, but none between their begin and end."""
    for world, (begin, end) in enumerate(flight_s):
        own = time_s[world][given[world] & np.isfinite(time_s[world])]
        if len(own) and not ((own >= begin - 1e-9) & (own <= end + 1e-9)).any():
            raise InputError(
                f"recording.{name}[{world}]",
                f"its readings are from {own.min():g} to {own.max():g} s, the flight from {begin:g} to"
                f" {end:g} s, so that none is within it",
                "Check that times are in seconds and of the same clock",
            )


def _without_outage(recording: Recording) -> Recording:
    return replace(recording, gps_outage_s=None)
