"""Settings of the navigation of a flight: what counts, how it is taken in, and all variances.

See Mirzababaei & Akbari, sections 3 and 5. What the paper leaves open (start, variances, rates) is a setting.
"""

from dataclasses import dataclass
from numbers import Integral

import numpy as np

from positioning.errors import InputError
from positioning.inertial.gps import UNITS, is_number

MODELS = ("geodetic", "flat")
INTERPOLATIONS = ("linear", "lagrange")
LEAST_COVARIANCE_HZ = 1.0
"""Fewer steps of the covariance are refused: in one the attitude would turn too far; assumed."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class FlightFilter:
    """Settings of the filter.

    Attributes
    ----------
    gps, fixes, slam
        Which readings count beside the inertial ones: GPS, ``recording.fix_m``, and sightings of landmarks.
    states
        9, or 15 with the biases of accelerometer and gyroscope.
    model
        Of the error: ``geodetic`` (eqs. 8 to 11) or ``flat`` (eqs. 41 and 42).
    closed_loop
        Whether the estimated error corrects the navigation at once, or stays beside it.
    interpolation, interpolation_order
        Of the navigation at the time of a reading: ``linear`` (eqs. 32 and 33), or ``lagrange`` (eqs. 34 and
        35) with m samples more on either side.
    units
        Of the position in the update by GPS: ``metres`` (eq. 30) or ``radians`` (eq. 28).
    outage_s
        Length of the outage of GPS in place of the recorded one.
    covariance_hz
        Rate of the covariance's steps, and of the updates; assumed.
    force_noise_m_per_s2_per_rt_hz, rate_noise_rad_per_s_per_rt_hz
        Densities of the noise of the readings: a MEMS unit's data sheet (0.1 m/s and 1 degree per root hour,
        rounded); assumed.
    noise_factor
        Multiplies these densities squared: Q of eq. 13 is the data sheet's times this factor.
    force_bias_m_per_s2, rate_bias_rad_per_s, bias_time_s
        Deviation and correlation time of the biases, for 15 states; assumed.
    gps_sigma_m, gps_velocity_sigma_m_per_s
        North, east and down; assumed.
    fix_sigma_m
        Of a fix, along each axis: a mean error of 2.6 m, as in Table 1, if it is a Rayleigh one.
    range_sigma_m, bearing_sigma_rad, elevation_sigma_rad
        Of a sighting; assumed.
    start_sigma_m, start_velocity_sigma_m_per_s, start_attitude_sigma_rad
        North, east and down: of the noted start; assumed.
    """

    gps: bool = True
    fixes: bool = False
    slam: bool = False
    states: int = 9
    model: str = "geodetic"
    closed_loop: bool = True
    interpolation: str = "linear"
    interpolation_order: int = 1
    units: str = "metres"
    outage_s: float | None = None
    covariance_hz: float = 20.0
    force_noise_m_per_s2_per_rt_hz: float = 0.002
    rate_noise_rad_per_s_per_rt_hz: float = 0.0003
    noise_factor: float = 1.0
    force_bias_m_per_s2: float = 0.02
    rate_bias_rad_per_s: float = 0.001
    bias_time_s: float = 300.0
    gps_sigma_m: Triple = (1.5, 1.5, 3.0)
    gps_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.15)
    fix_sigma_m: float = 2.074
    range_sigma_m: float = 0.2
    bearing_sigma_rad: float = 0.01
    elevation_sigma_rad: float = 0.01
    start_sigma_m: Triple = (1.5, 1.5, 3.0)
    start_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.1)
    start_attitude_sigma_rad: Triple = (0.01, 0.01, 0.03)

    def check(self) -> None:
        """Refuse settings without sense.

        Raises
        ------
        InputError
            For an unknown name, a value of another type or length, or a number that is not above zero where
            only such make sense.
        """
        for name in ("gps", "fixes", "slam", "closed_loop"):
            if not isinstance(getattr(self, name), bool):
                raise _setting(self, name, "it is neither true nor false", "Take one of them")
        for name in ("states", "interpolation_order"):
            if not isinstance(getattr(self, name), Integral) or isinstance(getattr(self, name), bool):
                raise _setting(self, name, "it is not a whole number", "Give one, without quotes")
        if self.states not in (9, 15):
            raise _setting(self, "states", "the filter has 9 or 15", "Take one of them")
        for name, known in (("model", MODELS), ("interpolation", INTERPOLATIONS), ("units", UNITS)):
            if not isinstance(getattr(self, name), str) or getattr(self, name) not in known:
                raise _setting(self, name, "it is not known", f"Take one of {list(known)}")
        if not 0 <= self.interpolation_order <= 10:
            raise _setting(self, "interpolation_order", "it is not from 0 to 10", "Correct it")
        if self.outage_s is not None and not is_number(self.outage_s):
            raise _setting(
                self, "outage_s", "it is not a number", "Give seconds, or null for the recorded one"
            )
        for name in (*_ABOVE_ZERO, *_NOT_NEGATIVE):
            value = getattr(self, name)
            if name not in _TRIPLES and not is_number(value):
                raise _setting(self, name, "it is not a number", "Give one, without quotes")
            if name in _TRIPLES and not (
                isinstance(value, list | tuple | np.ndarray)
                and np.shape(value) == (3,)
                and all(is_number(part) for part in value)
            ):
                raise _setting(self, name, "it is not three numbers", "Give those north, east and down")
        for name in _ABOVE_ZERO:
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not ((values > 0) & np.isfinite(values)).all():
                raise _setting(self, name, "it is not above zero", "Correct it")
        for name in _NOT_NEGATIVE:
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not ((values >= 0) & np.isfinite(values)).all():
                raise _setting(self, name, "it is below zero", "Correct it")
        if self.covariance_hz < LEAST_COVARIANCE_HZ:
            raise _setting(
                self,
                "covariance_hz",
                f"it is below {LEAST_COVARIANCE_HZ} Hz, too long a step for the dynamics of the error",
                "Raise it",
            )


def _setting(settings: FlightFilter, name: str, limit: str, cure: str) -> InputError:
    return InputError(f"{name}={getattr(settings, name)!r}", limit, cure)


_TRIPLES: tuple[str, ...] = ("gps_sigma_m", "gps_velocity_sigma_m_per_s")
_TRIPLES += ("start_sigma_m", "start_velocity_sigma_m_per_s", "start_attitude_sigma_rad")
_ABOVE_ZERO: tuple[str, ...] = (
    "covariance_hz",
    "bias_time_s",
    "gps_sigma_m",
    "gps_velocity_sigma_m_per_s",
    "fix_sigma_m",
)
_ABOVE_ZERO += ("range_sigma_m", "bearing_sigma_rad", "elevation_sigma_rad")
_NOT_NEGATIVE: tuple[str, ...] = (
    "force_noise_m_per_s2_per_rt_hz",
    "rate_noise_rad_per_s_per_rt_hz",
    "noise_factor",
)
_NOT_NEGATIVE += ("force_bias_m_per_s2", "rate_bias_rad_per_s", "start_sigma_m")
_NOT_NEGATIVE += ("start_velocity_sigma_m_per_s", "start_attitude_sigma_rad")
