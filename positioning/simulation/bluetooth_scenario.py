"""The scenario of Fig. 4 as a world of one epoch: three beacons, three measured distances, one place.

See Raghavan et al., section V.A and Fig. 4. Nothing is random: what the solvers make of it is exact.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from positioning.errors import InputError
from positioning.model import Recording, Site, Truth, Worlds
from positioning.simulation.settings import numbers, rows


def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
    """Return the same world for each generator.

    See Raghavan et al., section V.A and Fig. 4.

    Parameters
    ----------
    settings
        All of: ``size_m`` [x, y], ``beacons_m`` [beacon, 2], ``range_m`` [beacon], ``position_m`` [x, y].
        Other keys are left alone.
    rngs
        Their number is the number of worlds; nothing is drawn.

    Returns
    -------
    Worlds
        Observed ``site.corner_m`` [world, 2, 2], ``site.access_point_m`` [world, beacon, 2],
        ``recording.time_s`` [world, 1], ``recording.range_m`` [world, 1, beacon]; truth
        ``truth.position_m`` [world, 1, 2].

    Raises
    ------
    InputError
        For a setting that is missing or senseless, or no generator.
    """
    size_m = numbers(settings, "size_m", 2, least=0)
    beacon_m = rows(settings, "beacons_m", 2, least=3)
    range_m = numbers(settings, "range_m", len(beacon_m))
    position_m = numbers(settings, "position_m", 2)
    if min(range_m) <= 0:
        raise InputError("setting range_m", f"{min(range_m)} is not positive", "Give distances in metres")
    if not rngs:
        raise InputError("rngs", "there is no world to draw", "Give one generator for each world")
    site = Site(corner_m=np.array([[0.0, 0.0], size_m]), access_point_m=beacon_m)
    recording = Recording(time_s=np.zeros(1), range_m=np.array([range_m]))
    truth = Truth(position_m=np.array([position_m]))
    observed, true = (
        {name: np.stack([values] * len(rngs)) for name, values in arrays.items()}
        for arrays in ({**site.to_arrays(), **recording.to_arrays()}, truth.to_arrays())
    )
    return Worlds(observed=observed, truth=true)
