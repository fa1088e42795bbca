"""Make a batch of synthetic worlds: the observed side and the true side, in files of their own."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from positioning.files import read_json, write_tree
from positioning.joblog import logging_to
from positioning.seeds import stream
from positioning.simulation.settings import calibrated_settings


def main(study: str, members: Mapping[str, Any], calibration: str | None, observed: str, truth: str) -> None:
    """Simulate every family on the same seeds, so that families are paired too."""
    simulate = import_module(f"positioning.simulation.{study}").simulate
    steps = read_json(calibration) if calibration else []
    sides: dict[str, dict[str, Any]] = {"observed": {}, "truth": {}}
    for family, settings in members["families"].items():
        settings = {**settings, **calibrated_settings(steps, family)}
        worlds = simulate(settings, [stream(seed, study) for seed in members["seeds"]])
        index = {"world": np.asarray(members["worlds"]), "seed": np.asarray(members["seeds"])}
        sides["observed"][family] = {**index, **worlds.observed}
        sides["truth"][family] = {**index, **worlds.truth}
    write_tree(observed, sides["observed"])
    write_tree(truth, sides["truth"])


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.members,
            snakemake.input.get("calibration"),
            snakemake.output.observed,
            snakemake.output.truth,
        )
