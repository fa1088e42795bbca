"""What is looked at in a flight with an outage of GPS: errors in it, consistency, conditioning.

See Mirzababaei & Akbari, sections 3 to 5; the paper prints no figure of a flight.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.statistics import mean_where
from positioning.evaluation.tracks import Answer, Named, Values, answers, lines, share, table
from positioning.files import Tree
from positioning.inertial.geodetic import attitude_of
from positioning.inertial.strapdown import rotation_vector

LIMIT_M = 2.66
"""See the abstract: the largest error with which the flyer can land."""

SETTLED_S = 30.0
"""Consistency under GPS is looked at from here on, when the start is forgotten; assumed."""

SENSORS = ("gps", "fix", "sighting")


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the study's own measures of every row, one value a world, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the worlds by path, ``.../<batch>/<side>.npz``.

    Returns
    -------
    DataFrame
        In the outage of GPS, which a sweep over ``outage_s`` lengthens: those of `of_outage`, and
        ``outage_below_limit``, the share of its epochs with an error below `LIMIT_M`; none where no epoch
        falls into it. Under GPS, from `SETTLED_S` to the outage: ``gps_mean_m``, ``gps_rms_m``;
        ``gps_lag_s``, that of `lag_s`; ``gps_nees``, of nine states, 9 on average where the covariance is
        right. ``outage_nees`` is the same in the outage.
        ``nis_gps``, ``nis_fix``, ``nis_sighting``: normalised innovation squared per degree of freedom.
        ``condition``: logarithm to base ten of the condition number of the innovation covariance.
    """
    return table(lines(answer, _of_row(answer)) for answer in answers(estimates, worlds))


def of_outage(answer: Answer, error_m: Values, inside: NDArray[np.bool_]) -> Iterator[Named]:
    """Yield the errors in an outage of GPS; NaN where it has no epoch with a true place.

    ``outage_mean_m``, ``outage_max_m`` and ``outage_final_m``, horizontal, and ``outage_height_m``, the
    largest error of the height, of rows that keep it.

    Parameters
    ----------
    answer
        Of a row.
    error_m
        Horizontal, [w, n].
    inside
        Which epochs are in the outage, and have a true place, [w, n].
    """
    yield "outage_mean_m", mean_where(error_m, inside)
    yield "outage_max_m", _largest(error_m, inside)
    last = error_m.shape[1] - 1 - np.argmax(inside[:, ::-1], axis=1)
    final_m = np.take_along_axis(error_m, last[:, None], axis=1)[:, 0]
    yield "outage_final_m", np.where(inside.any(axis=1), final_m, np.nan)
    if "extra_height_m" in answer.estimates and "truth.height_m" in answer.truth:
        height_m = np.asarray(answer.estimates["extra_height_m"], dtype=float)
        off_m = np.abs(height_m - np.asarray(answer.truth["truth.height_m"], dtype=float))
        yield "outage_height_m", _largest(off_m, inside)


def outage(answer: Answer) -> tuple[Values, Values, NDArray[np.bool_]]:
    """Return when GPS is out, and where.

    Parameters
    ----------
    answer
        Of a row; a sweep whose name begins with ``outage`` varies the length in seconds.

    Returns
    -------
    begin_s
        [w, 1]; NaN without an outage.
    error_m
        Horizontal, [w, n]; NaN without a true place.
    inside
        Epochs after the begin, until the end, that have a true place, [w, n].
    """
    time_s = np.asarray(answer.observed["recording.time_s"], dtype=float)
    begin_s, end_s = np.asarray(answer.observed["recording.gps_outage_s"], dtype=float).T[:, :, None]
    if answer.row.startswith("outage") and np.isfinite(answer.value):
        end_s = begin_s + answer.value
    true_m = np.asarray(answer.truth["truth.position_m"], dtype=float)
    error_m = np.linalg.norm(np.asarray(answer.estimates["position_m"], dtype=float) - true_m, axis=-1)
    known = np.isfinite(true_m).all(axis=-1)
    return begin_s, error_m, (time_s > begin_s) & (time_s <= end_s) & known


def _of_row(answer: Answer) -> Iterator[Named]:
    begin_s, error_m, inside = outage(answer)
    time_s = np.asarray(answer.observed["recording.time_s"], dtype=float)
    before = (time_s >= SETTLED_S) & (time_s <= begin_s)
    yield from of_outage(answer, error_m, inside)
    yield "outage_below_limit", share(error_m < LIMIT_M, inside)
    yield "gps_mean_m", mean_where(error_m, before)
    yield "gps_rms_m", np.sqrt(mean_where(np.square(error_m), before))
    if "truth.velocity_m_per_s" in answer.truth:
        yield "gps_lag_s", lag_s(answer, before & np.isfinite(error_m))
    if "extra_covariance_9" in answer.estimates:
        nees = nees_of(answer)
        yield "gps_nees", mean_where(nees, before)
        yield "outage_nees", mean_where(nees, inside)
    for sensor in SENSORS:
        if f"extra_nis_{sensor}" in answer.estimates:
            yield f"nis_{sensor}", np.asarray(answer.estimates[f"extra_nis_{sensor}"], dtype=float)
    if "extra_innovation_condition" in answer.estimates:
        yield "condition", np.log10(np.asarray(answer.estimates["extra_innovation_condition"], dtype=float))


def lag_s(answer: Answer, chosen: NDArray[np.bool_]) -> Values:
    """Return by how much a track lags behind: the shift in time that leaves the least horizontal error, [w].

    See Mirzababaei & Akbari, section 3, which speaks of a time lag where Q is smaller than the true one. To
    first order an error ``e`` of a lag ``t`` at the velocity ``v`` is ``-v t``, so that least squares has
    ``t = -sum(e v) / sum(v v)``; negative where the track is ahead, NaN where nothing moves.

    Parameters
    ----------
    answer
        Of a row, with a true velocity.
    chosen
        Epochs, [w, n].
    """
    off_m, velocity = (
        np.where(chosen[..., None], np.asarray(values, dtype=float), 0.0)
        for values in (
            np.asarray(answer.estimates["position_m"], dtype=float) - answer.truth["truth.position_m"],
            answer.truth["truth.velocity_m_per_s"][..., 1::-1],
        )
    )
    squared = np.sum(np.square(velocity), axis=(1, 2))
    moves = squared > 0
    along = np.sum(off_m * velocity, axis=(1, 2))
    return np.where(moves, -along / np.where(moves, squared, 1.0), np.nan)


def _largest(values: Values, chosen: NDArray[np.bool_]) -> Values:
    """Return the largest of the chosen entries, [w]; NaN where none is."""
    most = np.max(np.where(chosen, values, -np.inf), axis=1)
    return np.where(chosen.any(axis=1), most, np.nan)


def nees_of(answer: Answer) -> Values:
    """Return the normalised estimation error squared of position, velocity and attitude, [w, n].

    See Mirzababaei & Akbari, eqs. 3 to 5: errors are navigation less truth, that of the attitude is the
    rotation that leads from the navigated to the true attitude.

    Parameters
    ----------
    answer
        Of a row that keeps all nine states and their covariance.
    """
    estimates, truth = answer.estimates, answer.truth

    def part(side: Mapping[str, NDArray[np.generic]], name: str) -> Values:
        return np.asarray(side[name], dtype=float)

    east_north_m = part(estimates, "position_m") - part(truth, "truth.position_m")
    up_m = part(estimates, "extra_height_m") - part(truth, "truth.height_m")
    position_m = np.stack([east_north_m[..., 1], east_north_m[..., 0], -up_m], axis=-1)
    velocity = part(estimates, "extra_velocity_m_per_s") - part(truth, "truth.velocity_m_per_s")
    navigated, true = (
        attitude_of(part(side, name))
        for side, name in ((estimates, "extra_attitude_rad"), (truth, "truth.attitude_rad"))
    )
    attitude_rad = -rotation_vector(navigated @ np.swapaxes(true, -1, -2))
    error = np.concatenate([position_m, velocity, attitude_rad], axis=-1)
    covariance = part(estimates, "extra_covariance_9")
    known = np.isfinite(error).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2))
    nees = np.full(known.shape, np.nan)
    solved = np.linalg.solve(covariance[known], error[known][..., None])[..., 0]
    nees[known] = np.sum(error[known] * solved, axis=-1)
    return nees
