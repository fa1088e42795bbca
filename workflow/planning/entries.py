"""Reads the rows of a study: which algorithm each is, of which task, with which parts and settings."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from planning.checks import check_known, check_value, hint, nearest, some_of
from planning.code import (
    constructor_choices,
    constructor_parameters,
    declares,
    methods,
    missing_of_library,
)
from planning.study import Entry
from positioning.errors import InputError
from positioning.registry import class_name

OPTIONS = ("use", "task", "over", "worlds", "families")
LIBRARY_TASK = "fingerprinting"
CONTEXT = ("site", "truth", "random_state")
"""Constructor parameters that the workflow fills in; a line may set ``random_state`` itself."""
PARTS = {
    **{task: task for task in ("access_points", "fingerprinting", "ranging", "trilateration")},
    "regressor": "fingerprinting",
    "inertial": "tracking",
    "alignment": "alignment",
}
"""Names of settings that are algorithms themselves where the row takes one, and their tasks."""
NEEDED = {"alignment": "placed"}
"""Methods that a part must have beside those of its task."""
LIBRARY_PARTS = ("access_points", "fingerprinting")
"""Tasks of parts that a library's class may do."""
BUILT_ON = {"fixes": ("trilateration", ("ranging", "trilateration")), "steps": ("tracking", ("inertial",))}
"""Options that name another row: the task of that row, and what the row then does not need itself."""
HANDS_UP_STEPS = "foot_inertial"
"""The algorithm whose rows keep the steps that they find."""

Tasks = Mapping[str, list[str]]


def algorithm_files(root: Path = Path()) -> dict[str, list[str]]:
    """Return the names of the algorithms with the tasks in whose folders they stand."""
    found: dict[str, list[str]] = {}
    for path in sorted((root / "algorithms").glob("*/*.py")):
        if path.stem not in ("__init__", "template"):
            found.setdefault(path.stem, []).append(path.parent.name)
    return found


def read_entries(values: Mapping[str, Any], key: str, root: Path) -> dict[str, Entry]:
    """Check the rows of a study and return them by name.

    Parameters
    ----------
    values
        Lines of the configuration by row; None = no settings.
    key
        Where they stand in the configuration.
    root
        The project's folder.

    Raises
    ------
    InputError
        For the first thing that is wrong.
    """
    files = algorithm_files(root)
    used = _tasks_of_the_study(values, files)
    entries = {}
    for name, line in values.items():
        where, line = f"{key}.{name}", dict(line or {})
        use = line.get("use", name)
        task = _task_of(use, line, files, where, used)
        if task == "access_points":
            raise InputError(
                where,
                f"{use} chooses access points and locates nothing, it is part of a row",
                f"Write {name}: {{use: reduced, access_points: {{use: {use}}}}}, for a tracking study inside"
                " {use: fingerprint_alone, fingerprinting: ...}",
            )
        if not Path(root / f"positioning/tasks/{task}.py").is_file():
            known_tasks = sorted(path.stem for path in (root / "positioning/tasks").glob("[a-z]*.py"))
            check_known(task, known_tasks, f"{where}.task", "task")
        module = import_module(f"positioning.tasks.{task}")
        if "protocol" in line and "protocol" in module.OPTIONS:
            check_known(line["protocol"], module.PROTOCOLS, f"{where}.protocol", f"protocol of {task}")
        built = {
            k: _with_tasks(v, files, f"{where}.{k}", root, PARTS.get(k))
            for k, v in line.items()
            if k not in OPTIONS
        }
        over = line.get("over")
        entry = Entry(
            name=name,
            use=use,
            task=task,
            parameters={k: v for k, v in built.items() if k not in module.OPTIONS},
            options={k: v for k, v in built.items() if k in module.OPTIONS},
            over=None if over is None else next((k, tuple(v)) for k, v in over.items()),
            worlds=line.get("worlds"),
            families=tuple(line.get("families", ())),
        )
        if entry.source is not None:
            _known_parameters(entry.parameters, root / entry.source, use, where)
            _check_parts(built, files, where, root, root / entry.source, use, module.OPTIONS)
            _check_values(entry.parameters, root / entry.source, use, where)
            if entry.over:
                line_of = {"use": use, "task": task, **entry.parameters}
                _check_swept(entry.over[0], entry.over[1], line_of, where, root)
        else:
            _check_library(use, where)
        entries[name] = entry
    return entries


def check_built_on(rows: Mapping[str, Entry], entries: Mapping[str, Entry], key: str, root: Path) -> None:
    """Check that rows which build on another one name a row of the right task with their worlds."""
    for name, row in rows.items():
        for option in BUILT_ON.keys() & row.options.keys():
            task, replaced = BUILT_ON[option]
            # A row of steps stands alone: what builds on another row hands nothing up.
            possible = {
                n: entry
                for n, entry in entries.items()
                if entry.task == task and not BUILT_ON.keys() & entry.options.keys()
            }
            below = row.options[option]
            check_known(
                below, possible, f"{key}.{name}.{option}", f"{task} row of this study that stands alone"
            )
            if option == "steps":
                if possible[below].use != HANDS_UP_STEPS:
                    raise InputError(
                        f"{key}.{name}.{option}",
                        f"{below} hands up no steps",
                        f"Name a row of {HANDS_UP_STEPS}",
                    )
                source = row.source
                if source is not None and not declares(
                    str(root / source), class_name(row.use), "takes_steps"
                ):
                    raise InputError(
                        f"{key}.{name}.{option}",
                        f"{row.use} does not take steps of another row, so that this would have no effect",
                        "Leave it out, or use a filter that says takes_steps, such as foot_cascaded_filter",
                    )
            twice = sorted(set(replaced) & row.parameters.keys())
            if twice:
                raise InputError(
                    f"{key}.{name}.{twice[0]}",
                    f"the row takes its {option} from {below}, so that this would have no effect",
                    "Give one of the two",
                )
            worlds = possible[below].worlds
            if worlds is not None and (row.worlds is None or row.worlds > worlds):
                raise InputError(
                    f"{key}.{name}.{option}",
                    f"{below} runs on {worlds} worlds only",
                    "Give this row no more worlds",
                )


def _check_parts(
    line: Mapping[str, Any],
    files: Mapping[str, list[str]],
    key: str,
    root: Path,
    source: Path,
    use: str,
    options: Sequence[str] = (),
) -> None:
    """Check that each setting that must be an algorithm is one, of the right task.

    Where the constructor of ``use`` takes numbers or words under one of these names, it is no part.
    """
    choices = constructor_choices(str(source), class_name(use)) or {}
    for name, task in PARTS.items():
        part = line.get(name)
        if part is None or (name not in options and choices.get(name) is not None):
            continue
        possible = [
            other
            for other, tasks in files.items()
            if task in tasks and not other.startswith("control_") and _has_needed(name, task, other, root)
        ]
        if not isinstance(part, Mapping) or "use" not in part:
            meant = part if part in possible else f"<one of {some_of(str(part), possible)}>"
            raise InputError(
                f"{key}.{name}",
                f"{part!r} is no {task} algorithm: the key use is missing",
                f"Write {name}: {{use: {meant}, ...}}",
            )
        own_use, own = str(part["use"]), part.get("task")
        if own != task and not (own is None and "." in own_use and task in LIBRARY_PARTS):
            raise InputError(
                f"{key}.{name}",
                f"{own_use} is no {task} algorithm" + (f" but one of {own}" if own else ""),
                f"Use one of {some_of(own_use, possible)}",
            )
        if not _has_needed(name, task, own_use, root):
            raise InputError(
                f"{key}.{name}",
                f"{own_use} has no method {NEEDED[name]}, which {use} calls",
                f"Use one of {some_of(own_use, possible)}",
            )


def _has_needed(name: str, task: str, use: str, root: Path) -> bool:
    """Tell whether a part has the method that is called, as far as that shows without importing it."""
    if name not in NEEDED:
        return True
    found = methods(str(root / f"algorithms/{task}/{use}.py"), class_name(use))
    return found is None or NEEDED[name] in found


def _check_values(line: Mapping[str, Any], source: Path, use: str, key: str) -> None:
    """Check settings against the annotations of the constructor, without importing the algorithm."""
    choices = constructor_choices(str(source), class_name(use)) or {}
    for name, value in line.items():
        check_value(value, choices.get(name), f"{key}.{name}")


def _check_library(use: str, key: str) -> None:
    """Check that a library's class exists, as far as that shows without importing it."""
    missing = missing_of_library(use)
    if missing is not None:
        name, others = missing
        near = hint(name.rpartition(".")[2], others)
        raise InputError(
            f"{key}.use",
            f"{use} cannot be imported, there is no {name}{near}",
            "Check the dotted name, and that the library is installed",
        )


def _tasks_of_the_study(values: Mapping[str, Any], files: Mapping[str, list[str]]) -> Tasks:
    """Return the rows of each task that rows name, or whose folder alone holds their algorithm."""
    found: dict[str, list[str]] = {}
    for name, line in values.items():
        line = {"use": name, **(line or {})}
        possible = [LIBRARY_TASK] if "." in line["use"] else files.get(line["use"], [])
        if "task" in line:
            found.setdefault(str(line["task"]), []).append(name)
        elif len(possible) == 1:
            found.setdefault(possible[0], []).append(name)
    return found


def _task_of(
    use: str,
    line: Mapping[str, Any],
    files: Mapping[str, list[str]],
    key: str,
    used: Tasks,
) -> str:
    """Return the task of an algorithm: as the line says, else where its file stands.

    Controls stand in several folders; then the tasks of the study's other rows tell which is meant.
    """
    if "." in use:
        return str(line.get("task", LIBRARY_TASK))
    if use not in files:
        # Of the tasks of the study first: a long list of all others helps nobody.
        own = [name for name, tasks in files.items() if set(tasks) & used.keys()]
        elsewhere = nearest(use, own) is None and nearest(use, files) is not None
        check_known(use, files if elsewhere or not own else own, key, "algorithm")
    if "task" in line:
        check_known(str(line["task"]), files[use], f"{key}.task", f"task of {use}")
        return str(line["task"])
    possible = files[use] if len(files[use]) == 1 else [task for task in files[use] if task in used]
    if len(possible) == 1:
        return possible[0]
    fewest, *others = sorted((used[task] for task in possible), key=len) or [[]]
    if others and len(fewest) < len(others[0]):
        odd = next(task for task in possible if used[task] is fewest)
        most = next(task for task in possible if used[task] is others[-1])
        inside = "Put its line inside a tracker, {use: fingerprint_alone, fingerprinting: {use: ...}}"
        as_part = inside if (odd, most) == ("fingerprinting", "tracking") else "Take it out"
        raise InputError(
            f"{key.rpartition('.')[0]}.{fewest[0]}",
            f"it is a {odd} row among those of {most}, and {use} exists for both",
            f"{as_part}, or add task: to {use}",
        )
    raise InputError(key, f"{use} exists for the tasks {', '.join(files[use])}", "Add task: to the line")


def _with_tasks(
    value: Any, files: Mapping[str, list[str]], key: str, root: Path, task: str | None = None
) -> Any:
    """Check a setting that is itself an algorithm, however deep, and add the task of each."""
    if not isinstance(value, Mapping):
        return value
    built = {
        str(k): _with_tasks(part, files, f"{key}.{k}", root, PARTS.get(str(k))) for k, part in value.items()
    }
    if "use" not in built:
        return built
    use = built["use"]
    if not isinstance(use, str) or not use:
        raise InputError(f"{key}.use", f"{use!r} is no name of an algorithm", "Name a file or a class")
    if "." in use:
        _check_library(use, key)
        return built
    if use.startswith("control_"):
        raise InputError(
            f"{key}.use", f"{use} may see the truth, and so is no part of a row", "Name an algorithm"
        )
    built["task"] = _task_of(use, built, files, key, {} if task is None else {task: []})
    source = root / f"algorithms/{built['task']}/{use}.py"
    own = {k: v for k, v in built.items() if k not in ("use", "task")}
    _known_parameters(own, source, use, key)
    _check_parts(built, files, key, root, source, use)
    _check_values(own, source, use, key)
    return built


def _check_swept(
    setting: str, values: Sequence[float], line: Mapping[str, Any], key: str, root: Path
) -> None:
    """Check the setting of a sweep; a dot leads into the settings of a part of the algorithm."""
    first, _, rest = setting.partition(".")
    source = root / f"algorithms/{line['task']}/{line['use']}.py"
    if "." not in line["use"]:
        _known_parameters([first], source, line["use"], key)
        for value in () if rest else values:
            _check_values({first: value}, source, line["use"], f"{key}.over")
    if rest:
        part = line.get(first)
        if not isinstance(part, Mapping) or "use" not in part:
            raise InputError(
                f"{key}.over.{setting}",
                f"the row builds no algorithm as its {first}",
                f"Give the row {first}: {{use: ...}}, or sweep another setting",
            )
        _check_swept(rest, values, part, f"{key}.{first}", root)


def _known_parameters(parameters: Iterable[str], source: Path, use: str, key: str) -> None:
    known = constructor_parameters(str(source), class_name(use))
    if known is not None:
        allowed = [name for name in known if name not in CONTEXT or name == "random_state"]
        for parameter in parameters:
            check_known(parameter, allowed, f"{key}.{parameter}", f"parameter of {use}")
