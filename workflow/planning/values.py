"""Tries settings of worlds and options of recordings on the code that reads them, before any job starts.

No limit is repeated here. Every ``simulate`` reads its settings before it draws, so that called for no world
it refuses what it would refuse in a job; every ``load`` looks at its options before it looks for files, so
that a folder that cannot exist is enough. What such a trial does not tell, a value against what a file holds
or a world that does not come out, its job tells.
"""

import os
import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from planning.checks import check_known, check_value
from planning.code import keywords
from planning.study import Study
from positioning.errors import InputError

ADAPTERS = Path("positioning/recordings")
OF_THE_WORKFLOW = ("adapter", "source")
"""Keys of a recording that are not options of its adapter."""

NOWHERE = Path(os.devnull, "options-are-tried")
"""A folder that cannot exist: what it would stand in is no folder."""


def check_options(studies: Mapping[str, Study], root: Path = Path()) -> None:
    """Check adapters and their options as far as their sources tell: names and kinds, nothing is imported.

    Parameters
    ----------
    studies
        As resolved, with recordings that are absent here.
    root
        The project's folder.

    Raises
    ------
    InputError
        For an adapter that does not exist, an option that it does not have, one that it needs, and a number
        in place of a word or the other way round.
    """
    adapters = [path.stem for path in sorted((root / ADAPTERS).glob("*.py")) if _has_load(path)]
    for study in studies.values():
        for name, recording in study.recordings.items():
            key, adapter = f"studies.{study.name}.recordings.{name}", recording["adapter"]
            check_known(adapter, adapters, f"{key}.adapter", f"adapter of {ADAPTERS}/")
            load = keywords(str(root / ADAPTERS / f"{adapter}.py"), "load")
            if load is None:
                continue
            options = _options(recording)
            for option, value in options.items():
                check_known(option, load, f"{key}.{option}", f"option of {adapter}")
                check_value(value, load[option].choices, f"{key}.{option}")
            for option, keyword in load.items():
                if keyword.needed and option not in options:
                    raise InputError(
                        f"{key}.{option}",
                        f"the option is missing, and {adapter} has no value of its own for it",
                        f"Add it; {ADAPTERS}/{adapter}.py tells its meaning",
                    )


def check_values(studies: Mapping[str, Study], config: Mapping[str, Any]) -> None:
    """Try the settings of all families of worlds, also as calibrations change them, and all options.

    Imports what reads them: 0.3 s for all simulations, up to 1 s for adapters, because of pandas and
    scipy.signal. Leave out recordings whose files are absent.

    Parameters
    ----------
    studies
        As resolved.
    config
        The configuration's ``studies``, which tells where a setting was set.

    Raises
    ------
    InputError
        Naming study, family or recording, and what was set.
    """
    for study in studies.values():
        _check_worlds(study, config[study.name])
        for name, recording in study.recordings.items():
            _check_recording(f"studies.{study.name}.recordings.{name}", recording)


def _check_worlds(study: Study, values: Mapping[str, Any]) -> None:
    simulate = None if study.recordings else _function(f"positioning.simulation.{study.name}", "simulate")
    if simulate is None:
        return
    for key, settings, own in _trials(study, values):
        try:
            simulate(settings, [])
        except InputError as error:
            # What else is refused, such as that there is no world to draw, speaks of no setting.
            if (named := re.match(r"setting (\w+)", error.thing)) is not None:
                raise InputError(_place(study, values, key, own, named[1]), error.limit, error.cure) from None
        except Exception:
            # A study may fail without a world to draw; in its job it has some.
            continue


def _trials(study: Study, values: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, str]]]:
    """Yield settings to be tried, the key that they belong to, and that of each one which is set there."""
    key = f"studies.{study.name}"
    families = {}
    for name, settings in study.families.items():
        own = (values.get("families") or {}).get(name) or {}
        families[name] = {setting: f"{key}.families.{name}.{setting}" for setting in own}
        yield f"{key}.families.{name}", settings, families[name]
    for number, step in enumerate(study.calibrate):
        where, name = f"{key}.calibrate[{number}]", step.get("family", next(iter(study.families)))
        others = step.get("settings", {})
        for end in step["between"]:
            own = {**families[name], **{setting: f"{where}.settings.{setting}" for setting in others}}
            own[step["setting"]] = f"{where}.between"
            yield where, {**study.families[name], **others, step["setting"]: end}, own


def _place(study: Study, values: Mapping[str, Any], key: str, own: Mapping[str, str], setting: str) -> str:
    """Return the key under which a setting stands: the family's, else the study's, else the paper's."""
    if setting in own:
        return own[setting]
    if setting in values.get("world", {}):
        return f"studies.{study.name}.world.{setting}"
    return f"{key}, setting {setting} of data/papers/{study.paper}.yaml"


def _check_recording(key: str, recording: Mapping[str, Any]) -> None:
    load = _function(f"positioning.recordings.{recording['adapter']}", "load")
    if load is None:
        return
    try:
        load(NOWHERE, **_options(recording))
    except InputError as error:
        # All else is about files, as none are there.
        if (named := re.search(r"\boption (\w+)$", error.thing)) is not None:
            raise InputError(f"{key}.{named[1]}", error.limit, error.cure) from None
    except Exception:
        return


def _has_load(path: Path) -> bool:
    return re.search(r"^def load\(", path.read_text(encoding="utf-8"), re.MULTILINE) is not None


def _options(recording: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in recording.items() if name not in OF_THE_WORKFLOW}


def _function(module: str, name: str) -> Any:
    """Return a function; None where the module does not import here, which its job then tells."""
    try:
        return getattr(import_module(module), name, None)
    except Exception:
        return None
