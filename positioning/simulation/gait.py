"""A pedestrian on a course, and the foot that carries the sensors: stances, swings, pauses.

Place, velocity and attitude of the foot are closed forms of time, so that readings can be derived from them
exactly. Arrays of strides have one row a world, filled up with NaN after its last stance: stance k lies
between the swings k - 1 and k, stance 0 is the first rest and the last one the last rest.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from positioning.errors import InputError
from positioning.inertial.strapdown import attitude_of
from positioning.model import Array
from positioning.simulation.wheeled import Course

# Standard normals that scale a stride are cut off here, so that no stride is absurd.
_MOST_DEVIATIONS = 3.0

# Sinusoids of which each part of the wobble is the sum.
_TONES = 3

# Halvings of an interval of time after which a passage is known to the last bits.
_HALVINGS = 60

# A speed of one leg passes to that of the next over three strides.
_BLEND = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True, kw_only=True)
class Gait:
    """How somebody walks, and how the instrumented foot moves.

    See Frank et al., sections 3.1 to 3.3, for the foot and its rest phases; no number of it is printed.

    Attributes
    ----------
    stride_m, stride_s
        Length and duration of a stride, two steps, at the usual speed, their quotient.
    speed_m_per_s
        Lowest and highest speed of a leg. Length and inverse duration go with the root of the speed.
    leg_strides
        Least and most strides that are walked at one speed.
    length_deviation, duration_deviation
        Standard deviations of a single stride, as shares of its length and duration.
    end_share
        Length of the first stride after a rest and of the last one before, as a share of the usual.
    stance_share
        Least and largest share of a stride's duration in which the foot stands.
    side_m, side_deviation_m
        How far right of the body the foot stands, and the standard deviation of a single stance.
    yaw_deviation_rad
        Standard deviation of the direction of the foot about the usual one in a single stance.
    sensor_m
        Place of the sensor from the ball of the foot, forward and up.
    toe_off_rad, heel_strike_rad
        How far the foot points down before it swings, and up before it lands.
    clearance_m, landing_m
        Lift of the ball in the middle of the swing, and that with the toes up before landing.
    swing_out_m
        Standard deviation of the sideways bow of a swing.
    shape_deviation
        Standard deviation of pitch and lift of a single stride, as a share of the usual.
    strike_m, strike_hz
        Amplitude and frequency of the shake of the foot as its heel lands.
    wobble_m, wobble_rad, wobble_hz
        Standard deviations of what a standing foot moves and turns about each axis; least and highest
        frequency.
    rest_wobble_share
        What is left of it in pauses and in the first and last rest.
    """

    stride_m: float
    stride_s: float
    speed_m_per_s: tuple[float, float]
    leg_strides: tuple[int, int]
    length_deviation: float
    duration_deviation: float
    end_share: float
    stance_share: tuple[float, float]
    side_m: float
    side_deviation_m: float
    yaw_deviation_rad: float
    sensor_m: tuple[float, float]
    toe_off_rad: float
    heel_strike_rad: float
    clearance_m: float
    landing_m: float
    swing_out_m: float
    shape_deviation: float
    strike_m: float
    strike_hz: float
    wobble_m: float
    wobble_rad: float
    wobble_hz: tuple[float, float]
    rest_wobble_share: float

    def __post_init__(self) -> None:
        """Refuse a gait that nobody has."""
        positive = ("stride_m", "stride_s", "end_share")
        spans = ("speed_m_per_s", "leg_strides", "stance_share", "wobble_hz")
        for name, value in vars(self).items():
            if not np.isfinite(value).all():
                raise InputError(f"gait, {name}", f"{value} is not finite", "Give finite numbers")
            if name == "sensor_m":
                continue
            if name in positive and not value > 0:
                raise InputError(f"gait, {name}", f"{value} is not above zero", "Give a positive number")
            if name in spans:
                _check_span(name, value)
            elif value < 0:
                raise InputError(f"gait, {name}", f"{value} is negative", "Give zero or more")
        for name, most in (("length_deviation", 0.3), ("duration_deviation", 0.3), ("shape_deviation", 0.3)):
            if getattr(self, name) >= most:
                raise InputError(
                    f"gait, {name}", f"{getattr(self, name)} is not below {most}", "Give a smaller deviation"
                )
        for name in ("end_share", "rest_wobble_share"):
            if getattr(self, name) > 1:
                raise InputError(f"gait, {name}", f"{getattr(self, name)} is above 1", "Give a share")
        if self.stance_share[1] >= 1:
            raise InputError("gait, stance_share", "the foot never swings", "Give shares below 1")
        if self.leg_strides[0] < 1:
            raise InputError("gait, leg_strides", "a leg may have no stride", "Give at least 1")

    def most_strides(self, length_m: float, pauses: int) -> int:
        """Return a number of strides that always suffices for a walk; see Frank et al., section 3.3."""
        usual = self.stride_m / self.stride_s
        shortest_m = self.stride_m * math.sqrt(self.speed_m_per_s[0] / usual)
        shortest_m *= 1 - _MOST_DEVIATIONS * self.length_deviation
        return math.ceil(length_m / shortest_m) + 2 * pauses + 3


class GaitDraws(NamedTuple):
    """The random numbers of a walk: uniform ones from 0 to 1, and standard normals.

    Attributes
    ----------
    leg_strides, leg_speed
        Uniform, [..., leg].
    pause
        Uniform, [..., pause].
    length, duration, side, yaw, swing_out, shape
        Normal, [..., stride].
    share, strike, wobble
        Uniform, [..., stride].
    tone_hz, tone_phase
        Uniform, [..., 6, tone]: of three places and three angles.
    """

    leg_strides: Array
    leg_speed: Array
    pause: Array
    length: Array
    duration: Array
    side: Array
    yaw: Array
    swing_out: Array
    shape: Array
    share: Array
    strike: Array
    wobble: Array
    tone_hz: Array
    tone_phase: Array

    @classmethod
    def stack(cls, draws: Sequence[Self]) -> Self:
        """Put walks side by side: one leading axis."""
        return cls(*(np.stack(parts) for parts in zip(*draws, strict=True)))


def draw_gait(rng: np.random.Generator, gait: Gait, *, length_m: float, pauses: int) -> GaitDraws:
    """Draw what a walk needs; see Frank et al., section 3.3, for its steps.

    Parameters
    ----------
    rng
        Source of the draws; their number depends on the gait's limits alone.
    gait
        How somebody walks.
    length_m
        Length of the walk.
    pauses
        Number of pauses.
    """
    stances = gait.most_strides(length_m, pauses) + 1
    legs = math.ceil(stances / gait.leg_strides[0])
    # The order of the draws is part of the world.
    leg_strides, leg_speed = rng.random((2, legs))
    pause = rng.random(pauses)
    normal = rng.standard_normal((6, stances)).clip(-_MOST_DEVIATIONS, _MOST_DEVIATIONS)
    length, duration, side, yaw, swing_out, shape = normal
    share, strike, wobble = rng.random((3, stances))
    tone_hz, tone_phase = rng.random((2, 6, _TONES))
    return GaitDraws(
        leg_strides=leg_strides,
        leg_speed=leg_speed,
        pause=pause,
        length=length,
        duration=duration,
        side=side,
        yaw=yaw,
        swing_out=swing_out,
        shape=shape,
        share=share,
        strike=strike,
        wobble=wobble,
        tone_hz=tone_hz,
        tone_phase=tone_phase,
    )


@dataclass(frozen=True, kw_only=True)
class Walk:
    """When the foot stands, and how far the body is then.

    Attributes
    ----------
    stance_time_s
        Begin and end of each stance, [..., s, 2], seconds; NaN after the last one.
    distance_m
        Distance along the course of the body as it passes each stance, [..., s], metres.
    body_time_s
        When the body reaches that place and when it leaves, [..., s, 2], seconds: one instant, but for rests.
    resting
        Stances that are rests or pauses, [..., s].
    """

    stance_time_s: Array
    distance_m: Array
    body_time_s: Array
    resting: NDArray[np.bool_]

    @property
    def end_s(self) -> Array:
        """End of the last rest, [...], seconds."""
        return np.asarray(np.nanmax(self.stance_time_s[..., 1], axis=-1))

    def at(self, index: int | slice) -> Self:
        """Take one walk out of a stack, or some."""
        return type(self)(**{name: values[index] for name, values in vars(self).items()})

    def distance_at(self, time_s: ArrayLike) -> Array:
        """Return the distance that the body has walked, [..., n], metres: smooth, never falling.

        See Frank et al., section 5.1, for the walk. Monotone cubic between the stances (Fritsch & Butland,
        1984), so that the speed is continuous and is zero in a pause.

        Parameters
        ----------
        time_s
            Times, [..., n], seconds; both ends are kept to, NaN gives NaN.
        """
        leading = self.distance_m.shape[:-1]
        time = np.asarray(time_s, dtype=np.float64)
        time = np.broadcast_to(time, (*leading, time.shape[-1]))
        rows = zip(self._bodies(), time.reshape(-1, time.shape[-1]), strict=True)
        return np.stack([body(row.clip(body.x[0], body.x[-1])) for body, row in rows]).reshape(time.shape)

    def passage_s(self, distance_m: ArrayLike) -> Array:
        """Return when the body first is at distances along the course, [..., m], seconds.

        See Frank et al., section 5.2: the times at which the reference points were passed.

        Parameters
        ----------
        distance_m
            [..., m], metres.

        Raises
        ------
        InputError
            For a place off the walk.
        """
        leading = self.distance_m.shape[:-1]
        distance = np.asarray(distance_m, dtype=np.float64)
        distance = np.broadcast_to(distance, (*leading, distance.shape[-1]))
        found = []
        for body, row in zip(self._bodies(), distance.reshape(-1, distance.shape[-1]), strict=True):
            before, after = (np.full(row.shape, body.x[end]) for end in (0, -1))
            if not ((row >= body(before)) & (row <= body(after))).all():
                raise InputError("distance_m", "a place is off the walk", "Give places on it")
            for _ in range(_HALVINGS):
                middle = 0.5 * (before + after)
                passed = body(middle) >= row
                before, after = np.where(passed, before, middle), np.where(passed, middle, after)
            found.append(after)
        return np.stack(found).reshape(distance.shape)

    def _bodies(self) -> list[PchipInterpolator]:
        stances = self.distance_m.shape[-1]
        bodies = []
        for when, place in zip(
            self.body_time_s.reshape(-1, 2 * stances), self.distance_m.reshape(-1, stances), strict=True
        ):
            # An ordinary stance has one instant, a rest has two.
            kept = np.isfinite(when) & np.insert(np.diff(when) > 0, 0, True)
            bodies.append(PchipInterpolator(when[kept], np.repeat(place, 2)[kept]))
        return bodies


def walk(
    gait: Gait,
    draws: GaitDraws,
    *,
    length_m: float,
    first_rest_s: ArrayLike,
    last_rest_s: ArrayLike,
    pause_s: ArrayLike,
) -> Walk:
    """Plan a walk of a given length: strides at changing speeds, a rest at both ends, pauses between.

    See Frank et al., section 5.1, for the walk, of which neither speeds nor pauses are reported. One pause
    falls into each of equal parts of the walk. All strides are stretched by one factor near 1 to
    sum up to the length.

    Parameters
    ----------
    gait
        How somebody walks.
    draws
        Random numbers, [..., stride].
    length_m
        Length of the walk along its course.
    first_rest_s, last_rest_s
        [...], seconds.
    pause_s
        What each pause adds to a stance, [..., pause], seconds.

    Raises
    ------
    InputError
        If the walk is too short for the pauses, or a rest is not above zero.
    """
    leading, stances = draws.length.shape[:-1], draws.length.shape[-1]
    pause = np.asarray(pause_s, dtype=np.float64)
    pauses = draws.pause.shape[-1]
    rests = [
        np.broadcast_to(np.asarray(rest, dtype=np.float64), leading) for rest in (first_rest_s, last_rest_s)
    ]
    if not (all((rest > 0).all() for rest in rests) and (pause >= 0).all()):
        raise InputError("first_rest_s, last_rest_s, pause_s", "a rest has no time", "Give positive times")
    usual = gait.stride_m / gait.stride_s
    fewest = 0.9 * length_m / (gait.stride_m * math.sqrt(gait.speed_m_per_s[1] / usual))
    # Parts of a walk with a pause each: the middle eight tenths, so that pauses lie strides apart.
    if fewest < 20 * (pauses + 1):
        raise InputError(
            "length_m",
            f"{length_m} m leave fewer than 20 strides between {pauses} pauses",
            "Walk farther or with fewer pauses",
        )

    relative = _speed(gait, draws) / usual
    stride_m = gait.stride_m * np.sqrt(relative) * (1 + gait.length_deviation * draws.length)
    stride_s = gait.stride_s / np.sqrt(relative) * (1 + gait.duration_deviation * draws.duration)
    part = (np.arange(pauses) + 0.1 + 0.8 * draws.pause) / max(pauses, 1)
    paused = np.floor(5 + part * (fewest - 10)).astype(np.int64)
    index = np.arange(stances)
    added_s = np.sum(np.where(index == paused[..., None], pause[..., None], 0.0), axis=-2)
    resting = (index == paused[..., None]).any(axis=-2)
    resting[..., 0] = True

    # Swing k leads from stance k to the next one; a short one begins at a rest or ends at one.
    short = resting.copy()
    short[..., :-1] |= resting[..., 1:]
    stride_m = np.where(short, gait.end_share * stride_m, stride_m)
    walked_m = np.cumsum(stride_m, axis=-1)
    count = np.sum(walked_m < length_m, axis=-1, keepdims=True) + 1
    final = index == count - 1
    stride_m = np.where(final & ~short, gait.end_share * stride_m, stride_m)
    stride_m = np.where(index < count, stride_m, 0.0)
    stride_m *= length_m / stride_m.sum(axis=-1, keepdims=True)
    distance_m = np.zeros((*leading, stances))
    distance_m[..., 1:] = np.cumsum(stride_m, axis=-1)[..., :-1]
    resting = (resting & (index < count)) | (index == count)

    low, high = gait.stance_share
    share = low + (high - low) * draws.share
    ordinary_s = share * stride_s
    stance_s = ordinary_s + added_s
    stance_s = np.where(index == 0, rests[0][..., None], stance_s)
    stance_s = np.where(index == count, rests[1][..., None], stance_s)
    swing_s = (1 - share) * stride_s
    end_s = np.cumsum(stance_s + swing_s, axis=-1) - swing_s
    time_s = np.stack([end_s - stance_s, end_s], axis=-1)

    # The body is above an ordinary stance at its middle; it stands still in the middle part of a rest.
    half_s = 0.5 * np.minimum(ordinary_s, stance_s)
    reached = np.where(index == 0, time_s[..., 0], time_s[..., 0] + half_s)
    left = np.where(index == count, time_s[..., 1], time_s[..., 1] - half_s)
    left = np.where(resting, left, reached)
    there = index <= count
    return Walk(
        stance_time_s=np.where(there[..., None], time_s, np.nan),
        distance_m=np.where(there, distance_m, np.nan),
        body_time_s=np.where(there[..., None], np.stack([reached, left], axis=-1), np.nan),
        resting=resting,
    )


class Stances(NamedTuple):
    """Where the foot stands.

    Attributes
    ----------
    ball_m
        Place of the ball of the foot, [..., s, 2], metres; NaN fills up.
    yaw_rad
        Direction of the sensor's forward axis, [..., s], radians, not wrapped.
    sensor_m
        Mean place of the sensor, [..., s, 3], metres.
    """

    ball_m: Array
    yaw_rad: Array
    sensor_m: Array


def stances(
    walk: Walk, course: Course, gait: Gait, draws: GaitDraws, *, misalignment_rad: ArrayLike = 0.0
) -> Stances:
    """Return where the foot stands beside its course, and where it points to.

    See Frank et al., eq. 4, for the misalignment.

    Parameters
    ----------
    walk, course, gait, draws
        As for the walk.
    misalignment_rad
        Angle from the walking direction to the forward axis of the sensor, [...], radians.
    """
    way = course.heading_at(np.nan_to_num(walk.distance_m))
    there = np.isfinite(walk.distance_m)
    way = np.where(there, way, np.nan)
    left = np.stack([-np.sin(way), np.cos(way)], axis=-1)
    aside = -gait.side_m + gait.side_deviation_m * draws.side
    ball = course.position_at(np.nan_to_num(walk.distance_m)) + aside[..., None] * left
    yaw = way + np.asarray(misalignment_rad)[..., None] + gait.yaw_deviation_rad * draws.yaw
    forward, up = gait.sensor_m
    pointing = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    height = np.where(there, up, np.nan)[..., None]
    return Stances(ball, yaw, np.concatenate([ball + forward * pointing, height], axis=-1))


class FootMotion(NamedTuple):
    """Motion of the sensor on the foot.

    Attributes
    ----------
    position_m, velocity_m_per_s
        [..., i, 3].
    attitude
        From the frame of the sensor to that of navigation, [..., i, 3, 3].
    """

    position_m: Array
    velocity_m_per_s: Array
    attitude: Array


def foot_motion(
    time_s: ArrayLike,
    walk: Walk,
    stances: Stances,
    gait: Gait,
    draws: GaitDraws,
    *,
    mounting: ArrayLike | None = None,
) -> FootMotion:
    """Return place, velocity and attitude of the sensor on the foot.

    See Frank et al., sections 3.1 and 3.2. In a swing the heel rises about the ball of the foot, the ball
    follows, lands with the toes up, and shakes. Place, velocity, acceleration and turn rate are continuous:
    all that moves a foot begins and ends with vanishing first and second derivatives. A standing foot
    wobbles a little.

    Parameters
    ----------
    time_s
        Rising times, [i], seconds; after the end the foot stands.
    walk, stances, gait, draws
        As planned.
    mounting
        Attitude of the sensor in the frame of the foot, [..., 3, 3]; None for none.
    """
    time = np.asarray(time_s, dtype=np.float64)
    phase = _Phase(time, walk)
    share, share_rate = phase.smooth(_ADVANCE)
    turned, turned_rate = phase.smooth(_TURN)

    amplitude = np.where(walk.resting, gait.rest_wobble_share, 0.5 + draws.wobble)
    size, size_change = phase.between(amplitude)
    size, size_rate = size + size_change * turned, size_change * turned_rate
    deviation = np.repeat([gait.wobble_m, gait.wobble_rad], 3)
    wobble, wobble_rate = [], []
    for part in range(6):
        value, rate = _tones(time, gait, draws.tone_hz[..., part, :], draws.tone_phase[..., part, :])
        wobble.append(deviation[part] * size * value)
        wobble_rate.append(deviation[part] * (size * rate + size_rate * value))

    shape = 1 + gait.shape_deviation * draws.shape
    toe, toe_rate = phase.bump(3, 6)
    heel, heel_rate = phase.bump(14, 4)
    lift, lift_rate = phase.bump(4, 4)
    down = phase.of(gait.toe_off_rad * shape)
    up = phase.of(gait.heel_strike_rad * shape)
    pitch = down * toe - up * heel + wobble[4]
    pitch_rate = down * toe_rate - up * heel_rate + wobble_rate[4]

    yaw, yaw_change = phase.between(stances.yaw_rad)
    heading = yaw + yaw_change * turned + wobble[5]
    heading_rate = yaw_change * turned_rate + wobble_rate[5]
    sine, cosine = np.sin(heading), np.cos(heading)

    # The sensor about the ball of the foot, in the vertical plane along the foot.
    forward, above = gait.sensor_m
    sine_pitch, cosine_pitch = np.sin(pitch), np.cos(pitch)
    ahead = forward * cosine_pitch + above * sine_pitch
    high = above * cosine_pitch - forward * sine_pitch
    ahead_rate, high_rate = high * pitch_rate, -ahead * pitch_rate

    bow = phase.of(gait.swing_out_m * draws.swing_out)
    aside, aside_rate = bow * lift, bow * lift_rate
    clearance = phase.of(gait.clearance_m * shape)
    landing = phase.of(gait.landing_m * shape)
    shake, shake_rate = _shake(phase, gait, draws)
    raised = clearance * lift + landing * heel + shake
    raised_rate = clearance * lift_rate + landing * heel_rate + shake_rate

    position = np.empty((*heading.shape, 3))
    velocity = np.empty_like(position)
    for axis, (along, across) in enumerate(((cosine, -sine), (sine, cosine))):
        ball, stride = phase.between(stances.ball_m[..., axis])
        position[..., axis] = ball + stride * share + ahead * along + aside * across + wobble[axis]
        velocity[..., axis] = stride * share_rate + ahead_rate * along + aside_rate * across
        # A turn by a quarter leads the forward direction to the left, and the left to the back.
        velocity[..., axis] += heading_rate * (ahead * across - aside * along) + wobble_rate[axis]
    position[..., 2] = high + raised + wobble[2]
    velocity[..., 2] = high_rate + raised_rate + wobble_rate[2]
    attitude = attitude_of(wobble[3], pitch, heading)
    if mounting is not None:
        attitude = attitude @ np.asarray(mounting, dtype=np.float64)[..., None, :, :]
    return FootMotion(position, velocity, attitude)


# Coefficients of u, u^2, ...: regularised incomplete beta functions, of (5, 4) and of (4, 4). They
# lead from 0 to 1 with three derivatives or more that vanish at both ends.
_ADVANCE = np.array([0.0, 0.0, 0.0, 0.0, 56.0, -140.0, 120.0, -35.0])
_TURN = np.array([0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])


class _Phase:
    """Which swing each time belongs to, and how much of it is over: 0 before, in the stance."""

    def __init__(self, time_s: Array, walk: Walk) -> None:
        begin, end = walk.stance_time_s[..., 0], walk.stance_time_s[..., 1]
        leading = begin.shape[:-1]
        rows = begin.reshape(-1, begin.shape[-1])
        # NaN sorts behind all times.
        found = np.stack([np.searchsorted(row, time_s, side="right") for row in rows])
        self.stance = np.clip(found - 1, 0, None).reshape(*leading, len(time_s))
        self.next = np.minimum(self.stance + 1, begin.shape[-1] - 1)
        start = self.of(end)
        lasts = np.take_along_axis(begin, self.next, axis=-1) - start
        # After the last stance there is no swing.
        self.duration_s = np.where(lasts > 0, lasts, np.inf)
        self.share = np.clip((time_s - start) / self.duration_s, 0.0, 1.0)
        self.rate = 1 / self.duration_s

    def of(self, values: Array) -> Array:
        """Take for each time the value of its stance, [..., i]."""
        return np.take_along_axis(values, self.stance, axis=-1)

    def between(self, values: Array) -> tuple[Array, Array]:
        """Return for each time the value of its stance, and the change to the next one."""
        here = self.of(values)
        change = np.take_along_axis(values, self.next, axis=-1) - here
        return here, np.where(np.isfinite(self.duration_s), change, 0.0)

    def smooth(self, coefficients: Array) -> tuple[Array, Array]:
        """Return a polynomial of the phase, and its derivative by time."""
        value, slope = np.zeros_like(self.share), np.zeros_like(self.share)
        for coefficient in coefficients[::-1]:
            slope = slope * self.share + value
            value = value * self.share + coefficient
        # The loop leaves out the last factor, for the coefficient of u to the power 0 is zero.
        return value * self.share, (slope * self.share + value) * self.rate

    def bump(self, rising: int, falling: int) -> tuple[Array, Array]:
        """Return u^rising (1 - u)^falling over its largest value, and its derivative by time."""
        top = rising / (rising + falling)
        scale = 1 / (top**rising * (1 - top) ** falling)
        left = 1 - self.share
        lower = scale * self.share ** (rising - 1) * left ** (falling - 1)
        slope = lower * (rising * left - falling * self.share)
        return lower * self.share * left, slope * self.rate


def _shake(phase: _Phase, gait: Gait, draws: GaitDraws) -> tuple[Array, Array]:
    """Return the vertical shake of a landing foot, and its derivative by time."""
    window, window_rate = phase.bump(30, 6)
    turn = 2 * np.pi * gait.strike_hz
    lasts = np.where(np.isfinite(phase.duration_s), phase.duration_s, 0.0)
    angle = turn * lasts * (phase.share - 30 / 36)
    amplitude = phase.of(gait.strike_m * (0.5 + draws.strike))
    value, rate = np.sin(angle), turn * np.cos(angle)
    return amplitude * window * value, amplitude * (window * rate + window_rate * value)


def _tones(time_s: Array, gait: Gait, uniform_hz: Array, uniform_phase: Array) -> tuple[Array, Array]:
    """Return a sum of sinusoids of unit deviation, [..., i], and its derivative by time."""
    low, high = gait.wobble_hz
    value, rate = (np.zeros((*uniform_hz.shape[:-1], len(time_s))) for _ in range(2))
    for tone in range(uniform_hz.shape[-1]):
        turn = 2 * np.pi * (low + (high - low) * uniform_hz[..., tone, None])
        angle = turn * time_s + 2 * np.pi * uniform_phase[..., tone, None]
        value += np.sin(angle)
        rate += turn * np.cos(angle)
    scale = math.sqrt(2 / uniform_hz.shape[-1])
    return scale * value, scale * rate


def _speed(gait: Gait, draws: GaitDraws) -> Array:
    """Return the speed of each stride, [..., stride]: one a leg, with short passages between."""
    least, most = gait.leg_strides
    ends = np.cumsum(least + np.floor((most - least + 1) * draws.leg_strides), axis=-1)
    index = np.arange(draws.length.shape[-1])
    leg = np.sum(index[:, None] >= ends[..., None, :], axis=-1)
    low, high = gait.speed_m_per_s
    speed = low + (high - low) * np.take_along_axis(draws.leg_speed, leg, axis=-1)
    padded = np.concatenate([speed[..., :1], speed, speed[..., -1:]], axis=-1)
    return np.asarray(sum(w * padded[..., k : k + len(index)] for k, w in enumerate(_BLEND)))


def _check_span(name: str, value: tuple[float, float]) -> None:
    if not 0 < value[0] <= value[1]:
        raise InputError(
            f"gait, {name}", f"{value} does not rise from above zero", "Give a positive span, low first"
        )
