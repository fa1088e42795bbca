"""The synthetic worlds of the study graph_slam with dead reckoning from simulated inertial readings.

See Gu et al., section III.A. Walks, building and radio are those of `positioning.simulation.graph_slam`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from positioning.model import Worlds
from positioning.simulation import graph_slam


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Draw one world for each generator; see `positioning.simulation.graph_slam.simulate`.

    See Gu et al., section III.A. Half a minute a world.

    Parameters
    ----------
    settings
        As there, and ``gait``, ``accelerometer``, ``gyro`` and ``foot_filter``: fields of
        `positioning.simulation.gait.Gait`, `positioning.simulation.imu.Triad` and
        `positioning.inertial.foot_settings.FootFilter`; ``imu_rate_hz``.
    rngs
        One generator for each world; equal seeds give worlds that differ in the dead reckoning alone.

    Raises
    ------
    InputError
        As there.
    """
    return graph_slam.simulate({**settings, "dead_reckoning": "imu"}, rngs)
