"""A person who walks through a building and around it: a network of ways, and a walk along a chain of places.

See Gu et al., section IV.A, for the walks that are meant: long ones through rooms, corridors and outdoors.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import shortest_path

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.model import Array
from positioning.simulation.wheeled import Course, Schedule, rounded_course, schedule

# Places closer than this are one.
_SAME_M = 1e-6

# Keeps a speed that is just reached on the safe side of rounding.
_ROUNDING = 1e-9

# The chain of straight pieces turns back where it turns by more; no arc rounds that in the width of a door.
_TURN_BACK_RAD = np.deg2rad(135.0)


class Network(NamedTuple):
    """Ways that meet, and the shortest routes along them.

    Attributes
    ----------
    node_m
        Places on the ways, [v, 2], metres.
    distance_m
        Along the ways, from each to each, [v, v].
    before
        Node before each second node on the route from each first, [v, v].
    """

    node_m: Array
    distance_m: Array
    before: NDArray[np.int32]

    def node(self, place_m: ArrayLike) -> int:
        """Return the node at a place, [2].

        Raises
        ------
        InputError
            If there is none.
        """
        away_m = pairwise_distance_m(np.asarray(place_m)[None], self.node_m)[0]
        if away_m.min() > _SAME_M:
            raise InputError("place_m", f"no node is at {place_m!r}", "Give a place that the network has")
        return int(np.argmin(away_m))

    def route(self, first: int, last: int) -> list[int]:
        """Return the nodes from one to another where the route turns, the ends included."""
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(self.before[first, nodes[-1]]))
        nodes.reverse()
        step = np.diff(self.node_m[nodes], axis=0)
        straight = np.abs(step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0]) < _SAME_M
        return [node for node, dropped in zip(nodes, [False, *straight, False], strict=False) if not dropped]


def network(way_m: ArrayLike, place_m: ArrayLike) -> Network:
    """Join straight ways to a network; they meet where the end of one lies on another.

    See Gu et al., Fig. 6, for what walks along the ways of a floor look like.

    Parameters
    ----------
    way_m
        End points of the ways, [w, 2, 2], metres.
    place_m
        Other places on the ways that are to be nodes, [p, 2], metres.

    Raises
    ------
    InputError
        For a place that is on no way, or ways that do not all hang together.
    """
    way, place = np.asarray(way_m, dtype=np.float64), np.asarray(place_m, dtype=np.float64).reshape(-1, 2)
    every = np.concatenate([way.reshape(-1, 2), place])
    _, first = np.unique(np.rint(every / _SAME_M), axis=0, return_index=True)
    node = every[np.sort(first)]
    along = np.diff(way, axis=1)[:, 0]
    length = np.hypot(*along.T)
    unit = along / length[:, None]
    # For each way and node: how far along, and how far to the side.
    away = node - way[:, :1]
    forth = np.einsum("wni,wi->wn", away, unit)
    side = away[..., 1] * unit[:, :1] - away[..., 0] * unit[:, 1:]
    on = (np.abs(side) < _SAME_M) & (forth > -_SAME_M) & (forth < length[:, None] + _SAME_M)
    if not on.any(axis=0).all():
        lost = node[np.argmin(on.any(axis=0))]
        raise InputError("place_m", f"{lost.tolist()} is on no way", "Give places on the ways")
    direct = np.zeros((len(node), len(node)))
    for held, position in zip(on, forth, strict=True):
        chain = np.flatnonzero(held)[np.argsort(position[held])]
        direct[chain[:-1], chain[1:]] = np.diff(position[chain])
    distance, before = shortest_path(direct, directed=False, return_predecessors=True)
    if not np.isfinite(distance).all():
        raise InputError("way_m", "some ways cannot be reached from others", "Give ways that meet")
    return Network(node, distance, before)


@dataclass(frozen=True, kw_only=True)
class Walk:
    """A walk: where, and when.

    Attributes
    ----------
    course
        The line; where the person turns on the spot its direction jumps.
    schedule
        When the person is how far, with a way-point at every stop and at both ends.
    rest_s
        How long the person stands at these way-points, [p], seconds.
    turn_rad
        Turn on the spot during each of these rests, [p], radians.
    stop
        Number of each of these way-points in the chain of places, [p].
    """

    course: Course
    schedule: Schedule
    rest_s: Array
    turn_rad: Array
    stop: NDArray[np.int64]

    @property
    def end_s(self) -> float:
        """End of the last rest, seconds."""
        return float(self.schedule.end_s)

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Return places, [n, 2], metres, and headings, [n], radians and not wrapped, at times, [n], seconds.

        See Gu et al., section III.A, for the state of a pose. After its end the walk is at rest.
        """
        time = np.asarray(time_s, dtype=np.float64)
        distance = self.schedule.distance_at(time)
        position = self.course.position_at(distance)
        # What has been left by now; the next stop's direction of departure comes only with its rest.
        following = np.searchsorted(self.schedule.departure_s[1:], time, side="right") + 1
        following = np.minimum(following, len(self.stop) - 1)
        stop_m = self._stop_m()[following]
        heading = self.course.heading_at(np.minimum(distance, stop_m - _SAME_M))
        rest = self.rest_s[following]
        arrival = self.schedule.departure_s[following] - rest
        share = np.clip(np.divide(time - arrival, rest, out=np.zeros_like(time), where=rest > 0), 0.0, 1.0)
        return position, heading + self.turn_rad[following] * share**2 * (3 - 2 * share)

    def _stop_m(self) -> Array:
        distance: Array = self.schedule.distance_at(self.schedule.passage_s)
        return distance

    @classmethod
    def along(
        cls,
        place_m: ArrayLike,
        rest_s: ArrayLike,
        cruise_m_per_s: ArrayLike,
        *,
        turn_back_s: float,
        corner_radius_m: float,
        acceleration_m_per_s2: float,
    ) -> Self:
        """Walk along a chain of places, with round corners, and stops at some of them.

        See Gu et al., section IV.A: walks that stop at landmarks. Where the chain turns back, the person
        stops and turns on the spot.

        Parameters
        ----------
        place_m
            The chain, [v, 2], metres.
        rest_s
            How long the person stands at each place, [v], seconds; 0 = walks on.
        cruise_m_per_s
            Speeds, [v]: as many of the first as there are legs between stops are used.
        turn_back_s
            How long turning back takes.
        corner_radius_m
            Radius of the arcs at corners.
        acceleration_m_per_s2
            At both sides of a stop.

        Raises
        ------
        InputError
            For a chain that cannot be walked.
        """
        place, rest = np.asarray(place_m, dtype=np.float64), np.array(rest_s, dtype=np.float64)
        step = np.diff(place, axis=0)
        direction = np.arctan2(step[:, 1], step[:, 0])
        turn = np.abs(np.angle(np.exp(1j * np.diff(direction))))
        rest[1:-1] = np.where((turn > _TURN_BACK_RAD) & (rest[1:-1] == 0), turn_back_s, rest[1:-1])
        stop = np.flatnonzero(np.concatenate([[True], rest[1:-1] > 0, [True]]))
        legs = [
            rounded_course(place[first : last + 1], corner_radius_m=corner_radius_m)
            for first, last in pairwise(stop)
        ]
        end_m = np.cumsum([leg.length_m for leg in legs])
        begin_m = np.insert(end_m[:-1], 0, 0.0)
        arriving = np.array([leg.heading_rad[-1] for leg in legs])
        # A straight last piece ends as it begins, an arc is never the last one.
        leaving = np.array([leg.heading_rad[0] for leg in legs])
        on_spot = np.angle(np.exp(1j * (leaving[1:] - arriving[:-1])))
        ahead = np.insert(np.cumsum(arriving[:-1] + on_spot - leaving[1:]), 0, 0.0)
        course = Course(
            start_m=np.concatenate([leg.start_m + at for leg, at in zip(legs, begin_m, strict=True)]),
            position_m=np.concatenate([leg.position_m for leg in legs]),
            heading_rad=np.concatenate([leg.heading_rad + by for leg, by in zip(legs, ahead, strict=True)]),
            curvature_per_m=np.concatenate([leg.curvature_per_m for leg in legs]),
            length_m=float(end_m[-1]),
        )
        # A leg that is too short for its speed has the highest that it can be begun and ended with.
        reached = np.sqrt(acceleration_m_per_s2 * (end_m - begin_m) * (1 - _ROUNDING))
        cruise = np.asarray(cruise_m_per_s, dtype=np.float64)[: len(legs)]
        plan = schedule(
            np.insert(end_m, 0, 0.0),
            np.minimum(cruise, reached),
            rest[stop],
            acceleration_m_per_s2=acceleration_m_per_s2,
        )
        return cls(
            course=course,
            schedule=plan,
            rest_s=rest[stop],
            turn_rad=np.concatenate([[0.0], on_spot, [0.0]]),
            stop=stop,
        )
