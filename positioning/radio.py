"""Parts of an indoor radio world: path loss, shadowing, and what a receiver reports.

All parameters follow NumPy's broadcasting against the array that they act on: a number for each
world stands before arrays [world, n, ap] as [world, 1, 1], one for each access point as [ap].
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.geometry import pairwise_distance_m

Array = NDArray[np.float64]

REFERENCE_DISTANCE_M = 1.0
"""Distance at which path loss models of buildings state their reference level."""

# Relative to the variance: keeps the factorisation going where two places coincide, and is far below
# anything that a receiver resolves.
_JITTER = 1e-9


def path_loss_dbm(distance_m: ArrayLike, *, reference_dbm: ArrayLike, path_loss_exponent: ArrayLike) -> Array:
    """Return the mean received signal strength of log-distance path loss in free view.

    The model behind Mirzababaei & Akbari, eq. 66, without its walls. Nearer than the reference
    distance of 1 m the level stays at the reference.

    Parameters
    ----------
    distance_m
        Distance from the transmitter, [...], metres.
    reference_dbm
        Level at 1 m, dBm.
    path_loss_exponent
        Ten times this is the loss per decade of distance, in dB.

    Returns
    -------
    Array
        Received signal strength, [...], dBm.
    """
    distance = np.maximum(np.asarray(distance_m, dtype=np.float64), REFERENCE_DISTANCE_M)
    decades = np.log10(distance / REFERENCE_DISTANCE_M)
    level: Array = np.asarray(reference_dbm) - 10.0 * np.asarray(path_loss_exponent) * decades
    return level


def correlated_shadowing_db(
    position_m: ArrayLike,
    *,
    deviation_db: ArrayLike,
    correlation_length_m: ArrayLike,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Draw shadowing that fades in and out over space, independent for each access point.

    Gudmundson (1991): the correlation between two places falls with their distance d as
    exp(-d / correlation length). Neither the length nor the deviation is in the papers.

    Parameters
    ----------
    position_m
        Places, [..., n, 2], metres.
    deviation_db
        Standard deviation at each place, dB; broadcasts against [..., n, count].
    correlation_length_m
        Distance at which the correlation is 1/e, metres; broadcasts against [..., n, n].
    count
        Number of independent fields, one for each access point.
    rng
        Source of the draws: exactly [..., n, count] standard normals.

    Returns
    -------
    Array
        Shadowing, [..., n, count], dB.

    Raises
    ------
    InputError
        For a negative deviation or a correlation length that is not positive.
    """
    deviation, length = np.asarray(deviation_db), np.asarray(correlation_length_m)
    if not np.all(deviation >= 0):
        raise InputError(
            "deviation_db", f"{deviation} is not zero or more", "Give a standard deviation in dB"
        )
    if not np.all(length > 0):
        raise InputError("correlation_length_m", f"{length} is not positive", "Give a length in metres")
    correlation = np.exp(-pairwise_distance_m(position_m, position_m) / length)
    correlation += _JITTER * np.eye(correlation.shape[-1])
    factor = np.linalg.cholesky(correlation)
    shadowing: Array = deviation * (factor @ rng.standard_normal((*factor.shape[:-1], count)))
    return shadowing


def receive(
    field_dbm: ArrayLike,
    *,
    noise_db: ArrayLike,
    floor_dbm: ArrayLike,
    fading: np.random.Generator | ArrayLike,
) -> Array:
    """Return what a receiver reports of a radio field: faded, in whole dBm, nothing below its floor.

    Mirzababaei & Akbari, section 6, report readings in dBm and nothing of the receiver; whole dBm
    are what IEEE 802.11b and Bluetooth receivers report.

    Parameters
    ----------
    field_dbm
        Mean received signal strength, [..., n, ap], dBm.
    noise_db
        Standard deviation of the fading of a scan, dB. The draws do not depend on it.
    floor_dbm
        A rounded reading below this is not heard, dBm.
    fading
        Source of one standard normal for each value of ``field_dbm``, or these normals themselves,
        an array that broadcasts against ``field_dbm`` (more leading axes: more scans of a place).

    Returns
    -------
    Array
        Received signal strength, [..., n, ap], dBm; NaN = not heard.

    Raises
    ------
    InputError
        For negative noise.
    """
    field, noise = np.asarray(field_dbm, dtype=np.float64), np.asarray(noise_db)
    if not np.all(noise >= 0):
        raise InputError("noise_db", f"{noise} is not zero or more", "Give a standard deviation in dB")
    normal = fading.standard_normal(field.shape) if isinstance(fading, np.random.Generator) else fading
    reading = np.rint(field + noise * np.asarray(normal, dtype=np.float64))
    return np.where(reading < np.asarray(floor_dbm), np.nan, reading)


def interpolate(grid_dbm: Array, position_m: Array, grid_m: float) -> Array:
    """Interpolate fields bilinearly between the nodes of a grid whose first node is the origin.

    Parameters
    ----------
    grid_dbm
        Values at the nodes, [world, x, y, beacon].
    position_m
        Places within the grid, [world, run, epoch, 2], metres; NaN for none.
    grid_m
        Distance between nodes.

    Returns
    -------
    Array
        [world, run, epoch, beacon]; NaN where there is no place.
    """
    node = position_m / grid_m
    last = np.array(grid_dbm.shape[1:3]) - 2
    # A place on the far edge belongs to the last cell.
    cell = np.clip(np.floor(np.nan_to_num(node)), 0, last).astype(np.int64)
    share = (node - cell)[..., None]
    (x, y), (right, up) = np.moveaxis(cell, -1, 0), np.moveaxis(share, -2, 0)
    world = np.arange(len(grid_dbm))[:, None, None]
    lower = (1 - right) * grid_dbm[world, x, y] + right * grid_dbm[world, x + 1, y]
    upper = (1 - right) * grid_dbm[world, x, y + 1] + right * grid_dbm[world, x + 1, y + 1]
    between: Array = (1 - up) * lower + up * upper
    return between
