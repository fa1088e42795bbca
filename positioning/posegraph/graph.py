"""Poses, and what ties them to each other.

See Gu et al., section III and Fig. 2.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from positioning.errors import InputError
from positioning.model import Array

Indices = NDArray[np.integer[Any]]

_ROUNDING = 1e-6
_EMPTY = {
    **dict.fromkeys(("motion_from", "motion_to", "near_from", "near_to"), np.intp),
    **dict.fromkeys(("fixed", "loop"), np.bool_),
}


def _none() -> Indices:
    return np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, kw_only=True)
class PoseGraph:
    """Poses in the plane with edges of motion and of proximity.

    Attributes
    ----------
    pose
        [n, 3]: x and y, metres, and heading, radians from the x axis to the left, need not be wrapped.
    motion_from, motion_to
        Poses at both ends of each motion edge, [e].
    motion
        The second pose seen from the first: forward and left, metres, and turn, radians, [e, 3]; the u of
        eq. 6. A loop closure that gives a relative pose is a motion edge as well.
    motion_information
        Inverse covariance of the residual of eq. 7, in the frame of the first pose, [e, 3, 3].
    near_from, near_to
        Poses that are near each other, [f]; each pair stands once.
    fixed
        Whether the pose keeps its value, [n].
    near_weight
        Weight of each proximity edge, [f], as a multiple of the common one; None = one.
    loop
        Motion edges that may be wrong and that a robust loss acts upon, [e]; None = none of them.
    """

    pose: Array
    motion_from: Indices
    motion_to: Indices
    motion: Array
    motion_information: Array
    fixed: NDArray[np.bool_]
    near_from: Indices = field(default_factory=_none)
    near_to: Indices = field(default_factory=_none)
    near_weight: Array | None = None
    loop: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Make arrays of lists.

        Raises
        ------
        InputError
            For rows of different lengths.
        """
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None or isinstance(value, np.ndarray):
                continue
            try:
                array = np.asarray(value)
            except ValueError as error:
                cure = "Give rows of one length"
                raise InputError(f"graph, {one.name}", "it is no array", cure) from error
            # An empty list has no type of its own.
            object.__setattr__(
                self, one.name, array if array.size else array.astype(_EMPTY.get(one.name, float))
            )

    def check(self, name: str = "graph") -> Self:
        """Return this graph if it can be used.

        Parameters
        ----------
        name
            The name under which the user knows this graph, for the error.

        Raises
        ------
        InputError
            For shapes that do not fit each other, values that are not finite numbers, marks that are neither
            true nor false, edges to poses that there are not or from a pose to itself, information that is
            not symmetric and positive semi-definite, or negative weights.
        """
        poses = len(self.pose) if np.ndim(self.pose) else 0
        motions, nears = np.size(self.motion_from), np.size(self.near_from)
        for what, values, shape in (
            ("pose", self.pose, (poses, 3)),
            ("fixed", self.fixed, (poses,)),
            ("motion_from", self.motion_from, (motions,)),
            ("motion_to", self.motion_to, (motions,)),
            ("motion", self.motion, (motions, 3)),
            ("motion_information", self.motion_information, (motions, 3, 3)),
            ("near_from", self.near_from, (nears,)),
            ("near_to", self.near_to, (nears,)),
            ("near_weight", self.near_weight, (nears,)),
            ("loop", self.loop, (motions,)),
        ):
            if values is None:
                continue
            if np.shape(values) != shape:
                cure = "Give one row for every pose or edge"
                raise InputError(f"{name}, {what}", f"its shape is {np.shape(values)}, not {shape}", cure)
            _finite(f"{name}, {what}", np.asarray(values))
            if what in ("fixed", "loop"):
                _marks(f"{name}, {what}", np.asarray(values))
        if not poses:
            raise InputError(name, "it has no pose", "Give at least one")
        for kind, start, end in (
            ("motion", self.motion_from, self.motion_to),
            ("near", self.near_from, self.near_to),
        ):
            _edges(f"{name}, {kind}_from and {kind}_to", start, end, poses)
        _information(f"{name}, motion_information", np.asarray(self.motion_information, dtype=np.float64))
        if self.near_weight is not None and (np.asarray(self.near_weight) < 0).any():
            edge = int(np.argmin(self.near_weight))
            limit = f"{self.near_weight[edge]} is negative"
            raise InputError(f"{name}, near_weight[{edge}]", limit, "Give a weight from zero")
        return self

    def component(self) -> tuple[int, Indices]:
        """Return the number of connected parts, and the part of each pose, [n]."""
        start = np.concatenate([self.motion_from, self.near_from])
        end = np.concatenate([self.motion_to, self.near_to])
        size = len(self.pose)
        links = coo_array((np.ones(len(start)), (start, end)), shape=(size, size))
        number, label = connected_components(links, directed=False)
        return int(number), label

    def loose(self) -> Indices:
        """Return the first pose of each connected part in which no pose is fixed."""
        number, label = self.component()
        held = np.bincount(label, weights=self.fixed, minlength=number) > 0
        first = np.unique(label, return_index=True)[1]
        return np.asarray(first[~held])

    def tied(self) -> Self:
        """Return this graph with the first pose fixed in each connected part that has no fixed pose.

        What is not connected cannot be aligned; each part is then optimised in its own frame.
        """
        fixed = np.array(self.fixed, dtype=bool)
        fixed[self.loose()] = True
        return replace(self, fixed=fixed)


class Solved(NamedTuple):
    """What an algorithm makes of a graph.

    Attributes
    ----------
    pose
        [n, 3], metres and radians, in the frame of the fixed poses.
    extra
        Whatever else it wants to keep, each a number or [n, ...].
    """

    pose: Array
    extra: Mapping[str, NDArray[np.generic]] = {}


def checked(graph: Any) -> PoseGraph:
    """Return what is a graph that can be used.

    Raises
    ------
    InputError
        As `PoseGraph.check`, and for anything that is no graph, the name of a file for example.
    """
    if not isinstance(graph, PoseGraph):
        cure = "Give a PoseGraph; positioning.posegraph.g2o.read makes one of a file"
        raise InputError("graph", f"it is a {type(graph).__name__}, not a PoseGraph", cure)
    return graph.check()


def _marks(what: str, values: NDArray[Any]) -> None:
    bad = (values != 0) & (values != 1)
    if bad.any():
        place = int(np.argmax(bad))
        raise InputError(
            f"{what}[{place}]", f"{values[place]} is neither true nor false", "Give True or False"
        )


def _finite(what: str, values: NDArray[Any]) -> None:
    if values.dtype.kind not in "biuf":
        raise InputError(what, f"its values are no numbers ({values.dtype})", "Give numbers")
    bad = ~np.isfinite(values)
    if bad.any():
        where = [int(i) for i in np.argwhere(bad)[0]]
        raise InputError(
            f"{what}{where}",
            f"the value {values[tuple(where)]} is not a finite number",
            "Leave out poses and edges without a value",
        )


def _edges(what: str, start: Indices, end: Indices, poses: int) -> None:
    for values in (start, end):
        if values.size and not np.issubdtype(values.dtype, np.integer):
            raise InputError(what, f"their type is {values.dtype}", "Give numbers of poses as integers")
    ends = np.stack([start, end], axis=-1)
    outside = ((ends < 0) | (ends >= poses)).any(axis=-1)
    if outside.any():
        edge = int(np.argmax(outside))
        raise InputError(
            f"{what}, edge {edge}",
            f"it joins poses {int(start[edge])} and {int(end[edge])}, the poses are 0 to {poses - 1}",
            "Correct it",
        )
    if (start == end).any():
        edge = int(np.argmax(start == end))
        raise InputError(
            f"{what}, edge {edge}", f"it joins pose {int(start[edge])} to itself", "Leave it out"
        )


def _information(what: str, information: Array) -> None:
    if not len(information):
        return
    skew, negative = wrong_information(information)
    for bad, text in ((skew, "not symmetric"), (negative, "not positive semi-definite")):
        if bad.any():
            edge = int(np.argmax(bad))
            raise InputError(f"{what}[{edge}]", f"it is {text}", "Give the inverse of a covariance")


def wrong_information(information: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which matrices, [e, 3, 3], are not symmetric, and which are not positive semi-definite."""
    size = np.abs(information).max(axis=(-2, -1))
    skew = np.abs(information - np.swapaxes(information, -1, -2)).max(axis=(-2, -1)) > _ROUNDING * size
    negative = np.linalg.eigvalsh(information)[:, 0] < -_ROUNDING * size
    return np.asarray(skew), np.asarray(negative)
