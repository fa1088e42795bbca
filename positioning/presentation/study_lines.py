"""What is told of a study before its numbers: worlds, rows, sweeps and settings, each in a line of words."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from positioning.evaluation.entries import protocol_of, task_of
from positioning.presentation.environment import as_text
from positioning.presentation.tones import is_control
from positioning.simulation.settings import calibrated_settings

SHOWN = 3
"""So many recordings of one kind are named in a line, the others counted."""

Entries = Mapping[str, Mapping[str, Any]]


def coded(text: str) -> Markup:
    """Return a text with what stands between backticks set as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def breakable(name: str) -> Markup:
    """Return a name set as code that may break behind its underscores."""
    return Markup(f"<code>{str(escape(name)).replace('_', '_<wbr>')}</code>")


def in_words(value: Any) -> str:
    """Return a setting's value as a reader writes it.

    Places and the like stand in brackets each, and so do the settings of an algorithm.
    """
    if isinstance(value, list) and value and all(isinstance(part, list) for part in value):
        return ", ".join(f"({in_words(part)})" for part in value)
    if isinstance(value, Mapping) and "use" in value:
        own = {name: part for name, part in value.items() if name not in ("use", "task")}
        return str(value["use"]) + (f" ({pairs(own)})" if own else "")
    return as_text(value)


def pairs(settings: Mapping[str, Any]) -> str:
    """Return settings as names with their values."""
    return ", ".join(f"{name} = {in_words(value)}" for name, value in settings.items())


def world_lines(
    plan: Mapping[str, Any], paper: Mapping[str, Any], steps: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Return one line a family of worlds, or one a kind of recordings, in words.

    Parameters
    ----------
    plan
        As in `positioning.presentation.pages.Report`.
    paper
        Settings of the study in the paper: ``value`` and ``unit`` by name.
    steps
        Calibrations, as the rule of this name writes them.

    Returns
    -------
    list of dict
        ``names``; ``more``, how many others there are of that kind; ``meaning``; ``changed``, the settings
        whose value is not that of the paper's list: ``name``, ``text`` and whether ``calibrated``.
    """
    meanings = plan.get("meanings", {})
    kinds: dict[str, list[str]] = {}
    for name in plan["recordings"]:
        kinds.setdefault(meanings.get(name, ""), []).append(name)
    lines: list[dict[str, Any]] = [
        {
            "names": names if len(names) <= SHOWN + 1 else names[:SHOWN],
            "more": len(names) - SHOWN if len(names) > SHOWN + 1 else 0,
            "meaning": coded(_sentence(meaning)),
            "changed": [],
        }
        for meaning, names in kinds.items()
    ]
    for family, settings in plan["families"].items():
        changed = [
            {"name": name, "text": f"{used} {_unit(paper[name]['unit'])}".strip(), "calibrated": calibrated}
            for name, (used, calibrated) in used_in(family, settings, steps).items()
            if name in paper and used != in_words(paper[name]["value"])
        ]
        meaning = coded(_sentence(meanings.get(family, "")))
        lines.append({"names": [family], "more": 0, "meaning": meaning, "changed": changed})
    return lines


def used_in(
    family: str, settings: Mapping[str, Any], steps: Sequence[Mapping[str, Any]]
) -> dict[str, tuple[str, bool]]:
    """Return the value of each setting that a family of worlds has, and whether calibration set it.

    Parameters
    ----------
    family
        Its name.
    settings
        As the plan has them, before calibration.
    steps
        Calibrations, as the rule of this name writes them.
    """
    found = calibrated_settings(steps, family)
    return {name: (in_words(found.get(name, value)), name in found) for name, value in settings.items()}


def scene_line(text: str) -> str:
    """Return what a world of a study holds, from the first line of the module that makes it."""
    return re.sub(r"^The synthetic worlds of the study \w+: ", "Each world: ", text)


def row_lines(entries: Entries) -> list[dict[str, Any]]:
    """Return what each row is: its algorithm in words, and how it differs from an earlier row of the same.

    Parameters
    ----------
    entries
        Of the plan: ``use``, ``parameters``, ``options`` and ``meaning`` by row.

    Returns
    -------
    list of dict
        ``name``, ``use``, ``what`` (HTML), ``settings``, ``task``, ``protocol`` and ``is_control``.
    """
    rows = {str(entry.get("use", name)): name for name, entry in reversed(list(entries.items()))}
    first: dict[tuple[str, str], str] = {}
    lines = []
    for name, entry in entries.items():
        use = str(entry.get("use", name))
        base = first.setdefault((use, task_of(entry)), name)
        own = _settings_of(entry)
        if base == name:
            what = _of_this_study(str(entry["meaning"]), rows) if entry.get("meaning") else _library(use)
            told = [what, f"With {pairs(own)}." if own else ""]
        else:
            told = [f"Like `{base}`{_difference(own, _settings_of(entries[base]))}."]
        lines.append(
            {
                "name": name,
                "use": use,
                "what": coded(" ".join(part for part in [*told, _sentence(_where(entry))] if part)),
                "settings": pairs(own),
                "task": task_of(entry),
                "protocol": protocol_of(entry),
                "is_control": is_control(use),
            }
        )
    return lines


def sweep_lines(sweeps: Entries, figures: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Return each sweep: which algorithm, which setting, the values tried, what stayed fixed.

    Parameters
    ----------
    sweeps
        Of the plan; one may give all settings of its row, or setting and values alone.
    figures
        The figure of the page that shows a sweep, by its name.
    """
    lines = []
    for name, sweep in sweeps.items():
        row = sweep if isinstance(sweep, Mapping) else {"over": sweep}
        setting, values = row["over"]
        fixed = {key: value for key, value in _settings_of(row).items() if key != setting}
        lines.append(
            {
                "name": name,
                "use": str(row.get("use", "")),
                "setting": setting,
                "over": as_text(values),
                "count": len(values),
                "fixed": "; ".join(part for part in [pairs(fixed), _where(row)] if part),
                "figure": (figures or {}).get(name, ""),
            }
        )
    return lines


def setting_lines(
    paper: Mapping[str, Any], families: Mapping[str, Mapping[str, Any]], steps: Sequence[Mapping[str, Any]]
) -> dict[str, list[dict[str, Any]]]:
    """Return the settings in two lists: what the paper reports, and what had to be assumed.

    Parameters
    ----------
    paper
        Settings of the study in the paper.
    families
        Settings in use, by family.
    steps
        Calibrations, as the rule of this name writes them.

    Returns
    -------
    dict of list
        ``reported`` and ``assumed``; each line has ``name``, ``value``, ``unit``, ``where`` (place or reason)
        and ``used``: where another value is used, the families, the value and whether it is ``calibrated``.
    """
    used = {family: used_in(family, settings, steps) for family, settings in families.items()}
    found: dict[str, list[dict[str, Any]]] = {"reported": [], "assumed": []}
    for name, setting in paper.items():
        value = in_words(setting["value"])
        instead: dict[tuple[str, bool], list[str]] = {}
        for family, values in used.items():
            if name in values and values[name] != (value, False):
                instead.setdefault(values[name], []).append(family)
        found["assumed" if setting.get("assumed") else "reported"].append(
            {
                "name": name,
                "value": value,
                "unit": setting["unit"],
                "where": coded(setting.get("where", setting.get("why", ""))),
                "used": [
                    {
                        "text": text,
                        "calibrated": calibrated,
                        "families": [] if len(named) == len(used) else named,
                    }
                    for (text, calibrated), named in instead.items()
                ],
            }
        )
    return found


def _settings_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {**entry.get("parameters", {}), **entry.get("options", {})}


def _difference(own: Mapping[str, Any], base: Mapping[str, Any]) -> str:
    other = {name: value for name, value in own.items() if name not in base or base[name] != value}
    default = [f"`{name}`" for name in base if name not in own]
    told = [pairs(other)] * bool(other) + [f"{', '.join(default)} as by default"] * bool(default)
    return ", but with " + " and ".join(told) if told else ""


def _where(entry: Mapping[str, Any]) -> str:
    worlds, families = entry.get("worlds"), entry.get("families") or ()
    told = [f"on {worlds} world{'s' * (worlds != 1)}"] if worlds else []
    told += [f"in {', '.join(f'`{family}`' for family in families)}"] if families else []
    return f"only {' '.join(told)}" if told else ""


def _library(use: str) -> str:
    module, _, name = use.rpartition(".")
    return f"`{name}` of the library {module.partition('.')[0]}." if module else ""


def _of_this_study(text: str, rows: Mapping[str, str]) -> str:
    """Return a text whose names of classes are names of rows, or of algorithms where no row has them."""

    def name(found: re.Match[str]) -> str:
        use = re.sub(r"(?<!^)(?=[A-Z])", "_", found[1]).lower()
        return f"`{rows.get(use, use)}`"

    return re.sub(r"`([A-Z]\w*)`", name, text)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "." * (text[-1:] not in ("", ".", "!", "?"))


def _unit(unit: str) -> str:
    """Return a unit without explanations and without the word for none."""
    return "" if unit in ("1", "word") or " or " in unit else re.split(r",| \(", unit)[0]
