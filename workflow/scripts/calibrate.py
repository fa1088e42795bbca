"""Find the one free setting at which a baseline has its printed number, on worlds of its own."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from typing import Any

import numpy as np
from scipy.optimize import brentq
from threadpoolctl import threadpool_limits

from positioning.errors import InputError
from positioning.evaluation.metrics import METRICS, figures_of_merit
from positioning.files import write_json
from positioning.joblog import logging_to
from positioning.model import Worlds
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.settings import calibrated_settings

DIGITS = 3
"""Decimals of a setting that are told apart."""

NEAR = 1e-3
"""Share of the printed number within which it counts as reached."""


def main(
    study: str,
    families: Mapping[str, Mapping[str, Any]],
    steps: Sequence[Mapping[str, Any]],
    processes: int,
    output: str,
) -> None:
    """Calibrate one setting after the other, each with those before it that hold in its family of worlds.

    Worlds are shared out among ``processes``; what comes out does not depend on their number.

    A step that names no family calibrates in the first one, for all; settings of its own hold in its
    calibration worlds only. Every trial draws the same random numbers, so that two trials differ by the
    setting alone.

    Raises
    ------
    InputError
        Where the printed number lies outside what the setting's range gives.
    """
    found: list[dict[str, Any]] = []
    # Forked, so that what is imported here need not be imported again.
    several = processes > 1
    pools = ProcessPoolExecutor(processes, get_context("fork"), _alone) if several else nullcontext()
    with pools as pool:
        for step in steps:
            family = step["family"] or next(iter(families))
            settings = {**families[family], **calibrated_settings(found, family), **step["settings"]}
            found.append(calibrate(study, family, settings, step, pool.map if pool else map, processes))
    write_json(output, found)


def _alone() -> None:
    """Keep a process to one thread.

    Snakemake allows linear algebra as many threads as the job has, in each process; they would wait for each
    other, in three times the time of one.
    """
    threadpool_limits(1)


def calibrate(
    study: str,
    family: str,
    settings: Mapping[str, Any],
    step: Mapping[str, Any],
    spread: Callable[..., Iterable[list[float]]],
    processes: int,
) -> dict[str, Any]:
    """Return one calibrated setting, and how it was found.

    The search ends where the printed number is near, or two values of the setting are too close to tell.
    """
    row, seeds, target = step["row"], step["seeds"], float(step["printed"])
    shares = [[int(seed) for seed in share] for share in np.array_split(seeds, processes) if len(share)]
    trials: dict[float, float] = {}

    def excess(trial: float) -> float:
        value = round(trial, DIGITS)
        if value not in trials:
            trials[value] = measure(value)
        off = trials[value] - target
        return 0.0 if abs(off) <= NEAR * abs(target) else off

    def measure(value: float) -> float:
        tried = partial(per_world, study, family, {**settings, step["setting"]: value}, step)
        return float(np.mean([x for share in spread(tried, shares) for x in share]))

    low, high = (round(float(end), DIGITS) for end in step["between"])
    if excess(low) * excess(high) > 0:
        raise InputError(
            f"{study}, calibration of {step['setting']}",
            f"{step['metric']} of {row['name']} is {trials[low]:.3f} at {low} and {trials[high]:.3f} at"
            f" {high}, the printed {step['printed']} is not between them",
            "Widen `between` in config/config.yaml",
        )
    value = round(float(brentq(excess, low, high, xtol=10**-DIGITS)), DIGITS)
    excess(value)
    return {
        "setting": step["setting"],
        "family": step["family"],
        "settings": dict(step["settings"]),
        "value": value,
        "row": row["name"],
        "metric": step["metric"],
        "claim": step["claim"],
        "printed": step["printed"],
        "reached": round(trials[value], 4),
        "worlds": len(seeds),
        "first_seed": seeds[0],
        "settings_tried": len(trials),
    }


def per_world(
    study: str, family: str, settings: Mapping[str, Any], step: Mapping[str, Any], seeds: Sequence[int]
) -> list[float]:
    """Return the step's metric of its row, one value for each world of these seeds."""
    row = step["row"]
    simulate: Callable[..., Worlds] = import_module(f"positioning.simulation.{study}").simulate
    task = import_module(f"positioning.tasks.{row['task']}")
    worlds = simulate(settings, [stream(seed, study) for seed in seeds])
    make = factory(row["use"], row["task"], row["parameters"])
    generators = [stream(seed, study, row["use"]) for seed in seeds]
    outcome = task.run(make, worlds.observed, None, row["options"], generators)
    if step["metric"] in METRICS:
        errors = task.score(outcome.estimates, worlds.truth)["error_m"]
        return [figures_of_merit(error_m)[step["metric"]] for error_m in errors]
    return own_measure(study, family, step, worlds, outcome.estimates)


def own_measure(
    study: str, family: str, step: Mapping[str, Any], worlds: Worlds, estimates: Mapping[str, Any]
) -> list[float]:
    """Return a measure that the study itself defines, one value a world."""
    measures = import_module(f"positioning.evaluation.studies.{study}").measures
    index = np.arange(len(next(iter(estimates.values()))))
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
            snakemake.threads,
            snakemake.output[0],
        )
