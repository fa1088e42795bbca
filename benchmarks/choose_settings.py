"""Prints the settings of SVM and MLP that were tried, with their errors on calibration worlds.

The paper prints none of them. The choice in config/config.yaml is the line with the smallest error; no
printed number enters it, and no world of a table. `python benchmarks/choose_settings.py` takes minutes.
"""

import itertools
import warnings

from positioning.files import read_yaml
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.fingerprint_loo import simulate
from positioning.tasks import fingerprinting as task

STUDY, WORLDS, NOISE_DB = "fingerprint_loo", 5, 5.055
TRIED = {
    "svm": [{"penalty": c, "tube_m": t} for c, t in itertools.product((1.0, 3.0, 10.0), (0.25, 0.75, 1.5))],
    "mlp": [
        {"weight_decay": d, "iterations": i} for d, i in itertools.product((1e-4, 1e-2, 0.3, 3.0), (50, 100))
    ],
}


def main() -> None:
    """Run every setting on the first calibration worlds."""
    warnings.filterwarnings("ignore")
    first_seed = read_yaml("config/config.yaml")["studies"][STUDY]["calibrate"][0]["first_seed"]
    settings = {k: v["value"] for k, v in read_yaml("data/papers/robo_sar.yaml")["settings"][STUDY].items()}
    seeds = range(first_seed, first_seed + WORLDS)
    worlds = simulate({**settings, "noise_db": NOISE_DB}, [stream(seed, STUDY) for seed in seeds])
    for use, lines in TRIED.items():
        for parameters in lines:
            generators = [stream(seed, STUDY, use) for seed in seeds]
            outcome = task.run(
                factory(use, "fingerprinting", parameters), worlds.observed, None, {}, generators
            )
            error_m = task.score(outcome.estimates, worlds.truth)["error_m"].mean()
            print(f"{use} {parameters}: {error_m:.3f} m on {WORLDS} worlds")


if __name__ == "__main__":
    main()
