"""Rest of a foot: when its inertial sensors say that it stands.

Every detector takes whole recordings, ``(specific_force, angular_rate, sample_rate_hz, *, settings)``, and
says of each sample whether the foot rests. `DETECTORS` names them.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.strapdown import GRAVITY_M_PER_S2
from positioning.model import Array

Flags = NDArray[np.bool_]


def acceleration_magnitude(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    sample_rate_hz: float,
    *,
    threshold_m_per_s2: float = 1.0,
    least_duration_s: float = 0.2,
    gravity_m_per_s2: float = GRAVITY_M_PER_S2,
) -> Flags:
    """Call it rest once the specific force has kept within a band around gravity for some time.

    See Frank et al., section 3.2. Causal: a sample tells of itself and of samples before. Width and time are
    not in the paper. Assumed: a tenth of gravity, which is far above noise and bias of such units (some
    0.02 m/s^2), and a fifth of a second, less than half of an ordinary stance; in a tenth a swinging foot
    often keeps within the band by chance. Of nine pairs, widths of 0.5, 1 and 2 m/s^2 with 0.1, 0.15 and 0.2
    s, it is the one whose count of steps came nearest to that of strides in four simulated walks, with
    generators seeded 100 to 103, of which no table knows. Places were not looked at.

    Parameters
    ----------
    specific_force_m_per_s2
        [..., i, 3].
    angular_rate_rad_per_s
        Not used.
    sample_rate_hz
        Samples a second.
    threshold_m_per_s2
        Half the width of the band.
    least_duration_s
        How long the band is kept before rest begins.
    gravity_m_per_s2
        Middle of the band.

    Returns
    -------
    NDArray
        [..., i].

    Raises
    ------
    InputError
        For settings that are not above zero, or shapes that do not fit.
    """
    force, _ = _signals(specific_force_m_per_s2, angular_rate_rad_per_s)
    _above_zero(
        sample_rate_hz=sample_rate_hz,
        threshold_m_per_s2=threshold_m_per_s2,
        least_duration_s=least_duration_s,
        gravity_m_per_s2=gravity_m_per_s2,
    )
    within = np.abs(np.linalg.norm(force, axis=-1) - gravity_m_per_s2) <= threshold_m_per_s2
    index = np.arange(within.shape[-1])
    last_outside = np.maximum.accumulate(np.where(within, -1, index), axis=-1)
    return np.asarray(index - last_outside >= _samples(least_duration_s, sample_rate_hz))


def shoe(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    sample_rate_hz: float,
    *,
    window_s: float = 0.05,
    threshold: float = 1e5,
    force_sigma_m_per_s2: float = 0.01,
    rate_sigma_rad_per_s: float = float(np.deg2rad(0.1)),
    gravity_m_per_s2: float = GRAVITY_M_PER_S2,
) -> Flags:
    """Call it rest where force and rate together hardly differ from those of a standing foot.

    See Skog et al. (2010), IEEE Trans. Biomed. Eng. 57(11), eq. 22: the generalised likelihood ratio test
    of gravity in the mean direction of the window, and no rotation. All samples of a window that passes
    rest, so it looks ahead by one window at most. The sigmas are those of OpenShoe (Nilsson et al. 2012). Its
    threshold, 3e4, cuts stances with a wobble in two, in the four simulated walks of
    `acceleration_magnitude`; 1e5, the only other one that was tried, does not.

    Parameters
    ----------
    specific_force_m_per_s2, angular_rate_rad_per_s
        [..., i, 3].
    sample_rate_hz
        Samples a second.
    window_s
        Length of the window.
    threshold
        A window passes below it.
    force_sigma_m_per_s2, rate_sigma_rad_per_s
        What weighs the two kinds of readings against each other.
    gravity_m_per_s2
        Magnitude at rest.

    Returns
    -------
    NDArray
        [..., i].

    Raises
    ------
    InputError
        For settings that are not above zero, or shapes that do not fit.
    """
    force, rate = _signals(specific_force_m_per_s2, angular_rate_rad_per_s)
    _above_zero(
        sample_rate_hz=sample_rate_hz,
        window_s=window_s,
        threshold=threshold,
        force_sigma_m_per_s2=force_sigma_m_per_s2,
        rate_sigma_rad_per_s=rate_sigma_rad_per_s,
        gravity_m_per_s2=gravity_m_per_s2,
    )
    window = _samples(window_s, sample_rate_hz)
    if window > force.shape[-2]:
        return np.zeros(force.shape[:-1], dtype=np.bool_)
    mean = _window_mean(force, window)
    length = np.linalg.norm(mean, axis=-1)
    # The mean square distance to gravity along the mean force, multiplied out.
    squared_force = _window_mean(np.sum(force**2, axis=-1, keepdims=True), window)[..., 0]
    distance = squared_force - 2 * gravity_m_per_s2 * length + gravity_m_per_s2**2
    squared_rate = _window_mean(np.sum(rate**2, axis=-1, keepdims=True), window)[..., 0]
    statistic = distance / force_sigma_m_per_s2**2 + squared_rate / rate_sigma_rad_per_s**2
    return _whole_windows(statistic < threshold, window, force.shape[-2])


def angular_rate_energy(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    sample_rate_hz: float,
    *,
    window_s: float = 0.05,
    threshold_rad_per_s: float = 0.5,
) -> Flags:
    """Call it rest where the foot hardly turns.

    See Skog et al. (2010), eq. 27. All samples of a window that passes rest, so it looks ahead by one window
    at most. The threshold is near the rate at which `shoe` with its defaults lets go.

    Parameters
    ----------
    specific_force_m_per_s2
        Not used.
    angular_rate_rad_per_s
        [..., i, 3].
    sample_rate_hz
        Samples a second.
    window_s
        Length of the window.
    threshold_rad_per_s
        A window passes where the root mean square of the rate is below it.

    Returns
    -------
    NDArray
        [..., i].

    Raises
    ------
    InputError
        For settings that are not above zero, or shapes that do not fit.
    """
    _, rate = _signals(specific_force_m_per_s2, angular_rate_rad_per_s)
    _above_zero(sample_rate_hz=sample_rate_hz, window_s=window_s, threshold_rad_per_s=threshold_rad_per_s)
    window = _samples(window_s, sample_rate_hz)
    if window > rate.shape[-2]:
        return np.zeros(rate.shape[:-1], dtype=np.bool_)
    energy = _window_mean(np.sum(rate**2, axis=-1, keepdims=True), window)[..., 0]
    return _whole_windows(energy < threshold_rad_per_s**2, window, rate.shape[-2])


DETECTORS: Mapping[str, Callable[..., Flags]] = {
    "acceleration_magnitude": acceleration_magnitude,
    "shoe": shoe,
    "angular_rate_energy": angular_rate_energy,
}
"""Detectors by the name under which settings call them."""


def detect(
    detector: str,
    settings: Mapping[str, Any],
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    sample_rate_hz: float,
) -> Flags:
    """Run a detector by its name.

    Parameters
    ----------
    detector
        A name in `DETECTORS`.
    settings
        Its keyword arguments.
    specific_force_m_per_s2, angular_rate_rad_per_s, sample_rate_hz
        As the detectors take them.

    Returns
    -------
    NDArray
        [..., i].

    Raises
    ------
    InputError
        For a name or a setting that does not exist, whatever the detector refuses, or an answer that is not
        one truth value a reading.
    """
    if detector not in DETECTORS:
        raise InputError(
            f"detector {detector!r}", "there is no such detector", f"Take one of {list(DETECTORS)}"
        )
    function = DETECTORS[detector]
    known = set(function.__kwdefaults__ or {})
    if unknown := sorted(set(settings) - known):
        raise InputError(
            f"detector_settings {unknown}", f"{detector} does not have them", f"It has {sorted(known)}"
        )
    flags = function(specific_force_m_per_s2, angular_rate_rad_per_s, sample_rate_hz, **settings)
    expected = np.shape(specific_force_m_per_s2)[:-1]
    if np.shape(flags) != expected or np.asarray(flags).dtype != np.bool_:
        raise InputError(
            f"the answer of detector {detector!r}",
            f"it is {np.asarray(flags).dtype} of shape {np.shape(flags)}, not bool of shape {expected}",
            "Answer True or False for every reading",
        )
    return flags


def spans(rest: Flags) -> list[NDArray[np.intp]]:
    """Return the first sample and the one behind the last of each rest, [s, 2] for each recording.

    Parameters
    ----------
    rest
        [r, i].
    """
    padded = np.zeros((len(rest), rest.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = rest
    change = np.diff(padded, axis=1)
    return [np.stack([np.flatnonzero(row == 1), np.flatnonzero(row == -1)], axis=-1) for row in change]


def _signals(force: ArrayLike, rate: ArrayLike) -> tuple[Array, Array]:
    forces, rates = np.asarray(force, dtype=np.float64), np.asarray(rate, dtype=np.float64)
    if forces.shape != rates.shape or forces.ndim < 2 or forces.shape[-1] != 3:
        raise InputError(
            "specific force and angular rate",
            f"their shapes {forces.shape} and {rates.shape} are not both [..., i, 3]",
            "Give one of each a sample",
        )
    return forces, rates


def _above_zero(**settings: float) -> None:
    for name, value in settings.items():
        if not value > 0:
            raise InputError(f"{name}={value}", "it is not above zero", "Correct it")


def _samples(duration_s: float, sample_rate_hz: float) -> int:
    return max(1, round(duration_s * sample_rate_hz))


def _window_mean(values: Array, window: int) -> Array:
    """Return means over windows along the last axis but one, as many as fit."""
    # A direct sum: running sums of squares would cancel after a long recording.
    count = values.shape[-2] - window + 1
    total = values[..., :count, :].copy()
    for shift in range(1, window):
        total += values[..., shift : shift + count, :]
    return total / window


def _whole_windows(passed: Flags, window: int, samples: int) -> Flags:
    rest = np.zeros((*passed.shape[:-1], samples), dtype=np.bool_)
    for shift in range(window):
        rest[..., shift : shift + passed.shape[-1]] |= passed
    return rest
