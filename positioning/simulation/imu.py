"""What inertial sensors of low cost and wheel encoders report of a true motion.

Random numbers come in as standard normals and are scaled here: worlds of equal seeds share them whatever
the quality of the sensor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from positioning.errors import InputError
from positioning.inertial.earth import EARTH_RATE_RAD_PER_S
from positioning.model import Array


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """The errors of a gyroscope, as data sheets state them.

    See Atia et al., Table 1.

    Attributes
    ----------
    turn_on_bias_rad_per_s
        Standard deviation of the bias that stays from one switching on to the next.
    in_run_bias_rad_per_s
        Standard deviation of the bias that wanders about it, a stationary first-order Gauss-Markov
        process.
    in_run_correlation_s
        Correlation time of that process.
    angle_random_walk_rad_per_sqrt_s
        White noise of the rate, as what its integral deviates by after a second.
    scale_deviation
        Standard deviation of the error of the scale; 0.01 is one per cent.
    step_rad_per_s
        Resolution of a reading; 0 reports it unrounded.
    """

    turn_on_bias_rad_per_s: float
    in_run_bias_rad_per_s: float
    in_run_correlation_s: float
    angle_random_walk_rad_per_sqrt_s: float
    scale_deviation: float = 0.0
    step_rad_per_s: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a gyroscope that cannot be."""
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"gyro, {name}", f"{value} is not zero or more", "Give a finite value")
        if self.in_run_correlation_s == 0:
            raise InputError("gyro, in_run_correlation_s", "it is zero", "Give a positive time")


class GyroDraws(NamedTuple):
    """The random numbers of a gyroscope, standard normals.

    Attributes
    ----------
    turn_on, scale
        One for each time that it is switched on, [...].
    in_run, white
        One for each reading, [..., m].
    """

    turn_on: Array
    scale: Array
    in_run: Array
    white: Array


def draw_gyro(rng: np.random.Generator, samples: int) -> GyroDraws:
    """Draw what a gyroscope needs for ``samples`` readings.

    See Atia et al., Table 1.

    Parameters
    ----------
    rng
        Source of 2 + 2 ``samples`` standard normals.
    samples
        Number of readings.
    """
    turn_on, scale = rng.standard_normal(2)
    return GyroDraws(
        turn_on=np.asarray(turn_on),
        scale=np.asarray(scale),
        in_run=rng.standard_normal(samples),
        white=rng.standard_normal(samples),
    )


def read_gyro(rate_rad_per_s: ArrayLike, draws: GyroDraws, gyro: Gyro, *, sample_rate_hz: float) -> Array:
    """Return the readings of a gyroscope that turns at a given rate.

    See Atia et al., Table 1. Noise that walks the angle by N in a second deviates by N sqrt(f) in each of f
    readings a second.

    Parameters
    ----------
    rate_rad_per_s
        What an ideal gyroscope would read, the turn of the earth included, [..., m], rad/s.
    draws
        Standard normals, [..., m] and [...].
    gyro
        The errors.
    sample_rate_hz
        Readings a second.

    Returns
    -------
    Array
        [..., m], rad/s.

    Raises
    ------
    InputError
        For a rate of sampling that is not positive.
    """
    _positive("sample_rate_hz", sample_rate_hz)
    in_run = gauss_markov(draws.in_run, correlation=gyro.in_run_correlation_s * sample_rate_hz)
    bias = gyro.turn_on_bias_rad_per_s * np.asarray(draws.turn_on)[..., None]
    scale = 1.0 + gyro.scale_deviation * np.asarray(draws.scale)[..., None]
    noise = gyro.angle_random_walk_rad_per_sqrt_s * np.sqrt(sample_rate_hz)
    reading: Array = (
        scale * np.asarray(rate_rad_per_s) + bias + gyro.in_run_bias_rad_per_s * in_run + noise * draws.white
    )
    step = gyro.step_rad_per_s
    return step * np.rint(reading / step) if step > 0 else reading


def gauss_markov(normal: ArrayLike, *, correlation: float) -> Array:
    """Return a stationary first-order Gauss-Markov process of unit deviation.

    The usual model of a bias that wanders, as in Atia et al., Table 1: in-run bias stability.

    Parameters
    ----------
    normal
        Standard normals, [..., m].
    correlation
        Steps after which the correlation has fallen to 1/e.

    Returns
    -------
    Array
        [..., m]; every value is standard normal from the first on.

    Raises
    ------
    InputError
        For a correlation that is not positive.
    """
    _positive("correlation", correlation)
    process = np.array(normal, dtype=np.float64)
    process[..., 1:] *= np.sqrt(-np.expm1(-2.0 / correlation))
    # x[k] = decay x[k - 1] + noise[k]. After each round a value holds the sum over twice as many steps,
    # so that the number of rounds is the logarithm of that of samples.
    shift = 1
    while shift < process.shape[-1] and (decay := np.exp(-shift / correlation)) > 0:
        process[..., shift:] += decay * process[..., :-shift].copy()
        shift *= 2
    return process


def vertical_earth_rate(latitude_rad: float) -> float:
    """Return what the earth turns about the vertical of a place, rad/s, positive to the left seen from above.

    See Atia et al., eq. 1, where it stands on the other side of the equation.

    Parameters
    ----------
    latitude_rad
        Latitude, radians, positive to the north.
    """
    return float(EARTH_RATE_RAD_PER_S * np.sin(latitude_rad))


def read_encoder(
    distance_m: ArrayLike, *, scale: ArrayLike, step_m: float, phase: ArrayLike, sample_rate_hz: float
) -> Array:
    """Return the speed that a wheel encoder reports: whole steps since the reading before.

    See Atia et al., section 6.1. What a reading cuts off the next one counts, so that the
    readings sum up to the distance to within a step.

    Parameters
    ----------
    distance_m
        True distance driven at each reading, [..., m], metres, not falling; NaN after the end.
    scale
        Distance that the encoder counts, as a multiple of the true one, [...].
    step_m
        Distance between two counts.
    phase
        Share of a step that the wheel has turned at the beginning, [...], 0 to 1.
    sample_rate_hz
        Readings a second.

    Returns
    -------
    Array
        Speed over the interval that ends at each reading, [..., m], m/s; the first is zero.

    Raises
    ------
    InputError
        For a step or a rate of sampling that is not positive.
    """
    _positive("step_m", step_m)
    _positive("sample_rate_hz", sample_rate_hz)
    scale, phase = (np.asarray(value, dtype=np.float64)[..., None] for value in (scale, phase))
    count = np.floor(scale * np.asarray(distance_m, dtype=np.float64) / step_m + phase)
    speed: Array = np.diff(count, axis=-1, prepend=count[..., :1]) * (step_m * sample_rate_hz)
    return speed


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(name, f"{value} is not a positive number", "Give a positive number")
