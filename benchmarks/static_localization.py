"""Print how far static trilateration is off in each coordinate, on calibration worlds.

Raghavan et al., section IV.E, set the deviation of a fix so; ``sigma_m`` of the study's filters is the
number printed here. The worlds are those that the calibration uses, and judge nothing.

Usage: ``python -m benchmarks.static_localization`` after a build.
"""

import numpy as np

from positioning.files import read_json, read_yaml
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.bluetooth_robot import simulate
from positioning.simulation.settings import calibrated_settings
from positioning.tasks import trilateration

STUDY, SOLVER = "bluetooth_robot", "iterative_fractional_printed"


def main() -> None:
    study = read_yaml("config/config.yaml")["studies"][STUDY]
    settings = read_yaml(f"data/papers/{study['paper']}.yaml")["settings"][STUDY]
    base = {name: setting["value"] for name, setting in settings.items()}
    steps = read_json(f"results/calibration/{STUDY}.json")
    squares = []
    for family, own in study["families"].items():
        (seeds,) = [s for s in study["calibrate"] if s["family"] == family]
        numbers = range(seeds["first_seed"], seeds["first_seed"] + seeds["worlds"])
        worlds = simulate(
            {**base, **own, **calibrated_settings(steps, family)}, [stream(n, STUDY) for n in numbers]
        )
        made = trilateration.run(
            factory(SOLVER, "trilateration", {}),
            worlds.observed,
            None,
            {},
            [stream(n, STUDY, SOLVER) for n in numbers],
        )
        errors = trilateration.score(made.estimates, worlds.truth)
        own_squares = [
            np.square(errors[name][~np.isnan(errors[name])]) for name in ("error_x_m", "error_y_m")
        ]
        squares.append(np.concatenate(own_squares))
        print(f"{family}: {np.sqrt(squares[-1].mean()):.2f} m a coordinate, {len(numbers)} worlds")
    print(f"both: {np.sqrt(np.mean([own.mean() for own in squares])):.2f} m")


if __name__ == "__main__":
    main()
