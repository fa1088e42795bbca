"""Approximate inverse of the normal equations of long walks that meet again and again.

A direct factor of such a graph fills up, since every place has been passed by many poses. What makes its
equations hard is the stiffness of the walks, and that is simple: a walk bends like a chain. Here a solution
of the chain alone, in which every pose feels its other edges but these do not feel it, is added to one for
smooth bends, in which poses between knots follow the rigid motions of the two knots about them (two-level
additive Schwarz; see Smith, Bjorstad & Gropp (1996), "Domain Decomposition", chapter 2). Conjugate gradients
need some five iterations with it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import coo_array

from positioning.model import Array

KNOT_EVERY = 20
"""Poses from knot to knot; half or double as many change the number of iterations by one."""

# Of the diagonal of the coarse problem: it is as singular as the frame is free.
_RIDGE = 1e-12


def number_of_knots(joined: NDArray[np.bool_]) -> int:
    """Return how many knots `TwoLevel` has, of which each adds three unknowns to a dense problem.

    Parameters
    ----------
    joined
        Whether a motion leads from each pose to the next, [n - 1].
    """
    ends = np.concatenate([[-1], np.flatnonzero(~joined), [len(joined)]])
    steps = np.diff(ends) - 1
    return int(np.sum(-(-steps // KNOT_EVERY) + 1))


class TwoLevel:
    """Two solutions of simpler equations, added.

    Parameters
    ----------
    joined
        Whether a motion leads from each pose to the next, [n - 1].
    band
        Where the entries (i + k, i) of the matrix stand among its values, [6, 3 n]; -1 where there is none.
    """

    def __init__(self, joined: NDArray[np.bool_], band: NDArray[np.intp]) -> None:
        self._band, self._there = np.maximum(band, 0), band >= 0
        self._poses, self._knots, self._share, self._centres = _knots(joined)
        self._coarse: Any = None
        self._bends: Any = None
        self._chain: Any = None

    def chain(self, values: Array) -> None:
        """Factor the chain of a matrix, given by its values."""
        band = np.where(self._there, values[self._band], 0.0)
        self._chain = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)

    def coarse(self, matrix: Any, pose: Array) -> None:
        """Factor the coarse problem of a matrix [3 n, 3 n] at these poses, [n, 3]."""
        offset_m = pose[self._poses, :2] - pose[self._centres[self._knots], :2]
        row, column, share = 3 * self._poses, 3 * self._knots, self._share
        bends = coo_array(
            (
                np.concatenate([share, share, share, -share * offset_m[:, 1], share * offset_m[:, 0]]),
                (
                    np.concatenate([row, row + 1, row + 2, row, row + 1]),
                    np.concatenate([column, column + 1, column + 2, column + 2, column + 2]),
                ),
            ),
            shape=(3 * len(pose), 3 * len(self._centres)),
        ).tocsr()
        small = (bends.T @ (matrix @ bends)).toarray()
        place = np.arange(len(small))
        small[place, place] *= 1.0 + _RIDGE
        self._bends, self._coarse = bends, cho_factor(small, lower=True, check_finite=False)

    def solve(self, right: Array) -> Array:
        """Return an approximate solution, [3 n]."""
        fine = cho_solve_banded((self._chain, True), right, check_finite=False)
        smooth = cho_solve(self._coarse, self._bends.T @ right, check_finite=False)
        return np.asarray(fine + self._bends @ smooth)


def _knots(joined: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """Return poses, the knots that they follow and by what share, and the pose of each knot."""
    begin = np.concatenate([[0], np.flatnonzero(~joined) + 1])
    end = np.concatenate([begin[1:], [len(joined) + 1]])
    poses, knots, shares, centres = [], [], [], []
    count = 0
    for first, after in zip(begin.tolist(), end.tolist(), strict=True):
        last = after - first - 1
        centre = np.unique(np.round(np.linspace(0, last, -(-last // KNOT_EVERY) + 1)).astype(np.intp))
        here = np.arange(last + 1)
        left = np.minimum(np.searchsorted(centre, here, side="right") - 1, max(len(centre) - 2, 0))
        right = np.minimum(left + 1, len(centre) - 1)
        part = (here - centre[left]) / np.maximum(centre[right] - centre[left], 1)
        poses += [first + here, first + here]
        knots += [count + left, count + right]
        shares += [1.0 - part, part]
        centres.append(first + centre)
        count += len(centre)
    return np.concatenate(poses), np.concatenate(knots), np.concatenate(shares), np.concatenate(centres)
