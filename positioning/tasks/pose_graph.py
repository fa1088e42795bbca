"""Pose graphs: from motions, loop closures and pairs of near places to the poses of one trajectory."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.answers import checked_answer, checked_array, stacked_extra
from positioning.errors import InputError
from positioning.geometry import rigid_fit, rotated
from positioning.model import Arrays, world
from positioning.posegraph.graph import PoseGraph, Solved
from positioning.registry import Factory
from positioning.tasks import Outcome

OPTIONS: tuple[str, ...] = ()
QUANTITY = "position"

PREFIX = "graph."
_OPTIONAL = ("near_from", "near_to", "near_weight", "loop")
_LEAST_PLACES = 2
"""Known places that the fit of a frame needs: one of them would have no error."""


def graph_of(observed: Arrays) -> PoseGraph:
    """Return the graph of one world.

    Parameters
    ----------
    observed
        Arrays ``graph.*`` without a world axis; those of proximity edges and ``graph.loop`` may be absent.

    Raises
    ------
    InputError
        For arrays that are missing, or a graph that cannot be used.
    """
    names = ("position_m", "heading_rad", "motion_from", "motion_to", "motion", "motion_information", "fixed")
    for name in names:
        if PREFIX + name not in observed:
            raise InputError(PREFIX + name, "it is missing", "Give every array of a graph")
    values: dict[str, Any] = {name: np.asarray(observed[PREFIX + name]) for name in names}
    pose = np.concatenate([values.pop("position_m"), values.pop("heading_rad")[:, None]], axis=-1)
    values |= {n: np.asarray(observed[PREFIX + n]) for n in _OPTIONAL if PREFIX + n in observed}
    return PoseGraph(pose=pose, **values).check()


def arrays_of(graph: PoseGraph) -> dict[str, NDArray[np.generic]]:
    """Return the arrays ``graph.*`` of one world, with a world axis in front: the reverse of `graph_of`."""
    values = {
        "position_m": graph.pose[:, :2],
        "heading_rad": graph.pose[:, 2],
        "motion_from": graph.motion_from,
        "motion_to": graph.motion_to,
        "motion": graph.motion,
        "motion_information": graph.motion_information,
        "fixed": graph.fixed,
        "loop": graph.loop,
        "near_from": graph.near_from,
        "near_to": graph.near_to,
        "near_weight": graph.near_weight,
    }
    return {PREFIX + name: np.asarray(v)[None] for name, v in values.items() if v is not None}


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run an algorithm on the graph of every world of a stack.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays ``graph.*``, with a world axis.
    truth
        Not used.
    options
        None.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``position_m`` [world, n, 2], ``heading_rad`` [world, n], and ``extra_<name>`` for whatever else
        the algorithm keeps.

    Raises
    ------
    InputError
        For a graph that cannot be used, or an answer that is no `Solved`, of the wrong shape, with NaN in it,
        or in which a fixed pose has moved.
    """
    if not any(name.startswith(PREFIX) for name in observed):
        return Outcome(skipped="there is no pose graph")
    answers: list[Solved] = []
    seconds = []
    for index, rng in enumerate(generators):
        graph = graph_of(world(observed, index))
        algorithm = make()
        if hasattr(algorithm, "skip") and (reason := algorithm.skip(graph)):
            return Outcome(skipped=str(reason))
        start = perf_counter()
        solved = algorithm.solve(graph, rng)
        seconds.append(perf_counter() - start)
        answers.append(_checked(solved, graph))
    pose = np.stack([solved.pose for solved in answers])
    estimates: dict[str, NDArray[np.generic]] = {"position_m": pose[..., :2], "heading_rad": pose[..., 2]}
    estimates |= stacked_extra([solved.extra for solved in answers])
    return Outcome(estimates=estimates, seconds=np.array(seconds))


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the errors of the poses whose true place is known, [world, n], metres.

    A graph tells no frame: errors are those after the rotation and shift that fit best over all known places
    of a world. A world in which nobody knows a true place has no error at all, and is left out of means.
    """
    true_m = np.asarray(truth["truth.position_m"], dtype=float)
    offset_m = fit_to(np.asarray(estimates["position_m"], dtype=float), true_m) - true_m
    return {
        "error_m": np.hypot(offset_m[..., 0], offset_m[..., 1]),
        "error_x_m": offset_m[..., 0],
        "error_y_m": offset_m[..., 1],
    }


def fit_to(position_m: NDArray[np.float64], true_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return trajectories in the frame of the truth.

    Parameters
    ----------
    position_m
        [world, n, 2], metres.
    true_m
        True places, the same shape; NaN where none is known.

    Returns
    -------
    Array
        [world, n, 2], metres: one rotation and one shift a world, least squares over the known places; NaN in
        worlds with fewer than two of them.
    """
    fitted_m = np.full(position_m.shape, np.nan)
    known = np.asarray(np.isfinite(true_m).all(axis=-1))
    told = np.count_nonzero(known, axis=-1) >= _LEAST_PLACES
    if told.any():
        heading_rad, shift_m = rigid_fit(position_m[told], true_m[told], known[told])
        fitted_m[told] = rotated(position_m[told], heading_rad[:, None]) + shift_m[:, None]
    return fitted_m


def _checked(answer: Any, graph: PoseGraph) -> Solved:
    solved = checked_answer(
        answer,
        Solved,
        "solve",
        "a Solved of positioning.posegraph.graph",
        "Return Solved(pose), of the shape [pose, 3]",
    )
    pose = checked_array("pose", solved.pose, np.ones(len(graph.pose), dtype=bool), (3,))
    moved = np.asarray(graph.fixed & ~np.isclose(pose, graph.pose, rtol=0, atol=1e-6).all(axis=-1))
    if moved.any():
        raise InputError(
            f"its answer, pose[{int(np.argmax(moved))}]",
            "the pose is fixed, and has moved",
            "Correct the algorithm",
        )
    return Solved(pose, solved.extra)
