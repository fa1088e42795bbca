"""A drive of a wheeled vehicle along a course: round corners, different speeds, stops at way-points."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.model import Array


@dataclass(frozen=True, kw_only=True)
class Course:
    """A smooth line in the plane: straight pieces, and arcs that touch them.

    Attributes
    ----------
    start_m
        Distance along the line at which each piece begins, [k], metres, rising from zero.
    position_m
        Where each piece begins, [k, 2], metres.
    heading_rad
        Direction there, [k], radians from the x axis to the left, not wrapped.
    curvature_per_m
        Turn per metre of each piece, [k], rad/m, positive to the left.
    length_m
        Length of the line.
    """

    start_m: Array
    position_m: Array
    heading_rad: Array
    curvature_per_m: Array
    length_m: float

    def heading_at(self, distance_m: ArrayLike) -> Array:
        """Return the direction at distances along the line, [...], radians, not wrapped.

        See Atia et al., section 6.3, for the drive along a predefined trajectory.
        """
        piece, beyond = self._pieces(distance_m)
        heading: Array = self.heading_rad[piece] + self.curvature_per_m[piece] * beyond
        return heading

    def position_at(self, distance_m: ArrayLike) -> Array:
        """Return places at distances along the line, [..., 2], metres.

        See Atia et al., Fig. 3, for the trajectory.
        """
        piece, beyond = self._pieces(distance_m)
        # The chord of an arc leads in its middle direction; this holds for a straight piece too.
        half_turn = self.curvature_per_m[piece] * beyond / 2
        chord = beyond * np.sinc(half_turn / np.pi)
        way = self.heading_rad[piece] + half_turn
        position: Array = self.position_m[piece] + chord[..., None] * np.stack(
            [np.cos(way), np.sin(way)], axis=-1
        )
        return position

    def _pieces(self, distance_m: ArrayLike) -> tuple[NDArray[np.int64], Array]:
        """Return the piece of each distance, and how far beyond its beginning; ends are kept to."""
        distance = np.clip(np.asarray(distance_m, dtype=np.float64), 0.0, self.length_m)
        piece = np.searchsorted(self.start_m, distance, side="right") - 1
        return piece, distance - self.start_m[piece]


def rounded_course(vertex_m: ArrayLike, *, corner_radius_m: float) -> Course:
    """Return the line along a chain of straight pieces whose corners are arcs.

    See Atia et al., Fig. 3, for a trajectory along corridors.

    Parameters
    ----------
    vertex_m
        Corners of the chain, [v, 2], metres, its ends included.
    corner_radius_m
        Radius of the arcs.

    Raises
    ------
    InputError
        If neighbours coincide, the chain turns straight back, or there is no room for an arc.
    """
    vertex = np.asarray(vertex_m, dtype=np.float64)
    if vertex.ndim != 2 or vertex.shape[1] != 2 or len(vertex) < 2 or not np.isfinite(vertex).all():
        raise InputError("vertex_m", "they are not two or more places", "Give rows of x, y")
    if not (np.isfinite(corner_radius_m) and corner_radius_m > 0):
        raise InputError("corner_radius_m", f"{corner_radius_m} is not positive", "Give a radius in metres")
    along = np.diff(vertex, axis=0)
    length = np.hypot(*along.T)
    if not length.all():
        raise InputError("vertex_m", "two places in a row are the same", "Leave one out")
    direction = np.arctan2(along[:, 1], along[:, 0])
    turn = np.angle(np.exp(1j * np.diff(direction)))
    if (np.abs(turn) > np.pi - 1e-6).any():
        raise InputError("vertex_m", "the chain turns straight back", "Give corners that an arc can round")
    # What an arc takes off the straight pieces on both sides of its corner.
    cut = corner_radius_m * np.tan(np.abs(turn) / 2)
    straight = length - np.append(cut, 0.0) - np.insert(cut, 0, 0.0)
    if (straight < 0).any():
        raise InputError(
            "corner_radius_m",
            f"an arc of {corner_radius_m} m does not fit a piece of {length[np.argmin(straight)]:.2f} m",
            "Give a smaller radius or longer pieces",
        )
    arc = corner_radius_m * np.abs(turn)
    pieces = np.empty(2 * len(length) - 1)
    pieces[0::2], pieces[1::2] = straight, arc
    unit = along / length[:, None]
    position = np.empty((len(pieces), 2))
    position[0] = vertex[0]
    position[2::2], position[1::2] = (
        vertex[1:-1] + cut[:, None] * unit[1:],
        vertex[1:-1] - cut[:, None] * unit[:-1],
    )
    heading = direction[0] + np.insert(np.cumsum(turn), 0, 0.0)
    curvature = np.zeros(len(pieces))
    curvature[1::2] = np.sign(turn) / corner_radius_m
    ends = np.cumsum(pieces)
    # A corner that does not turn, and a straight piece that the arcs use up, have no length and go.
    kept = pieces > 0
    return Course(
        start_m=np.insert(ends[:-1], 0, 0.0)[kept],
        position_m=position[kept],
        heading_rad=np.repeat(heading, 2)[:-1][kept],
        curvature_per_m=curvature[kept],
        length_m=float(ends[-1]),
    )


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """When a vehicle is how far: knots between which the acceleration is constant.

    Attributes
    ----------
    time_s, distance_m, speed_m_per_s
        Knots, [..., k], not falling in time.
    passage_s
        When each way-point is passed, [..., p], seconds: the middle of a stop.
    departure_s
        When each way-point is left, [..., p], seconds.
    """

    time_s: Array
    distance_m: Array
    speed_m_per_s: Array
    passage_s: Array
    departure_s: Array

    @property
    def end_s(self) -> Array:
        """End of the last rest, [...], seconds."""
        return self.time_s[..., -1]

    def at(self, index: int) -> Self:
        """Take one drive out of a stack."""
        return type(self)(**{name: values[index] for name, values in vars(self).items()})

    def distance_at(self, time_s: ArrayLike) -> Array:
        """Return the distance driven at times, [..., m], metres; both ends are kept to.

        See Atia et al., section 6.3: the trajectory was followed with different speeds.

        Parameters
        ----------
        time_s
            Times, [..., m], seconds; NaN gives NaN.
        """
        leading, knots = self.time_s.shape[:-1], self.time_s.shape[-1]
        time = np.asarray(time_s, dtype=np.float64)
        time = np.broadcast_to(time, (*leading, time.shape[-1]))
        # Row by row, since the search is for one sorted row; NaN sorts behind all.
        knot = np.stack(
            [
                np.searchsorted(row, at, side="right")
                for row, at in zip(
                    self.time_s.reshape(-1, knots), time.reshape(-1, time.shape[-1]), strict=True
                )
            ]
        ).reshape(time.shape)
        knot = np.clip(knot - 1, 0, knots - 1)
        lasts = np.diff(self.time_s, axis=-1, append=np.inf)
        gains = np.diff(self.speed_m_per_s, axis=-1, append=self.speed_m_per_s[..., -1:])
        acceleration = np.divide(gains, lasts, out=np.zeros_like(gains), where=lasts > 0)
        since, start, speed, rising = (
            np.take_along_axis(values, knot, axis=-1)
            for values in (self.time_s, self.distance_m, self.speed_m_per_s, acceleration)
        )
        since = np.maximum(time - since, 0.0)
        distance: Array = start + since * (speed + rising * since / 2)
        return distance


def schedule(
    waypoint_m: ArrayLike, cruise_m_per_s: ArrayLike, rest_s: ArrayLike, *, acceleration_m_per_s2: float
) -> Schedule:
    """Plan a drive from way-point to way-point: a speed for each leg, a rest at some way-points.

    See Atia et al., section 6.3. A way-point without a rest is passed at the lower speed of its two legs.

    Parameters
    ----------
    waypoint_m
        Distance of each way-point along the course, [..., p], metres, rising.
    cruise_m_per_s
        Speed of each leg, [..., p - 1].
    rest_s
        Rest at each way-point, [..., p], seconds; 0 for none. At both ends the vehicle stands anyway.
    acceleration_m_per_s2
        Acceleration and deceleration.

    Raises
    ------
    InputError
        For speeds or an acceleration that are not positive, negative rests, or a leg too short to reach
        its speed.
    """
    waypoint, cruise, rest = (
        np.asarray(values, dtype=np.float64) for values in (waypoint_m, cruise_m_per_s, rest_s)
    )
    leg = np.diff(waypoint, axis=-1)
    if not ((cruise > 0).all() and (rest >= 0).all() and acceleration_m_per_s2 > 0):
        raise InputError(
            "cruise_m_per_s, rest_s, acceleration_m_per_s2",
            "a speed or the acceleration is not positive, or a rest is negative",
            "Give positive speeds and acceleration, and rests of zero or more",
        )
    passing = np.zeros(waypoint.shape)
    passing[..., 1:-1] = np.where(rest[..., 1:-1] > 0, 0.0, np.minimum(cruise[..., :-1], cruise[..., 1:]))
    before, after = passing[..., :-1], passing[..., 1:]
    rises_m = (cruise**2 - before**2) / (2 * acceleration_m_per_s2)
    falls_m = (cruise**2 - after**2) / (2 * acceleration_m_per_s2)
    even_m = leg - rises_m - falls_m
    # A leg just long enough may come out shorter: way-points are rounded.
    rounded_m = 4 * np.finfo(np.float64).eps * np.abs(waypoint).max(axis=-1, keepdims=True)
    if not (even_m >= -rounded_m).all():
        raise InputError(
            "acceleration_m_per_s2",
            f"{acceleration_m_per_s2} m/s2 does not reach the speed of a leg within its length",
            "Give a higher acceleration, lower speeds or longer legs",
        )
    even_m = np.maximum(even_m, 0.0)
    # Four knots for each leg: it begins, has its speed, brakes, ends; before it the vehicle may have rested.
    lasts = np.stack(
        [
            rest[..., :-1],
            (cruise - before) / acceleration_m_per_s2,
            even_m / cruise,
            (cruise - after) / acceleration_m_per_s2,
        ],
        axis=-1,
    )
    goes = np.stack([np.zeros_like(leg), rises_m, even_m, falls_m], axis=-1)
    speed = np.stack([before, before, cruise, cruise], axis=-1)

    def knots(values: Array, last: Array) -> Array:
        return np.concatenate([values.reshape(*values.shape[:-2], -1), last], axis=-1)

    time = np.zeros((*leg.shape[:-1], 4 * leg.shape[-1] + 2))
    time[..., 1:] = np.cumsum(knots(lasts, rest[..., -1:]), axis=-1)
    begins = knots(waypoint[..., :-1, None] + np.cumsum(goes, axis=-1) - goes, waypoint[..., -1:])
    arrival, departure = time[..., 0::4], time[..., 1::4]
    return Schedule(
        time_s=time,
        distance_m=np.concatenate([begins, waypoint[..., -1:]], axis=-1),
        speed_m_per_s=knots(speed, np.zeros((*leg.shape[:-1], 2))),
        passage_s=(arrival + departure) / 2,
        departure_s=departure,
    )
