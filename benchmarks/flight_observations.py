"""What misprints do to a flight: numbers of "Dynamics" and "Observations" in docs/flight-equations.md.

``python benchmarks/flight_observations.py [worlds]`` flies the first worlds of the study, six unless told,
with SLAM of 15 states, once as corrected and once with each of the equations 47, 49 and 51 as printed; then,
as corrected in worlds whose GPS has white errors alone. Last it tells how far the flat model, and GPS without
the columns of the lever arm, move the tracks of two filters.
"""

import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from positioning.files import read_yaml
from positioning.inertial import flight_filter, landmarks
from positioning.inertial.flight_filter import navigate_flight
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.gps import metric_observation_matrix
from positioning.model import Array, Recording, Site, Worlds
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


def without_lever_arm(attitude: Array, rate: Array, lever_m: Array, *, states: int) -> Array:
    """Equations 28 and 30, which know no lever arm."""
    return metric_observation_matrix(attitude, rate, np.zeros_like(lever_m), states=states)


VARIANTS: dict[str, dict[str, Callable[..., Any]]] = {
    "as corrected": {},
    "without the columns of the landmark (51)": {"observation_matrices": without_landmark},
    "without the covariance of a new landmark (47)": {"first_sight": alone},
    "arctangent of y/x (49)": {"sighting_of": half_circle},
}

WHITE = {"gps_correlated_m": [0.0] * 3}
"""Settings of worlds whose GPS has white errors alone."""


def part(arrays: dict[str, Any], prefix: str) -> dict[str, Any]:
    """Return the arrays of one side of a world by the names of their fields."""
    return {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}


class Flown(NamedTuple):
    """Tracks of a filter in all worlds, [world, n]: places east and north, metres; errors; NEES."""

    position_m: Array
    error_m: Array
    nees: Array
    in_outage: NDArray[np.bool_]


def main(worlds: int) -> None:
    """Print mean error in the outage and NEES of each variant, then how far two others move a track."""
    settings = read_yaml(ROOT / "data/papers/robo_sar.yaml")["settings"]["sar_flight"]
    first = read_yaml(ROOT / "config/config.yaml")["studies"]["sar_flight"]["first_seed"]
    values = {name: line["value"] for name, line in settings.items()}
    made = simulated(values, first, worlds)
    slam = FlightFilter(slam=True, states=15)
    print(f"seeds {first} to {first + worlds - 1}: mean error in the outage, NEES of east and north")
    for words, changed in VARIANTS.items():
        tell(words, fly(made, slam, changed))
    tell("as corrected, white GPS", fly(simulated(values | WHITE, first, worlds), slam))
    gps = FlightFilter(states=15)
    for words, filter_settings in (("GPS and inertial unit", gps), ("SLAM", slam)):
        right = fly(made, filter_settings)
        moved("flat model (42), " + words, right, fly(made, replace(filter_settings, model="flat")))
        bare = fly(made, filter_settings, {"metric_observation_matrix": without_lever_arm})
        moved("GPS without the columns of the lever arm (28, 30), " + words, right, bare)


def simulated(values: dict[str, Any], first: int, worlds: int) -> Worlds:
    """Return the first worlds of the study with some settings."""
    return simulate(values, [stream(first + number, "sar_flight") for number in range(worlds)])


def fly(made: Worlds, settings: FlightFilter, changed: Mapping[str, Callable[..., Any]] = {}) -> Flown:
    """Return what a filter does in some worlds, with some functions of the filter exchanged."""
    recording = Recording(**part(dict(made.observed), "recording."))
    site = Site(**part(dict(made.observed), "site."))
    begin_s, end_s = np.asarray(recording.gps_outage_s, dtype=float).T[:, :, None]
    with ExitStack() as stack:
        for name, function in changed.items():
            stack.enter_context(patch.object(flight_filter, name, function))
        found = navigate_flight(recording, site, settings)
    off_m = (found.position_m - made.truth["truth.position_m"])[..., ::-1]
    spread = found.covariance[..., :2, :2]
    return Flown(
        found.position_m,
        np.linalg.norm(off_m, axis=-1),
        np.sum(off_m * np.linalg.solve(spread, off_m[..., None])[..., 0], axis=-1),
        (recording.time_s > begin_s) & (recording.time_s <= end_s),
    )


def tell(words: str, flown: Flown) -> None:
    """Print mean error in the outage and NEES."""
    inside = flown.in_outage
    print(f"{words}: {flown.error_m[inside].mean():.3g} m, {flown.nees[inside].mean():.3g}")


def moved(words: str, right: Flown, other: Flown) -> None:
    """Print how far a variant moves the tracks of the corrected filter, and their mean error."""
    apart_m, inside = np.linalg.norm(other.position_m - right.position_m, axis=-1), right.in_outage
    before_m, after_m = right.error_m[inside].mean(), other.error_m[inside].mean()
    print(
        f"{words}: tracks move by at most {apart_m.max():.2g} m, {apart_m[inside].max():.2g} m in the outage;"
        f" the mean error there goes from {before_m:.4g} m by {after_m - before_m:+.2g} m"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
