"""Arrays of vectors as inertial navigation takes them: three parts on the last axis."""

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.model import Array


def vectors(name: str, values: ArrayLike) -> Array:
    """Return an array of vectors with their three parts last, [..., 3].

    Raises
    ------
    InputError
        For another last axis, with the name of the array.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise InputError(name, f"its shape is {array.shape}, not [..., 3]", "Put the three parts last")
    return array


def force_and_rate(
    specific_force_m_per_s2: ArrayLike, angular_rate_rad_per_s: ArrayLike
) -> tuple[Array, Array]:
    """Return specific forces, m/s^2, and angular rates, rad/s, of the same readings, both [..., i, 3].

    Raises
    ------
    InputError
        For shapes that do not fit each other.
    """
    force = vectors("specific_force_m_per_s2", specific_force_m_per_s2)
    rate = vectors("angular_rate_rad_per_s", angular_rate_rad_per_s)
    if force.shape != rate.shape or force.ndim < 2:
        raise InputError(
            "specific_force_m_per_s2 and angular_rate_rad_per_s",
            f"their shapes {force.shape} and {rate.shape} are not both [..., i, 3]",
            "Give one of each a sample",
        )
    return force, rate
