"""Templates of pages, and what all of them may use."""

from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from positioning.presentation.tables import HEADINGS, NOTHING
from positioning.presentation.tones import PALETTES, TONES


def environment() -> Environment:
    """Return the environment in which templates are filled: undefined names raise, text is escaped."""
    filled = Environment(
        loader=PackageLoader("positioning.presentation"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    filled.filters["tone"] = lambda verdict: TONES.get(verdict, "plain")
    filled.filters["as_text"] = as_text
    filled.globals["palettes"] = PALETTES
    filled.globals["headings"] = HEADINGS
    filled.globals["nothing"] = NOTHING
    return filled


def as_text(value: Any) -> str:
    """Return a setting's value as a reader writes it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(
            f"{key} = {'(' + as_text(part) + ')' if isinstance(part, Mapping) else as_text(part)}"
            for key, part in value.items()
        )
    if isinstance(value, (list, tuple)):
        return ", ".join(as_text(part) for part in value)
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
