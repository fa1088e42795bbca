"""What algorithms answer, checked before it is kept, with errors that name the part and the place."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.model import Array

Kind = TypeVar("Kind")

_CURE = "Correct the algorithm"


def checked_answer(answer: Any, kind: type[Kind], method: str, needed: str, cure: str) -> Kind:
    """Return what a method of an algorithm gave, if it is of its kind and keeps its extras by name.

    Parameters
    ----------
    answer
        What it gave.
    kind
        A class with an ``extra``.
    method
        The method, for the error.
    needed
        The kind in words: ``a Solved of positioning.posegraph.graph``.
    cure
        What to return instead.

    Raises
    ------
    InputError
        For another kind, or an ``extra`` that is no mapping.
    """
    if not isinstance(answer, kind):
        raise InputError("its answer", f"{method} gave a {type(answer).__name__}, {needed} is needed", cure)
    extra = getattr(answer, "extra", None)
    if not isinstance(extra, Mapping):
        raise InputError(
            "its answer, extra", f"it is a {type(extra).__name__}", "Give a dict of arrays by name"
        )
    return answer


def checked_array(
    name: str, values: Any, asked: NDArray[np.bool_], parts: tuple[int, ...], axes: Sequence[str] = ()
) -> Array:
    """Return an array of an answer as numbers, if they are there and finite wherever they are asked for.

    Parameters
    ----------
    name
        Its name in the answer.
    values
        What the algorithm gave.
    asked
        Where a number is asked for, [...].
    parts
        Shape behind the axes of ``asked``: (2,) for positions [..., 2], () for headings [...].
    axes
        What each axis of ``asked`` counts, for the error: ``walk``, ``pose``; none: indices alone.

    Raises
    ------
    InputError
        For what is no array, has another shape, or is not finite where it is asked for; it names the first.
    """
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"its answer, {name}", "it is no array", _CURE) from error
    shape = (*asked.shape, *parts)
    if found.shape != shape:
        raise InputError(f"its answer, {name}", f"the shape is {found.shape}, {shape} is needed", _CURE)
    bad = np.argwhere(asked & ~np.isfinite(found).all(axis=tuple(range(asked.ndim, found.ndim))))
    if len(bad):
        words = axes or [""] * asked.ndim
        place = ", ".join(f"{axis} {index}".strip() for axis, index in zip(words, bad[0], strict=True))
        raise InputError(f"its answer, {name}[{place}]", "it is not finite", _CURE)
    return found


def stacked_extra(extras: Sequence[Mapping[str, NDArray[np.generic]]]) -> dict[str, NDArray[np.generic]]:
    """Return what algorithms keep beside their answers, with a world axis, named ``extra_<name>``.

    Raises
    ------
    InputError
        For a world without what the first one has, or with another shape.
    """
    stacked = {}
    for name in extras[0]:
        values = [np.asarray(extra[name]) for extra in extras if name in extra]
        if len(values) < len(extras) or len({value.shape for value in values}) > 1:
            limit = "it is not there with the same shape in every world"
            raise InputError(f"its answer, extra[{name!r}]", limit, _CURE)
        stacked[f"extra_{name}"] = np.stack(values)
    return stacked
