"""Fingerprinting: from received signal strengths to a place, with a survey to learn from."""

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.estimator import clone
from positioning.model import Array, Arrays, Query, Site, Survey, Truth, world
from positioning.registry import Factory
from positioning.tasks import Outcome

OPTIONS = ("protocol",)
QUANTITY = "position"


def leave_one_out(algorithm: Any, survey: Survey, query: Query | None) -> Array:
    """Locate every fingerprint of the survey with all those taken at other places.

    The whole reference point is left out: fingerprints at the tested one's own position never train.
    """
    # Imported here, because scoring uses this module and must not wait for scikit-learn.
    from positioning.fingerprints import training_members

    if hasattr(algorithm, "leave_one_out"):
        return np.asarray(algorithm.leave_one_out(survey.rss_dbm, survey.position_m), dtype=float)
    return _refit(algorithm, survey, training_members(survey.position_m))


def holdout(algorithm: Any, survey: Survey, query: Query | None) -> Array:
    """Locate every second fingerprint with the others, and these with the former."""
    even = np.arange(len(survey.rss_dbm)) % 2 == 0
    return _refit(algorithm, survey, even[:, None] != even[None, :])


def resubstitution(algorithm: Any, survey: Survey, query: Query | None) -> Array:
    """Locate every fingerprint with the whole survey, itself included: too good, shown as such."""
    algorithm.fit(survey.rss_dbm, survey.position_m)
    return np.asarray(algorithm.predict(survey.rss_dbm), dtype=float)


def survey_to_query(algorithm: Any, survey: Survey, query: Query | None) -> Array:
    """Learn from the survey and locate the query, as published data sets are split."""
    if query is None:
        raise InputError("protocol survey_to_query", "these data have no query", "Use leave_one_out")
    algorithm.fit(survey.rss_dbm, survey.position_m)
    return np.asarray(algorithm.predict(query.rss_dbm), dtype=float)


PROTOCOLS: dict[str, Callable[[Any, Survey, Query | None], Array]] = {
    protocol.__name__: protocol for protocol in (leave_one_out, holdout, resubstitution, survey_to_query)
}


def run(
    make: Factory,
    observed: Arrays,
    truth: Arrays | None,
    options: Mapping[str, Any],
    generators: Sequence[np.random.Generator],
) -> Outcome:
    """Run a fingerprinting algorithm on every world of a stack.

    Parameters
    ----------
    make
        Makes the algorithm.
    observed
        Arrays of `Survey`, `Site` and, where the data are split, `Query`, with a world axis.
    truth
        Arrays of `Truth` for a control, else None.
    options
        ``protocol``: how it is tested; by default `survey_to_query` where there is a query and
        `leave_one_out` where there is none.
    generators
        One for every world.

    Returns
    -------
    Outcome
        With ``position_m`` [world, n, 2], metres.

    Raises
    ------
    InputError
        For data that cannot be used, or an answer of the wrong shape or with NaN in it.
    """
    positions, seconds = [], []
    for index, rng in enumerate(generators):
        arrays = world(observed, index)
        survey, site, query = Survey.from_arrays(arrays), Site.from_arrays(arrays), Query.from_arrays(arrays)
        if survey is None:
            raise InputError(
                "observed worlds", "they hold no survey", "Give fingerprinting a study with surveys"
            )
        survey.check()
        seen = Truth.from_arrays(world(truth, index)) if truth is not None else None
        algorithm = make(site=site, truth=seen, random_state=int(rng.integers(2**31)))
        shown = (survey, site) if seen is None else (survey, site, seen)
        if hasattr(algorithm, "skip") and (reason := algorithm.skip(*shown)):
            return Outcome(skipped=str(reason))
        protocol = options.get("protocol") or ("leave_one_out" if query is None else "survey_to_query")
        start = perf_counter()
        position = PROTOCOLS[protocol](algorithm, survey, query)
        seconds.append(perf_counter() - start)
        asked = survey if protocol != "survey_to_query" or query is None else query
        positions.append(_checked(position, len(asked.rss_dbm)))
    return Outcome(estimates={"position_m": np.stack(positions)}, seconds=np.asarray(seconds))


def score(estimates: Arrays, truth: Arrays) -> dict[str, NDArray[np.float64]]:
    """Return the error of every located fingerprint: distance and components, [world, n], metres."""
    offset = np.asarray(estimates["position_m"], dtype=float) - np.asarray(
        truth["truth.position_m"], dtype=float
    )
    return {
        "error_m": np.hypot(offset[..., 0], offset[..., 1]),
        "error_x_m": offset[..., 0],
        "error_y_m": offset[..., 1],
    }


def _refit(algorithm: Any, survey: Survey, members: NDArray[np.bool_]) -> Array:
    """Train anew for every different row of ``members`` [n, n] and locate its fingerprints."""
    answers = np.empty((len(members), 2))
    folds: dict[bytes, list[int]] = {}
    for index, member in enumerate(members):
        folds.setdefault(member.tobytes(), []).append(index)
    for number, tested in enumerate(folds.values()):
        member = members[tested[0]]
        with _checks_once(number):
            fresh = clone(algorithm).fit(survey.rss_dbm[member], survey.position_m[member])
            answers[tested] = _checked(fresh.predict(survey.rss_dbm[tested]), len(tested))
    return answers


def _checks_once(number: int) -> AbstractContextManager[None]:
    """Spare scikit-learn its checks of settings and data that have passed them in fold 0."""
    if "sklearn" not in sys.modules:
        return nullcontext()
    from sklearn import config_context

    context: AbstractContextManager[None] = config_context(
        assume_finite=number > 0, skip_parameter_validation=number > 0
    )
    return context


def _checked(position_m: Any, count: int) -> Array:
    """Return an algorithm's answer if it is what the contract asks for."""
    position = np.asarray(position_m, dtype=float)
    if position.shape != (count, 2) or not np.isfinite(position).all():
        raise InputError(
            "its answer",
            f"shape {position.shape} with {np.count_nonzero(~np.isfinite(position))} values that are not"
            f" finite; {(count, 2)} finite coordinates in metres are needed",
            "Correct the algorithm",
        )
    return position
