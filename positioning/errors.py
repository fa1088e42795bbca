"""The one error that users of Reposition meet: it names the thing, the limit and the cure."""

from math import isfinite
from numbers import Integral, Real
from typing import Any, Self


class InputError(ValueError):
    """Input that cannot be used.

    Parameters
    ----------
    thing
        What is wrong, by the name under which the user knows it (a file, a key, a column).
    limit
        The rule that it breaks, with the offending value.
    cure
        What the user can do about it.
    """

    def __init__(self, thing: str, limit: str, cure: str) -> None:
        super().__init__(f"{thing}: {limit}. {cure}.")
        self.thing, self.limit, self.cure = thing, limit, cure

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, str, str]]:
        return type(self), (self.thing, self.limit, self.cure)


class Reason(str):
    """Why an algorithm does not run on given data: what a ``skip`` may answer in place of a plain text.

    Parameters
    ----------
    limit
        The reason, which tables show.
    cure
        What the user can do about it, for whoever calls the algorithm all the same.
    """

    cure: str

    def __new__(cls, limit: str, cure: str) -> Self:
        """Return the reason as a text that knows its cure."""
        reason = super().__new__(cls, limit)
        reason.cure = cure
        return reason


def refusal(thing: str, reason: str) -> InputError:
    """Return the error of an algorithm that is called in spite of its reason not to run.

    Parameters
    ----------
    thing
        What is wrong, by the name under which the user knows it.
    reason
        What ``skip`` answered; the cure is that of a `Reason`.
    """
    return InputError(thing, str(reason), getattr(reason, "cure", "Leave these data out"))


def check_whole(name: str, value: Any, *, least: int | None = None) -> None:
    """Refuse a setting that is no whole number.

    Parameters
    ----------
    name
        The setting.
    value
        What it was set to.
    least
        The smallest number that it may be; None = any.

    Raises
    ------
    InputError
        For anything else, a text or 4.0 as well.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or (least is not None and value < least):
        from_least = "" if least is None else f" from {least}"
        cure = f"Give {name} as a whole number{from_least}"
        raise InputError(f"{name}={value!r}", f"it is not a whole number{from_least}", cure)


def check_number(name: str, value: Any, *, least: float | None = None, above: float | None = None) -> None:
    """Refuse a setting that is no finite number.

    Parameters
    ----------
    name
        The setting.
    value
        What it was set to.
    least, above
        The smallest number that it may be, or one below all that it may be; None = any.

    Raises
    ------
    InputError
        For anything else, a number as text as well.
    """
    number = isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
    if number and (least is None or value >= least) and (above is None or value > above):
        return
    words = "" if least is None else f" from {_words(least)}"
    words += "" if above is None else f" above {_words(above)}"
    as_text = isinstance(value, str)
    raise InputError(
        f"{name}={value!r}",
        f"it is {'text, ' if as_text else ''}not a finite number{words}",
        f"Give {name} as a number{words}" + (", without quotes" if as_text else ""),
    )


def _words(number: float) -> str:
    return f"{number:g}" if number else "zero"
