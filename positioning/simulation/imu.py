"""What inertial sensors of low cost, magnetometers and wheel encoders report of a true motion.

Random numbers come in as standard normals and are scaled here: worlds of equal seeds share them whatever
the quality of the sensor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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


IN_RUN_KNOT_S = 1.0
"""Distance of the knots of a triad's wandering bias, which is linear between them."""


@dataclass(frozen=True, kw_only=True)
class Triad:
    """The errors of three equal sensors at right angles, as data sheets state them.

    See Frank et al., section 3.1, for the sensors; their errors are not printed. All values but times and
    scales are in the unit of the sensor: m/s2, rad/s or microtesla.

    Attributes
    ----------
    turn_on_bias
        Standard deviation of the bias that stays from one switching on to the next.
    in_run_bias
        Standard deviation of the bias that wanders about it, a stationary first-order Gauss-Markov process.
    in_run_correlation_s
        Correlation time of that process.
    noise_density
        White noise, in the unit of the sensor over the root of a hertz: a mean over a second deviates by it.
    scale_deviation
        Standard deviation of the error of each axis' scale; 0.01 is one per cent.
    limit
        Largest reading to both sides; infinity for none.
    step
        Resolution of a reading; 0 reports it unrounded.
    """

    turn_on_bias: float
    in_run_bias: float
    in_run_correlation_s: float
    noise_density: float
    scale_deviation: float = 0.0
    limit: float = np.inf
    step: float = 0.0

    def __post_init__(self) -> None:
        """Refuse sensors that cannot be."""
        for name, value in vars(self).items():
            if not (value >= 0 and (np.isfinite(value) or name == "limit")):
                raise InputError(f"triad, {name}", f"{value} is not zero or more", "Give a finite value")
        for name in ("in_run_correlation_s", "limit"):
            if getattr(self, name) == 0:
                raise InputError(f"triad, {name}", "it is zero", "Give a positive value")


class TriadDraws(NamedTuple):
    """The random numbers of three sensors, standard normals.

    Attributes
    ----------
    turn_on, scale
        One for each axis, [..., 3].
    in_run
        One for each knot of the wandering bias, [..., 3, knot].
    white
        One for each reading, [..., i, 3], in single precision.
    """

    turn_on: Array
    scale: Array
    in_run: Array
    white: NDArray[np.float32]


def draw_triad(rng: np.random.Generator, samples: int, *, sample_rate_hz: float) -> TriadDraws:
    """Draw what three sensors need for ``samples`` readings; see Frank et al., section 3.1.

    Parameters
    ----------
    rng
        Source of the standard normals.
    samples
        Number of readings.
    sample_rate_hz
        Readings a second.

    Raises
    ------
    InputError
        For a rate of sampling that is not positive.
    """
    _positive("sample_rate_hz", sample_rate_hz)
    knots = int(np.ceil(samples / sample_rate_hz / IN_RUN_KNOT_S)) + 1
    turn_on, scale = rng.standard_normal((2, 3))
    return TriadDraws(
        turn_on=turn_on,
        scale=scale,
        in_run=rng.standard_normal((3, knots)),
        white=rng.standard_normal((samples, 3), dtype=np.float32),
    )


def read_triad(ideal: ArrayLike, draws: TriadDraws, triad: Triad, *, sample_rate_hz: float) -> Array:
    """Return the readings of three sensors that ideally read ``ideal``.

    See Frank et al., section 3.1. A reading is scaled, shifted by both biases and noise, rounded to the
    resolution and held within the limits, in that order.

    Parameters
    ----------
    ideal
        Means over the interval of each reading, [..., i, 3], in the unit of the sensor.
    draws
        For i readings at least.
    triad
        The errors.
    sample_rate_hz
        Readings a second.

    Returns
    -------
    Array
        [..., i, 3].

    Raises
    ------
    InputError
        For a rate of sampling that is not positive, or too few draws.
    """
    _positive("sample_rate_hz", sample_rate_hz)
    reading = np.array(ideal, dtype=np.float64)
    samples = reading.shape[-2]
    if draws.white.shape[-2] < samples:
        raise InputError(
            "draws", f"they are for {draws.white.shape[-2]} readings, not {samples}", "Draw for all readings"
        )
    reading *= 1.0 + triad.scale_deviation * draws.scale[..., None, :]
    knots = gauss_markov(draws.in_run, correlation=triad.in_run_correlation_s / IN_RUN_KNOT_S)
    bias = triad.turn_on_bias * draws.turn_on[..., None] + triad.in_run_bias * knots
    at = np.arange(samples) / (sample_rate_hz * IN_RUN_KNOT_S)
    knot = at.astype(np.int64)
    share = at - knot
    wandering = bias[..., knot] + share * (bias[..., knot + 1] - bias[..., knot])
    reading += np.swapaxes(wandering, -1, -2)
    reading += (triad.noise_density * np.sqrt(sample_rate_hz)) * draws.white[..., :samples, :]
    if triad.step > 0:
        reading = triad.step * np.rint(reading / triad.step)
    return np.clip(reading, -triad.limit, triad.limit, out=reading)


def earth_field_ut(intensity_ut: float, inclination_rad: float, north_rad: ArrayLike) -> Array:
    """Return the magnetic field of the earth in a frame whose z axis points up, [..., 3], microtesla.

    See Frank et al., section 3.1, for the magnetometer.

    Parameters
    ----------
    intensity_ut
        Magnitude, microtesla.
    inclination_rad
        How far it points below the horizon, radians.
    north_rad
        Direction to magnetic north, [...], radians from the x axis to the left.
    """
    north = np.asarray(north_rad, dtype=np.float64)
    level = intensity_ut * np.cos(inclination_rad)
    down = np.full(north.shape, -intensity_ut * np.sin(inclination_rad))
    return np.stack([level * np.cos(north), level * np.sin(north), down], axis=-1)


def smooth_field(
    direction: ArrayLike, phase_rad: ArrayLike, position_m: ArrayLike, *, correlation_m: float
) -> Array:
    """Return a random field over the plane of unit deviation: a sum of plane waves.

    With many waves it is Gaussian, and its correlation falls with the distance d as
    exp(-d^2 / (2 correlation^2)). See Rahimi & Recht (2007), "Random features for large-scale kernel
    machines". For what steel and cables do to the magnetic field of a building.

    Parameters
    ----------
    direction
        Standard normals, [..., wave, 2].
    phase_rad
        Uniform over a turn, [..., wave, part], radians, for each part of the field.
    position_m
        Places, [n, 2], metres.
    correlation_m
        Correlation length.

    Returns
    -------
    Array
        [..., n, part].

    Raises
    ------
    InputError
        For a correlation length that is not positive.
    """
    _positive("correlation_m", correlation_m)
    phase = np.asarray(phase_rad, dtype=np.float64)
    waves = np.asarray(direction, dtype=np.float64) / correlation_m
    along = np.asarray(position_m, dtype=np.float64) @ np.swapaxes(waves, -1, -2)
    # cos(a + b) = cos a cos b - sin a sin b makes a matrix product of the sum over the waves.
    total = np.cos(along) @ np.cos(phase) - np.sin(along) @ np.sin(phase)
    return np.asarray(np.sqrt(2.0 / phase.shape[-2]) * total)


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
