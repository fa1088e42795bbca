"""Steps of a walker that one row has found and another one builds on."""

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.foot_steps import Steps
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

    Parameters
    ----------
    recording
        Stack with ``step_time_s`` and so on, [r, s] each, NaN behind the last step of a recording.

    Raises
    ------
    InputError
        For steps of which a part is missing, that do not fit each other or the recordings, are not in the
        order of time, or have a part that is not finite.
    """
    names = [PREFIX + name for name in Steps._fields]
    given = {name: getattr(recording, name) for name in names}
    missing = [name for name, values in given.items() if values is None]
    if len(missing) == len(names):
        return None
    if missing:
        raise InputError("recording", f"its steps lack {', '.join(missing)}", f"Give {', '.join(names)}")
    arrays = {name: np.asarray(values, dtype=float) for name, values in given.items()}
    shapes = {name: values.shape for name, values in arrays.items()}
    shape, count = shapes[names[0]], len(recording.time_s)
    if len(set(shapes.values())) > 1 or len(shape) != 2 or shape[0] != count:
        raise InputError(
            "recording",
            f"the shapes of its steps are {shapes}, not ({count}, s) each",
            "Give all for each step",
        )
    time_s = arrays[names[0]]
    there = ~np.isnan(time_s)
    _refuse(names[0], np.isinf(time_s), "the time is infinite", "Give seconds")
    _refuse(names[0], there[:, 1:] & ~there[:, :-1], "a time before is missing", "Use NaN after the end only")
    with np.errstate(invalid="ignore"):
        _refuse(names[0], np.diff(time_s, axis=1) < 0, "a step after it ends earlier", "Sort steps by time")
    for name in names[1:]:
        _refuse(name, there & ~np.isfinite(arrays[name]), "it is not a finite number", "Leave the step out")
    return Steps(*arrays.values())


def _refuse(name: str, bad: NDArray[np.bool_], limit: str, cure: str) -> None:
    if bad.any():
        where = ", ".join(str(i) for i in np.argwhere(bad)[0])
        raise InputError(f"recording.{name}[{where}]", limit, cure)
