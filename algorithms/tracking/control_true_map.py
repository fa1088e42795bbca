"""Control: GPS, inertial navigation and landmarks of a flight for somebody who has the map."""

from collections.abc import Sequence

import numpy as np

from algorithms.tracking.flight_inertial import flight_missing, navigation_track
from positioning.errors import InputError, Reason, refusal
from positioning.filters.plane import track_one, with_leading_axis
from positioning.inertial.flight_checks import check_flight
from positioning.inertial.flight_filter import FlightNavigation, FlightRun
from positioning.inertial.flight_settings import FlightFilter, Triple
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth


class ControlTrueMap:
    """SLAM/GPS/INS with all landmarks known exactly: what any map could do for these sensors.

    See Mirzababaei & Akbari, section 5, with `FlightSlam` for the rest.

    Parameters
    ----------
    truth
        Landmarks of the flights that are tracked: with a leading axis for `track_stack`, without one for
        `track`.
    gps
        Whether GPS counts.
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
    start_sigma_m, start_velocity_sigma_m_per_s, start_attitude_sigma_rad
        Of the noted start, north, east and down; assumed.
    """

    def __init__(
        self,
        *,
        truth: Truth | None = None,
        gps: bool = True,
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
        start_sigma_m: Triple = (1.5, 1.5, 3.0),
        start_velocity_sigma_m_per_s: Triple = (0.1, 0.1, 0.1),
        start_attitude_sigma_rad: Triple = (0.01, 0.01, 0.03),
    ) -> None:
        self.truth = truth
        self.gps = gps
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
        self.start_sigma_m = start_sigma_m
        self.start_velocity_sigma_m_per_s = start_velocity_sigma_m_per_s
        self.start_attitude_sigma_rad = start_attitude_sigma_rad

    def settings(self) -> FlightFilter:
        """Return the settings of the filter.

        See Mirzababaei & Akbari, section 5.
        """
        values = {name: value for name, value in vars(self).items() if name != "truth"}
        return FlightFilter(slam=True, **values)

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Mirzababaei & Akbari, section 5.
        """
        if self.truth is None or self.truth.landmark_m is None:
            return Reason("the true landmarks are known of synthetic worlds only", "Leave these data out")
        return flight_missing(recording, site, self.settings())

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        truth = None if self.truth is None else with_leading_axis(self.truth)
        tracker = ControlTrueMap(**vars(self) | {"truth": truth})
        return track_one(tracker, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings in lock-step.

        See Mirzababaei & Akbari, eqs. 44 to 59.

        Parameters
        ----------
        recording
            Stack: epochs [r, n], readings of the inertial unit [r, i, 3], the noted start [r, 3], GPS
            [r, g, 3], and sightings [r, o, 3].
        survey
            Not used.
        site
            Origin of the local frame [r, 3].
        rngs
            Not used.

        Returns
        -------
        Track
            With the extra arrays of `flight_track`, among them the true landmarks, with covariances of zero.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        settings = self.settings()
        settings.check()
        reason = self.skip(recording, survey, site)
        if reason or self.truth is None or self.truth.landmark_m is None:
            raise refusal("control_true_map", reason)
        landmark_m = np.asarray(self.truth.landmark_m, dtype=np.float64)
        return navigation_track(known_map_flight(recording, site, settings, landmark_m), settings)


class _KnownMap(FlightRun):
    """A flight whose landmarks are part of the state from the start, without any uncertainty."""

    def __init__(self, recording: Recording, site: Site, settings: FlightFilter, landmark_m: Array) -> None:
        super().__init__(recording, site, settings)
        # A column of zeros in the covariance stays one: no sighting moves these landmarks.
        # Landmarks above the highest number seen are in no state.
        map_m = landmark_m[:, : self.marks, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
        known = np.isfinite(map_m).all(axis=-1)
        self.map[:, : map_m.shape[1]] = np.where(known[..., None], map_m, 0.0)
        self.known[:, : map_m.shape[1]] = known


def known_map_flight(
    recording: Recording, site: Site, settings: FlightFilter, landmark_m: Array
) -> FlightNavigation:
    """Navigate flights with landmarks that are known exactly.

    See Mirzababaei & Akbari, eqs. 49 to 51, without the columns of the landmarks.

    Parameters
    ----------
    recording, site
        Stacks with one leading axis r.
    settings
        Of the filter; its ``slam`` must be set.
    landmark_m
        East, north and up, [r, l, 3], metres; NaN fills up.

    Raises
    ------
    InputError
        For what `check_flight` refuses, or where a landmark is seen that is not known.
    """
    check_flight(recording, site, settings)
    number = np.asarray(recording.sighting_landmark)
    seen = number >= 0
    fits = landmark_m.ndim == 3 and landmark_m.shape[::2] == (len(number), 3)
    if not fits or number.max(initial=-1) >= landmark_m.shape[1]:
        raise InputError(
            "truth.landmark_m",
            f"its shape is {landmark_m.shape} for {len(number)} recordings with {number.max(initial=-1) + 1}"
            " landmarks",
            "Give the control the truth of the recordings that it tracks",
        )
    known = np.isfinite(landmark_m).all(axis=-1)
    if not np.take_along_axis(known, np.where(seen, number, 0), axis=1)[seen].all():
        raise InputError("truth.landmark_m", "a landmark is seen that it does not hold", "Give all landmarks")
    return _KnownMap(recording, site, settings, landmark_m).run()
