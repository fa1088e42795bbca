"""Tracking: from a recording, epoch after epoch, to a track with its covariance."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.answers import checked_array
from positioning.errors import InputError
from positioning.model import Arrays, Recording, Track
from positioning.ranging import TooManyCombinations
from positioning.registry import Factory
from positioning.stacks import Stack, stack
from positioning.tasks import Outcome

OPTIONS = ("fixes", "steps")
QUANTITY = "position"


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run a tracking algorithm on every recording of a stack of worlds.

    One with ``track_stack`` gets all recordings at once, filled up with NaN behind their ends; any other
    gets one after the other, each as long as it is. Epochs that all have the same time are places
    without an order: what needs an order does not run on them, unless the algorithm says
    ``needs_order = False``.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays of `Recording`, `Site`, and `Survey` or `Calibration`, with a world axis.
    truth
        Arrays of `Truth` for a control, else None.
    options
        ``fixes`` names a trilateration row, ``steps`` a tracking row that finds steps; what they found stands
        in the recordings already.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``position_m`` [world, ..., n, 2] and ``covariance_m2`` [world, ..., n, 2, 2], and
        ``extra_<name>`` for whatever else the algorithm keeps.

    Raises
    ------
    InputError
        For data without a site, or an answer of the wrong shape or with NaN in it.
    """
    if "recording.time_s" not in observed:
        return Outcome(skipped="there is no recording")
    stacked = stack(observed, truth, generators)
    algorithm = make(**({} if stacked.truth is None else {"truth": stacked.truth}))
    given = (stacked.recording, stacked.survey, stacked.site)
    if hasattr(algorithm, "skip") and (reason := algorithm.skip(*given)):
        return Outcome(skipped=str(reason))
    if getattr(algorithm, "needs_order", True) and _without_order(stacked.recording):
        return Outcome(skipped="the epochs are static places without an order in time")
    start = perf_counter()
    try:
        if hasattr(algorithm, "track_stack"):
            track = algorithm.track_stack(*given, stacked.generators)
            _check_times(track, stacked.recording)
        else:
            track = _one_by_one(algorithm, stacked)
    except TooManyCombinations as error:
        return Outcome(skipped=str(error))
    seconds = np.full(len(generators), (perf_counter() - start) / len(generators))
    _check(track, stacked)
    estimates = {"position_m": track.position_m, "covariance_m2": track.covariance_m2}
    estimates |= {f"extra_{name}": np.asarray(values) for name, values in track.extra.items()}
    return Outcome(
        estimates={name: stacked.unstacked(values) for name, values in estimates.items()}, seconds=seconds
    )


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the position error of each epoch, [world, epoch over all runs], metres.

    ``nees`` is the normalised estimation error squared: 2 on average where the covariance is right.
    """
    true_m = np.asarray(truth["truth.position_m"], dtype=float)
    worlds = len(true_m)
    offset = (np.asarray(estimates["position_m"], dtype=float) - true_m).reshape(worlds, -1, 2)
    covariance_m2 = np.asarray(estimates["covariance_m2"], dtype=float).reshape(worlds, -1, 2, 2)
    asked = ~np.isnan(offset).any(axis=-1)
    nees = np.full(asked.shape, np.nan)
    inverse = np.linalg.pinv(covariance_m2[asked], hermitian=True)
    nees[asked] = np.einsum("si,sij,sj->s", offset[asked], inverse, offset[asked])
    return {
        "error_m": np.hypot(offset[..., 0], offset[..., 1]),
        "error_x_m": offset[..., 0],
        "error_y_m": offset[..., 1],
        "nees": nees,
    }


def _without_order(recording: Recording) -> bool:
    times_s = recording.time_s
    return times_s.shape[-1] > 1 and bool(np.all(np.isnan(times_s) | (times_s == times_s[:, :1])))


def _one_by_one(algorithm: Any, stacked: Stack) -> Track:
    longest, tracks = stacked.recording.time_s.shape[1], []
    for index, rng in enumerate(stacked.generators):
        recording = stacked.recording.at(index)
        count = int(np.count_nonzero(~np.isnan(recording.time_s)))
        survey = None if stacked.survey is None else stacked.survey.at(index)
        recording = recording.until(count)
        track = algorithm.track(recording, survey, stacked.site.at(index), rng)
        _check_times(track, recording)
        tracks.append(_filled(track, count, longest))
    return Track(
        time_s=stacked.recording.time_s,
        position_m=np.stack([track.position_m for track in tracks]),
        covariance_m2=np.stack([track.covariance_m2 for track in tracks]),
        extra={name: np.stack([track.extra[name] for track in tracks]) for name in tracks[0].extra},
    )


def _filled(track: Track, count: int, longest: int) -> Track:
    def fill(values: NDArray[np.generic]) -> NDArray[np.float64]:
        found = np.asarray(values, dtype=float)
        if len(found) != count:
            raise InputError(
                "its answer", f"{len(found)} epochs for a recording of {count}", "Answer for every epoch"
            )
        return np.concatenate([found, np.full((longest - count, *found.shape[1:]), np.nan)])

    return Track(
        time_s=fill(track.time_s),
        position_m=fill(track.position_m),
        covariance_m2=fill(track.covariance_m2),
        extra={name: fill(values) for name, values in track.extra.items()},
    )


def _check_times(track: Any, recording: Recording) -> None:
    if not isinstance(track, Track):
        raise InputError(
            "its answer",
            f"it is a {type(track).__name__}, not a Track",
            "Return positioning.model.Track(time_s=..., position_m=..., covariance_m2=...)",
        )
    answered_s, asked_s = np.asarray(track.time_s, dtype=float), np.asarray(recording.time_s, dtype=float)
    if len(answered_s) != len(asked_s):
        raise InputError(
            "its answer",
            f"{len(answered_s)} epochs for a recording of {len(asked_s)}",
            "Answer for every epoch",
        )
    if not np.array_equal(answered_s, asked_s, equal_nan=True):
        raise InputError(
            "its answer, time_s",
            "it differs from that of the recording",
            "Answer at the epochs of the recording, in their order, with time_s=recording.time_s",
        )


def _check(track: Track, stacked: Stack) -> None:
    asked = ~np.isnan(stacked.recording.time_s)
    axes = ("recording", "epoch")
    checked_array("position_m", track.position_m, asked, (2,), axes)
    covariance_m2 = checked_array("covariance_m2", track.covariance_m2, asked, (2, 2), axes)
    smallest = np.linalg.eigvalsh(covariance_m2[asked])[..., 0]
    if not (smallest >= -1e-9 * np.abs(covariance_m2[asked]).max(axis=(-1, -2), initial=0.0)).all():
        raise InputError(
            "its answer, covariance_m2",
            f"it has a negative variance, {smallest.min():.3g} square metres",
            "Return a positive semi-definite matrix for every epoch",
        )
