"""The synthetic worlds of the study graph_slam: a building and its surroundings, five long walks, radio.

See Gu et al., section IV. The paper reports durations, the total length, landmarks and passages; all the rest
is assumed, and every number of it is a setting.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m
from positioning.inertial.foot_settings import FootFilter
from positioning.model import Array, Query, Site, Survey, Truth, Walks, Worlds
from positioning.radio import interpolate, path_loss_dbm, receive
from positioning.simulation.dead_reckoning import FootDraws, FootErrors, dead_reckon, draw_foot
from positioning.simulation.floorplan import (
    random_split,
    rectangle_walls,
    room_row_walls,
    wall_with_openings,
)
from positioning.simulation.foot_chain import Foot, reckon_by_foot
from positioning.simulation.gait import Gait
from positioning.simulation.imu import Triad, gauss_markov
from positioning.simulation.pedestrian import Network, Walk, network
from positioning.simulation.settings import number, numbers, rows, span, whole

MERGE_S = 0.001
"""A visit this close to a scan, or closer, is noted this much after it: times of poses differ."""

# What must lie between a door's middle and the side walls of its room, so that a tour fits on both sides.
_DOOR_SIDE_M = 3
# A tour enters a room this deep before it turns, and keeps this far from walls.
_ENTRY_M = 1.5
_CLEAR_M = 1.0
# Doors of facing rows lie on different multiples of this, so that their ways into the corridor are apart.
_DOOR_GRID_M = 4

# Access points are on the storey of the walks, one above, one below, in turn.
_STOREYS = (0, 1, -1)

# Landmarks keep this far from where ways meet.
_SHORTEST_M = 2.0

# Nodes of the shadowing's grid: a world takes 500 bytes for each, and an access point's square root of it.
_MOST_NODES = 50_000

_CHILDREN = (
    *("building", "routes", "drift", "place", "shadow", "carried", "walk_noise", "survey", "survey_noise"),
    *("query_route", "query_noise", "pair_route", "pair_noise", "start"),
)


class Room(NamedTuple):
    """A room with one door.

    Attributes
    ----------
    left_m, right_m
        Its side walls, metres in x.
    front_m
        Wall with the door, metres in y.
    inward
        1 where the room lies above that wall, -1 below.
    depth_m
        From front to back.
    door_m
        Middle of the door, metres in x.
    node
        Place in the corridor in front of the door, [2], metres.
    """

    left_m: float
    right_m: float
    front_m: float
    inward: int
    depth_m: float
    door_m: float
    node: tuple[float, float]


class Building(NamedTuple):
    """One world's building and the ways through it and around it.

    Attributes
    ----------
    wall_m
        Walls, [w, 2, 2], metres; the first ``outer`` of them are the outer walls.
    outer
        Number of outer walls.
    rooms
        All rooms.
    ways
        Corridors, paths outside, and the ways between them.
    """

    wall_m: Array
    outer: int
    rooms: list[Room]
    ways: Network


class Way(NamedTuple):
    """A chain of places to walk along.

    Attributes
    ----------
    place_m
        [v, 2], metres.
    rest_s
        How long the person stands at each, [v], seconds.
    landmark
        Number of the landmark that is visited at each, [v]; -1 = none.
    """

    place_m: list[tuple[float, float]]
    rest_s: list[float]
    landmark: list[int]


class Radio(NamedTuple):
    """One world's access points.

    Attributes
    ----------
    position_m
        [ap, 2], metres.
    storey
        [ap]; 0 is that of the walks.
    outside
        Whether an access point is in a neighbouring building, [ap].
    shadow_db
        Shadowing at the nodes of a grid that begins at the lower left corner of the site, [x, y, ap], dB.
    """

    position_m: Array
    storey: NDArray[np.int64]
    outside: NDArray[np.bool_]
    shadow_db: Array


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator.

    See Gu et al., sections III and IV. A building has a ring of corridors, rooms on both sides of the two
    long ones, and an entrance at each end; paths lead around it, and further away on one side. Sizes and
    doors of the rooms differ between worlds. Four landmarks are surveyed. Each walk visits them in random
    order, each once before any comes again; before a visit it goes through a room, or around the building,
    where time allows, and after the last visit it goes on until its time is over. At a visit the person
    stands for ``visit_s`` and notes it in the middle of that time.

    A pose is at each scan and each visit. Dead reckoning has the errors of
    `positioning.simulation.dead_reckoning` and begins at (0, 0, psi).

    Access points are indoors on three storeys, every ``outside_every``-th in a neighbouring building. Mean
    strength is log-distance path loss less a loss for walls and ceilings on the straight line, plus
    shadowing that is correlated over space, drawn at the nodes of a grid and bilinear between them (its
    correlation falls exponentially along each axis); the body takes up to ``body_loss_db`` from what comes
    from behind. Each walk carries the phone in its own way. A reading fades, and is in whole dBm.

    Parts have random streams of their own: what is changed in one leaves the others alone, walks and lines
    share building, radio and survey, and fewer access points are the first ones of the same.

    Parameters
    ----------
    settings
        All of: ``scene`` (walks, lines), ``size_m`` [x, y], ``corridor_width_m``, ``room_depth_m``,
        ``room_width_m`` [least, most], ``outer_rooms`` and ``inner_rooms`` (each row), ``door_width_m``,
        ``entrance_width_m``, ``path_m`` (path around, from the walls), ``far_path_m`` (from there),
        ``neighbour_m`` (neighbours, from the paths), ``landmark_m`` [landmark, 2], ``walk_s`` and ``visits``
        (each walk's), ``visit_s``, ``first_rest_s``, ``turn_back_s``, ``speed_m_per_s`` [least, most],
        ``acceleration_m_per_s2``, ``corner_radius_m``, ``sway_m`` [inside, outside], ``outing_share``,
        ``far_share``, ``line_m`` (x and y of both ends), ``line_walks``, ``scan_period_s``, ``query_s``,
        ``pair_s``, ``survey_spacing_m``, ``survey_sparse_m``, ``survey_scans``, ``access_points``,
        ``outside_every``, ``reference_dbm`` (at 1 m), ``path_loss_exponent``, ``wall_loss_db``,
        ``outer_wall_loss_db``, ``storey_m``, ``ceiling_loss_db``, ``shadowing_db``,
        ``shadowing_correlation_m``, ``grid_m``, ``body_loss_db``, ``carry_db``, ``fading_db``,
        ``floor_dbm``, ``dead_reckoning`` (model, imu), ``start_heading_deg``, ``stride_s``, ``stride_m``,
        ``heading_noise_deg``, ``drift_deg_per_s``, ``drift_correlation_s``, ``scale_deviation``,
        ``position_noise_m``. Other keys are left alone.
    rngs
        One generator for each world, fresh; a world depends on its own alone.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2] and ``site.wall_m`` [world, wall, 2, 2]; ``walks.time_s``
        and ``walks.heading_rad`` [world, walk, pose], ``walks.position_m`` [world, walk, pose, 2],
        ``walks.rss_dbm`` [world, walk, pose, ap], all NaN at a visit; ``survey.rss_dbm`` [world, place, ap],
        mean of the scans that hear, ``survey.position_m`` [world, place, 2] and ``survey.sparse`` [world,
        place], bool; ``query.rss_dbm`` [world, scan, ap]; ``pairs.dense_position_m`` [world, scan, 2] and
        ``pairs.dense_rss_dbm`` [world, scan, ap] inside the building, ``pairs.sparse_...`` outside. NaN
        follows the end of a walk.

        Truth ``truth.position_m`` [world, walk, pose, 2], NaN but at visits, ``truth.landmark`` [world, walk,
        pose], ``truth.path_m`` [world, walk, pose, 2] and ``truth.heading_rad`` [world, walk, pose] at all
        poses, ``truth.query_m`` [world, scan, 2]. In the scene of lines, the first place and the last one of
        a walk are its landmarks.

    Raises
    ------
    InputError
        For a setting that is missing or senseless, no generator, or walks whose time does not suffice.
    """
    values = _read(settings)
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    # All ways come before anything that takes long.
    planned = []
    for rng in rngs:
        streams = dict(zip(_CHILDREN, rng.spawn(len(_CHILDREN)), strict=True))
        building = _building(values, streams["building"])
        planned.append((streams, building, _walks(values, building, streams)))
    worlds = [_world(values, *plan) for plan in planned]
    named = {
        part: {name: np.stack([world[part][name] for world in worlds]) for name in worlds[0][part]}
        for part in worlds[0]
    }
    corner = np.repeat(values["corner_m"][None], len(worlds), axis=0)
    site = Site(corner_m=corner, wall_m=np.stack([building.wall_m for _, building, _ in planned]))
    walks, truth = Walks(**named["walks"]), Truth(**named["truth"])
    survey, query = named["survey"], Query(**named["query"])
    return Worlds(
        observed={
            **site.to_arrays(),
            **walks.to_arrays(),
            **Survey(rss_dbm=survey["rss_dbm"], position_m=survey["position_m"]).to_arrays(),
            "survey.sparse": survey["sparse"],
            **query.to_arrays(),
            **{f"pairs.{name}": found for name, found in named["pairs"].items()},
        },
        truth=truth.to_arrays(),
    )


class _Plan(NamedTuple):
    """One world's walks: those that are dead reckoned, that of the test scans, and the two short ones."""

    walks: list[Walk]
    landmark: list[NDArray[np.int64]]
    end_s: list[float]
    query: Walk
    dense: Walk
    sparse: Walk


def _building(values: Mapping[str, Any], rng: np.random.Generator) -> Building:
    """Draw the building."""
    (width, height), corridor, depth = values["size_m"], values["corridor_width_m"], values["room_depth_m"]
    least, most = (int(limit) for limit in values["room_width_m"])
    door_m = values["door_width_m"]
    outline = rectangle_walls([[0.0, 0.0], [width, height]])
    gap = (height - np.array([values["entrance_width_m"], -values["entrance_width_m"]])) / 2
    outer = np.concatenate(
        [outline[[0, 2]], *(wall_with_openings([x, 0.0], [x, height], gap) for x in (0.0, width))]
    )
    south, north, middle = depth, height - depth, height / 2
    # Rows of rooms: front, back, corridor, ends, number of rooms, and which multiples their doors are at.
    sides = {"outer": (0.0, width), "inner": (corridor, width - corridor)}
    table = [
        (south, 0.0, south + corridor / 2, "outer", 0),
        (south + corridor, middle, south + corridor / 2, "inner", _DOOR_GRID_M // 2),
        (north - corridor, middle, north - corridor / 2, "inner", _DOOR_GRID_M // 2),
        (north, height, north - corridor / 2, "outer", 0),
    ]
    walls, rooms = [outer], []
    for front, back, lane, kind, phase in table:
        left, right = sides[kind]
        widths = random_split(
            int(right - left), least=least, most=most, rng=rng, parts=values[f"{kind}_rooms"]
        )
        edge = left + np.concatenate([[0], np.cumsum(widths)]).astype(np.float64)
        low = np.ceil((edge[:-1] + _DOOR_SIDE_M - phase) / _DOOR_GRID_M)
        high = np.floor((edge[1:] - _DOOR_SIDE_M - phase) / _DOOR_GRID_M)
        door = phase + _DOOR_GRID_M * (low + np.floor(rng.random(len(widths)) * (high - low + 1)))
        row = room_row_walls(edge, front_m=front, back_m=back, door_m=door - door_m / 2, door_width_m=door_m)
        if kind == "outer":
            # Partitions at the ends of the building are part of its outline.
            row = np.delete(row, [0, len(edge) - 1], axis=0)
        elif back == middle and front < middle:
            row = np.concatenate([row, [[[left, middle], [right, middle]]]])
        walls.append(row)
        rooms += [
            Room(x0, x1, front, 1 if back > front else -1, abs(back - front), x, (x, lane))
            for (x0, x1), x in zip(pairwise(edge.tolist()), door.tolist(), strict=True)
        ]
    places = np.array([*(room.node for room in rooms), *values["landmark_m"].tolist()])
    return Building(np.concatenate(walls), len(outer), rooms, network(_ways(values), places))


def _ways(values: Mapping[str, Any]) -> Array:
    """Return middle lines of corridors, paths outside and the ways in, [way, 2, 2]."""
    (width, height), half = values["size_m"], values["corridor_width_m"] / 2
    south = values["room_depth_m"] + half
    inside = rectangle_walls([[half, south], [width - half, height - south]])
    away, far = values["path_m"], values["far_path_m"]
    around = rectangle_walls([[-away, -away], [width + away, height + away]])
    outing = rectangle_walls([[width + away, -away], [width + away + far, height + away]])[:3]
    middle = height / 2
    entrances = [[[-away, middle], [half, middle]], [[width - half, middle], [width + away, middle]]]
    return np.concatenate([inside, around, outing, entrances])


class _Stroller:
    """Plans one walk: where the person goes next, and whether the time suffices."""

    def __init__(self, values: Mapping[str, Any], building: Building, rng: np.random.Generator) -> None:
        self.values, self.building, self.rng = values, building, rng
        node = building.rooms[rng.integers(len(building.rooms))].node
        self.node = building.ways.node(node)
        self.way = Way([node], [values["first_rest_s"]], [-1])
        self.length_m, self.stops = 0.0, 0
        height, (inside, outside) = values["size_m"][1], values["sway_m"]
        half = values["corridor_width_m"] / 2
        doors = {room.node for room in building.rooms}
        self.sway = np.zeros_like(building.ways.node_m)
        for node_index, (x, y) in enumerate(building.ways.node_m.tolist()):
            if (x, y) in doors:
                # Straight in front of the door, but not always in the middle of the corridor.
                self.sway[node_index, 1] = inside
            elif 0 < x < values["size_m"][0] and y != height / 2:
                self.sway[node_index] = inside
            elif y != height / 2:
                self.sway[node_index] = outside
        for place in values["landmark_m"]:
            self.sway[building.ways.node(place)] = 0.0
        self.half = half

    def least_s(self, length_m: float, stops: int) -> float:
        """Return a time that suffices for a way, with stops and as many turns on the spot."""
        slowest, fastest = self.values["speed_m_per_s"]
        rest_s = self.values["visit_s"] + self.values["turn_back_s"]
        brakes_s = 2 * fastest / self.values["acceleration_m_per_s2"]
        return float(length_m / slowest + stops * (rest_s + brakes_s))

    @property
    def time_s(self) -> float:
        """A time that suffices for the way so far."""
        return float(self.values["first_rest_s"]) + self.least_s(self.length_m, self.stops)

    def step(self, place: tuple[float, float], rest_s: float = 0.0, landmark: int = -1) -> None:
        """Go straight to a place."""
        self.length_m += float(np.hypot(*np.subtract(place, self.way.place_m[-1])))
        self.way.place_m.append(place)
        self.way.rest_s.append(rest_s)
        self.way.landmark.append(landmark)

    def go(self, node: int) -> None:
        """Go along the ways to a node."""
        for turn in self.building.ways.route(self.node, node)[1:]:
            swayed = self.building.ways.node_m[turn] + self.sway[turn] * self.rng.uniform(-1, 1, 2)
            self.step((float(swayed[0]), float(swayed[1])))
        self.node = node

    def visit(self, landmark: int) -> None:
        """Go to a landmark and stand there."""
        self.go(self.building.ways.node(self.values["landmark_m"][landmark]))
        self.way.rest_s[-1], self.way.landmark[-1] = self.values["visit_s"], landmark
        self.stops += 1

    def excursion(self, then: Sequence[int], end_s: float) -> bool:
        """Go through a room or around the building, where time is left for what comes then; tell whether.

        ``then`` are the nodes to be visited afterwards.
        """
        enter, inner, leave = (
            self._outing() if self.rng.random() < self.values["outing_share"] else self._room()
        )
        ways = self.building.ways
        chain = np.array([ways.node_m[enter], *inner])
        length_m = float(ways.distance_m[self.node, enter] + np.hypot(*np.diff(chain, axis=0).T).sum())
        # Swaying makes a way longer by less than this.
        length_m += 2 * max(self.values["sway_m"]) * len(chain)
        stages = [leave, *then]
        length_m += sum(float(ways.distance_m[first, last]) for first, last in pairwise(stages))
        length_m += 4 * max(self.values["sway_m"]) * len(stages)
        if self.time_s + self.least_s(length_m, len(stages)) > end_s:
            return False
        self.go(enter)
        for place in inner:
            self.step(place)
        self.node = leave
        self.stops += 1
        return True

    def _room(self) -> tuple[int, list[tuple[float, float]], int]:
        """Draw a tour of a room: the node before it, the places, and the node after it."""
        room = self.building.rooms[self.rng.integers(len(self.building.rooms))]
        node = self.building.ways.node(room.node)
        share = self.rng.random(4)
        left, right = room.left_m + _CLEAR_M, room.right_m - _CLEAR_M
        first = left + share[0] * (room.door_m - _ENTRY_M - left)
        last = right - share[1] * (right - room.door_m - _ENTRY_M)
        if share[2] < 0.5:
            first, last = last, first
        near = room.front_m + room.inward * _ENTRY_M
        deepest = room.depth_m - _CLEAR_M
        deep = room.front_m + room.inward * (deepest - share[3] * (deepest - 2 * _ENTRY_M))
        across = self.rng.uniform(-1, 1) * self.values["sway_m"][0]
        door = room.door_m
        loop = [(door, near), (first, near), (first, deep), (last, deep), (last, near), (door, near)]
        return node, [*loop, (door, room.node[1] + across)], node

    def _outing(self) -> tuple[int, list[tuple[float, float]], int]:
        """Draw a way around the building from one entrance to the other, near or far."""
        (width, height), away = self.values["size_m"], self.values["path_m"]
        west, east = (self.half, height / 2), (width - self.half, height / 2)
        upper, far = self.rng.random() < 0.5, self.rng.random() < self.values["far_share"]
        y, other_y = (height + away, -away) if upper else (-away, height + away)
        places = [(-away, height / 2), (-away, y), (width + away, y)]
        if far:
            x = width + away + self.values["far_path_m"]
            places[-1:] = [(x, y), (x, other_y), (width + away, other_y)]
        places.append((width + away, height / 2))
        outside = self.values["sway_m"][1]
        swayed = [
            (x, y)
            if y == height / 2
            else (x + outside * self.rng.uniform(-1, 1), y + outside * self.rng.uniform(-1, 1))
            for x, y in places
        ]
        ways = self.building.ways
        if self.rng.random() < 0.5:
            return ways.node(west), [*swayed, east], ways.node(east)
        return ways.node(east), [*swayed[::-1], west], ways.node(west)


def _route(
    values: Mapping[str, Any], building: Building, rng: np.random.Generator, *, end_s: float, visits: int
) -> Way:
    """Plan one walk that lasts ``end_s`` or longer."""
    person = _Stroller(values, building, rng)
    landmarks = len(values["landmark_m"])
    order: list[int] = []
    while len(order) < visits:
        block = rng.permutation(landmarks).tolist()
        if order and block[0] == order[-1]:
            block[:2] = block[1::-1]
        order += block
    order = order[:visits]
    node = [building.ways.node(values["landmark_m"][landmark]) for landmark in order]
    for index, landmark in enumerate(order):
        person.excursion(node[index:], end_s)
        person.visit(landmark)
    if person.time_s > end_s:
        raise InputError(
            "setting walk_s",
            f"{end_s:g} s may not suffice for {visits} visits: that takes up to {person.time_s:.0f} s",
            "Give more time or fewer visits",
        )
    fastest = values["speed_m_per_s"][1]
    # Round corners are shorter: by less than this share.
    while values["first_rest_s"] + 0.9 * person.length_m / fastest < end_s:
        person.excursion([], np.inf)
    return person.way


def _walk(values: Mapping[str, Any], way: Way, rng: np.random.Generator) -> Walk:
    """Return the walk along a way."""
    slowest, fastest = values["speed_m_per_s"]
    return Walk.along(
        way.place_m,
        way.rest_s,
        slowest + (fastest - slowest) * rng.random(len(way.place_m)),
        turn_back_s=values["turn_back_s"],
        corner_radius_m=values["corner_radius_m"],
        acceleration_m_per_s2=values["acceleration_m_per_s2"],
    )


def _walks(
    values: Mapping[str, Any], building: Building, streams: Mapping[str, np.random.Generator]
) -> _Plan:
    """Plan all walks of a world."""
    if values["scene"] == "lines":
        rest = [values["first_rest_s"], values["visit_s"]]
        way = Way([tuple(place) for place in values["line_m"].tolist()], rest, [0, 1])
        found = [_walk(values, way, rng) for rng in streams["routes"].spawn(values["line_walks"])]
        walks = [(walk, way, walk.end_s) for walk in found]
    else:
        walks = []
        for end_s, visits, rng in zip(
            values["walk_s"], values["visits"], streams["routes"].spawn(len(values["walk_s"])), strict=True
        ):
            way = _route(values, building, rng, end_s=end_s, visits=visits)
            walks.append((_walk(values, way, rng), way, end_s))
    rng = streams["query_route"]
    query = _walk(values, _route(values, building, rng, end_s=values["query_s"], visits=0), rng)
    rng = streams["pair_route"]
    inside = {**values, "outing_share": 0.0}
    dense = _walk(values, _route(inside, building, rng, end_s=values["pair_s"], visits=0), rng)
    # From the entrance over the far path, and back along the building.
    (width, height), away = values["size_m"], values["path_m"]
    x, far_x = width + away, width + away + values["far_path_m"]
    places = [(x, height / 2), (x, -away), (far_x, -away), (far_x, height + away), (-away, height + away)]
    sparse = _walk(values, Way(places, [0.0] * len(places), [-1] * len(places)), rng)
    if sparse.end_s < values["pair_s"]:
        raise InputError(
            "setting pair_s",
            f"the walk outside is over after {sparse.end_s:.0f} s, before {values['pair_s']:g} s",
            "Give a shorter time, or longer paths outside",
        )
    marks = [np.array(way.landmark)[walk.stop] for walk, way, _ in walks]
    return _Plan([walk for walk, _, _ in walks], marks, [end for _, _, end in walks], query, dense, sparse)


def _world(
    values: Mapping[str, Any], streams: dict[str, np.random.Generator], building: Building, plan: _Plan
) -> dict[str, dict[str, NDArray[Any]]]:
    """Return everything of one world that differs between worlds."""
    radio = _radio(values, streams["place"], streams["shadow"])
    poses = _poses(values, plan)
    count = len(plan.walks)

    # One call for all places: walks, test scans and the two short walks one after the other.
    scanned = poses["scanned"]
    query_s = np.arange(values["query_scans"]) * values["scan_period_s"]
    pair_s = np.arange(values["pair_scans"]) * values["scan_period_s"]
    single = [plan.query.at(query_s), plan.dense.at(pair_s), plan.sparse.at(pair_s)]
    place_m = np.concatenate([poses["path_m"][scanned], *(place for place, _ in single)])
    facing = np.concatenate([poses["heading_rad"][scanned], *(heading for _, heading in single)])
    surveyed_m, sparse = _survey_places(values)
    scans = values["survey_scans"]
    surveyor = streams["survey"].uniform(0, 2 * np.pi, len(surveyed_m))
    level_dbm = _level_dbm(values, building, radio, np.concatenate([place_m, surveyed_m]))
    level_dbm -= _body_loss_db(
        values, radio, np.concatenate([place_m, surveyed_m]), np.concatenate([facing, surveyor])
    )
    ends = np.cumsum([scanned.sum(), len(query_s), len(pair_s), len(pair_s)])
    walks_dbm, query_dbm, dense_dbm, sparse_dbm, survey_dbm = np.split(level_dbm, ends)

    # Walks of longer worlds than these have room for the same draws.
    carried = values["carry_db"] * streams["carried"].standard_normal(4 + count)
    walk_of = np.nonzero(scanned)[0]
    scan_of = poses["scan"][scanned]
    noise = _normals(streams["walk_noise"], values, count * values["scans_most"])
    noise = noise.reshape(count, values["scans_most"], -1)[walk_of, scan_of]
    rss_dbm = np.full((*scanned.shape, values["access_points"]), np.nan)
    rss_dbm[scanned] = _hear(values, walks_dbm + carried[4 + walk_of, None], noise)
    every_dbm = _hear(
        values,
        survey_dbm + carried[0],
        _normals(streams["survey_noise"], values, scans * len(surveyed_m)).reshape(scans, *survey_dbm.shape),
    )
    heard = np.isfinite(every_dbm).sum(axis=0)
    mean_dbm = np.divide(
        np.nansum(every_dbm, axis=0), heard, out=np.full(heard.shape, np.nan), where=heard > 0
    )
    pair_noise = _normals(streams["pair_noise"], values, 2 * len(pair_s))
    reckoned = _reckoned(values, streams, plan, poses)
    return {
        "walks": {"time_s": poses["time_s"], **reckoned, "rss_dbm": rss_dbm},
        "survey": {"rss_dbm": mean_dbm, "position_m": surveyed_m, "sparse": sparse},
        "query": {
            "rss_dbm": _hear(
                values, query_dbm + carried[1], _normals(streams["query_noise"], values, len(query_s))
            )
        },
        "pairs": {
            "dense_position_m": single[1][0],
            "dense_rss_dbm": _hear(values, dense_dbm + carried[2], pair_noise[: len(pair_s)]),
            "sparse_position_m": single[2][0],
            "sparse_rss_dbm": _hear(values, sparse_dbm + carried[3], pair_noise[len(pair_s) :]),
        },
        "truth": {
            "position_m": np.where(poses["landmark"][..., None] >= 0, poses["path_m"], np.nan),
            "landmark": poses["landmark"],
            "path_m": poses["path_m"],
            "heading_rad": poses["heading_rad"],
            "query_m": single[0][0],
        },
    }


def _poses(values: Mapping[str, Any], plan: _Plan) -> dict[str, NDArray[Any]]:
    """Return the poses of the walks, [walk, pose, ...], with their scans and landmarks."""
    shape = (len(plan.walks), values["poses_most"])
    found: dict[str, NDArray[Any]] = {
        "time_s": np.full(shape, np.nan),
        "path_m": np.full((*shape, 2), np.nan),
        "heading_rad": np.full(shape, np.nan),
        "scan": np.full(shape, -1),
        "landmark": np.full(shape, -1),
    }
    for index, (walk, mark, end_s) in enumerate(zip(plan.walks, plan.landmark, plan.end_s, strict=True)):
        scan_s = np.arange(int(end_s / values["scan_period_s"] + MERGE_S) + 1) * values["scan_period_s"]
        visit_s, visited = walk.schedule.passage_s[mark >= 0], mark[mark >= 0]
        close = np.abs(visit_s[:, None] - scan_s).min(axis=1, initial=np.inf) < MERGE_S
        visit_s = np.where(close, visit_s + 2 * MERGE_S, visit_s)
        time_s = np.concatenate([scan_s, visit_s])
        order = np.argsort(time_s)
        place_m, heading = walk.at(time_s[order])
        filled = {
            "time_s": time_s[order],
            "path_m": place_m,
            "heading_rad": heading,
            "scan": np.concatenate([np.arange(len(scan_s)), np.full(len(visit_s), -1)])[order],
            "landmark": np.concatenate([np.full(len(scan_s), -1), visited])[order],
        }
        for name, known in filled.items():
            found[name][index, : len(known)] = known
    return {**found, "scanned": found["scan"] >= 0}


def _reckoned(
    values: Mapping[str, Any],
    streams: Mapping[str, np.random.Generator],
    plan: _Plan,
    poses: Mapping[str, NDArray[Any]],
) -> dict[str, Array]:
    """Return the dead reckoning of the poses."""
    count, errors = len(plan.walks), values["errors"]
    start = np.deg2rad(values["start_heading_deg"]) * streams["start"].uniform(-1, 1, count)
    rngs = streams["drift"].spawn(count)
    if values["foot"] is not None:
        position, heading = reckon_by_foot(plan.walks, poses["time_s"], start, values["foot"], rngs)
        return {"position_m": position, "heading_rad": heading}
    stride_s = np.arange(values["strides"] + 1) * errors.stride_s
    knots = np.stack(
        [walk.at(np.minimum(stride_s, end_s))[0] for walk, end_s in zip(plan.walks, plan.end_s, strict=True)]
    )
    draws = [draw_foot(rng, values["strides"]) for rng in rngs]
    position, heading = dead_reckon(
        knots,
        poses["time_s"],
        poses["path_m"],
        poses["heading_rad"],
        start,
        FootDraws(*map(np.stack, zip(*draws, strict=True))),
        errors,
    )
    return {"position_m": position, "heading_rad": heading}


def _survey_places(values: Mapping[str, Any]) -> tuple[Array, NDArray[np.bool_]]:
    """Return the places of the survey, [place, 2], and which of them are in the sparser one."""
    step, size = values["survey_spacing_m"], np.asarray(values["size_m"])
    # Half a metre off the lattice that all walls are on.
    axes = [np.arange(0.5, length, step) for length in size]
    inside = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    ways = _ways(values)
    chains = []
    # Ways inside are covered by the grid.
    for start, end in ways[4:]:
        length = float(np.hypot(*(end - start)))
        along = np.arange(0.0, length, step)[:, None] / length
        chains.append(start + along * (end - start))
    path = np.concatenate(chains)
    # Ways meet at their ends.
    path = np.unique(path, axis=0)
    path = path[((path < 0) | (path > size)).any(axis=1)]
    place = np.concatenate([inside, path])
    away = pairwise_distance_m(place, place)
    sparse = np.zeros(len(place), dtype=bool)
    for index in range(len(place)):
        sparse[index] = not (away[index, sparse] < values["survey_sparse_m"] - 1e-9).any()
    return place, sparse


def _radio(values: Mapping[str, Any], place_rng: np.random.Generator, rng: np.random.Generator) -> Radio:
    """Draw the access points, one after the other: fewer are the first ones."""
    count, nodes = values["access_points"], values["nodes"]
    uniform = place_rng.random((count, 2))
    number_of = np.arange(count)
    outside = number_of % values["outside_every"] == values["outside_every"] - 1
    storey = np.where(outside, 0, np.array(_STOREYS)[(number_of - number_of // values["outside_every"]) % 3])
    lower, upper = values["corner_m"]
    edge = rectangle_walls([lower, upper])
    length = np.hypot(*(edge[:, 1] - edge[:, 0]).T)
    at = uniform[:, 0] * length.sum()
    side = np.searchsorted(np.cumsum(length), at, side="right").clip(max=3)
    share = ((at - (np.cumsum(length) - length)[side]) / length[side])[:, None]
    border = edge[side, 0] + share * (edge[side, 1] - edge[side, 0])
    position = np.where(outside[:, None], border, uniform * values["size_m"])
    # A process along each axis in turn: the correlation is the product of both.
    steps = values["shadowing_correlation_m"] / values["grid_m"]
    shadow = gauss_markov(rng.standard_normal((count, *nodes)), correlation=steps)
    shadow = values["shadowing_db"] * gauss_markov(np.swapaxes(shadow, 1, 2), correlation=steps)
    return Radio(position, storey, outside, np.transpose(shadow, (2, 1, 0)))


def _level_dbm(values: Mapping[str, Any], building: Building, radio: Radio, place_m: Array) -> Array:
    """Return the mean strength at places without the body, [place, ap]."""
    distance_m = np.hypot(
        pairwise_distance_m(place_m, radio.position_m), values["storey_m"] * np.abs(radio.storey)
    )
    level = path_loss_dbm(
        distance_m, reference_dbm=values["reference_dbm"], path_loss_exponent=values["path_loss_exponent"]
    )
    outer, inner = np.split(building.wall_m, [building.outer])
    # A neighbour's own wall counts too.
    crossed = crossings(place_m, radio.position_m, outer) + radio.outside
    level -= values["outer_wall_loss_db"] * crossed + values["ceiling_loss_db"] * np.abs(radio.storey)
    # What comes from another storey passes the ceiling and not the partitions.
    same = radio.storey == 0
    level[:, same] -= values["wall_loss_db"] * crossings(place_m, radio.position_m[same], inner)
    within = place_m - values["corner_m"][0]
    level += interpolate(radio.shadow_db[None], within[None, None], values["grid_m"])[0, 0]
    return level


def crossings(place_m: ArrayLike, other_m: ArrayLike, wall_m: ArrayLike) -> NDArray[np.int64]:
    """Count the walls between places and others where all walls run along an axis, [place, other].

    `positioning.geometry.wall_crossings` decides every touch exactly; the random places here touch
    nothing, and there are ten times as many as it can do in the time of a run.

    Parameters
    ----------
    place_m
        [place, 2], metres.
    other_m
        [other, 2], metres.
    wall_m
        [wall, 2, 2], metres.
    """
    place, other = np.asarray(place_m, dtype=np.float64), np.asarray(other_m, dtype=np.float64)
    count = np.zeros((len(place), len(other)), dtype=np.int64)
    for first, last in np.asarray(wall_m, dtype=np.float64):
        across = int(first[1] == last[1])
        along = 1 - across
        low, high = sorted((first[along], last[along]))
        before, behind = place[:, across] - first[across], other[:, across] - first[across]
        share = before[:, None] / np.where(before[:, None] == behind, np.nan, before[:, None] - behind)
        meets = place[:, None, along] + share * (other[:, along] - place[:, None, along])
        count += ((before[:, None] < 0) != (behind < 0)) & (meets > low) & (meets < high)
    return count


def _body_loss_db(values: Mapping[str, Any], radio: Radio, place_m: Array, heading_rad: Array) -> Array:
    """Return what the body takes, [place, ap]: nothing from ahead, all from behind, half from the sides."""
    x, y = np.moveaxis(radio.position_m - place_m[:, None], -1, 0)
    ahead = np.cos(heading_rad)[:, None] * x + np.sin(heading_rad)[:, None] * y
    loss: Array = values["body_loss_db"] / 2 * (1 - ahead / np.maximum(np.hypot(x, y), 1e-9))
    return loss


def _normals(rng: np.random.Generator, values: Mapping[str, Any], count: int) -> Array:
    """Draw standard normals, [count, ap], access point after access point."""
    return rng.standard_normal((values["access_points"], count)).T


def _hear(values: Mapping[str, Any], level_dbm: Array, fading: Array) -> Array:
    return receive(level_dbm, noise_db=values["fading_db"], floor_dbm=values["floor_dbm"], fading=fading)


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, all checked before any work, with what follows from them."""
    values: dict[str, Any] = {
        "scene": _word(settings, "scene", ("walks", "lines")),
        "dead_reckoning": _word(settings, "dead_reckoning", ("model", "imu")),
        "size_m": numbers(settings, "size_m", 2, least=1, integer=True),
        "room_width_m": numbers(settings, "room_width_m", 2, least=1, integer=True),
        "landmark_m": rows(settings, "landmark_m", 2, least=2),
        "line_m": rows(settings, "line_m", 2, least=2),
        "walk_s": _list(settings, "walk_s"),
        "visits": tuple(int(visits) for visits in _list(settings, "visits", integer=True)),
        "speed_m_per_s": span(settings, "speed_m_per_s", least=0),
        "sway_m": numbers(settings, "sway_m", 2, least=0),
        "reference_dbm": number(settings, "reference_dbm"),
        "floor_dbm": number(settings, "floor_dbm"),
        "start_heading_deg": number(settings, "start_heading_deg", least=0, most=180),
    }
    counts = [
        *("corridor_width_m", "room_depth_m", "outer_rooms", "inner_rooms", "line_walks"),
        *("survey_scans", "access_points", "outside_every"),
    ]
    positive = [
        *("entrance_width_m", "path_m", "far_path_m", "neighbour_m", "door_width_m", "visit_s"),
        *("turn_back_s", "acceleration_m_per_s2", "corner_radius_m", "scan_period_s", "query_s", "pair_s"),
        *("survey_spacing_m", "survey_sparse_m", "shadowing_correlation_m", "grid_m", "stride_s", "stride_m"),
        "drift_correlation_s",
    ]
    not_negative = [
        *("first_rest_s", "path_loss_exponent", "wall_loss_db", "outer_wall_loss_db", "storey_m"),
        *("ceiling_loss_db", "shadowing_db", "body_loss_db", "carry_db", "fading_db", "heading_noise_deg"),
        *("drift_deg_per_s", "scale_deviation", "position_noise_m"),
    ]
    values |= {name: whole(settings, name, least=1) for name in counts}
    values |= {name: number(settings, name, above=0) for name in positive}
    values |= {name: number(settings, name, least=0) for name in not_negative}
    values |= {name: number(settings, name, least=0, most=1) for name in ("outing_share", "far_share")}
    _check_building(values)
    _check_walks(values)

    margin = values["path_m"] + values["neighbour_m"]
    lower = -np.array([margin, margin])
    upper = np.add(values["size_m"], (margin + values["far_path_m"], margin))
    nodes = np.rint((upper - lower) / values["grid_m"]).astype(np.int64) + 1
    _require(
        bool(np.allclose((nodes - 1) * values["grid_m"], upper - lower)) and 4 <= nodes.prod() <= _MOST_NODES,
        "grid_m",
        f"{values['grid_m']} m does not divide the {upper - lower} m of the site into {_MOST_NODES} nodes",
        "Give a divisor of both sides, not too fine",
    )
    slowest = values["speed_m_per_s"][0]
    if values["scene"] == "lines":
        length_m = float(np.hypot(*(values["line_m"][1] - values["line_m"][0])))
        brakes_s = 2 * values["speed_m_per_s"][1] / values["acceleration_m_per_s2"]
        longest_s = values["first_rest_s"] + values["visit_s"] + length_m / slowest + brakes_s
        visits = 2
    else:
        longest_s, visits = max(values["walk_s"]), max(values["visits"])
    period_s = values["scan_period_s"]
    scans_most = int(longest_s / period_s + MERGE_S) + 1
    errors = FootErrors(
        stride_s=values["stride_s"],
        stride_m=values["stride_m"],
        heading_noise_rad=float(np.deg2rad(values["heading_noise_deg"])),
        drift_rad_per_s=float(np.deg2rad(values["drift_deg_per_s"])),
        drift_correlation_s=values["drift_correlation_s"],
        scale_deviation=values["scale_deviation"],
        position_noise_m=values["position_noise_m"],
    )
    return {
        **values,
        "corner_m": np.stack([lower, upper]),
        "nodes": tuple(nodes.tolist()),
        "errors": errors,
        "foot": _foot(settings) if values["dead_reckoning"] == "imu" else None,
        "scans_most": scans_most,
        "poses_most": scans_most + visits,
        "strides": int(np.ceil(longest_s / errors.stride_s)) + 1,
        "query_scans": int(values["query_s"] / period_s + MERGE_S) + 1,
        "pair_scans": int(values["pair_s"] / period_s + MERGE_S) + 1,
    }


def _foot(settings: Mapping[str, Any]) -> Foot:
    """Return gait, sensors and filter, for dead reckoning from inertial readings."""
    parts = {"gait": Gait, "accelerometer": Triad, "gyro": Triad, "foot_filter": FootFilter}
    made: dict[str, Any] = {}
    for name, kind in parts.items():
        fields = settings.get(name)
        _require(
            isinstance(fields, Mapping), name, f"{fields!r} does not name its parts", "Give them by name"
        )
        known = {
            part: tuple(found) if isinstance(found, Sequence) and not isinstance(found, str) else found
            for part, found in dict(fields or {}).items()
        }
        try:
            made[name] = kind(**known)
        except TypeError as error:
            raise InputError(f"setting {name}", str(error), "Give each of its parts once") from error
    return Foot(
        made["gait"],
        made["accelerometer"],
        made["gyro"],
        number(settings, "imu_rate_hz", above=0),
        made["foot_filter"],
    )


def _check_building(values: Mapping[str, Any]) -> None:
    """Refuse a building whose parts do not fit each other."""
    width, height = values["size_m"]
    corridor, depth = values["corridor_width_m"], values["room_depth_m"]
    least, most = values["room_width_m"]
    _require(
        2 * _DOOR_SIDE_M + _DOOR_GRID_M <= least <= most,
        "room_width_m",
        f"{least:g} to {most:g} m is not from {2 * _DOOR_SIDE_M + _DOOR_GRID_M} m on, the lower end first",
        "Give wider rooms, so that a tour fits on both sides of the door",
    )
    inner = height / 2 - depth - corridor
    _require(
        min(inner, depth) >= 2 * _ENTRY_M + _CLEAR_M + 1,
        "room_depth_m",
        f"rooms of {depth} m leave {inner:g} m for those inside of the corridors",
        "Give a depth of 5 m or more that leaves as much",
    )
    for name, length in (("outer_rooms", width), ("inner_rooms", width - 2 * corridor)):
        _require(
            least * values[name] <= length <= most * values[name],
            name,
            f"{values[name]} rooms of {least:g} to {most:g} m do not make a row of {length:g} m",
            "Give another number of rooms, or other widths",
        )
    _require(corridor >= 2, "corridor_width_m", f"{corridor} m is too narrow", "Give 2 m or more")
    _require(
        values["door_width_m"] <= 2 and values["entrance_width_m"] <= corridor,
        "door_width_m",
        "a door is wider than 2 m, or an entrance than the corridor",
        "Give narrower ones",
    )
    _require(values["path_m"] >= 4, "path_m", f"{values['path_m']} m is too near", "Give 4 m or more")
    _require(
        values["sway_m"][0] <= corridor / 2 - 1 and values["sway_m"][1] < values["path_m"] / 2,
        "sway_m",
        f"{values['sway_m']} m leads within a metre of a corridor's wall, or half way to the building",
        "Give less",
    )


def _check_walks(values: Mapping[str, Any]) -> None:
    """Refuse walks and landmarks that do not fit the building or each other."""
    _require(
        len(values["walk_s"]) == len(values["visits"]) and min(values["walk_s"]) > 0,
        "visits",
        f"{len(values['visits'])} numbers for {len(values['walk_s'])} walks, or a walk takes no time",
        "Give a time and a number of visits for each walk",
    )
    _require(
        values["speed_m_per_s"][0] > 0, "speed_m_per_s", "the person stands still", "Give speeds above zero"
    )
    _require(
        values["corner_radius_m"] <= 0.4, "corner_radius_m", "no room beside doors", "Give 0.4 m or less"
    )
    ways = _ways(values)
    for index, place in enumerate(values["landmark_m"]):
        start, end = ways[:, 0], ways[:, 1]
        along = (end - start) / np.hypot(*(end - start).T)[:, None]
        away = place - start
        side = np.abs(away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0])
        forth = (away * along).sum(axis=1)
        rest = np.hypot(*(end - start).T) - forth
        on = (side < 1e-9) & (forth >= _SHORTEST_M) & (rest >= _SHORTEST_M)
        _require(
            bool(on.any()),
            f"landmark_m[{index}]",
            f"{place.tolist()} is not in the middle of a corridor or path, {_SHORTEST_M} m off its ends",
            "Give such a place",
        )
        to_door = abs((place[0] + 1) % 2 - 1)
        level = bool(on[[0, 2]].any())
        _require(
            not level or to_door >= 1 - 1e-9,
            f"landmark_m[{index}]",
            f"{place.tolist()} may be in front of a door",
            "Give an odd number of metres in x to landmarks in the corridors along x",
        )
    _require(
        len(np.unique(values["landmark_m"], axis=0)) == len(values["landmark_m"]),
        "landmark_m",
        "two share a place",
        "Give each landmark a place of its own",
    )
    line, size = values["line_m"], np.asarray(values["size_m"])
    _require(
        len(line) == 2 and bool(((line > 0) & (line < size)).all()) and np.ptp(line, axis=0).max() > 5,
        "line_m",
        "it does not have two ends within the building, more than 5 m apart",
        "Give both ends in one corridor",
    )


def _list(settings: Mapping[str, Any], name: str, *, integer: bool = False) -> tuple[float, ...]:
    """Return one setting that must be a list of one number or more."""
    value = settings.get(name)
    count = len(value) if isinstance(value, Sequence) and not isinstance(value, str) else 1
    return numbers(settings, name, max(count, 1), least=0, integer=integer)


def _word(settings: Mapping[str, Any], name: str, allowed: Sequence[str]) -> str:
    """Return one setting that must be one of some words."""
    value = settings.get(name)
    _require(
        value in allowed, name, f"{value!r} is not one of: {', '.join(allowed)}", "Give one of these words"
    )
    return str(value)


def _require(fits: bool, name: str, limit: str, cure: str) -> None:
    if not fits:
        raise InputError(f"setting {name}", limit, cure)
