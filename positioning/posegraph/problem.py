"""Cost, gradient and curvature of a graph of poses, and the damped step that they ask for.

See Gu et al., eqs. 3 to 5. Damping must not stiffen what the weak edges hold alone. A walk as a whole is held
by its proximity edges, whose curvature may be a million times below that of its steps; damping in proportion
to the diagonal of all edges stops the walk, and the search with it, far from the minimum. Here the damping of
a pose is in proportion to what its proximity edges could pull, with that of the steps scaled down to the same
level.
"""

from typing import NamedTuple

import numpy as np

from positioning.model import Array
from positioning.posegraph.costs import Loss, NearCost, of_error, robust
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.normal_equations import BLOCK, Pattern, incidence, summed
from positioning.posegraph.residuals import motion_jacobians, motion_residual, near_error

# Of the largest curvature: parts of a graph that only flat edges tie keep their place, without 0 / 0.
_RIDGE = 1e-14
_NO_DISTANCE_M = 1e-12


class Value(NamedTuple):
    """The cost of a graph.

    Attributes
    ----------
    motion
        Of the motion edges, with their robust loss.
    near
        Of the proximity edges, as the paper has it.
    rounded
        The same with the corner of the linear cost rounded.
    """

    motion: float
    near: float
    rounded: float

    @property
    def printed(self) -> float:
        """The cost as it is told."""
        return self.motion + self.near

    @property
    def minimised(self) -> float:
        """The cost that the search lowers."""
        return self.motion + self.rounded


class Problem:
    """Cost, gradient and curvature of a graph; what does not change between steps is kept.

    So are the distances at the poses last asked for: an array of poses must not be changed in place.

    Parameters
    ----------
    graph, near, loop_loss, loop_scale
        As of `positioning.posegraph.optimiser.optimise`, checked.
    pattern
        Whether steps will be asked for; the cost alone needs no sparse matrix.
    """

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
        self._last: tuple[Array, Array, Array] | None = None
        if pattern and len(self.free):
            self.pattern = Pattern(graph, self.free)
            self._motion_from, self._motion_to, self._near_from, self._near_to = (
                incidence(ends, self.poses)
                for ends in (graph.motion_from, graph.motion_to, graph.near_from, graph.near_to)
            )
            self.scale = self._damping_scale()

    def cost(self, pose: Array) -> Value:
        """Return the cost at these poses."""
        squared = self._squared(self._motion_residual(pose))
        if self.loop_loss is not None:
            squared = np.where(self.loop, robust(squared, self.loop_loss, self.loop_scale)[0], squared)
        motion = float(np.sum(squared))
        if self.near is None:
            return Value(motion, 0.0, 0.0)
        near = self.near
        error = near_error(
            self._offset(pose)[1], e_max=near.e_max, d_min_m=near.d_min_m, d_max_m=near.d_max_m
        )
        if near.cost == "linear":
            rounding = near.rounding * near.e_max
            rounded = float(np.dot(self.weight, np.hypot(error, rounding) - rounding))
            return Value(motion, float(np.dot(self.weight, error)), rounded)
        squared = error * error
        if near.loss is not None:
            squared = robust(squared, near.loss, near.loss_scale)[0]
        value = float(np.dot(self.weight, squared))
        return Value(motion, value, value)

    def normal_equations(self, pose: Array) -> tuple[Array, Array]:
        """Return the gradient of the free poses, and the curvature as values of the sparse matrix."""
        graph, pattern = self.graph, self.pattern
        residual = self._motion_residual(pose)
        by_from, by_to = motion_jacobians(pose[graph.motion_from], pose[graph.motion_to])
        information = 2.0 * self.information
        if self.loop_loss is not None:
            slope = robust(self._squared(residual), self.loop_loss, self.loop_scale)[1]
            information = information * np.where(self.loop, slope, 1.0)[:, None, None]
        from_weighted = np.swapaxes(by_from, -1, -2) @ information
        to_weighted = np.swapaxes(by_to, -1, -2) @ information
        gradient = summed(self._motion_from, (from_weighted @ residual[..., None])[..., 0])
        gradient += summed(self._motion_to, (to_weighted @ residual[..., None])[..., 0])
        diagonal = summed(self._motion_from, from_weighted @ by_from)
        diagonal += summed(self._motion_to, to_weighted @ by_to)
        across = from_weighted @ by_to
        across = np.where(pattern.motion_swapped[:, None, None], np.swapaxes(across, -1, -2), across)
        joint = summed(pattern.motion_pair, across)
        shared = np.zeros((pattern.near_pair.shape[0], 3))
        if self.near is not None and len(graph.near_from):
            pull_curvature = self._near(pose, self.near)
            by_start, by_end = (summed(ends, pull_curvature) for ends in (self._near_from, self._near_to))
            gradient[:, :2] += by_end[:, :2]
            gradient[:, :2] -= by_start[:, :2]
            diagonal[:, :2, :2] += (by_start + by_end)[:, 2:][:, BLOCK]
            shared = summed(pattern.near_pair, pull_curvature)[:, 2:]
        return gradient[self.free].ravel(), pattern.values(diagonal[self.free], joint, -shared)

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

    def _offset(self, pose: Array) -> tuple[Array, Array]:
        """Return the offset of the proximity edges, [2, f], and its length, [f], metres."""
        if self._last is None or self._last[0] is not pose:
            # Whole columns are read much faster than rows of two.
            offset_m = np.stack(
                [line[self.graph.near_to] - line[self.graph.near_from] for line in pose.T[:2]]
            )
            self._last = pose, offset_m, np.hypot(offset_m[0], offset_m[1])
        return self._last[1:]

    def _near(self, pose: Array, near: NearCost) -> Array:
        """Return the derivative by the second pose and the curvature (xx, xy, yy), [f, 5]."""
        offset_m, distance_m = self._offset(pose)
        slope = near.e_max / (near.d_max_m - near.d_min_m)
        error = slope * (distance_m - near.d_min_m)
        between = (distance_m > near.d_min_m) & (distance_m < near.d_max_m)
        derivative, second = of_error(np.where(between, error, 0.0), near)
        weight = np.where(between, self.weight, 0.0)
        distance_m = np.maximum(distance_m, _NO_DISTANCE_M)
        east, north = offset_m / distance_m
        force = weight * derivative * slope
        along, across = weight * second * slope**2, force / distance_m
        return np.stack(
            [
                force * east,
                force * north,
                along * east * east + across * north * north,
                (along - across) * east * north,
                along * north * north + across * east * east,
            ],
            axis=-1,
        )

    def _damping_scale(self) -> Array:
        """Return what a unit of damping adds to the curvature of each free coordinate, [free * 3]."""
        graph = self.graph
        by_from, by_to = motion_jacobians(graph.pose[graph.motion_from], graph.pose[graph.motion_to])
        motion = np.zeros((self.poses, 3))
        for ends, jacobian in ((self._motion_from, by_from), (self._motion_to, by_to)):
            motion += summed(ends, np.einsum("eij,eik,ekj->ej", jacobian, self.information, jacobian))
        scale = 2.0 * motion
        if self.near is not None and self.weight.any():
            slope = self.near.e_max / (self.near.d_max_m - self.near.d_min_m)
            _, middle = of_error(np.array([0.5 * self.near.e_max]), self.near)
            pull = self.weight * float(middle[0]) * slope**2
            own = summed(self._near_from, pull) + summed(self._near_to, pull)
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
