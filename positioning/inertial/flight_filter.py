"""The navigation of a flight by inertial sensors, GPS, fixes of a radio system, and landmarks.

See Mirzababaei & Akbari, sections 3 and 5. A strapdown navigation at the rate of its readings, and an
error-state Kalman filter beside it, whose state grows by three with every landmark (eqs. 37 to 59). What the
paper leaves open (start, variances, rates) is a setting of `flight_settings.FlightFilter`. What is refused
stands in `flight_checks`, which reading counts when in `flight_plan`.

Inside the filter the error of the position is in metres north, east, down, and so are the landmarks in the
local frame of the site. Readings with a clock of their own are compared with the navigation of their time,
and count at the end of the covariance's step that they fall into: an error ``x`` of that end was ``(I - F t)
x`` at the time t before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from positioning.inertial.error_state import increments
from positioning.inertial.flight_checks import check_flight
from positioning.inertial.flight_plan import (
    SIGHTINGS_TOGETHER,
    Event,
    Whole,
    interpolation_window,
    landmark_counts,
    plan_of,
    prepared,
    rank_within,
    readings_a_step,
)
from positioning.inertial.flight_settings import FlightFilter
from positioning.inertial.geodetic import (
    attitude_of,
    metres_per_unit,
    position_scale_m,
    roll_pitch_yaw,
    to_local,
)
from positioning.inertial.geodetic_error_state import (
    ATTITUDE,
    FORCE_BIAS,
    POSITION,
    RATE_BIAS,
    VELOCITY,
    fill_metric_error_dynamics,
)
from positioning.inertial.geodetic_strapdown import Strapdown, Together, together
from positioning.inertial.gps import metric_observation_matrix
from positioning.inertial.landmarks import (
    first_sight,
    from_sensor_m,
    has_direction,
    observation_matrices,
    relative_m,
    sighting_of,
)
from positioning.inertial.strapdown import cross_matrix, rotation
from positioning.model import Array, Recording, Site

SENSORS = ("gps", "fix", "sighting")

# Steps of the covariance between two looks at the rounding.
_TIDY = 64
# The condition of the innovation's covariance is looked at so often: in every tenth reading of GPS.
_CONDITION_EVERY = 10
# Readings that are prepared at a time.
_BLOCK = 500
# So often what hangs on place and velocity by way of the earth is taken anew: 1e-7 of gravity in that time.
_EARTH_S = 0.2
# Most inertial readings that the strapdown goes through at once.
_AT_ONCE = 10
_NED_OF_ENU = np.array([1, 0, 2])
_DOWN = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, kw_only=True)
class FlightNavigation:
    """Where flights were, at the epochs of their recordings, each after the updates of the same interval.

    After the end of a recording all is NaN.

    Attributes
    ----------
    time_s
        [r, n].
    geodetic
        Latitude, longitude, radians, height, metres, [r, n, 3].
    position_m
        East and north in the local frame of the site, [r, n, 2].
    height_m
        Above its origin, [r, n].
    velocity_m_per_s
        North, east and down, [r, n, 3].
    attitude_rad
        Roll, pitch and yaw, [r, n, 3].
    covariance
        Of the errors of position, metres north, east, down, velocity and attitude, [r, n, 9, 9].
    bias
        Of accelerometer and gyroscope at the end, [r, 6], m/s^2 and rad/s; zeros with 9 states.
    landmark_m
        Landmarks at the end, east, north and up, [r, l, 3], up to the greatest number that the stack sees;
        NaN for those never seen.
    landmark_covariance_m2
        [r, l, 3, 3], in the same axes.
    normalised_innovation_squared, degrees_of_freedom
        By the name of the sensor, each [r]: the mean per degree of freedom, NaN without one, and the number.
    innovation_condition
        Greatest condition number of the covariance of GPS innovations, [r], among the first and every tenth
        reading of GPS in the recording; NaN if none of these counts.
    skipped_sightings
        Sightings that told no direction, or were to, [r]: the landmark at, right above or below the sensor.
    """

    time_s: Array
    geodetic: Array
    position_m: Array
    height_m: Array
    velocity_m_per_s: Array
    attitude_rad: Array
    covariance: Array
    bias: Array
    landmark_m: Array
    landmark_covariance_m2: Array
    normalised_innovation_squared: Mapping[str, Array]
    degrees_of_freedom: Mapping[str, Array]
    innovation_condition: Array
    skipped_sightings: Whole


def navigate_flight(recording: Recording, site: Site, settings: FlightFilter) -> FlightNavigation:
    """Navigate the flights of a stack of recordings.

    See Mirzababaei & Akbari, sections 3 and 5. The flight starts one interval before the first inertial time,
    which is the end of a reading's interval. Readings after the last inertial one do not count.

    Parameters
    ----------
    recording
        Stack, one leading axis r.
    site
        Stack, with ``origin_geodetic`` [r, 3].
    settings
        Of the filter.

    Raises
    ------
    InputError
        For what `check_flight` refuses.
    """
    check_flight(recording, site, settings)
    return FlightRun(recording, site, settings).run()


class FlightRun:
    """One stack on its way; worlds are last in the navigation, first in covariances and readings.

    What `navigate_flight` does after `check_flight`. Who knows landmarks beforehand writes them into `map`
    and `known` before `run`.

    Parameters
    ----------
    recording, site
        Stacks that `check_flight` has seen.
    settings
        Of the filter.

    Attributes
    ----------
    map
        Landmarks, north, east and down in the local frame, [w, l, 3], metres.
    known
        Which of them are part of the state, [w, l].
    """

    def __init__(self, recording: Recording, site: Site, settings: FlightFilter) -> None:
        self.recording, self.settings = recording, settings
        self.origin = np.asarray(site.origin_geodetic, dtype=np.float64)
        self.states = settings.states
        # `check_flight` has seen that all flights have the same.
        time_s = np.asarray(recording.imu_time_s, np.float64)
        self.stride = int(readings_a_step(time_s, settings.covariance_hz)[0])
        self.readings = prepared(recording, self.stride)
        self.worlds = self.readings.duration_s.shape[1]
        self.window = interpolation_window(settings)
        self.marks, self.landmarks = landmark_counts(recording) if settings.slam else (0, 0)
        self.mover = Strapdown(
            np.asarray(recording.start_geodetic, np.float64),
            np.asarray(recording.start_velocity_m_per_s, np.float64),
            attitude_of(np.asarray(recording.start_attitude_rad, np.float64)),
        )
        size, worlds = self.states + 3 * self.landmarks, self.worlds
        self.covariance = np.zeros((worlds, size, size))
        self.scratch = np.empty_like(self.covariance)
        # Transition of the vehicle's errors since what it shares with the landmarks was moved.
        self.pending = np.tile(np.eye(self.states), (worlds, 1, 1))
        self._start_covariance()
        # Estimate of the error of the navigation as it stands, zero after a correction.
        self.error = np.zeros((worlds, size))
        self.bias = np.zeros((6, worlds))
        self.step_s = np.cumsum(self.readings.duration_s.reshape(-1, self.stride, worlds), axis=1)[:, -1]
        self.per_s = 1.0 / np.where(self.step_s > 0, self.step_s, 1.0)
        # Velocity increment of the specific force over a step.
        self.force_advance = np.zeros((3, worlds))
        self.map = np.zeros((worlds, self.landmarks, 3))
        self.known = np.zeros((worlds, self.landmarks), dtype=np.bool_)
        self.dynamics = np.zeros((worlds, self.states, self.states))
        self.spread = {name: np.zeros(worlds) for name in SENSORS}
        self.degrees = {name: np.zeros(worlds) for name in SENSORS}
        self.condition = np.full(worlds, np.nan)
        self.skipped = np.zeros(worlds, dtype=np.intp)
        # States of this step and, before them, as many as an interpolation may need.
        self.kept = self.window
        length = self.kept + self.stride
        self.place = np.tile(self.mover.geodetic, (length, 1, 1))
        self.speed = np.tile(self.mover.velocity_m_per_s, (length, 1, 1))
        self.turned = np.tile(self.mover.attitude, (length, 1, 1, 1))
        epochs = np.asarray(recording.time_s).shape
        self.found = FlightNavigation(
            time_s=np.asarray(recording.time_s, np.float64),
            geodetic=np.full((*epochs, 3), np.nan),
            position_m=np.full((*epochs, 2), np.nan),
            height_m=np.full(epochs, np.nan),
            velocity_m_per_s=np.full((*epochs, 3), np.nan),
            attitude_rad=np.full((*epochs, 3), np.nan),
            covariance=np.full((*epochs, 9, 9), np.nan),
            bias=np.zeros((worlds, 6)),
            landmark_m=np.full((worlds, self.marks, 3), np.nan),
            landmark_covariance_m2=np.full((worlds, self.marks, 3, 3), np.nan),
            normalised_innovation_squared={},
            degrees_of_freedom={},
            innovation_condition=self.condition,
            skipped_sightings=self.skipped,
        )

    def run(self) -> FlightNavigation:
        """Go through the whole flight, and return what was found."""
        plan = plan_of(self.recording, self.settings, self.readings, self.stride)
        count = len(self.readings.duration_s)
        biases = self.states == 15
        block = max(1, _BLOCK // self.stride) * self.stride
        every = max(1, int(_EARTH_S * self.settings.covariance_hz))
        # The strapdown goes through as many readings at once as divide a step of the covariance.
        at_once = max(size for size in range(1, _AT_ONCE + 1) if self.stride % size == 0)
        ready: list[Together] = []
        # The epochs at the start, before any reading: all slots hold the start.
        for event in plan.get(-1, ()):
            self._write(event, 0)
        for step, first in enumerate(range(0, count, self.stride)):
            last = first + self.stride
            if first % block == 0:
                part = slice(first, first + block)
                made = increments(
                    np.moveaxis(self.readings.force_m_per_s2[part], 1, 2),
                    np.moveaxis(self.readings.rate_rad_per_s[part], 1, 2),
                    self.readings.duration_s[part],
                    biases=biases,
                )
                ready = together(made, at_once)
            mover, anew = self.mover, step % every == 0
            if anew:
                mover.look_around()
            self.force_advance[...] = 0.0
            for slots in (self.place, self.speed, self.turned):
                slots[: self.kept] = slots[-self.kept :]
            for slot in range(self.kept, len(self.place), at_once):
                own = (first % block + slot - self.kept) // at_once
                way = mover.advance_together(ready[own], self.bias if biases else None)
                self.place[slot : slot + at_once] = way.geodetic
                self.speed[slot : slot + at_once] = way.velocity_m_per_s
                self.turned[slot : slot + at_once] = way.attitude
                self.force_advance += way.force_advance
            self._propagate(first, last, anew)
            # Number of the state in the first slot.
            offset = first + 1 - self.kept
            events = plan.get(step, ())
            if events:
                self._update(events, offset, last)
            if step % _TIDY == _TIDY - 1:
                mover.tidy()
                self.covariance += self.covariance.swapaxes(1, 2).copy()
                self.covariance *= 0.5
        return self._finish()

    def _start_covariance(self) -> None:
        settings = self.settings
        sigmas = np.concatenate(
            [
                settings.start_sigma_m,
                settings.start_velocity_sigma_m_per_s,
                settings.start_attitude_sigma_rad,
                np.repeat([settings.force_bias_m_per_s2, settings.rate_bias_rad_per_s], 3),
            ]
        )[: self.states]
        self.covariance[:, range(self.states), range(self.states)] = sigmas**2
        density = np.zeros(self.states)
        density[VELOCITY] = settings.noise_factor * settings.force_noise_m_per_s2_per_rt_hz**2
        density[ATTITUDE] = settings.noise_factor * settings.rate_noise_rad_per_s_per_rt_hz**2
        if self.states == 15:
            density[9:] = 2.0 / settings.bias_time_s * sigmas[9:] ** 2
        self.density = density

    def _propagate(self, first: int, last: int, anew: bool) -> None:
        """Move the covariance over a step, and keep its dynamics.

        See Mirzababaei & Akbari, eqs. 14, 17 and 18 (to second order in time), and 54. What vehicle and
        landmarks have in common waits for the next reading: `_settle`.
        """
        mover, states, dynamics = self.mover, self.states, self.dynamics
        duration, per_s = self.step_s[first // self.stride], self.per_s[first // self.stride]
        if self.settings.model == "flat":
            dynamics[:, range(3), range(3, 6)] = 1.0
        elif anew:
            fill_metric_error_dynamics(dynamics, mover.around, mover.velocity_m_per_s)
        dynamics[:, VELOCITY, ATTITUDE] = cross_matrix((self.force_advance * per_s).T)
        if states == 15:
            matrix = 0.5 * (self.turned[self.kept - 1] + self.turned[self.kept + last - first - 1])
            matrix = matrix.transpose(2, 0, 1)
            dynamics[:, VELOCITY, FORCE_BIAS] = matrix
            dynamics[:, ATTITUDE, RATE_BIAS] = -matrix
            np.einsum("rii->ri", dynamics)[:, 9:] = -1.0 / self.settings.bias_time_s
        change = dynamics * duration[:, None, None]
        change += 0.5 * (change @ change)
        np.einsum("rii->ri", change)[...] += 1.0
        covariance = self.covariance
        vehicle = covariance[:, :states, :states]
        np.einsum("rii->ri", vehicle)[...] += self.density * duration[:, None]
        vehicle[...] = change @ vehicle @ change.swapaxes(1, 2)
        if self.landmarks:
            self.pending = change @ self.pending
        if not self.settings.closed_loop:
            self.error[:, :states] = (change @ self.error[:, :states, None])[..., 0]

    def _settle(self, world: Whole) -> None:
        """Move what vehicle and landmarks have in common over the steps since the last reading of worlds."""
        states, covariance = self.states, self.covariance
        if len(world) == self.worlds:
            cross = self.pending @ covariance[:, :states, states:]
            covariance[:, :states, states:] = cross
            covariance[:, states:, :states] = cross.swapaxes(1, 2)
        else:
            cross = self.pending[world] @ covariance[world, :states, states:]
            covariance[world, :states, states:] = cross
            covariance[world, states:, :states] = cross.swapaxes(1, 2)
        self.pending[world] = np.eye(states)

    def _update(self, events: list[Event], offset: int, last: int) -> None:
        """Take in the readings of a step, correct, and write the epochs down."""
        end_s = self.readings.state_time_s[last]
        readings = [event for event in events if event.kind != "epoch"]
        if readings and self.landmarks:
            self._settle(np.unique(np.concatenate([event.world for event in readings])))
        for event in readings:
            take = {"gps": self._gps, "fix": self._fix, "sighting": self._sighting}[event.kind]
            take(event, offset, end_s[event.world] - event.time_s)
        if readings and self.settings.closed_loop:
            self._correct()
        for event in events:
            if event.kind == "epoch":
                self._write(event, offset)

    def _at_end(self, observed: Array, world: Whole, ago_s: Array) -> Array:
        """Return derivatives by the errors now of what hangs on those some time ago, [m, p, s]."""
        parts = observed.shape[-1]
        now = observed @ self.dynamics[world, :parts]
        now *= -ago_s[:, None, None]
        now[..., :parts] += observed
        return np.asarray(now)

    def _at(self, event: Event, offset: int) -> tuple[Array, Array, Array]:
        """Return geodetic position, velocity and attitude of the navigation at the times of an event.

        See Mirzababaei & Akbari, eqs. 32 to 35. Attitudes are averaged likewise: 1e-5 rad at 1 rad/s.
        """
        slot, world = event.state - offset, event.world[:, None]
        weight = event.weight[..., None]
        place = np.sum(weight * self.place[slot, :, world], axis=1)
        speed = np.sum(weight * self.speed[slot, :, world], axis=1)
        turned = np.sum(weight[..., None] * self.turned[slot, :, :, world], axis=1)
        return place, speed, turned

    def _gps(self, event: Event, offset: int, ago_s: Array) -> None:
        """Take in GPS; see Mirzababaei & Akbari, eqs. 27 to 36.1 and 52."""
        recording, settings, world, index = self.recording, self.settings, event.world, event.item
        place, speed, turned = self._at(event, offset)
        levers = recording.gps_lever_arm_m
        lever = np.zeros((len(world), 3)) if levers is None else np.asarray(levers, np.float64)[world]
        reading = np.clip(event.state[:, event.state.shape[1] // 2] - 1, 0, None)
        rate = self.readings.rate_rad_per_s[reading, :, world] - self.bias[3:, world].T
        rate -= (self.mover.frame_rate_rad_per_s()[:, world].T[:, None] @ turned)[:, 0]
        observed = metric_observation_matrix(turned, rate, lever, states=self.states)
        scale = position_scale_m(place)
        assert recording.gps_geodetic is not None
        away = (turned @ lever[..., None])[..., 0]
        innovation = (place - recording.gps_geodetic[world, index]) * scale + away
        sigma = np.broadcast_to(settings.gps_sigma_m, innovation.shape)
        if recording.gps_velocity_m_per_s is None:
            observed = observed[:, :3]
        else:
            moving = (turned @ np.cross(rate, lever)[..., None])[..., 0]
            faster = speed + moving - recording.gps_velocity_m_per_s[world, index]
            innovation = np.concatenate([innovation, faster], axis=1)
            velocity_sigma = np.broadcast_to(settings.gps_velocity_sigma_m_per_s, speed.shape)
            sigma = np.concatenate([sigma, velocity_sigma], axis=1)
        if settings.units == "radians":
            per_row = np.ones_like(innovation)
            per_row[:, :3] = 1.0 / np.abs(scale)
            observed, innovation, sigma = observed * per_row[..., None], innovation * per_row, sigma * per_row
        variance = self._take("gps", world, self._at_end(observed, world, ago_s), innovation, sigma**2)
        some = np.flatnonzero(index % _CONDITION_EVERY == 0)
        if len(some):
            number = np.linalg.cond(variance[some])
            self.condition[world[some]] = np.fmax(self.condition[world[some]], number)

    def _fix(self, event: Event, offset: int, ago_s: Array) -> None:
        """Take in a position in the plane."""
        place, _, _ = self._at(event, offset)
        world = event.world
        assert self.recording.fix_m is not None
        fix = np.asarray(self.recording.fix_m[world, event.item, 0], dtype=np.float64)
        local = to_local(place, self.origin[world])
        observed = np.broadcast_to(np.eye(2, self.states), (len(world), 2, self.states))
        innovation = local[:, 1::-1] - fix[:, ::-1]
        variance = np.full(innovation.shape, self.settings.fix_sigma_m**2)
        self._take("fix", world, self._at_end(observed, world, ago_s), innovation, variance)

    def _sighting(self, event: Event, offset: int, ago_s: Array) -> None:
        """Take in the sighting of a landmark, or make it part of the state.

        See Mirzababaei & Akbari, eqs. 44 to 51, and section 4 for a landmark that is new.
        """
        recording, settings, world, index = self.recording, self.settings, event.world, event.item
        assert recording.sighting is not None
        assert recording.sighting_landmark is not None
        place, _, turned = self._at(event, offset)
        local = to_local(place, self.origin[world])[:, _NED_OF_ENU] * _DOWN
        seen = np.asarray(recording.sighting[world, index], dtype=np.float64)
        number = np.asarray(recording.sighting_landmark[world, index], dtype=np.intp)
        levers = recording.sighting_lever_arm_m
        lever = np.zeros((len(world), 3)) if levers is None else np.asarray(levers, np.float64)[world]
        sigma = np.array([settings.range_sigma_m, settings.bearing_sigma_rad, settings.elevation_sigma_rad])
        known = self.known[world, number]
        again = np.flatnonzero(known)
        if len(again):
            relative = from_sensor_m(
                self.map[world[again], number[again]], local[again], turned[again], lever[again]
            )
            sure = has_direction(relative) & has_direction(relative_m(seen[again]))
            np.add.at(self.skipped, world[again[~sure]], 1)
            again, relative = again[sure], relative[sure]
        if len(again):
            one, mark = world[again], number[again]
            by_vehicle, by_landmark = observation_matrices(
                self.map[one, mark], local[again], turned[again], lever[again]
            )
            innovation = sighting_of(relative) - seen[again]
            innovation[:, 1] = (innovation[:, 1] + np.pi) % (2 * np.pi) - np.pi
            observed = self._at_end(by_vehicle, one, ago_s[again])
            self._take_sightings(one, mark, observed, by_landmark, innovation, sigma**2)
        fresh = np.flatnonzero(~known)
        if len(fresh):
            sure = has_direction(relative_m(seen[fresh]))
            np.add.at(self.skipped, world[fresh[~sure]], 1)
            fresh = fresh[sure]
        # One after the other: what two have in common is part of the second one's covariance.
        rank = rank_within(fresh, world[fresh])
        for turn in range(int(rank.max(initial=-1)) + 1):
            new = fresh[rank == turn]
            landmark, by_vehicle, by_sighting = first_sight(local[new], turned[new], lever[new], seen[new])
            by_state = self._at_end(by_vehicle, world[new], ago_s[new])
            self._augment(world[new], number[new], landmark, by_state, by_sighting * sigma)

    def _take_sightings(
        self,
        world: Whole,
        mark: Whole,
        observed: Array,
        by_landmark: Array,
        innovation: Array,
        variance: Array,
    ) -> None:
        """Take in sightings of known landmarks, at most `SIGHTINGS_TOGETHER` a world, in one step.

        See Mirzababaei & Akbari, eqs. 55 to 59. Filled up with sightings that tell nothing, so that the
        rounding of a flight does not hang on what others of its stack see.
        """
        states, number = self.states, np.unique(world)
        # Nothing changes where nothing is seen; most of a stack is cheaper to move in place than to pick.
        if 2 * len(number) > self.worlds:
            number = np.arange(self.worlds)
        count, every = len(number), np.searchsorted(number, world)
        slot = np.arange(len(world)) - np.searchsorted(world, world)
        vehicle = np.zeros((count, SIGHTINGS_TOGETHER, 3, states))
        landmark = np.zeros((count, SIGHTINGS_TOGETHER, 3, 3))
        rows = np.zeros((count, SIGHTINGS_TOGETHER, 3), dtype=np.intp)
        left, spreads = np.zeros((count, SIGHTINGS_TOGETHER, 3)), np.ones((count, SIGHTINGS_TOGETHER, 3))
        vehicle[every, slot], landmark[every, slot] = observed, by_landmark
        rows[every, slot] = states + 3 * mark[:, None] + np.arange(3)
        left[every, slot], spreads[every, slot] = innovation, variance
        parts = 3 * SIGHTINGS_TOGETHER
        flat = vehicle.reshape(count, parts, states)
        whole = count == self.worlds
        covariance = self.covariance if whole else self.covariance[number]
        error = self.error if whole else self.error[number]
        each = np.arange(count)[:, None, None]
        row_gain = flat @ covariance[:, :states]
        # Symmetric: the rows lie together in memory.
        row_gain.reshape(count, SIGHTINGS_TOGETHER, 3, -1)[...] += landmark @ covariance[each, rows]
        spread = flat @ row_gain[:, :, :states].swapaxes(1, 2)
        spread += (landmark @ row_gain.swapaxes(1, 2)[each, rows]).reshape(count, parts, parts)
        left -= (vehicle @ error[:, None, :states, None])[..., 0]
        left -= (landmark @ error[each, rows][..., None])[..., 0]
        self._lower(
            "sighting",
            number,
            row_gain,
            spread,
            left.reshape(count, parts),
            spreads.reshape(count, parts),
            3 * np.bincount(every, minlength=count),
        )

    def _augment(self, world: Whole, number: Whole, landmark: Array, by_state: Array, noisy: Array) -> None:
        """Make landmarks part of the state, one a world, with their covariance with everything else."""
        states = self.states
        rows = states + 3 * number[:, None] + np.arange(3)
        crossed = by_state @ self.covariance[world, :states]
        own = crossed[:, :, :states] @ by_state.swapaxes(1, 2) + noisy @ noisy.swapaxes(1, 2)
        self.covariance[world[:, None], rows] = crossed
        self.covariance[world[:, None], :, rows] = crossed
        self.covariance[world[:, None, None], rows[:, :, None], rows[:, None]] = own
        self.map[world, number] = landmark
        self.error[world[:, None], rows] = (by_state @ self.error[world, :states, None])[..., 0]
        self.known[world, number] = True

    def _take(self, kind: str, world: Whole, observed: Array, innovation: Array, variance: Array) -> Array:
        """Take in one reading in some worlds; return the covariance of the innovation.

        See Mirzababaei & Akbari, eqs. 55 to 59.
        """
        states = self.states
        row_gain = observed @ self.covariance[world, :states]
        spread = observed @ row_gain[:, :, :states].swapaxes(1, 2)
        left = innovation - (observed @ self.error[world, :states, None])[..., 0]
        degrees = np.full(len(world), innovation.shape[1])
        return self._lower(kind, world, row_gain, spread, left, variance, degrees)

    def _lower(
        self,
        kind: str,
        world: Whole,
        row_gain: Array,
        spread: Array,
        left: Array,
        variance: Array,
        degrees: Whole,
    ) -> Array:
        """Move errors and covariances of some worlds by an innovation; return its covariance."""
        spread = 0.5 * (spread + spread.swapaxes(1, 2))
        parts = left.shape[1]
        spread[:, range(parts), range(parts)] += variance
        inverse = np.linalg.inv(spread)
        gain = inverse @ row_gain
        moved = (left[:, None] @ gain)[:, 0]
        if len(world) == self.worlds:
            self.error += moved
            self.covariance -= np.matmul(row_gain.swapaxes(1, 2), gain, out=self.scratch)
        else:
            self.error[world] += moved
            self.covariance[world] -= row_gain.swapaxes(1, 2) @ gain
        self.spread[kind][world] += (left[:, None] @ inverse @ left[..., None])[:, 0, 0]
        self.degrees[kind][world] += degrees
        return np.asarray(spread)

    def _correct(self) -> None:
        """Move the estimated error into navigation, biases and map, and forget it.

        Towards the truth, with the error of `geodetic_error_state`: C <- (I + E) C, here by the exact
        rotation. The states kept for interpolation move alike.
        """
        mover, error = self.mover, self.error
        shift = (error[:, POSITION] / metres_per_unit(mover.around)).T
        turn = rotation(error[:, ATTITUDE])
        mover.geodetic -= shift
        mover.velocity_m_per_s -= error[:, VELOCITY].T
        mover.attitude[...] = (turn @ mover.attitude.transpose(2, 0, 1)).transpose(1, 2, 0)
        self.place -= shift
        self.speed -= error[:, VELOCITY].T
        self.turned[...] = (turn @ self.turned.transpose(0, 3, 1, 2)).transpose(0, 2, 3, 1)
        if self.states == 15:
            self.bias += error[:, 9:15].T
        if self.landmarks:
            self.map -= error[:, self.states :].reshape(self.map.shape)
        error[...] = 0.0

    def _write(self, event: Event, offset: int) -> None:
        """Write down the state at epochs."""
        place, speed, turned = self._at(event, offset)
        world, index, found = event.world, event.item, self.found
        if not self.settings.closed_loop:
            error = self.error[world]
            place = place - error[:, POSITION] / position_scale_m(place)
            speed = speed - error[:, VELOCITY]
            turned = rotation(error[:, ATTITUDE]) @ turned
        local = to_local(place, self.origin[world])
        found.geodetic[world, index] = place
        found.position_m[world, index] = local[:, :2]
        found.height_m[world, index] = local[:, 2]
        found.velocity_m_per_s[world, index] = speed
        found.attitude_rad[world, index] = roll_pitch_yaw(turned)
        found.covariance[world, index] = self.covariance[world, :9, :9]

    def _finish(self) -> FlightNavigation:
        found, states = self.found, self.states
        estimated = self.map
        if states == 15:
            found.bias[...] = self.bias.T + self.error[:, 9:15]
        if self.landmarks:
            estimated = self.map - self.error[:, states:].reshape(self.map.shape)
        seen = self.known[:, : self.marks]
        found.landmark_m[seen] = estimated[self.known][:, _NED_OF_ENU] * _DOWN
        blocks = self.covariance[:, states:, states:].reshape(
            self.worlds, self.landmarks, 3, self.landmarks, 3
        )
        each = np.arange(self.landmarks)
        own = np.moveaxis(blocks[:, each, :, each, :], 0, 1)
        own = own[..., _NED_OF_ENU, :][..., _NED_OF_ENU] * _DOWN[:, None] * _DOWN
        found.landmark_covariance_m2[seen] = own[self.known]
        normalised: dict[str, Array] = {}
        for name in SENSORS:
            count = self.degrees[name]
            mean = self.spread[name] / np.where(count > 0, count, 1.0)
            normalised[name] = np.where(count > 0, mean, np.nan)
        return replace(found, normalised_innovation_squared=normalised, degrees_of_freedom=self.degrees)
