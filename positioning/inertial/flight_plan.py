"""The plan of a flight: inertial readings made ready, and which reading of which sensor counts at which step.

See Mirzababaei & Akbari, section 3, eqs. 32 to 35, for readings with a clock of their own: they are compared
with the navigation of their time, interpolated between its states, and count at the end of the covariance's
step that the last of these states falls into.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.gps import lagrange_weights, usable_gps
from positioning.model import Array, Recording

SIGHTINGS_TOGETHER = 6
"""Most sightings of a flight that are taken in at a time."""
# Landmarks are given room for in blocks of so many.
_LANDMARKS_A_BLOCK = 8

Whole = NDArray[np.intp]


class FlightReadings(NamedTuple):
    """Inertial readings made ready, worlds last: [i, ...]; those after the end last 0 s.

    There are as many as whole steps of the covariance need.
    """

    force_m_per_s2: Array
    rate_rad_per_s: Array
    duration_s: Array
    # Of the states, [i + 1, w]: the start, and the end of each reading.
    state_time_s: Array
    # Number of readings, [w].
    length: Whole


class Event(NamedTuple):
    """What happens at the same step in some worlds: one reading each of a sensor, or one epoch each."""

    kind: str
    world: Whole
    item: Whole
    # Numbers of the states about the time, [m, k], with their weights, and the time itself.
    state: Whole
    weight: Array
    time_s: Array


def readings_a_step(imu_time_s: Array, covariance_hz: float) -> Whole:
    """Return how many readings a step of the covariance comprises, [w], by the median interval of each."""
    step_s = np.nanmedian(np.diff(imu_time_s, axis=1), axis=1)
    return np.asarray(np.maximum(1, np.rint(1.0 / (covariance_hz * step_s))), dtype=np.intp)


def interpolation_window(settings: FlightFilter) -> int:
    """Return the number of states that an interpolation at the time of GPS takes."""
    return 2 + (2 * settings.interpolation_order if settings.interpolation == "lagrange" else 0)


def landmark_counts(recording: Recording) -> tuple[int, int]:
    """Return the number of landmarks, and of those that the state has room for.

    Always some more than there are, in whole blocks of the products of matrices: the rounding of a flight
    then does not hang on the landmarks that others of its stack see.
    """
    most = int(np.max(np.asarray(recording.sighting_landmark), initial=-1)) + 1
    return most, 0 if most == 0 else _LANDMARKS_A_BLOCK * (most // _LANDMARKS_A_BLOCK + 1)


def prepared(recording: Recording, stride: int) -> FlightReadings:
    """Return the inertial readings of a stack, filled up to whole steps of `stride` readings."""
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    there = np.isfinite(time_s)
    length = np.count_nonzero(there, axis=1)
    start = 2 * time_s[:, 0] - time_s[:, 1]
    ends = time_s[np.arange(len(time_s)), length - 1]
    more = -time_s.shape[1] % stride
    there = np.pad(there, ((0, 0), (0, more)))
    times_s = np.where(there, np.pad(time_s, ((0, 0), (0, more))), ends[:, None])
    states_s = np.concatenate([start[:, None], times_s], axis=1).T

    def parts(values: Array | None) -> Array:
        whole = np.pad(np.asarray(values, dtype=np.float64), ((0, 0), (0, more), (0, 0)))
        return np.ascontiguousarray(np.moveaxis(np.where(there[..., None], whole, 0.0), 0, -1))

    return FlightReadings(
        parts(recording.specific_force_m_per_s2),
        parts(recording.angular_rate_rad_per_s),
        np.ascontiguousarray(np.diff(states_s, axis=0)),
        np.ascontiguousarray(states_s),
        np.asarray(length, dtype=np.intp),
    )


def plan_of(
    recording: Recording, settings: FlightFilter, readings: FlightReadings, stride: int
) -> dict[int, list[Event]]:
    """Return what happens at the end of each step of the covariance, sensors before epochs.

    See Mirzababaei & Akbari, eqs. 32 to 35.

    Parameters
    ----------
    recording
        Stack that `flight_checks.check_flight` has seen.
    settings
        Which sensors count, and how many states an interpolation takes.
    readings
        Of `prepared`, with the times of the states.
    stride
        Readings a step.

    Returns
    -------
    dict
        By the number of the step, -1 for epochs at the start; steps without an event are left out.
    """
    plan: dict[int, list[Event]] = {}
    if settings.gps:
        gps_s, use = np.asarray(recording.gps_time_s, np.float64), usable_gps(recording, settings.outage_s)
        _add(plan, "gps", gps_s, use, interpolation_window(settings), recording, readings, stride)
    time_s = np.asarray(recording.time_s, dtype=np.float64)
    if settings.fixes:
        fix = np.asarray(recording.fix_m, dtype=np.float64)[:, :, 0]
        use = np.isfinite(time_s) & np.isfinite(fix).all(axis=-1)
        _add(plan, "fix", time_s, use, 2, recording, readings, stride)
    if settings.slam:
        seen_s = np.asarray(recording.sighting_time_s, dtype=np.float64)
        use = np.isfinite(seen_s) & (np.asarray(recording.sighting_landmark) >= 0)
        use &= np.isfinite(np.asarray(recording.sighting)).all(axis=-1)
        _add(plan, "sighting", seen_s, use, 2, recording, readings, stride)
    _add(plan, "epoch", time_s, np.isfinite(time_s), 2, recording, readings, stride)
    return plan


def _add(
    plan: dict[int, list[Event]],
    kind: str,
    time_s: Array,
    use: NDArray[np.bool_],
    width: int,
    recording: Recording,
    readings: FlightReadings,
    stride: int,
) -> None:
    """Add what counts at times [w, m] of a sensor, or of the epochs, with `width` states about each."""
    world, index = np.nonzero(use)
    if not len(world):
        return
    times = time_s[world, index]
    bracket = np.empty(len(world), dtype=np.intp)
    states_s = readings.state_time_s
    lengths = readings.length
    for one in range(len(lengths)):
        own = world == one
        ordered = states_s[: lengths[one] + 1, one]
        # Times equal to that of a state up to rounding belong to its step.
        bracket[own] = np.searchsorted(ordered, times[own] - 1e-9, side="left")
    ends = lengths[world]
    late = times > states_s[ends, world] + 1e-9
    if kind == "epoch":
        times = np.minimum(times, states_s[ends, world])
    elif late.any():
        world, index, times = world[~late], index[~late], times[~late]
        bracket, ends = bracket[~late], ends[~late]
        if not len(world):
            return
    before = (kind == "epoch") & (bracket == 0)
    bracket = np.clip(bracket, 1, ends)
    # At the ends of the recording the window moves inwards.
    begin = np.clip(bracket - width // 2, 0, ends + 1 - width)
    state = begin[:, None] + np.arange(width)
    weight = lagrange_weights(states_s[state, world[:, None]], times)
    if kind == "epoch":
        weight[before] = np.eye(width)[0]
    step = (begin + width - 2) // stride
    step[before] = -1
    turn = _turns(recording, kind, step, world, index)
    order = np.lexsort((index, world, turn, step))
    step, turn = step[order], turn[order]
    cuts = np.flatnonzero((np.diff(step) != 0) | (np.diff(turn) != 0)) + 1
    parts = (np.split(part[order], cuts) for part in (world, index, state, weight, times))
    for number, *group in zip(step[np.append(0, cuts)], *parts, strict=True):
        plan.setdefault(int(number), []).append(Event(kind, *group))


def _turns(recording: Recording, kind: str, step: Whole, world: Whole, index: Whole) -> Whole:
    """Return which readings of a step are taken in together, by increasing numbers.

    One each a world, but of sightings as many as `SIGHTINGS_TOGETHER`, each of another landmark: the first
    of a landmark may make it part of the state.
    """
    if kind != "sighting":
        return rank_within(index, step, world)
    assert recording.sighting_landmark is not None
    number = np.asarray(recording.sighting_landmark, dtype=np.intp)[world, index]
    again = rank_within(index, step, world, number)
    part = rank_within(index, step, world, again) // SIGHTINGS_TOGETHER
    return np.asarray(again * (part.max() + 1) + part, dtype=np.intp)


def rank_within(index: Whole, *keys: Whole) -> Whole:
    """Return how many with the same keys have a smaller index, [m]."""
    order = np.lexsort((index, *keys[::-1]))
    position = np.arange(len(order))
    fresh = np.zeros(len(order), dtype=np.bool_)
    fresh[:1] = True
    for key in keys:
        fresh[1:] |= np.diff(key[order]) != 0
    rank = np.empty_like(position)
    rank[order] = position - np.maximum.accumulate(np.where(fresh, position, 0))
    return rank
