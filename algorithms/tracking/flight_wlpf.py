"""GPS, inertial navigation, landmarks, and fixes by wireless fingerprints of a flight."""

from collections.abc import Sequence

import numpy as np

from algorithms.tracking.flight_inertial import flight_missing, flight_track
from positioning.filters.plane import track_one
from positioning.inertial.flight_settings import FlightFilter, Triple
from positioning.model import Calibration, Recording, Site, Survey, Track


class FlightWlpf:
    """SLAM/GPS/INS/WLPF: fixes of wireless fingerprinting limit the error as well.

    See Mirzababaei & Akbari, Figure 1 and sections 5 and 6. How a fix enters is not printed: here as a
    measured place in the plane, with independent errors, whenever there is one, under GPS too. Errors that
    belong to a place break this assumption. A fix tells nothing of the height.

    Parameters
    ----------
    gps
        Whether GPS counts.
    slam
        Whether sightings of landmarks count.
    states
        9, or 15 with the biases of accelerometer and gyroscope: a modern baseline, see Groves (2013),
        "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", section 14.2.
    model
        Of the error: ``geodetic`` (eqs. 8 to 11) or ``flat`` (eqs. 41 and 42), both corrected.
    closed_loop
        Whether the estimated error corrects the navigation at once, section 5.E, or stays beside it.
    interpolation, interpolation_order
        Of the navigation at the time of a reading: ``linear`` (eqs. 32 and 33), or ``lagrange`` (eqs. 34 and
        35) with m samples more on either side.
    units
        Of the position in the update by GPS: ``metres`` (eq. 30) or ``radians`` (eq. 28).
    outage_s
        Length of the outage of GPS in place of the recorded one, from the same begin; None for that.
    covariance_hz
        Rate of the covariance's steps, and of the updates; assumed.
    force_noise_m_per_s2_per_rt_hz, rate_noise_rad_per_s_per_rt_hz
        Densities of the noise of the readings, those of a data sheet; assumed.
    noise_factor
        Multiplies these densities squared, Q of eq. 13; section 3 raises it until the filter is stable.
    force_bias_m_per_s2, rate_bias_rad_per_s, bias_time_s
        Deviation and correlation time of the biases, for 15 states; assumed.
    gps_sigma_m, gps_velocity_sigma_m_per_s
        North, east and down, eq. 31; assumed.
    range_sigma_m, bearing_sigma_rad, elevation_sigma_rad
        Of a sighting, eq. 51; assumed.
    fix_sigma_m
        Of a fix, along each axis: a mean error of 2.6 m, as in Table 1, if it is a Rayleigh one.
    start_sigma_m, start_velocity_sigma_m_per_s, start_attitude_sigma_rad
        Of the noted start, north, east and down; assumed.
    """

    def __init__(
        self,
        *,
        gps: bool = True,
        slam: bool = True,
        states: int = 9,
        model: str = "geodetic",
        closed_loop: bool = True,
        interpolation: str = "linear",
        interpolation_order: int = 1,
        units: str = "metres",
        outage_s: float | None = None,
        covariance_hz: float = 20.0,
        force_noise_m_per_s2_per_rt_hz: float = 0.002,
        rate_noise_rad_per_s_per_rt_hz: float = 0.0003,
        noise_factor: float = 1.0,
        force_bias_m_per_s2: float = 0.02,
        rate_bias_rad_per_s: float = 0.001,
        bias_time_s: float = 300.0,
        gps_sigma_m: Triple = (1.5, 1.5, 3.0),
        gps_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.15),
        range_sigma_m: float = 0.2,
        bearing_sigma_rad: float = 0.01,
        elevation_sigma_rad: float = 0.01,
        fix_sigma_m: float = 2.074,
        start_sigma_m: Triple = (1.5, 1.5, 3.0),
        start_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.1),
        start_attitude_sigma_rad: Triple = (0.01, 0.01, 0.03),
    ) -> None:
        self.gps = gps
        self.slam = slam
        self.states = states
        self.model = model
        self.closed_loop = closed_loop
        self.interpolation = interpolation
        self.interpolation_order = interpolation_order
        self.units = units
        self.outage_s = outage_s
        self.covariance_hz = covariance_hz
        self.force_noise_m_per_s2_per_rt_hz = force_noise_m_per_s2_per_rt_hz
        self.rate_noise_rad_per_s_per_rt_hz = rate_noise_rad_per_s_per_rt_hz
        self.noise_factor = noise_factor
        self.force_bias_m_per_s2 = force_bias_m_per_s2
        self.rate_bias_rad_per_s = rate_bias_rad_per_s
        self.bias_time_s = bias_time_s
        self.gps_sigma_m = gps_sigma_m
        self.gps_velocity_sigma_m_per_s = gps_velocity_sigma_m_per_s
        self.range_sigma_m = range_sigma_m
        self.bearing_sigma_rad = bearing_sigma_rad
        self.elevation_sigma_rad = elevation_sigma_rad
        self.fix_sigma_m = fix_sigma_m
        self.start_sigma_m = start_sigma_m
        self.start_velocity_sigma_m_per_s = start_velocity_sigma_m_per_s
        self.start_attitude_sigma_rad = start_attitude_sigma_rad

    def settings(self) -> FlightFilter:
        """Return the settings of the filter.

        See Mirzababaei & Akbari, sections 3 and 5.
        """
        return FlightFilter(fixes=True, **vars(self))

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Mirzababaei & Akbari, sections 5 and 6.
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

        See Mirzababaei & Akbari, Figure 1 and eqs. 37 to 59.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of the inertial unit [r, i, 3], the noted start [r, 3], GPS
            [r, g, 3], fixes [r, n, 1, 2], and sightings [r, o, 3].
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
