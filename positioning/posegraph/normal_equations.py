"""Normal equations of a graph of poses as a sparse matrix: where their values stand, and how they are solved.

A direct factor solves them where it stays small; where it would fill up, conjugate gradients with the inverse
of `positioning.posegraph.preconditioner` do.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from positioning.model import Array
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.preconditioner import TwoLevel, number_of_knots

# A factor with fewer values an unknown costs no more than a few iterations.
_HEAVY = 200
# A coarse problem is dense: with more knots a pose it would cost more than the factor that it replaces.
_MOST_KNOTS = 0.2
_CLOSE, _CG_ITERATIONS = 1e-3, 200
# A new coarse problem costs as much as some fifteen iterations.
_CG_MORE = 8


class Pattern:
    """Where the values of the normal equations stand in a sparse matrix.

    Coordinates of a pose stay together, as 3 x 3 blocks: an order that gives little fill-in is found on the
    graph of poses, once. Where its factor would fill up nevertheless, the poses keep their order.

    Parameters
    ----------
    graph
        The graph.
    free
        Indices of the poses that may move, ascending.
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
