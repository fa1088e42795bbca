"""Few columns of a map that tell the most about all columns: fast orthogonal search.

Also the checks of input that the choices of access points share.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError, check_whole
from positioning.model import Array

Index = NDArray[np.intp]

METHODS = ("total", "threshold")

# A column that keeps no more than this share of its variance is a combination of the chosen ones: what is
# left of it is rounding.
_LEAST_SHARE = 1e-10
# Reductions that differ by no more than this share are equal but for rounding.
_EQUAL_SHARE = 1e-9


class Chosen(NamedTuple):
    """Columns in the order in which they were chosen.

    Attributes
    ----------
    selected
        Column numbers, [..., c].
    reduction
        By how much each lowered the mean square error, summed over all columns, [..., c], in the square of
        the unit of the matrix (dB^2 for received strengths).
    """

    selected: Index
    reduction: Array


def orthogonal_search(matrix: ArrayLike, columns: int, *, method: str = "total") -> Chosen:
    """Choose columns that model all columns of a matrix with the least mean square error.

    See Atia et al., section 5.7, eqs. 9 to 13. The constant term of the model comes first, which the paper
    does not say: without it, a column that is hardly ever heard, and therefore nearly constant, would be
    chosen in its place. All columns are modelled, the chosen ones too.

    No orthogonal function is built. The correlations between all columns cost O(M N^2); each choice then
    takes the part that the new column explains off them, O(N^2).

    Reductions that are equal but for rounding are ties: the column with the lowest number wins. Columns
    that are combinations of chosen ones reduce nothing, and come after all that do, by number; constant
    columns come last, by number.

    Parameters
    ----------
    matrix
        M rows by N columns, [..., M, N], without NaN.
    columns
        How many columns to choose.
    method
        "total": at each step the column with the largest reduction, as in section 5.7.2. "threshold": as in
        section 6.4, one pass over the columns in their order, which keeps a column if its reduction exceeds
        a threshold. That is the largest threshold with which exactly ``columns`` are kept; where none is,
        the largest that keeps more, and the first ``columns`` of these. Which columns it keeps depends on
        their order.

    Returns
    -------
    Chosen
        Column numbers and reductions, [..., columns].

    Raises
    ------
    InputError
        For a matrix without rows or with values that are not finite, more columns than exist, or an unknown
        method.
    """
    values = np.asarray(matrix, dtype=np.float64)
    if method not in METHODS:
        raise InputError(
            f"method={method!r}", f"it must be one of {', '.join(METHODS)}", "Choose one of them"
        )
    if values.ndim < 2 or values.shape[-2] == 0:
        raise InputError("matrix", f"its shape is {values.shape}: no rows", "Give [..., rows, columns]")
    check_columns(columns, values.shape[-1])
    if not np.isfinite(values).all():
        where = ", ".join(str(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise InputError(f"matrix[{where}]", "it is not a finite number", "Fill what was not heard first")
    correlation = _correlations(values)
    if method == "total":
        return _largest_first(correlation, columns)
    worlds = [_one_pass(world, columns) for world in correlation.reshape(-1, *correlation.shape[-2:])]
    shape = (*values.shape[:-2], columns)
    return Chosen(
        np.reshape([world.selected for world in worlds], shape).astype(np.intp),
        np.reshape([world.reduction for world in worlds], shape).astype(np.float64),
    )


def check_columns(columns: int, most: int) -> None:
    """Refuse a number of columns that a map does not have.

    See Atia et al., section 5.7.2.

    Parameters
    ----------
    columns
        The number that is asked for.
    most
        The number that can be had.

    Raises
    ------
    InputError
        If ``columns`` is no whole number, or does not lie between 1 and ``most``.
    """
    check_whole("columns", columns)
    if not 1 <= columns <= most:
        raise InputError(
            f"columns={columns}",
            f"it must lie between 1 and {most}, what this map has",
            "Choose fewer columns, or survey more access points",
        )


def check_readings(rss_dbm: ArrayLike, access_points: int | None = None) -> Array:
    """Return fingerprints if access points can be chosen from them.

    See Atia et al., section 5.7.2.

    Parameters
    ----------
    rss_dbm
        Received signal strength, [n, ap], dBm; NaN = not heard.
    access_points
        The number of access points that there must be; None: any.

    Raises
    ------
    InputError
        For another shape, no fingerprint at all to learn from, or infinite readings.
    """
    rss = np.asarray(rss_dbm, dtype=np.float64)
    learning = access_points is None
    if rss.ndim != 2 or (len(rss) == 0 if learning else rss.shape[1] != access_points):
        expected = "[n, ap] with n from 1" if learning else f"[n, {access_points}]"
        raise InputError(
            f"fingerprints of shape {rss.shape}",
            f"{expected} is needed",
            "Give one column for each access point of the survey, NaN where it was not heard",
        )
    if np.isinf(rss).any():
        where = ", ".join(str(i) for i in np.argwhere(np.isinf(rss))[0])
        raise InputError(f"rss_dbm[{where}]", "the reading is infinite", "Use NaN for not heard")
    return rss


def _correlations(values: Array) -> Array:
    """Return the covariances of all columns, [..., N, N]: what is left of correlations by the constant."""
    # Less the first row, a constant column is exactly zero, whatever the rounding of means.
    centred = values - values[..., :1, :]
    centred -= centred.mean(axis=-2, keepdims=True)
    return np.asarray(np.swapaxes(centred, -1, -2) @ centred / values.shape[-2])


def _largest_first(correlation: Array, columns: int) -> Chosen:
    variance = np.diagonal(correlation, axis1=-2, axis2=-1).copy()
    order = _order_of_the_rest(variance)
    selected = np.empty((*variance.shape[:-1], columns), dtype=np.intp)
    reduction = np.empty(selected.shape)
    for step in range(columns):
        reductions = _reductions(correlation, variance)
        # Below all that reduce the error stand combinations of the chosen, constants and the chosen.
        rank = np.where(reductions > 0, reductions, order)
        best = rank.max(axis=-1, keepdims=True)
        column = np.argmax(rank >= best - _EQUAL_SHARE * np.abs(best), axis=-1)
        selected[..., step] = column
        reduction[..., step] = np.take_along_axis(reductions, column[..., None], axis=-1)[..., 0]
        np.put_along_axis(order, column[..., None], -np.inf, axis=-1)
        _explain(correlation, column, reduction[..., step] > 0)
    return Chosen(selected, reduction)


def _order_of_the_rest(variance: Array) -> Array:
    """Rank columns that reduce nothing: constant ones behind the others."""
    return np.where(variance > 0, -1.0, -2.0)


def _reductions(correlation: Array, variance: Array) -> Array:
    """Return the reduction by each column, [..., N], zero for combinations of the chosen: eq. 13."""
    left = np.diagonal(correlation, axis1=-2, axis2=-1)
    independent = left > _LEAST_SHARE * variance
    total = np.einsum("...ij,...ij->...i", correlation, correlation)
    return np.asarray(np.divide(total, left, out=np.zeros_like(total), where=independent))


def _explain(correlation: Array, column: Index, wanted: NDArray[np.bool_]) -> None:
    """Take what a column explains off all correlations, in place."""
    shared = np.take_along_axis(correlation, column[..., None, None], axis=-1)[..., 0]
    power = np.take_along_axis(shared, column[..., None], axis=-1)
    scaled = np.divide(shared, np.sqrt(np.where(wanted[..., None], power, 1.0)))
    scaled *= wanted[..., None]
    correlation -= scaled[..., :, None] * scaled[..., None, :]


def _one_pass(correlation: Array, columns: int) -> Chosen:
    """Find the largest threshold with which one pass over the columns keeps the number asked for.

    A pass with threshold t stays as it is down to the largest reduction that it refused: these are the only
    thresholds to try. A pass that has kept too many ends at once, since below its threshold, down to the
    largest that it refused until then, every pass keeps the same.
    """
    variance = np.diagonal(correlation).copy()
    known: dict[tuple[int, ...], Array] = {}

    def reductions(chosen: tuple[int, ...]) -> Array:
        if chosen not in known:
            rest = correlation.copy()
            for column in chosen:
                _explain(rest, np.asarray(column), np.asarray(True))
            known[chosen] = _reductions(rest, variance)
        return known[chosen]

    too_many: tuple[int, ...] = ()
    level = np.inf
    while True:
        chosen: tuple[int, ...] = ()
        refused, begin = 0.0, 0
        while len(chosen) <= columns:
            ahead = reductions(chosen)[begin:]
            kept = np.flatnonzero(ahead >= level)
            refused = max(refused, ahead[: kept[0] if len(kept) else None].max(initial=0.0))
            if not len(kept):
                break
            begin += int(kept[0]) + 1
            chosen += (begin - 1,)
        if len(chosen) > columns:
            too_many = too_many or chosen[:columns]
        if len(chosen) == columns or refused == 0:
            break
        level = refused * (1 - _EQUAL_SHARE)
    if len(chosen) != columns and too_many:
        chosen = too_many
    steps = range(min(len(chosen), columns))
    reduction = [reductions(chosen[:step])[chosen[step]] for step in steps]
    order = _order_of_the_rest(variance)
    order[list(chosen)] = -np.inf
    missing = columns - len(chosen)
    rest = np.argsort(-order, kind="stable")[:missing]
    return Chosen(np.array([*chosen, *rest], dtype=np.intp), np.array([*reduction, *[0.0] * missing]))
