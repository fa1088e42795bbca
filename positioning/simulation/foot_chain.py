"""Dead reckoning the long way: a walk moves a foot, the foot an inertial unit, and a filter finds the track.

See Gu et al., section III.A, for the foot-mounted module; nothing of it is printed. Parts are those of the
study foot_wlan, without a magnetometer.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from positioning.inertial.foot import foot_navigation
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.rest import spans
from positioning.inertial.strapdown import readings
from positioning.model import Array, Recording, Site
from positioning.simulation import gait as gaits
from positioning.simulation.dead_reckoning import Reckoned, own_frame
from positioning.simulation.gait import Gait, GaitDraws, draw_gait, foot_motion, stances
from positioning.simulation.imu import Triad, draw_triad, read_triad
from positioning.simulation.pedestrian import Walk

# After its end a walk is at rest; the foot, too.
_LAST_REST_S = 5.0


class Foot(NamedTuple):
    """What is on the foot.

    Attributes
    ----------
    gait
        How the foot moves.
    force, rate
        Errors of accelerometers, m/s2, and gyroscopes, rad/s.
    rate_hz
        Readings a second.
    filter
        Settings of the inertial filter.
    """

    gait: Gait
    force: Triad
    rate: Triad
    rate_hz: float
    filter: FootFilter


def stepped(walk: Walk, foot: Foot, rng: np.random.Generator) -> tuple[gaits.Walk, GaitDraws]:
    """Return when and where the foot stands so that the body is on a given walk.

    See Gu et al., section III.A: the module updates with each step. Between two stops are as many equal
    strides as come nearest to the usual duration; the body passes a stance in its middle.

    Parameters
    ----------
    walk
        Of the body.
    foot
        Has the gait.
    rng
        Source of the draws.
    """
    share = float(np.mean(foot.gait.stance_share))
    left_s, rest_s = walk.schedule.departure_s, walk.rest_s
    begins, ends, resting = [0.0], [], [True]
    for leave_s, arrive_s in zip(left_s[:-1], left_s[1:] - rest_s[1:], strict=True):
        swings = max(round((arrive_s - leave_s) / foot.gait.stride_s), 1)
        period_s = (arrive_s - leave_s) / (swings - share)
        lift_s = leave_s + period_s * np.arange(swings)
        ends += lift_s.tolist()
        begins += (lift_s + (1 - share) * period_s).tolist()
        resting += [False] * (swings - 1) + [True]
    ends.append(max(float(left_s[-1]), begins[-1] + _LAST_REST_S))
    stance_s = np.stack([begins, ends], axis=-1)
    middle_s = stance_s.mean(axis=-1)
    # A draw for each stance, and some that nobody needs.
    draws = draw_gait(rng, foot.gait, length_m=1.5 * foot.gait.stride_m * len(begins), pauses=0)
    most = draws.length.shape[-1]
    missing = most - len(begins)
    filled = np.pad(stance_s, ((0, missing), (0, 0)), constant_values=np.nan)
    distance = np.pad(walk.schedule.distance_at(middle_s), (0, missing), constant_values=np.nan)
    steps = gaits.Walk(
        stance_time_s=filled,
        distance_m=distance,
        body_time_s=np.where(np.pad(resting, (0, missing))[:, None], filled, filled.mean(axis=-1)[:, None]),
        resting=np.pad(resting, (0, missing)),
    )
    return steps, draws


def reckon_by_foot(
    walks: Sequence[Walk],
    time_s: Array,
    start_heading_rad: Array,
    foot: Foot,
    rngs: Sequence[np.random.Generator],
) -> Reckoned:
    """Return what an inertial filter on the foot reports of walks.

    See Gu et al., eq. 2 and section III.A. The track is that of the foot, from stance to stance; the body is
    above it in the middle of a stance, and beside it by half the width of the hips.

    Parameters
    ----------
    walks
        Of the body, which begins with a rest.
    time_s
        Times of the poses, [k, n], seconds; NaN after the end.
    start_heading_rad
        Heading that the dead reckoning begins with, [k], radians.
    foot
        Gait, sensors and filter.
    rngs
        One for each walk.

    Raises
    ------
    InputError
        If the filter cannot use the readings.
    """
    count, period_s = len(walks), 1 / foot.rate_hz
    samples = (np.ceil(np.nanmax(time_s, axis=-1) * foot.rate_hz) + foot.rate_hz).astype(np.int64)
    time = np.full((count, samples.max()), np.nan)
    force, rate = (np.full((count, samples.max(), 3), np.nan) for _ in range(2))
    half_stance_s = np.zeros(count)
    for row, (walk, rng, most) in enumerate(zip(walks, rngs, samples.tolist(), strict=True)):
        steps, draws = stepped(walk, foot, rng)
        half_stance_s[row] = np.nanmedian(np.diff(steps.stance_time_s, axis=-1)) / 2
        standing = stances(steps, walk.course, foot.gait, draws)
        motion = foot_motion(np.arange(most + 1) * period_s, steps, standing, foot.gait, draws)
        ideal = readings(motion.velocity_m_per_s, motion.attitude, period_s)
        time[row, :most] = (np.arange(most) + 1) * period_s
        for into, true, sensors in zip((force, rate), ideal, (foot.force, foot.rate), strict=True):
            noise = draw_triad(rng, most, sample_rate_hz=foot.rate_hz)
            into[row, :most] = read_triad(true, noise, sensors, sample_rate_hz=foot.rate_hz)
    recording = Recording(
        time_s=time_s, imu_time_s=time, specific_force_m_per_s2=force, angular_rate_rad_per_s=rate
    )
    navigation = foot_navigation(recording, Site(corner_m=np.zeros((count, 2, 2))), foot.filter)

    position = np.full((*time_s.shape, 2), np.nan)
    heading = np.full(time_s.shape, np.nan)
    for row, rest in enumerate(spans(navigation.rest)):
        there = np.isfinite(time_s[row])
        first, last = rest[:, 0], rest[:, 1] - 1
        span_s = time[row, last] - time[row, first]
        # The body comes to a stop half an ordinary stance after the foot, and leaves as much before it.
        aside_s = np.minimum(half_stance_s[row], span_s / 2)
        knot_s = np.stack([time[row, first] + aside_s, time[row, last] - aside_s], axis=-1).ravel()
        index = np.stack([first, last], axis=-1).ravel()
        # Sample after sample: from stance to stance a turn back could be to either side.
        going = navigation.heading_rad[row, : last[-1] + 1]
        yaw = np.unwrap(going)[index]
        heading[row, there] = np.interp(time_s[row, there], knot_s, yaw)
        for axis in range(2):
            place = navigation.position_m[row, index, axis]
            position[row, there, axis] = np.interp(time_s[row, there], knot_s, place)
    return own_frame(position, heading, position[:, 0], start_heading_rad - heading[:, 0])
