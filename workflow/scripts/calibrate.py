"""Find the one free setting at which a baseline has its printed number, on worlds of its own."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from scipy.optimize import brentq

from positioning.errors import InputError
from positioning.evaluation.metrics import METRICS, figures_of_merit
from positioning.files import write_json
from positioning.joblog import logging_to
from positioning.model import Worlds
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.settings import calibrated_settings

TOLERANCE = 1e-3


def main(
    study: str, families: Mapping[str, Mapping[str, Any]], steps: Sequence[Mapping[str, Any]], output: str
) -> None:
    """Calibrate one setting after the other, each with those before it that hold in its family of worlds.

    A step that names no family calibrates in the first one, for all. Every trial draws the same random
    numbers, so that two trials differ by the setting alone.

    Raises
    ------
    InputError
        Where the printed number lies outside what the setting's range gives.
    """
    simulate = import_module(f"positioning.simulation.{study}").simulate
    found: list[dict[str, Any]] = []
    for step in steps:
        family = step["family"] or next(iter(families))
        settings = {**families[family], **calibrated_settings(found, family)}
        found.append(calibrate(study, simulate, family, settings, step))
    write_json(output, found)


def calibrate(
    study: str,
    simulate: Callable[..., Worlds],
    family: str,
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
        if step["metric"] in METRICS:
            errors = task.score(outcome.estimates, worlds.truth)["error_m"]
            per_world = [figures_of_merit(error_m)[step["metric"]] for error_m in errors]
        else:
            per_world = own_measure(study, family, step, worlds, outcome.estimates)
        trials[value] = float(np.mean(per_world))
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
        "family": step["family"],
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


def own_measure(
    study: str, family: str, step: Mapping[str, Any], worlds: Worlds, estimates: Mapping[str, Any]
) -> Sequence[float]:
    """Return a measure that the study itself defines, one value a world."""
    measures = import_module(f"positioning.evaluation.studies.{study}").measures
    index = np.arange(len(step["seeds"]))
    values = {f"estimate.{name}": array for name, array in estimates.items()}
    step_values = {"world": index, "value": np.asarray(np.nan), "skipped": np.asarray(""), **values}
    found = measures(
        {f"{step['row']['name']}/00000.npz": {f"{family}/0": step_values}},
        {
            "00000/observed.npz": {family: {"world": index, **worlds.observed}},
            "00000/truth.npz": {family: {"world": index, **worlds.truth}},
        },
    )
    chosen = (found["algorithm"] == step["row"]["name"]) & (found["metric"] == step["metric"])
    if not chosen.any():
        raise InputError(
            f"{study}, calibration of {step['setting']}",
            f"the study measures no {step['metric']} of {step['row']['name']}",
            "Name a column of the tables, or a metric of the study's own measures",
        )
    return [float(x) for x in found.loc[chosen, "x"]]


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.families,
            snakemake.params.steps,
            snakemake.output[0],
        )
