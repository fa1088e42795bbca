"""Distances and wall crossings against closed forms and rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m, wall_crossings

SMALL = st.integers(-4, 4)
POINT = st.tuples(SMALL, SMALL)
WALL = st.tuples(POINT, POINT)


def count_by_solving(start, end, walls) -> int:
    """Solve for the crossing point of each wall, moved by a real small step, in rational arithmetic."""
    step = Fraction(1, 10**60)
    count = 0
    for (first_x, first_y), (second_x, second_y) in walls:
        wall_x, wall_y = Fraction(first_x) + step, Fraction(first_y) + step**2
        wall_dx, wall_dy = Fraction(second_x) - Fraction(first_x), Fraction(second_y) - Fraction(first_y)
        dx, dy = Fraction(end[0]) - Fraction(start[0]), Fraction(end[1]) - Fraction(start[1])
        determinant = dx * wall_dy - dy * wall_dx
        if determinant == 0:
            continue
        off_x, off_y = wall_x - Fraction(start[0]), wall_y - Fraction(start[1])
        on_line = (off_x * wall_dy - off_y * wall_dx) / determinant
        on_wall = (off_x * dy - off_y * dx) / determinant
        count += 0 < on_line < 1 and 0 < on_wall < 1
    return count


@settings(deadline=None, max_examples=300)
@given(start=POINT, end=POINT, walls=st.lists(WALL, min_size=1, max_size=6))
def test_crossings_equal_rational_arithmetic_on_small_integers(start, end, walls):
    assert wall_crossings([start], [end], walls)[0, 0] == count_by_solving(start, end, walls)


@settings(deadline=None, max_examples=200)
@given(start=POINT, step=POINT, other=POINT, scale=st.sampled_from([0.1, 0.3, 1e3 / 7]))
def test_crossings_equal_rational_arithmetic_where_rounding_would_decide(start, step, other, scale):
    # The wall begins a third of the way along the line, but for the rounding of multiples of 0.1.
    start, step, other = (scale * (np.array(point) + 12.7) for point in (start, step, other))
    step = step - 12.7 * scale
    line, wall = (start, start + 3 * step), (start + step, other)
    assert wall_crossings(line[:1], line[1:], [wall])[0, 0] == count_by_solving(*line, [wall])


@settings(deadline=None, max_examples=100)
@given(start=POINT, end=POINT, walls=st.lists(WALL, min_size=1, max_size=6))
def test_crossings_do_not_depend_on_directions(start, end, walls):
    walls = np.array(walls)
    count = wall_crossings([start], [end], walls)
    np.testing.assert_array_equal(count, wall_crossings([end], [start], walls))
    np.testing.assert_array_equal(count, wall_crossings([start], [end], walls[:, ::-1]))


def test_crossings_are_invariant_under_rotation_and_translation():
    rng = np.random.default_rng(3)
    start, end, wall = rng.uniform(0, 30, (40, 2)), rng.uniform(0, 30, (6, 2)), rng.uniform(0, 30, (30, 2, 2))
    count = wall_crossings(start, end, wall)
    assert 2 < count.mean() < 20
    angle_rad = 0.7
    turn = np.array([[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]])
    moved = [points @ turn.T + [100.0, -50.0] for points in (start, end, wall)]
    np.testing.assert_array_equal(wall_crossings(*moved), count)


@pytest.mark.parametrize(
    ("what", "start", "end", "walls", "expected"),
    [
        ("plain crossing", (0, 0), (4, 0), [((2, -1), (2, 1))], 1),
        ("short of the wall", (0, 0), (1, 0), [((2, -1), (2, 1))], 0),
        ("beside the wall", (0, 2), (4, 2), [((2, -1), (2, 1))], 0),
        ("joint of two walls in a row", (0, 0), (4, 0), [((2, -1), (2, 0)), ((2, 0), (2, 1))], 1),
        ("through a corner into the room", (-1, -1), (1, 1), [((0, 0), (5, 0)), ((0, 0), (0, 5))], 1),
        (
            "through a wall where another ends on it",
            (0, 1),
            (0, -1),
            [((-2, 0), (2, 0)), ((0, 0), (0, -2))],
            1,
        ),
        ("along a wall", (0, 0), (4, 0), [((1, 0), (3, 0))], 0),
        ("from a place to itself on a wall", (2, 0), (2, 0), [((2, -1), (2, 1))], 0),
        ("wall of length zero", (0, 0), (4, 0), [((2, 0), (2, 0))], 0),
    ],
)
def test_crossings_of_known_figures(what, start, end, walls, expected):
    assert wall_crossings([start], [end], walls)[0, 0] == expected, what


def test_missing_walls_count_as_none():
    walls = np.array([[[2.0, -1], [2, 1]], [[np.nan] * 2] * 2, [[3, -1], [3, np.nan]]])
    assert wall_crossings([[0.0, 0.0]], [[4.0, 0.0]], walls)[0, 0] == 1
    assert wall_crossings([[0.0, 0.0]], [[4.0, 0.0]], np.empty((0, 2, 2)))[0, 0] == 0


def test_crossings_broadcast_over_worlds():
    rng = np.random.default_rng(4)
    start, end, wall = (
        rng.uniform(0, 9, (3, 7, 2)),
        rng.uniform(0, 9, (4, 2)),
        rng.uniform(0, 9, (2, 1, 5, 2, 2)),
    )
    count = wall_crossings(start, end, wall)
    assert count.shape == (2, 3, 7, 4)
    for row in range(2):
        for column in range(3):
            np.testing.assert_array_equal(
                count[row, column], wall_crossings(start[column], end, wall[row, 0])
            )


@pytest.mark.parametrize(
    ("thing", "arguments"),
    [
        ("start_m", ([1.0, 2.0], [[1.0, 2.0]], np.zeros((1, 2, 2)))),
        ("end_m", ([[1.0, 2.0]], [[1.0, np.nan]], np.zeros((1, 2, 2)))),
        ("wall_m", ([[1.0, 2.0]], [[1.0, 2.0]], np.zeros((3, 2)))),
        ("wall_m", ([[1.0, 2.0]], [[1.0, 2.0]], np.full((1, 2, 2), np.inf))),
    ],
)
def test_crossings_name_what_does_not_fit(thing, arguments):
    with pytest.raises(InputError) as caught:
        wall_crossings(*arguments)
    assert caught.value.thing == thing


def test_distances_equal_scipy_and_broadcast():
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(3, 8, 2)), rng.normal(size=(5, 2))
    distance_m = pairwise_distance_m(first, second)
    assert distance_m.shape == (3, 8, 5)
    for world in range(3):
        np.testing.assert_allclose(distance_m[world], cdist(first[world], second), rtol=1e-13)
    with pytest.raises(InputError, match="coordinates"):
        pairwise_distance_m(first, np.zeros((5, 3)))
