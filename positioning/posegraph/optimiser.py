"""Poses that contradict the edges of a graph least: Levenberg-Marquardt on sparse normal equations.

See Gu et al., eqs. 3 to 5; Madsen, Nielsen & Tingleff (2004), "Methods for Non-Linear Least Squares
Problems", section 3.2, for the damping. The cost is that of the paper, without a factor of one half.

Damping must not stiffen what the weak edges hold alone. A walk as a whole is held by its proximity edges,
whose curvature may be a million times below that of its steps; damping in proportion to the diagonal of all
edges stops the walk, and the search with it, far from the minimum. Here the damping of a pose is in
proportion to what its proximity edges could pull, with that of the steps scaled down to the same level, and
before the search stops it tries a step that is hardly damped.
"""

from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from positioning.errors import InputError, check_number, check_whole
from positioning.geometry import rotated
from positioning.model import Array
from positioning.posegraph.graph import PoseGraph, checked
from positioning.posegraph.preconditioner import TwoLevel, number_of_knots
from positioning.posegraph.residuals import (
    D_MAX_M,
    D_MIN_M,
    motion_jacobians,
    motion_residual,
    near_residual,
)
from positioning.posegraph.rotations import rotations_first

Cost = Literal["squared", "linear"]
Loss = Literal["cauchy", "huber", "dcs"]
Start = Literal["given", "rotations_first"]
Search = Literal["levenberg_marquardt", "gauss_newton"]
Frame = Literal["held", "free"]
COSTS: Final = ("squared", "linear")
LOSSES: Final = ("cauchy", "huber", "dcs")
STARTS: Final = ("given", "rotations_first")
SEARCHES: Final = ("levenberg_marquardt", "gauss_newton")
FRAMES: Final = ("held", "free")

_FIRST_DAMPING = 1e-6
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e12
# Of the largest curvature: parts of a graph that only flat edges tie keep their place, without 0 / 0.
_RIDGE = 1e-14
_NO_DISTANCE_M = 1e-12
_NEGLIGIBLE_COST = 1e-24
# Relative: what rounding takes from a cost when poses are turned and shifted.
_SAME_COST = 1e-9
# A factor with fewer values an unknown costs no more than a few iterations.
_HEAVY = 200
# A coarse problem is dense: with more knots a pose it would cost more than the factor that it replaces.
_MOST_KNOTS = 0.2
_CLOSE, _CG_ITERATIONS = 1e-3, 200
# A new coarse problem costs as much as some fifteen iterations.
_CG_MORE = 8


@dataclass(frozen=True, kw_only=True)
class NearCost:
    """What the error of a proximity edge costs.

    See Gu et al., eqs. 5 and 10. With "linear", a pair adds weight * e, as eq. 5 is printed; with "squared",
    weight * e^2, as a least-squares library minimises. Each pair counts once; eq. 5 counts it in both orders,
    which is a factor of two in the weight.

    Attributes
    ----------
    weight
        Omega of eq. 5, without unit; the paper gives no value.
    d_min_m, d_max_m
        Ends of the straight line of eq. 10, metres.
    e_max
        Largest error; only weight * e_max, or weight * e_max^2, counts.
    cost
        "linear" or "squared".
    loss
        Robust loss in place of the square, with "squared" alone: "cauchy", "huber" or "dcs" (dynamic
        covariance scaling); None = the square itself.
    loss_scale
        Error from which the loss grows less than the square, in the unit of ``e_max``.
    rounding
        With "linear", the corner at ``d_min_m`` is rounded: e becomes sqrt(e^2 + r^2) - r with
        r = rounding * e_max, which is below e by less than r. Reported costs are those of e itself.
    """

    weight: float
    d_min_m: float = D_MIN_M
    d_max_m: float = D_MAX_M
    e_max: float = 1.0
    cost: Cost = "squared"
    loss: Loss | None = None
    loss_scale: float = 0.1
    rounding: float = 1e-2

    @classmethod
    def of_distance(
        cls,
        sigma_m: float,
        *,
        d_min_m: float = D_MIN_M,
        d_max_m: float = D_MAX_M,
        loss: Loss | None = None,
        scale_m: float = 1.0,
    ) -> "NearCost":
        """Return the squared cost of pairs that are known to be near up to a standard deviation.

        Where motions have information in metres, so has this cost: a pair adds the square of its distance
        beyond ``d_min_m`` as a multiple of the standard deviation, and no more beyond ``d_max_m``.

        Parameters
        ----------
        sigma_m
            Standard deviation of the distance beyond ``d_min_m``, metres, of a pair of weight one.
        d_min_m, d_max_m
            As of the class.
        loss, scale_m
            Robust loss, and the distance beyond ``d_min_m`` from which it grows less than the square, metres.

        Raises
        ------
        InputError
            For values outside their range.
        """
        check_number("sigma_m", sigma_m, above=0)
        _check_ends(d_min_m, d_max_m)
        check_number("scale_m", scale_m, above=0)
        span_m = d_max_m - d_min_m
        return cls(
            weight=(span_m / sigma_m) ** 2,
            d_min_m=d_min_m,
            d_max_m=d_max_m,
            loss=loss,
            loss_scale=scale_m / span_m,
        ).check()

    def check(self) -> "NearCost":
        """Return this cost if it can be used.

        Raises
        ------
        InputError
            For values outside their range, unknown names, or a loss with the linear cost.
        """
        check_number("weight", self.weight, least=0)
        for name in ("e_max", "loss_scale", "rounding"):
            check_number(name, getattr(self, name), above=0)
        _check_ends(self.d_min_m, self.d_max_m)
        if self.cost not in COSTS:
            raise InputError(f"cost={self.cost!r}", f"it is none of {', '.join(COSTS)}", "Correct it")
        _check_loss("loss", self.loss)
        if self.loss is not None and self.cost != "squared":
            raise InputError(
                f"loss={self.loss!r}",
                "a loss replaces the square",
                "Use it with cost='squared', or leave it out",
            )
        return self


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
    problem = _Problem(graph, near, loop_loss, loop_scale)
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
            held = _Problem(whole, near, loop_loss, loop_scale)
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
    found = _Problem(graph, near, loop_loss, loop_scale, pattern=False).cost(np.asarray(graph.pose))
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


class _Value(NamedTuple):
    motion: float
    near: float
    rounded: float

    @property
    def printed(self) -> float:
        return self.motion + self.near

    @property
    def minimised(self) -> float:
        return self.motion + self.rounded


def _search(
    problem: "_Problem", pose: Array, first: _Value, iterations: int, tolerance: float
) -> tuple[Array, _Value, int, str]:
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
    problem: "_Problem", pose: Array, first: _Value, iterations: int, tolerance: float
) -> tuple[Array, _Value, int, str]:
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


class _Problem:
    """Cost, gradient and curvature of a graph; what does not change between steps is kept."""

    def __init__(
        self,
        graph: PoseGraph,
        near: NearCost | None,
        loop_loss: Loss | None,
        loop_scale: float,
        *,
        pattern: bool = True,
    ) -> None:
        self.graph, self.near = graph, near
        self.poses = len(graph.pose)
        self.information = np.asarray(graph.motion_information, dtype=np.float64)
        self.loop_loss, self.loop_scale = (None if graph.loop is None else loop_loss), loop_scale
        self.loop = np.zeros(len(graph.motion_from), bool) if graph.loop is None else graph.loop
        self.weight = np.full(len(graph.near_from), 0.0 if near is None else near.weight)
        if graph.near_weight is not None:
            self.weight = self.weight * graph.near_weight
        self.free = np.flatnonzero(~np.asarray(graph.fixed, dtype=bool))
        if pattern and len(self.free):
            self.pattern = _Pattern(graph, self.free)
            self.scale = self._damping_scale()

    def cost(self, pose: Array) -> _Value:
        """Return the cost at these poses."""
        squared = self._squared(self._motion_residual(pose))
        if self.loop_loss is not None:
            squared = np.where(self.loop, _robust(squared, self.loop_loss, self.loop_scale)[0], squared)
        motion = float(np.sum(squared))
        if self.near is None:
            return _Value(motion, 0.0, 0.0)
        near = self.near
        error = near_residual(
            pose[self.graph.near_from],
            pose[self.graph.near_to],
            e_max=near.e_max,
            d_min_m=near.d_min_m,
            d_max_m=near.d_max_m,
        )
        if near.cost == "linear":
            rounding = near.rounding * near.e_max
            rounded = float(np.dot(self.weight, np.hypot(error, rounding) - rounding))
            return _Value(motion, float(np.dot(self.weight, error)), rounded)
        squared = error * error
        if near.loss is not None:
            squared = _robust(squared, near.loss, near.loss_scale)[0]
        value = float(np.dot(self.weight, squared))
        return _Value(motion, value, value)

    def normal_equations(self, pose: Array) -> tuple[Array, Array]:
        """Return the gradient of the free poses, and the curvature as values of the sparse matrix."""
        graph, pattern = self.graph, self.pattern
        residual = self._motion_residual(pose)
        by_from, by_to = motion_jacobians(pose[graph.motion_from], pose[graph.motion_to])
        information = 2.0 * self.information
        if self.loop_loss is not None:
            slope = _robust(self._squared(residual), self.loop_loss, self.loop_scale)[1]
            information = information * np.where(self.loop, slope, 1.0)[:, None, None]
        from_weighted = np.swapaxes(by_from, -1, -2) @ information
        to_weighted = np.swapaxes(by_to, -1, -2) @ information
        gradient = _summed(graph.motion_from, (from_weighted @ residual[..., None])[..., 0], self.poses)
        gradient += _summed(graph.motion_to, (to_weighted @ residual[..., None])[..., 0], self.poses)
        diagonal = _summed(graph.motion_from, from_weighted @ by_from, self.poses)
        diagonal += _summed(graph.motion_to, to_weighted @ by_to, self.poses)
        across = from_weighted @ by_to
        across = np.where(pattern.motion_swapped[:, None, None], np.swapaxes(across, -1, -2), across)
        joint = _summed(pattern.motion_pair, across[pattern.motion_both], pattern.motion_pairs)
        shared = np.zeros((pattern.near_pairs, 3))
        if self.near is not None and len(graph.near_from):
            pull, curvature = self._near(pose, self.near)
            gradient[:, :2] += _summed(graph.near_to, pull, self.poses)
            gradient[:, :2] -= _summed(graph.near_from, pull, self.poses)
            own = _summed(graph.near_from, curvature, self.poses) + _summed(
                graph.near_to, curvature, self.poses
            )
            diagonal[:, :2, :2] += own[:, _BLOCK]
            shared = _summed(pattern.near_pair, curvature[pattern.near_both], pattern.near_pairs)
        return gradient[self.free].ravel(), pattern.values(diagonal[self.free], joint, -shared[:, _BLOCK])

    def step(self, pose: Array, gradient: Array, hessian: Array, damping: float) -> tuple[Array, float]:
        """Return the step of all free poses, [free * 3], and the decrease of cost that the model promises."""
        pattern = self.pattern
        added = damping * self.scale
        try:
            ridge = _RIDGE * hessian.max(initial=0.0)
            step = -pattern.solve(hessian, added + ridge, gradient, pose[self.free])
        except RuntimeError:  # exactly singular
            return np.zeros_like(gradient), np.inf
        if not np.isfinite(step).all():
            return np.zeros_like(gradient), np.inf
        return step, 0.5 * float(np.dot(added * step, step) - np.dot(gradient, step))

    def moved(self, pose: Array, step: Array) -> Array:
        """Return the poses after a step of the free ones."""
        moved = pose.copy()
        moved[self.free] += step.reshape(-1, 3)
        return moved

    def _near(self, pose: Array, near: NearCost) -> tuple[Array, Array]:
        """Return the derivative by the second pose, [f, 2], and the curvature (xx, xy, yy), [f, 3]."""
        offset_m = pose[self.graph.near_to, :2] - pose[self.graph.near_from, :2]
        distance_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
        slope = near.e_max / (near.d_max_m - near.d_min_m)
        error = slope * (distance_m - near.d_min_m)
        between = (distance_m > near.d_min_m) & (distance_m < near.d_max_m)
        derivative, second = _of_error(np.where(between, error, 0.0), near)
        weight = np.where(between, self.weight, 0.0)
        distance_m = np.maximum(distance_m, _NO_DISTANCE_M)
        east, north = offset_m[:, 0] / distance_m, offset_m[:, 1] / distance_m
        force = weight * derivative * slope
        along, across = weight * second * slope**2, force / distance_m
        curvature = np.stack(
            [
                along * east * east + across * north * north,
                (along - across) * east * north,
                along * north * north + across * east * east,
            ],
            axis=-1,
        )
        return np.stack([force * east, force * north], axis=-1), curvature

    def _damping_scale(self) -> Array:
        """Return what a unit of damping adds to the curvature of each free coordinate, [free * 3]."""
        graph = self.graph
        by_from, by_to = motion_jacobians(graph.pose[graph.motion_from], graph.pose[graph.motion_to])
        motion = np.zeros((self.poses, 3))
        for pose, jacobian in ((graph.motion_from, by_from), (graph.motion_to, by_to)):
            motion += _summed(
                pose, np.einsum("eij,eik,ekj->ej", jacobian, self.information, jacobian), self.poses
            )
        scale = 2.0 * motion
        if self.near is not None and self.weight.any():
            slope = self.near.e_max / (self.near.d_max_m - self.near.d_min_m)
            _, middle = _of_error(np.array([0.5 * self.near.e_max]), self.near)
            pull = self.weight * float(middle[0]) * slope**2
            own = _summed(graph.near_from, pull, self.poses) + _summed(graph.near_to, pull, self.poses)
            level = scale[self.free, :2].mean()
            scale *= min(1.0, own[self.free].mean() / level) if level > 0 else 1.0
            scale[:, :2] += own[:, None]
        # A coordinate without any edge stays where it is.
        return np.where(scale > 0, scale, 1.0)[self.free].ravel()

    def _motion_residual(self, pose: Array) -> Array:
        graph = self.graph
        return motion_residual(pose[graph.motion_from], pose[graph.motion_to], graph.motion)

    def _squared(self, residual: Array) -> Array:
        return np.asarray(np.einsum("ei,eij,ej->e", residual, self.information, residual))


class _Pattern:
    """Where the values of the normal equations stand in a sparse matrix.

    Coordinates of a pose stay together, as 3 x 3 blocks: an order that gives little fill-in is found on the
    graph of poses, once. Where its factor would fill up nevertheless, the poses keep their order.
    """

    def __init__(self, graph: PoseGraph, free: NDArray[np.intp]) -> None:
        count = len(free)
        number = np.full(len(graph.pose), -1)
        number[free] = np.arange(count)
        motion, near = (
            np.sort(number[np.stack([start, end])], axis=0)
            for start, end in ((graph.motion_from, graph.motion_to), (graph.near_from, graph.near_to))
        )
        self.motion_both, self.near_both = motion[0] >= 0, near[0] >= 0
        self.motion_swapped = number[graph.motion_from] > number[graph.motion_to]
        ends = np.concatenate([motion[:, self.motion_both], near[:, self.near_both]], axis=1)
        key, pair = np.unique(ends[0] * count + ends[1], return_inverse=True)
        first, second = np.divmod(key, count)
        split = int(self.motion_both.sum())
        stiff, self.motion_pair = np.unique(pair[:split], return_inverse=True)
        soft, self.near_pair = np.unique(pair[split:], return_inverse=True)
        self.motion_pairs, self.near_pairs = len(stiff), len(soft)

        joined = np.zeros(max(count - 1, 0), dtype=bool)
        next_pose = self.motion_both & (motion[1] == motion[0] + 1)
        joined[motion[0, next_pose]] = True
        place, fill = _little_fill(first, second, count)
        # Nine values a block, three unknowns a pose.
        heavy = 3 * fill > _HEAVY * count and number_of_knots(joined) <= _MOST_KNOTS * count
        if heavy:
            place = np.arange(count)
        here, one, two = place, place[first], place[second]
        row = np.concatenate([here, two, one])
        column = np.concatenate([here, one, two])
        order = np.lexsort((row, column))
        blocks = np.bincount(column, minlength=count)
        start = np.concatenate([[0], np.cumsum(blocks)])
        # Values of a block column: three columns one after the other, each with three values a block.
        rank = np.empty(len(row), dtype=np.intp)
        rank[order] = np.arange(len(row)) - start[column[order]]
        base = 9 * start[column] + 3 * rank
        position = (
            base[:, None, None] + np.arange(3)[:, None] + (3 * blocks[column])[:, None, None] * np.arange(3)
        )
        diagonal, lower, upper = np.split(position, [count, count + len(key)])
        # Proximity knows no headings: its blocks have two rows and two columns.
        joint = np.stack([upper[stiff], np.swapaxes(lower[stiff], -1, -2)])
        shared = np.stack([upper[soft], np.swapaxes(lower[soft], -1, -2)])[..., :2, :2]
        there = np.zeros(9 * len(row), dtype=bool)
        for part in (diagonal, joint, shared):
            there[part] = True
        before = np.concatenate([[0], np.cumsum(there)])
        self._diagonal, self._joint, self._shared = (before[part] for part in (diagonal, joint, shared))
        self._size = int(before[-1])
        rows = np.empty(len(there), dtype=np.intc)
        rows[position] = 3 * row[:, None, None] + np.arange(3)[:, None]
        self._row = rows[there]
        self._start = before[np.concatenate([[0], np.cumsum(np.repeat(3 * blocks, 3))])].astype(np.intc)
        self._unknown = (3 * place[:, None] + np.arange(3)).ravel()
        self._middle = np.diagonal(self._diagonal, axis1=-2, axis2=-1).ravel()
        self._near_inverse: TwoLevel | None = None
        # Iterations with the coarse problem when it was new; None = there is none, or it is of no more use.
        self._needed: int | None = None
        if heavy:
            next_one = np.flatnonzero(second == first + 1)
            below = np.where(there[lower[next_one]], before[lower[next_one]], -1)
            self._near_inverse = TwoLevel(joined, _band(self._diagonal, first[next_one], below))

    def values(self, diagonal: Array, joint: Array, shared: Array) -> Array:
        """Return the values of the matrix from its blocks.

        Those of poses [count, 3, 3], of pairs that a motion joins [motion_pairs, 3, 3], and of pairs that are
        near [near_pairs, 2, 2]. A pair's block has the rows of its first pose, its transpose stands across.
        """
        values = np.zeros(self._size)
        values[self._diagonal] = diagonal
        values[self._joint] = joint
        values[self._shared] += shared
        return values

    def solve(self, values: Array, added: Array, right: Array, pose: Array) -> Array:
        """Solve the equations with ``added`` on the diagonal; a RuntimeError says that they are singular.

        A factor that fills up is not made; conjugate gradients come close enough within a few iterations.
        """
        damped = values.copy()
        damped[self._middle] += added
        size = len(self._unknown)
        if self._near_inverse is not None:
            matrix = csr_array((damped, self._row, self._start), shape=(size, size))
            found = self._iterated(self._near_inverse, matrix, right, pose)
            if found is not None:
                return found
        # The order is symmetric and the matrix positive definite: no pivoting, as in a Cholesky factor.
        options = {"SymmetricMode": True}
        order = "NATURAL" if self._near_inverse is None else "MMD_AT_PLUS_A"
        placed = np.empty(size)
        placed[self._unknown] = right
        matrix = csc_array((damped, self._row, self._start), shape=(size, size))
        factor = splu(matrix, permc_spec=order, diag_pivot_thresh=0.0, options=options)
        return np.asarray(factor.solve(placed)[self._unknown])

    def _iterated(self, near_inverse: TwoLevel, matrix: Any, right: Array, pose: Array) -> Array | None:
        """Solve by conjugate gradients; None where they do not come close.

        The coarse problem of an earlier matrix does as long as it needs few iterations more than when new.
        """
        try:
            near_inverse.chain(matrix.data)
            for _ in range(2):
                when_new = self._needed
                if when_new is None:
                    near_inverse.coarse(matrix, pose)
                found, needed = _conjugate_gradients(matrix, right, near_inverse)
                if found is None:
                    self._needed = None
                    if when_new is None:  # nothing new is left to try
                        break
                    continue
                if when_new is None:
                    self._needed = needed
                elif needed > when_new + _CG_MORE:
                    self._needed = None
                return found
        except np.linalg.LinAlgError:  # not positive definite to rounding
            pass
        self._needed = None
        return None


def _band(diagonal: NDArray[Any], pose: NDArray[Any], below: NDArray[Any]) -> NDArray[Any]:
    """Return where the entries (i + k, i) up to the block of the next pose stand, [6, 3 n]; -1 = nowhere.

    From where the blocks of all poses stand, [n, 3, 3], and those below them of some, [p, 3, 3].
    """
    count = len(diagonal)
    both = np.full((count, 6, 3), -1)
    both[:, :3] = diagonal
    both[pose, 3:] = below
    column = np.arange(3)
    band = np.full((6, count, 3), -1)
    for lower in range(6):
        inside = column + lower < 6
        band[lower][:, inside] = both[:, (column + lower)[inside], column[inside]]
    return band.reshape(6, 3 * count)


def _conjugate_gradients(matrix: Any, right: Array, near_inverse: TwoLevel) -> tuple[Array | None, int]:
    """Return a solution whose relative error is about `_CLOSE`, or None, and the iterations that it took.

    The error is estimated by the preconditioner, nearly as the curvature weighs it, so that soft directions
    count as much as stiff ones.
    """
    found, residual = np.zeros(len(right)), right
    direction = preconditioned = near_inverse.solve(residual)
    first = product = float(np.dot(residual, preconditioned))
    if first == 0.0:
        return found, 0
    for iteration in range(_CG_ITERATIONS):
        image = matrix @ direction
        curvature = float(np.dot(direction, image))
        if not (curvature > 0 and product > 0):
            break
        length = product / curvature
        found = found + length * direction
        residual = residual - length * image
        preconditioned = near_inverse.solve(residual)
        previous, product = product, float(np.dot(residual, preconditioned))
        if abs(product) <= _CLOSE**2 * first:
            return np.asarray(found), iteration + 1
        direction = preconditioned + product / previous * direction
    return None, _CG_ITERATIONS


def _little_fill(first: NDArray[Any], second: NDArray[Any], count: int) -> tuple[NDArray[Any], int]:
    """Return the place of each pose in an order of least degree, [count], and the values of its factor."""
    here = np.arange(count)
    value = np.concatenate([np.full(count, 2.0 * len(first) + 1.0), np.full(2 * len(first), -1.0)])
    row, column = np.concatenate([here, first, second]), np.concatenate([here, second, first])
    matrix = csc_array((value, (row, column)), shape=(count, count))
    options = {"SymmetricMode": True}
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.asarray(factor.perm_c), int(factor.nnz)


_BLOCK = np.array([[0, 1], [1, 2]])


def _summed(index: NDArray[Any], values: Array, count: int) -> Array:
    """Return the sums of rows by index, [count, ...]."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
    sums = [np.bincount(index, weights=column, minlength=count) for column in flat.T]
    return np.asarray(np.stack(sums, axis=-1).reshape(count, *values.shape[1:]), dtype=np.float64)


def _of_error(error: Array, near: NearCost) -> tuple[Array, Array]:
    """Return first derivative and curvature of the cost by the error, for a weight of one."""
    if near.cost == "linear":
        root = np.hypot(error, near.rounding * near.e_max)
        return error / root, 1.0 / root
    if near.loss is None:
        return 2.0 * error, np.full_like(error, 2.0)
    slope = _robust(error * error, near.loss, near.loss_scale)[1]
    return 2.0 * slope * error, 2.0 * slope


def _robust(squared: Array, loss: Loss, scale: float) -> tuple[Array, Array]:
    """Return a robust loss of a squared residual, and its derivative by it.

    See Agarwal et al. (2013), "Robust map optimization using dynamic covariance scaling", for the third.
    """
    limit = scale * scale
    if loss == "cauchy":
        return limit * np.log1p(squared / limit), limit / (limit + squared)
    if loss == "huber":
        root = np.sqrt(np.maximum(squared, limit))
        return np.where(squared <= limit, squared, 2.0 * scale * root - limit), scale / root
    beyond = limit * (3.0 * squared - limit) / (limit + squared)
    slope = np.minimum(1.0, 2.0 * limit / (limit + squared))
    return np.where(squared <= limit, squared, beyond), slope * slope


def _check_settings(
    near: NearCost | None, loop_loss: Loss | None, loop_scale: float, iterations: int, tolerance: float
) -> None:
    if near is not None:
        near.check()
    _check_loss("loop_loss", loop_loss)
    check_number("loop_scale", loop_scale, above=0)
    check_number("tolerance", tolerance, above=0)
    check_whole("iterations", iterations, least=1)


def _check_ends(d_min_m: float, d_max_m: float) -> None:
    check_number("d_min_m", d_min_m, least=0)
    check_number("d_max_m", d_max_m, above=0)
    if d_min_m >= d_max_m:
        limit = "they are not 0 <= d_min_m < d_max_m"
        raise InputError(f"d_min_m={d_min_m} and d_max_m={d_max_m}", limit, "Correct them")


def _check_loss(name: str, loss: str | None) -> None:
    if loss is not None and loss not in LOSSES:
        raise InputError(f"{name}={loss!r}", f"it is none of {', '.join(LOSSES)}", "Correct it")
