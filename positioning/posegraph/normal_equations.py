"""Normal equations of a graph of poses as a sparse matrix: where their values stand, and how they are solved.

A direct factor solves them where it stays small; where it would fill up, conjugate gradients with the inverse
of `positioning.posegraph.preconditioner` do.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array
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

BLOCK = np.array([[0, 1], [1, 2]])
"""Which of the three values (xx, xy, yy) of a symmetric block stands where."""


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

    Attributes
    ----------
    motion_pair, near_pair
        `incidence` of the pairs of free poses that motions join, and of those that are near: of all edges,
        those that join two free poses.
    motion_swapped
        Whether the second pose of a motion is the first one of its pair, [e].
    """

    def __init__(self, graph: PoseGraph, free: NDArray[np.intp]) -> None:
        count = len(free)
        number = np.full(len(graph.pose), -1)
        number[free] = np.arange(count)
        motion, near = (
            np.sort(number[np.stack([start, end])], axis=0)
            for start, end in ((graph.motion_from, graph.motion_to), (graph.near_from, graph.near_to))
        )
        motion_both, near_both = motion[0] >= 0, near[0] >= 0
        self.motion_swapped = number[graph.motion_from] > number[graph.motion_to]
        ends = np.concatenate([motion[:, motion_both], near[:, near_both]], axis=1)
        key, pair = np.unique(ends[0] * count + ends[1], return_inverse=True)
        first, second = np.divmod(key, count)
        split = int(motion_both.sum())
        stiff, motion_pair = np.unique(pair[:split], return_inverse=True)
        soft, near_pair = np.unique(pair[split:], return_inverse=True)
        self.motion_pair = incidence(motion_pair, len(stiff), motion_both)
        self.near_pair = incidence(near_pair, len(soft), near_both)

        joined = np.zeros(max(count - 1, 0), dtype=bool)
        next_pose = motion_both & (motion[1] == motion[0] + 1)
        joined[motion[0, next_pose]] = True
        place = np.arange(count)
        few_knots = number_of_knots(joined) <= _MOST_KNOTS * count
        # Nine values a block, three unknowns a pose. A factor has no fewer values than its matrix.
        heavy = few_knots and 3 * (count + 2 * len(key)) > _HEAVY * count
        if not heavy:
            order, fill = _little_fill(first, second, count)
            heavy = few_knots and 3 * fill > _HEAVY * count
            place = place if heavy else order
        full = np.zeros(len(key), dtype=bool)
        full[stiff] = True
        here, one, two = place, place[first], place[second]
        row, column = np.concatenate([here, two, one]), np.concatenate([here, one, two])
        # Proximity knows no headings: its blocks have two rows and two columns.
        whole = np.concatenate([np.ones(count, dtype=bool), full, full])
        base, self._start = _columns(row, column, whole, count)
        self._size = int(self._start[-1])
        diagonal, (lower, upper) = _places(base[:count], 3), np.split(base[count:], 2)
        joint = np.stack([_places(upper[stiff], 3), np.swapaxes(_places(lower[stiff], 3), -1, -2)])
        shared = np.stack([_places(upper[soft], 2), np.swapaxes(_places(lower[soft], 2), -1, -2)])
        # Where each value comes from, among those of the blocks one after the other.
        values_from = 9 * count + 9 * len(stiff) + 3 * np.arange(len(soft))[:, None, None] + BLOCK
        self._from = np.empty(self._size, dtype=np.intp)
        self._from[shared] = values_from
        self._from[joint] = 9 * count + np.arange(9 * len(stiff)).reshape(-1, 3, 3)
        self._from[diagonal] = np.arange(9 * count).reshape(-1, 3, 3)
        twice = full[soft]
        self._twice = shared[:, twice].ravel()
        self._twice_from = np.concatenate([values_from[twice].ravel()] * 2)
        self._row = np.empty(self._size, dtype=np.intc)
        for blocks, ends in ((shared, soft), (joint, stiff)):
            within = np.arange(blocks.shape[-1])
            self._row[blocks[0]] = 3 * one[ends, None, None] + within[:, None]
            self._row[blocks[1]] = 3 * two[ends, None, None] + within
        self._row[diagonal] = 3 * here[:, None, None] + np.arange(3)[:, None]
        self._unknown = (3 * place[:, None] + np.arange(3)).ravel()
        self._middle = np.diagonal(diagonal, axis1=-2, axis2=-1).ravel()
        self._near_inverse: TwoLevel | None = None
        # Iterations with the coarse problem when it was new; None = there is none, or it is of no more use.
        self._needed: int | None = None
        if heavy:
            next_one = np.flatnonzero(second == first + 1)
            below = np.where(full[next_one, None, None], _places(lower[next_one], 3), -1)
            below[:, :2, :2] = _places(lower[next_one], 2)
            self._near_inverse = TwoLevel(joined, _band(diagonal, first[next_one], below))

    def values(self, diagonal: Array, joint: Array, shared: Array) -> Array:
        """Return the values of the matrix from its blocks.

        Those of poses [count, 3, 3], of pairs that a motion joins [m, 3, 3], and (xx, xy, yy) of pairs that
        are near [p, 3]. A pair's block has the rows of its first pose, its transpose stands across.
        """
        source = np.concatenate([diagonal.ravel(), joint.ravel(), shared.ravel()])
        # Reading from few places is much faster than writing to many.
        values = source[self._from]
        values[self._twice] += source[self._twice_from]
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


def incidence(index: NDArray[Any], count: int, some: NDArray[np.bool_] | None = None) -> Any:
    """Return the sparse matrix [count, e] whose product with rows sums them by index.

    Parameters
    ----------
    index
        Where each row is summed, [e], or only those that ``some``, [e], marks.
    count
        Number of sums.
    some
        Rows that are summed at all; None = all.
    """
    edges = np.arange(len(index)) if some is None else np.flatnonzero(some)
    shape = (count, len(index) if some is None else len(some))
    return coo_array((np.ones(len(edges)), (index, edges)), shape=shape).tocsr()


def summed(ends: Any, values: Array) -> Array:
    """Return sums of rows, [count, ...], by an `incidence` [count, e] of the rows, [e, ...]."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:], dtype=int)))
    return np.asarray((ends @ flat).reshape(ends.shape[0], *values.shape[1:]), dtype=np.float64)


def _columns(
    row: NDArray[Any], column: NDArray[Any], whole: NDArray[np.bool_], count: int
) -> tuple[NDArray[np.intp], NDArray[np.intc]]:
    """Return where the values of blocks begin in each of their columns, [b, 3], and those of all columns.

    From the block row and block column of each block, [b], and whether it is a whole one, 3 x 3; others are
    2 x 2 and have nothing in the third column. The beginnings of all columns are [3 count + 1].
    """
    order = np.argsort(column * count + row)
    bounds = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=count))])
    height = np.where(whole[order, None], [3, 3, 3], [2, 2, 0])
    before = np.concatenate([np.zeros((1, 3), dtype=np.intp), np.cumsum(height, axis=0)])
    start = np.concatenate([[0], np.cumsum(np.diff(before[bounds], axis=0).ravel())])
    base = np.empty((len(row), 3), dtype=np.intp)
    base[order] = before[:-1]
    base += (start[:-1].reshape(-1, 3) - before[bounds[:-1]])[column]
    return base, start.astype(np.intc)


def _places(base: NDArray[np.intp], size: int) -> NDArray[np.intp]:
    """Return where the values of blocks [size, size] stand, from where their columns begin, [b, 3]."""
    return base[:, None, :size] + np.arange(size)[:, None]


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
