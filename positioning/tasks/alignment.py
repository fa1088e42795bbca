"""Alignment: from walks in frames of their own to walks in one frame."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.answers import checked_answer, checked_array, stacked_extra
from positioning.geometry import rigid_fit, rotated
from positioning.model import Aligned, Arrays, Truth, Walks, world
from positioning.registry import Factory
from positioning.tasks import Outcome

OPTIONS: tuple[str, ...] = ()
QUANTITY = "position"


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run an alignment algorithm on every world of a stack.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays of `Walks`, with a world axis.
    truth
        Arrays of `Truth` for a control, else None.
    options
        None.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``position_m`` [world, k, n, 2], ``heading_rad`` [world, k, n], and ``extra_<name>`` for whatever
        else the algorithm keeps.

    Raises
    ------
    InputError
        For an answer that is no `Aligned`, of the wrong shape or with NaN in it.
    """
    if not any(name.startswith("walks.") for name in observed):
        return Outcome(skipped="there are no walks")
    answers, seconds = [], []
    for index, rng in enumerate(generators):
        walks = Walks.from_arrays(world(observed, index))
        assert walks is not None
        seen = None if truth is None else Truth.from_arrays(world(truth, index))
        algorithm = make(**({} if seen is None else {"truth": seen}))
        if hasattr(algorithm, "skip") and (reason := algorithm.skip(walks)):
            return Outcome(skipped=str(reason))
        start = perf_counter()
        aligned = algorithm.align(walks, rng)
        seconds.append(perf_counter() - start)
        answers.append(_checked(aligned, walks))
    estimates: dict[str, NDArray[np.generic]] = {
        "position_m": np.stack([aligned.position_m for aligned in answers]),
        "heading_rad": np.stack([aligned.heading_rad for aligned in answers]),
    }
    estimates |= stacked_extra([aligned.extra for aligned in answers])
    return Outcome(estimates=estimates, seconds=np.array(seconds))


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the errors where a walk is known to have been, [world, poses of all walks], metres.

    Walks in one frame still miss the one that ties this frame to the building. ``error_m`` is after the
    rotation and shift, the same for all walks of a world, that fit best over all places where the error is
    asked for; ``error_first_m`` after those that lay the first pose of the first walk on the true one.
    """
    estimate_m = np.asarray(estimates["position_m"], dtype=float)
    true_m = np.asarray(truth["truth.position_m"], dtype=float)
    worlds = len(true_m)
    fitted_m = fit_to(estimate_m, true_m)
    first_m = lay_on_first_pose(
        estimate_m,
        np.asarray(estimates["heading_rad"], dtype=float),
        np.asarray(truth["truth.path_m"], dtype=float),
        np.asarray(truth["truth.heading_rad"], dtype=float),
    )
    offset_m = (fitted_m - true_m).reshape(worlds, -1, 2)
    return {
        "error_m": np.hypot(offset_m[..., 0], offset_m[..., 1]),
        "error_x_m": offset_m[..., 0],
        "error_y_m": offset_m[..., 1],
        "error_first_m": np.linalg.norm(first_m - true_m, axis=-1).reshape(worlds, -1),
    }


def fit_to(position_m: NDArray[np.float64], true_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return aligned walks in the frame of the truth, tied by all places that are known.

    Parameters
    ----------
    position_m
        Aligned walks, [world, k, n, 2], metres.
    true_m
        True places, the same shape; NaN where none is known.

    Returns
    -------
    Array
        [world, k, n, 2], metres: one rotation and one shift a world, least squares over the known places.
    """
    worlds = len(position_m)
    points, targets = position_m.reshape(worlds, -1, 2), true_m.reshape(worlds, -1, 2)
    known = np.asarray(np.isfinite(points).all(axis=-1) & np.isfinite(targets).all(axis=-1))
    heading_rad, shift_m = rigid_fit(points, targets, known)
    return (rotated(points, heading_rad[:, None]) + shift_m[:, None]).reshape(position_m.shape)


def lay_on_first_pose(
    position_m: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    path_m: NDArray[np.float64],
    true_heading_rad: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return aligned walks in the frame of the truth, tied by the first pose of the first walk alone.

    Parameters
    ----------
    position_m, heading_rad
        Aligned walks, [world, k, n, 2] and [world, k, n], metres and radians.
    path_m, true_heading_rad
        The truth, the same shapes.
    """
    turn_rad = (true_heading_rad - heading_rad)[:, 0, 0][:, None, None]
    relative_m = position_m - position_m[:, :1, :1]
    return np.asarray(rotated(relative_m, turn_rad) + path_m[:, :1, :1])


def _checked(answer: Any, walks: Walks) -> Aligned:
    aligned = checked_answer(
        answer,
        Aligned,
        "align",
        "an Aligned of positioning.model",
        "Return Aligned(position_m=..., heading_rad=...), of shapes [walk, pose, 2] and [walk, pose]",
    )
    there, axes = ~np.isnan(walks.time_s), ("walk", "pose")
    return aligned._replace(
        position_m=checked_array("position_m", aligned.position_m, there, (2,), axes),
        heading_rad=checked_array("heading_rad", aligned.heading_rad, there, (), axes),
    )
