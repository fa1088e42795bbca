"""What a configuration resolves to: studies, and the rows of their tables."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from planning.code import constructor_defaults, first_line
from positioning.registry import class_name


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


def _nested(value: Any) -> list[str]:
    """Return the files of all algorithms that stand in a setting."""
    if not isinstance(value, Mapping):
        return []
    own = [f"algorithms/{value['task']}/{value['use']}.py"] if {"use", "task"} <= value.keys() else []
    return own + [source for part in value.values() for source in _nested(part)]
