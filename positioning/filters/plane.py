"""Receivers that move in the plane: checks of a stack of recordings, and the particle filter over them."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError, check_whole
from positioning.filters import particle_filter
from positioning.filters.resampling import effective_sample_size
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth

Part = TypeVar("Part", bound=Recording | Site | Survey | Calibration | Truth)
LogLikelihood = Callable[[NDArray[np.intp], int, Array], Array]

LEAST_VARIANCE_M2 = 1e-6
"""No estimate of a particle filter is surer than one millimetre: all particles may be copies of one."""

# Values of one state variable that are worked on at a time, so that a block stays in the cache.
_BLOCK = 1 << 14


class MotionNoise(NamedTuple):
    """Standard deviations of a motion, each a scalar or [r].

    See Raghavan et al., section IV.D, where they are not printed.

    Attributes
    ----------
    turn_rad
        Of each of the two turns.
    advance_m
        Of a translation.
    drift_rad_per_m
        Of the drift of the heading in a translation, per metre of it; its mean is zero.
    walk_m_per_s
        Of each coordinate after a second, where nothing is known of the motion; it grows with the root of
        time.
    """

    turn_rad: Any
    advance_m: Any
    drift_rad_per_m: Any
    walk_m_per_s: Any = 1.0


def with_leading_axis(part: Part) -> Part:
    """Return a stack of one."""
    values = {field.name: getattr(part, field.name) for field in fields(part)}
    stacked: dict[str, Any] = {k: None if v is None else np.asarray(v)[None] for k, v in values.items()}
    return type(part)(**stacked)


def track_one(
    tracker: Any,
    recording: Recording,
    survey: Survey | Calibration | None,
    site: Site,
    rng: np.random.Generator,
) -> Track:
    """Run a tracker's ``track_stack`` on one recording.

    Parameters
    ----------
    tracker
        Has ``track_stack``.
    recording, survey, site
        Without leading axes.
    rng
        The recording's generator.
    """
    learnt = None if survey is None else with_leading_axis(survey)
    track = tracker.track_stack(with_leading_axis(recording), learnt, with_leading_axis(site), [rng])
    return Track(
        time_s=track.time_s[0],
        position_m=track.position_m[0],
        covariance_m2=track.covariance_m2[0],
        extra={name: values[0] for name, values in track.extra.items()},
    )


def check_stack(
    recording: Recording, site: Site, *, beacons: bool = True, ordered: bool = True
) -> NDArray[np.intp]:
    """Return the number of epochs of each recording of a stack that can be used.

    Parameters
    ----------
    recording, site
        Stacks with one leading axis.
    beacons
        Whether the places of the beacons are needed.
    ordered
        Whether times must increase.

    Returns
    -------
    NDArray
        [r], at least 1.

    Raises
    ------
    InputError
        For arrays that do not fit each other, an empty recording, times that are infinite, missing in
        between or not increasing, missing motion, infinite readings, a start that is infinite or in degrees,
        or a site without area or, if they are needed, without the places of its beacons.
    """
    time_s = np.asarray(recording.time_s, dtype=np.float64)
    if time_s.ndim != 2 or time_s.size == 0:
        raise InputError(
            "recording.time_s", f"its shape is {time_s.shape}: no epochs", "Give at least one recording"
        )
    there = ~np.isnan(time_s)
    length = np.count_nonzero(there, axis=1)
    behind = np.arange(time_s.shape[1]) >= length[:, None]
    _refuse("recording.time_s", length[:, None] == 0, "the recording has no epoch", "Leave it out")
    followed = np.logical_or.accumulate(there[:, ::-1], axis=1)[:, ::-1]
    _refuse("recording.time_s", followed & ~there, "the time is missing", "Use NaN after the end only")
    _refuse("recording.time_s", np.isinf(time_s), "the time is infinite", "Give seconds")
    with np.errstate(invalid="ignore"):
        backwards = np.diff(time_s, axis=1, prepend=-np.inf) <= 0
    if ordered:
        _refuse("recording.time_s", backwards, "time does not increase", "Sort the epochs by time")
    motion = {k: getattr(recording, k) for k in ("turn_before_rad", "advance_m", "turn_after_rad")}
    known = [name for name, values in motion.items() if values is not None]
    if known and len(known) < len(motion):
        raise InputError(
            f"recording.{known[0]}", "the rest of the motion is missing", f"Give {', '.join(motion)}, or none"
        )
    for name in known:
        _shaped(f"recording.{name}", motion[name], time_s.shape)
        _refuse(
            f"recording.{name}",
            ~np.isfinite(motion[name]) & ~behind,
            "the motion is not a finite number",
            "Give every epoch a motion, or none",
        )
    for name in ("rss_dbm", "range_m"):
        readings = getattr(recording, name)
        if readings is not None:
            heard = None if site.access_point_m is None else np.shape(site.access_point_m)[1]
            _shaped(f"recording.{name}", readings, (*time_s.shape, heard))
            _refuse(f"recording.{name}", np.isinf(readings), "a reading is infinite", "Use NaN for none")
    _check_start(recording, len(time_s))
    _check_site(site, len(time_s), beacons)
    return np.asarray(length, dtype=np.intp)


def check_angle(name: str, value: Any) -> None:
    """Refuse an angle that is infinite, or more than a whole turn either way; NaN passes: it is unknown.

    Raises
    ------
    InputError
        Naming the angle.
    """
    angle = np.asarray(value)
    if angle.dtype.kind not in "iuf":
        raise InputError(name, f"{value!r} is not a number", "Give radians")
    if np.isinf(angle).any():
        raise InputError(name, "it is infinite", "Give radians")
    if (np.abs(angle) > 2 * np.pi).any():
        most = float(np.nanmax(np.abs(angle)))
        raise InputError(
            name, f"{most:g} is more than a whole turn: it looks like degrees", "Multiply by pi / 180"
        )


def centre_and_variance(site: Site) -> tuple[Array, Array]:
    """Return mean [r, 2], metres, and covariance [r, 2, 2], square metres, of a uniform place in a site."""
    corner_m = np.asarray(site.corner_m, dtype=np.float64)
    size_m = corner_m[:, 1] - corner_m[:, 0]
    return corner_m.mean(axis=1), size_m[:, :, None] ** 2 / 12 * np.eye(2)


def headings_missing(recording: Recording) -> bool:
    """Tell whether the start heading of any recording of a stack was not noted."""
    heading_rad = recording.start_heading_rad
    return heading_rad is None or bool(np.isnan(heading_rad).any())


def start_heading_rad(recording: Recording) -> Array:
    """Return the noted start headings, [r], radians.

    Raises
    ------
    InputError
        Where one was not noted.
    """
    if headings_missing(recording):
        raise InputError(
            "recording.start_heading_rad",
            "it was not noted, but heading_known is set",
            "Set heading_known to false, or record the heading",
        )
    return np.asarray(recording.start_heading_rad, dtype=np.float64)


def cannot_locate(recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
    """Say why no epoch can have a fix: a reason to skip these data, empty where there is none."""
    if recording.fix_m is not None:
        return ""
    if site.access_point_m is None or not np.isfinite(site.access_point_m).all():
        return "the places of the beacons are not known"
    if np.shape(site.access_point_m)[-2] < 3:
        return "a fix needs three beacons"
    if recording.range_m is not None:
        return ""
    if recording.rss_dbm is None or not isinstance(survey, Calibration):
        return "there are neither distances nor a calibration run that tells them from strengths"
    return ""


def check_locatable(recording: Recording, survey: Survey | Calibration | None, site: Site) -> None:
    """Refuse a stack without beacons, or without anything that tells distances.

    Raises
    ------
    InputError
        With the reason that `cannot_locate` gives, or what `check_stack` raises.
    """
    reason = cannot_locate(recording, survey, site)
    if reason:
        raise InputError(
            "recording and site",
            reason,
            "Give access_point_m of three beacons, and range_m or rss_dbm with a calibration run",
        )


WHOLE = ("clusters", "downsampling", "headings", "particles", "scan_every")
"""Settings that count something."""


def check_settings(**least: tuple[Any, float, float]) -> None:
    """Refuse settings outside their limits: ``name=(value, least, most)``.

    Those of `WHOLE` must be whole numbers.

    Raises
    ------
    InputError
        Naming the first setting that is outside, or no number.
    """
    for name, (value, lowest, highest) in least.items():
        if name in WHOLE:
            check_whole(name, value)
        if np.asarray(value).dtype.kind not in "iuf":
            raise InputError(f"{name}={value!r}", "it is not a number", "Correct the setting")
        if not (np.asarray(value) >= lowest).all() or not (np.asarray(value) <= highest).all():
            raise InputError(
                f"{name}={value}", f"it must be from {lowest:g} to {highest:g}", "Correct the setting"
            )


def turn_advance_turn(
    state: Array,
    turn_before_rad: Array,
    advance_m: Array,
    turn_after_rad: Array,
    noise: MotionNoise,
    draws: Array,
) -> None:
    """Move particles, in place, by a turn, a straight line and a second turn, each with its noise.

    See Raghavan et al., section IV.D; the printed second theta_1'' is theta_1'. The drift turns the heading
    evenly along the line, which therefore leads in the direction half way between.

    Parameters
    ----------
    state
        x, y, heading, [r, p, 3], metres and radians; changed.
    turn_before_rad, advance_m, turn_after_rad
        Commands, [r].
    noise
        Standard deviations, each a scalar or [r].
    draws
        Standard normals of turn before, advance, drift and turn after, [r, 4, p].
    """
    turn, advance, drift, after = (draws[:, part] for part in range(4))
    turn_noise, advance_noise, drift_noise = (np.reshape(value, (-1, 1)) for value in noise[:3])
    heading = state[..., 2]
    heading += turn_before_rad[:, None] + turn_noise * turn
    drift_rad = drift_noise * np.abs(advance_m)[:, None] * drift
    way_rad = heading + 0.5 * drift_rad
    driven_m = advance_m[:, None] + advance_noise * advance
    state[..., 0] += driven_m * np.cos(way_rad)
    state[..., 1] += driven_m * np.sin(way_rad)
    heading += drift_rad + (turn_after_rad[:, None] + turn_noise * after)


def filter_particles(
    recording: Recording,
    site: Site,
    rngs: Sequence[np.random.Generator],
    log_likelihood: LogLikelihood,
    *,
    particles: int,
    noise: MotionNoise,
    heading_known: bool,
    resample_below: float,
) -> Track:
    """Run a particle filter over x, y and heading on every recording of a stack.

    See Raghavan et al., sections IV.C and IV.D. It starts with particles uniform over the site. An estimate
    is the weighted mean after the update and before resampling.

    Parameters
    ----------
    recording, site
        Stacks with one leading axis.
    rngs
        One generator a recording.
    log_likelihood
        Called with recordings [m], an epoch and places [m, p, 2], metres; returns [m, p].
    particles
        Number of particles.
    noise
        Of the motion.
    heading_known
        Start with the recorded heading; else with any.
    resample_below
        Resample where the effective sample size is below this share of the particles.

    Returns
    -------
    Track
        With extra ``effective_sample_size`` [r, n].

    Raises
    ------
    InputError
        For input that `check_stack` refuses, senseless settings, or unknown headings.
    """
    check_settings(
        particles=(particles, 1, 1e9),
        resample_below=(resample_below, 0, 1),
        turn_noise_rad=(noise.turn_rad, 0, np.inf),
        advance_noise_m=(noise.advance_m, 0, np.inf),
        drift_noise_rad_per_m=(noise.drift_rad_per_m, 0, np.inf),
        walk_m_per_s=(noise.walk_m_per_s, 0, np.inf),
    )
    length = check_stack(recording, site, beacons=False)
    heading_rad = start_heading_rad(recording) if heading_known else None
    count, epochs = recording.time_s.shape
    deviations = MotionNoise(*(np.broadcast_to(np.asarray(v, dtype=np.float64), count) for v in noise))
    position_m = np.full((count, epochs, 2), np.nan)
    covariance_m2 = np.full((count, epochs, 2, 2), np.nan)
    effective = np.full((count, epochs), np.nan)
    # The longest first: those that still run are always the first ones of a block.
    order = np.argsort(-length, kind="stable")
    step = max(1, _BLOCK // particles)
    for begin in range(0, count, step):
        rows = order[begin : begin + step]
        state = _start(site, heading_rad, rows, [rngs[row] for row in rows], particles)
        weight = np.full((len(rows), particles), 1.0 / particles)
        for epoch in range(int(length[rows[0]])):
            running = rows[length[rows] > epoch]
            busy = slice(0, len(running))
            own = [rngs[row] for row in running]
            if epoch:
                _move(recording, deviations, state[busy], running, epoch, own)
            weight[busy] = particle_filter.reweight(
                weight[busy], log_likelihood(running, epoch, state[busy, :, :2])
            )
            place = running, epoch
            position_m[place] = particle_filter.weighted_mean(state[busy, :, :2], weight[busy])
            covariance = particle_filter.weighted_covariance(state[busy, :, :2], weight[busy])
            covariance_m2[place] = covariance + LEAST_VARIANCE_M2 * np.eye(2)
            effective[place] = effective_sample_size(weight[busy])
            particle_filter.resample(state[busy], weight[busy], resample_below, own)
    return Track(
        time_s=recording.time_s,
        position_m=position_m,
        covariance_m2=covariance_m2,
        extra={"effective_sample_size": effective},
    )


def _start(
    site: Site,
    heading_rad: Array | None,
    rows: NDArray[np.intp],
    rngs: Sequence[np.random.Generator],
    particles: int,
) -> Array:
    state = particle_filter.empty_states(len(rows), particles, 3)
    draws = particle_filter.uniform(rngs, (3, particles))
    corner_m = np.asarray(site.corner_m, dtype=np.float64)[rows]
    for axis in range(2):
        low, high = corner_m[:, 0, axis, None], corner_m[:, 1, axis, None]
        state[..., axis] = low + (high - low) * draws[:, axis]
    state[..., 2] = 2 * np.pi * draws[:, 2] if heading_rad is None else heading_rad[rows, None]
    return state


def _move(
    recording: Recording,
    noise: MotionNoise,
    state: Array,
    rows: NDArray[np.intp],
    epoch: int,
    rngs: Sequence[np.random.Generator],
) -> None:
    particles = state.shape[1]
    if recording.turn_before_rad is None or recording.advance_m is None or recording.turn_after_rad is None:
        draws = particle_filter.standard_normal(rngs, (2, particles))
        elapsed_s = recording.time_s[rows, epoch] - recording.time_s[rows, epoch - 1]
        step_m = noise.walk_m_per_s[rows] * np.sqrt(elapsed_s)
        for axis in range(2):
            state[..., axis] += step_m[:, None] * draws[:, axis]
        return
    turn_advance_turn(
        state,
        recording.turn_before_rad[rows, epoch],
        recording.advance_m[rows, epoch],
        recording.turn_after_rad[rows, epoch],
        MotionNoise(*(values[rows] for values in noise)),
        particle_filter.standard_normal(rngs, (4, particles)),
    )


def _check_start(recording: Recording, recordings: int) -> None:
    """Refuse a noted start that does not fit; NaN stands for one that was not noted."""
    if recording.start_heading_rad is not None:
        _shaped("recording.start_heading_rad", recording.start_heading_rad, (recordings,))
        check_angle("recording.start_heading_rad", recording.start_heading_rad)
    if recording.start_position_m is not None:
        _shaped("recording.start_position_m", recording.start_position_m, (recordings, 2))
        _refuse(
            "recording.start_position_m",
            np.isinf(recording.start_position_m),
            "the place is infinite",
            "Give metres",
        )


def _check_site(site: Site, recordings: int, beacons: bool) -> None:
    _shaped("site.corner_m", site.corner_m, (recordings, 2, 2))
    corner_m = np.asarray(site.corner_m, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        area = np.isfinite(corner_m).all(axis=(1, 2)) & (corner_m[:, 1] > corner_m[:, 0]).all(axis=1)
    _refuse(
        "site.corner_m",
        np.logical_not(area),
        "the corners enclose no area",
        "Give the lower left corner first",
    )
    if beacons:
        if site.access_point_m is None:
            raise InputError("site", "the places of the beacons are not known", "Give access_point_m")
        _shaped("site.access_point_m", site.access_point_m, (recordings, None, 2))
        _refuse(
            "site.access_point_m",
            ~np.isfinite(site.access_point_m),
            "a place of a beacon is not a finite number",
            "Survey all beacons",
        )


def _shaped(name: str, values: Any, shape: tuple[int | None, ...]) -> None:
    found = np.shape(values)
    if len(found) != len(shape) or any(
        asked not in (None, size) for asked, size in zip(shape, found, strict=True)
    ):
        expected = ", ".join("any" if size is None else str(size) for size in shape)
        raise InputError(name, f"its shape is {found}, not ({expected})", "Give arrays that fit each other")


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    if bad.any():
        where = ", ".join(str(i) for i in np.argwhere(bad)[0])
        raise InputError(f"{name}[{where}]", limit, cure)
