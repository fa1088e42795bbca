"""Checks of single names, values and files, whose errors say what was meant or is possible."""

import difflib
from collections.abc import Iterable, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import jsonschema

from planning.code import Choices, fits
from positioning.errors import InputError
from positioning.files import read_yaml

LISTED = 160
"""Names that are possible are listed up to so many characters."""

KINDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "text",
    "None": "null",
    "tuple": "",
}
"""Kinds of values in words."""


def check_schema(value: Any, schema: Path, name: str) -> None:
    """Check a value against a JSON schema.

    Raises
    ------
    InputError
        Naming the key, the value and what is allowed there.
    """
    validator = jsonschema.Draft202012Validator(read_yaml(schema))
    error = jsonschema.exceptions.best_match(validator.iter_errors(value))
    if error is None:
        return
    key = ".".join([name, *(str(part) for part in error.absolute_path)])
    if error.validator == "additionalProperties":
        allowed = sorted(error.schema.get("properties", {}))
        unknown = sorted(set(error.instance) - set(allowed))[0]
        raise InputError(
            f"{key}.{unknown}",
            f"the key is unknown{hint(unknown, allowed)}",
            f"Allowed are {some_of(unknown, allowed)}",
        )
    if error.validator == "required":
        missing = [name for name in error.validator_value if name not in error.instance]
        raise InputError(
            key, f"the key {missing[0]} is missing", "Add it; config/README.md tells its meaning"
        )
    if error.validator == "oneOf":
        raise InputError(
            key,
            "it needs either worlds and first_seed, or recordings without worlds, world, families, calibrate",
            "Keep one kind; config/README.md shows both",
        )
    rules = {
        "minimum": "at least {}",
        "maximum": "at most {}",
        "type": "of type {}",
        "enum": "one of {}",
        "pattern": "a name like {}",
        "minProperties": "at least {} entry",
        "minItems": "at least {} values",
        "maxItems": "at most {} values",
        "maxProperties": "at most {} entry",
    }
    allowed_values = rules.get(error.validator, error.validator + " {}").format(error.validator_value)
    raise InputError(
        key, f"the value {error.instance!r} is not allowed; it must be {allowed_values}", "Correct it"
    )


def check_value(value: Any, choices: Choices, key: str) -> None:
    """Check a value against what its annotation allows; None = anything.

    Raises
    ------
    InputError
        Naming the key, the value and what it may be.
    """
    if choices is None or fits(value, choices):
        return
    words = [choice.value for choice in choices if choice.kind == "value"]
    kinds = [KINDS[choice.kind] for choice in choices if choice.kind != "value"]
    kinds += [f"a list of {len(c.items)}" for c in choices if c.kind == "tuple" and not c.repeats]
    allowed = " or ".join([", ".join(map(repr, words))] * bool(words) + [kind for kind in kinds if kind])
    if isinstance(value, str):
        limit = f"the value {value!r} is text"
        if (number := _as_number(value)) is not None and any(c.kind in ("float", "int") for c in choices):
            raise InputError(key, f"{limit} to YAML; it must be {allowed}", f"Write {number}")
        near = hint(value, [word for word in words if isinstance(word, str)])
        raise InputError(key, f"the value {value!r} is not allowed{near}", f"It must be {allowed}")
    raise InputError(key, f"the value {value!r} is not allowed", f"It must be {allowed}")


def check_known(value: str, allowed: Iterable[str], key: str, what: str) -> None:
    """Check that a name is one of those that are possible.

    Parameters
    ----------
    value
        The name.
    allowed
        The names that are possible.
    key
        Where it stands in the configuration.
    what
        What it is to name.

    Raises
    ------
    InputError
        Naming the key, the nearest name and the others.
    """
    allowed = list(allowed)
    if value not in allowed:
        raise InputError(
            key,
            f"there is no {what} named {value!r}{hint(value, allowed)}",
            f"Known are {some_of(value, allowed)}" if allowed else "There is none to choose from",
        )


def _as_number(text: str) -> str | None:
    """Return how YAML reads a number that it took for text, None for what is no finite number."""
    try:
        number = Decimal(text.strip())
    except InvalidOperation:
        return None
    if not number.is_finite():
        return None
    plain = f"{number:f}"
    if "e" not in text.lower():
        return f"{plain} without quotes"
    mantissa, exponent = f"{number.normalize():e}".split("e")
    mantissa += "" if "." in mantissa else ".0"
    return f"{plain} or {mantissa}e{int(exponent):+d}"


def nearest(value: str, allowed: Iterable[str]) -> str | None:
    """Return the allowed name that is most like this one, None where none is like it."""
    return next(iter(difflib.get_close_matches(value, list(allowed), n=1, cutoff=0.5)), None)


def hint(value: str, allowed: Iterable[str]) -> str:
    """Return the end of a sentence that asks for the nearest of the allowed names."""
    near = nearest(value, allowed)
    return "" if near is None else f"; did you mean {near!r}"


def some_of(value: str, allowed: Sequence[str]) -> str:
    """Return a line of the allowed names; where they are too many, the nearest ones."""
    if len(", ".join(allowed)) <= LISTED:
        return ", ".join(allowed)
    order = sorted(allowed, key=lambda name: -difflib.SequenceMatcher(None, value, name).ratio())
    shown = [order[0]]
    while len(", ".join([*shown, order[len(shown)]])) <= LISTED:
        shown.append(order[len(shown)])
    return f"{', '.join(shown)} and {len(order) - len(shown)} more"
