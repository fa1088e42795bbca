"""Pose graphs that others published: a research laboratory, a simulated town, and a corridor with its log.

The first was measured by D. Haehnel with a laser scanner at the Intel Research Lab and published by
L. Carlone; the second was simulated by E. Olson; the third was measured by the process automation group of
TU Chemnitz (libRSF): odometry of a robot, candidates of a camera for places met again, and true places.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array, Worlds
from positioning.posegraph import g2o
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.residuals import move
from positioning.recordings.register import find_file
from positioning.tasks.pose_graph import arrays_of

NAMES = ("intel", "m3500", "corridor")
FILES = {"intel": "intel.g2o", "m3500": "M3500.txt"}
LOG, TRUTH = "tuc_Corridor_Input.txt", "tuc_Corridor_GT.txt"


def load(folder: str | Path, *, name: str = "intel", least_score: float = 0.0) -> Worlds:
    """Load one graph.

    ``intel`` and ``m3500`` are taken as they are: poses, motions and information of the files, loop closures
    are the motions between poses that do not follow each other. Nobody knows their true places. ``m3500`` is
    simulated, no measurement, and its information should be met with care: the entries 44.72 are the root of
    2000, so that they may be roots of information, not information; other copies print other values. They
    are taken as printed. As all entries of most edges are the same number, their square would hardly move the
    minimum, but multiply its cost.

    ``corridor`` has no graph, but a log, from which one is made. Key poses are the times that stand in a loop
    candidate, one about every two seconds; nothing between them is kept. The motion from one to the next is
    the odometry integrated, each reading held until the next one comes: turned by half before and by half
    after it is moved. Its information is the inverse of the covariance that follows from the printed
    variances of the readings, 0.0025 (m/s)^2 along and across and 0.0001 (rad/s)^2, whose errors are taken
    for independent of each other; a drift that lasts is not in them, and is what dead reckoning suffers from
    here. The last key pose lies 0.2 s behind the last reading, which is held until then. A candidate gives no
    motion, but says that two places are one, with a score from 0 to 1: it is a proximity edge of that weight.
    Of all candidates 22 % are within 1 m in truth, of those with a score from 0.1 on 43 %, from 0.5 on 72 %.
    True places are interpolated in time between those of the file, every 0.2 s.

    Parameters
    ----------
    folder
        The folder of the files.
    name
        ``intel``, ``m3500`` or ``corridor``.
    least_score
        Least score of a loop candidate that is kept, 0 to 1; for ``corridor`` alone.

    Returns
    -------
    Worlds
        One world: ``graph.position_m`` [1, n, 2] and ``graph.heading_rad`` [1, n], where the search begins
        (for ``corridor`` dead reckoning from the origin), ``graph.fixed`` [1, n], the first pose,
        ``graph.motion_from``, ``graph.motion_to``, ``graph.loop`` [1, e], ``graph.motion`` [1, e, 3],
        ``graph.motion_information`` [1, e, 3, 3], ``graph.near_from``, ``graph.near_to`` [1, f], for
        ``corridor`` also ``graph.near_weight`` [1, f] and ``graph.time_s`` [1, n], and as truth
        ``truth.position_m`` [1, n, 2], NaN where nobody knows it.

    Raises
    ------
    InputError
        For a graph that does not exist, a score out of its range or where there are none, or a file that is
        missing or cannot be read.
    """
    if name not in NAMES:
        raise InputError(
            "pose_graphs, option name", f"{name!r} is none of {', '.join(NAMES)}", "Correct the option"
        )
    if not 0 <= least_score <= 1:
        limit = f"{least_score} is no score from 0 to 1"
        raise InputError("pose_graphs, option least_score", limit, "Correct the option")
    if name == "corridor":
        return _corridor(folder, least_score)
    if least_score:
        limit = f"{name} has no scores, so that {least_score} would have no effect"
        raise InputError("pose_graphs, option least_score", limit, "Leave the option out")
    graph = g2o.read(find_file(folder, FILES[name]))
    truth = {"truth.position_m": np.full((1, len(graph.pose), 2), np.nan)}
    return Worlds(observed=arrays_of(graph), truth=truth)


class Odometry(NamedTuple):
    """Motions between key poses.

    Attributes
    ----------
    motion
        Forward and left, metres, and turn, radians, in the frame of the pose before, [e, 3].
    covariance
        In that frame, [e, 3, 3].
    """

    motion: Array
    covariance: Array


def integrated(key_s: Array, time_s: Array, rate: Array, variance: Array) -> Odometry:
    """Return the motions between key poses that readings of velocity and turn rate tell.

    Parameters
    ----------
    key_s
        Times of the key poses, [n], seconds, increasing, none before the first reading.
    time_s
        Times of the readings, [m], seconds, increasing; each holds until the next one, the last for ever.
    rate
        Forward and left, metres a second, and turn, radians a second, [m, 3].
    variance
        Of ``rate``, [m, 3], each reading with an error of its own for one median interval; an interval of
        another length has the variance of white noise.
    """
    grid_s = np.union1d(time_s[(time_s > key_s[0]) & (time_s < key_s[-1])], key_s)
    step_s = np.diff(grid_s)
    reading = np.searchsorted(time_s, grid_s[:-1], side="right") - 1
    step = rate[reading] * step_s[:, None]
    noise = variance[reading] * (np.median(np.diff(time_s)) * step_s)[:, None]
    before = np.searchsorted(grid_s, key_s)
    owner = np.repeat(np.arange(len(key_s) - 1), np.diff(before))

    heading_rad = np.concatenate([[0.0], np.cumsum(step[:, 2])])
    along_rad = heading_rad[:-1] + 0.5 * step[:, 2]
    way = np.concatenate([[0.0], np.cumsum((step[:, 0] + 1j * step[:, 1]) * np.exp(1j * along_rad))])
    back = np.exp(-1j * heading_rad[before[:-1]])
    moved = (way[before[1:]] - way[before[:-1]]) * back
    motion = np.stack([moved.real, moved.imag, np.diff(heading_rad[before])], axis=-1)

    # What an error of each step does to the end of its motion, in the frame of the pose before it.
    direction = np.exp(1j * along_rad) * back[owner]
    lever = (way[before[1:]][owner] - way[:-1]) * back[owner]
    effect = np.zeros((len(step), 3, 3))
    effect[:, 0, 0] = effect[:, 1, 1] = direction.real
    effect[:, 1, 0], effect[:, 0, 1] = direction.imag, -direction.imag
    effect[:, 0, 2], effect[:, 1, 2], effect[:, 2, 2] = -lever.imag, lever.real, 1.0
    each = (effect * noise[:, None, :]) @ np.swapaxes(effect, -1, -2)
    return Odometry(motion, np.add.reduceat(each, before[:-1], axis=0))


def _corridor(folder: str | Path, least_score: float) -> Worlds:
    log, true = _read(folder, LOG, {"odom2": 7, "loop": 3}), _read(folder, TRUTH, {"point2": 3, "angle": 2})
    odometry, loop, point = log["odom2"], log["loop"], true["point2"]
    key_s = np.unique(loop[:, :2])
    motion, covariance = integrated(key_s, odometry[:, 0], odometry[:, 1:4], odometry[:, 4:])
    number = np.arange(len(key_s))
    pose = np.zeros((len(key_s), 3))
    for end in number[1:]:
        pose[end] = move(pose[end - 1], motion[end - 1])
    kept = loop[loop[:, 2] >= least_score]
    if not len(kept):
        limit = f"no candidate has a score of {least_score} or more"
        raise InputError("pose_graphs, option least_score", limit, "Lower it")
    near = np.sort(np.searchsorted(key_s, kept[:, :2]), axis=1)
    graph = PoseGraph(
        pose=pose,
        motion_from=number[:-1],
        motion_to=number[1:],
        motion=motion,
        motion_information=np.asarray(np.linalg.inv(covariance), dtype=np.float64),
        fixed=number == 0,
        loop=np.zeros(len(motion), dtype=bool),
        near_from=near[:, 0],
        near_to=near[:, 1],
        near_weight=kept[:, 2],
    ).check("pose_graphs, corridor")
    place_m = [np.interp(key_s, point[:, 0], point[:, axis], left=np.nan, right=np.nan) for axis in (1, 2)]
    return Worlds(
        observed={**arrays_of(graph), "graph.time_s": key_s[None]},
        truth={"truth.position_m": np.stack(place_m, axis=-1)[None]},
    )


def _read(folder: str | Path, file: str, columns: dict[str, int]) -> dict[str, NDArray[np.float64]]:
    """Return the first numbers of the lines of each kind, [line, column], times increasing in the first."""
    rows: dict[str, list[list[float]]] = {kind: [] for kind in columns}
    path = find_file(folder, file)
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.split()
        kind, values = (words[0], words[1:]) if words else ("", [])
        try:
            if kind not in columns:
                raise ValueError(f"{kind or 'an empty line'} is none of {', '.join(columns)}")
            if len(values) < columns[kind]:
                raise ValueError(f"{kind} has {len(values)} values, not {columns[kind]}")
            numbers = [float(value) for value in values[: columns[kind]]]
            if not np.isfinite(numbers).all():
                raise ValueError("a value is not finite")
        except ValueError as error:
            raise _unusable(f"{file}, line {number}", str(error)) from error
        rows[kind].append(numbers)
    found = {kind: np.array(values).reshape(-1, columns[kind]) for kind, values in rows.items()}
    for kind, table in found.items():
        if not len(table):
            raise _unusable(file, f"it has no line {kind}")
        later = np.diff(table[:, 0])
        if (later < 0).any() or (kind != "loop" and (later == 0).any()):
            raise _unusable(file, f"the time of the lines {kind} does not increase")
    return found


def _unusable(thing: str, limit: str) -> InputError:
    return InputError(f"pose_graphs, file {thing}", limit, "Use the registered file of data/sources.csv")
