"""Limited-memory BFGS for many small problems at once, step for step that of L-BFGS-B without bounds."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from positioning.errors import InputError
from positioning.fingerprints import Index, Mask
from positioning.model import Array

Objective = Callable[[Index, Array], tuple[Array, Array]]
"""Numbers of the problems [p] and their points [p, n] to values [p] and gradients [p, n]."""

# Settings of the line search of L-BFGS-B 3.0: sufficient decrease, curvature, width of the bracket.
_DECREASE, _CURVATURE, _WIDTH = 1e-3, 0.9, 0.1
_LONGEST_STEP = 1e10
_MOST_TRIALS = 20
_EPSILON = float(np.finfo(np.float64).eps)


class Minima(NamedTuple):
    """Where the minimisations ended.

    See Byrd, Lu, Nocedal & Zhu (1995).

    Attributes
    ----------
    point
        [problem, n].
    value
        [problem].
    iterations
        [problem].
    """

    point: Array
    value: Array
    iterations: Index


def minimise_together(
    objective: Objective,
    start: Array,
    *,
    iterations: int,
    gradient_tolerance: float = 1e-5,
    value_tolerance: float = 1e7 * _EPSILON,
    memory: int = 10,
) -> Minima:
    """Minimise problems that do not depend on each other, all by one step at a time.

    See Byrd, Lu, Nocedal & Zhu (1995), of whose method this is the case without bounds, and More & Thuente
    (1994) for the line search. Settings mean what they mean in ``scipy.optimize.minimize`` with
    ``method="L-BFGS-B"``, and steps are those that it would take, but for rounding: with thousands of
    problems of some dozen unknowns each, most of its time is overhead.

    Parameters
    ----------
    objective
        Called with the numbers of those problems that need a value, and with their points.
    start
        [problem, n].
    iterations
        Largest number of steps.
    gradient_tolerance
        A problem ends where no component of its gradient is larger.
    value_tolerance
        A problem ends with a step that lowers the value by less, relative to the larger of value and 1.
    memory
        How many of the latest steps that had a curvature describe it.

    Raises
    ------
    InputError
        If ``iterations`` or ``memory`` is not positive.
    """
    for name, count in (("iterations", iterations), ("memory", memory)):
        if count < 1:
            raise InputError(f"{name}={count}", "it must be at least 1", "Choose a number such as 100")
    point = np.array(start, dtype=np.float64)
    problems, unknowns = point.shape
    value, gradient = objective(np.arange(problems), point)
    step_of = np.zeros((memory, problems, unknowns))
    change_of = np.zeros((memory, problems, unknowns))
    # The inverse of step * change; 0 where a slot is empty, which makes the slot without effect.
    weight = np.zeros((memory, problems))
    scale = np.ones(problems)
    taken = np.zeros(problems, dtype=np.intp)
    running = np.abs(gradient).max(axis=1) > gradient_tolerance
    slot = 0
    while running.any():
        at = np.flatnonzero(running)
        order = [(slot - 1 - back) % memory for back in range(memory)]
        direction = _direction(
            gradient[at], step_of[:, at], change_of[:, at], weight[:, at], scale[at], order
        )
        first = np.where(taken[at] == 0, 1.0 / np.linalg.norm(direction, axis=1), 1.0)
        found, trial, trial_value, trial_gradient = _search(
            objective, at, point[at], value[at], gradient[at], direction, first
        )
        # Where no point along the direction will do, the curvature is forgotten; without any, it ends.
        lost = at[~found]
        running[lost[~weight[:, lost].any(axis=0)]] = False
        weight[:, lost], scale[lost] = 0.0, 1.0
        at = at[found]
        trial, trial_value, trial_gradient = (part[found] for part in (trial, trial_value, trial_gradient))
        step, change = trial - point[at], trial_gradient - gradient[at]
        lowered = value[at] - trial_value
        larger = np.maximum(np.maximum(np.abs(value[at]), np.abs(trial_value)), 1.0)
        slope = np.sum(gradient[at] * step, axis=1)
        product, length = np.sum(step * change, axis=1), np.sum(change * change, axis=1)
        # Too little curvature along the step to learn from.
        known = product > -_EPSILON * slope
        # A pair that is skipped drops no older one: those move on with the slots.
        skipped, learned = at[~known], at[known]
        if len(skipped):
            for kept in (step_of, change_of, weight):
                kept[:, skipped] = np.roll(kept[:, skipped], 1, axis=0)
        step_of[slot, learned], change_of[slot, learned] = step[known], change[known]
        weight[slot, learned] = 1.0 / product[known]
        scale[at] = np.where(known, product / np.where(known, length, 1.0), scale[at])
        slot = (slot + 1) % memory
        point[at], value[at], gradient[at] = trial, trial_value, trial_gradient
        taken[at] += 1
        running[at] = (
            (taken[at] < iterations)
            & (np.abs(trial_gradient).max(axis=1, initial=0.0) > gradient_tolerance)
            & (lowered > value_tolerance * larger)
        )
    return Minima(point, value, taken)


def _direction(
    gradient: Array, step_of: Array, change_of: Array, weight: Array, scale: Array, order: list[int]
) -> Array:
    """Return the quasi-Newton directions [problem, n] by the two loops over the latest steps."""
    direction = -gradient
    along = {}
    for slot in order:
        along[slot] = weight[slot] * np.einsum("pn,pn->p", step_of[slot], direction)
        direction -= along[slot][:, None] * change_of[slot]
    direction *= scale[:, None]
    for slot in reversed(order):
        back = weight[slot] * np.einsum("pn,pn->p", change_of[slot], direction)
        direction += (along[slot] - back)[:, None] * step_of[slot]
    return direction


def _search(
    objective: Objective,
    problem: Index,
    start: Array,
    value: Array,
    gradient: Array,
    direction: Array,
    length: Array,
) -> tuple[Mask, Array, Array, Array]:
    """Return where a good point was found, the points, and the values and gradients there."""
    slope = np.sum(gradient * direction, axis=1)
    found = np.zeros(len(problem), dtype=bool)
    point, at_value, at_gradient = start.copy(), value.copy(), gradient.copy()
    index = np.flatnonzero(slope < 0)
    # State of More & Thuente: the best point (x), the other end of the bracket (y), and the trial.
    trial = length[index]
    zero = np.zeros(len(index))
    state: dict[str, Any] = {
        "x": zero,
        "fx": value[index],
        "dx": slope[index],
        "y": zero,
        "fy": value[index],
        "dy": slope[index],
        "low": zero,
        "high": 5.0 * trial,
        "width": np.full(len(index), _LONGEST_STEP),
        "before": np.full(len(index), 2.0 * _LONGEST_STEP),
        "second": zero.astype(bool),
        "bracketed": zero.astype(bool),
    }
    for _ in range(_MOST_TRIALS):
        if not len(index):
            break
        point[index] = start[index] + trial[:, None] * direction[index]
        at_value[index], at_gradient[index] = objective(problem[index], point[index])
        trial_value = at_value[index]
        trial_slope = np.sum(at_gradient[index] * direction[index], axis=1)
        target_slope = _DECREASE * slope[index]
        target = value[index] + trial * target_slope
        low_enough = trial_value <= target
        done = low_enough & (np.abs(trial_slope) <= -_CURVATURE * slope[index])
        bracketed, low, high = state["bracketed"], state["low"], state["high"]
        done |= bracketed & ((trial <= low) | (trial >= high) | (high - low <= _WIDTH * high))
        done |= (trial >= _LONGEST_STEP) & low_enough & (trial_slope <= target_slope)
        found[index[done]] = True
        left = ~done
        if not left.any():
            break
        index, trial, trial_value, trial_slope, target_slope, low_enough = (
            array[left] for array in (index, trial, trial_value, trial_slope, target_slope, low_enough)
        )
        state = {name: array[left] for name, array in state.items()}
        state["second"] = state["second"] | (low_enough & (trial_slope >= 0))
        trial = _next_trial(state, trial, trial_value, trial_slope, target_slope, low_enough)
    return found, point, at_value, at_gradient


def _next_trial(
    state: dict[str, Any], trial: Array, value: Array, slope: Array, target_slope: Array, low_enough: Mask
) -> Array:
    """Narrow the bracket of every search and return the next step lengths [problem]."""
    # In the first stage the search is for a point below the target line, not for a minimum.
    lowered = ~state["second"] & (value <= state["fx"]) & ~low_enough
    line = np.where(lowered, target_slope, 0.0)
    x, fx, dx = state["x"], state["fx"] - state["x"] * line, state["dx"] - line
    y, fy, dy = state["y"], state["fy"] - state["y"] * line, state["dy"] - line
    f, d = value - trial * line, slope - line
    bracketed = state["bracketed"]
    following, bracketed_now = _interpolate(
        (x, fx, dx), (y, fy, dy), (trial, f, d), bracketed, state["low"], state["high"]
    )
    higher, turned = f > fx, d * dx < 0
    other_is_best = ~higher & turned
    y, fy, dy = (
        np.where(higher, at_trial, np.where(other_is_best, best, other))
        for at_trial, best, other in ((trial, x, y), (f, fx, fy), (d, dx, dy))
    )
    x, fx, dx = (np.where(higher, best, at_trial) for best, at_trial in ((x, trial), (fx, f), (dx, d)))
    state |= {"x": x, "fx": fx + x * line, "dx": dx + line, "y": y, "fy": fy + y * line, "dy": dy + line}
    state["bracketed"] = bracketed_now
    wide = bracketed_now & (np.abs(y - x) >= 0.66 * state["before"])
    following = np.where(wide, x + 0.5 * (y - x), following)
    state["before"] = np.where(bracketed_now, state["width"], state["before"])
    state["width"] = np.where(bracketed_now, np.abs(y - x), state["width"])
    ahead = following - x
    state["low"] = np.where(bracketed_now, np.minimum(x, y), following + 1.1 * ahead)
    state["high"] = np.where(bracketed_now, np.maximum(x, y), following + 4.0 * ahead)
    following = np.clip(following, 0.0, _LONGEST_STEP)
    low, high = state["low"], state["high"]
    stuck = bracketed_now & ((following <= low) | (following >= high) | (high - low <= _WIDTH * high))
    return np.where(stuck, x, following)


def _interpolate(
    best: tuple[Array, Array, Array],
    other: tuple[Array, Array, Array],
    trial: tuple[Array, Array, Array],
    bracketed: Mask,
    low: Array,
    high: Array,
) -> tuple[Array, Mask]:
    """Return the next step lengths by cubics and lines, and where a minimum is bracketed now.

    The four cases are those of More & Thuente (1994), section 4: a higher value; a slope of the other sign;
    a flatter slope; neither.
    """
    (x, fx, dx), (y, fy, dy), (t, f, d) = best, other, trial
    higher, turned, flatter = f > fx, d * dx < 0, np.abs(d) < np.abs(dx)
    # Of all four cases only one is used, and the others may divide by zero.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        theta = 3.0 * (fx - f) / (t - x) + dx + d
        size = np.maximum(np.maximum(np.abs(theta), np.abs(dx)), np.abs(d))
        root = size * np.sqrt(np.maximum((theta / size) ** 2 - (dx / size) * (d / size), 0.0))
        # Higher value: the minimum lies between.
        gamma = np.where(t < x, -root, root)
        cubic = x + ((gamma - dx) + theta) / (((gamma - dx) + gamma) + d) * (t - x)
        parabola = x + ((dx / ((fx - f) / (t - x) + dx)) / 2.0) * (t - x)
        nearer = np.abs(cubic - x) < np.abs(parabola - x)
        of_higher = np.where(nearer, cubic, cubic + (parabola - cubic) / 2.0)
        # The slope changed its sign: the minimum lies between.
        gamma = np.where(t > x, -root, root)
        secant = t + (d / (d - dx)) * (x - t)
        cubic = t + ((gamma - d) + theta) / (((gamma - d) + gamma) + dx) * (x - t)
        of_turned = np.where(np.abs(cubic - t) > np.abs(secant - t), cubic, secant)
        # A flatter slope: the cubic may have no minimum beyond the trial.
        ratio = ((gamma - d) + theta) / ((gamma + (dx - d)) + gamma)
        cubic = np.where((ratio < 0) & (gamma != 0), t + ratio * (x - t), np.where(t > x, high, low))
        closer = np.abs(cubic - t) < np.abs(secant - t)
        within = np.where(closer, cubic, secant)
        limit = t + 0.66 * (y - t)
        within = np.where(t > x, np.minimum(limit, within), np.maximum(limit, within))
        beyond = np.clip(np.where(closer, secant, cubic), low, high)
        of_flatter = np.where(bracketed, within, beyond)
        # Neither: a cubic with the other end of the bracket, or as far as allowed.
        theta = 3.0 * (f - fy) / (y - t) + dy + d
        size = np.maximum(np.maximum(np.abs(theta), np.abs(dy)), np.abs(d))
        root = size * np.sqrt(np.maximum((theta / size) ** 2 - (dy / size) * (d / size), 0.0))
        gamma = np.where(t > y, -root, root)
        cubic = t + ((gamma - d) + theta) / (((gamma - d) + gamma) + dy) * (y - t)
        of_neither = np.where(bracketed, cubic, np.where(t > x, high, low))
    following = np.select([higher, turned, flatter], [of_higher, of_turned, of_flatter], of_neither)
    return following, bracketed | higher | turned
