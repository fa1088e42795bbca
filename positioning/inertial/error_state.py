"""Error-state Kalman filter of a strapdown navigation, many worlds in lock-step.

See Frank et al., section 3.1, Foxlin (2005), IEEE Comput. Graph. Appl. 25(6), and Groves (2013), chapter 14.

Convention: error = truth less estimate, in the order position (3), velocity (3), attitude (3), and with 15
states accelerometer bias (3) and gyroscope bias (3). Position, velocity and attitude error are in the
navigation frame, biases in that of the sensor. The attitude error is a rotation vector on the left:
``C_true = Exp(error) C_estimate``. A bias is what the sensor reads too much.

Inside the filter worlds are the last axis of vectors and attitudes, so that an operation is one pass over
contiguous memory, and the first axis of covariances, whose products are then those of small matrices.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.inertial.merged import MOMENTS, Merged, noise_of_moments
from positioning.inertial.strapdown import GRAVITY_M_PER_S2, cross_matrix, mean_rotation, rotation
from positioning.model import Array

STATES = (9, 15)
POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
FORCE_BIAS, RATE_BIAS = slice(9, 12), slice(12, 15)

# Three axes, and the first two again: the cross product is then a difference of two products of slices.
_ROUND = np.array([0, 1, 2, 0, 1])
# Leads a vector to the nine entries of minus its cross product.
_MINUS_CROSS = -cross_matrix(np.eye(3)).reshape(3, 9)


class ProcessNoise(NamedTuple):
    """Spectral densities of white noise, the same along all axes.

    Attributes
    ----------
    force_m_per_s2_per_rt_hz, rate_rad_per_s_per_rt_hz
        Of the readings.
    force_bias_m_per_s2_per_rt_s, rate_bias_rad_per_s_per_rt_s
        Of the random walks of their biases: standard deviation after one second.
    heading_rad_per_rt_s
        Of a random walk of the heading, beside that of the rate's noise.
    """

    force_m_per_s2_per_rt_hz: float
    rate_rad_per_s_per_rt_hz: float
    force_bias_m_per_s2_per_rt_s: float = 0.0
    rate_bias_rad_per_s_per_rt_s: float = 0.0
    heading_rad_per_rt_s: float = 0.0


class Increments(NamedTuple):
    """Readings made ready for the filter: n samples of w worlds.

    Attributes
    ----------
    turn_and_advance
        Rotation over the sample, and beside it the velocity increment of the specific force in the frame of
        the sample before: [n, 3, 4, w].
    mean_rotation_s
        Mean rotation on the way, times the duration, [n, 3, 3, w]; None where no biases are estimated.
    duration_s
        [n, w]; nothing moves in a sample that lasts 0 s.
    """

    turn_and_advance: Array
    mean_rotation_s: Array | None
    duration_s: Array


def increments(
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    duration_s: ArrayLike,
    *,
    biases: bool = False,
) -> Increments:
    """Integrate readings over their samples, as `strapdown.navigate` does, for `ErrorStateFilter.predict`.

    See Groves (2013), section 5.4.

    Parameters
    ----------
    specific_force_m_per_s2, angular_rate_rad_per_s
        [n, w, 3], in the frame of the sensor.
    duration_s
        [n, w].
    biases
        Whether the filter has 15 states.
    """
    duration = np.asarray(duration_s, dtype=np.float64)
    turn = np.asarray(angular_rate_rad_per_s, dtype=np.float64) * duration[..., None]
    both = np.empty((len(duration), 3, 4, duration.shape[1]))
    both[:, :, :3] = np.moveaxis(rotation(turn), 1, -1)
    mean = np.ascontiguousarray(np.moveaxis(mean_rotation(turn), 1, -1))
    mean *= duration[:, None, None]
    force = np.moveaxis(np.asarray(specific_force_m_per_s2, dtype=np.float64), 1, -1)
    advance = both[:, :, 3]
    np.multiply(mean[:, :, 0], force[:, 0, None], out=advance)
    advance += mean[:, :, 1] * force[:, 1, None]
    advance += mean[:, :, 2] * force[:, 2, None]
    return Increments(both, mean if biases else None, duration)


def transition(
    attitude: ArrayLike,
    specific_force_m_per_s2: ArrayLike,
    angular_rate_rad_per_s: ArrayLike,
    duration_s: float,
    *,
    states: int = 9,
) -> Array:
    """Return the derivative of the error after a sample by the error before it, as one matrix.

    See Groves (2013), eq. 14.50. The filter itself never builds it. Left out: what a gyroscope bias does to
    the velocity within the very same sample, at most half of force times duration squared.

    Parameters
    ----------
    attitude
        Before the sample, [..., 3, 3].
    specific_force_m_per_s2, angular_rate_rad_per_s
        Readings less the biases, [..., 3].
    duration_s
        Of the sample.
    states
        9 or 15.

    Returns
    -------
    Array
        [..., states, states].

    Raises
    ------
    InputError
        For another number of states.
    """
    _check_states(states)
    matrix, force = np.asarray(attitude, np.float64), np.asarray(specific_force_m_per_s2, np.float64)
    mean = matrix @ mean_rotation(np.asarray(angular_rate_rad_per_s, np.float64) * duration_s) * duration_s
    change = np.broadcast_to(np.eye(states), (*force.shape[:-1], states, states)).copy()
    advance = cross_matrix((mean @ force[..., None])[..., 0])
    change[..., POSITION, VELOCITY] = duration_s * np.eye(3)
    change[..., VELOCITY, ATTITUDE] = -advance
    change[..., POSITION, ATTITUDE] = -0.5 * duration_s * advance
    if states == 15:
        change[..., VELOCITY, FORCE_BIAS] = -mean
        change[..., POSITION, FORCE_BIAS] = -0.5 * duration_s * mean
        change[..., ATTITUDE, RATE_BIAS] = -mean
    return change


class ErrorStateFilter:
    """Strapdown navigation of w worlds, and the covariance of its error.

    See Frank et al., section 3.1. First `predict`, then the updates of that sample in any order, then
    `correct`, which moves the estimated error into the navigation.

    Parameters
    ----------
    position_m, velocity_m_per_s
        At the start, [w, 3].
    attitude
        At the start, [w, 3, 3].
    covariance
        Of the error at the start, [w, s, s] with s = 9 or 15.
    noise
        Of the readings.
    gravity_m_per_s2
        [w] or one number.

    Raises
    ------
    InputError
        For shapes that do not fit each other.
    """

    def __init__(
        self,
        *,
        position_m: ArrayLike,
        velocity_m_per_s: ArrayLike,
        attitude: ArrayLike,
        covariance: ArrayLike,
        noise: ProcessNoise,
        gravity_m_per_s2: ArrayLike = GRAVITY_M_PER_S2,
    ) -> None:
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.ndim != 3 or matrix.shape[1] != matrix.shape[2]:
            raise InputError("covariance", f"its shape is {matrix.shape}, not [w, s, s]", "Correct it")
        worlds, self.states = matrix.shape[:2]
        _check_states(self.states)
        self.covariance = matrix.copy()
        self.position_m = _worlds_last("position_m", position_m, (worlds, 3))
        self.velocity_m_per_s = _worlds_last("velocity_m_per_s", velocity_m_per_s, (worlds, 3))
        self.attitude = _worlds_last("attitude", attitude, (worlds, 3, 3))
        self.bias = np.zeros((6, worlds))
        self.error = np.zeros((self.states, worlds))
        self.gravity_m_per_s2 = np.broadcast_to(np.asarray(gravity_m_per_s2, np.float64), (worlds,)).copy()
        self.noise = noise
        self._density = np.zeros(self.states)
        for part, density in zip((VELOCITY, ATTITUDE, FORCE_BIAS, RATE_BIAS), noise[:4], strict=True):
            self._density[part] = density**2
        self._density[8] += noise.heading_rad_per_rt_s**2
        self._transition = np.tile(np.eye(self.states), (worlds, 1, 1))
        self._position_by_velocity = np.einsum("wii->wi", self._transition[:, POSITION, VELOCITY])
        self._by_attitude = self._transition[:, :6, ATTITUDE].reshape(worlds, 2, 3, 3)
        self._way_and_advance = np.empty((3, 2, worlds))
        self._of_moments = noise_of_moments(
            noise.force_m_per_s2_per_rt_hz**2,
            noise.rate_rad_per_s_per_rt_hz**2,
            noise.heading_rad_per_rt_s**2,
        )
        self._diagonal = np.einsum("wii->wi", self.covariance)
        self._square = np.empty_like(self.covariance)
        self._matrix, self._matrix_too, self._turned = (np.empty((3, 4, worlds)) for _ in range(3))
        self._panel, self._roots = np.empty((3, self.states, worlds)), np.empty((3, self.states, worlds))
        self._state, self._half_step = np.empty((self.states, worlds)), np.empty(worlds)

    def predict(
        self,
        turn_and_advance: Array,
        duration_s: Array,
        mean_rotation_s: Array | None = None,
        merged: Merged | None = None,
    ) -> None:
        """Move navigation and covariance over one sample, or over several that are merged.

        The noise of a sample enters at its end.

        Parameters
        ----------
        turn_and_advance, duration_s, mean_rotation_s
            One sample of `Increments`: [3, 4, w], [w] and [3, 3, w].
        merged
            What more there is to know of worlds for which they are sums over several samples; 9 states only.
        """
        turned, matrix, other = self._turned, self._matrix, self._matrix_too
        attitude, velocity, position = self.attitude, self.velocity_m_per_s, self.position_m
        half = np.multiply(duration_s, 0.5, out=self._half_step)
        np.multiply(attitude[:, 0, None], turn_and_advance[0], out=turned)
        np.multiply(attitude[:, 1, None], turn_and_advance[1], out=matrix)
        np.multiply(attitude[:, 2, None], turn_and_advance[2], out=other)
        turned += matrix
        turned += other
        both, mean = self._way_and_advance, None
        way, advance = both[:, 0], both[:, 1]
        advance[...] = turned[:, 3]
        if mean_rotation_s is not None:
            mean = _product(attitude, mean_rotation_s)
            biased = np.sum(mean[:, None] * self.bias.reshape(2, 3, -1), axis=2)
            advance -= biased[:, 0]
            turned[:, :3] -= _crossed(biased[:, 1], turned[:, :3])
        np.multiply(advance, half, out=way)
        noise: Array | float = 0.0
        if merged is not None:
            before = attitude[..., merged.world]
            way[:, merged.world] = np.sum(before * merged.way_m, axis=1)
            noise = self._merged_noise(before, merged.moments)
        attitude[...] = turned[:, :3]
        moved = np.multiply(velocity, duration_s, out=matrix[:, 0])
        moved += way
        position += moved
        velocity += advance
        fallen = self.gravity_m_per_s2 * duration_s
        velocity[2] -= fallen
        fallen *= half
        position[2] -= fallen

        change = self._transition
        # Sums of one product and two zeros: exact in any order.
        self._by_attitude[...] = (both.transpose(2, 1, 0) @ _MINUS_CROSS).reshape(-1, 2, 3, 3)
        self._position_by_velocity[...] = duration_s[:, None]
        if mean is not None:
            block = np.negative(mean.transpose(2, 0, 1))
            change[:, VELOCITY, FORCE_BIAS] = change[:, ATTITUDE, RATE_BIAS] = block
            np.multiply(block, half[:, None, None], out=change[:, POSITION, FORCE_BIAS])
        np.matmul(change, self.covariance, out=self._square)
        np.matmul(self._square, change.swapaxes(1, 2), out=self.covariance)
        self._diagonal += self._density * duration_s[:, None]
        if merged is not None:
            self.covariance[merged.world] += noise

    def _merged_noise(self, attitude: Array, moments: Array) -> Array:
        """Return what the noise of merged samples adds to covariances [k, 9, 9]."""
        into = np.zeros((attitude.shape[-1], MOMENTS, MOMENTS))
        into[:, :3, :3] = into[:, 3:6, 3:6] = attitude.transpose(2, 0, 1)
        into[:, 6, 6] = into[:, 7, 7] = 1.0
        turned = into @ moments @ into.swapaxes(1, 2)
        # Not as one product of matrices, whose rounding would hang on how many worlds there are.
        return np.asarray((turned.reshape(-1, 1, MOMENTS * MOMENTS) @ self._of_moments).reshape(-1, 9, 9))

    def update(self, gain_row: Array, innovation: Array, variance: Array, used: Array) -> None:
        """Take in one number a world; it counts in `error` at once, and in the navigation at `correct`.

        See Groves (2013), section 3.2.6 (sequential updates).

        Parameters
        ----------
        gain_row
            Covariance of the error with what is measured, [s, w].
        innovation
            Measured less predicted, with the errors known so far, [w].
        variance
            Of the innovation, [w], above zero.
        used
            [w], 1 where the world has the measurement, 0 where it has none.
        """
        weight = used / variance
        np.multiply(gain_row, weight * innovation, out=self._state)
        self.error += self._state
        np.multiply(gain_row, np.sqrt(weight, out=weight), out=self._state)
        root = self._state.T
        np.multiply(root[:, :, None], root[:, None], out=self._square)
        self.covariance -= self._square

    def zero_velocity(self, at_rest: Array, variance_m2_per_s2: float) -> None:
        """Take in that the foot does not move.

        See Frank et al., sections 3.1 and 3.2.

        Parameters
        ----------
        at_rest
            [w], 1 where it rests, else 0.
        variance_m2_per_s2
            Of each part of the velocity at rest.
        """
        # One axis after the other on the three rows that matter; then the whole covariance at once.
        panel, roots, state, error = self._panel, self._roots, self._state, self.error
        panel[...] = self.covariance[:, VELOCITY].transpose(1, 2, 0)
        for axis in range(3):
            row, root, part = panel[axis], roots[axis], 3 + axis
            weight = row[part] + variance_m2_per_s2
            np.divide(at_rest, weight, out=weight)
            innovation = self.velocity_m_per_s[axis] + error[part]
            innovation *= weight
            np.multiply(row, innovation, out=state)
            error -= state
            np.multiply(row, np.sqrt(weight, out=weight), out=root)
            if axis < 2:
                panel[axis + 1 :] -= root[part + 1 : 6, None] * root
        worlds_first = np.ascontiguousarray(roots.transpose(2, 0, 1))
        np.matmul(worlds_first.swapaxes(1, 2), worlds_first, out=self._square)
        self.covariance -= self._square

    def magnetic_heading(
        self, field: Array, north_rad: Array, variance_rad2: float, used: NDArray[np.float64]
    ) -> None:
        """Take in that the horizontal part of the magnetic field points north.

        See Frank et al., section 3.1; the derivative by the attitude error is exact, with the tilt.

        Parameters
        ----------
        field
            In the frame of the sensor, [3, w], of any unit; finite also where it is not used.
        north_rad
            Direction to magnetic north in the navigation frame, [w].
        variance_rad2
            Of the direction of the horizontal field.
        used
            [w], 1 where the world has the measurement, 0 where it has none.
        """
        east, north, up = np.sum(self.attitude * field, axis=1)
        squared = east * east + north * north
        used = used * (squared > 0)
        squared = np.where(squared > 0, squared, 1.0)
        by_east, by_north = -up * east / squared, -up * north / squared
        covariance, error = self.covariance, self.error
        row = covariance[:, 6].T * by_east + covariance[:, 7].T * by_north + covariance[:, 8].T
        variance = row[6] * by_east + row[7] * by_north + row[8] + variance_rad2
        ahead, aside = np.cos(north_rad), np.sin(north_rad)
        found = np.arctan2(aside * east - ahead * north, ahead * east + aside * north)
        known = error[6] * by_east + error[7] * by_north + error[8]
        self.update(row, found - known, variance, used)

    def position_fix(self, fix_m: Array, root_precision: Array, used: Array) -> None:
        """Take in a position in the plane.

        Parameters
        ----------
        fix_m
            [2, w]; finite also where it is not used.
        root_precision
            Inverse of the lower triangular root of the covariance of the fix, [2, 2, w].
        used
            [w], 1 where the world has a fix, 0 where it has none.
        """
        covariance, error = self.covariance, self.error
        away = fix_m - self.position_m[:2]
        for by_x, by_y in root_precision:
            row = by_x * covariance[:, 0].T + by_y * covariance[:, 1].T
            innovation = by_x * (away[0] - error[0]) + by_y * (away[1] - error[1])
            self.update(row, innovation, by_x * row[0] + by_y * row[1] + 1.0, used)

    def correct(self) -> None:
        """Move the estimated error into position, velocity, attitude and biases, and forget it.

        See Groves (2013), section 14.1.1 (closed loop). The rotation of the attitude error is exactly one,
        by a unit quaternion, and right to third order.
        """
        error = self.error
        self.position_m += error[POSITION]
        self.velocity_m_per_s += error[VELOCITY]
        if self.states == 15:
            self.bias += error[9:]
        turn = error[ATTITUDE]
        once = _crossed(turn, self.attitude)
        twice = _crossed(turn, once)
        squared = turn * turn
        scale = squared[0] + squared[1]
        scale += squared[2]
        scale *= 0.25
        scale += 1.0
        twice *= 0.5
        once += twice
        once /= scale
        self.attitude += once
        error[...] = 0.0

    def tidy(self) -> None:
        """Take the rounding of many steps off the attitude and the symmetry of the covariance."""
        excess = np.einsum("kiw,kjw->ijw", self.attitude, self.attitude)
        excess -= np.eye(3)[..., None]
        self.attitude -= 0.5 * np.einsum("ikw,kjw->ijw", self.attitude, excess)
        np.add(self.covariance, self.covariance.swapaxes(1, 2), out=self._square)
        np.multiply(self._square, 0.5, out=self.covariance)


def _check_states(states: int) -> None:
    if states not in STATES:
        raise InputError(f"states={states}", "an error-state filter has 9 or 15", "Take one of them")


def _worlds_last(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InputError(name, f"its shape is {array.shape}, not {shape}", "Give one a world")
    # A copy always: the filter works in place.
    return np.moveaxis(array, 0, -1).copy()


def _crossed(vector: Array, matrix: Array) -> Array:
    """Return the cross products of vectors [3, w] with the columns of matrices [3, c, w]."""
    around, twice = vector.take(_ROUND, axis=0), matrix.take(_ROUND, axis=0)
    crossed = around[1:4, None] * twice[2:5]
    crossed -= around[2:5, None] * twice[1:4]
    return np.asarray(crossed)


def _product(left: Array, right: Array) -> Array:
    """Return products of matrices [3, 3, w] with [3, s, w]."""
    product = left[:, 0, None] * right[0]
    product += left[:, 1, None] * right[1]
    product += left[:, 2, None] * right[2]
    return np.asarray(product)
