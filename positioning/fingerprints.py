"""Common parts of the fingerprinting algorithms: who may train, signal distances, not heard."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError, Reason, check_whole
from positioning.estimator import Regressor, Transformer
from positioning.model import Array, Survey

# From so many differences on, SciPy's loop is worth the third of a second that its import takes.
_MANY_DIFFERENCES = 2_000_000

Mask = NDArray[np.bool_]
Index = NDArray[np.intp]


def training_members(position_m: ArrayLike) -> Mask:
    """Tell, for every fold of a leave-one-out, which fingerprints may train.

    See Mirzababaei & Akbari, section 6 ("Leave-One-Out method"). The whole reference point is left
    out: no fingerprint taken at exactly the tested one's position trains.

    Parameters
    ----------
    position_m
        Positions, [n, 2], metres.

    Returns
    -------
    NDArray
        [n, n], row = fold, True where the column may train.
    """
    position = np.asarray(position_m, dtype=np.float64)
    members: Mask = (position[:, None, 0] != position[None, :, 0]) | (
        position[:, None, 1] != position[None, :, 1]
    )
    return members


def too_few(survey: Survey, needed: int, name: str) -> str | None:
    """Return why a survey is too small for a setting, None where it is not.

    See Mirzababaei & Akbari, section 6.

    Parameters
    ----------
    survey
        The survey; leave-one-out trains with all fingerprints but those of one place.
    needed
        The smallest number of training fingerprints that the setting can work with.
    name
        The setting, for the reason: ``k = 4``.

    Raises
    ------
    InputError
        For a setting that is no whole number.
    """
    check_whole(name.split(" ")[0], needed)
    _, counts = np.unique(survey.position_m, axis=0, return_counts=True)
    left = len(survey.position_m) - int(counts.max())
    if left >= needed:
        return None
    return Reason(
        f"{name} needs {needed} training fingerprints, this survey leaves {left}",
        f"Choose a smaller {name.split(' ')[0]}, or survey more places",
    )


def fill_not_heard(rss_dbm: ArrayLike, floor_dbm: float) -> Array:
    """Return the readings with ``floor_dbm`` in place of NaN.

    See Mirzababaei & Akbari, section 6; the paper does not say how it fills them.

    Parameters
    ----------
    rss_dbm
        Received signal strength, [..., ap], dBm; NaN = not heard.
    floor_dbm
        What stands for an access point that was not heard, dBm.
    """
    rss = np.asarray(rss_dbm, dtype=np.float64)
    return np.where(np.isnan(rss), floor_dbm, rss)


def standardisation(values: Array, member: Mask) -> tuple[Array, Array]:
    """Return mean and standard deviation of the columns over each fold's members.

    See Mirzababaei & Akbari, section 6, which does not say how inputs are scaled; rules are those of
    scikit-learn's ``StandardScaler``.

    Parameters
    ----------
    values
        Readings or coordinates, [n, column].
    member
        [fold, n], True where a row counts in that fold.

    Returns
    -------
    tuple
        Means and deviations, [fold, column]; the deviation of a column that is constant but for rounding
        is 1.
    """
    mean, deviation = np.empty((2, len(member), values.shape[1]))
    for fold, chosen in enumerate(member):
        inside = values[chosen]
        mean[fold] = inside.mean(axis=0)
        variance = inside.var(axis=0)
        epsilon = np.finfo(np.float64).eps
        least = len(inside) * (epsilon * variance + len(inside) * (mean[fold] * epsilon) ** 2)
        deviation[fold] = np.sqrt(np.where(variance <= least, 1.0, variance))
    return mean, deviation


def signal_distance_db(first_dbm: ArrayLike, second_dbm: ArrayLike) -> Array:
    """Return the Euclidean distance between fingerprints in signal space.

    See Mirzababaei & Akbari, eqs. 65 and 69. Each pair is computed by itself, so that equal
    fingerprints have exactly equal distances, whatever else is in the arrays.

    Parameters
    ----------
    first_dbm, second_dbm
        Fingerprints without NaN, [m, ap] and [n, ap], dBm.

    Returns
    -------
    Array
        [m, n], dB.
    """
    first, second = (np.asarray(readings, dtype=np.float64) for readings in (first_dbm, second_dbm))
    if len(first) * second.size >= _MANY_DIFFERENCES:
        from scipy.spatial.distance import cdist

        return np.asarray(cdist(first, second))
    # Access point after access point, as SciPy adds them up.
    squared = np.zeros((len(first), len(second)))
    difference = np.empty_like(squared)
    for one, other in zip(first.T, second.T, strict=True):
        np.subtract(one[:, None], other, out=difference)
        difference *= difference
        squared += difference
    return np.sqrt(squared, out=squared)


def nearest_members(distance_db: Array, count: int, member: Mask | None = None, name: str = "k") -> Index:
    """Return the indices of the nearest fingerprints, the nearest first, ties by index.

    See Mirzababaei & Akbari, section 6, step 1 of WKNN.

    Parameters
    ----------
    distance_db
        Distances to the training fingerprints, [m, n], dB.
    count
        How many neighbours.
    member
        [m, n], False where a fingerprint must not be used; None allows all.
    name
        The name under which the user set ``count``, for the error.

    Returns
    -------
    NDArray
        [m, count].

    Raises
    ------
    InputError
        If ``count`` is no whole number, not positive, or larger than the smallest training set.
    """
    check_whole(name, count)
    least = (
        distance_db.shape[1] if member is None else int(member.sum(axis=1).min(initial=distance_db.shape[1]))
    )
    if not 1 <= count <= least:
        raise InputError(
            f"{name}={count}",
            f"it must lie between 1 and the number of training fingerprints, {least}",
            f"Choose a smaller {name}, or survey more places",
        )
    distance = distance_db if member is None else np.where(member, distance_db, np.inf)
    order: Index = np.argsort(distance, axis=1, kind="stable")[:, :count]
    return order


def checked_survey(rss_dbm: ArrayLike, position_m: ArrayLike, least: int = 1) -> tuple[Array, Array]:
    """Return fingerprints and their positions as arrays that can train.

    See Mirzababaei & Akbari, section 6.

    Parameters
    ----------
    rss_dbm
        Received signal strength, [n, ap], dBm; NaN = not heard.
    position_m
        Where each fingerprint was taken, [n, 2], metres.
    least
        The smallest number of fingerprints.

    Raises
    ------
    InputError
        If the survey cannot be used.
    """
    rss = np.asarray(rss_dbm, dtype=np.float64)
    position = np.asarray(position_m, dtype=np.float64)
    Survey(rss_dbm=rss, position_m=position).check("training survey", least)
    return rss, position


class FingerprintRegressor(Regressor):
    """A scikit-learn regressor from fingerprints to positions: the checks that all of them share.

    See Mirzababaei & Akbari, section 6. An algorithm may as well derive from scikit-learn's classes
    directly; this base only saves it the checks.
    """

    def _training(self, rss_dbm: ArrayLike, position_m: ArrayLike, least: int = 1) -> tuple[Array, Array]:
        """Return a checked survey and remember its number of access points."""
        rss, position = checked_survey(rss_dbm, position_m, least)
        self.n_features_in_ = rss.shape[1]
        return rss, position

    def _readings(self, rss_dbm: ArrayLike) -> Array:
        """Return fingerprints to be located if they fit the survey of the training."""
        self._check_fitted()
        rss = np.asarray(rss_dbm, dtype=np.float64)
        if rss.ndim != 2 or rss.shape[1] != self.n_features_in_:
            raise InputError(
                f"fingerprints of shape {rss.shape}",
                f"[m, {self.n_features_in_}] is needed, as in the training survey",
                "Give one column for each access point of the survey, NaN where it was not heard",
            )
        return rss


class FillNotHeard(Transformer):
    """Replace NaN by a weak reading, for regressors of other libraries.

    See Mirzababaei & Akbari, section 6; the paper does not say how not heard is treated.

    Parameters
    ----------
    value_dbm
        What stands for not heard, dBm; None: one dB below the weakest reading of the fit.

    Attributes
    ----------
    value_dbm_
        The value in use, dBm.
    """

    # A fit in which nothing was heard has no weakest reading; any number will do then.
    _NOTHING_HEARD_DBM = -100.0

    def __init__(self, *, value_dbm: float | None = None) -> None:
        self.value_dbm = value_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: Any = None) -> Self:
        """Find the value that stands for not heard.

        See Mirzababaei & Akbari, section 6.

        Parameters
        ----------
        rss_dbm
            Received signal strength of the training, [n, ap], dBm; NaN = not heard.
        position_m
            Not used.
        """
        rss = np.asarray(rss_dbm, dtype=np.float64)
        heard = rss[~np.isnan(rss)]
        weakest = heard.min() - 1.0 if heard.size else self._NOTHING_HEARD_DBM
        self.value_dbm_ = float(weakest if self.value_dbm is None else self.value_dbm)
        self.n_features_in_ = rss.shape[1]
        return self

    def transform(self, rss_dbm: ArrayLike) -> Array:
        """Return the readings without NaN.

        See Mirzababaei & Akbari, section 6.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [m, ap], dBm; NaN = not heard.
        """
        self._check_fitted()
        return fill_not_heard(rss_dbm, self.value_dbm_)
