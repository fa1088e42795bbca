"""From a configuration line to an algorithm: one file an algorithm, or any scikit-learn regressor.

A setting may itself be an algorithm, ``{use: ...}``: a tracker has its ranging and its trilateration.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from positioning.errors import InputError

Factory = Callable[..., Any]
"""Makes a fresh algorithm; keyword arguments that its constructor does not know are left out."""


def class_name(algorithm: str) -> str:
    """Return the class that ``algorithms/<task>/<algorithm>.py`` defines: the name in CamelCase."""
    return "".join(part.capitalize() for part in algorithm.split("_"))


def factory(use: str, task: str, parameters: Mapping[str, Any]) -> Factory:
    """Return a maker of the algorithm that a configuration line names.

    Parameters
    ----------
    use
        The name of a file of ``algorithms/<task>/``, or the dotted name of a library's class.
    task
        The folder; for a dotted name the task that it is used for.
    parameters
        The line's settings, passed on to the constructor.

    Raises
    ------
    InputError
        For a class that does not exist, has no ``predict``, or does not take a parameter.
    """
    if "." in use:
        cls = _library_class(use)
        if not (hasattr(cls, "fit") and hasattr(cls, "predict")):
            raise InputError(
                f"algorithm {use}",
                "it is no regressor: a class with fit and predict is needed",
                "Name a scikit-learn regressor's class",
            )
    else:
        cls = _own_class(use, task)
    known = inspect.signature(cls).parameters
    _refuse_unknown(parameters, known, use)

    def make(**context: Any) -> Any:
        given = {name: _built(value) for name, value in parameters.items()}
        algorithm = cls(**{**{k: v for k, v in context.items() if k in known}, **given})
        return _with_inputs_prepared(algorithm) if "." in use else algorithm

    make.algorithm_class = cls  # type: ignore[attr-defined]
    return make


def build(line: Mapping[str, Any]) -> Any:
    """Build an algorithm that is part of another one: ``{use: <name>, task: <folder>, ...}``.

    A library's class is called as it is, with the line's other keys.

    Parameters
    ----------
    line
        ``use`` names a file of ``algorithms/<task>/`` or the dotted name of a library's class; the
        planning of a configuration adds ``task``. All other keys go to the constructor.

    Raises
    ------
    InputError
        For a class that does not exist or does not take a parameter.
    """
    use, parameters = line["use"], {k: v for k, v in line.items() if k not in ("use", "task")}
    if "." in use:
        cls = _library_class(use)
    elif "task" in line:
        cls = _own_class(use, line["task"])
        _refuse_unknown(parameters, inspect.signature(cls).parameters, use)
    else:
        raise InputError(f"algorithm {use}", "the line does not name its task", "Add task: to the line")
    return cls(**{name: _built(value) for name, value in parameters.items()})


def changed(parameters: Mapping[str, Any], setting: str, value: Any) -> dict[str, Any]:
    """Return settings with one of them changed; a dot leads into the settings of a part.

    Parameters
    ----------
    parameters
        Settings as in a configuration line; they stay as they are.
    setting
        For example ``k``, or ``fingerprinting.access_points.columns``.
    value
        The new value.
    """
    first, _, rest = setting.partition(".")
    return {**parameters, first: changed(parameters[first], rest, value) if rest else value}


def _refuse_unknown(parameters: Mapping[str, Any], known: Mapping[str, Any], use: str) -> None:
    for name in parameters:
        if name not in known:
            raise InputError(
                f"algorithm {use}, parameter {name}",
                f"its constructor takes {', '.join(known) or 'no parameters'}",
                "Correct the line in config/config.yaml",
            )


def _own_class(use: str, task: str) -> Any:
    module = importlib.import_module(f"algorithms.{task}.{use}")
    cls = getattr(module, class_name(use), None)
    if cls is None:
        raise InputError(
            f"algorithms/{task}/{use}.py",
            f"it defines no class {class_name(use)}",
            "Name the class like the file, in CamelCase",
        )
    return cls


def _library_class(use: str) -> Any:
    module_name, _, name = use.rpartition(".")
    try:
        cls = getattr(importlib.import_module(module_name), name)
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"algorithm {use}",
            f"it cannot be imported ({error})",
            "Check the dotted name, and that the library is installed",
        ) from error
    if not inspect.isclass(cls):
        raise InputError(f"algorithm {use}", "it is no class", "Give the dotted name of a class")
    return cls


def _built(value: Any) -> Any:
    """Build a setting that is itself an algorithm, or an object of a library like a kernel."""
    return build(value) if isinstance(value, Mapping) and "use" in value else value


def _with_inputs_prepared(regressor: Any) -> Any:
    """Put a library's regressor behind what it expects: no NaN, like scales, one target if need be."""
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.multioutput import MultiOutputRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.utils import get_tags

    from positioning.fingerprints import FillNotHeard

    if not get_tags(regressor).target_tags.multi_output:
        regressor = MultiOutputRegressor(regressor)
    scaled = TransformedTargetRegressor(regressor, transformer=StandardScaler(), check_inverse=False)
    return make_pipeline(FillNotHeard(), StandardScaler(), scaled)
