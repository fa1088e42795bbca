"""Poses that contradict the edges of a graph least: Levenberg-Marquardt on sparse normal equations.

See Gu et al., eqs. 3 to 5; Madsen, Nielsen & Tingleff (2004), "Methods for Non-Linear Least Squares
Problems", section 3.2, for the damping. The cost is that of the paper, without a factor of one half.

`positioning.posegraph.problem` says how a step is damped. Before the search stops, it tries one that is
hardly damped.
"""

from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from positioning.errors import InputError, check_number, check_whole
from positioning.geometry import rotated
from positioning.model import Array
from positioning.posegraph.costs import Loss, NearCost, check_loss
from positioning.posegraph.graph import PoseGraph, checked
from positioning.posegraph.problem import Problem, Value
from positioning.posegraph.rotations import rotations_first

Start = Literal["given", "rotations_first"]
Search = Literal["levenberg_marquardt", "gauss_newton"]
Frame = Literal["held", "free"]
STARTS: Final = ("given", "rotations_first")
SEARCHES: Final = ("levenberg_marquardt", "gauss_newton")
FRAMES: Final = ("held", "free")

_FIRST_DAMPING = 1e-6
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e12
_NEGLIGIBLE_COST = 1e-24
# Relative: what rounding takes from a cost when poses are turned and shifted.
_SAME_COST = 1e-9


class Optimised(NamedTuple):
    """The poses of least cost that were found, and how.

    Attributes
    ----------
    pose
        [n, 3], metres and radians; headings go on from those of the start and are not wrapped.
    cost_start, cost
        Before and after, without a factor of one half, corners not rounded.
    iterations
        Steps that were taken.
    converged
        Whether a stop rule was met before the iterations ran out and every step could be taken.
    reason
        Which: "cost" (no step that would lower it by more than the tolerance), "zero" (nothing left to
        lower), "damping" (no step lowers it at all: the numbers are exhausted), "iterations", "nothing
        free", or "singular" (a step of Gauss and Newton has no finite length).
    """

    pose: Array
    cost_start: float
    cost: float
    iterations: int
    converged: bool
    reason: str


def optimise(
    graph: PoseGraph,
    *,
    near: NearCost | None = None,
    loop_loss: Loss | None = None,
    loop_scale: float = 1.0,
    start: Start = "given",
    search: Search = "levenberg_marquardt",
    frame: Frame = "free",
    iterations: int = 100,
    tolerance: float = 1e-6,
) -> Optimised:
    """Find the poses of least cost near those of the graph.

    See Gu et al., eqs. 3 to 5. Steps of dead reckoning cost the square of their residual, weighted with the
    information. Second derivatives of proximity edges are exact where those are convex, so that the linear
    cost is minimised by reweighted least squares with the curvature across the edge added.

    Parameters
    ----------
    graph
        At least one pose of every connected part must be fixed; see `PoseGraph.tied`.
    near
        Cost of the proximity edges; needed where there are some.
    loop_loss
        Robust loss on the motion edges ``graph.loop``; None = the square.
    loop_scale
        Residual from which the loss grows less than the square, standard deviations.
    start
        Where the search begins: at the poses "given", or at those of `rotations_first`, whatever they cost.
    search
        "levenberg_marquardt", whose every step lowers the cost, or "gauss_newton", which takes steps without
        damping, may lose its way far from the minimum, and passes long curved valleys in fewer steps.
    frame
        What becomes of a pose that is the only fixed one of its part, and so tells the frame alone. "held":
        it stays where it is, as section III-A has it, and all others move about it. "free": it moves like all
        others, and is put back in place at the end with all that the cost joins to it. Every minimum of one
        is a minimum of the other, of the same cost; but where there are several, the two may end in different
        ones, and either may need more steps. The steps of "gauss_newton" need a frame: it always holds.
    iterations
        Most steps to take.
    tolerance
        Relative decrease of the cost below which to stop.

    Returns
    -------
    Optimised
        Never of a larger cost than where the search begins, up to the rounding of the linear cost;
        ``cost_start`` is that of the poses given.

    Raises
    ------
    InputError
        For a graph that cannot be used, parts of it without a fixed pose, proximity edges without a cost, or
        settings outside their range.
    """
    checked(graph)
    _check_settings(near, loop_loss, loop_scale, iterations, tolerance)
    if start not in STARTS:
        raise InputError(f"start={start!r}", f"it is none of {', '.join(STARTS)}", "Correct it")
    if search not in SEARCHES:
        raise InputError(f"search={search!r}", f"it is none of {', '.join(SEARCHES)}", "Correct it")
    if frame not in FRAMES:
        raise InputError(f"frame={frame!r}", f"it is none of {', '.join(FRAMES)}", "Correct it")
    if near is None and len(graph.near_from):
        limit = f"the graph has {len(graph.near_from)} proximity edges"
        raise InputError("near", limit, "Give a NearCost, or a graph without them")
    loose = graph.loose()
    if len(loose):
        raise InputError(
            f"graph, the part of pose {int(loose[0])}",
            f"no pose of it is fixed, and no edge joins it to a fixed one ({len(loose)} such part(s))",
            "Fix a pose of it, leave it out, or take graph.tied()",
        )
    whole = graph
    if search == "levenberg_marquardt" and frame == "free":
        graph = _with_free_frames(whole)
    problem = Problem(graph, near, loop_loss, loop_scale)
    pose = np.array(graph.pose, dtype=np.float64)
    first = problem.cost(pose)
    if not len(problem.free):
        return Optimised(pose, first.printed, first.printed, 0, True, "nothing free")
    begin = first
    if start == "rotations_first":
        pose = rotations_first(whole)
        begin = problem.cost(pose)
    find = _search if search == "levenberg_marquardt" else _gauss_newton
    pose, last, taken, reason = find(problem, pose, begin, iterations, tolerance)
    if graph is not whole:
        pose = _in_given_frames(whole, graph, near, pose)
        back = problem.cost(pose)
        if back.minimised < (1.0 - _SAME_COST) * last.minimised:
            # Something that nothing joined to the fixed pose came within its reach: there is more to find.
            held = Problem(whole, near, loop_loss, loop_scale)
            pose, last, more, reason = _search(held, pose, back, iterations - taken, tolerance)
            taken += more
    return Optimised(
        pose, first.printed, last.printed, taken, reason not in ("iterations", "singular"), reason
    )


def cost(
    graph: PoseGraph,
    *,
    near: NearCost | None = None,
    loop_loss: Loss | None = None,
    loop_scale: float = 1.0,
) -> tuple[float, float]:
    """Return the cost of the motion edges and that of the proximity edges at the poses of the graph.

    See Gu et al., eqs. 4 and 5.

    Raises
    ------
    InputError
        As `optimise`, but no pose needs to be fixed.
    """
    checked(graph)
    _check_settings(near, loop_loss, loop_scale, 1, 1.0)
    found = Problem(graph, near, loop_loss, loop_scale, pattern=False).cost(np.asarray(graph.pose))
    return found.motion, found.near


def _with_free_frames(graph: PoseGraph) -> PoseGraph:
    """Return the graph without fixed poses in those parts in which only one is fixed, and others are not.

    Such a pose tells the frame and nothing else: the cost is the same in every frame. Held while all others
    move, it makes them swing about it, and steps along the tangent of far poses must be short. The same graph
    where there is no such pose.
    """
    number, part = graph.component()
    fixed = np.asarray(graph.fixed, dtype=bool)
    alone = (np.bincount(part, weights=fixed, minlength=number) == 1) & (np.bincount(part) > 1)
    freed = fixed & alone[part]
    return replace(graph, fixed=fixed & ~freed) if freed.any() else graph


def _in_given_frames(graph: PoseGraph, freed: PoseGraph, near: NearCost | None, pose: Array) -> Array:
    """Return poses turned and shifted so that the poses that were freed are back in place.

    With each goes what motions and proximity edges with a slope join to it. What hangs by flat edges alone
    keeps its place, wherever the rest has gone meanwhile; as those edges cost their most already, this cannot
    raise the cost.
    """
    back = np.flatnonzero(np.asarray(graph.fixed, dtype=bool) & ~np.asarray(freed.fixed, dtype=bool))
    number, part = _joined(graph, near, pose).component()
    anchor = np.full(number, -1)
    anchor[part[back]] = back
    of_pose = anchor[part]
    moves = of_pose >= 0
    on = of_pose[moves]
    given = np.asarray(graph.pose, dtype=np.float64)
    turn_rad = given[on, 2] - pose[on, 2]
    found = pose.copy()
    found[moves, :2] = rotated(pose[moves, :2] - pose[on, :2], turn_rad) + given[on, :2]
    found[moves, 2] += turn_rad
    # Without the rounding of a difference that is added again.
    found[back] = given[back]
    return found


def _joined(graph: PoseGraph, near: NearCost | None, pose: Array) -> PoseGraph:
    """Return the graph without the edges that cost the same wherever their poses go from here."""
    weighs = np.asarray(graph.motion_information).any(axis=(-2, -1))
    if near is None:
        reach = np.zeros(len(graph.near_from), dtype=bool)
    else:
        offset_m = pose[graph.near_to, :2] - pose[graph.near_from, :2]
        reach = np.hypot(offset_m[:, 0], offset_m[:, 1]) < near.d_max_m
        if near.weight == 0:
            reach[:] = False
        if graph.near_weight is not None:
            reach &= np.asarray(graph.near_weight) > 0
    return replace(
        graph,
        motion_from=graph.motion_from[weighs],
        motion_to=graph.motion_to[weighs],
        near_from=graph.near_from[reach],
        near_to=graph.near_to[reach],
    )


def _search(
    problem: Problem, pose: Array, first: Value, iterations: int, tolerance: float
) -> tuple[Array, Value, int, str]:
    value, damping, growth, relaxed = first, _FIRST_DAMPING, 2.0, True
    gradient, hessian = problem.normal_equations(pose)
    taken = 0
    while True:
        if value.minimised <= _NEGLIGIBLE_COST:
            return pose, value, taken, "zero"
        if taken == iterations:
            return pose, value, taken, "iterations"
        step, promised = problem.step(pose, gradient, hessian, damping)
        if promised <= tolerance * value.minimised:
            if damping <= _FIRST_DAMPING or relaxed:
                return pose, value, taken, "cost"
            # The damping may be what holds the step back.
            damping, growth, relaxed = _FIRST_DAMPING, 2.0, True
            continue
        trial = problem.moved(pose, step)
        trial_value = problem.cost(trial)
        gain = (value.minimised - trial_value.minimised) / promised if np.isfinite(promised) else -1.0
        if gain > 0:
            decrease = value.minimised - trial_value.minimised
            small = decrease <= tolerance * value.minimised
            pose, value, taken = trial, trial_value, taken + 1
            if small and damping <= _FIRST_DAMPING:
                return pose, value, taken, "cost"
            relaxed = relaxed and small
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), _LEAST_DAMPING)
            growth = 2.0
            gradient, hessian = problem.normal_equations(pose)
        else:
            damping, growth = damping * growth, growth * 2.0
            if not damping < _MOST_DAMPING:
                return pose, value, taken, "damping"


def _gauss_newton(
    problem: Problem, pose: Array, first: Value, iterations: int, tolerance: float
) -> tuple[Array, Value, int, str]:
    """Take undamped steps, whether or not they lower the cost; return the best poses that were met."""
    best, least, value, taken = pose, first, first, 0
    while taken < iterations:
        if value.minimised <= _NEGLIGIBLE_COST:
            return best, least, taken, "zero"
        step, promised = problem.step(pose, *problem.normal_equations(pose), 0.0)
        if not np.isfinite(promised):
            return best, least, taken, "singular"
        pose = problem.moved(pose, step)
        before, value, taken = value, problem.cost(pose), taken + 1
        if not np.isfinite(value.minimised):
            return best, least, taken, "singular"
        if value.minimised < least.minimised:
            best, least = pose, value
        if abs(before.minimised - value.minimised) <= tolerance * before.minimised:
            return best, least, taken, "cost"
    return best, least, taken, "iterations"


def _check_settings(
    near: NearCost | None, loop_loss: Loss | None, loop_scale: float, iterations: int, tolerance: float
) -> None:
    if near is not None:
        near.check()
    check_loss("loop_loss", loop_loss)
    check_number("loop_scale", loop_scale, above=0)
    check_number("tolerance", tolerance, above=0)
    check_whole("iterations", iterations, least=1)
