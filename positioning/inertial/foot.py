"""Inertial navigation of a foot.

See Frank et al., section 3. A strapdown navigation and an error-state filter beside it, which learns at each
rest of the foot that the velocity is zero. What the paper leaves open (start, variances, the extent of the
magnetometer's use) is a setting of `foot_settings.FootFilter`; `foot_steps` makes steps of the navigation.

With 9 states a bias is nowhere in the error. What the alignment leaves of that of the gyroscope, and how it
wanders later, turns the heading by degrees in minutes, of which the variance of the heading knows nothing: it
is too small by far after a long walk, unless ``heading_noise_rad_per_rt_s`` stands for it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.error_state import ErrorStateFilter, Increments, ProcessNoise, increments
from positioning.inertial.foot_alignment import Alignment, align, magnetic_north_rad, rests
from positioning.inertial.foot_checks import check_clocks, check_force_units, check_imu
from positioning.inertial.foot_plan import (
    Fixes,
    PlannedFixes,
    fixes_by_stop,
    magnetic_updates,
    numbered_stops,
    planned_fixes,
    wanted_stops,
)
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.merged import Merged, merge
from positioning.inertial.rest import Flags
from positioning.inertial.strapdown import attitude_of
from positioning.model import Array, Recording, Site

# Stops of the filter of which readings are prepared at a time, and between two looks at the rounding.
_BLOCK = 512
_TIDY = 256


class Start(NamedTuple):
    """What is known of the start; all of it may be left out.

    Attributes
    ----------
    position_m, covariance_m2
        [r, 2] and [r, 2, 2]; None for (0, 0), known to a millimetre.
    heading_rad, heading_error_rad
        Of the SENSOR, [r] each; None for that of the magnetometer, or zero without one.
    """

    position_m: ArrayLike | None = None
    covariance_m2: ArrayLike | None = None
    heading_rad: ArrayLike | None = None
    heading_error_rad: ArrayLike | None = None


class FootState(NamedTuple):
    """The navigation at some times, each [r, n, ...], as in `FootNavigation`; NaN where there is no time."""

    position_m: Array
    heading_rad: Array
    position_covariance_m2: Array
    heading_variance_rad2: Array


@dataclass(frozen=True, kw_only=True)
class FootNavigation:
    """Where a foot was, at the end of intervals of n readings and after their updates.

    They are all i readings, unless `foot_navigation` leaves some out. Before the alignment ends everything
    stays as at the start; after the end of a recording all is NaN.

    Attributes
    ----------
    time_s
        [r, n].
    position_m
        [r, n, 3].
    heading_rad
        Of the forward axis of the sensor, [r, n], from -pi to pi.
    rest
        Whether the foot rests, [r, n].
    position_covariance_m2
        In the plane, [r, n, 2, 2].
    heading_variance_rad2
        [r, n].
    start
        What the navigation starts from, each [r, ...].
    alignment_end_s
        When the alignment ended, [r]: the last reading of its rest, until which nothing moves.
    """

    time_s: Array
    position_m: Array
    heading_rad: Array
    rest: Flags
    position_covariance_m2: Array
    heading_variance_rad2: Array
    start: FootState
    alignment_end_s: Array

    def at(self, time_s: ArrayLike) -> FootState:
        """Return the state at given times: that of the last reading here until then, or of the start.

        Parameters
        ----------
        time_s
            [r, n], seconds; NaN for none.
        """
        times = np.asarray(time_s, dtype=np.float64)
        index = np.full(times.shape, -1, dtype=np.intp)
        for row, (own, asked) in enumerate(zip(self.time_s, times, strict=True)):
            there = own[~np.isnan(own)]
            # NaN sorts behind all numbers.
            index[row] = np.minimum(np.searchsorted(there, asked, side="right"), len(there)) - 1

        def take(values: Array, start: Array) -> Array:
            extra = (1,) * (values.ndim - 2)
            picked = values[np.arange(len(values))[:, None], np.maximum(index, 0)]
            shape = (*index.shape, *extra)
            state = np.where((index < 0).reshape(shape), start[:, None], picked)
            return np.where(np.isnan(times).reshape(shape), np.nan, state)

        return FootState(
            take(self.position_m, self.start.position_m),
            take(self.heading_rad, self.start.heading_rad),
            take(self.position_covariance_m2, self.start.position_covariance_m2),
            take(self.heading_variance_rad2, self.start.heading_variance_rad2),
        )


def foot_navigation(
    recording: Recording,
    site: Site,
    settings: FootFilter,
    *,
    rest: ArrayLike | None = None,
    fixes: Fixes | None = None,
    start: Start | None = None,
    every_reading: bool = True,
    readings: int | None = None,
) -> FootNavigation:
    """Navigate the feet of a stack of recordings.

    See Frank et al., sections 3.1 and 3.2. Until the end of the first rest that is long enough, nothing
    moves: it gives roll and pitch, the bias of the gyroscope, gravity, and the heading from the magnetometer.
    A fix counts after the last reading until its epoch.

    Parameters
    ----------
    recording
        Stack with inertial readings [r, i].
    site
        Stack; its magnetic north is needed for the magnetometer.
    settings
        Of the filter.
    rest
        When the feet rest, [r, i], in place of the detector.
    fixes
        At the epochs ``recording.time_s`` [r, n], if any.
    start
        Where the feet stand at the start, as far as known.
    every_reading
        Whether the answer is wanted at every reading. Without, it is left out where neither the filter has
        something to take in nor a rest begins or ends nor an epoch asks. With 9 states the readings in
        between are then taken together, in a fraction of the time, for the same answer.
    readings
        Navigate the first so many readings only, at least 1; the answer ends there. None for all.

    Raises
    ------
    InputError
        For settings or readings that cannot be used, epochs at other times than the readings, no rest that is
        long enough, readings in units of gravity, or fixes that do not fit.
    """
    settings.check()
    length = check_imu(recording)
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    check_clocks(recording, length)
    check_force_units(recording, length)
    flags = rests(recording, settings) if rest is None else np.asarray(rest, dtype=np.bool_)
    if flags.shape != time_s.shape:
        raise InputError("rest", f"its shape is {flags.shape}, not {time_s.shape}", "Give one a reading")
    flags = flags & ~np.isnan(time_s)
    north_rad = magnetic_north_rad(recording, site, settings)
    alignment = align(recording, flags, settings, north_rad)
    engine, first = _engine(alignment, settings, start or Start(), len(time_s))
    used, field_ut = magnetic_updates(recording, flags, settings, north_rad, alignment)
    at_rest = flags & (np.arange(time_s.shape[1]) >= alignment.end[:, None]) & settings.zero_velocity
    found = planned_fixes(recording, fixes, time_s)
    stops = wanted_stops(
        recording,
        flags,
        at_rest,
        used,
        found,
        length,
        every_reading=every_reading or settings.states != 9,
        readings=readings,
    )
    return _run(
        recording, engine, first, alignment, settings, flags, at_rest, used, field_ut, north_rad, found, stops
    )


def _engine(
    alignment: Alignment, settings: FootFilter, start: Start, count: int
) -> tuple[ErrorStateFilter, FootState]:
    """Return the filter at the start, and what is asked of it there."""

    def given(value: ArrayLike | None, other: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
        array = np.asarray(other if value is None else value, dtype=np.float64)
        if array.shape != shape or not np.isfinite(array).all():
            raise InputError(
                f"start.{name}", f"it is not finite of shape {shape}: {array.shape}", "Give one a recording"
            )
        return array

    place = given(start.position_m, np.zeros((count, 2)), (count, 2), "position_m")
    spread = given(
        start.covariance_m2, np.tile(1e-6 * np.eye(2), (count, 1, 1)), (count, 2, 2), "covariance_m2"
    )
    heading = given(start.heading_rad, alignment.heading_rad, (count,), "heading_rad")
    error = given(start.heading_error_rad, alignment.heading_error_rad, (count,), "heading_error_rad")
    covariance = np.zeros((count, settings.states, settings.states))
    covariance[:, :2, :2] = spread
    covariance[:, 2, 2] = 1e-6
    for part, sigma in (
        (slice(3, 6), settings.zero_velocity_noise_m_per_s),
        (slice(6, 8), settings.tilt_error_rad),
        (slice(9, 12), settings.force_bias_m_per_s2),
        (slice(12, 15), alignment.rate_bias_error_rad_per_s),
    ):
        for state in range(settings.states)[part]:
            covariance[:, state, state] = sigma**2
    covariance[:, 8, 8] = error**2
    walks = (settings.force_bias_walk_m_per_s2_per_rt_s, settings.rate_bias_walk_rad_per_s_per_rt_s)
    engine = ErrorStateFilter(
        position_m=np.concatenate([place, np.zeros((count, 1))], axis=-1),
        velocity_m_per_s=np.zeros((count, 3)),
        attitude=attitude_of(alignment.roll_rad, alignment.pitch_rad, heading),
        covariance=covariance,
        noise=ProcessNoise(
            settings.force_noise_m_per_s2_per_rt_hz,
            settings.rate_noise_rad_per_s_per_rt_hz,
            *walks,
            settings.heading_noise_rad_per_rt_s,
        ),
        gravity_m_per_s2=alignment.gravity_m_per_s2,
    )
    wrapped = np.arctan2(np.sin(heading), np.cos(heading))
    position = engine.position_m.T.copy()
    return engine, FootState(position, wrapped, spread.copy(), error**2)


def _run(
    recording: Recording,
    engine: ErrorStateFilter,
    first: FootState,
    alignment: Alignment,
    settings: FootFilter,
    flags: Flags,
    at_rest: Flags,
    magnetic: Flags,
    field_ut: Array | None,
    north_rad: Array | None,
    found: PlannedFixes,
    stops: Flags,
) -> FootNavigation:
    """Run the filter from stop to stop, worlds in lock-step: the n-th stop of each at once.

    Between two stops nothing is measured, and their number differs less between worlds than their times.
    """
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    worlds, samples = time_s.shape
    duration_s = np.diff(time_s, axis=1, prepend=time_s[:, :1])
    # Nothing moves before the end of the alignment.
    duration_s = np.where(np.arange(samples) < alignment.end[:, None], 0.0, duration_s)
    north = np.zeros(worlds) if north_rad is None else np.where(np.isfinite(north_rad), north_rad, 0.0)
    force = np.asarray(recording.specific_force_m_per_s2)
    rate = np.asarray(recording.angular_rate_rad_per_s)
    stop, before = numbered_stops(stops)
    planned = fixes_by_stop(found, stops)
    told = len(stop)
    position_m, heading = np.empty((worlds, told, 3)), np.empty((worlds, told))
    covariance, variance = np.empty((worlds, told, 2, 2)), np.empty((worlds, told))
    kept = np.empty((_BLOCK, 9, worlds))
    forward = engine.attitude[:2, 0]
    corner = engine.covariance.transpose(1, 2, 0)[:2, :2]
    everyone = np.arange(worlds)
    for begin in range(0, len(stop), _BLOCK):
        end = min(begin + _BLOCK, len(stop))
        here = stop[begin:end]
        # A world that has no stop left stays as it is.
        count = stop[begin:end] - before[begin:end]
        lasts_s = np.where(count > 0, duration_s[everyone, here], 0.0)
        made = increments(
            force[everyone, here],
            rate[everyone, here] - alignment.rate_bias_rad_per_s,
            lasts_s,
            biases=settings.states == 15,
        )
        merged = _merged(made, count, before[begin:end], force, rate, duration_s, alignment)
        rests_here = at_rest[everyone, here] & (count > 0)
        uses_here = magnetic[everyone, here] & (count > 0)
        someone, someone_uses = (
            np.logical_or.reduce(flag, axis=1).tolist() for flag in (rests_here, uses_here)
        )
        resting, using = rests_here.astype(np.float64), uses_here.astype(np.float64)
        if field_ut is not None:
            field = np.where(uses_here[..., None], field_ut[everyone, here], 0.0).astype(np.float64)
            seen = np.ascontiguousarray(field.swapaxes(1, 2))
        for step in range(end - begin):
            if step % _TIDY == 0:
                engine.tidy()
            mean = None if made.mean_rotation_s is None else made.mean_rotation_s[step]
            engine.predict(made.turn_and_advance[step], made.duration_s[step], mean, merged.get(step))
            corrected = False
            if someone[step]:
                engine.zero_velocity(resting[step], settings.zero_velocity_noise_m_per_s**2)
                corrected = True
            if someone_uses[step]:
                engine.magnetic_heading(
                    seen[step], north, settings.magnetic_heading_noise_rad**2, using[step]
                )
                corrected = True
            for rows, fix_m, root in planned.get(begin + step, ()):
                _fix(engine, rows, fix_m, root)
                corrected = True
            if corrected:
                engine.correct()
            row = kept[step]
            row[:3] = engine.position_m
            row[3:5] = forward
            row[5:7] = corner[0]
            row[7] = corner[1, 1]
            row[8] = engine.covariance[:, 8, 8]
        done, block = np.moveaxis(kept[: end - begin], -1, 0), slice(begin, end)
        position_m[:, block] = done[..., :3]
        heading[:, block] = np.arctan2(done[..., 4], done[..., 3])
        covariance[:, block, 0, 0], covariance[:, block, 1, 1] = done[..., 5], done[..., 7]
        covariance[:, block, 0, 1] = covariance[:, block, 1, 0] = done[..., 6]
        variance[:, block] = done[..., 8]
    ended = (stop == before).T
    for values in (position_m, heading, covariance, variance):
        values[ended] = np.nan
    return FootNavigation(
        time_s=np.where(ended, np.nan, time_s[everyone[:, None], stop.T]),
        position_m=position_m,
        heading_rad=heading,
        rest=flags[everyone[:, None], stop.T] & ~ended,
        position_covariance_m2=covariance,
        heading_variance_rad2=variance,
        start=first,
        alignment_end_s=time_s[everyone, alignment.end - 1],
    )


def _merged(
    made: Increments,
    count: NDArray[np.intp],
    before: NDArray[np.intp],
    force: Array,
    rate: Array,
    duration_s: Array,
    alignment: Alignment,
) -> dict[int, Merged]:
    """Put the sums of runs of several samples into increments; return by step what more there is to know.

    Parameters
    ----------
    made
        Of the last sample until each stop, [n, w].
    count, before
        Samples until each stop, and the last one before them, [n, w].
    force, rate, duration_s
        Of all samples, [w, i, ...].
    alignment
        Has the bias of the rates.
    """
    place, world = np.nonzero(count > 1)
    if not len(place):
        return {}
    order = np.argsort(-count[place, world], kind="stable")
    place, world = place[order], world[order]
    length = count[place, world]
    # The first sample of each run, then the second of each that has one, and so on.
    inside, run = np.nonzero(np.arange(length[0])[:, None] < length)
    own_world = world[run]
    sample = (before[place, world] + 1)[run] + inside
    sums = merge(
        force[own_world, sample],
        rate[own_world, sample] - alignment.rate_bias_rad_per_s[own_world],
        duration_s[own_world, sample],
        length,
    )
    made.turn_and_advance[place, :, :3, world] = sums.rotation
    made.turn_and_advance[place, :, 3, world] = sums.advance_m_per_s
    made.duration_s[place, world] = sums.duration_s
    by_step = np.argsort(place, kind="stable")
    steps, starts = np.unique(place[by_step], return_index=True)
    return {
        int(step): Merged(world[own], sums.way_m[own].T, sums.moments[own])
        for step, own in zip(steps, np.split(by_step, starts[1:]), strict=True)
    }


def _fix(engine: ErrorStateFilter, rows: NDArray[np.intp], fix_m: Array, root: Array) -> None:
    """Take in the fixes [k, 2] of some worlds, with the roots of their precisions [k, 2, 2]."""
    worlds = engine.position_m.shape[1]
    place, precision, used = np.zeros((2, worlds)), np.zeros((2, 2, worlds)), np.zeros(worlds)
    place[:, rows], precision[:, :, rows], used[rows] = fix_m.T, np.moveaxis(root, 0, -1), 1.0
    engine.position_fix(place, precision, used)
