"""Checks the configuration and resolves it into studies, batches of worlds and entries of tables."""

import ast
import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import jsonschema

from planning.code import (
    Choices,
    constructor_choices,
    constructor_defaults,
    constructor_parameters,
    declares,
    first_line,
    fits,
    methods,
    missing_of_library,
)
from positioning.errors import InputError
from positioning.files import read_yaml
from positioning.registry import class_name

SCHEMAS = Path("workflow/schemas")
PAPERS = Path("data/papers")
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
LISTED = 160
"""Names that are possible are listed up to so many characters."""


@dataclass(frozen=True)
class Entry:
    """A row of a table, or the curve of a sweep: one algorithm with its settings."""

    name: str
    use: str
    task: str
    parameters: dict[str, Any]
    options: dict[str, Any]
    over: tuple[str, tuple[float, ...]] | None = None
    worlds: int | None = None
    families: tuple[str, ...] = ()

    @property
    def source(self) -> str | None:
        """The algorithm's file, None for a library's class."""
        return None if "." in self.use else f"algorithms/{self.task}/{self.use}.py"

    @property
    def is_control(self) -> bool:
        """Whether it may see the truth."""
        return self.use.startswith("control_")

    @property
    def sources(self) -> list[str]:
        """Files of the algorithm and of those that its settings build."""
        parts = [use for value in (self.parameters, self.options) for use in _nested(value)]
        return [*([self.source] if self.source else []), *dict.fromkeys(parts)]

    def describe(self) -> dict[str, Any]:
        """Return its settings, and what it stands for: the first line of its class, where that is ours."""
        if self.source is None:
            return self.settings()
        return {**self.settings(), "meaning": first_line(self.source, class_name(self.use))}

    def in_full(self) -> dict[str, Any]:
        """Return its parameters with the defaults of the constructor, as far as these are plain values."""
        own = {} if self.source is None else constructor_defaults(self.source, class_name(self.use))
        return {**own, **self.parameters}

    def settings(self) -> dict[str, Any]:
        """Everything that its results depend on, as a job's parameter."""
        return {
            "name": self.name,
            "use": self.use,
            "task": self.task,
            "parameters": self.parameters,
            "options": self.options,
            "over": None if self.over is None else [self.over[0], list(self.over[1])],
            "worlds": self.worlds,
            "families": list(self.families),
        }


@dataclass(frozen=True)
class Study:
    """One study: worlds made or recorded, the algorithms that run on them, the paper behind it.

    ``scene`` and ``meanings`` (by family or recording) say in words what the worlds are.
    """

    name: str
    title: str
    paper: str
    batch: int
    entries: dict[str, Entry]
    sweeps: dict[str, Entry]
    reference: str
    worlds: int = 0
    first_seed: int = 0
    families: dict[str, dict[str, Any]] = field(default_factory=dict)
    calibrate: list[dict[str, Any]] = field(default_factory=list)
    recordings: dict[str, dict[str, Any]] = field(default_factory=dict)
    figure: str = ""
    scene: str = ""
    meanings: dict[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """Where the worlds come from, which is also the name of their folder in ``data/``."""
        return "recorded" if self.recordings else "synthetic"

    @property
    def rows(self) -> dict[str, Entry]:
        """All entries: those of the table, then those of the sweeps."""
        return {**self.entries, **self.sweeps}

    def calibration_steps(self, claims: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Return the calibrations with the printed number that each hits, in the order of the file."""
        printed = {claim["id"]: claim.get("printed") for claim in claims}
        return [
            {
                **{key: step[key] for key in ("setting", "between", "metric", "claim")},
                "family": step.get("family"),
                "settings": step.get("settings", {}),
                "row": self.entries[step["algorithm"]].settings(),
                "printed": printed[step["claim"]],
                "seeds": [step["first_seed"] + i for i in range(step["worlds"])],
            }
            for step in self.calibrate
        ]

    def batches(self, entry: str | None = None) -> list[str]:
        """Return the batches, named by their first world; a sweep over fewer worlds needs fewer."""
        total = len(self.recordings) or self.worlds
        if entry is not None and self.rows[entry].worlds is not None and not self.recordings:
            total = min(total, self.rows[entry].worlds or total)
        return [f"{first:05d}" for first in range(0, total, self.batch)]

    def describe(self) -> dict[str, Any]:
        """Return the plan as the study's page tells it."""
        return {
            "title": self.title,
            "paper": self.paper,
            "figure": self.figure,
            "entries": {name: row.describe() for name, row in self.entries.items()},
            "sweeps": {name: row.settings() for name, row in self.sweeps.items()},
            "families": self.families,
            "recordings": self.recordings,
            "worlds": self.worlds,
            "first_seed": self.first_seed,
            "reference": self.reference,
            "scene": self.scene,
            "meanings": {
                name: text
                for name, text in self.meanings.items()
                if name in self.families or name in self.recordings
            },
        }

    def members(self, batch: str) -> dict[str, Any]:
        """Return what a batch holds: seeds of worlds by family, or recordings with their options."""
        first = int(batch)
        if self.recordings:
            names = list(self.recordings)[first : first + self.batch]
            return {name: self.recordings[name] for name in names}
        indices = list(range(first, min(first + self.batch, self.worlds)))
        return {"worlds": indices, "seeds": [self.first_seed + i for i in indices], "families": self.families}


@cache
def read_paper(root: Path, key: str) -> dict[str, Any]:
    """Return what a paper reports; read and checked once, however many studies are of it.

    Raises
    ------
    InputError
        Where its file does not follow the schema.
    """
    paper: dict[str, Any] = read_yaml(root / PAPERS / f"{key}.yaml")
    check_schema(paper, root / SCHEMAS / "paper.schema.yaml", f"data/papers/{key}.yaml")
    return paper


def resolve(config: Mapping[str, Any], root: Path = Path()) -> dict[str, Study]:
    """Check a configuration and return its studies.

    Parameters
    ----------
    config
        The configuration as read from ``config/config.yaml`` and overlays.
    root
        The project's folder.

    Raises
    ------
    InputError
        For the first thing that is wrong, before any job starts.
    """
    config = in_order(config, read_yaml(root / "config/config.yaml"))
    for name, study in config.get("studies", {}).items():
        if isinstance(study, Mapping) and "paper" not in study:
            raise InputError(
                f"studies.{name}",
                "it names no paper; is it in an overlay only",
                "Add the study to config/config.yaml, or take it out of the overlay",
            )
    check_schema(config, root / SCHEMAS / "config.schema.yaml", "config")
    papers = sorted(path.stem for path in (root / PAPERS).glob("*.yaml"))
    studies = {}
    for name, values in config["studies"].items():
        key = f"studies.{name}"
        _known(values["paper"], papers, f"{key}.paper", "paper of data/papers/")
        paper = read_paper(root, values["paper"])
        entries = _entries(values["algorithms"], f"{key}.algorithms", root)
        sweeps = _entries(values.get("sweeps", {}), f"{key}.sweeps", root)
        for twice in entries.keys() & sweeps.keys():
            raise InputError(f"{key}.sweeps.{twice}", "a row of the table has this name", "Rename the sweep")
        _check_built_on({**entries, **sweeps}, entries, f"{key}.algorithms", root)
        reference = values.get("reference", next(iter(entries)))
        _known(reference, entries, f"{key}.reference", "row of algorithms")
        study = Study(
            name=name,
            title=values.get("title", name),
            paper=values["paper"],
            batch=values["batch"],
            entries=entries,
            sweeps=sweeps,
            reference=reference,
            worlds=values.get("worlds", 0),
            first_seed=values.get("first_seed", 0),
            recordings={k: v for k, v in values.get("recordings", {}).items() if v is not None},
            calibrate=[
                {**step, "worlds": min(step["worlds"], config.get("calibration_worlds", step["worlds"]))}
                for step in values.get("calibrate", [])
            ],
            families={} if "recordings" in values else _families(values, paper, name),
            figure=values.get("figure", ""),
            scene="" if "recordings" in values else _told(root / f"positioning/simulation/{name}.py"),
            meanings=_meanings(values, key, root),
        )
        for row in study.rows.values():
            for family in row.families:
                known = study.families or study.recordings
                part = "algorithms" if row.name in entries else "sweeps"
                _known(family, known, f"{key}.{part}.{row.name}.families", "family of worlds")
        if "recordings" not in values:
            _check_synthetic(study, paper, root)
        studies[name] = study
    return studies


def in_order(config: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration in the order of the file that it extends, without what is set to null.

    Snakemake puts the keys of an overlay in front. Order matters: the first family of worlds is the
    one that calibrates and that claims speak of, and rows stand in the table as they stand here.
    """
    keys = [*(key for key in base if key in config), *(key for key in config if key not in base)]
    ordered = {}
    for key in keys:
        value, below = config[key], base.get(key)
        if isinstance(value, Mapping):
            value = in_order(value, below if isinstance(below, Mapping) else {})
        ordered[key] = value
    for part in ("studies", "families", "recordings", "algorithms", "sweeps"):
        if isinstance(ordered.get(part), Mapping):
            ordered[part] = {name: entry for name, entry in ordered[part].items() if entry is not None}
    return ordered


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
            f"the key is unknown{_hint(unknown, allowed)}",
            f"Allowed are {_some(unknown, allowed)}",
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


def algorithm_files(root: Path = Path()) -> dict[str, list[str]]:
    """Return the names of the algorithms with the tasks in whose folders they stand."""
    found: dict[str, list[str]] = {}
    for path in sorted((root / "algorithms").glob("*/*.py")):
        if path.stem not in ("__init__", "template"):
            found.setdefault(path.stem, []).append(path.parent.name)
    return found


def _entries(values: Mapping[str, Any], key: str, root: Path) -> dict[str, Entry]:
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
            _known(task, known_tasks, f"{where}.task", "task")
        module = import_module(f"positioning.tasks.{task}")
        if "protocol" in line and "protocol" in module.OPTIONS:
            _known(line["protocol"], module.PROTOCOLS, f"{where}.protocol", f"protocol of {task}")
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


BUILT_ON = {"fixes": ("trilateration", ("ranging", "trilateration")), "steps": ("tracking", ("inertial",))}
"""Options that name another row: the task of that row, and what the row then does not need itself."""


HANDS_UP_STEPS = "foot_inertial"
"""The algorithm whose rows keep the steps that they find."""


def _check_built_on(rows: Mapping[str, Entry], entries: Mapping[str, Entry], key: str, root: Path) -> None:
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
            _known(below, possible, f"{key}.{name}.{option}", f"{task} row of this study that stands alone")
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
            meant = part if part in possible else f"<one of {_some(str(part), possible)}>"
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
                f"Use one of {_some(own_use, possible)}",
            )
        if not _has_needed(name, task, own_use, root):
            raise InputError(
                f"{key}.{name}",
                f"{own_use} has no method {NEEDED[name]}, which {use} calls",
                f"Use one of {_some(own_use, possible)}",
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
        _check_value(value, choices.get(name), f"{key}.{name}")


def _check_value(value: Any, choices: Choices, key: str) -> None:
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
        near = _hint(value, [word for word in words if isinstance(word, str)])
        raise InputError(key, f"the value {value!r} is not allowed{near}", f"It must be {allowed}")
    raise InputError(key, f"the value {value!r} is not allowed", f"It must be {allowed}")


KINDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "text",
    "None": "null",
    "tuple": "",
}
"""Kinds of values in words."""


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


def _check_library(use: str, key: str) -> None:
    """Check that a library's class exists, as far as that shows without importing it."""
    missing = missing_of_library(use)
    if missing is not None:
        name, others = missing
        near = _hint(name.rpartition(".")[2], others)
        raise InputError(
            f"{key}.use",
            f"{use} cannot be imported, there is no {name}{near}",
            "Check the dotted name, and that the library is installed",
        )


Tasks = Mapping[str, list[str]]


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
        elsewhere = _nearest(use, own) is None and _nearest(use, files) is not None
        _known(use, files if elsewhere or not own else own, key, "algorithm")
    if "task" in line:
        _known(str(line["task"]), files[use], f"{key}.task", f"task of {use}")
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


def _nested(value: Any) -> list[str]:
    """Return the files of all algorithms that stand in a setting."""
    if not isinstance(value, Mapping):
        return []
    own = [f"algorithms/{value['task']}/{value['use']}.py"] if {"use", "task"} <= value.keys() else []
    return own + [source for part in value.values() for source in _nested(part)]


def _known_parameters(parameters: Iterable[str], source: Path, use: str, key: str) -> None:
    known = constructor_parameters(str(source), class_name(use))
    if known is not None:
        allowed = [name for name in known if name not in CONTEXT or name == "random_state"]
        for parameter in parameters:
            _known(parameter, allowed, f"{key}.{parameter}", f"parameter of {use}")


def _families(values: Mapping[str, Any], paper: Mapping[str, Any], study: str) -> dict[str, dict[str, Any]]:
    """Settings of every world family: the paper's, over these the study's, over these the family's."""
    reported = {name: setting["value"] for name, setting in paper["settings"].get(study, {}).items()}
    shared = values.get("world", {})
    families = {
        family: {name: value for name, value in (own or {}).items() if name != "meaning"}
        for family, own in (values.get("families") or {"worlds": {}}).items()
    }
    for where, names in (("world", shared), *((f"families.{f}", v) for f, v in families.items())):
        for name in names:
            _known(
                name,
                reported,
                f"studies.{study}.{where}.{name}",
                f"setting of data/papers/{values['paper']}.yaml",
            )
    return {family: {**reported, **shared, **own} for family, own in families.items()}


def _meanings(values: Mapping[str, Any], key: str, root: Path) -> dict[str, str]:
    """Return what is said of families, and of recordings what the adapter's first line says, by name."""
    found = {}
    for name, family in values.get("families", {}).items():
        text = (family or {}).get("meaning", "")
        if not isinstance(text, str):
            raise InputError(f"{key}.families.{name}.meaning", f"{text!r} is no text", "Say it in words")
        found[name] = text
    for name, options in values.get("recordings", {}).items():
        found[name] = _told(root / f"positioning/recordings/{(options or {}).get('adapter')}.py")
    return found


def _told(module: Path) -> str:
    """Return the first line of a module's docstring without importing it; empty where there is none."""
    if not module.is_file():
        return ""
    return (ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def _check_synthetic(study: Study, paper: Mapping[str, Any], root: Path) -> None:
    key = f"studies.{study.name}"
    simulation = Path("positioning/simulation") / f"{study.name}.py"
    if not (root / simulation).is_file():
        raise InputError(
            key, f"there is no {simulation}", "Add the module that simulates this study's worlds"
        )
    claims = {claim["id"]: claim for claim in paper["claims"]}
    ranges = [(f"{key}.worlds", study.first_seed, study.worlds)]
    for number, calibration in enumerate(study.calibrate):
        where = f"{key}.calibrate[{number}]"
        _known(calibration["algorithm"], study.entries, f"{where}.algorithm", "row of algorithms")
        if BUILT_ON.keys() & study.entries[calibration["algorithm"]].options.keys():
            raise InputError(
                f"{where}.algorithm",
                f"{calibration['algorithm']} builds on another row",
                "Calibrate on a row that stands alone",
            )
        _known(calibration["claim"], claims, f"{where}.claim", "claim of the paper")
        if "family" in calibration:
            _known(calibration["family"], study.families, f"{where}.family", "family of worlds")
        claim = claims[calibration["claim"]]
        hits = {k: calibration[k] for k in ("algorithm", "metric", "family") if k in calibration}
        if hits.get("family") == next(iter(study.families)) and "family" not in claim.get("quantity", {}):
            del hits["family"]
        if claim["kind"] != "value" or claim["quantity"] != hits:
            raise InputError(
                f"{where}.claim",
                f"{claim['id']} speaks of {claim.get('quantity')}, the calibration of {hits}",
                "Name the claim whose printed number the calibration shall reach",
            )
        settings = next(iter(study.families.values()))
        _known(calibration["setting"], settings, f"{where}.setting", "setting")
        for name in calibration.get("settings", {}):
            others = [other for other in settings if other != calibration["setting"]]
            _known(name, others, f"{where}.settings", "other setting")
        ranges.append((where, calibration["first_seed"], calibration["worlds"]))
    for i, (name, first, count) in enumerate(ranges):
        for other, other_first, other_count in ranges[i + 1 :]:
            if first < other_first + other_count and other_first < first + count:
                raise InputError(
                    other,
                    f"its seeds {other_first} to {other_first + other_count - 1} overlap with"
                    f" {first} to {first + count - 1} of {name}",
                    "Choose a first_seed outside: worlds that calibrate must not be worlds that judge",
                )


def _known(value: str, allowed: Iterable[str], key: str, what: str) -> None:
    allowed = list(allowed)
    if value not in allowed:
        raise InputError(
            key,
            f"there is no {what} named {value!r}{_hint(value, allowed)}",
            f"Known are {_some(value, allowed)}" if allowed else "There is none to choose from",
        )


def _nearest(value: str, allowed: Iterable[str]) -> str | None:
    return next(iter(difflib.get_close_matches(value, list(allowed), n=1, cutoff=0.5)), None)


def _hint(value: str, allowed: Iterable[str]) -> str:
    """Return the end of a sentence that asks for the nearest of the allowed names."""
    near = _nearest(value, allowed)
    return "" if near is None else f"; did you mean {near!r}"


def _some(value: str, allowed: Sequence[str]) -> str:
    """Return a line of the allowed names; where they are too many, the nearest ones."""
    if len(", ".join(allowed)) <= LISTED:
        return ", ".join(allowed)
    order = sorted(allowed, key=lambda name: -difflib.SequenceMatcher(None, value, name).ratio())
    shown = [order[0]]
    while len(", ".join([*shown, order[len(shown)]])) <= LISTED:
        shown.append(order[len(shown)])
    return f"{', '.join(shown)} and {len(order) - len(shown)} more"
