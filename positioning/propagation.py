"""The propagation model of the Bayesian rows: its fit to a survey, and the likelihood of a place."""

from abc import ABC, abstractmethod
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr

from positioning.errors import InputError
from positioning.estimator import clone
from positioning.fingerprints import FingerprintRegressor, Mask, training_members
from positioning.geometry import pairwise_distance_m, wall_crossings
from positioning.model import Array, Site, Survey

NEAREST_M = 0.5
"""Shorter distances to an access point count as this: nobody surveys inside its housing."""

# Fewer readings than this leave nothing to estimate the residual's deviation from.
_LEAST_READINGS = 4
# A reading is rounded to 1 dB, which alone deviates by 1/sqrt(12) dB.
_LEAST_DEVIATION_DB = 12.0**-0.5
# Eigenvalues of the normal equations below this part of the largest belong to no independent term.
_DEPENDENT = 1e-12


class Propagation(NamedTuple):
    """Propagation models of all folds.

    See Mirzababaei & Akbari, eq. 66.

    Attributes
    ----------
    coefficient
        b0, b1, b2 of each access point, [fold, ap, term]; dB, dB, dB per wall.
    deviation_db
        Standard deviation of the residuals, [fold, ap], dB.
    used
        [fold, ap], False where an access point was heard too seldom to be fitted.
    """

    coefficient: Array
    deviation_db: Array
    used: Mask


def propagation_terms(position_m: ArrayLike, site: Site) -> Array:
    """Return the terms of the propagation model: 1, ln distance, walls crossed.

    See Mirzababaei & Akbari, eq. 66, where the logarithm is named in the text but missing in the
    formula.

    Parameters
    ----------
    position_m
        Positions, [n, 2], metres.
    site
        Access points, and walls; without walls there is no third term.

    Returns
    -------
    Array
        [n, ap, term], term = 3, or 2 without walls.

    Raises
    ------
    InputError
        If the positions of the access points are not known.
    """
    if site.access_point_m is None or not np.isfinite(site.access_point_m).all():
        raise InputError(
            "site.access_point_m",
            "the propagation model needs the position of every access point",
            "Add the positions to the site, or leave out the Bayesian algorithms",
        )
    position = np.asarray(position_m, dtype=np.float64)
    access_point = np.asarray(site.access_point_m, dtype=np.float64)
    distance_m = np.maximum(pairwise_distance_m(position, access_point), NEAREST_M)
    terms = [np.ones_like(distance_m), np.log(distance_m)]
    if site.wall_m is not None:
        terms.append(wall_crossings(position, access_point, site.wall_m).astype(np.float64))
    return np.stack(terms, axis=-1)


def fit_propagation(terms: Array, rss_dbm: Array, member: Mask) -> Propagation:
    """Fit the propagation model of every fold and access point by least squares.

    See Mirzababaei & Akbari, eq. 66. Only readings that were heard count. Where terms are linearly
    dependent (no wall ever crossed, say), the solution of minimum norm is taken, which leaves out
    a term that is always zero.

    Parameters
    ----------
    terms
        From `propagation_terms`, [n, ap, term].
    rss_dbm
        Received signal strength, [n, ap], dBm; NaN = not heard.
    member
        [fold, n], True where a fingerprint trains in that fold.
    """
    samples, access_points, count = terms.shape
    heard = ~np.isnan(rss_dbm)
    reading = np.where(heard, rss_dbm, 0.0)
    counted = np.where(heard[..., None], terms, 0.0)
    weight = member.astype(np.float64)
    # Zero weights times finite terms are exact zeros: what is left out leaves no rounding behind.
    products = (counted[..., :, None] * terms[..., None, :]).reshape(samples, -1)
    gram = (weight @ products).reshape(-1, access_points, count, count)
    moment = (weight @ (counted * reading[..., None]).reshape(samples, -1)).reshape(
        -1, access_points, count, 1
    )
    coefficient = (np.linalg.pinv(gram, rcond=_DEPENDENT, hermitian=True) @ moment)[..., 0]
    # [ap, fold, n]
    predicted = np.moveaxis(coefficient, 1, 0) @ np.moveaxis(terms, 0, 2)
    residual = np.where(member & heard.T[:, None, :], reading.T[:, None, :] - predicted, 0.0)
    readings = weight @ heard.astype(np.float64)
    variance = np.sum(residual * residual, axis=2).T / np.maximum(readings - count, 1.0)
    deviation_db = np.maximum(np.sqrt(variance), _LEAST_DEVIATION_DB)
    return Propagation(coefficient, deviation_db, readings >= _LEAST_READINGS)


def log_likelihood(model: Propagation, terms: Array, rss_dbm: Array, floor_dbm: float | None = None) -> Array:
    """Return the logarithm of the likelihood of places, but for a constant of each fingerprint.

    See Mirzababaei & Akbari, eqs. 66-68: residuals of the propagation model are Gaussian, and
    independent between access points.

    Parameters
    ----------
    model
        Models of all folds, or of one fold that is used for all fingerprints.
    terms
        From `propagation_terms` at the places, [place, ap, term].
    rss_dbm
        Fingerprints, one a fold, [fold, ap], dBm; NaN = not heard.
    floor_dbm
        None: an access point that is not heard says nothing. Else its likelihood is the probability
        of a reading below this, dBm.

    Returns
    -------
    Array
        [fold, place].
    """
    heard = ~np.isnan(rss_dbm)
    reading = np.where(heard, rss_dbm, 0.0)
    total = np.zeros((len(rss_dbm), len(terms)))
    for access_point in range(terms.shape[1]):
        expected = model.coefficient[:, access_point] @ terms[:, access_point].T
        precision = 1.0 / model.deviation_db[:, access_point, None]
        used = np.broadcast_to(model.used[:, access_point], len(total))
        residual = (reading[:, access_point, None] - expected) * precision
        total -= np.where((used & heard[:, access_point])[:, None], 0.5 * residual * residual, 0.0)
        silent = used & ~heard[:, access_point]
        if floor_dbm is not None and silent.any():
            below = np.broadcast_to((floor_dbm - expected) * precision, total.shape)[silent]
            total[silent] += log_ndtr(below)
    return total


def grid_m(corner_m: ArrayLike, step_m: float) -> Array:
    """Return the centres of the cells into which a grid divides an area.

    See Mirzababaei & Akbari, eqs. 67 and 68: the places over which the posterior is taken.

    Parameters
    ----------
    corner_m
        Lower left and upper right corner, [2, 2], metres.
    step_m
        Largest side of a cell, metres.

    Returns
    -------
    Array
        [place, 2], metres.

    Raises
    ------
    InputError
        If the step is not positive, or the upper right corner is below or left of the other.
    """
    corner = np.asarray(corner_m, dtype=np.float64)
    size = corner[1] - corner[0]
    if not step_m > 0:
        raise InputError(
            f"grid_step_m={step_m}", "it must be positive", "Choose a step in metres, such as 0.5"
        )
    if not (size >= 0).all():
        raise InputError(
            "site.corner_m",
            f"the corners {corner.tolist()} enclose no area",
            "Give the lower left corner first, then the upper right one",
        )
    cells = np.maximum(np.ceil(size / step_m - 1e-9), 1).astype(int)
    x_m, y_m = (
        corner[0, axis] + size[axis] * (np.arange(cells[axis]) + 0.5) / cells[axis] for axis in range(2)
    )
    return np.stack(np.meshgrid(x_m, y_m, indexing="ij"), axis=-1).reshape(-1, 2)


class PropagationRegressor(FingerprintRegressor, ABC):
    """The part that both Bayesian estimators share: the posterior over a grid of places.

    See Mirzababaei & Akbari, eqs. 66-68. The prior is uniform over the site.

    Parameters
    ----------
    site
        Corners, access points and walls of the place.
    grid_step_m
        Step of the grid, metres.
    floor_dbm
        See `log_likelihood`.
    """

    def __init__(
        self, *, site: Site | None = None, grid_step_m: float = 0.5, floor_dbm: float | None = None
    ) -> None:
        self.site = site
        self.grid_step_m = grid_step_m
        self.floor_dbm = floor_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Fit the propagation model of each access point.

        See Mirzababaei & Akbari, eq. 66.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey cannot be used, or the access points' positions are not known.
        """
        rss, terms = self._prepare(rss_dbm, position_m, least=1)
        self.model_ = fit_propagation(terms, rss, np.ones((1, len(rss)), dtype=bool))
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, eqs. 67 and 68.
        """
        rss = self._readings(rss_dbm)
        return self._locate(log_likelihood(self.model_, self.grid_terms_, rss, self.floor_dbm))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Parameters as in `fit`, whose model stays as it is.
        """
        fresh = clone(self)
        rss, terms = fresh._prepare(rss_dbm, position_m, least=2)
        model = fit_propagation(terms, rss, training_members(position_m))
        return fresh._locate(log_likelihood(model, fresh.grid_terms_, rss, self.floor_dbm))

    def _prepare(self, rss_dbm: ArrayLike, position_m: ArrayLike, least: int) -> tuple[Array, Array]:
        """Return checked readings and the terms at their positions; set up the grid."""
        rss, position = self._training(rss_dbm, position_m, least)
        if self.site is None:
            raise InputError("site", "the propagation model needs a site", "Give one with its access points")
        terms = propagation_terms(position, self.site)
        if terms.shape[:2] != rss.shape:
            raise InputError(
                "site.access_point_m",
                f"{terms.shape[1]} access points, but fingerprints of {rss.shape[1]}",
                "Give one position for every column of rss_dbm",
            )
        self.grid_m_ = grid_m(self.site.corner_m, self.grid_step_m)
        self.grid_terms_ = propagation_terms(self.grid_m_, self.site)
        return rss, terms

    @abstractmethod
    def _locate(self, likelihood: Array) -> Array:
        """Return positions [m, 2] from the logarithm of the likelihood of the grid, [m, place]."""

    @staticmethod
    def skip(survey: Survey, site: Site | None) -> str | None:
        """Say why the propagation model cannot be used on these data, None where it can.

        See Mirzababaei & Akbari, eq. 66.
        """
        if site is None or site.access_point_m is None or not np.isfinite(site.access_point_m).all():
            return "the positions of the access points are not known"
        return None
