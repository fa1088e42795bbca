"""A foot that carries an inertial measurement unit and ends where it started.

Published by x-io Technologies with its gait-tracking program: one walk of about 25 m.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from positioning.model import Recording, Site, Truth, Worlds
from positioning.recordings.foot_imu_corridor import STANDARD_GRAVITY_M_PER_S2
from positioning.recordings.register import find_file, unreadable

FILE = "short_walk.csv"

COLUMNS = (
    "Time (s)",
    *(f"Accelerometer {axis} (g)" for axis in "XYZ"),
    *(f"Gyroscope {axis} (deg/s)" for axis in "XYZ"),
)

REACH_M = 12.5
"""A closed walk of 25 m comes no farther from its start than this: half the side of the site."""


def load(folder: str | Path) -> Worlds:
    """Load the walk, of which nothing is known but that it is closed.

    Two epochs: the first and the last reading. The start is the origin by definition and is not scored; the
    true end is the origin again, so the error of the one epoch that counts is the closure of the loop. It
    says little of the heading, and nothing of the scale. The publisher's own tracker closes the loop to
    0.082 m.

    Nothing tells a direction: x is where the walk begins to go. The unit's axes are those of the project, x
    forward and z up, tilted by about 30 degrees on the instep. Angular rates are in degrees a second and
    accelerations in g in the file. Times are as recorded: 2.5 ms apart, and 4 to 12.6 ms where readings were
    lost, 165 times. 205 rows repeat the row before, with its time; they are left out.

    Parameters
    ----------
    folder
        The folder of the file.

    Returns
    -------
    Worlds
        One world: ``site.corner_m`` [1, 2, 2], a square about the start that the walk cannot leave,
        ``recording.time_s`` [1, 2], ``recording.imu_time_s`` [1, i] from the first reading,
        ``recording.specific_force_m_per_s2`` and ``recording.angular_rate_rad_per_s`` [1, i, 3],
        ``recording.start_heading_rad`` [1] and ``recording.start_position_m`` [1, 2], zero, and as truth
        ``truth.position_m`` [1, 2, 2], NaN at the start, and ``truth.path_m`` [1, 2, 2].

    Raises
    ------
    InputError
        For a file that is missing or is not this data set's.
    """
    path = find_file(folder, FILE)
    try:
        values = pd.read_csv(path, usecols=list(COLUMNS), dtype=float)[list(COLUMNS)].to_numpy()
        if not len(values) or not np.isfinite(values).all():
            raise ValueError("there is no row, or a cell is empty or not finite")
        values = values[np.append(True, (np.diff(values, axis=0) != 0).any(axis=1))]
        if len(values) < 2 or (np.diff(values[:, 0]) <= 0).any():
            raise ValueError("the time does not increase")
    except (ValueError, TypeError) as error:
        raise unreadable("foot_imu_loop", FILE, f"the columns {', '.join(COLUMNS)}", error) from error
    time_s = values[:, 0] - values[0, 0]
    force_m_per_s2 = values[:, 1:4] * STANDARD_GRAVITY_M_PER_S2
    site = Site(corner_m=np.array([[[-REACH_M, -REACH_M], [REACH_M, REACH_M]]]))
    recording = Recording(
        time_s=time_s[[0, -1]][None],
        imu_time_s=time_s[None],
        specific_force_m_per_s2=force_m_per_s2[None],
        angular_rate_rad_per_s=np.radians(values[:, 4:])[None],
        start_heading_rad=np.zeros(1),
        start_position_m=np.zeros((1, 2)),
    )
    truth = Truth(
        position_m=np.array([[[np.nan, np.nan], [0.0, 0.0]]]),
        path_m=np.zeros((1, 2, 2)),
    )
    return Worlds(observed={**site.to_arrays(), **recording.to_arrays()}, truth=truth.to_arrays())
