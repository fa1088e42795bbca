"""Random floors of buildings: walls with doors, rooms along corridors, places to survey.

Rectangles are lower left and upper right corner, [..., 2, 2]; walls are two end points, [..., 2, 2].
Rows of rooms run along x; swap the last axis of every array for a building along y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A floor of a building.

    Attributes
    ----------
    corner_m
        Its outline, [2, 2], metres.
    wall_m
        Walls, cut at the doors, [w, 2, 2], metres.
    room_m
        Rooms, [r, 2, 2], metres.
    corridor_m
        Corridors, [c, 2, 2], metres; they overlap where they meet.
    """

    corner_m: Array
    wall_m: Array
    room_m: Array
    corridor_m: Array


def rectangle_walls(corner_m: ArrayLike) -> Array:
    """Return the four walls around rectangles.

    Parameters
    ----------
    corner_m
        Rectangles, [..., 2, 2], metres.

    Returns
    -------
    Array
        Walls, [..., 4, 2, 2], metres, counter-clockwise from the lower one.
    """
    corner = np.asarray(corner_m, dtype=np.float64)
    x, y = corner[..., [0, 1, 1, 0], 0], corner[..., [0, 0, 1, 1], 1]
    vertex = np.stack([x, y], axis=-1)
    return np.stack([vertex, np.roll(vertex, -1, axis=-2)], axis=-2)


def wall_with_openings(start_m: ArrayLike, end_m: ArrayLike, opening_m: ArrayLike) -> Array:
    """Return what is left of a straight wall between its openings.

    Parameters
    ----------
    start_m, end_m
        End points of the whole wall, [2], metres.
    opening_m
        Begin and end of each opening, [k, 2], metres along the wall from its start; they may
        overlap and may reach beyond the wall.

    Returns
    -------
    Array
        Walls, [w, 2, 2], metres.
    """
    start, end = np.asarray(start_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    openings = np.asarray(opening_m, dtype=np.float64).reshape(-1, 2)
    pieces, reached = [], 0.0
    for opening_begin, opening_end in [*sorted(map(tuple, openings)), (length, length)]:
        if opening_begin > reached:
            pieces.append((reached, min(opening_begin, length)))
        reached = max(reached, opening_end)
    # The ends stay exactly those given, so that joined walls share them to the last bit.
    share = np.array(pieces, dtype=np.float64).reshape(-1, 2, 1) / (length or 1.0)
    return np.where(share == 1.0, end, start + share * (end - start))


def room_row_walls(
    edge_m: ArrayLike, *, front_m: float, back_m: float, door_m: ArrayLike, door_width_m: float
) -> Array:
    """Return the walls of a row of rooms along x: all partitions, and the front wall with its doors.

    The back wall is left to the caller, because it belongs to the outline or to the next row.

    Parameters
    ----------
    edge_m
        Where the partitions stand, from the first room's outer side to the last one's, [rooms + 1],
        metres in x.
    front_m, back_m
        Where the front wall and the back wall run, metres in y.
    door_m
        Left end of each door, [doors], metres in x.
    door_width_m
        Width of the doors, metres.

    Returns
    -------
    Array
        Walls, [w, 2, 2], metres; the first ``rooms + 1`` are the partitions in the order of
        ``edge_m``.
    """
    edge, door = np.asarray(edge_m, dtype=np.float64), np.asarray(door_m, dtype=np.float64)
    partition = np.empty((len(edge), 2, 2))
    partition[:, :, 0] = edge[:, None]
    partition[:, :, 1] = [back_m, front_m]
    front = wall_with_openings(
        [edge[0], front_m],
        [edge[-1], front_m],
        np.stack([door - edge[0], door - edge[0] + door_width_m], axis=-1),
    )
    return np.concatenate([partition, front])


def random_split(
    total: int, *, least: int, most: int, rng: np.random.Generator, parts: int | None = None
) -> NDArray[np.int64]:
    """Cut a length into random pieces, all within limits.

    Parameters
    ----------
    total
        Length, in cells.
    least, most
        Limits of a piece, in cells.
    rng
        Source of the draws.
    parts
        Number of pieces; None leaves it to chance.

    Returns
    -------
    NDArray
        Lengths of the pieces in random order, [parts], cells; their sum is ``total``.

    Raises
    ------
    InputError
        If no such pieces exist.
    """

    def possible(rest: int, left: int | None) -> bool:
        return -(-rest // most) * least <= rest if left is None else left * least <= rest <= left * most

    if least < 1 or most < least or total < 0 or not possible(total, parts):
        raise InputError(
            f"a length of {total} cells",
            f"it cannot be cut into {'' if parts is None else f'{parts} '}pieces of {least} to {most} cells",
            "Change the size of the building, the limits of its rooms or the number of its corridors",
        )
    pieces: list[int] = []
    rest, left = total, parts
    while rest:
        left = None if left is None else left - 1
        sizes = [size for size in range(least, min(most, rest) + 1) if possible(rest - size, left)]
        pieces.append(sizes[rng.integers(len(sizes))])
        rest -= pieces[-1]
    # Later pieces have less choice; the order must not show it.
    return rng.permutation(np.array(pieces, dtype=np.int64))


def corridor_building(
    size_m: Sequence[float],
    *,
    cell_m: float,
    corridors: int,
    corridor_width_m: float,
    room_m: Sequence[float],
    door_width_m: float,
    rng: np.random.Generator,
) -> Plan:
    """Draw a floor: corridors along x with rooms on both sides, joined by one corridor across.

    All walls run on a lattice of square cells, so that the centres of the cells are clear of them.
    Every room has one door to its corridor. The corridor across begins at the first corridor
    and ends at the last; one corridor alone has none.

    Parameters
    ----------
    size_m
        Extent in x and y, metres; multiples of ``cell_m``, as are the other lengths but the doors.
    cell_m
        Side of a cell, metres.
    corridors
        Number of corridors along x.
    corridor_width_m
        Width of every corridor, metres.
    room_m
        Least and largest width and depth of a room, metres.
    door_width_m
        Width of a door, metres.
    rng
        Source of the draws.

    Raises
    ------
    InputError
        For lengths that are not multiples of the cell, doors wider than a room, or rooms that do not
        fit between the corridors.
    """
    columns, rows = (_cells("size_m", length, cell_m) for length in size_m)
    corridor_cells = _cells("corridor_width_m", corridor_width_m, cell_m)
    least, most = (_cells("room_m", length, cell_m) for length in room_m)
    if not 0 <= door_width_m < least * cell_m:
        raise InputError(
            "door_width_m", f"{door_width_m} does not fit a room of {room_m[0]} m", "Give a narrower door"
        )
    depth = random_split(
        rows - corridors * corridor_cells, least=least, most=most, rng=rng, parts=2 * corridors
    )
    across = _corridor_across(columns, corridor_cells, least, most, rng) if corridors > 1 else None

    corner = np.array([[0.0, 0.0], [columns, rows]]) * cell_m
    walls, rooms, hallways = [rectangle_walls(corner)], [], []
    bottom = 0
    for row in range(2 * corridors):
        top = bottom + int(depth[row])
        front, back = (top, bottom) if row % 2 == 0 else (bottom, top)
        inner = across is not None and 0 < row < 2 * corridors - 1
        sections = (
            [(0, across), (across + corridor_cells, columns)]
            if inner and across is not None
            else [(0, columns)]
        )
        for left, right in sections:
            width = random_split(right - left, least=least, most=most, rng=rng)
            edge = cell_m * (left + np.concatenate([[0], np.cumsum(width)]))
            door = edge[:-1] + rng.random(len(width)) * (np.diff(edge) - door_width_m)
            row_walls = room_row_walls(
                edge, front_m=front * cell_m, back_m=back * cell_m, door_m=door, door_width_m=door_width_m
            )
            # Partitions at the ends of the building are part of its outline.
            outline = np.zeros(len(row_walls), dtype=bool)
            outline[0], outline[len(edge) - 1] = left == 0, right == columns
            walls.append(row_walls[~outline])
            # Two rows back to back share one wall.
            if row % 2 == 1 and row < 2 * corridors - 1:
                walls.append(np.array([[[left, back], [right, back]]]) * cell_m)
            rooms += [[[x0, bottom * cell_m], [x1, top * cell_m]] for x0, x1 in pairwise(edge)]
        bottom = top
        if row % 2 == 0:
            hallways.append([[0, bottom], [columns, bottom + corridor_cells]])
            bottom += corridor_cells
    if across is not None:
        hallways.append([[across, hallways[0][0][1]], [across + corridor_cells, hallways[-1][1][1]]])
    return Plan(
        corner_m=corner,
        wall_m=np.concatenate(walls),
        room_m=np.array(rooms),
        corridor_m=np.array(hallways) * cell_m,
    )


def _corridor_across(columns: int, width: int, least: int, most: int, rng: np.random.Generator) -> int:
    starts = [
        start
        for start in range(least, columns - width - least + 1)
        if all(-(-side // most) * least <= side for side in (start, columns - width - start))
    ]
    if not starts:
        raise InputError(
            "size_m", "the floor is too narrow for a corridor across", "Give a larger size or smaller rooms"
        )
    return starts[rng.integers(len(starts))]


def _cells(name: str, length_m: float, cell_m: float) -> int:
    cells = round(length_m / cell_m) if cell_m > 0 else 0
    if cells < 1 or abs(cells * cell_m - length_m) > 1e-9 * length_m:
        raise InputError(
            name, f"{length_m} m is not a multiple of {cell_m} m", "Give a whole number of cells"
        )
    return cells


def cell_centres(corner_m: ArrayLike, cell_m: float) -> Array:
    """Return the centres of the square cells that fill a rectangle, row after row.

    Parameters
    ----------
    corner_m
        Rectangle, [2, 2], metres.
    cell_m
        Side of a cell, metres; both sides of the rectangle are multiples of it.

    Returns
    -------
    Array
        Points, [n, 2], metres.
    """
    corner = np.asarray(corner_m, dtype=np.float64)
    columns, rows = (_cells("corner_m", float(length), cell_m) for length in corner[1] - corner[0])
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    centre: Array = corner[0] + cell_m * np.stack([x.ravel(), y.ravel()], axis=-1)
    return centre


def inside(point_m: ArrayLike, rectangle_m: ArrayLike) -> NDArray[np.bool_]:
    """Tell which points lie in which rectangles; the border belongs to them.

    Parameters
    ----------
    point_m
        Points, [..., n, 2], metres.
    rectangle_m
        Rectangles, [..., r, 2, 2], metres.

    Returns
    -------
    NDArray
        True for a point in a rectangle, [..., n, r].
    """
    point = np.asarray(point_m, dtype=np.float64)[..., :, None, :]
    rectangle = np.asarray(rectangle_m, dtype=np.float64)[..., None, :, :, :]
    within: NDArray[np.bool_] = np.all(
        (rectangle[..., 0, :] <= point) & (point <= rectangle[..., 1, :]), axis=-1
    )
    return within


def survey_places(
    plan: Plan,
    *,
    points: int,
    grid_m: float,
    furniture_share: float,
    furniture_m: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Choose exactly so many places of a grid, leaving out closed rooms and pieces of furniture.

    The grid's points are the centres of its cells. Whole rooms are closed at random as long as they
    fit; furniture in the open rooms takes the rest. Corridors stay free.

    Parameters
    ----------
    plan
        The floor.
    points
        Number of places that remain.
    grid_m
        Spacing of the grid, metres.
    furniture_share
        Share, at least, of the places left out that furniture takes, 0 to 1.
    furniture_m
        Side of a square piece of furniture, metres; smaller than the grid.
    rng
        Source of the draws.

    Returns
    -------
    tuple
        The places, [points, 2], and the closed areas, [c, 2, 2], both in metres.

    Raises
    ------
    InputError
        If the grid has too few points, or too few of them in rooms.
    """
    grid = cell_centres(plan.corner_m, grid_m)
    excess = len(grid) - points
    if excess < 0:
        raise InputError(
            "points",
            f"{points} places are asked of a grid of {len(grid)}",
            "Give fewer points or a finer grid",
        )
    if not 0 < furniture_m < grid_m:
        raise InputError(
            "furniture_m",
            f"{furniture_m} m is not between 0 and the grid's {grid_m} m",
            "Give a smaller side",
        )
    in_room = inside(grid, plan.room_m)
    room_points = in_room.sum(axis=0)
    budget = excess - int(np.ceil(furniture_share * excess))
    closed: list[int] = []
    for room in rng.permutation(len(plan.room_m)):
        if room_points[room] <= budget:
            budget -= int(room_points[room])
            closed.append(room)
    free: NDArray[np.bool_] = np.all(~in_room[:, closed], axis=1)
    candidates = np.flatnonzero(free & in_room.any(axis=1))
    blocked = int(free.sum()) - points
    if blocked > len(candidates):
        raise InputError(
            "points",
            f"{blocked} places must be left out, open rooms have {len(candidates)}",
            "Give more points or a coarser grid",
        )
    furniture = rng.choice(candidates, blocked, replace=False)
    free[furniture] = False
    half = furniture_m / 2
    pieces = np.stack([grid[furniture] - half, grid[furniture] + half], axis=-2)
    return grid[free], np.concatenate([plan.room_m[closed], pieces])


def stratified_points(corner_m: ArrayLike, cells: Sequence[int], rng: np.random.Generator) -> Array:
    """Draw one point in each cell of an even partition of a rectangle, row after row.

    Parameters
    ----------
    corner_m
        Rectangle, [2, 2], metres.
    cells
        Number of cells in x and in y.
    rng
        Source of the draws.

    Returns
    -------
    Array
        Points, [cells in x * cells in y, 2], metres.
    """
    corner = np.asarray(corner_m, dtype=np.float64)
    column, row = np.meshgrid(np.arange(cells[0]), np.arange(cells[1]))
    cell = np.stack([column.ravel(), row.ravel()], axis=-1)
    share = (cell + rng.random(cell.shape)) / np.asarray(cells)
    point: Array = corner[0] + share * (corner[1] - corner[0])
    return point
