"""How far the misprints of eqs. 8.1 and 9.1 move the error of a flight without aiding; prints a table.

See Mirzababaei & Akbari, eqs. 8 to 11. The error obeys ``x' = F x``, with F constant in a steady, level
flight. The difference d of the errors by a printed and by the mended F obeys ``d' = F_printed d + (F_printed
- F) x``, and is found with x, by the exponential of one matrix, free of the rounding of a difference.

Run as ``python benchmarks/flight_misprints.py``.
"""

import numpy as np
from scipy.linalg import expm

from positioning.inertial.earth import EARTH_RATE_RAD_PER_S, meridian_radius_m, normal_radius_m
from positioning.inertial.geodetic import position_scale_m
from positioning.inertial.geodetic_error_state import error_dynamics
from positioning.model import Array

PLACE = np.array([np.radians(35.7), np.radians(51.4), 1209.0])
"""Of the study's flights."""

SPEEDS_M_PER_S, SINK_M_PER_S, UNAIDED_S = (5.0, 20.0), 0.3, 40.0
HEADINGS_RAD = {"north-east": np.pi / 4, "east": np.pi / 2}
START = np.repeat([10.0, 0.1, 0.01], 3)
"""Error at the begin, metres, metres a second and radians, along all axes."""


def printed_entries(velocity_m_per_s: Array) -> dict[str, tuple[int, int, float]]:
    """Return row, column and value of each entry as printed, by the equation."""
    north, east, down = velocity_m_per_s
    latitude, height = PLACE[0], PLACE[2]
    meridian, normal = meridian_radius_m(latitude) + height, normal_radius_m(latitude) + height
    cosine, tangent = np.cos(latitude), np.tan(latitude)
    coriolis = 2 * EARTH_RATE_RAD_PER_S * east * cosine
    return {
        "8.1": (1, 0, float(east * np.sin(latitude) / (normal**2 * cosine))),
        "9.1, row 1": (3, 0, float(-coriolis - east / (normal * cosine**2))),
        "9.1, row 2": (4, 2, float(-east * down / meridian**2 - north * east * tangent / normal**2)),
    }


def moved_m(velocity_m_per_s: Array) -> dict[str, float]:
    """Return how far each misprint moves the error of the position, horizontally, metres."""
    dynamics = error_dynamics(PLACE, velocity_m_per_s, np.eye(3), np.array([0.0, 0.0, -9.8]))
    scale_m = position_scale_m(PLACE)
    start = START / np.concatenate([scale_m, np.ones(6)])
    found = {}
    for name, (row, column, value) in printed_entries(velocity_m_per_s).items():
        change = np.zeros((9, 9))
        change[row, column] = value - dynamics[row, column]
        both = np.block([[dynamics + change, change], [np.zeros((9, 9)), dynamics]])
        # Metres, else the entries of 1e-13 drown beside those of 10.
        units = np.tile(np.concatenate([scale_m, np.ones(6)]), 2)
        both = units[:, None] * both / units
        end = expm(both * UNAIDED_S) @ np.concatenate([np.zeros(9), start * units[:9]])
        found[name] = float(np.hypot(end[0], end[1]))
    return found


if __name__ == "__main__":
    for heading, angle_rad in HEADINGS_RAD.items():
        for speed in SPEEDS_M_PER_S:
            velocity = np.array([speed * np.cos(angle_rad), speed * np.sin(angle_rad), SINK_M_PER_S])
            parts = ", ".join(f"{name}: {value:.2g} m" for name, value in moved_m(velocity).items())
            print(f"{heading}, {speed:g} m/s, sinking at {SINK_M_PER_S:g} m/s: {parts}")
