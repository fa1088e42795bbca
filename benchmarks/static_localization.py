"""Print how far static trilateration is off in each coordinate, on calibration worlds.

Raghavan et al., section IV.E, set the deviation of a fix so; ``sigma_m`` of the study's filters is the
number printed here for the row whose fixes they use. The worlds are those that the calibration uses, and
judge nothing.

Usage: ``python -m benchmarks.static_localization`` after a build.
"""

import sys

import numpy as np

from positioning.files import read_json, read_yaml
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.bluetooth_robot import simulate
from positioning.simulation.settings import calibrated_settings
from positioning.tasks import trilateration

sys.path.insert(0, "workflow")
from planning.config import resolve

STUDY = "bluetooth_robot"


def main() -> None:
    study = resolve(read_yaml("config/config.yaml"))[STUDY]
    steps = read_json(f"results/calibration/{STUDY}.json")
    made = {}
    for family, settings in study.families.items():
        (own,) = [step for step in steps if step["family"] == family]
        numbers = range(own["first_seed"], own["first_seed"] + own["worlds"])
        streams = [stream(n, STUDY) for n in numbers]
        made[family] = simulate({**settings, **calibrated_settings(steps, family)}, streams)
    for name, row in study.entries.items():
        if row.task != "trilateration":
            continue
        variances = []
        for worlds in made.values():
            seeds = worlds.observed["recording.time_s"].shape[0]
            outcome = trilateration.run(
                factory(row.use, row.task, row.parameters),
                worlds.observed,
                None,
                row.options,
                [stream(n, STUDY, name) for n in range(seeds)],
            )
            errors = trilateration.score(outcome.estimates, worlds.truth)
            variances.append(np.nanmean(np.square([errors["error_x_m"], errors["error_y_m"]])))
        told = ", ".join(f"{f} {np.sqrt(v):.2f}" for f, v in zip(made, variances, strict=True))
        print(f"{name}: {np.sqrt(np.mean(variances)):.2f} m a coordinate ({told})")


if __name__ == "__main__":
    main()
