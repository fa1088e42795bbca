"""What the misprints of sightings do to a flight: the table in "Observations" of docs/flight-equations.md.

``python benchmarks/flight_observations.py [worlds]`` flies the first worlds of the study, six unless told,
with SLAM of 15 states, once as corrected and once with each of the equations 47, 49 and 51 as printed; last,
as corrected in worlds whose GPS has white errors alone.
"""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from positioning.files import read_yaml
from positioning.inertial import flight_filter, landmarks
from positioning.inertial.flight_filter import FlightFilter, navigate_flight
from positioning.model import Array, Recording, Site
from positioning.seeds import stream
from positioning.simulation.sar_flight import simulate

ROOT = Path(__file__).resolve().parents[1]


def without_landmark(*given: Array) -> tuple[Array, Array]:
    """Equation 51 without the columns of the landmark."""
    by_vehicle, by_landmark = landmarks.observation_matrices(*given)
    return by_vehicle, np.zeros_like(by_landmark)


def alone(*given: Array) -> tuple[Array, Array, Array]:
    """Equation 47 as a place alone: a new landmark has nothing in common with the vehicle."""
    place, by_vehicle, by_sighting = landmarks.first_sight(*given)
    return place, np.zeros_like(by_vehicle), by_sighting


def half_circle(relative: Array) -> Array:
    """Equation 49 with the arctangent of y / x."""
    seen = landmarks.sighting_of(relative)
    seen[..., 1] = np.arctan(relative[..., 1] / relative[..., 0])
    return seen


VARIANTS: dict[str, dict[str, Callable[..., Any]]] = {
    "as corrected": {},
    "without the columns of the landmark (51)": {"observation_matrices": without_landmark},
    "without the covariance of a new landmark (47)": {"first_sight": alone},
    "arctangent of y/x (49)": {"sighting_of": half_circle},
}


def part(arrays: dict[str, Any], prefix: str) -> dict[str, Any]:
    """Return the arrays of one side of a world by the names of their fields."""
    return {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}


def main(worlds: int) -> None:
    """Print mean error in the outage, and the normalised error squared of east and north."""
    settings = read_yaml(ROOT / "data/papers/robo_sar.yaml")["settings"]["sar_flight"]
    first = read_yaml(ROOT / "config/config.yaml")["studies"]["sar_flight"]["first_seed"]
    values = {name: line["value"] for name, line in settings.items()}
    print(f"seeds {first} to {first + worlds - 1}: mean error in the outage, NEES of east and north")
    for words, changed in VARIANTS.items():
        fly(words, values, first, worlds, changed)
    fly("as corrected, white GPS", values | {"gps_correlated_m": [0.0] * 3}, first, worlds, {})


def fly(words: str, values: dict[str, Any], first: int, worlds: int, changed: dict[str, Any]) -> None:
    """Print what a filter does in the first worlds, with some functions of the filter exchanged."""
    made = simulate(values, [stream(first + number, "sar_flight") for number in range(worlds)])
    recording = Recording(**part(dict(made.observed), "recording."))
    site = Site(**part(dict(made.observed), "site."))
    begin_s, end_s = np.asarray(recording.gps_outage_s, dtype=float).T[:, :, None]
    inside = (recording.time_s > begin_s) & (recording.time_s <= end_s)
    with ExitStack() as stack:
        for name, function in changed.items():
            stack.enter_context(patch.object(flight_filter, name, function))
        found = navigate_flight(recording, site, FlightFilter(slam=True, states=15))
    off_m = (found.position_m - made.truth["truth.position_m"])[..., ::-1]
    spread = found.covariance[..., :2, :2]
    nees = np.sum(off_m * np.linalg.solve(spread, off_m[..., None])[..., 0], axis=-1)
    print(f"{words}: {np.linalg.norm(off_m, axis=-1)[inside].mean():.3g} m, {nees[inside].mean():.3g}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
