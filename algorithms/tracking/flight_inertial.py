"""Inertial navigation of a flight alone, and what all trackers of a flight share."""

from collections.abc import Sequence

import numpy as np

from positioning.errors import Reason, refusal
from positioning.filters.plane import track_one
from positioning.inertial.flight_filter import FlightNavigation, navigate_flight
from positioning.inertial.flight_settings import FlightFilter, Triple
from positioning.model import Array, Calibration, Recording, Site, Survey, Track


class FlightInertial:
    """Strapdown navigation from the noted start, with the covariance of its error.

    See Mirzababaei & Akbari, section 2. Nothing bounds its error; the paper has no figure of it.

    Parameters
    ----------
    states
        9, or 15 with the biases of accelerometer and gyroscope: a modern baseline, see Groves (2013),
        "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", section 14.2.
    model
        Of the error: ``geodetic`` (eqs. 8 to 11) or ``flat`` (eqs. 41 and 42), both corrected.
    covariance_hz
        Rate of the covariance's steps, and of the updates; assumed.
    force_noise_m_per_s2_per_rt_hz, rate_noise_rad_per_s_per_rt_hz
        Densities of the noise of the readings, those of a data sheet; assumed.
    noise_factor
        Multiplies these densities squared, Q of eq. 13; section 3 raises it until the filter is stable.
    force_bias_m_per_s2, rate_bias_rad_per_s, bias_time_s
        Deviation and correlation time of the biases, for 15 states; assumed.
    start_sigma_m, start_velocity_sigma_m_per_s, start_attitude_sigma_rad
        Of the noted start, north, east and down; assumed.
    """

    def __init__(
        self,
        *,
        states: int = 9,
        model: str = "geodetic",
        covariance_hz: float = 20.0,
        force_noise_m_per_s2_per_rt_hz: float = 0.002,
        rate_noise_rad_per_s_per_rt_hz: float = 0.0003,
        noise_factor: float = 1.0,
        force_bias_m_per_s2: float = 0.02,
        rate_bias_rad_per_s: float = 0.001,
        bias_time_s: float = 300.0,
        start_sigma_m: Triple = (1.5, 1.5, 3.0),
        start_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.1),
        start_attitude_sigma_rad: Triple = (0.01, 0.01, 0.03),
    ) -> None:
        self.states = states
        self.model = model
        self.covariance_hz = covariance_hz
        self.force_noise_m_per_s2_per_rt_hz = force_noise_m_per_s2_per_rt_hz
        self.rate_noise_rad_per_s_per_rt_hz = rate_noise_rad_per_s_per_rt_hz
        self.noise_factor = noise_factor
        self.force_bias_m_per_s2 = force_bias_m_per_s2
        self.rate_bias_rad_per_s = rate_bias_rad_per_s
        self.bias_time_s = bias_time_s
        self.start_sigma_m = start_sigma_m
        self.start_velocity_sigma_m_per_s = start_velocity_sigma_m_per_s
        self.start_attitude_sigma_rad = start_attitude_sigma_rad

    def settings(self) -> FlightFilter:
        """Return the settings of the filter.

        See Mirzababaei & Akbari, eqs. 11 to 18.
        """
        return FlightFilter(gps=False, **vars(self))

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Mirzababaei & Akbari, section 2.
        """
        return flight_missing(recording, site, self.settings())

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        return track_one(self, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings in lock-step.

        See Mirzababaei & Akbari, eqs. 1 to 11.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of the inertial unit [r, i, 3], and the noted start [r, 3].
        survey
            Not used.
        site
            Origin of the local frame [r, 3].
        rngs
            Not used.

        Returns
        -------
        Track
            With the extra arrays of `flight_track`.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        return flight_track(recording, site, self.settings())


def flight_missing(recording: Recording, site: Site, settings: FlightFilter) -> str:
    """Say what recordings lack that a filter needs; empty where they lack nothing.

    See Mirzababaei & Akbari, Figure 1.

    Parameters
    ----------
    recording, site
        Stacks or single ones.
    settings
        Which sensors count.
    """
    needed = [
        (True, ("imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s"), "no inertial readings"),
        (True, ("start_geodetic", "start_velocity_m_per_s", "start_attitude_rad"), "no start of the flight"),
        (settings.gps, ("gps_time_s", "gps_geodetic"), "no GPS"),
        (settings.fixes, ("fix_m",), "no position fixes"),
        (settings.slam, ("sighting_time_s", "sighting_landmark", "sighting"), "no sightings of landmarks"),
    ]
    for counts, names, what in needed:
        values = [getattr(recording, name) for name in names] if counts else []
        if any(value is None or np.isnan(value).all() for value in values):
            return Reason(f"the recording holds {what}", f"Give {', '.join(names)}")
    if site.origin_geodetic is None:
        return Reason("nobody knows where on the earth the site lies", "Give origin_geodetic")
    return ""


def flight_track(recording: Recording, site: Site, settings: FlightFilter) -> Track:
    """Return the track of a filter on a stack of recordings.

    See Mirzababaei & Akbari, sections 3 and 5.

    Parameters
    ----------
    recording, site
        Stacks.
    settings
        Of the filter.

    Returns
    -------
    Track
        With extra ``height_m`` [r, n], ``velocity_m_per_s`` and ``attitude_rad`` [r, n, 3], ``covariance_9``
        [r, n, 9, 9] of position north, east and down, velocity and attitude, with 15 states ``bias`` [r, 6],
        accelerometer and gyroscope at the end, and what `navigation_track` adds for each sensor.

    Raises
    ------
    InputError
        For senseless settings, or input that cannot be used.
    """
    settings.check()
    if reason := flight_missing(recording, site, settings):
        raise refusal("recording and site", reason)
    return navigation_track(navigate_flight(recording, site, settings), settings)


def navigation_track(navigation: FlightNavigation, settings: FlightFilter) -> Track:
    """Return a navigation as a track.

    See Mirzababaei & Akbari, eqs. 57 to 59, for the innovations.

    Parameters
    ----------
    navigation
        Of a stack.
    settings
        That it was made with.

    Returns
    -------
    Track
        With the extra arrays that `flight_track` names, for each sensor that counts ``nis_<sensor>``, mean
        normalised innovation squared per degree of freedom, and ``degrees_<sensor>`` [r], where the sensor
        is ``gps``, ``fix`` or ``sighting``; with GPS ``innovation_condition`` [r]; with landmarks
        ``landmark_m`` [r, l, 3], east, north and up at the end, NaN for those never seen,
        ``landmark_covariance_m2`` [r, l, 3, 3], and ``skipped_sightings`` [r].
    """
    extra: dict[str, Array] = {
        "height_m": navigation.height_m,
        "velocity_m_per_s": navigation.velocity_m_per_s,
        "attitude_rad": navigation.attitude_rad,
        "covariance_9": navigation.covariance,
    }
    if settings.states == 15:
        extra["bias"] = navigation.bias
    for sensor, counts in (("gps", settings.gps), ("fix", settings.fixes), ("sighting", settings.slam)):
        if counts:
            extra[f"nis_{sensor}"] = navigation.normalised_innovation_squared[sensor]
            extra[f"degrees_{sensor}"] = navigation.degrees_of_freedom[sensor]
    if settings.gps:
        extra["innovation_condition"] = navigation.innovation_condition
    if settings.slam:
        extra["landmark_m"] = navigation.landmark_m
        extra["landmark_covariance_m2"] = navigation.landmark_covariance_m2
        extra["skipped_sightings"] = np.asarray(navigation.skipped_sightings, dtype=np.float64)
    # North and east become x to the east and y to the north.
    plane_m2 = navigation.covariance[..., 1::-1, 1::-1]
    return Track(
        time_s=navigation.time_s,
        position_m=navigation.position_m,
        covariance_m2=0.5 * (plane_m2 + np.swapaxes(plane_m2, -1, -2)),
        extra=extra,
    )
