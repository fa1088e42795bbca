"""The random drive of a wheeled robot among furniture: commands, and the motion that they really gave.

See Raghavan et al., sections IV.D and V. All draws come in as arrays of fixed size, so that any number of
robots drive in lock-step and each depends on its own draws alone.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.model import Array

# How often a robot looks for a way on. Amidst furniture most ways are blocked; at three in four blocked,
# one step in a thousand finds no way in 24 draws.
ATTEMPTS = 24

_QUARTER_TURNS_RAD = np.array([0.0, 0.5, 1.0, -0.5]) * np.pi


class DriveDraws(NamedTuple):
    """The random numbers of a drive, standard ones, to be scaled.

    Attributes
    ----------
    start
        Quarter turn of the heading at the start, 0 to 3, [...].
    share
        Translation as a share of its span, uniform in [0, 1), [..., n, attempt].
    before, after
        Quarter turns, 0 to 3, before and after the translation, [..., n, attempt].
    noise
        Standard normals of turn before, advance, drift and turn after, [..., n, 4].
    """

    start: NDArray[np.int64]
    share: Array
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    noise: Array


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Commands of a drive, and what became of them; NaN after the end.

    Attributes
    ----------
    turn_before_rad, advance_m, turn_after_rad
        Commanded motion since the epoch before, [..., n]; zero at the first epoch.
    position_m
        True place at each epoch, [..., n, 2].
    heading_rad
        True heading at each epoch, [..., n], not wrapped.
    """

    turn_before_rad: Array
    advance_m: Array
    turn_after_rad: Array
    position_m: Array
    heading_rad: Array


def draw_drive(rng: np.random.Generator, *, runs: int, epochs: int) -> DriveDraws:
    """Draw what ``runs`` drives of at most ``epochs`` epochs need, [runs, epochs, ...].

    See Raghavan et al., section V.

    Parameters
    ----------
    rng
        Source of the draws; their number depends on ``runs`` and ``epochs`` alone.
    runs
        Number of drives.
    epochs
        Number of epochs, the start included.
    """
    return DriveDraws(
        start=rng.integers(4, size=runs),
        share=rng.random((runs, epochs, ATTEMPTS)),
        before=rng.integers(4, size=(runs, epochs, ATTEMPTS)),
        after=rng.integers(4, size=(runs, epochs, ATTEMPTS)),
        noise=rng.standard_normal((runs, epochs, 4)),
    )


def random_drive(
    start_m: ArrayLike,
    draws: DriveDraws,
    *,
    size_m: tuple[float, float],
    margin_m: float,
    furniture_m: ArrayLike,
    advance_m: tuple[float, float],
    epochs_least: int,
    turn_noise_rad: float,
    advance_noise_m: float,
    drift_noise_rad_per_m: float,
) -> Drive:
    """Drive random translations, each followed by a random multiple of a quarter turn.

    See Raghavan et al., sections IV.D and V, and the caption of Table II. A step is a turn, a straight line
    and a second turn. The turn before is zero unless the way straight on was refused: then translation and
    direction are drawn again, up to 24 times. A way is refused if it meets furniture, or, in the first
    ``epochs_least`` epochs, if it leaves the arena. Later a way that leaves the arena ends the run, and so
    does a robot that finds no way.

    Every turn has its noise, also a turn of zero. Drift turns the heading evenly along the translation,
    which therefore leads in the direction half way between. All ways are judged as they really go.

    Parameters
    ----------
    start_m
        Places of the first epoch, [..., 2], metres.
    draws
        Random numbers, [..., n, ...].
    size_m
        Width and depth of the arena, whose lower left corner is the origin.
    margin_m
        Distance that the robot keeps from the edge of the arena.
    furniture_m
        Lower left and upper right corners, [f, 2, 2], metres.
    advance_m
        Shortest and longest commanded translation.
    epochs_least
        Epochs that every run has.
    turn_noise_rad, advance_noise_m
        Standard deviation of each turn and of each translation.
    drift_noise_rad_per_m
        Standard deviation of the drift of the heading in a translation, per metre.

    Returns
    -------
    Drive
        Commands and true motion, [..., n].

    Raises
    ------
    InputError
        If a robot finds no way before ``epochs_least``.
    """
    leading, epochs = draws.noise.shape[:-2], draws.noise.shape[-2]
    runs = int(np.prod(leading, dtype=np.int64))
    start, share, before, after, noise = (
        values.reshape(runs, *values.shape[len(leading) :]) for values in draws
    )
    furniture = np.asarray(furniture_m, dtype=np.float64).reshape(-1, 2, 2)
    position_m = np.full((runs, epochs, 2), np.nan)
    heading_rad, turn_before_rad, advance, turn_after_rad = (
        np.full((runs, epochs), np.nan) for _ in range(4)
    )
    position_m[:, 0] = np.broadcast_to(np.asarray(start_m, dtype=np.float64), (*leading, 2)).reshape(runs, 2)
    heading_rad[:, 0] = _QUARTER_TURNS_RAD[start]
    turn_before_rad[:, 0] = advance[:, 0] = turn_after_rad[:, 0] = 0.0
    shortest, longest = advance_m

    driving = np.arange(runs)
    for epoch in range(1, epochs):
        turn = _QUARTER_TURNS_RAD[before[driving, epoch]]
        turn[:, 0] = 0.0
        ahead_m = shortest + (longest - shortest) * share[driving, epoch]
        turn_noise, advance_noise, drift_noise, after_noise = noise[driving, epoch].T[..., None]
        drift_rad = drift_noise_rad_per_m * ahead_m * drift_noise
        departure_rad = heading_rad[driving, epoch - 1, None] + turn + turn_noise_rad * turn_noise
        way_rad = departure_rad + drift_rad / 2
        driven_m = ahead_m + advance_noise_m * advance_noise
        place_m = position_m[driving, epoch - 1, None]
        end_m = place_m + driven_m[..., None] * np.stack([np.cos(way_rad), np.sin(way_rad)], axis=-1)

        leaves = ((end_m < margin_m) | (end_m > np.asarray(size_m) - margin_m)).any(axis=-1)
        refused = meets_rectangle(place_m, end_m, furniture)
        if epoch < epochs_least:
            refused |= leaves
        stuck = refused.all(axis=-1)
        if epoch < epochs_least and stuck.any():
            x, y = place_m[stuck][0, 0]
            raise InputError(
                "setting furniture_m",
                f"a robot at ({x:.2f}, {y:.2f}) m finds no way on in {ATTEMPTS} draws",
                "Leave more room between furniture, or shorten advance_m",
            )
        row = np.arange(len(driving))
        attempt = np.argmin(refused, axis=-1)
        onward = ~stuck & ~leaves[row, attempt]
        chosen = row[onward], attempt[onward]
        driving = driving[onward]
        turn_before_rad[driving, epoch] = turn[chosen]
        advance[driving, epoch] = ahead_m[chosen]
        turn_after_rad[driving, epoch] = _QUARTER_TURNS_RAD[after[driving, epoch, chosen[1]]]
        position_m[driving, epoch] = end_m[chosen]
        heading_rad[driving, epoch] = (
            (departure_rad + drift_rad)[chosen]
            + turn_after_rad[driving, epoch]
            + turn_noise_rad * after_noise[onward, 0]
        )
    return Drive(
        turn_before_rad=turn_before_rad.reshape(*leading, epochs),
        advance_m=advance.reshape(*leading, epochs),
        turn_after_rad=turn_after_rad.reshape(*leading, epochs),
        position_m=position_m.reshape(*leading, epochs, 2),
        heading_rad=heading_rad.reshape(*leading, epochs),
    )


def meets_rectangle(start_m: ArrayLike, end_m: ArrayLike, corner_m: ArrayLike) -> NDArray[np.bool_]:
    """Tell whether straight lines meet any of some rectangles along the axes; touching is meeting.

    See Raghavan et al., section V: part of the floor was cluttered with furniture.

    Parameters
    ----------
    start_m, end_m
        End points of the lines, [..., 2], metres.
    corner_m
        Lower left and upper right corners, [f, 2, 2], metres.

    Returns
    -------
    NDArray
        [...].
    """
    start, end = (np.asarray(values, dtype=np.float64)[..., None, :] for values in (start_m, end_m))
    low, high = np.moveaxis(np.asarray(corner_m, dtype=np.float64), -2, 0)
    along = end - start
    # Shares of the line at which it enters and leaves the strip of a rectangle, for x and for y. A line
    # along a strip is in it always or never.
    fixed = along == 0
    step = np.where(fixed, 1.0, along)
    within = (low <= start) & (start <= high)
    bounds = (low - start) / step, (high - start) / step
    enters = np.where(fixed, np.where(within, -np.inf, np.inf), np.minimum(*bounds))
    exits = np.where(fixed, np.where(within, np.inf, -np.inf), np.maximum(*bounds))
    meets: NDArray[np.bool_] = (
        np.maximum(enters.max(axis=-1), 0.0) <= np.minimum(exits.min(axis=-1), 1.0)
    ).any(axis=-1)
    return meets
