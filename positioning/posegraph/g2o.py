"""Pose graphs in files: the .g2o format, and the older one of TORO in which some graphs are published.

See Kuemmerle et al. (2011), "g2o: A general framework for graph optimization", and Grisetti et al. (2007), "A
tree parameterization for efficiently computing maximum likelihood maps using gradient descent", for TORO.

Both hold the information of an edge in the frame of the measured second pose, `PoseGraph` in that of the
first: reading and writing turn it by the measured turn.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array
from positioning.posegraph.graph import PoseGraph, checked, wrong_information

# Places of the six numbers of an edge within the information matrix.
_G2O: Final = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))
_TORO: Final = ((0, 0, 1, 2, 0, 1), (0, 1, 1, 2, 2, 2))
_VERTEX: Final = ("VERTEX_SE2", "VERTEX2")
_EDGE: Final = {"EDGE_SE2": _G2O, "EDGE2": _TORO}
_FIX: Final = "FIX"
_NEAR: Final = "EDGE_NEAR"


def read(path: str | Path) -> PoseGraph:
    """Read a graph.

    Lines ``VERTEX_SE2 id x y heading`` or ``VERTEX2``, ``EDGE_SE2 from to forward left turn`` or ``EDGE2``
    with six numbers of information (``EDGE2`` in TORO's order), ``FIX id ...`` and ``EDGE_NEAR from to
    weight``, a proximity edge, which other programs do not know. Empty lines and those that begin with ``#``
    or ``PARAMS_``, which tell of sensors, are skipped.

    Parameters
    ----------
    path
        The file, UTF-8.

    Returns
    -------
    PoseGraph
        Poses in the order of the file. Without a line ``FIX``, the first one is fixed. Edges between poses
        that do not follow each other in the file are loops.

    Raises
    ------
    InputError
        With file and line number: for a line of another kind or length, what is not a finite number, a pose
        or a pair that stands twice, an edge to a pose that stands nowhere, information that is not positive
        semi-definite, or a negative weight. For a file without a pose.
    """
    file = Path(path)
    number_of: dict[int, int] = {}
    poses: list[list[float]] = []
    edges: dict[str, list[tuple[int, list[str]]]] = {tag: [] for tag in (*_EDGE, _NEAR, _FIX)}
    for number, line in enumerate(_text(file).splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith(("#", "PARAMS_")):
            continue
        tag, values = words[0], words[1:]
        if tag in _VERTEX:
            _expect(file, number, tag, values, 4)
            vertex = _integers(file, number, values[:1])[0]
            if vertex in number_of:
                _fail(file, number, f"pose {vertex} stands here a second time", "Remove one of the two")
            number_of[vertex] = len(poses)
            poses.append(_numbers(file, number, values[1:]))
        elif tag in edges:
            edges[tag].append((number, values))
        else:
            known = ", ".join((*_VERTEX, *edges))
            _fail(file, number, f"{tag!r} is none of {known}", "Remove the line, or convert the file")
    if not poses:
        raise InputError(str(file), "it holds no pose", "Give a file with VERTEX_SE2 or VERTEX2 lines")

    start, end, motion, information, line_of = [], [], [], [], []
    for tag, places in _EDGE.items():
        for number, values in edges[tag]:
            _expect(file, number, tag, values, 11)
            one, two = _ends(file, number, values, number_of)
            numbers = _numbers(file, number, values[2:])
            start.append(one)
            end.append(two)
            motion.append(numbers[:3])
            matrix = np.zeros((3, 3))
            matrix[places] = numbers[3:]
            information.append(matrix)
            line_of.append(number)
    near_from, near_to, near_weight = [], [], []
    pairs: dict[frozenset[int], int] = {}
    for number, values in edges[_NEAR]:
        _expect(file, number, _NEAR, values, 3)
        one, two = _ends(file, number, values, number_of)
        near_from.append(one)
        near_to.append(two)
        near_weight.append(_numbers(file, number, values[2:])[0])
        if near_weight[-1] < 0:
            _fail(file, number, f"the weight {values[2]} is negative", "Give a weight from zero")
        if (first := pairs.setdefault(frozenset((one, two)), number)) != number:
            _fail(file, number, f"the pair stands in line {first} already", "Keep one of the two")
    fixed = np.zeros(len(poses), dtype=bool)
    for number, values in edges[_FIX]:
        fixed[[_pose(file, number, vertex, number_of) for vertex in _integers(file, number, values)]] = True
    if not fixed.any():
        fixed[0] = True

    motions = np.array(motion, dtype=np.float64).reshape(-1, 3)
    upper = np.array(information, dtype=np.float64).reshape(-1, 3, 3)
    full = upper + np.triu(upper, 1).swapaxes(-1, -2)
    if len(full) and (negative := wrong_information(full)[1]).any():
        limit = "the information is not positive semi-definite"
        _fail(file, line_of[int(np.argmax(negative))], limit, "Give the inverse of a covariance")
    starts, ends = np.array(start, dtype=np.intp), np.array(end, dtype=np.intp)
    return PoseGraph(
        pose=np.array(poses, dtype=np.float64),
        motion_from=starts,
        motion_to=ends,
        motion=motions,
        motion_information=_turned(full, motions[:, 2]),
        near_from=np.array(near_from, dtype=np.intp),
        near_to=np.array(near_to, dtype=np.intp),
        near_weight=np.array(near_weight, dtype=np.float64) if near_weight else None,
        fixed=fixed,
        loop=np.abs(ends - starts) != 1,
    ).check(str(file))


def write(path: str | Path, graph: PoseGraph) -> None:
    """Write a graph as .g2o; poses are numbered from zero.

    Reading it back gives the same graph to the last digit but for the information, which is turned twice.
    Which edges are loops is not written.

    Parameters
    ----------
    path
        The file, which is replaced.
    graph
        What to write; proximity edges become ``EDGE_NEAR from to weight``.

    Raises
    ------
    InputError
        For a graph that cannot be used.
    """
    checked(graph)
    lines = [f"{_VERTEX[0]} {i} {_digits(pose)}" for i, pose in enumerate(graph.pose.tolist())]
    information = _turned(np.asarray(graph.motion_information, dtype=np.float64), -graph.motion[:, 2])
    numbers = np.concatenate([graph.motion, information[:, _G2O[0], _G2O[1]]], axis=-1)
    ends = zip(graph.motion_from.tolist(), graph.motion_to.tolist(), numbers.tolist(), strict=True)
    lines += [f"EDGE_SE2 {start} {end} {_digits(values)}" for start, end, values in ends]
    weight = np.ones(len(graph.near_from)) if graph.near_weight is None else graph.near_weight
    near = zip(graph.near_from.tolist(), graph.near_to.tolist(), weight.tolist(), strict=True)
    # What not every program knows stands last: some stop reading there.
    fixed = np.flatnonzero(graph.fixed)
    if len(fixed):
        lines.append(f"{_FIX} {' '.join(map(str, fixed.tolist()))}")
    lines += [f"{_NEAR} {start} {end} {value!r}" for start, end, value in near]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _turned(information: Array, turn_rad: Array) -> Array:
    """Return information of the measured second pose in the frame of the first."""
    rotation = np.zeros((*turn_rad.shape, 3, 3))
    rotation[..., 0, 0] = rotation[..., 1, 1] = np.cos(turn_rad)
    rotation[..., 1, 0] = np.sin(turn_rad)
    rotation[..., 0, 1] = -rotation[..., 1, 0]
    rotation[..., 2, 2] = 1.0
    turned = rotation @ information @ np.swapaxes(rotation, -1, -2)
    # Symmetric to the last digit, whatever the rounding.
    return np.asarray(0.5 * (turned + np.swapaxes(turned, -1, -2)))


def _digits(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _text(file: Path) -> str:
    try:
        # Some editors begin a file with a mark of its encoding.
        return file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(file), f"it cannot be read ({error})", "Give a .g2o file") from error


def _fail(file: Path, number: int, limit: str, cure: str) -> NoReturn:
    raise InputError(f"{file}, line {number}", limit, cure)


def _expect(file: Path, number: int, tag: str, values: list[str], count: int) -> None:
    if len(values) != count:
        _fail(file, number, f"{tag} has {len(values)} values, not {count}", "Complete the line")


def _integers(file: Path, number: int, values: list[str]) -> list[int]:
    try:
        return [int(value) for value in values]
    except ValueError:
        _fail(file, number, f"{' '.join(values)!r} are no numbers of poses", "Correct the line")


def _numbers(file: Path, number: int, values: list[str]) -> list[float]:
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        numbers = [np.nan]
    if not np.isfinite(numbers).all():
        _fail(file, number, f"{' '.join(values)!r} are not all finite numbers", "Correct the line")
    return numbers


def _pose(file: Path, number: int, vertex: int, number_of: dict[int, int]) -> int:
    if vertex not in number_of:
        _fail(file, number, f"pose {vertex} stands nowhere in the file", "Add it, or remove the edge")
    return number_of[vertex]


def _ends(file: Path, number: int, values: list[str], number_of: dict[int, int]) -> tuple[int, int]:
    one, two = (_pose(file, number, vertex, number_of) for vertex in _integers(file, number, values[:2]))
    if one == two:
        _fail(file, number, f"the edge joins pose {values[0]} to itself", "Remove the line")
    return one, two
