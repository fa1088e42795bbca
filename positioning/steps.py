"""Steps of a walker that one row has found and another one builds on."""

import numpy as np

from positioning.inertial.foot import Steps
from positioning.model import Array, Arrays, Recording

PREFIX = "step_"


def to_extra(steps: Steps) -> dict[str, Array]:
    """Return steps as what a track keeps beside places: ``step_time_s`` and so on, [r, s].

    See Frank et al., Figure 3: the lower filter hands its steps up.
    """
    return {PREFIX + name: np.asarray(values) for name, values in steps._asdict().items()}


def of_extra(estimates: Arrays) -> dict[str, Array]:
    """Return the steps that a tracking row has kept, as fields of the recordings that it ran on.

    See Frank et al., Figure 3.

    Parameters
    ----------
    estimates
        ``extra_step_time_s`` and so on, [world, ..., s], as the task tracking leaves them; empty where the
        row was skipped.

    Returns
    -------
    dict
        ``recording.step_time_s`` and so on; empty where there are none.
    """
    names = [PREFIX + name for name in Steps._fields]
    if not all(f"extra_{name}" in estimates for name in names):
        return {}
    return {f"recording.{name}": np.asarray(estimates[f"extra_{name}"], dtype=float) for name in names}


def of_recording(recording: Recording) -> Steps | None:
    """Return the steps that stand in recordings, None where there are none.

    See Frank et al., Figure 3.
    """
    if recording.step_time_s is None:
        return None
    return Steps(*(np.asarray(getattr(recording, PREFIX + name), dtype=float) for name in Steps._fields))
