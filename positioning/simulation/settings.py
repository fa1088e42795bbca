"""Reads the settings of a simulation: no default hides in code, and a senseless value is named."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError

Span = tuple[float, float]


def number(
    settings: Mapping[str, Any],
    name: str,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    above: float = -math.inf,
) -> float:
    """Return one setting that must be a finite number within limits.

    Parameters
    ----------
    settings
        All settings by name.
    name
        Name of the setting.
    least, most
        Smallest and largest value allowed.
    above
        Limit that the value must exceed.

    Raises
    ------
    InputError
        Naming the setting, if it is missing or senseless.
    """
    return _checked(name, _present(settings, name), least, most, above)


def whole(settings: Mapping[str, Any], name: str, *, least: int) -> int:
    """Return one setting that must be a whole number of at least ``least``; else raise InputError."""
    value = number(settings, name, least=least)
    if value != int(value):
        raise InputError(f"setting {name}", f"{value} is not a whole number", "Give a whole number")
    return int(value)


def numbers(
    settings: Mapping[str, Any], name: str, count: int, *, least: float = -math.inf, integer: bool = False
) -> tuple[float, ...]:
    """Return one setting that must be a list of ``count`` finite numbers; else raise InputError."""
    value = _present(settings, name)
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != count:
        raise InputError(
            f"setting {name}", f"{value!r} is not a list of {count} numbers", f"Give {count} numbers"
        )
    found = tuple(_checked(name, item, least, math.inf, -math.inf) for item in value)
    if integer and any(item != int(item) for item in found):
        raise InputError(f"setting {name}", f"{value!r} are not all whole numbers", "Give whole numbers")
    return found


def span(settings: Mapping[str, Any], name: str, *, least: float = -math.inf) -> Span:
    """Return one setting that must be [low, high], or a number for both; else raise InputError."""
    value = _present(settings, name)
    pair = numbers(settings, name, 2, least=least) if isinstance(value, Sequence) else (value, value)
    low, high = (_checked(name, item, least, math.inf, -math.inf) for item in pair)
    if low > high:
        raise InputError(f"setting {name}", f"{low} is above {high}", "Give the lower end first")
    return low, high


def rows(settings: Mapping[str, Any], name: str, columns: int, *, least: int) -> NDArray[np.float64]:
    """Return one setting that must be a list of rows of numbers, at least ``least``, [row, column].

    Raises InputError, naming the setting, if it is missing or senseless.
    """
    # Asked for as numbers, a setting that is missing is named like any other.
    found = settings[name] if name in settings else numbers(settings, name, columns)
    if isinstance(found, str) or not isinstance(found, Sequence) or len(found) < least:
        raise InputError(
            f"setting {name}",
            f"{found!r} is not a list of at least {least} rows",
            f"Give rows of {columns} numbers",
        )
    labelled = {f"{name}[{row}]": value for row, value in enumerate(found)}
    table = [numbers(labelled, label, columns) for label in labelled]
    return np.asarray(table, dtype=np.float64).reshape(-1, columns)


def calibrated_settings(steps: Sequence[Mapping[str, Any]], family: str) -> dict[str, float]:
    """Return the calibrated settings that hold in a family of worlds: its own, and those for all.

    Parameters
    ----------
    steps
        Calibrations as they stand in ``results/calibration/<study>.json``: ``setting``, ``value`` and
        ``family``, None where the setting holds in all.
    family
        Name of the family.
    """
    return {step["setting"]: step["value"] for step in steps if step["family"] in (None, family)}


def _present(settings: Mapping[str, Any], name: str) -> Any:
    if name not in settings:
        raise InputError(
            f"setting {name}",
            "it is missing and no default hides in the code",
            "Add it to the study's settings",
        )
    return settings[name]


def _checked(name: str, value: Any, least: float, most: float, above: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise InputError(f"setting {name}", f"{value!r} is not a finite number", "Give a number")
    if not least <= value <= most or value <= above:
        limits = [f"at least {least}"] * (least > -math.inf) + [f"at most {most}"] * (most < math.inf)
        limits += [f"above {above}"] * (above > -math.inf)
        raise InputError(
            f"setting {name}", f"{value} is not {' and '.join(limits)}", "Give a value within the limits"
        )
    return float(value)
