"""The verdict on each claim of a paper: printed numbers beside rebuilt ones, by rules fixed beforehand.

A claim says where it stands in the paper, its digits as printed, what quantity of the study it
speaks of, and its kind:

======== ==========================================================================================
value    a number (also a share): ``reproduced`` where the printed digits lie inside the central 95 %
         of single experiments over the worlds, else ``not reproduced`` with the distance
ordering the quantities ascend in the order listed; ratio and bound: a quantity (or its ratio to
         another) keeps to ``at_least`` / ``at_most``. The share of worlds in which that is so decides:
         ``holds`` from 95 %, ``fails`` to 5 %, else ``depends``
exact    a deterministic scenario: ``exact`` where the rebuilt number has the printed digits
none     the paper gives no number: the rebuilt one is reported, ``none given``
words    nothing that a study here can measure: ``not testable``, or ``contradicts itself`` where the
         paper's own words do so, with the reason
======== ==========================================================================================

Before worlds decide an ordering, a ratio or a bound, the paper's own printed numbers are put into it:
if they break it, the claim ``contradicts itself``. A number that set a free parameter is ``calibrated``.
Where worlds are too few for a 95 % interval and the printed number lies outside what they span, the
verdict is ``undecided``: that happens in quick builds only.
"""

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.evaluation.statistics import CONFIDENCE, share_interval, single_experiment_interval

VERDICTS = (
    "exact",
    "reproduced",
    "holds",
    "depends",
    "not reproduced",
    "fails",
    "contradicts itself",
    "calibrated",
    "none given",
    "not testable",
    "undecided",
)
COLUMNS = ["claim", "paper", "study", "where", "what", "unit"]
COLUMNS += ["printed", "rebuilt", "low", "high", "worlds", "verdict", "reason"]


def judge(
    claims: Sequence[Mapping[str, Any]],
    measures: pd.DataFrame,
    *,
    paper: str,
    study: str,
    calibrated: Mapping[str, str],
) -> pd.DataFrame:
    """Return the ledger of a study: one row a claim, columns ``COLUMNS``.

    Parameters
    ----------
    claims
        The study's claims, as in ``data/papers/<key>.yaml``.
    measures
        One value a row: ``family, algorithm, value, world, metric, x``; ``value`` is the setting of a
        sweep, NaN for rows of the table.
    paper, study
        Keys of the paper and of the study.
    calibrated
        Claims that set a free parameter, with the sentence that says which.

    Raises
    ------
    InputError
        For a claim whose quantity the study does not measure.
    """
    rows = []
    for claim in claims:
        rows.append(
            {
                "claim": claim["id"],
                "paper": paper,
                "study": study,
                "where": claim["where"],
                "what": claim["what"],
                "unit": claim.get("unit", ""),
                "printed": claim.get("printed", ""),
                **_judge_one(claim, claims, measures, calibrated),
            }
        )
    return pd.DataFrame(rows, columns=COLUMNS)


def per_world(measures: pd.DataFrame, quantity: Mapping[str, Any], name: str) -> pd.Series:
    """Return a quantity's value in every world, indexed by world.

    Parameters
    ----------
    measures
        As in `judge`.
    quantity
        ``{algorithm, metric}`` for a row of the table; ``{sweep, metric, at}`` for a point of a
        sweep; ``{sweep, argmin}`` for the setting at which a sweep's metric is smallest. With
        ``family`` where it is not the first.
    name
        The claim, for the error.

    Raises
    ------
    InputError
        Where nothing of that name was measured.
    """
    family = quantity.get("family", measures["family"].iloc[0] if len(measures) else "")
    algorithm = quantity.get("algorithm", quantity.get("sweep"))
    metric = quantity.get("metric", quantity.get("argmin"))
    chosen = measures[
        (measures["family"] == family) & (measures["algorithm"] == algorithm) & (measures["metric"] == metric)
    ]
    if "at" in quantity:
        chosen = chosen[chosen["value"] == quantity["at"]]
    if chosen.empty:
        raise InputError(
            f"claim {name}",
            f"the study measured no {dict(quantity)}",
            "Name a row or a sweep of config/config.yaml, and a metric of the tables",
        )
    if "argmin" in quantity:
        best = chosen.sort_values(["world", "x", "value"]).groupby("world").first()
        return pd.Series(best["value"])
    return pd.Series(chosen.set_index("world")["x"].sort_index())


def quantities(claim: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return all quantities that a claim speaks of, in its order."""
    single = [claim[key] for key in ("quantity", "to") if key in claim]
    return [*claim.get("quantities", []), *single]


def _judge_one(
    claim: Mapping[str, Any],
    claims: Sequence[Mapping[str, Any]],
    measures: pd.DataFrame,
    calibrated: Mapping[str, str],
) -> dict[str, Any]:
    kind = claim["kind"]
    if kind == "words":
        return _row(verdict=claim.get("verdict", "not testable"), reason=claim["reason"])
    absent = {q.get("algorithm", q.get("sweep")) for q in quantities(claim)} - set(measures["algorithm"])
    if absent:
        names = ", ".join(sorted(map(str, absent)))
        return _row(verdict="not testable", reason=f"the configuration has no row or sweep named {names}")
    if kind in ("value", "exact", "none"):
        values = per_world(measures, claim["quantity"], claim["id"]).to_numpy(dtype=float)
        if claim["id"] in calibrated:
            interval = single_experiment_interval(values)
            return _row(values.mean(), interval, len(values), "calibrated", calibrated[claim["id"]])
        return {"value": _value, "exact": _exact, "none": _none}[kind](claim, values)
    return _condition(claim, claims, measures)


def _value(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    printed, interval, n = float(claim["printed"]), single_experiment_interval(values), len(values)
    half = _half_unit(claim["printed"])
    span = f"{_short(interval.low)} to {_short(interval.high)}"
    covers = f"the central {100 * interval.coverage:.0f} % of single experiments over {n} worlds"
    if interval.low - half <= printed <= interval.high + half:
        return _row(values.mean(), interval, n, "reproduced", f"inside {span}, {covers}")
    distance = printed - values.mean()
    spread = (
        f", {abs(distance) / values.std(ddof=1):.1f} standard deviations"
        if n > 1 and values.std() > 0
        else ""
    )
    side = "above" if distance > 0 else "below"
    reason = f"outside {span}, {covers}: {abs(distance):.3g} {side} the mean{spread}"
    if interval.coverage < CONFIDENCE:
        return _row(values.mean(), interval, n, "undecided", reason + "; too few worlds for a 95 % interval")
    return _row(values.mean(), interval, n, "not reproduced", _with_note(reason, claim))


def _exact(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    rebuilt = values[0]
    digits = -int(Decimal(claim["printed"]).as_tuple().exponent)
    if f"{rebuilt:.{digits}f}" == f"{Decimal(claim['printed']):.{digits}f}":
        return _row(rebuilt, None, len(values), "exact", "every printed digit")
    reason = f"rebuilt {rebuilt:.{digits + 2}f}, a difference of {abs(rebuilt - float(claim['printed'])):.3g}"
    return _row(rebuilt, None, len(values), "not reproduced", _with_note(reason, claim))


def _none(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    interval = single_experiment_interval(values)
    return _row(
        values.mean(), interval, len(values), "none given", _with_note("the paper prints no number", claim)
    )


def _condition(
    claim: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], measures: pd.DataFrame
) -> dict[str, Any]:
    """Judge an ordering, a ratio or a bound by the share of worlds in which it holds."""
    columns = pd.concat(
        [per_world(measures, q, claim["id"]) for q in quantities(claim)], axis=1, join="inner"
    )
    met = np.asarray([_holds(claim, row) for row in columns.to_numpy(dtype=float)])
    successes, n = int(met.sum()), len(met)
    interval, share = share_interval(successes, n), successes / n
    verdict = "holds" if share >= CONFIDENCE else "fails" if share <= 1 - CONFIDENCE else "depends"
    reason = f"true in {successes} of {n} worlds"
    own = [_printed_number(q, claims) for q in quantities(claim)]
    if all(number is not None for number in own):
        numbers = [float(number) for number in own if number is not None]
        arithmetic = _arithmetic(claim, [str(number) for number in own])
        if not _holds(claim, np.asarray(numbers)):
            verdict, reason = "contradicts itself", f"the paper prints {arithmetic}; {reason}"
        else:
            reason += f"; the paper prints {arithmetic}"
    return _row(share, interval, n, verdict, _with_note(reason, claim))


def _holds(claim: Mapping[str, Any], numbers: NDArray[np.float64]) -> bool:
    if claim["kind"] == "ordering":
        return bool(np.all(np.diff(numbers) > 0))
    number = numbers[0] / numbers[1] if claim["kind"] == "ratio" else numbers[0]
    low, high = claim.get("at_least"), claim.get("at_most")
    return (low is None or number >= float(low) - _half_unit(low)) and (
        high is None or number <= float(high) + _half_unit(high)
    )


def _arithmetic(claim: Mapping[str, Any], printed: Sequence[str]) -> str:
    limits = [
        f"{word} {claim[key]}"
        for key, word in (("at_least", "at least"), ("at_most", "at most"))
        if key in claim
    ]
    wanted = " and ".join(limits)
    if claim["kind"] == "ordering":
        return ", ".join(printed) + " (ascending is claimed)"
    if claim["kind"] == "ratio":
        return (
            f"{printed[0]} / {printed[1]} = {float(printed[0]) / float(printed[1]):.3f} ({wanted} is claimed)"
        )
    return f"{printed[0]} ({wanted} is claimed)"


def _printed_number(quantity: Mapping[str, Any], claims: Sequence[Mapping[str, Any]]) -> str | None:
    """Find the number that the paper prints for a quantity among its value claims."""
    return next((c["printed"] for c in claims if c["kind"] == "value" and c["quantity"] == quantity), None)


def _half_unit(printed: str) -> float:
    """Half a unit of the last printed digit: a rounded number stands for all that round to it."""
    return float(Decimal(5).scaleb(int(Decimal(printed).as_tuple().exponent) - 1))


def _short(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _with_note(reason: str, claim: Mapping[str, Any]) -> str:
    return f"{reason}; {claim['note']}" if "note" in claim else reason


def _row(
    rebuilt: float | None = None,
    interval: Any = None,
    worlds: int = 0,
    verdict: str = "",
    reason: str = "",
) -> dict[str, Any]:
    nothing = float("nan")
    return {
        "rebuilt": nothing if rebuilt is None else float(rebuilt),
        "low": nothing if interval is None else interval.low,
        "high": nothing if interval is None else interval.high,
        "worlds": worlds,
        "verdict": verdict,
        "reason": reason,
    }
