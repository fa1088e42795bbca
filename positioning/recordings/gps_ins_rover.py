"""A rover with an inertial measurement unit and GPS, driving outdoors at 0.4 m/s.

Measured by O. Lamarre, O. Limoyo, F. Maric and J. Kelly (University of Toronto) on a terrain of the Canadian
Space Agency: the first half of one run.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from positioning.errors import InputError
from positioning.inertial.geodetic import attitude_of, position_scale_m, roll_pitch_yaw, to_local
from positioning.model import Array, Recording, Site, Truth, Worlds
from positioning.recordings.register import find_file, unreadable

IMU, GPS, REFERENCE = "imu.csv", "gps_raw.csv", "reference_pose.csv"

COLUMNS = {
    IMU: ("t_s", "fx_mps2", "fy_mps2", "fz_mps2", "wx_radps", "wy_radps", "wz_radps"),
    GPS: ("t_s", "lat_deg", "lon_deg", "alt_m", "e_m", "n_m", "u_m"),
    REFERENCE: ("t_s", "e_m", "n_m", "u_m", "qx", "qy", "qz", "qw"),
}

BODY_OF_UNIT = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From the axes of the unit, x right, y backwards, z down, to those of the body, x forward, y right."""

PRINTED_LEVER_ARM_M = (-0.156, 0.511, 0.004)
"""From the unit to the antenna, printed without a word on its axes and its sign."""

LEVER_ARMS = ("none", "printed", "turned")
"""How the printed lever arm is read."""

REST_S = 1.0
"""The rover stands for so long at least before it drives off."""

COURSE_STEP_S = 0.5
"""The course is that of displacements over so long."""

MOST_MISFIT_M = 0.01
"""Both columns of GPS, geodetic and grid, agree to this after a turn and a change of scale."""

MARGIN_M = 5.0
"""The site reaches so far beyond the track and the GPS."""

_ENU_TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_UP_TO_DOWN = np.diag([1.0, -1.0, -1.0])


class _Files(NamedTuple):
    """The three tables, each with time in its first column."""

    imu: Array
    gps: Array
    reference: Array


def load(
    folder: str | Path,
    *,
    outage_from_s: float | None = None,
    outage_s: float = 40.0,
    gps_interval_s: float = 1.0,
    align_s: float = 20.0,
    settle_s: float = 25.0,
    lever_arm: str = "none",
) -> Worlds:
    """Load the drive: readings of the unit, GPS, and the reference poses.

    Epochs are the times of the reference poses, about 2.2 a second. The reference is the publishers' own
    fusion of the sensors, not a survey: GPS is off it by about 1 m horizontally. It takes time to settle: in
    its first 20 s its heading jumps by up to 20 degrees against the gyroscope, and its place by 1 m between
    two poses. Epochs before ``settle_s`` have no true position and attitude; ``truth.path_m`` holds them.

    Axes. The unit does not sit as its column names suggest: against the attitudes of the reference, x of the
    unit points to the right and y backwards (pitch follows y of the accelerometer and minus x of the
    gyroscope, roll minus x and minus y). Readings are turned into the body, x forward, y right, z down.

    Lever arm. One is printed, without a word on its axes and its sign, and the files cannot decide them. GPS
    less the antenna's place by the reference, root mean square over the epochs from 25 s on, is 1.00 m
    without a lever arm, 1.13 m with the printed numbers along the body's axes, and 1.37 m with them turned
    like the readings; turned and of opposite sign they give 0.84 m. The reference is made of the same
    sensors, nobody says to which point of the rover it belongs, and errors of GPS change more slowly than the
    rover turns. None is used unless asked for.

    Frames. The grid (UTM 18T) of the reference is turned by 1.15 degrees against true north and shrunk by
    2e-4. Both come from the GPS rows, which hold geodetic and grid coordinates; places and attitudes of the
    reference are turned back. The origin of the local frame is the first GPS row. Heights are those of the
    files, without a word on geoid or ellipsoid; a geoid would change gravity by 1e-4 m/s^2.

    Start. The rover stands during the first second of the readings: place from the mean of GPS until its
    end, less a lever arm if there is one, velocity zero, roll and pitch from the mean specific force. Nobody
    noted the heading, and the reference tells none before it settles. It comes from GPS and gyroscope over
    the first ``align_s`` seconds: the heading with which the displacements of the antenna, turned back by the
    gyroscope, point forward on the mean. 10 to 180 s give the same within 3 degrees, some 3 degrees off the
    settled reference. GPS rows before the first reading are not part of the recording.

    GPS came 20 times a second with errors whose correlation falls to a half after 4.5 s: an independent row
    every 0.05 s it is not. One every ``gps_interval_s`` is kept. It gives no velocity.

    Parameters
    ----------
    folder
        The folder of the files.
    outage_from_s
        Where an outage of the GPS begins, seconds on the clock of the files; None for no outage. The rows
        stay in the recording.
    outage_s
        How long it lasts, seconds.
    gps_interval_s
        Least time between GPS rows that are kept, seconds; 0 keeps all.
    align_s
        How long GPS and gyroscope serve to find the heading at the start, seconds; at least 10.
    settle_s
        Time of the first epoch that is scored, seconds on the clock of the files.
    lever_arm
        From the unit to the antenna: ``none``, zeros; ``printed``, the printed numbers along x forward, y
        right, z down; ``turned``, the same numbers along the axes of the unit.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2] and ``site.origin_geodetic`` [1, 3], ``recording.time_s``
        [1, n], ``recording.imu_time_s`` [1, i], ``recording.specific_force_m_per_s2`` and
        ``recording.angular_rate_rad_per_s`` [1, i, 3] in the body, ``recording.gps_time_s`` [1, g],
        ``recording.gps_geodetic`` [1, g, 3], ``recording.gps_lever_arm_m`` [1, 3],
        ``recording.gps_outage_s`` [1, 2], NaN for none, ``recording.start_geodetic``,
        ``start_velocity_m_per_s`` and ``start_attitude_rad`` [1, 3], and as truth ``truth.position_m``
        [1, n, 2], NaN before ``settle_s``, ``truth.path_m`` [1, n, 2], ``truth.height_m`` [1, n] and
        ``truth.attitude_rad`` [1, n, 3], NaN as well.

    Raises
    ------
    InputError
        For an option out of its limits, or a file that is missing or is not this data set's.
    """
    options = partial(
        _check_options,
        lever_arm=lever_arm,
        outage_from_s=outage_from_s,
        outage_s=outage_s,
        gps_interval_s=gps_interval_s,
        align_s=align_s,
        settle_s=settle_s,
    )
    # First for a drive without an end: what is wrong anyhow is told before any file is read.
    options(np.inf)
    files = _Files(*(_read(folder, file) for file in (IMU, GPS, REFERENCE)))
    options(min(table[-1, 0] for table in files))
    imu_time_s = files.imu[:, 0]
    force_m_per_s2, rate_rad_per_s = files.imu[:, 1:4] @ BODY_OF_UNIT.T, files.imu[:, 4:] @ BODY_OF_UNIT.T
    geodetic = np.column_stack([np.radians(files.gps[:, 1:3]), files.gps[:, 3]])
    origin = geodetic[0]
    antenna_m = to_local(geodetic, origin)
    grid = _grid(files.gps, antenna_m)

    epoch_s = files.reference[:, 0]
    flat_m = (files.reference[:, 1] + 1j * files.reference[:, 2]) / grid
    path_m = np.stack([flat_m.real, flat_m.imag], axis=-1)
    settled = epoch_s >= settle_s
    attitude_rad = _reference_attitude_rad(files.reference[:, 4:], float(np.angle(grid)))

    rest = imu_time_s < imu_time_s[0] + REST_S
    levelled = _levelled_rad(force_m_per_s2[rest].mean(axis=0))
    heading_rad = _course_rad(
        imu_time_s, rate_rad_per_s[:, 2], files.gps[:, 0], antenna_m, (imu_time_s[0] + REST_S, align_s)
    )
    start_rad = np.array([*levelled, heading_rad])
    lever_arm_m = _lever_arm_m(lever_arm)
    standing = geodetic[files.gps[:, 0] < imu_time_s[0] + REST_S].mean(axis=0)
    start = standing - attitude_of(start_rad) @ lever_arm_m / position_scale_m(standing)

    kept = _thinned(files.gps[:, 0], gps_interval_s) & (files.gps[:, 0] >= imu_time_s[0])
    known_m = np.concatenate([path_m, antenna_m[:, :2]])
    outage = (np.nan, np.nan) if outage_from_s is None else (outage_from_s, outage_from_s + outage_s)
    site = Site(
        corner_m=np.stack([known_m.min(axis=0) - MARGIN_M, known_m.max(axis=0) + MARGIN_M])[None],
        origin_geodetic=origin[None],
    )
    recording = Recording(
        time_s=epoch_s[None],
        imu_time_s=imu_time_s[None],
        specific_force_m_per_s2=force_m_per_s2[None],
        angular_rate_rad_per_s=rate_rad_per_s[None],
        gps_time_s=files.gps[kept, 0][None],
        gps_geodetic=geodetic[kept][None],
        gps_lever_arm_m=lever_arm_m[None],
        gps_outage_s=np.array([outage]),
        start_geodetic=start[None],
        start_velocity_m_per_s=np.zeros((1, 3)),
        start_attitude_rad=start_rad[None],
    )
    truth = Truth(
        position_m=np.where(settled[:, None], path_m, np.nan)[None],
        path_m=path_m[None],
        height_m=files.reference[None, :, 3],
        attitude_rad=np.where(settled[:, None], attitude_rad, np.nan)[None],
    )
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())


def _lever_arm_m(lever_arm: str) -> Array:
    """Return the lever arm in the body, [3]."""
    along = {"none": np.zeros((3, 3)), "printed": np.eye(3), "turned": BODY_OF_UNIT}[lever_arm]
    return np.asarray(along @ np.array(PRINTED_LEVER_ARM_M))


def _check_options(
    end_s: float, lever_arm: str, *, outage_from_s: float | None, outage_s: float, **others: float
) -> None:
    """Refuse options outside the drive, which ends at ``end_s``."""
    if lever_arm not in LEVER_ARMS:
        raise InputError(
            "gps_ins_rover, option lever_arm", f"{lever_arm!r} is not known", f"Take one of {LEVER_ARMS}"
        )
    least = {"gps_interval_s": 0.0, "align_s": 10.0, "settle_s": 0.0}
    begins_s = others["align_s"] if outage_from_s is None else outage_from_s
    limits = {name: (value, least[name], end_s) for name, value in others.items()}
    limits |= {"outage_from_s": (begins_s, others["align_s"], end_s)}
    limits |= {"outage_s": (outage_s, 0.0, end_s if outage_from_s is None else end_s - begins_s)}
    for name, (value, low, high) in limits.items():
        # NaN is outside as well.
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            words = f"from {low:g} s on" if np.isinf(high) else f"from {low:g} to {high:.0f} s"
            raise InputError(
                f"gps_ins_rover, option {name}",
                f"{value!r} is not a number {words}",
                "Stay within the drive, and let an outage begin after the alignment",
            )


def _grid(gps: Array, antenna_m: Array) -> complex:
    """Return the complex number that leads from the local frame to the grid: its scale, and its turn."""
    local, grid = antenna_m[:, 0] + 1j * antenna_m[:, 1], gps[:, 4] + 1j * gps[:, 5]
    factor = complex(np.vdot(local, grid) / np.vdot(local, local).real)
    misfit_m = float(np.abs(grid - factor * local).max())
    if not misfit_m <= MOST_MISFIT_M:
        raise InputError(
            f"gps_ins_rover, file {GPS}",
            f"geodetic and grid coordinates disagree by {misfit_m:.3f} m",
            "Use the registered file of data/sources.csv",
        )
    return factor


def _reference_attitude_rad(quaternion: Array, convergence_rad: float) -> Array:
    """Return roll, pitch and yaw against true north of attitudes against the grid, [n, 3], radians."""
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    attitude = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    angles = roll_pitch_yaw(_ENU_TO_NED @ attitude @ _UP_TO_DOWN)
    # A direction has a smaller yaw, clockwise from north, in a frame that is turned clockwise; the grid's
    # coordinates are the local ones turned to the left by the convergence.
    angles[:, 2] += convergence_rad
    angles[:, 2] = np.remainder(angles[:, 2] + np.pi, 2 * np.pi) - np.pi
    return angles


def _levelled_rad(force_m_per_s2: Array) -> tuple[float, float]:
    """Return roll and pitch of a resting body, radians."""
    forward, right, down = force_m_per_s2
    return float(np.arctan2(-right, -down)), float(np.arctan2(forward, np.hypot(right, down)))


def _course_rad(
    imu_time_s: Array,
    turn_rate_rad_per_s: Array,
    gps_time_s: Array,
    antenna_m: Array,
    span_s: tuple[float, float],
) -> float:
    """Return the yaw at the first reading with which the rover drives forward on the mean of a time span."""
    turned_rad = np.concatenate([[0.0], np.cumsum(turn_rate_rad_per_s[1:] * np.diff(imu_time_s))])
    sample_s = np.arange(span_s[0], span_s[1] + 1e-9, COURSE_STEP_S)
    # North on the real axis, east on the imaginary one: angles are then clockwise, like yaw.
    place = np.interp(sample_s, gps_time_s, antenna_m[:, 1]) + 1j * np.interp(
        sample_s, gps_time_s, antenna_m[:, 0]
    )
    middle_rad = np.interp(0.5 * (sample_s[1:] + sample_s[:-1]), imu_time_s, turned_rad)
    return float(np.angle(np.sum(np.diff(place) * np.exp(-1j * middle_rad))))


def _thinned(time_s: Array, interval_s: float) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mark the first row of each interval, counted from the first row."""
    if interval_s == 0:
        return np.ones(len(time_s), dtype=bool)
    return np.asarray(np.diff((time_s - time_s[0]) // interval_s, prepend=-1) > 0)


def _read(folder: str | Path, file: str) -> Array:
    path = find_file(folder, file)
    columns = list(COLUMNS[file])
    try:
        values = pd.read_csv(path, usecols=columns, dtype=float)[columns].to_numpy()
        if len(values) < 2 or not np.isfinite(values).all():
            raise ValueError("there are fewer than two rows, or a cell is empty or not finite")
        if (np.diff(values[:, 0]) <= 0).any():
            raise ValueError("the time does not increase")
    except (ValueError, TypeError) as error:
        raise unreadable("gps_ins_rover", file, f"the columns {', '.join(columns)}", error) from error
    return np.asarray(values)
