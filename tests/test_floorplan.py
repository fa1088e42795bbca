"""Plans of buildings: their parts against hand-made figures, random floors against their rules."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioning.errors import InputError
from positioning.geometry import wall_crossings
from positioning.simulation.floorplan import (
    cell_centres,
    corridor_building,
    inside,
    random_split,
    rectangle_walls,
    room_row_walls,
    stratified_points,
    survey_places,
    wall_with_openings,
)

BUILDING = {
    "cell_m": 1.5,
    "corridors": 2,
    "corridor_width_m": 3.0,
    "room_m": [3.0, 7.5],
    "door_width_m": 0.9,
}
SURVEY = {"points": 257, "grid_m": 1.5, "furniture_share": 0.3, "furniture_m": 0.9}


def building(seed, size_m=(30.0, 25.5), **changes):
    return corridor_building(size_m, **{**BUILDING, **changes}, rng=np.random.default_rng(seed))


def area_m2(rectangle_m):
    return np.prod(rectangle_m[..., 1, :] - rectangle_m[..., 0, :], axis=-1)


def distance_to_walls_m(point_m, wall_m):
    """Distance from points [n, 2] to the nearest of axis-parallel walls, by clamping."""
    low, high = wall_m.min(axis=1), wall_m.max(axis=1)
    nearest = np.clip(point_m[:, None], low, high)
    return np.linalg.norm(point_m[:, None] - nearest, axis=-1).min(axis=1)


def test_rectangle_has_four_joined_walls():
    walls = rectangle_walls([[1.0, 2.0], [5.0, 4.0]])
    np.testing.assert_array_equal(
        walls, [[[1, 2], [5, 2]], [[5, 2], [5, 4]], [[5, 4], [1, 4]], [[1, 4], [1, 2]]]
    )
    assert rectangle_walls(np.zeros((3, 7, 2, 2))).shape == (3, 7, 4, 2, 2)
    # From inside to outside there is one wall, from outside through to outside there are two or none.
    count = wall_crossings([[3.0, 3.0], [0.0, 3.1]], [[9.0, 3.3], [0.0, 9.0]], walls)
    np.testing.assert_array_equal(count, [[1, 1], [2, 0]])


@pytest.mark.parametrize(
    ("openings", "expected"),
    [
        ([], [(0, 10)]),
        ([(2, 3)], [(0, 2), (3, 10)]),
        ([(6, 7), (2, 3)], [(0, 2), (3, 6), (7, 10)]),
        ([(2, 5), (3, 4)], [(0, 2), (5, 10)]),
        ([(-1, 1), (9, 12)], [(1, 9)]),
        ([(0, 10)], []),
        ([(11, 12)], [(0, 10)]),
    ],
)
def test_openings_leave_the_rest_of_a_wall(openings, expected):
    along_x = wall_with_openings([5.0, 1.0], [15.0, 1.0], np.reshape(openings, (-1, 2)))
    np.testing.assert_allclose(along_x[..., 0] - 5, np.reshape(expected, (-1, 2)), atol=1e-12)
    assert (along_x[..., 1] == 1).all()
    # A slanted wall of the same length: 3-4-5 triangle, times two.
    slanted = wall_with_openings([0.0, 0.0], [6.0, 8.0], np.reshape(openings, (-1, 2)))
    np.testing.assert_allclose(
        np.hypot(*np.moveaxis(slanted, -1, 0)), np.reshape(expected, (-1, 2)), atol=1e-12
    )


def test_row_of_rooms_has_partitions_and_doors():
    walls = room_row_walls([0.0, 4.0, 7.0], front_m=5.0, back_m=0.0, door_m=[1.0, 5.0], door_width_m=1.0)
    np.testing.assert_array_equal(walls[:3, :, 0], [[0, 0], [4, 4], [7, 7]])
    np.testing.assert_array_equal(walls[:3, :, 1], [[0, 5]] * 3)
    np.testing.assert_allclose(walls[3:, :, 0], [[0, 1], [2, 5], [6, 7]])
    assert (walls[3:, :, 1] == 5).all()


@settings(deadline=None, max_examples=200)
@given(
    total=st.integers(0, 60),
    least=st.integers(1, 6),
    extra=st.integers(0, 6),
    parts=st.none() | st.integers(1, 8),
    seed=st.integers(0, 99),
)
def test_split_keeps_its_limits_or_says_that_it_cannot(total, least, extra, parts, seed):
    most = least + extra
    counts = range(61) if parts is None else [parts]
    possible = any(count * least <= total <= count * most for count in counts)
    rng = np.random.default_rng(seed)
    if not possible:
        with pytest.raises(InputError, match="cannot be cut"):
            random_split(total, least=least, most=most, rng=rng, parts=parts)
        return
    pieces = random_split(total, least=least, most=most, rng=rng, parts=parts)
    assert pieces.sum() == total
    assert ((least <= pieces) & (pieces <= most)).all()
    assert parts is None or len(pieces) == parts


@pytest.mark.parametrize("corridors", [1, 2, 3])
def test_rooms_and_corridors_fill_the_floor(corridors):
    size_m = (30.0, {1: 12.0, 2: 25.5, 3: 37.5}[corridors])
    for seed in range(10):
        plan = building(seed, size_m=size_m, corridors=corridors)
        cell_m = cell_centres(plan.corner_m, 1.5)
        in_room, in_corridor = inside(cell_m, plan.room_m), inside(cell_m, plan.corridor_m)
        np.testing.assert_array_equal(in_room.sum(axis=1) + in_corridor.any(axis=1), 1)
        assert (in_room.sum(axis=0) >= 4).all()
        extent_m = plan.room_m[:, 1] - plan.room_m[:, 0]
        assert extent_m.min() >= 3.0
        assert extent_m.max() <= 7.5
        np.testing.assert_allclose(plan.corner_m, [[0, 0], size_m])


def test_walls_part_rooms_and_doors_open_them():
    for seed in range(10):
        plan = building(seed)
        centre_m = plan.room_m.mean(axis=1)
        corridor_m = plan.corridor_m.mean(axis=1)
        # Between two rooms that touch there is a wall (two doors may face each other over a
        # corridor); inside one room there is none.
        low, high = plan.room_m[:, 0], plan.room_m[:, 1]
        touching = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=-1)
        count = wall_crossings(np.add(centre_m, [0.01, 0.003]), centre_m, plan.wall_m)
        assert (count[touching & ~np.eye(len(centre_m), dtype=bool)] >= 1).all()
        assert (np.diag(count) == 0).all()
        # Corridors that meet are open to each other.
        assert (
            wall_crossings(
                corridor_m[:2] * [0, 1] + corridor_m[2] * [1, 0], corridor_m[2:], plan.wall_m
            ).max()
            == 0
        )
        # Every room has one door: the opening of its walls is one door wide.
        outline_m = 2 * (plan.room_m[:, 1] - plan.room_m[:, 0]).sum(axis=1)
        for room, length_m in zip(plan.room_m, outline_m, strict=True):
            low = np.maximum(plan.wall_m.min(axis=1), room[0])
            high = np.minimum(plan.wall_m.max(axis=1), room[1])
            on_side = ((low == high) & ((low == room[0]) | (low == room[1]))).any(axis=1) & (low <= high).all(
                axis=1
            )
            covered_m = (high - low)[on_side].sum()
            np.testing.assert_allclose(length_m - covered_m, 0.9, atol=1e-9)


def test_no_wall_is_there_twice():
    for seed in range(10):
        wall_m = building(seed).wall_m
        lengths_m = np.linalg.norm(wall_m[:, 1] - wall_m[:, 0], axis=-1)
        assert lengths_m.min() > 0
        # A point a third along each wall lies on that wall only.
        third_m = wall_m[:, 0] * (2 / 3) + wall_m[:, 1] / 3
        low, high = wall_m.min(axis=1) - 1e-9, wall_m.max(axis=1) + 1e-9
        parallel = (np.ptp(wall_m, axis=1)[:, None] > 0) == (np.ptp(wall_m, axis=1)[None] > 0)
        on_wall = ((low <= third_m[:, None]) & (third_m[:, None] <= high)).all(axis=-1) & parallel.all(
            axis=-1
        )
        np.testing.assert_array_equal(on_wall.sum(axis=1), 1)


def test_plans_differ_between_generators_and_repeat_with_the_same():
    first, again, other = building(1), building(1), building(2)
    np.testing.assert_array_equal(first.wall_m, again.wall_m)
    assert first.wall_m.shape != other.wall_m.shape or (first.wall_m != other.wall_m).any()


@pytest.mark.parametrize(
    ("thing", "changes"),
    [
        ("size_m", {"size_m": (30.0, 25.0)}),
        ("corridor_width_m", {"corridor_width_m": 2.0}),
        ("door_width_m", {"door_width_m": 3.5}),
        ("a length of -1 cells", {"corridors": 9}),
        ("size_m", {"size_m": (7.5, 25.5)}),
    ],
)
def test_buildings_that_cannot_be_name_the_reason(thing, changes):
    with pytest.raises(InputError) as caught:
        building(0, **changes)
    assert caught.value.thing == thing


def test_cell_centres_fill_the_rectangle_row_by_row():
    np.testing.assert_allclose(
        cell_centres([[1.0, 2.0], [4.0, 3.0]], 1.0), [[1.5, 2.5], [2.5, 2.5], [3.5, 2.5]]
    )
    assert cell_centres([[0.0, 0.0], [30.0, 25.5]], 1.5).shape == (340, 2)


def test_inside_includes_the_border():
    rectangle_m = np.array([[[0.0, 0.0], [2.0, 1.0]], [[1.0, 0.0], [3.0, 3.0]]])
    np.testing.assert_array_equal(
        inside([[0.0, 1.0], [1.5, 0.5], [2.5, 2.0], [4.0, 0.0]], rectangle_m),
        [[True, False], [True, True], [False, True], [False, False]],
    )


def test_survey_keeps_exactly_the_points_and_clear_of_all_that_is_closed():
    for seed in range(100):
        plan = building(seed)
        place_m, closed_m = survey_places(plan, **SURVEY, rng=np.random.default_rng(seed))
        assert place_m.shape == (257, 2)
        assert len(np.unique(place_m, axis=0)) == 257
        assert not inside(place_m, closed_m).any()
        assert inside(place_m, plan.corner_m[None]).all()
        assert distance_to_walls_m(place_m, plan.wall_m).min() > 0.74
        furniture = area_m2(closed_m) < 1.0
        assert furniture.sum() >= 0.3 * 83
        # Closed rooms are whole rooms, and what is closed explains every point that is missing.
        rooms = {tuple(room) for room in plan.room_m.reshape(-1, 4)}
        assert all(tuple(area) in rooms for area in closed_m[~furniture].reshape(-1, 4))
        assert inside(cell_centres(plan.corner_m, 1.5), closed_m).sum() == 83
        assert not inside(closed_m.mean(axis=1), plan.corridor_m).any()


def test_survey_of_the_whole_grid_closes_nothing():
    place_m, closed_m = survey_places(building(0), **{**SURVEY, "points": 340}, rng=np.random.default_rng(0))
    assert place_m.shape == (340, 2)
    assert closed_m.shape == (0, 2, 2)


@pytest.mark.parametrize(
    ("thing", "changes"),
    [("points", {"points": 341}), ("points", {"points": 20}), ("furniture_m", {"furniture_m": 1.5})],
)
def test_surveys_that_cannot_be_name_the_reason(thing, changes):
    with pytest.raises(InputError) as caught:
        survey_places(building(0), **{**SURVEY, **changes}, rng=np.random.default_rng(0))
    assert caught.value.thing == thing


def test_stratified_points_lie_one_in_each_cell():
    point_m = stratified_points([[10.0, 0.0], [40.0, 20.0]], [3, 2], np.random.default_rng(0))
    cell = np.floor((point_m - [10.0, 0.0]) / 10.0)
    np.testing.assert_array_equal(cell, [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
