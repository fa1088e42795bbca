"""What a right implementation of the study shows on worlds that no table is made from."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import ROOT

from positioning.model import Worlds
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.fingerprint_loo import simulate
from positioning.tasks import fingerprinting as task

pytestmark = pytest.mark.slow
STUDY = "fingerprint_loo"
CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"][STUDY]
PAPER = yaml.safe_load((ROOT / "data/papers/robo_sar.yaml").read_text(encoding="utf-8"))
FIRST_SEED, COUNT = 500_000, 20


@cache
def worlds() -> Worlds:
    settings = {name: setting["value"] for name, setting in PAPER["settings"][STUDY].items()}
    return simulate(settings, [stream(FIRST_SEED + i, STUDY) for i in range(COUNT)])


@cache
def errors(row: str, count: int = COUNT) -> np.ndarray:
    """Errors [world, point] of a configured row on the first worlds."""
    line = dict(CONFIG["algorithms"][row] or {})
    use, protocol = line.pop("use", row), line.pop("protocol", None)
    # How many worlds of its study a row has; these here are others.
    line.pop("worlds", None)
    observed, truth = ({n: v[:count] for n, v in side.items()} for side in worlds())
    options: dict[str, Any] = {"protocol": protocol} if protocol else {}
    outcome = task.run(
        factory(use, "fingerprinting", line),
        observed,
        truth if use.startswith("control_") else None,
        options,
        [stream(FIRST_SEED + i, STUDY, use) for i in range(count)],
    )
    return task.score(outcome.estimates, truth)["error_m"]


def test_these_worlds_are_not_those_of_the_tables() -> None:
    ranges = [(CONFIG["first_seed"], CONFIG["worlds"])]
    ranges += [(c["first_seed"], c["worlds"]) for c in CONFIG["calibrate"]]
    assert all(first >= FIRST_SEED + COUNT or first + count <= FIRST_SEED for first, count in ranges)


def share(first: str, second: str) -> float:
    return float(np.mean(errors(first).mean(axis=1) < errors(second).mean(axis=1)))


def test_more_neighbours_and_weights_help() -> None:
    assert share("wknn", "knn") >= 0.9
    assert share("knn", "nearest_neighbour") >= 0.9


def test_the_posterior_mean_beats_the_most_likely_place() -> None:
    assert share("bayes_average", "bayes_maximum_likelihood") >= 0.9


@pytest.mark.parametrize("row", [r for r in CONFIG["algorithms"] if r != "control_oracle"])
def test_nothing_beats_the_oracle_on_average(row: str) -> None:
    count = 2
    oracle, other = errors("control_oracle")[:count], errors(row, count)
    assert oracle.mean() < other.mean()
    assert np.square(oracle).mean() < np.square(other).mean()


def test_resubstitution_flatters() -> None:
    assert share("rbf_resubstitution", "rbf_network") == 1.0


def test_every_row_beats_the_centre_of_the_site() -> None:
    for row in ("wknn", "knn", "nearest_neighbour", "bayes_average", "rbf_network", "rbf_network_nearest"):
        assert share(row, "control_centre") == 1.0
