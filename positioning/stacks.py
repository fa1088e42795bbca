"""Recordings side by side: worlds of one run or of several, as one stack of recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Arrays, Calibration, Recording, Site, Survey, Truth

PER_RUN = (
    "position_m",
    "heading_rad",
    "distance_m",
    "path_m",
    "stance_time_s",
    "stance_m",
    "on_point_m",
    "height_m",
    "velocity_m_per_s",
    "attitude_rad",
)
"""What `Truth` holds of every epoch of every run; the rest is known once a world."""

Generators = Sequence[np.random.Generator]


@dataclass(frozen=True, kw_only=True)
class Stack:
    """All recordings of a stack of worlds, with one leading axis r = worlds x runs.

    Attributes
    ----------
    recording, site
        Every array has the leading axis r; what a world knows once stands there for each run.
    survey
        The world's fingerprints, or its calibration run where there are none.
    calibration
        The calibration run, where there is one.
    truth
        For controls.
    generators
        One for every recording: the world's own where it has one run, else its children.
    shape
        (worlds,) or (worlds, runs).
    """

    recording: Recording
    site: Site
    survey: Survey | Calibration | None
    calibration: Calibration | None
    truth: Truth | None
    generators: list[np.random.Generator]
    shape: tuple[int, ...]

    def unstacked(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Give an array [r, ...] the axes of worlds and runs back."""
        return values.reshape(*self.shape, *values.shape[1:])


def stack(observed: Arrays, truth: Arrays | None, generators: Generators) -> Stack:
    """Return the recordings of a stack of worlds.

    Parameters
    ----------
    observed
        Arrays of `Recording` [world, n, ...] or [world, run, n, ...], and of `Site`, `Survey`,
        `Calibration` [world, ...].
    truth
        Arrays of `Truth` for a control: those that a recording has for each epoch are [world, run, n,
        ...], others [world, ...].
    generators
        One a world.

    Raises
    ------
    InputError
        Where there is no recording, or no site.
    """
    recording, site = Recording.from_arrays(observed), Site.from_arrays(observed)
    for name, part in (("recording", recording), ("site", site)):
        if part is None:
            raise InputError("observed worlds", f"they hold no {name}", "Give a study that records motion")
    assert recording is not None
    assert site is not None
    shape = recording.time_s.shape[:-1]
    runs = shape[1] if len(shape) > 1 else 1

    def flat(part: object, per_run: Sequence[str]) -> dict[str, NDArray[np.generic]]:
        values = {f.name: getattr(part, f.name) for f in fields(part)}  # type: ignore[arg-type]
        return {
            name: value.reshape(-1, *value.shape[len(shape) :])
            if name in per_run
            else np.repeat(value, runs, axis=0)
            for name, value in values.items()
            if value is not None
        }

    calibration = Calibration.from_arrays(observed)
    if calibration is not None:
        calibration = Calibration(**flat(calibration, ()))  # type: ignore[arg-type]
    survey = Survey.from_arrays(observed)
    seen = Truth.from_arrays(truth) if truth is not None else None
    return Stack(
        recording=Recording(**flat(recording, [f.name for f in fields(Recording)])),  # type: ignore[arg-type]
        site=Site(**flat(site, ())),  # type: ignore[arg-type]
        survey=calibration if survey is None else Survey(**flat(survey, ())),  # type: ignore[arg-type]
        calibration=calibration,
        truth=None if seen is None else Truth(**flat(seen, PER_RUN)),  # type: ignore[arg-type]
        generators=list(generators)
        if len(shape) == 1
        else [child for rng in generators for child in rng.spawn(runs)],
        shape=shape,
    )
