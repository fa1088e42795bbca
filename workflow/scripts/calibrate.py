"""Find the one free setting at which a baseline has its printed number, on worlds of its own."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from scipy.optimize import brentq

from positioning.errors import InputError
from positioning.evaluation.metrics import figures_of_merit
from positioning.files import write_json
from positioning.joblog import logging_to
from positioning.model import Worlds
from positioning.registry import factory
from positioning.seeds import stream

TOLERANCE = 1e-3


def main(
    study: str, families: Mapping[str, Mapping[str, Any]], steps: Sequence[Mapping[str, Any]], output: str
) -> None:
    """Calibrate one setting after the other, each with those before it, in the first family of worlds.

    Every trial draws the same random numbers, so that two trials differ by the setting alone.

    Raises
    ------
    InputError
        Where the printed number lies outside what the setting's range gives.
    """
    simulate = import_module(f"positioning.simulation.{study}").simulate
    found: list[dict[str, Any]] = []
    for step in steps:
        settings = {**next(iter(families.values())), **{f["setting"]: f["value"] for f in found}}
        found.append(calibrate(study, simulate, settings, step))
    write_json(output, found)


def calibrate(
    study: str,
    simulate: Callable[..., Worlds],
    settings: Mapping[str, Any],
    step: Mapping[str, Any],
) -> dict[str, Any]:
    """Return one calibrated setting, and how it was found."""
    row, seeds, target = step["row"], step["seeds"], float(step["printed"])
    task = import_module(f"positioning.tasks.{row['task']}")
    make = factory(row["use"], row["task"], row["parameters"])
    trials: dict[float, float] = {}

    def excess(value: float) -> float:
        worlds = simulate({**settings, step["setting"]: value}, [stream(seed, study) for seed in seeds])
        generators = [stream(seed, study, row["use"]) for seed in seeds]
        outcome = task.run(make, worlds.observed, None, row["options"], generators)
        errors = task.score(outcome.estimates, worlds.truth)["error_m"]
        trials[value] = float(np.mean(figures_of_merit(errors)[step["metric"]]))
        return trials[value] - target

    low, high = (float(end) for end in step["between"])
    if excess(low) * excess(high) > 0:
        raise InputError(
            f"{study}, calibration of {step['setting']}",
            f"{step['metric']} of {row['name']} is {trials[low]:.3f} at {low} and {trials[high]:.3f} at"
            f" {high}, the printed {step['printed']} is not between them",
            "Widen `between` in config/config.yaml",
        )
    value = round(float(brentq(excess, low, high, xtol=TOLERANCE)), 3)
    return {
        "setting": step["setting"],
        "value": value,
        "row": row["name"],
        "metric": step["metric"],
        "claim": step["claim"],
        "printed": step["printed"],
        "reached": round(excess(value) + target, 4),
        "worlds": len(seeds),
        "first_seed": seeds[0],
        "settings_tried": len(trials),
    }


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.families,
            snakemake.params.steps,
            snakemake.output[0],
        )
