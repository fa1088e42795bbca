"""A foot that carries an inertial measurement unit, walking and running in a motion-capture room.

Measured by B. Wagstaff, V. Peretroukhin and J. Kelly (University of Toronto) in 14 trials.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array, Recording, Site, Truth, Worlds
from positioning.recordings.mat_file import read_mat
from positioning.recordings.register import find_file, unreadable

NAMES = (
    "2017-11-22-11-22-03",
    "2017-11-22-11-36-45",
    "2017-11-22-11-39-47",
    "2017-11-22-11-49-03",
    "2017-11-22-11-49-29",
    "2017-11-22-11-50-42",
    "2017-11-22-11-52-02",
    "2017-11-27-11-11-24",
    "2017-11-27-11-12-18",
    "2017-11-27-11-13-41",
    "2017-12-15-17-59-19",
    "2017-12-15-18-00-13",
    "2017-12-15-18-01-18",
    "2018-02-09-11-32-01",
)
"""The trials, by the time of their start."""

DETECTORS = ("vicon", "shoe", "ared", "amvd", "mbgtd")
"""Rest labels that stand in the files."""

LABELS = ("best", *DETECTORS)

SENSOR_AXES = np.array([1.0, -1.0, -1.0])
"""Sensor to the frame of the project, axis by axis: the unit hangs upside down, its z axis points down."""

ROOM_AXES = np.array([1.0, -1.0, 1.0])
"""The tracker's frame is left-handed: its y axis is turned round."""

ROOM_M = ((-2.5, -2.5), (2.5, 2.5))
"""The room of 5 m by 5 m about the tracker's origin."""

EPOCH_READINGS = 20
"""Every so many readings are an epoch: at 200 Hz, one every 0.1 s."""

HELD_READINGS = 4
"""A place that so many readings share to the last digit was held by the tracker, which had lost the foot."""

EPOCHS = ("all", "stances")

STILL_M_PER_S, STILL_S, STILL_SPAN = 0.3, 0.05, 5
"""By the tracker, a foot stands where it is slower than this for so long; its speed is taken over so many
readings before and after, for the tracker jumps by centimetres."""

LEAST_STRIDE_M = 0.3
"""Two places where the foot stands are a stride apart when they are farther from each other than this."""


class _Trial(NamedTuple):
    """One file, in the frames of the project."""

    time_s: Array
    force_m_per_s2: Array
    rate_rad_per_s: Array
    foot_m: Array
    rest: NDArray[np.bool_]


class _Standing(NamedTuple):
    """Stances by the tracker: index of the first and of the last still reading, [k], and place, [k, 2], m."""

    begin: NDArray[np.intp]
    last: NDArray[np.intp]
    place_m: Array


class Start(NamedTuple):
    """How a dead-reckoned track is laid into the frame of the truth.

    Attributes
    ----------
    position_m
        Place of the foot before its first stride, [2], metres.
    heading_rad
        Direction from there to where it stands after the last stride of the alignment, radians from the x
        axis to the left.
    """

    position_m: Array
    heading_rad: float


def load(
    folder: str | Path,
    *,
    name: str = NAMES[0],
    epochs: str = "all",
    labels: str = "best",
    align_strides: int = 1,
) -> Worlds:
    """Load one trial: readings of the foot's sensors, and where the foot truly was.

    Every twentieth reading is an epoch, at 200 Hz one every 0.1 s; the true place is the tracker's at that
    reading, of the foot and not of the body. Or epochs are the last still readings of the stances: what
    reckons by steps knows places at stances only, and a detector tells of a stance some time after it began,
    so that in its middle the step to it may still be missing. The true place is then the median over the
    stance. These stances are those of the tracker: speed below 0.3 m/s for 0.05 s, and 0.3 m from the stance
    before; a foot that is still again nearer to it is in the same stance. With 0.5 m/s they are as many; with
    0.2 m/s for 0.1 s most stances of the running trials are missed.

    Two frames need a turn. The unit hangs upside down: x stays, y and z change their sign, so that the
    specific force at rest points up along z. Then x is forward along the foot to about 10 degrees, but in the
    last trial, where the unit sits about 125 degrees to the left of it; it is tilted by 15 to 30 degrees, and
    a filter has to level it. The tracker's frame is left-handed: with its y axis as recorded, tracks of the
    sensors fit at 1.6 m, with it turned round at 0.1 m.

    Nobody noted where the trials start, or in which direction, in the frame of the tracker. Both come from
    the truth: the place before the first stride, and the direction from there to where the foot stands after
    ``align_strides`` strides. These epochs are therefore not scored. The people walk in circles and turn by
    50 to 90 degrees a stride, so more than one stride says little of a direction.

    The tracker lost the foot at times and held its last place, up to 0.5 s, and then jumped by up to 1 m:
    such epochs have no truth. What is left still jumps by up to 0.1 m.

    Rest labels were tuned to the truth by the publishers. They are truth, and only controls may see them.
    ``vicon`` is the tracker's speed below a threshold: where it held a place, it says rest in mid-swing,
    which spoils 5 of the 14 trials. Labels flicker; each run of them is a stance of its own, down to one
    reading.

    Parameters
    ----------
    folder
        The folder of the files.
    name
        The trial, by the time of its start, as in ``NAMES``. In those of 2017-11-22 from 11-49-03 on the
        foot rests for less than a second before it moves.
    epochs
        ``all`` or ``stances``, the last still reading of each.
    labels
        Which labels are the true stances, which are not those of the epochs: ``best`` (those that the
        publishers found best in this trial), ``vicon``, ``shoe``, ``ared``, ``amvd`` or ``mbgtd``.
    align_strides
        How many first strides serve for the alignment, at least 1.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], the room, ``recording.time_s`` [1, n],
        ``recording.imu_time_s`` [1, i], as in the file, where the first reading ends at 0.005 s,
        ``recording.specific_force_m_per_s2`` and ``recording.angular_rate_rad_per_s`` [1, i, 3],
        ``recording.start_heading_rad`` [1] and ``recording.start_position_m`` [1, 2], and as truth
        ``truth.position_m`` [1, n, 2], NaN in the alignment and where the tracker held a place,
        ``truth.path_m`` [1, n, 2], NaN only there, ``truth.stance_time_s`` [1, s, 2], times of the first and
        the last reading of each stance, and ``truth.stance_m`` [1, s, 3], means of the places in it, NaN
        where all were held.

    Raises
    ------
    InputError
        For an option that does not exist, more strides than there are, or a file that is missing or is not
        this data set's.
    """
    for option, value, known in (
        ("name", name, NAMES),
        ("epochs", epochs, EPOCHS),
        ("labels", labels, LABELS),
    ):
        if value not in known:
            raise InputError(
                f"foot_imu_mocap, option {option}",
                f"{value!r} is none of {', '.join(known)}",
                "Correct the option",
            )
    check_strides("foot_imu_mocap", align_strides)
    trial = _read(folder, f"{name}.mat", labels)
    held = _held(trial.foot_m)
    standing = _standing(trial.time_s, trial.foot_m, held)
    start = start_of("foot_imu_mocap", standing.place_m, align_strides)

    if epochs == "stances":
        epoch, path_m = standing.last, standing.place_m
        scored = np.arange(len(epoch)) > align_strides
    else:
        epoch = np.arange(0, len(trial.time_s), EPOCH_READINGS)
        path_m = np.where(held[epoch, None], np.nan, trial.foot_m[epoch, :2])
        scored = epoch > standing.begin[align_strides]
    time_s = trial.time_s[epoch]
    begin, end = runs_of(trial.rest)

    site = Site(corner_m=np.array([ROOM_M]))
    recording = Recording(
        time_s=time_s[None],
        imu_time_s=trial.time_s[None],
        specific_force_m_per_s2=trial.force_m_per_s2[None],
        angular_rate_rad_per_s=trial.rate_rad_per_s[None],
        start_heading_rad=np.array([start.heading_rad]),
        start_position_m=start.position_m[None],
    )
    truth = Truth(
        position_m=np.where(scored[:, None], path_m, np.nan)[None],
        path_m=path_m[None],
        stance_time_s=np.stack([trial.time_s[begin], trial.time_s[end - 1]], axis=-1)[None],
        stance_m=_mean_of_runs(trial.foot_m, ~held, begin, end)[None],
    )
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())


def start_of(source: str, standing_m: Array, align_strides: int) -> Start:
    """Return place and direction of the first strides.

    Parameters
    ----------
    source
        Name of the data set, for the error.
    standing_m
        Where the foot stands, one place a stance, [k, 2], metres.
    align_strides
        How many strides to take.

    Raises
    ------
    InputError
        Where there are not more strides than that.
    """
    if len(standing_m) < align_strides + 2:
        raise InputError(
            f"{source}, option align_strides",
            f"{align_strides} of {len(standing_m) - 1} strides would leave none to score",
            "Take fewer strides",
        )
    way_m = standing_m[align_strides] - standing_m[0]
    return Start(position_m=standing_m[0], heading_rad=float(np.arctan2(way_m[1], way_m[0])))


def check_strides(source: str, align_strides: int) -> None:
    """Refuse a number of strides that is none.

    Raises
    ------
    InputError
        For anything but a whole number above zero.
    """
    if not isinstance(align_strides, int) or isinstance(align_strides, bool) or align_strides < 1:
        raise InputError(
            f"{source}, option align_strides",
            f"{align_strides!r} is no whole number above zero",
            "Take at least one stride",
        )


def runs_of(marked: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the index where each run of marked samples begins, and the one behind its end, each [s]."""
    change = np.diff(marked.astype(np.int8), prepend=0, append=0)
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def _held(foot_m: Array) -> NDArray[np.bool_]:
    """Mark readings at which the tracker held a place, [i]."""
    begin, end = runs_of((np.diff(foot_m, axis=0) == 0).all(axis=1))
    held = np.zeros(len(foot_m), dtype=bool)
    # A run of equal steps has one place more than steps.
    for first, last in zip(begin, end + 1, strict=True):
        held[first:last] = last - first >= HELD_READINGS
    return held


def _standing(time_s: Array, foot_m: Array, held: NDArray[np.bool_]) -> _Standing:
    index = np.arange(len(time_s))
    before, after = np.maximum(index - STILL_SPAN, 0), np.minimum(index + STILL_SPAN, len(time_s) - 1)
    speed_m_per_s = np.linalg.norm(foot_m[after] - foot_m[before], axis=1) / (time_s[after] - time_s[before])
    begin: list[int] = []
    still: list[int] = []
    place_m: list[Array] = []
    for first, last in zip(*runs_of((speed_m_per_s < STILL_M_PER_S) & ~held), strict=True):
        here_m = np.median(foot_m[first:last, :2], axis=0)
        if time_s[last - 1] - time_s[first] < STILL_S:
            continue
        if place_m and np.linalg.norm(here_m - place_m[-1]) <= LEAST_STRIDE_M:
            still[-1] = last - 1
            continue
        begin.append(first)
        still.append(last - 1)
        place_m.append(here_m)
    return _Standing(np.array(begin, np.intp), np.array(still, np.intp), np.reshape(place_m, (-1, 2)))


def _mean_of_runs(
    place_m: Array, known: NDArray[np.bool_], begin: NDArray[np.intp], end: NDArray[np.intp]
) -> Array:
    """Return the mean over the known places of each run, [s, 3], metres; NaN where it has none."""
    total_m = np.concatenate([np.zeros((1, 3)), np.cumsum(place_m * known[:, None], axis=0)])
    count = np.concatenate([[0], np.cumsum(known)])
    share = (count[end] - count[begin])[:, None]
    return np.where(share > 0, (total_m[end] - total_m[begin]) / np.maximum(share, 1), np.nan)


def _read(folder: str | Path, file: str, labels: str) -> _Trial:
    path = find_file(folder, file)
    try:
        content = read_mat(path)
        if labels == "best":
            labels = str(np.ravel(content["best_detector"])[0]).strip()
        if labels not in DETECTORS:
            raise ValueError(f"{labels!r} is no detector")
        imu, foot_m = (np.asarray(content[key], dtype=float) for key in ("imu", "gt"))
        time_s, label = (
            np.ravel(np.asarray(content[key], dtype=float)) for key in ("ts", f"zv_{labels}_opt")
        )
        count = len(time_s)
        if imu.shape != (count, 6) or foot_m.shape != (count, 3) or label.shape != (count,) or count < 2:
            raise ValueError(f"imu {imu.shape}, gt {foot_m.shape} and labels {label.shape} do not fit ts")
        if not all(np.isfinite(values).all() for values in (imu, foot_m, time_s, label)):
            raise ValueError("a value is not finite")
        if (np.diff(time_s) <= 0).any():
            raise ValueError("the time does not increase")
    except (ValueError, TypeError, LookupError) as error:
        what = "the arrays imu, ts, gt, best_detector and the labels"
        raise unreadable("foot_imu_mocap", file, what, error) from error
    return _Trial(
        time_s=time_s,
        force_m_per_s2=imu[:, :3] * SENSOR_AXES,
        rate_rad_per_s=imu[:, 3:] * SENSOR_AXES,
        foot_m=foot_m * ROOM_AXES,
        rest=label > 0,
    )
